"""Rows of numbers that describe a posture over the standing body, the resulting load on the feet, and poses of the last seconds.

All may be interpolated linearly between ticks: weighted quantities are stored multiplied by their weight. Movements from one
value to another follow minimum-jerk profiles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackers.arrays import Array
from twin.people.gait.gait_state import FLOOR_ROWS, ROWS, GaitState
from twin.people.posture.body_measures import BodyMeasures

TICK_S = 0.025
"""Period of the people's clock [s]; poses are interpolated between ticks."""

HISTORY_S = 3.0
"""Time for which poses are kept [s]."""

AHEAD_S = 1.0
"""Time by which people may be stepped ahead of what is asked about them [s]."""

HELD, HELD_OVER, HELD_HIGH, HELD_YAW = slice(0, 3), 0, 1, 2
"""Weights with which the pelvis is held: over the floor, height, yaw."""
PLACE_XY, PLACE_X, PLACE_Y, PLACE_Z, PLACE_YAW = slice(3, 5), 3, 4, 5, 6
"""Held position [m] and yaw [rad], each times its weight."""
PELVIS_PITCH = 7
"""Turn of the pelvis forward about the hips [rad]."""
BACK, DROP = 8, 9
"""Displacement of the hips back over standing feet, and down by bent knees [m]."""
SPINE, SPINE_YAW, SPINE_PITCH, SPINE_ROLL = slice(10, 13), 10, 11, 12
"""Angles added to the trunk's [rad]."""
NECK_PITCH = 13
ARMS_PITCH = 14
"""Angles added to the pitch of the head and of both shoulders [rad]."""
LEGS = 15
"""For each leg (2 x 6 rows): weight with which it is off the floor; hip yaw, roll, pitch, knee, ankle [rad] times it."""
HIP_PITCH, KNEE, ANKLE = 3, 4, 5
"""Rows of one leg, after its weight, hip yaw and hip roll."""
FREE_ANGLES = 5
REST = 27
"""Weights with which the hands lie on the thighs, left and right."""
ARMS_FLAT = 29
"""Weight with which the arms lie beside the body."""
PROP = 30
"""Weight with which the hands are propped on the bed behind the hips."""
HANDS = 31
"""For each hand (2 x 4 rows): weight with which it reaches; the point x, y, z [m] times it."""
LOOK, LOOK_TO = 39, slice(40, 43)
"""Weight with which the head is turned; the gaze direction in the room (unit vector x, y, z) times it."""
OFF_FEET = 43
"""Share of the weight not on the feet."""
ACCELERATION = 44
"""Vertical acceleration of the centre of mass [m/s²]."""
PRESSURE = 45
"""Shift of the centre of pressure forward under the feet [m]."""
POSTURE_ROWS = 46


def active(rows: Array) -> NDArray[np.intp]:
    """Return the indices (m,) of people with a posture other than standing, from rows (POSTURE_ROWS, n)."""
    return rows.any(axis=0).nonzero()[0] if np.count_nonzero(rows) else np.zeros(0, dtype=np.intp)


def faced(heading: Array, rows: Array) -> Array:
    """Return the facing yaw (n,) [rad] including postures, unwrapped; lying, it points to the feet end of the bed.

    heading (n,): that of the gait [rad], unwrapped as when the person sat down.
    """
    return (1.0 - rows[HELD_YAW]) * heading + rows[PLACE_YAW]


_UPPER_BODY_SHARE = 0.678
_UPPER_BODY_UP = 0.18
"""Mass of head, arms and trunk as a share of the body's, and their centre above the hips as a share of the stature (D. A.
Winter, "Biomechanics and Motor Control of Human Movement", table 4.1)."""
_THIGHS_SHARE = 0.16
"""Share of the body's mass in the legs that rises with the hips."""


class CentreOfMass:
    """Heights of n people's centres of mass relative to standing, and their rates, as postures move them."""

    def __init__(self, measures: BodyMeasures) -> None:
        self._measures = measures
        self._standing = hips_up(np.zeros((POSTURE_ROWS, len(measures))), measures)
        self._up = np.zeros(len(measures))
        self._rate = np.zeros(len(measures))

    @property
    def moves(self) -> bool:
        """True unless all centres of mass rest at standing height."""
        return bool(self._up.any() or self._rate.any())

    def step(self, rows: Array, dt: float) -> None:
        """Write the vertical acceleration into rows (POSTURE_ROWS, n), `dt` [s] after the last call.

        A difference of heights, so one tick late. Arms and lower legs are taken to keep their height.
        """
        if not (rows.any() or self.moves):
            return
        up = self._height(rows)
        rate = (up - self._up) / dt
        rows[ACCELERATION] = (rate - self._rate) / dt
        self._up, self._rate = up, rate

    def begin(self, rows: Array) -> None:
        """Begin at rest in rows (POSTURE_ROWS, n)."""
        self._up, self._rate = self._height(rows), np.zeros(len(self._measures))

    def _height(self, rows: Array) -> Array:
        lean = rows[PELVIS_PITCH] + rows[SPINE_PITCH]
        upper = _UPPER_BODY_SHARE * _UPPER_BODY_UP * self._measures.stature * (np.cos(lean) - 1.0)
        return (_UPPER_BODY_SHARE + _THIGHS_SHARE) * (hips_up(rows, self._measures) - self._standing) + upper


def hips_up(rows: Array, measures: BodyMeasures) -> Array:
    """Return the height of the hip joints (n,) [m] without the gait's small motions."""
    over_ankles = np.sqrt(np.maximum(measures.leg**2 - rows[BACK] ** 2, 0.0)) - rows[DROP]
    return (1 - rows[HELD_HIGH]) * (over_ankles + measures.ankle_height) + rows[PLACE_Z]


def support(rows: Array) -> tuple[Array, Array]:
    """Return the share of weight on the feet and the vertical acceleration of the centre of mass [m/s²], (n,) each.

    The feet of a person of mass m carry share · m · (g + acceleration).
    """
    return 1.0 - rows[OFF_FEET], rows[ACCELERATION]


def pressure_shift_m(rows: Array) -> Array:
    """Return the forward shift of the centre of pressure due to postures, (n,) [m]."""
    return rows[PRESSURE]


PEAK_RATE = 1.875
"""Peak rate of a minimum-jerk movement relative to its mean rate."""


def minimum_jerk(progress: ArrayLike, begin: float | Array = 0.0, end: float | Array = 1.0) -> Array:
    """Return the share of the way, 0 to 1, at a progress from `begin` to `end`: 10 p³ - 15 p⁴ + 6 p⁵.

    Source: T. Flash and N. Hogan, "The coordination of arm movements: an experimentally confirmed mathematical model",
    Journal of Neuroscience 5, 1985.
    """
    p = np.minimum(np.maximum((np.asarray(progress, dtype=float) - begin) / (end - begin), 0.0), 1.0)
    return np.minimum(p * p * p * (10.0 + p * (6.0 * p - 15.0)), 1.0)  # rounding ends up to 7e-16 beyond


class MinimumJerkProfile:
    """Values (k, n) of n people that move to goals along minimum-jerk profiles."""

    def __init__(self, size: int, count: int) -> None:
        self.value = np.zeros((size, count))
        self.moving = np.zeros(count, dtype=bool)
        self._start = np.zeros((size, count))
        self._goal = np.zeros((size, count))
        self._progress = np.ones(count)
        self._duration = np.ones(count)

    def go(self, person: int, goal: ArrayLike, duration_s: float) -> None:
        """Send one person's values (k,) from the present to a goal."""
        self._start[:, person] = self.value[:, person]
        self._goal[:, person] = goal
        self._duration[person] = duration_s
        self._progress[person] = 0.0
        self.moving[person] = True

    def put(self, person: int, value: ArrayLike) -> None:
        """Set one person's values (k,) at once."""
        self.value[:, person] = self._start[:, person] = self._goal[:, person] = value
        self._progress[person] = 1.0
        self.moving[person] = False

    def goal(self, person: int) -> Array:
        """Return the goal of one person's values, (k,)."""
        return self._goal[:, person].copy()

    def step(self, dt: float) -> None:
        """Move by dt [s]."""
        if not self.moving.any():
            return
        self._progress = np.minimum(self._progress + dt / self._duration, 1.0)
        share = minimum_jerk(self._progress)
        # a reached goal is met to the bit
        self.value = np.where(self._progress >= 1.0, self._goal, self._start + share * (self._goal - self._start))
        self.moving = self._progress < 1.0


class PoseHistory:
    """Gait, posture and presence of n people at the ticks of the last `HISTORY_S`, and of `AHEAD_S` before; memory does not grow
    with time.
    """

    def __init__(self, count: int) -> None:
        size = round((HISTORY_S + AHEAD_S) / TICK_S) + 1
        self.tick = -1
        self._floor = np.zeros((size, FLOOR_ROWS, count), dtype=complex)
        self._rows = np.zeros((size, ROWS, count))
        self._posture = np.zeros((size, POSTURE_ROWS, count))
        self._present = np.zeros((size, count), dtype=bool)

    def __len__(self) -> int:
        """Return the number of ticks that are kept."""
        return len(self._rows)

    def append(self, state: GaitState, posture: Array, present: NDArray[np.bool_]) -> None:
        """Append the state, posture (POSTURE_ROWS, n) and presence (n,) of the next tick."""
        self.tick += 1
        slot = self.tick % len(self)
        self._floor[slot], self._rows[slot] = state.floor, state.rows
        self._posture[slot], self._present[slot] = posture, present

    def last(self) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Return copies of the last tick's floor, rows, posture, present."""
        slot = self.tick % len(self)
        return tuple(each[slot].copy() for each in (self._floor, self._rows, self._posture, self._present))  # pyright: ignore[reportReturnType]

    def present(self, t: float) -> NDArray[np.bool_]:
        """Return a mask (n,) of the people in the room at time t [s]."""
        return self._present[self._slots(t)[0]].copy()

    def at(self, t: float) -> tuple[GaitState, Array]:
        """Interpolate gait state and posture (POSTURE_ROWS, n) at time t [s]. Raises ValueError for a time not kept."""
        early, late, share = self._slots(t)
        floor, rows, posture = self._floor, self._rows, self._posture
        return GaitState(
            floor[early] + share * (floor[late] - floor[early]), rows[early] + share * (rows[late] - rows[early])
        ), posture[early] + share * (posture[late] - posture[early])

    def ticks_around(self, t: float) -> list[tuple[GaitState, Array]]:
        """Return gait state and posture at the two ticks around time t [s], the earlier first; empty before the second tick."""
        if self.tick == 0:
            return []
        late = max(min(int(t / TICK_S + 1e-9) + 1, self.tick), 1)
        slots = [(late - 1) % len(self), late % len(self)]
        return [(GaitState(self._floor[slot], self._rows[slot]), self._posture[slot]) for slot in slots]

    def _slots(self, t: float) -> tuple[int, int, float]:
        """Return the two stored ticks around time t [s], and the share of the later one."""
        size = len(self)
        oldest = max(0, self.tick - size + 1)
        place = t / TICK_S
        if not oldest <= place <= self.tick + 1e-6:
            raise ValueError(
                f"t = {t} s is not between {oldest * TICK_S:.2f} and {self.tick * TICK_S:.2f} s, for which "
                f"people are kept: time goes forward, and {HISTORY_S:g} s back; looks in order of time, or another Simulation, "
                "are expected"
            )
        before = min(int(place + 1e-9), self.tick)
        share = max(place - before, 0.0)  # a time rounded to just before its tick is at it, so that no load is below 0
        return before % size, min(before + 1, self.tick) % size, share
