"""What biomechanics reads off the vertical load of a foot: stance, humps, dip, cadence, step length."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.reproduce.gait.bodies import Steady

STANDS_FROM = 0.02
"""A foot stands from this load on [body weights]."""
STANCE_POINTS = 101


@dataclass(frozen=True, eq=False)
class Stance:
    """Whole stances of a foot, each over 0 to 100 % of its time."""

    curves: Array  # (m, STANCE_POINTS) [body weights]
    seconds: Array  # (m,)


@dataclass(frozen=True)
class Figures:
    """Of one person in their stride; loads in body weights.

    mean: of both feet together over whole strides; first, dip, second: of the mean curve of a foot's stances; hump: its
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
        """Steps a minute."""
        return 120.0 / self.stride_s


def slices(on: NDArray[np.bool_]) -> list[slice]:
    """Whole stretches in which the flags (k,) hold, those cut off at the ends left out."""
    change = np.diff(on.astype(int))
    starts, ends = np.flatnonzero(change == 1) + 1, np.flatnonzero(change == -1) + 1
    return [slice(int(start), int(ends[ends > start][0])) for start in starts if (ends > start).any()]


def stance(load: Array, rate_hz: float) -> Stance:
    """The stances in a foot's load (k,) [body weights]."""
    found = slices(load > STANDS_FROM)
    whole = np.linspace(0, 1, STANCE_POINTS)
    curves = [np.interp(whole, np.linspace(0, 1, len(load[each])), load[each]) for each in found]
    return Stance(
        np.array(curves).reshape(-1, STANCE_POINTS), np.array([(each.stop - each.start) / rate_hz for each in found])
    )


def roll(steady: Steady, person: int) -> Array:
    """Where the load acts over the stances of a person's feet, (m, STANCE_POINTS) [m] ahead of the shoe's heel."""
    whole = np.linspace(0, 1, STANCE_POINTS)
    points = [
        steady.pressure_m[each, foot, person]
        for foot in range(2)
        for each in slices(steady.load[:, foot, person] > STANDS_FROM)
    ]
    return np.array([np.interp(whole, np.linspace(0, 1, len(each)), each) for each in points])


def figures(load: Array, rate_hz: float, step_length_m: float = np.nan) -> Figures:
    """The figures of a person from the loads of both feet (k, 2) [body weights]; ValueError without a whole stride."""
    stances = [stance(load[:, foot], rate_hz) for foot in range(2)]
    strides, means, lengths = [], [], []
    for foot in range(2):
        starts = np.flatnonzero(np.diff((load[:, foot] > STANDS_FROM).astype(int)) == 1) + 1
        if len(starts) < 2 or not len(stances[foot].seconds):
            continue  # no whole stride of this foot
        strides.append((starts[-1] - starts[0]) / (len(starts) - 1) / rate_hz)
        means.append(load[starts[0] : starts[-1]].sum(axis=1).mean())
        lengths.append(stances[foot].seconds.mean() / strides[-1])
    if not strides:
        raise ValueError("no whole stride of either foot")
    curve = np.concatenate([each.curves for each in stances]).mean(axis=0)
    first, dip, second = humps(curve)
    return Figures(
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
    """First hump, dip and second hump of a stance's load (STANCE_POINTS,)."""
    third, half = len(curve) // 3, len(curve) // 2
    return float(curve[:half].max()), float(curve[third:-third].min()), float(curve[half:].max())


def figures_of(steady: Steady) -> list[Figures]:
    """The figures of each person, step lengths from where the feet stand."""
    rate_hz = 1 / float(np.diff(steady.t[:2])[0])
    found = []
    for person in range(len(steady.stature_m)):
        ahead = []
        for foot in range(2):
            standing = [
                steady.place[(each.start + each.stop) // 2, foot, person].real
                for each in slices(steady.load[:, foot, person] > STANDS_FROM)
            ]
            ahead.append(np.diff(standing).mean())
        found.append(figures(steady.load[:, :, person], rate_hz, float(np.mean(ahead)) / 2))
    return found


def column(found: list[Figures], name: str) -> Array:
    """One figure of everybody, (n,); `name`: a field of `Figures`, or cadence."""
    assert name == "cadence" or name in {field.name for field in fields(Figures)}
    return np.array([getattr(each, name) for each in found])
