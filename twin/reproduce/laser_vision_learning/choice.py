"""What was tried before M, K, patches and features were chosen, on development seeds and near-identical clothes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trackers.configuration import validate
from trackers.laser_vision_learning.looks import LooksOptions

_CHANGES: Mapping[str, Mapping[str, Any]] = {
    "as chosen": {},
    "M 20, K 15": {"boosting": {"trees": 20, "kept": 15}},
    "M 30, K 21": {"boosting": {"kept": 21}},
    "M 50, K 35": {"boosting": {"trees": 50, "kept": 35}},
    "M 50, K 45": {"boosting": {"trees": 50, "kept": 45}},
    "K 0: fresh every picture": {"boosting": {"kept": 0}},
    "K = M: never trained again": {"boosting": {"kept": 30}},
    "patches of 0.12 m": {"patches": {"size_m": 0.12}},
    "patches of 0.3 m": {"patches": {"size_m": 0.3}},
    "20 patches": {"patches": {"count": 20}},
    "80 patches": {"patches": {"count": 80}},
    "RGB only": {"features": {"kinds": ["rgb"]}},
    "edge orientations only": {"features": {"kinds": ["edges"]}},
    "Haralick texture": {"features": {"kinds": ["texture"]}},
    "without the height on the body": {"height": False},
    "without patches of the room": {"background": 0},
    "colour histogram instead of patches": {"by": "histogram"},
}

VARIANTS: Mapping[str, LooksOptions] = {name: validate(LooksOptions, change, name) for name, change in _CHANGES.items()}
"""Options by what is different in them."""
