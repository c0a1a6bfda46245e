"""Who is confirmed, what it says of somebody that no look showed them, who is reported meanwhile, and who ends."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from trackers.area import Area
from trackers.arrays import Array, Mask
from trackers.filters.imm import Imm
from trackers.filters.negative_information import existence_after_miss, probability_within, update_missed
from trackers.filters.rows import written
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.laser_fisheye_imm.people import People
from trackers.tracking.lifecycle import clear_of, coasting_within, measured_for_longer, measured_now, nanoseconds

_AT_REST = 0.01
"""Variance of the speed of somebody who lies [m²/s²]."""


class TrackManager:
    """The rules, the numbers given so far, and when any scanner last looked.

    area: where people are (None: everywhere).
    """

    def __init__(self, options: LaserFisheyeImmOptions, area: Area | None, imm: Imm) -> None:
        self._options, self._area, self._imm = options, area, imm
        self._next_id = 1
        self._looked_ns = 0

    def looked(self, ns: int) -> None:
        """A scanner has looked at stamp ns."""
        self._looked_ns = ns

    def confirmed(self, people: People, ns: int, knows_room: bool) -> People:
        """With an id for whoever was measured for long enough, and has moved where only that tells them from the room."""
        if people.confirmed.all():
            return people
        rules, learns = self._options.management, not knows_room
        after_s = rules.confirm_learned_after_s if learns else rules.confirm_after_s
        new = measured_for_longer(people.roster, ns, after_s, self._options.step_s)
        if learns:
            moved = people.measured_at - people.born_at
            new &= np.hypot(moved[:, 0], moved[:, 1]) >= rules.confirm_moved_m
        new = new.nonzero()[0]
        first, self._next_id = self._next_id, self._next_id + new.size
        return people.changed(roster=people.roster.confirm(new, first))

    def unseen(
        self, people: People, ns: int, elapsed_s: float, missed: Callable[[Float[Array, "2 *n"]], Float[Array, "*n"]]
    ) -> People:
        """After a moment: whoever it did not show is likelier where nothing would show them, and the likelier gone.

        missed: how probably the moment, a share of a period, shows nothing of somebody at room points [m].
        """
        rules = self._options.management
        measured = measured_now(people.roster, ns)
        unseen = (people.confirmed & ~measured).nonzero()[0]
        if unseen.size == 0:
            return people
        taken = people.positions[measured & people.confirmed]

        def not_shown(points: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
            free = clear_of(points.reshape(2, -1).T, taken, rules.apart_m).reshape(points.shape[1:])
            return missed(points) * free

        state = people.state.select(unseen)
        state, chance = update_missed(state, not_shown, self._imm.velocity(state))
        sitting, posture = self._options.posture, people.posture.select(unseen)
        seated, seat = posture.seated(people.measured_at[unseen], sitting), np.nan_to_num(posture.seat)
        alone = clear_of(seat, taken, clearance_m=rules.apart_m)
        posture, chance = posture.missed(seated, chance, alone, elapsed_s, sitting)
        at_rest = self._imm.start(seat, None, sitting.place_m**2, _AT_REST)
        state = state.replaced(posture.lying, at_rest.select(posture.lying))
        existence = people.existence
        if rules.survival_s is not None:
            stays_s = np.where(seated, sitting.stays_s, rules.survival_s)
            still = existence_after_miss(existence[unseen], chance, elapsed_s, stays_s)
            existence = written(existence, unseen, still)
        posture = people.posture.replaced(unseen, posture)
        return people.in_state(people.state.replaced(unseen, state)).changed(existence=existence, posture=posture)

    def reported(self, people: People, ns: int) -> Bool[Mask, "n"]:
        """Select the confirmed tracks that are measured, or whose person is probably there and near the reported place.

        A coasting track is a statement about the posterior: its person exists and stands within `within_m` of the mean with
        more than `exists_above`. One that spreads too far, in a shadow, stays for re-identification and is not reported.
        """
        measured = measured_now(people.roster, ns)  # in the area, or the track would have ended
        if measured.all():
            return people.confirmed
        there = self._inside(people) & self._exists(people)
        within_m = self._options.management.within_m
        if within_m is not None:
            chance = people.existence * probability_within(
                people.state, people.positions, within_m, self._imm.velocity(people.state)
            )
            there &= chance > self._options.management.exists_above
        return people.confirmed & (measured | there)

    def remaining(self, people: People, ns: int) -> People:
        """Without whoever has left the area or has not been shown for long."""
        # a prediction that strays out of the area is not yet a person who has left it
        inside = self._inside(people) | ~measured_now(people.roster, ns)
        return people.select(self._goes_on(people, ns) & inside)

    def before(self, people: People, last_ns: int, ns: int) -> People:
        """Return those who are still followed at the look of stamp ns, if the one before was at `last_ns`.

        Time in which nothing looked is no evidence against anybody; after a gap longer than `coast_s` all tracks end.
        """
        return people.select(np.full(len(people), ns - last_ns <= nanoseconds(self._options.management.coast_s)))

    def _goes_on(self, people: People, ns: int) -> Bool[Mask, "n"]:
        """Who is followed on after a look: tentative tracks while measured; by the looks made, those who exist longer."""
        rules, roster = self._options.management, people.roster
        goes_on = coasting_within(roster, ns, rules.coast_s, 0.0)
        looked = ns - self._looked_ns <= nanoseconds(rules.coast_s)
        # without an area there is always somewhere to be, behind the walls
        if looked and rules.survival_s is not None and self._area is not None:
            goes_on |= roster.confirmed & self._exists(people)
        return goes_on

    def _exists(self, people: People) -> Bool[Mask, "n"]:
        """Who is probably still there."""
        return people.exist(self._options.management.exists_above)

    def _inside(self, people: People) -> Bool[Mask, "n"]:
        """Which tracks are in the area or its margin."""
        if self._area is None or len(people) == 0:
            return np.ones(len(people), np.bool_)
        return self._area.contains(people.positions)
