"""Two knee scanners that face each other across the flat room of `synthetic_room`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from synthetic_room import AREA, Walk, scan

from trackers.observations import NS_PER_S, LaserScan
from trackers.rig import LaserSensor, Pose, Rig, Role

AWAY_M = 3.6  # how far ahead the second scanner stands, looking back


def laser(back: bool, role: Role = "knee") -> LaserSensor:
    place = (0, AWAY_M if back else 0, 0.45)
    return LaserSensor(
        topic=f"/{back}", role=role, room_from_sensor=Pose(xyz=place, rpy=(0, 0, -np.pi / 2 if back else np.pi / 2))
    )


RIG = Rig(sensors={"front": laser(False), "back": laser(True)}, area=AREA)


def one_scan(walk: Walk | None, k: int, t: float, back: bool, seed: int, role: Role = "knee") -> LaserScan:
    if walk is not None and back:
        walk = Walk(np.array([0.0, AWAY_M]) - walk.position, walk.heading + np.pi, walk.phase)
    observed = scan(walk, k, role, round(t * NS_PER_S), np.random.default_rng([seed, k, back]))
    return replace(observed, sensor="back" if back else "front")


EMPTY = [one_scan(None, k, 0.1 * k, back, 7) for k in range(6) for back in (False, True)]


def observed(walk: Walk, late_s: float = 0.0) -> list[LaserScan]:
    """Both scanners' scans of a walk; the second's `late_s` after the first's."""
    return [one_scan(walk, k, 1 + 0.1 * k + late_s * back, back, 3) for k in range(len(walk)) for back in (False, True)]
