"""Identities: tracks that come out of hiding, by clothes and by how far their people can have walked."""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array, Bool, Float, Mask
from trackers.filters.gating import distances, max_weight_assignment
from trackers.filters.rows import written
from trackers.fusion.options import ColourIdentityOptions
from trackers.fusion.people import People
from trackers.fusion.posture import LAIN_M
from trackers.observations import NS_PER_S

_HIDDEN_S = 0.2
"""A track that has not been measured for longer may be the one that comes up elsewhere [s]."""
_NEAR_M = 0.5
"""And so much farther than its person can have walked [m]."""
_EVEN = 0.35
"""Distance of colours at which two looks are as likely one person's as two people's."""
_COLOUR = 12.0
"""Log-likelihood ratio per distance of colours: measured in the twin."""


def colour_distance(first: People, second: People) -> Float[Array, "n k"]:
    """Return χ² distances of the clothes of tracks, that of an even ratio where either is not known."""
    distance = first.clothes.distance(second.clothes.reference, second.clothes.known)
    return np.full((len(first), len(second)), _EVEN) if distance is None else np.nan_to_num(distance, nan=_EVEN)


def reidentified(
    people: People, new: Bool[Mask, "n"], ns: int, options: ColourIdentityOptions
) -> tuple[People, Bool[Mask, "n"]]:
    """Let tracks that are about to be confirmed go on with the identities of hidden ones whose people they can be.

    Each takes that of the likeliest, by colours and by how far it is from where that was expected; the hidden track ends. Returns
    the tracks, and which of them are still to be confirmed.
    """
    gap_s = (ns - people.roster.measured_ns) / NS_PER_S
    hidden = np.flatnonzero(people.confirmed & (gap_s > _HIDDEN_S) & (people.existence > 0.5))
    fresh = np.flatnonzero(new)
    if not fresh.size or not hidden.size or not options.reach_m_s:
        return people, new
    before, after = people.select(hidden), people.select(fresh)
    walked_m = _NEAR_M + options.reach_m_s * gap_s[hidden]
    # who rests gets up before they walk
    reach_m = np.where(before.posture.rests, np.minimum(LAIN_M, walked_m), walked_m)[:, None]
    away = distances(before.place, after.positions)
    colour = colour_distance(before, after)
    worth = np.where(
        (away <= reach_m) & (colour <= options.same_below), 1.0 + _COLOUR * (1 - colour) - away / reach_m, 0.0
    )
    old, now = max_weight_assignment(worth)
    if not old.size:
        return people, new
    old, now = hidden[old], fresh[now]
    roster = people.roster.changed(
        id=written(people.roster.id, now, people.roster.id[old]),
        confirmed=written(people.roster.confirmed, now, True),
        born_ns=written(people.roster.born_ns, now, people.roster.born_ns[old]),
    )
    clothes = people.clothes.replaced(
        now[people.clothes.known[old]], people.clothes.select(old[people.clothes.known[old]])
    )
    people = people.changed(
        roster=roster,
        clothes=clothes,
        stature_m=written(people.stature_m, now, people.stature_m[old]),
    )
    stays = np.ones(len(people), np.bool_)
    stays[old] = False
    new = written(new, now, False)
    return people.select(stays), new[stays]
