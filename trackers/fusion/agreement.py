"""Agreement of sensors: which of them shows people elsewhere, at other times or not at all where the others show them.

Places that each two sources show of people are compared (`ShiftedDifferences`): a source that hangs elsewhere has a mean
difference of all people, one with a wrong clock shows them where the others showed them some time ago, or the others where it
did. A source is suspect, for as long as that lasts, if those it contradicts so are more than half of all sources compared, itself
among them: of two, or of two against two, it is unknown which are wrong, and none is. One that hardly shows people whom any other
shows is suspect too.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trackers.arrays import Array, Bool, Float, Mask
from trackers.fusion.differences import LONGEST_S, ShiftedDifferences
from trackers.fusion.look import Look
from trackers.fusion.person_tracks import People
from trackers.observations import NS_PER_S

logger = logging.getLogger(__name__)

_MEMORY_S = 4.0
"""Time constant of forgetting who was shown [s]."""
_OFF_M, _LATE_S, _LEAST_SHOWN = 0.2, 0.15, 0.25
"""Offset [m], time [s] and share of the people shown from which, and below which, a source is suspect."""
_SURE_NATS, _LIKELY_NATS = 5.0, 2.5
"""Log-likelihood ratio of a delay against none that a suspicion takes, and from which an offset is not judged [nat]."""
_FEWEST = 12.0
"""People whom others show, as many as count, from which on a source hardly shows them."""

_SUSPECT_M = 0.5
"""Standard deviation added to what a sensor measures that contradicts the others, at least [m]."""


class Agreement:
    """Keeps the differences between s sources; names: the sensors of each, for sentences."""

    def __init__(self, names: Sequence[Sequence[str]]) -> None:
        self._names, n = [" and ".join(each) for each in names], len(names)
        self._differences = ShiftedDifferences(n)
        self._asked, self._shown, self._sigma_m = np.zeros(n), np.zeros(n), np.zeros(n)
        self._ns: int | None = None
        self.offsets_m: Float[Array, "s"] = np.zeros(n)
        """Offset of each source from those that it contradicts, less its error [m]; 0 where those are no majority."""
        self.delays_s: Float[Array, "s"] = np.zeros(n)
        """Time by which each source is surely ahead of a majority, or behind it [s]; else 0."""
        self.suspect: Bool[Mask, "s"] = np.zeros(n, np.bool_)
        """The sources that contradict a majority, as of the last `found`."""
        self.findings: dict[int, str] = {}
        """Sentences on the sources that have contradicted the others, each as of when it first did, or surely was late."""
        self._named_late = set[int]()

    def age(self, people: People, ns: int) -> None:
        """Forget a share of all until stamp ns, and compare what sources have shown of people until then."""
        elapsed_s = 0.0 if self._ns is None else max(0.0, (ns - self._ns) / NS_PER_S)
        kept, self._ns = np.exp(-elapsed_s / _MEMORY_S), ns
        self._asked *= kept
        self._shown *= kept
        if len(self._names) > 2 and self._differences.advance(people, ns):
            evidence, lag_s = self._differences.lags(_LATE_S)
            compared = self._differences.compared
            self.delays_s = _delays(np.where(self._differences.known, evidence, 0.0), lag_s, compared)
            self.offsets_m = self._offsets(np.maximum(evidence, evidence.T) > _LIKELY_NATS, compared)

    def take(self, number: int, sigma_m: Float[Array, "p"], asked: Float[Array, "n"], shown: Bool[Mask, "n"]) -> None:
        """Take in a look of source `number` at the last stamp, by the standard deviations of what it measured of tracks [m].

        asked: how probably it would have shown each track that others show; shown: which it showed.
        """
        if self._ns is not None:
            self._differences.looked(number, self._ns)
        if sigma_m.size:
            self._sigma_m[number] = sigma_m.sum() / sigma_m.size
        self._asked[number] += asked.sum()
        self._shown[number] += (asked * shown).sum()

    def _offsets(self, late: Bool[Mask, "s s"], compared: Bool[Mask, "s s"]) -> Float[Array, "s"]:
        """Return the offset of each source from a majority, less its error [m]; late: pairs that a delay explains.

        compared: pairs that count, less sources that are surely late or ahead.

        A sensor states the standard deviation of what stays of its errors with a person: that of a mean over n people falls with
        their number, and is learned from how much they differ, with the stated one as that of one more person. So the error is
        distributed as Student's t with n + 2 degrees of freedom, whose standard deviation is √(1 + 2 / n) of its scale.
        """
        of = self._differences.offsets()
        stated_m2 = np.maximum(self._sigma_m[:, None], self._sigma_m) ** 2
        error_m = np.sqrt(stated_m2 + of.n_people * (of.between_m2 + of.within_m2)) / of.n_people
        error_of_each_m = np.sqrt(stated_m2 + of.within_m2)
        wider = np.sqrt(1 + 2 / of.n_people)
        off_m = np.maximum(of.together_m - wider * error_m, of.each_m - wider * error_of_each_m)
        in_time = self.delays_s == 0
        return _of_majority(np.where(of.known & ~late, off_m, 0.0), compared & in_time & in_time[:, None])

    def of_suspect(self, look: Look, number: int) -> Look:
        """Return what a suspect source shows: tracks roughly, but neither initiations nor deletions nor weights."""
        off_m2 = max(self.offsets_m[number], _SUSPECT_M) ** 2
        return replace(
            look, covariance=look.covariance + off_m2 * np.eye(2), starts=np.zeros_like(look.starts), load_n=None
        )

    def found(self) -> list[str]:
        """Judge the sources; warn of, and return, what of the suspect ones contradicts the others and was not known before."""
        hardly_shows = (self._asked >= _FEWEST) & (self._shown < _LEAST_SHOWN * self._asked)
        self.suspect = (self.offsets_m > _OFF_M) | (self.delays_s > 0) | hardly_shows
        late = (
            set(np.flatnonzero(self.delays_s > 0).tolist()) - self._named_late
        )  # at first it may have seemed an offset
        new = {
            k: self._sentence(k) for k in np.flatnonzero(self.suspect).tolist() if k in late or k not in self.findings
        }
        self._named_late |= late
        self.findings |= new
        for sentence in new.values():
            logger.warning(sentence)
        return list(new.values())

    def _sentence(self, number: int) -> str:
        """Return a clause that says what of a suspect source contradicts the others."""
        name, off_m, late_s = self._names[number], self.offsets_m[number], self.delays_s[number]
        if late_s > 0:
            or_more = " or more" if late_s >= LONGEST_S else ""
            return f"{name} shows people {late_s:.1f} s{or_more} off the time of the other sensors"
        if off_m > _OFF_M:
            return f"{name} shows people {off_m:.1f} m off where the other sensors do"
        return f"{name} hardly shows the people whom the other sensors show"


def _delays(
    evidence: Float[Array, "s s"], lag_s: Float[Array, "s s"], compared: Bool[Mask, "s s"]
) -> Float[Array, "s"]:
    """Return the time by which each source is surely ahead of a majority, or behind it [s]; else 0."""
    behind, ahead = _of_majority(evidence, compared), _of_majority(evidence.T, compared)
    delays_s = np.zeros(len(compared))
    for k in np.flatnonzero(np.maximum(behind, ahead) > _SURE_NATS).tolist():
        of_pairs, sure = (lag_s[k], evidence[k]) if behind[k] > ahead[k] else (lag_s[:, k], evidence[:, k])
        delays_s[k] = np.median(of_pairs[compared[k] & (sure > _SURE_NATS)])
    return delays_s


def _of_majority(values: Float[Array, "s s"], compared: Bool[Mask, "s s"]) -> Float[Array, "s"]:
    """Return the largest value that so many others of each source reach that they are more than half of all sources.

    All are those that are compared with it, and itself, which counts as one that does not: of m others it takes more than
    (m + 1) / 2. 0 where there are too few.
    """
    count = compared.sum(axis=1)
    if count.max(initial=0) < 2:
        return np.zeros(len(values))
    ordered = np.sort(np.where(compared, values, np.inf), axis=1)  # the compared ones first
    return np.where(count < 2, 0.0, ordered[np.arange(len(values)), np.maximum(count - 1 - (count + 1) // 2, 0)])
