"""Maneuvering walk in place of figure 6 of Bai and Takahashi.

The figure is missing in our copy. The text describes one person who starts, stops and turns sharply, about 85 scans at T =
0.1 s, seen by a rig at the origin. The script below is ours: two stops and starts, three sharp turns, one of them on the
spot, and a run, within human limits: speeds up to 2.6 m/s, accelerations up to 7 m/s² (sideways in a turn; 4 m/s² ahead),
turn rates up to 2π rad/s on the spot. It follows no filter's model: speed and heading change at a constant rate during a
leg. It was not chosen by the filters' results.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from trackers.arrays import Array

Kind = Literal["steady", "start", "stop", "turn"]

PERIOD_S = 0.1
"""Scan period T of the paper."""

_STEP_S = 0.001  # of the integration; scans fall on every hundredth step


@dataclass(frozen=True)
class Leg:
    """Stretch of the walk: speed changes evenly to `speed_m_s`, heading turns evenly by `turn_rad`, in `duration_s`."""

    kind: Kind
    duration_s: float
    speed_m_s: float
    turn_rad: float = 0.0


START_M = (1.0, 1.5)
START_HEADING_RAD = 0.3
START_SPEED_M_S = 1.2
LEGS = (
    Leg("steady", 1.0, 1.2),
    Leg("stop", 0.3, 0.0),
    Leg("steady", 0.7, 0.0),
    Leg("start", 0.4, 1.4),
    Leg("steady", 0.8, 1.4),
    Leg("turn", 0.4, 1.4, np.radians(100)),
    Leg("steady", 0.6, 1.4),
    Leg("start", 0.4, 2.6),
    Leg("steady", 0.7, 2.6),
    Leg("turn", 0.6, 1.6, np.radians(-90)),
    Leg("steady", 0.5, 1.6),
    Leg("stop", 0.4, 0.0),
    Leg("turn", 0.5, 0.0, np.radians(180)),  # on the spot
    Leg("start", 0.4, 1.4),
    Leg("steady", 0.7, 1.4),
)


@dataclass(frozen=True)
class Maneuver:
    """Leg that is no steady walking: its kind, start and end [s]."""

    kind: Kind
    start_t: float
    end_t: float


@dataclass(frozen=True, eq=False)
class ManeuveringWalk:
    """The truth at every scan."""

    t: Array  # (k,) [s]
    position: Array  # (k, 2) [m]
    heading: Array  # (k,) [rad]
    speed: Array  # (k,) [m/s]
    turn_rate: Array  # (k,) [rad/s]
    maneuvers: tuple[Maneuver, ...]

    def __len__(self) -> int:
        return len(self.t)


def maneuvering_walk() -> ManeuveringWalk:
    """Sample the walk of `LEGS` every `PERIOD_S`; between two legs the turn rate is that of the earlier one."""
    duration = np.array([leg.duration_s for leg in LEGS])
    ends = np.cumsum(duration)
    starts = ends - duration
    n_step = round(float(ends[-1]) / _STEP_S)
    fine_t = np.arange(n_step + 1) * _STEP_S
    knots = np.concatenate([[0.0], ends])
    speed = np.interp(fine_t, knots, [START_SPEED_M_S, *(leg.speed_m_s for leg in LEGS)])
    turned = np.cumsum([leg.turn_rad for leg in LEGS])
    heading = START_HEADING_RAD + np.interp(fine_t, knots, np.concatenate([[0.0], turned]))
    velocity = speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    moved = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]), axis=0) * _STEP_S
    position = np.concatenate([[START_M], START_M + moved])
    scan = slice(0, None, round(PERIOD_S / _STEP_S))
    t = np.asarray(fine_t[scan], np.float64)
    leg_at = np.minimum(np.searchsorted(ends, t - 1e-9), len(LEGS) - 1)
    rates = np.array([leg.turn_rad / leg.duration_s for leg in LEGS])
    maneuvers = tuple(
        Maneuver(leg.kind, round(float(start), 9), round(float(end), 9))
        for leg, start, end in zip(LEGS, starts, ends, strict=True)
        if leg.kind != "steady"
    )
    return ManeuveringWalk(t, position[scan], heading[scan], speed[scan], rates[leg_at], maneuvers)
