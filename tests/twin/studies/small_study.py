"""A study that takes seconds, and changes of it."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

import yaml

SMALL: dict[str, Any] = {
    "name": "small",
    "scenarios": [{"scenario": "lab-five-people", "set": {"duration_s": 1.5, "sensors.fisheye": None}}],
    "trackers": ["laser-imm"],
    "seeds": [1000, 1001],
    "held_out": {"seeds": [1900, 1901]},
    "devices": {
        "rig": {
            "together": ["waist", "knee"],
            "walls": {"height_m": [0.9, 1.0], "height_every_m": 0.1, "every_m": 2.5, "off_m": 0.2},
            "aim": "area",
            "price": 1500,
        }
    },
    "objectives": [{"kind": "metric", "metric": "hota"}],
    "coverage": {"samples": 4, "seeds": [1950]},
    "search": {"method": "optuna", "candidates": 6, "generation": 2, "replicates": [1, 2]},
}


def changed(changes: dict[str, Any]) -> dict[str, Any]:
    """The small study with values by dotted path; None takes an entry out."""
    content = deepcopy(SMALL)
    for path, value in changes.items():
        here: Any = content
        *parts, last = path.split(".")
        for part in parts:
            here = here[int(part)] if isinstance(here, list) else here.setdefault(part, {})
        if value is None:
            here.pop(last)
        elif isinstance(here, list):
            here[int(last)] = value
        else:
            here[last] = value
    return content


def written(folder: Path, **changes: Any) -> Path:
    """A file of it; a double underscore in a name stands for a dot."""
    path = folder / "small.yaml"
    path.write_text(yaml.safe_dump(changed({name.replace("__", "."): value for name, value in changes.items()})))
    return path
