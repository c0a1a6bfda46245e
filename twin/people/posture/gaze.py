"""Gaze: heads that turn to a point, a person or an angle at human speed, or look about freely."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Planar
from twin.people.body.proportions import about_y, about_z, direction, turned
from twin.people.posture.body_measures import BodyMeasures
from twin.people.posture.posture_rows import (
    BACK,
    HELD_OVER,
    LOOK,
    LOOK_TO,
    PEAK_RATE,
    PELVIS_PITCH,
    PLACE_X,
    PLACE_Y,
    SPINE_PITCH,
    SPINE_YAW,
    MinimumJerkProfile,
    faced,
    hips_up,
    minimum_jerk,
)

NECK_YAW_MOST_RAD = 1.396
"""Greatest turn of the head on the trunk, to either side (80 degrees)."""
NECK_PITCH_MOST_RAD = (-0.95, 0.80)
"""Greatest nod of the head on the trunk, up and down (55 and 45 degrees)."""
HEAD_RATE_RAD_S = 4.0
"""Greatest rate of the head's turns."""

_SHORTEST_S = 0.35
_TRUNK_FROM_RAD = 0.9
_TRUNK_SHARE = 0.5
_TRUNK_MOST_RAD = 0.35
_YAW_MOST_RAD = NECK_YAW_MOST_RAD + _TRUNK_MOST_RAD
_KEEPS_SIDE_RAD = 2.5
"""Angle beyond which an object behind is looked at over the current shoulder."""


class _Aim(IntEnum):
    AHEAD = 0
    POINT = 1
    PERSON = 2
    ANGLE = 3


class GazeControl:
    """Controlled gaze of n people; other heads stay as the gait has them."""

    def __init__(self, count: int) -> None:
        self.share = MinimumJerkProfile(1, count)
        self._aim = np.zeros(count, dtype=np.intp)
        self._point = np.zeros((count, 3))
        self._target_person = np.zeros(count, dtype=np.intp)
        self._angle = np.zeros((count, 2))
        self._turned = np.zeros((count, 2))  # yaw and pitch of the gaze in the body's frame [rad]
        self._from = np.zeros((count, 2))
        self._progress = np.ones(count)
        self._duration = np.ones(count)
        self._behind = np.zeros(count)  # remaining part of the wished turn [rad]
        self._fresh = np.zeros(count, dtype=bool)

    def at_point(self, person: int, point: Array) -> None:
        """Keep looking at a point (3,) in the room [m]."""
        self._point[person] = point
        self._begin(person, _Aim.POINT)

    def at_person(self, person: int, other: int) -> None:
        """Keep looking at another's head."""
        self._target_person[person] = other
        self._begin(person, _Aim.PERSON)

    def by_angle(self, person: int, yaw: float, pitch: float) -> None:
        """Turn the gaze from straight ahead: yaw to the left, pitch down positive [rad]."""
        self._angle[person] = yaw, pitch
        self._begin(person, _Aim.ANGLE)

    def ahead(self, person: int) -> None:
        """Look where the way goes again."""
        if self._aim[person] != _Aim.AHEAD:
            self._aim[person] = _Aim.AHEAD
            self.share.go(person, 0.0, _duration_s(self._turned[person]))

    def done(self, person: int) -> bool:
        """Return whether the head is at its goal, or as far as it turns."""
        turned = self._aim[person] == _Aim.AHEAD or (self._progress[person] >= 1.0 and self._behind[person] < 1e-3)
        return bool(turned and not self.share.moving[person] and not self._fresh[person])

    def idle(self) -> bool:
        """Return whether no gaze is controlled."""
        return not (self._aim.any() or self.share.value.any() or self.share.moving.any())

    def step(self, dt: float, head: Array, body: Array, rows: Array) -> None:
        """Turn the heads by dt [s] and write rows (POSTURE_ROWS, n).

        head (n, 3): centres of the heads [m]; body (n, 3, 3): room_from_body, without the trunk's turn.
        """
        who = np.nonzero((self._aim != _Aim.AHEAD) | (self.share.value[0] > 0))[0]
        aim = self._aim[who]
        target = np.where((aim == _Aim.PERSON)[:, None], head[self._target_person[who]], self._point[who])
        seen = turned(body[who].transpose(0, 2, 1), target - head[who])
        yaw = np.arctan2(seen[:, 1], seen[:, 0])
        pitch = -np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1]))
        over = (np.abs(yaw) > _KEEPS_SIDE_RAD) & (yaw * self._turned[who, 0] < 0)
        yaw = np.where(over, -yaw, yaw)
        wish = np.where((aim == _Aim.ANGLE)[:, None], self._angle[who], np.stack([yaw, pitch], axis=-1))
        wish = np.where((aim == _Aim.AHEAD)[:, None], self._turned[who], wish)
        wish[:, 0] = np.minimum(np.maximum(wish[:, 0], -_YAW_MOST_RAD), _YAW_MOST_RAD)
        fresh = self._fresh[who]
        if fresh.any():
            self._start(who[fresh], wish[fresh])
        self._progress[who] = np.minimum(self._progress[who] + dt / self._duration[who], 1.0)
        share = minimum_jerk(self._progress[who])[:, None]
        goal = self._from[who] + share * (wish - self._from[who])
        most = 1.05 * HEAD_RATE_RAD_S * dt
        self._turned[who] += np.minimum(np.maximum(goal - self._turned[who], -most), most)
        self._behind[who] = np.abs(wish - self._turned[who]).max(axis=1)
        self.share.step(dt)
        self._write(who, body, rows)

    def _write(self, who: NDArray[np.intp], body: Array, rows: Array) -> None:
        weight = self.share.value[0, who]
        yaw, pitch = self._turned[who].T
        towards = turned(body[who], direction(yaw, pitch))
        rows[LOOK, who] = weight
        rows[LOOK_TO, who] = weight * towards.T
        beyond = _TRUNK_SHARE * np.maximum(np.abs(yaw) - _TRUNK_FROM_RAD, 0.0)
        rows[SPINE_YAW, who] += weight * np.copysign(np.minimum(beyond, _TRUNK_MOST_RAD), yaw)

    def _begin(self, person: int, aim: _Aim) -> None:
        self._aim[person] = aim
        self._fresh[person] = True

    def _start(self, who: NDArray[np.intp], wish: Array) -> None:
        """Begin turning from the present gaze; without one, the new gaze fades in."""
        for person, angles in zip(who, wish, strict=True):
            if self.share.value[0, person] == 0.0:
                self._turned[person] = self._from[person] = angles
                self._progress[person] = 1.0
                # the gait's own gaze may be turned the other way
                self.share.go(person, 1.0, _duration_s(self._turned[person], 0.5))
            else:
                self._from[person] = self._turned[person]
                self._progress[person] = 0.0
                self._duration[person] = duration_s = _duration_s(angles - self._turned[person])
                if self.share.goal(person)[0] < 1.0:
                    self.share.go(person, 1.0, duration_s)
            self._fresh[person] = False


def _duration_s(angles: Array, more_rad: float = 0.0) -> float:
    """Return the duration [s] of a turn of the head by yaw and pitch (2,), and `more_rad` beyond [rad]."""
    return max(_SHORTEST_S, PEAK_RATE * (float(np.abs(angles).max()) + more_rad) / HEAD_RATE_RAD_S)


_SPREAD_RAD = 0.3
_MOST_RAD = 0.8
_LOOKS_FOR_S = (0.8, 3.0)


class FreeGaze:
    """Random gaze of n people without a target: an angle from the heading, each by its own generator."""

    def __init__(self, random: Sequence[np.random.Generator]) -> None:
        self._random = random
        self._angle = np.zeros(len(random))
        self._until = np.zeros(len(random))

    def at(self, t: float) -> Array:
        """Return the angles (n,) [rad] at time t [s]; times must increase."""
        over = t >= self._until
        if np.count_nonzero(over):
            for place in np.flatnonzero(over).tolist():
                rng = self._random[place]
                self._angle[place] = np.clip(rng.normal(0.0, _SPREAD_RAD), -_MOST_RAD, _MOST_RAD)
                self._until[place] = t + rng.uniform(*_LOOKS_FOR_S)
        return self._angle


def heads_of(measures: BodyMeasures, place: Planar, heading: Array, rows: Array) -> tuple[Array, Array]:
    """Return centres of the heads (n, 3) [m] and room_from_body (n, 3, 3) without the gait's small motions.

    place (n,) x + iy [m], heading (n,) [rad]: those of the gait; rows (POSTURE_ROWS, n).
    """
    yaw = faced(heading, rows)
    body = about_z(yaw) @ about_y(rows[PELVIS_PITCH])
    hips = np.stack(
        [
            (1 - rows[HELD_OVER]) * place.real + rows[PLACE_X] - rows[BACK] * np.cos(yaw),
            (1 - rows[HELD_OVER]) * place.imag + rows[PLACE_Y] - rows[BACK] * np.sin(yaw),
            hips_up(rows, measures),
        ],
        axis=-1,
    )
    zero = np.zeros(len(measures))
    head = np.stack([measures.head_ahead, zero, measures.neck + measures.head_up], axis=-1)
    waist = np.stack([zero, zero, measures.waist], axis=-1)
    return hips + turned(body, waist + turned(about_y(rows[SPINE_PITCH]), head)), body
