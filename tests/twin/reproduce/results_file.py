"""What every `results.json` holds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

FIELDS = ["where", "row", "column", "paper", "ours", "ci95", "unit", "runs", "paper_system", "baseline"]


def checked_results(folder: Path) -> list[dict[str, Any]]:
    """The results of a reproduction, each with all fields, finite and once."""
    results = json.loads((folder / "results.json").read_text())
    for each in results:
        assert list(each) == FIELDS
        assert each["ci95"][0] <= each["ci95"][1] and np.isfinite([each["ours"], *each["ci95"]]).all()
    assert len({(each["where"], each["row"], each["column"]) for each in results}) == len(results)
    return results
