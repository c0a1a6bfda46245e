"""Agreement of sensors: which of them shows people elsewhere, at other times or not at all where the others show them.

Of every track that two sources measure at nearly one time the difference d of their places is kept, forgotten over some seconds.
A source that hangs elsewhere has a mean of d, one with a wrong clock has d = v τ for people who walk at v; τ is the least
squares' Σ v·d / Σ v². A source whose differences from most of the others are large is suspect, for as long as that lasts; of two
alone it is unknown which one is wrong, and neither is. One that hardly shows people whom any other shows is suspect too.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.fusion.look import Look
from trackers.fusion.person_tracks import People
from trackers.observations import NS_PER_S

logger = logging.getLogger(__name__)

_MEMORY_S = 4.0
"""Time constant of forgetting [s]."""
_TOGETHER_S = 0.12
"""Two sources measure a track within so much time [s]."""
_OFF_M, _LATE_S, _LEAST_SHOWN = 0.2, 0.15, 0.25
"""Offset [m], time [s] and share of the people shown from which, and below which, a source is suspect."""
_SURE = 5.0
"""Standard errors that a delay must exceed: errors of one sensor are alike for a while."""
_FEWEST, _LEAST_M2_S2 = 12.0, 3.0
"""Differences, and sum of squared speeds [m²/s²], that a suspicion takes."""

_SUSPECT_M = 0.5
"""Standard deviation added to what a sensor measures that contradicts the others, at least [m]."""

_OF_OTHER = np.array([1.0, -1.0, -1.0, -1.0, 1.0])
"""Signs of the sums of differences as of the other source."""


class Agreement:
    """Keeps the differences between s sources; names: the sensors of each, for sentences."""

    def __init__(self, names: Sequence[Sequence[str]]) -> None:
        self._names, n = [" and ".join(each) for each in names], len(names)
        self._sums, self._asked, self._shown = np.zeros((n, n, 5)), np.zeros(n), np.zeros(n)
        self._n, self._off_m = self._sums[..., 0], self._sums[..., 1:3]
        self._along, self._square = self._sums[..., 3], self._sums[..., 4]
        self._sigma_m = np.zeros(n)
        self._ns: int | None = None
        self.suspect: Bool[Mask, "s"] = np.zeros(n, np.bool_)
        """The sources that contradict most of the others, as of the last `found`."""
        self.findings: dict[int, str] = {}
        """Sentences on the sources that have contradicted the others, each as of when it first did."""

    def age(self, ns: int) -> None:
        """Forget a share of all until stamp ns."""
        elapsed_s = 0.0 if self._ns is None else max(0.0, (ns - self._ns) / NS_PER_S)
        kept, self._ns = np.exp(-elapsed_s / _MEMORY_S), ns
        for each in (self._sums, self._asked, self._shown):
            each *= kept

    def take(
        self,
        number: int,
        people: People,
        row: Int[Index, "p"],
        place: Float[Array, "p 2"],
        sigma_m: Float[Array, "p"],
        ns: int,
    ) -> None:
        """Take in where source `number` measured the tracks at `row` [m], each with a standard deviation."""
        if not row.size:
            return
        self._sigma_m[number] = float(sigma_m.mean())
        since_s = (ns - people.seen_ns[row]) / NS_PER_S  # (p, s)
        together = (since_s < _TOGETHER_S) & (people.existence[row, None] > 0.9)
        together &= ~people.posture.rests[row, None]  # of whom each kind shows another part
        together[:, number] = False
        velocity = people.velocity[row, None]
        off = np.where(together[..., None], place[:, None] - people.seen_at[row] - since_s[..., None] * velocity, 0.0)
        square = np.where(together, (velocity**2).sum(axis=2), 0.0)
        along = (off * velocity).sum(axis=(0, 2))
        sums = np.column_stack([together.sum(axis=0), off.sum(axis=0), along, square.sum(axis=0)])
        self._sums[number] += sums
        self._sums[:, number] += _OF_OTHER * sums

    def take_shown(self, number: int, asked: Float[Array, "n"], shown: Bool[Mask, "n"]) -> None:
        """Take in how probably source `number` would have shown each track that others show, and which it showed."""
        self._asked[number] += asked.sum()
        self._shown[number] += (asked * shown).sum()

    @property
    def offsets_m(self) -> Float[Array, "s"]:
        """Offset of each source from most of the others [m]; 0 where fewer than two others tell."""
        off_m = self._off_m / np.maximum(self._n, 1.0)[..., None]
        mean = np.hypot(off_m[..., 0], off_m[..., 1])
        return self._median(mean - np.maximum(self._sigma_m[:, None], self._sigma_m), self._n >= _FEWEST)

    @property
    def delays_s(self) -> Float[Array, "s"]:
        """Time by which each source is ahead of most of the others, or behind them [s]; 0 where fewer than two others tell."""
        known = (self._n >= _FEWEST) & (self._square >= _LEAST_M2_S2)
        square = np.maximum(self._square, 1e-9)
        error_s = _SURE * np.maximum(self._sigma_m[:, None], self._sigma_m) / np.sqrt(square)
        return self._median(np.abs(self._along / square) - error_s, known)

    def of_suspect(self, look: Look, number: int) -> Look:
        """Return what a suspect source shows: tracks roughly, but neither initiations nor deletions."""
        off_m2 = max(self.offsets_m[number], _SUSPECT_M) ** 2
        return replace(look, covariance=look.covariance + off_m2 * np.eye(2), starts=np.zeros_like(look.starts))

    def found(self) -> list[str]:
        """Judge the sources; warn of, and return, what of the suspect ones contradicts the others and was not known before."""
        hardly_shows = (self._asked >= _FEWEST) & (self._shown < _LEAST_SHOWN * self._asked)
        self.suspect = (self.offsets_m > _OFF_M) | (self.delays_s > _LATE_S) | hardly_shows
        new = {k: self._sentence(k) for k in np.flatnonzero(self.suspect).tolist() if k not in self.findings}
        self.findings |= new
        for sentence in new.values():
            logger.warning(sentence)
        return list(new.values())

    def _sentence(self, number: int) -> str:
        """Return a clause that says what of a suspect source contradicts the others."""
        name, off_m, late_s = self._names[number], self.offsets_m[number], self.delays_s[number]
        if late_s > _LATE_S:
            return f"{name} shows people {late_s:.1f} s off the time of the other sensors"
        if off_m > _OFF_M:
            return f"{name} shows people {off_m:.1f} m off where the other sensors do"
        return f"{name} hardly shows the people whom the other sensors show"

    @staticmethod
    def _median(values: Float[Array, "s s"], known: Bool[Mask, "s s"]) -> Float[Array, "s"]:
        """Return the lower median over the others of each source; 0 where fewer than two are known."""
        count = known.sum(axis=1)
        if count.max(initial=0) < 2:
            return np.zeros(len(values))
        ordered = np.sort(np.where(known, values, np.inf), axis=1)  # the known ones first
        return np.where(count < 2, 0.0, ordered[np.arange(len(values)), (count - 1) // 2])
