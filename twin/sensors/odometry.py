"""Odometry of a driving housing: the sum of what its wheels measure, which drifts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from trackers.arrays import Array
from trackers.observations import Odometry
from trackers.rig import OdometrySensor
from twin.instant.snapshot import Snapshot
from twin.sensors.schedule import Timing
from twin.sensors.sensor import Reading, State

_SLIP_M, _SLIP_RAD = 0.05, 0.05
"""Standard deviation of what one slip of the wheels adds to the way [m] and the turn [rad]."""


class OdometryDescription(Timing):
    """Odometry of a driving housing: its pose since the start, summed up of what its wheels measure.

    Errors follow the odometry motion model of S. Thrun, W. Burgard and D. Fox, Probabilistic Robotics, 2005, section 5.4, with
    a systematic part. All three at 0: the true pose.
    """

    rate_hz: float = Field(default=20.0, ge=0.001, le=1000, description="observations per second [Hz]")
    drift: float = Field(
        default=0.01,
        ge=0,
        le=1,
        description="standard deviation of the scale errors of ways and turns, drawn once a run",
    )
    noise: float = Field(
        default=0.01, ge=0, le=1, description="standard deviation of ways per root of their length [m/√m], turns alike"
    )
    slip: float = Field(
        default=0.0, ge=0, le=10, description="how often wheels slip, a few centimetres each, per metre"
    )

    @property
    def is_exact(self) -> bool:
        """True without any error."""
        return not (self.drift or self.noise or self.slip)


@dataclass(frozen=True, eq=False)
class _Summed:
    """True pose and estimate (4, 4) of the last reading, and scale errors of ways and turns."""

    true: Array
    estimate: Array
    scale: Array  # (2,)


class BaseOdometry:
    """The pose of a housing in its odometry frame, which is where it started, with the errors of its description.

    Between two readings the way and the turn of the base are measured with a scale error, with noise that grows with their root,
    and with slips. `frame_from_base` of the truth is exact.
    """

    instants_s = (0.0,)

    def __init__(self, name: str, rig: OdometrySensor, description: OdometryDescription) -> None:
        self.name = name
        self._rig = rig
        self._description = description
        self._frame_from_room = np.linalg.inv(rig.room_from_sensor.matrix)

    def rig_sensor(self) -> OdometrySensor:
        """Return the tracker's view of the odometry: its topic, and where its frame lies."""
        return self._rig

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """Return the pose summed up so far; the state is the sum."""
        (snapshot,) = snapshots
        true = self._frame_from_room @ snapshot.bases[self.name]
        if self._description.is_exact:
            return Reading(Odometry(self.name, stamp_ns, true), {"frame_from_base": true}), None
        if state is None:
            state = _Summed(true, true, rng.normal(0.0, self._description.drift, 2))
        step = np.linalg.inv(state.true) @ true
        estimate = state.estimate @ self._measured(step, state.scale, rng)
        return Reading(Odometry(self.name, stamp_ns, estimate.copy()), {"frame_from_base": true}), _Summed(
            true, estimate, state.scale
        )

    def _measured(self, step: Array, scale: Array, rng: np.random.Generator) -> Array:
        """Return a step (4, 4) as the wheels measure it; draws as many numbers whatever the step."""
        way_m, turn_rad = float(np.hypot(*step[:2, 3])), float(np.arctan2(step[1, 0], step[0, 0]))
        noise, slips = rng.normal(size=4), rng.random()
        spread = self._description.noise * np.sqrt([way_m, abs(turn_rad)])
        slipped = slips < self._description.slip * way_m
        error_m = scale[0] * way_m + spread[0] * noise[0] + slipped * _SLIP_M * noise[2]
        error_rad = scale[1] * turn_rad + spread[1] * noise[1] + slipped * _SLIP_RAD * noise[3]
        measured = step.copy()
        if way_m > 0:
            measured[:2, 3] *= 1.0 + error_m / way_m
        cosine, sine = np.cos(error_rad), np.sin(error_rad)
        measured[:2, :2] = np.array([[cosine, -sine], [sine, cosine]]) @ step[:2, :2]
        return measured
