"""Identities of `fusion`: who comes out of hiding, who comes back, and who has changed tracks with another.

Clothes and weights of each person are learned slowly, and what a track has shown lately beside them. A new track goes on with the
identity of a hidden one, or of one that has ended, whose person it can be, as soon as clothes tell; and identities change places
where the clothes shown lately are another person's rather than the track's own (joint assignment over a window: doubtful looks
are not learned).
"""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.gating import distances, max_weight_assignment
from trackers.filters.rows import marked, written
from trackers.fusion.options import ColourIdentityOptions
from trackers.fusion.person_tracks import People
from trackers.observations import NS_PER_S
from trackers.tracking.roster import NEVER_NS
from trackers.vision.histogram import chi_squared, chi_squared_distance

_HIDDEN_S = 0.2
"""A track that has not been measured for longer may be the one that comes up elsewhere [s]."""
_EVEN = 0.35
"""Distance of colours at which two looks are as likely one person's as two people's."""
_COLOUR, _MOST = 12.0, 4.5
"""Log-likelihood ratio per distance of colours, and at most: measured in the twin."""
_WALKS_FROM_M_S = 0.5
"""Speed from which a load is a walker's [m/s]: whatever it is, it is the weight."""
_START_M, _WALKS_M_S = 0.5, 1.0
"""Standard deviations of where a person who has left comes up: at once [m], and by the time since [m/s]."""
_ANYWHERE_M = 3.0
"""Standard deviation of where others come up, from there [m]."""
_STAYS_S = 1.0
"""A track may stay for so long where its person is no more, and show another one's clothes [s]."""
_MOST_ANYWHERE = 2.5
"""Log-likelihood ratio at most of a place for who has left it, against anywhere in the area."""
_CHANGED = 4.0
"""Log-likelihood ratio from which two tracks have changed people."""
_UNKNOWN = 2.0
"""Log-likelihood ratio against which a person wears what one has not learned: in other light, or from another side."""
_SEEN_S = 1.0
"""A look no longer ago tells whether the other track has changed its person, too [s]."""
_FEWEST = 8
"""Looks by which clothes are known well enough to tell that."""
_DOUBTFUL = 0.1
"""A look that is nearer by so much to the clothes of another person, in distance of colours, is not learned."""
_PATIENCE_S = 5.0
"""Clothes, or the light, have changed after doubtful looks for so long [s]."""


class IdentityMemory:
    """Keeps who has left, and gives tracks the identities of the people whom they show."""

    def __init__(self, options: ColourIdentityOptions, room_m2: float = 0.0) -> None:
        """room_m2: size of the area that is tracked [m²], 0: not known."""
        self._options, self._room_m2 = options, room_m2
        self._left: People | None = None

    def remember(self, people: People, ns: int) -> None:
        """Keep tracks that end at stamp ns, if they are confirmed and their clothes or weights are known."""
        kept = people.confirmed & (people.clothes.known | people.weights.known)
        if kept.any():
            self._left = self._left_of(people, ns).joined(people.select(kept))

    def recognized(self, people: People, new: Bool[Mask, "n"], ns: int) -> tuple[People, Bool[Mask, "n"]]:
        """Let tracks that are about to be confirmed, or have just been looked at, go on with identities of others.

        Each takes that of the likeliest, by colours and by how far they are apart: a hidden track's covariance is how far its
        person may have left where no sensor looks; a person who has left walks on. None is a person who was still shown, or
        measured, once the track was there. The hidden track ends. Returns the tracks, and which are still to be confirmed.
        """
        fresh = np.flatnonzero(new | (people.confirmed & (people.clothes.looked_ns == ns)))
        gap_s = (ns - people.roster.measured_ns) / NS_PER_S
        hidden = np.flatnonzero(people.confirmed & (gap_s > _HIDDEN_S) & (people.existence > 0.5))
        left = self._left_of(people, ns)
        if not self._options.gate or not fresh.size or not (hidden.size or len(left)):
            return people, new
        before, after = people.select(hidden), people.select(fresh)
        off = after.positions - before.positions[:, None]
        square = np.einsum("nka,nkab,nkb->nk", off, np.linalg.inv(before.covariance[:, None] + after.covariance), off)
        alike = before.clothes.distance(after.clothes)
        of_hidden = _COLOUR * (_EVEN - np.nan_to_num(alike, nan=_EVEN)) - 0.5 * square
        of_hidden += np.where(new[fresh], 0.5 * self._options.gate**2, 0.0)
        of_hidden += np.nan_to_num(before.weights.log_ratio(after.weights))
        before = before.joined(left)
        # who looked or weighed like others lately was not measured: another one was
        clothes, weights = before.clothes, before.weights
        known_ns = np.maximum(clothes.learned_ns, weights.learned_ns)
        as_others = np.maximum(clothes.looked_ns, weights.felt_ns) > known_ns
        measured_ns = np.where(as_others, known_ns, before.roster.measured_ns)
        known_ns = np.where(known_ns == NEVER_NS, measured_ns, known_ns)
        last_ns = np.where(new[fresh], known_ns[:, None], measured_ns[:, None])
        apart = last_ns <= after.roster.born_ns + _STAYS_S * NS_PER_S
        of_left = np.where(new[fresh], self._as_left(left, after, ns), _as_lost(left, after, ns))
        old, now = max_weight_assignment(np.where(apart, np.concatenate([of_hidden, of_left]), 0.0))
        if not old.size:
            return people, new
        now, is_left = fresh[now], old >= hidden.size
        self._left = left.select(~marked(len(left), old[is_left] - hidden.size))
        people = people.replaced(now, people.select(now).identified_as(before.select(old)))
        stays = ~marked(len(people), hidden[old[~is_left]])
        return people.select(stays), written(new, now, False)[stays]

    def looked(self, people: People, row: Int[Index, "k"], histogram: Float[Array, "k bins"], ns: int) -> People:
        """Return people after clear looks at the clothes of those at `row`, each with the identity that its looks tell."""
        clothes, options = people.clothes, self._options
        own = chi_squared(clothes.reference[row], histogram)
        unlike = people.confirmed[row] & clothes.known[row] & (own > _DOUBTFUL)
        unlike &= ns - clothes.learned_ns[row] < _PATIENCE_S * NS_PER_S
        doubtful = np.zeros(row.size, np.bool_)
        if unlike.any():
            others = (people.confirmed & clothes.known)[:, None] & (np.arange(len(people))[:, None] != row[unlike])
            away = np.where(others, chi_squared_distance(clothes.reference, histogram[unlike]), np.inf)
            departed = chi_squared_distance(self._left_of(people, ns).clothes.reference, histogram[unlike])
            doubtful[unlike] = np.concatenate([away, departed]).min(axis=0) < own[unlike] - _DOUBTFUL
        people = people.changed(
            clothes=clothes.looked(row, histogram, people.positions[row], doubtful, ns, options.learns_s)
        )
        return self._changed_places(people, row, ns) if options.gate else people

    def felt(self, people: People, row: Int[Index, "k"], load_n: Float[Array, "k"], ns: int) -> People:
        """Return people after loads [N] of the whole of those at `row`, each with the identity that its weight tells."""
        walks = np.hypot(*people.velocity[row].T) > _WALKS_FROM_M_S
        weights = people.weights.felt(row, load_n, people.positions[row], walks, ns, self._options.learns_s)
        people = people.changed(weights=weights)
        return self._changed_places(people, row, ns) if self._options.gate else people

    def _changed_places(self, people: People, row: Int[Index, "k"], ns: int) -> People:
        """Return people with the identities exchanged of the two tracks that say most clearly that they have changed people.

        The second may be of who has left; the identity of the first has then left in its place.
        """
        clothes, weights, n = people.clothes, people.weights, len(people)
        sure = people.confirmed & ((clothes.n_look >= _FEWEST) | (weights.learned_s >= weights.LATELY_S))
        recent_ns = ns - round(_SEEN_S * NS_PER_S)
        shown = clothes.looked_ns >= recent_ns
        borne = (weights.felt_ns >= recent_ns) & (weights.lately_s >= weights.LATELY_S)
        body, seen = row[sure[row]], sure & (shown | borne)
        colours = _log_ratio(chi_squared(clothes.reference[body], clothes.lately[body]))
        own = np.where(clothes.known[body] & shown[body], colours, 0.0)
        body = body[own + np.where(borne, weights.own_log_ratio, 0.0)[body] < 0]
        if not body.size:
            return people
        ratio, left = np.zeros((n, n)), self._left_of(people, ns)
        by_weight = weights.learned_ns > clothes.learned_ns
        last_ns = np.where(by_weight, weights.learned_ns, clothes.learned_ns)
        last_at = np.where(by_weight[:, None], weights.learned_at, clothes.learned_at)
        walked = np.nan_to_num(_log_walked(last_at, ns - last_ns, people.positions[seen]))
        ratio[:, seen] = np.nan_to_num(_log_alike(people, people, shown, borne))[:, seen] + walked
        own = np.maximum(ratio.diagonal(), -_UNKNOWN)
        # of identities and tracks: this one's rather than its own
        other = np.where(sure[:, None], ratio - own, -np.inf)
        back = np.where(seen[:, None], other.T, 0.0)
        of_left = _log_back(left, people, _walked_ns(left, ns), shown, borne)
        gain = np.concatenate([other + back, of_left - own])[:, body]
        i, k = np.unravel_index(gain.argmax(), gain.shape)
        if gain[i, k] <= _CHANGED:
            return people
        first = body[[k]]
        if i < n:
            both = np.array([first[0], i])
            others = people.select(both[::-1])
            return people.replaced(both, people.select(both).identified_as(others, exchanged=True))
        departed = np.array([i - n])
        identity, track = left.select(departed), people.select(first)
        self._left = left.replaced(departed, track.changed(existence=np.zeros(1)))
        return people.replaced(first, track.identified_as(identity, exchanged=True))

    def _as_left(self, left: People, people: People, ns: int) -> Float[Array, "l n"]:
        """Return the log-likelihood ratio of new tracks as people who have left, against others; −∞ where nothing tells.

        Others may come up anywhere in the area.
        """
        since_ns = _walked_ns(left, ns)
        sigma_m = _START_M + _WALKS_M_S * since_ns / NS_PER_S
        anywhere = np.clip(np.log(np.maximum(self._room_m2, 1e-9) / (2 * np.pi * sigma_m**2)), 0.0, _MOST_ANYWHERE)
        return _log_back(left, people, since_ns) + anywhere[:, None]

    def _left_of(self, people: People, ns: int) -> People:
        """Return who has left lately enough, none at first."""
        if self._left is None:
            self._left = people.select(np.zeros(len(people), np.bool_))
        return self._left.select(ns - self._left.roster.measured_ns < self._options.recall_s * NS_PER_S)


def _log_ratio(distance: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Return the log-likelihood ratio of looks at one person against two, by the distance of their colours."""
    return np.clip(_COLOUR * (_EVEN - distance), -_MOST, _MOST)


def _log_alike(
    identity: People, tracks: People, shown: Bool[Mask, "k"] | bool = True, borne: Bool[Mask, "k"] | bool = True
) -> Float[Array, "n k"]:
    """Return the log-likelihood ratio of what tracks have shown and borne lately as these people's; NaN where neither tells.

    shown, borne: the tracks whose clothes, and whose loads, tell.
    """
    colours = np.where(shown, _log_ratio(identity.clothes.distance(tracks.clothes)), np.nan)
    weights = np.where(borne, identity.weights.log_ratio(tracks.weights), np.nan)
    return np.where(np.isnan(colours), weights, colours + np.nan_to_num(weights))


def _walked_ns(left: People, ns: int) -> Int[Index, "l"]:
    """Return for how long people may have walked on since they were measured last [ns]: who has not got up is still there."""
    return np.where(left.posture.rests, 0, ns - left.roster.measured_ns)


def _log_walked(
    place: Float[Array, "l 2"], since_ns: Int[Index, "l"], there: Float[Array, "n 2"]
) -> Float[Array, "l n"]:
    """Return the log-likelihood of people to be at places [m] some time after they were elsewhere [m], in that of their peak."""
    sigma_m = _START_M + _WALKS_M_S * since_ns / NS_PER_S
    return -0.5 * (distances(place, there) / sigma_m[:, None]) ** 2


def _log_back(
    left: People,
    people: People,
    since_ns: Int[Index, "l"],
    shown: Bool[Mask, "n"] | bool = True,
    borne: Bool[Mask, "n"] | bool = True,
) -> Float[Array, "l n"]:
    """Return the log-likelihood ratio of tracks as people who may have walked for a time [ns], by their looks and places.

    −∞ where no look tells; shown, borne: see `_log_alike`.
    """
    alike = np.nan_to_num(_log_alike(left, people, shown, borne), nan=-np.inf)
    return alike + _log_walked(left.place, since_ns, people.positions)


def _as_lost(left: People, people: People, ns: int) -> Float[Array, "l n"]:
    """Return the log-likelihood ratio of tracks followed for some time as people who were lost; −∞ of who was followed out."""
    gap_ns = ns - left.roster.measured_ns
    late = 2 * np.log(np.minimum(_ANYWHERE_M / (_START_M + _WALKS_M_S * gap_ns / NS_PER_S), 1.0))
    return _log_back(left, people, gap_ns) + np.where(left.existence < 0.5, late, -np.inf)[:, None]
