"""Parameters of walking and running by speed, and the load of each step.

Walking and running overlap in speed, so both share one scale, the pace: a walker's pace is the speed, a runner's the speed
plus `RUN_PACE`; a change passes through the paces between. Everything is sampled every 0.02 m/s of pace.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.models import load_yaml
from twin.people.body.proportions import Skeleton

RUN_PACE = 1.0
"""Offset of running behind walking on the scale of pace [m/s]."""

LOAD, HEIGHT, RATE, SHARE_BEHIND = range(4)
"""Columns of `GaitTable.cycle`."""

_STEP = 0.02
_PHASES = 128
_SHAPE = 256
_ROLL = np.linspace(0.0, 1.0, 201)


class GaitStyle(NamedTuple):
    """Gait parameters of n people at their paces, (n,) each; the rows of `models/people/gait.yaml`, and what follows from them.

    step_time [s]; double_support: share of a step, negative: share in the air; step_width, clearance (of the swinging
    foot), pelvis_drop [m]; lands_ahead: share of a step; heel_off: share of the stance at which the heel begins to rise;
    heel_rise (of the foot that leaves the floor), kick, toe_up (of the foot before it lands), trunk_lean, elbow [rad];
    arm_swing [rad/m]; reach: share of the leg; stance: length of a foot's stance in steps; flight: `double_support` if
    negative, else beyond a step's end; heel_turns: share of the stance in which the heel rises; half_width: of a step [m];
    row: place in the table of loads.
    """

    step_time: Array
    double_support: Array
    step_width: Array
    lands_ahead: Array
    heel_off: Array
    heel_rise: Array
    kick: Array
    clearance: Array
    toe_up: Array
    pelvis_drop: Array
    trunk_lean: Array
    elbow: Array
    arm_swing: Array
    reach: Array
    stance: Array
    flight: Array
    heel_turns: Array
    half_width: Array
    row: NDArray[np.intp]


_ROWS = (
    "step_time_s", "double_support", "step_width_m", "lands_ahead", "heel_off", "heel_rise_rad", "kick_rad",
    "clearance_m", "toe_up_rad", "pelvis_drop_m", "trunk_lean_rad", "elbow_rad", "arm_swing_rad_m", "reach",
)  # fmt: skip
_DERIVED = ("stance", "flight", "heel_turns", "half_width_m")
_NEVER = 9.0
"""Progress through a step that none reaches."""
_HUMPS = ("peak_strike", "dip", "peak_push")
_TIMES = ("step_time_s",)
_LENGTHS = ("step_width_m", "clearance_m", "pelvis_drop_m", "half_width_m")
_PER_LENGTH = ("arm_swing_rad_m",)


class Ramps(NamedTuple):
    """Rise and fall of the load on a walker's foot; `stance_load` in `models/people/gait.yaml`.

    dip_at: share of the stance at the trough; unloading: time after the second hump relative to that before the first;
    starts, ends: slope at first and at last contact, as a share of the ramp's mean slope.
    """

    dip_at: float
    unloading: float
    starts: float
    ends: float


class _Table(NamedTuple):
    """Styles (rows, paces); cycle (paces · phases, 4), see `GaitTable.cycle`; roll (2, 201) of a walker and a runner over
    the stance; speeds of gait changes.
    """

    styles: Array
    cycle: Array
    roll: Array
    last_pace: float
    runs_above: float
    walks_below: float


@cache
def _table() -> _Table:
    content = load_yaml("people/gait.yaml")
    walking, running = content["walking"], content["running"]
    knots = np.concatenate([walking["speed_m_s"], np.add(running["speed_m_s"], RUN_PACE)])
    last = float(knots[-1])
    paces = np.arange(0.0, last + _STEP, _STEP)
    styles = np.stack([np.interp(paces, knots, walking[name] + running[name]) for name in _ROWS])
    humps = np.stack([np.interp(paces, walking["speed_m_s"], walking[name]) for name in _HUMPS])
    first, second = walking["speed_m_s"][-1], running["speed_m_s"][0] + RUN_PACE
    runs = np.clip((paces - first) / (second - first), 0.0, 1.0)
    width, double_support, heel_off = (
        styles[_ROWS.index(each)] for each in ("step_width_m", "double_support", "heel_off")
    )
    flight = np.where(double_support < 0, double_support, _NEVER)
    styles = np.concatenate([styles, [1.0 + double_support, flight, 1.0 - heel_off, 0.5 * width]])
    cycle = _cycle(double_support, humps, runs, Ramps(**content["stance_load"]))
    roll = content["roll"]
    rolls = np.stack(
        [_monotone_cubic(np.array(roll["stance"]), np.array(roll[gait]), _ROLL) for gait in ("walking", "running")]
    )
    return _Table(styles, cycle, rolls, last, content["runs_above_m_s"], content["walks_below_m_s"])


def _monotone_cubic(x: Array, y: Array, at: Array) -> Array:
    """Evaluate the monotone cubics through knots (k,), k > 2, at places within them, as SciPy's PchipInterpolator, to the
    bit."""
    step = np.diff(x)
    slope = np.diff(y) / step
    turns = np.sign(slope[1:]) * np.sign(slope[:-1]) <= 0
    near, far = 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
    one, other = (np.where(turns, 1.0, each) for each in (slope[:-1], slope[1:]))
    inner = np.where(turns, 0.0, 1 / ((near / one + far / other) / (near + far)))
    ends = (_slope_at_end(*step[:2], *slope[:2]), _slope_at_end(*step[:-3:-1], *slope[:-3:-1]))
    tangent = np.concatenate([ends[:1], inner, ends[1:]])
    bend = (tangent[:-1] + tangent[1:] - 2 * slope) / step
    k = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(step) - 1)
    s = at - x[k]
    return y[k] + tangent[k] * s + ((slope - tangent[:-1]) / step - bend)[k] * (s * s) + (bend / step)[k] * (s * s * s)


def _slope_at_end(step: float, next_step: float, slope: float, next_slope: float) -> float:
    """Return the slope at an end by three points, limited so that the curve stays monotone."""
    found = ((2 * step + next_step) * slope - step * next_slope) / (step + next_step)
    if np.sign(found) != np.sign(slope):
        return 0.0
    return 3 * slope if np.sign(slope) != np.sign(next_slope) and abs(found) > 3 * abs(slope) else found


def stance_load(share: Array, double_support: Array, humps: Array, runs: Array, ramps: Ramps) -> Array:
    """Return the vertical load of one foot over its stance, (p, k), in body weights.

    share (k,): through the stance, 0 to 1; double_support (p,): share of a step; humps (3, p): a walker's first hump, trough
    and second hump; runs (p,): 0 walker, 1 runner; ramps: a walker's. A walker's curve is cubics through the three extremes.
    The humps lie where the mean is 1 / (1 + double_support), so that both feet carry one body weight. A runner's curve is
    half a sine.
    """
    strike, dip, push = humps
    dip_at, unloading, starts, ends = ramps
    mean = 1.0 / (1.0 + double_support)
    down, up = 0.5 * (strike + dip), 0.5 * (dip + push)
    edges = strike * (0.5 + starts / 12.0) + unloading * push * (0.5 + ends / 12.0)
    rise = (dip_at * down + (1 - dip_at) * up - mean) / (down + unloading * up - edges)
    rise = np.where(runs > 0, 0.2, rise)
    if not ((rise > 0.05) & (rise < 0.4)).all():
        raise ValueError("models/people/gait.yaml: the humps of a walker's load do not fit its double support")
    rise = rise[:, None]
    fall = unloading * rise
    late = 1.0 - fall
    walk = np.select(
        [share < rise, share < dip_at, share < late],
        [
            strike[:, None] * _hermite(share / rise, starts),
            _between(strike[:, None], dip[:, None], (share - rise) / (dip_at - rise)),
            _between(dip[:, None], push[:, None], (share - dip_at) / (late - dip_at)),
        ],
        push[:, None] * _hermite((1.0 - share) / fall, ends),
    )
    walk = walk * (mean / walk.mean(axis=1))[:, None]
    run = (0.5 * np.pi) * np.sin(np.pi * share) * mean[:, None]
    return walk + runs[:, None] * (run - walk)


def _hermite(x: Array, slope: float) -> Array:
    """Return a cubic from 0, with this slope there, to 1, flat there."""
    return slope * x * (1 - x) ** 2 + x * x * (3 - 2 * x)


def _between(low: Array, high: Array, x: Array) -> Array:
    return low + (high - low) * x * x * (3 - 2 * x)


def _cycle(double_support: Array, humps: Array, runs: Array, ramps: Ramps) -> Array:
    """Return the load of a regular step and the resulting bob, (paces · (phases + 1), 4); see `GaitTable.cycle`."""
    share = (np.arange(_SHAPE) + 0.5) / _SHAPE
    curve = stance_load(share, double_support, humps, runs, ramps)
    phase = np.arange(_PHASES) / _PHASES
    stands = 1.0 + double_support[:, None]

    def load(steps: Array) -> Array:
        place = steps / stands * _SHAPE - 0.5
        padded = np.concatenate([0 * curve[:, :1], curve, 0 * curve[:, :1]], axis=1)
        place = np.clip(place + 1.0, 0.0, _SHAPE + 1.0)
        low = np.minimum(place.astype(np.intp), _SHAPE)
        rows = np.arange(len(curve))[:, None]
        return padded[rows, low] + (place - low) * (padded[rows, low + 1] - padded[rows, low])

    front, rear = load(np.broadcast_to(phase, (len(curve), _PHASES))), load(phase + 1.0 + 0 * stands)
    total = front + rear
    scale = 1.0 / total.mean(axis=1, keepdims=True)
    total, share_rear = total * scale, np.divide(rear, total, out=np.zeros_like(rear), where=total > 1e-9)
    # twice integrated over the phase: height and speed of the body's centre, in units of g T² and g T
    spectrum = np.fft.rfft(total - 1.0, axis=1)
    turns = 2j * np.pi * np.arange(spectrum.shape[1])
    turns[0] = 1.0
    spectrum[:, 0] = 0.0
    height = np.fft.irfft(spectrum / turns**2, _PHASES, axis=1)
    rate = np.fft.irfft(spectrum / turns, _PHASES, axis=1)
    cycle = np.stack([total, height, rate, share_rear], axis=-1)
    return np.concatenate([cycle, cycle[:, :1]], axis=1).reshape(-1, 4)


class GaitTable:
    """Gait parameters of n people, scaled to their legs by dynamic similarity (equal Froude number)."""

    def __init__(self, skeleton: Skeleton) -> None:
        self._table = _table()
        factors = {
            **dict.fromkeys(_TIMES, np.sqrt(skeleton.scale)),
            **dict.fromkeys(_LENGTHS, skeleton.scale),
            **dict.fromkeys(_PER_LENGTH, 1.0 / skeleton.scale),
        }
        unscaled = np.ones_like(skeleton.scale)
        self._factors = np.stack([factors.get(name, unscaled) for name in (*_ROWS, *_DERIVED)])
        self._per_speed = 1.0 / np.sqrt(skeleton.scale)

    @property
    def runs_above(self) -> float:
        """Speed above which the reference person runs [m/s]."""
        return self._table.runs_above

    @property
    def walks_below(self) -> float:
        """Speed below which a running reference person walks again [m/s]."""
        return self._table.walks_below

    def similar(self, speed: Array) -> Array:
        """Return the speeds (n,) [m/s] of the reference person's similar motion."""
        return speed * self._per_speed

    def at(self, pace: Array) -> GaitStyle:
        """Look up the parameters at paces (n,) [m/s] of the reference person; the last entry beyond the table."""
        row = (np.minimum(pace, self._table.last_pace) * (1.0 / _STEP) + 0.5).astype(np.intp)
        return GaitStyle._make([*(self._table.styles.take(row, axis=1) * self._factors), row])

    def cycle(self, row: NDArray[np.intp], progress: Array) -> Array:
        """Look up a regular step at fractions through it (0 to 1), (n, 4).

        Columns: whole load [body weights]; height of the centre of mass about its mean and its rate, in units of g T² and g
        T for a step time T; share of the load still on the rear foot. The second derivative of the height is exactly the
        load less one.
        """
        place = np.minimum(progress, 0.999999) * _PHASES
        whole = place.astype(np.intp)
        index = row * (_PHASES + 1) + whole
        low = self._table.cycle.take(index, axis=0)
        high = self._table.cycle.take(index + 1, axis=0)
        return low + (place - whole)[:, None] * (high - low)

    def roll(self, stance: Array, runs: Array) -> Array:
        """Return the point of load at shares of the stance (2, n), as a share of the shoe from its heel.

        runs (n,): 0 walker, 1 runner.
        """
        walking, running = self._table.roll
        point = np.interp(stance, _ROLL, walking)
        return point + runs * (np.interp(stance, _ROLL, running) - point) if np.count_nonzero(runs) else point
