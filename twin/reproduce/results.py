"""What a reproduction found, row by row: the paper's figure, ours, and how sure we are of it; `results.json`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from twin.recording.atomic_file import open_atomic


@dataclass(frozen=True)
class Result:
    """One figure. paper: None where the paper prints no number; ci95: over `runs` runs."""

    where: str
    row: str
    column: str
    paper: float | None
    ours: float
    ci95: tuple[float, float]
    unit: str
    runs: int


def write_results(path: Path, results: Sequence[Result]) -> None:
    """Write `results.json`: a list of objects with the fields of `Result`. Raises InputError where it cannot be written."""
    with open_atomic(path) as stream_:
        json.dump([asdict(result) for result in results], stream_, indent=2)
        stream_.write("\n")
