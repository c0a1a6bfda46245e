"""Whose legs are whose: under each trunk that is seen its own, the others by where people are expected to walk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from trackers.arrays import Array, Index
from trackers.filters.gating import distances
from trackers.laser.grouping import pair_off, take_legs
from trackers.laser_fisheye_imm.detection import Seen
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.laser_fisheye_imm.people import People
from trackers.tracking.track_manager import nanoseconds


@dataclass(frozen=True, eq=False)
class Walkers:
    """People as their legs alone show them, and the middle of the legs under each trunk."""

    position: Float[Array, "p 2"]  # [m]
    n_leg: Int[Index, "p"]
    under_trunk: Float[Array, "k 2"]  # [m], NaN where not both are seen


def find_walkers(
    seen: Seen,
    people: People,
    trunk_of: Int[Index, "n"],
    reach_m: float,
    ns: int,
    options: LaserFisheyeImmOptions,
) -> Walkers:
    """The legs of a moment at ns, shared out at once among k trunks and those of n people whom none of them shows.

    trunk_of: the trunk that shows each person, or −1; reach_m: how far from where a person is expected their legs may be.
    A third leg under a trunk is a bag, and nobody else's. Whoever sits is as far behind the knees as before. Legs that nobody
    takes are strangers'.
    """
    knee, legs = options.knee, seen.legs.position
    wide, trunks = seen.legs.width_m > knee.both_legs_m, seen.trunks.position
    n_trunk, shown = len(trunks), trunk_of >= 0
    under = trunks.copy()
    under[trunk_of[shown]] += people.posture.knees[shown]
    at_trunks = distances(under, legs).min(axis=0, initial=np.inf) <= options.track_management.apart_m

    hidden = people.select(~shown)
    seated = hidden.posture.seated(hidden.measured_at, options.posture)
    before = np.where(seated[:, None], hidden.posture.knees, 0.0)
    half_seen = ns - hidden.whole_ns > nanoseconds(knee.single_leg_s)
    barred = np.zeros((n_trunk + len(hidden), len(legs)), np.bool_)
    barred[n_trunk:] = at_trunks

    def of_both(trunk: float, person: Float[Array, "h"] | float) -> Float[Array, "both"]:
        return np.concatenate([np.full(n_trunk, trunk), np.broadcast_to(person, len(hidden))])

    expected = np.concatenate([under, hidden.positions + before])
    reach, opposite = of_both(knee.claim_m, reach_m), of_both(0.0, knee.opposite)
    first_leg_m2 = of_both(0.0, np.where(half_seen, knee.half_seen_m2, 0.0))
    position, n_leg, free = expected.copy(), np.zeros(len(expected), np.intp), np.ones(len(legs), np.bool_)
    everybody = np.arange(len(expected))
    for who in [everybody] if knee.shared else [everybody[:n_trunk], everybody[n_trunk:]]:
        found = take_legs(
            legs[free],
            wide[free],
            expected[who],
            reach[who],
            knee.stride_m,
            opposite[who],
            first_leg_m2[who],
            barred[np.ix_(who, free)],
        )
        position[who], n_leg[who], free[free] = found
    # one leg is up to half a stride from the middle
    own = np.where(n_leg[:n_trunk, None] == 2, position[:n_trunk], np.nan)
    known = n_leg[n_trunk:] > 0
    free &= ~at_trunks
    strangers, n_leg_of_strangers = pair_off(legs[free], knee.pair_m, seen.firm[free])
    walkers = np.concatenate([(position[n_trunk:] - before)[known], strangers])
    return Walkers(walkers, np.concatenate([n_leg[n_trunk:][known], n_leg_of_strangers]), own)
