"""Fixed-lag smoother: frames are delayed, so that they use later measurements too.

A track confirmed meanwhile is reported from its first measurement on. Positions and velocities follow a motion of constant
acceleration, fitted by least squares to the measurements in a window before and after, with a prior on people's motion: the
Gaussian posterior of a linear model (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, eq. 2.8). A
person measured before and after a gap is thus placed in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.observations import NS_PER_S
from trackers.tracks import Track, TrackFrame

_ACCELERATION_M_S2 = 3.0
"""Prior standard deviation of people's acceleration, on each axis."""


@dataclass(frozen=True, eq=False)
class Held:
    """n tracks of a tracker in one frame, including tentative ones."""

    ns: int
    serial: Int[Index, "n"]  # ascending; one per track, from the first measurement on
    measured: Bool[Mask, "n"]  # in this frame
    place: Float[Array, "n 2"]  # last measured position [m]
    variance_m2: Float[Array, "n"]  # of that position, on each axis
    reported: dict[int, Track]  # tracks reported in this frame, by id


class FixedLagSmoother:
    """Delay of a tracker's frames by `delay_s`; speed_m_s: prior standard deviation of people's speed, on each axis."""

    def __init__(self, delay_s: float, speed_m_s: float) -> None:
        self._delay_ns = round(delay_s * NS_PER_S)
        self._prior = np.diag([0.0, speed_m_s**-2, _ACCELERATION_M_S2**-2])
        self._ids: dict[int, int] = {}
        self._kept: list[Held] = []
        self._next = 0  # index of the first frame not returned yet

    def add(self, held: Held, ids: Int[Index, "n"]) -> list[TrackFrame]:
        """Add a frame; return those now due, oldest first. ids: 0 for tentative tracks."""
        known = ids > 0
        self._ids.update(zip(held.serial[known].tolist(), ids[known].tolist(), strict=True))
        self._kept.append(held)
        frames = self._left(held.ns - self._delay_ns)
        oldest_ns = self._kept[self._next].ns - self._delay_ns
        n_left = sum(each.ns < oldest_ns for each in self._kept[: self._next])
        left, self._kept, self._next = self._kept[:n_left], self._kept[n_left:], self._next - n_left
        for each in left:  # a track that has ended does not come back
            for serial in np.setdiff1d(each.serial, self._kept[0].serial).tolist():
                self._ids.pop(serial, None)
        return frames

    def finish(self) -> list[TrackFrame]:
        """Return all remaining frames."""
        return self._left(self._kept[-1].ns) if self._kept else []

    def _left(self, until_ns: int) -> list[TrackFrame]:
        frames = []
        while self._next < len(self._kept) and self._kept[self._next].ns <= until_ns:
            frames.append(self._frame(self._kept[self._next]))
            self._next += 1
        return frames

    def _frame(self, now: Held) -> TrackFrame:
        """Return a frame with the knowledge of later ones."""
        window = [each for each in self._kept if abs(each.ns - now.ns) <= self._delay_ns]
        t_s = np.array([each.ns - now.ns for each in window]) / NS_PER_S
        place, weight = (np.stack(each) for each in zip(*(_measured(it, now.serial) for it in window), strict=True))
        seen = ~np.isnan(place[..., 0])
        fits = seen[t_s <= 0].any(axis=0) & seen[t_s >= 0].any(axis=0)
        fitted = self._fit(t_s, place[:, fits], weight[:, fits])
        tracks = dict(now.reported)
        for serial, measured, row in zip(now.serial[fits].tolist(), now.measured[fits], fitted.tolist(), strict=True):
            if serial in self._ids:
                x, y, vx, vy, radius_m = row
                number = self._ids[serial]
                track = tracks.get(number, Track(number, x, y))
                status = "confirmed" if measured else "coasting"
                tracks[number] = replace(track, x=x, y=y, vx=vx, vy=vy, status=status, radius95_m=radius_m)
        return TrackFrame(now.ns, tuple(tracks[number] for number in sorted(tracks)))

    def _fit(
        self, t_s: Float[Array, "f"], place: Float[Array, "f n 2"], weight: Float[Array, "f n"]
    ) -> Float[Array, "n 5"]:
        """Return x, y [m] and their rates [m/s] at t = 0, fitted to weighted positions, and the radius of 95 % [m]."""
        basis = np.stack([np.ones_like(t_s), t_s, t_s**2 / 2], axis=1)
        normal = np.einsum("fi,fj,fn->nij", basis, basis, weight) + self._prior
        right = np.einsum("fi,fn,fnk->nik", basis, weight, np.nan_to_num(place))
        fitted = np.linalg.solve(normal, right)[:, :2].reshape(-1, 4)
        variance = np.linalg.inv(normal)[:, 0, 0]  # equal on both axes
        return np.column_stack([fitted, np.sqrt(-2 * np.log(0.05) * variance)])


def _measured(held: Held, serial: Int[Index, "n"]) -> tuple[Float[Array, "n 2"], Float[Array, "n"]]:
    """Return the measured places of these tracks in a frame [m], NaN for the others, and their weights [1/m²], 0."""
    found, weight = np.full((serial.size, 2), np.nan), np.zeros(serial.size)
    row = np.searchsorted(held.serial, serial)
    there = (row < held.serial.size).nonzero()[0]
    there = there[(held.serial[row[there]] == serial[there]) & held.measured[row[there]]]
    found[there], weight[there] = held.place[row[there]], 1 / held.variance_m2[row[there]]
    return found, weight


def by_id(tracks: Sequence[Track]) -> dict[int, Track]:
    """Return tracks by id."""
    return {each.id: each for each in tracks}
