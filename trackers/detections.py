"""What a tracker's detector saw, told one by one: an optional part of being a tracker.

So the same detections can be given to another tracker, or compared with the truth. A tracker that has `detections()` says
after each `update` and `finish` what the moments it worked therein showed; `twin detections` writes it down.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import Protocol, runtime_checkable


@dataclass(frozen=True, slots=True)
class Detection:
    """One thing that a detector took for a person or a part of one, in the room frame; NaN where it does not say.

    stamp_ns: that of the moment [ns]; sensors: those that saw it; role: what was seen ("waist": a trunk, "knee": legs);
    x, y: ground point [m]; variance_m2: of the position on each axis [m²]; width_m: how wide it was seen [m].
    """

    stamp_ns: int
    sensors: tuple[str, ...]
    role: str
    x: float
    y: float
    variance_m2: float = nan
    width_m: float = nan


@runtime_checkable
class TellsDetections(Protocol):
    """A tracker that tells what its detector saw."""

    def detections(self) -> list[Detection]:
        """The detections of the moments that the last `update` or `finish` worked, oldest first."""
        ...
