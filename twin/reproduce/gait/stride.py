"""Steady gait: simulated bodies at one speed, and biomechanical measures of a foot's vertical load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.people.body.proportions import Skeleton, proportions_of
from twin.people.gait.gait import Gait
from twin.people.gait.gait_state import GaitState, foot_loads
from twin.people.posture.posture_rows import TICK_S

FINE_HZ = 600.0
"""Rate of the force plates, at which loads are interpolated between the people's ticks."""

_SPEEDS_UP_S = 4.0
_ACCELERATION_M_S2 = 4.0


@dataclass(frozen=True, eq=False)
class SteadyGait:
    """n people in steady stride at one speed: load and position of each foot."""

    speed_m_s: float
    stature_m: Array  # (n,)
    t: Array  # (k,) [s]
    load: Array  # (k, 2, n) [body weights], left and right foot
    place: NDArray[np.complex128]  # (k, 2, n) x + iy [m]; they walk along x
    pressure_m: Array  # (k, 2, n): point of load, ahead of the shoe's heel
    shoe_m: Array  # (n,)

    @property
    def rate_hz(self) -> float:
        """Rate of `t`."""
        return 1 / float(np.diff(self.t[:2])[0])


@dataclass
class _GuidedPeople:
    """Stand-in for a crowd: people who all go straight ahead."""

    place: NDArray[np.complex128]
    velocity: NDArray[np.complex128]
    acceleration: NDArray[np.complex128]
    heading: Array
    facing: NDArray[np.complex128]
    turn_rate: Array

    @classmethod
    def standing(cls, count: int) -> _GuidedPeople:
        still = np.zeros(count, dtype=complex)
        return cls(still, still, still, np.zeros(count), np.ones(count, dtype=complex), np.zeros(count))

    def go(self, speed_m_s: float) -> None:
        velocity = np.full(len(self.place), speed_m_s, dtype=complex)
        self.acceleration = (velocity - self.velocity) / TICK_S
        self.velocity = velocity
        self.place = self.place + velocity * TICK_S


def simulate_steady(speed_m_s: float, statures_m: Sequence[float], seconds: float = 12.0) -> SteadyGait:
    """Simulate people of these statures [m] at one walking or running speed for this time, after a start from standing."""
    count = len(statures_m)
    led = _GuidedPeople.standing(count)
    skeleton = Skeleton([proportions_of(stature) for stature in statures_m])
    gait = Gait(skeleton, led)
    t, load, place, ahead = [], [], [], []
    for tick in range(1, round((seconds + _SPEEDS_UP_S) / TICK_S) + 1):
        now = tick * TICK_S
        led.go(min(speed_m_s, _ACCELERATION_M_S2 * now))
        gait.step(led, np.zeros(count), TICK_S)
        if now > _SPEEDS_UP_S:
            feet = foot_loads(GaitState(gait.state.floor.copy(), gait.state.rows.copy()), skeleton)
            t.append(now)
            load.append(feet.load.copy())
            place.append(feet.place.copy())
            ahead.append(feet.pressure_ahead.copy())
    coarse = np.array(t)
    fine = np.arange(coarse[0], coarse[-1], 1 / FINE_HZ)
    return SteadyGait(
        speed_m_s, np.array(statures_m), fine, _between(fine, coarse, np.array(load)),
        _between(fine, coarse, np.array(place).real) + 1j * _between(fine, coarse, np.array(place).imag),
        _between(fine, coarse, np.array(ahead) + skeleton.heel), skeleton.shoe,
    )  # fmt: skip


def _between(fine: Array, coarse: Array, values: Array) -> Array:
    """Interpolate values (k, ...) at the coarse times to the fine ones (j, ...)."""
    after = np.clip(np.searchsorted(coarse, fine, side="right"), 1, len(coarse) - 1)
    share = (fine - coarse[after - 1]) / (coarse[after] - coarse[after - 1])
    share = share.reshape(-1, *[1] * (values.ndim - 1))
    return values[after - 1] + share * (values[after] - values[after - 1])


STANDS_FROM = 0.02
"""Least load of a standing foot [body weights]."""
STANCE_POINTS = 101


@dataclass(frozen=True, eq=False)
class Stance:
    """Complete stances of a foot, each over 0 to 100 % of its duration."""

    curves: Array  # (m, STANCE_POINTS) [body weights]
    seconds: Array  # (m,)


@dataclass(frozen=True)
class StrideMeasures:
    """Measures of one person in steady stride; loads in body weights.

    mean: of both feet together over complete strides; first, dip, second: of the mean curve of a foot's stances; hump: its
    greatest load; stance_share: of the stride, both feet's mean.
    """

    mean: float
    first: float
    dip: float
    second: float
    hump: float
    stance_share: float
    stance_s: float
    stride_s: float
    step_length_m: float

    @property
    def cadence(self) -> float:
        """Steps per minute."""
        return 120.0 / self.stride_s


def whole_stretches(on: NDArray[np.bool_]) -> list[slice]:
    """Find the stretches in which the flags (k,) hold, without those cut off at the ends."""
    change = np.diff(on.astype(int))
    starts, ends = np.flatnonzero(change == 1) + 1, np.flatnonzero(change == -1) + 1
    return [slice(int(start), int(ends[ends > start][0])) for start in starts if (ends > start).any()]


def stance(load: Array, rate_hz: float) -> Stance:
    """Cut a foot's load (k,) [body weights] into its stances."""
    found = whole_stretches(load > STANDS_FROM)
    whole = np.linspace(0, 1, STANCE_POINTS)
    curves = [np.interp(whole, np.linspace(0, 1, len(load[each])), load[each]) for each in found]
    return Stance(
        np.array(curves).reshape(-1, STANCE_POINTS), np.array([(each.stop - each.start) / rate_hz for each in found])
    )


def load_path(steady: SteadyGait) -> Array:
    """Compute the point of load over the stances of the first person's feet, (m, STANCE_POINTS) [m] ahead of the heel."""
    whole = np.linspace(0, 1, STANCE_POINTS)
    points = [
        steady.pressure_m[each, foot, 0]
        for foot in range(2)
        for each in whole_stretches(steady.load[:, foot, 0] > STANDS_FROM)
    ]
    return np.array([np.interp(whole, np.linspace(0, 1, len(each)), each) for each in points])


def measure_stride(load: Array, rate_hz: float, step_length_m: float = np.nan) -> StrideMeasures:
    """Measure a person by the loads of both feet (k, 2) [body weights]; ValueError without a complete stride."""
    stances = [stance(load[:, foot], rate_hz) for foot in range(2)]
    strides, means, lengths = [], [], []
    for foot in range(2):
        starts = np.flatnonzero(np.diff((load[:, foot] > STANDS_FROM).astype(int)) == 1) + 1
        if len(starts) < 2 or not len(stances[foot].seconds):
            continue  # no complete stride of this foot
        strides.append((starts[-1] - starts[0]) / (len(starts) - 1) / rate_hz)
        means.append(load[starts[0] : starts[-1]].sum(axis=1).mean())
        lengths.append(stances[foot].seconds.mean() / strides[-1])
    if not strides:
        raise ValueError("no whole stride of either foot")
    curve = np.concatenate([each.curves for each in stances]).mean(axis=0)
    first, dip, second = humps(curve)
    return StrideMeasures(
        mean=float(np.mean(means)),
        first=first,
        dip=dip,
        second=second,
        hump=float(curve.max()),
        stance_share=float(np.mean(lengths)),
        stance_s=float(np.mean([each.seconds.mean() for each in stances])),
        stride_s=float(np.mean(strides)),
        step_length_m=step_length_m,
    )


def humps(curve: Array) -> tuple[float, float, float]:
    """Find first hump, dip and second hump of a stance's load (STANCE_POINTS,)."""
    third, half = len(curve) // 3, len(curve) // 2
    return float(curve[:half].max()), float(curve[third:-third].min()), float(curve[half:].max())


def measure_people(steady: SteadyGait) -> list[StrideMeasures]:
    """Measure each person, with step lengths from the positions of the feet."""
    found = []
    for person in range(len(steady.stature_m)):
        ahead = []
        for foot in range(2):
            standing = [
                steady.place[(each.start + each.stop) // 2, foot, person].real
                for each in whole_stretches(steady.load[:, foot, person] > STANDS_FROM)
            ]
            ahead.append(np.diff(standing).mean())
        found.append(measure_stride(steady.load[:, :, person], steady.rate_hz, float(np.mean(ahead)) / 2))
    return found


def values_of(found: list[StrideMeasures], name: str) -> Array:
    """Collect one measure of all people, (n,); `name`: a field of `StrideMeasures`, or cadence."""
    return np.array([getattr(each, name) for each in found])
