"""Detections of a tracker, one by one: an optional part of being a tracker (`trackers.tracks.Reporting`).

So the same detections can be given to another tracker, or compared with the truth; `twin detections` writes them down.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan


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
