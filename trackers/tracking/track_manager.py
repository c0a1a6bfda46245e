"""Track management: initiation, confirmation, deletion and re-identification with common options for every tracker.

Times are integer nanoseconds, like stamps, so that floating-point rounding decides no rule.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, PositiveInt

from trackers.area import Area
from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.configuration import Strict
from trackers.filters.gating import distances
from trackers.observations import NS_PER_S
from trackers.tracking.roster import Roster, State


class TrackManagementOptions(Strict):
    """Options `track_management` of every tracker; systems have their own values and additional rules."""

    confirm_s: float = Field(
        default=0.0,
        ge=0,
        description="a tentative track is confirmed once it was measured for longer than this, each frame standing for a "
        "period [s]",
    )
    confirm_hits: PositiveInt = Field(default=1, description="and in at least so many frames")
    coast_s: float = Field(
        default=2.0, ge=0, description="a confirmed track that was not measured for longer is deleted [s]"
    )
    tentative_coast_s: float = Field(
        default=0.0, ge=0, description="a tentative track that was not measured for longer is deleted [s]"
    )
    report_s: float | None = Field(
        default=None, ge=0, description="a coasting track is reported for so long [s]; null: until it is deleted"
    )
    start_apart_m: float = Field(
        default=0.5, ge=0, description="no track is initiated nearer than this to another [m]; 0: anywhere"
    )
    area_margin_m: float = Field(
        default=0.3,
        ge=0,
        description="how far outside the rig's area tracks are kept [m]; a rig without one has no limit",
    )


class ReidentificationOptions(Strict):
    """Options of re-identification, within the range that a person out of sight may have walked."""

    reid_m: float = Field(default=0.0, ge=0, description="distance of re-identification at once [m]")
    reid_speed_m_s: float | None = Field(
        default=1.5,
        ge=0,
        description="what that distance grows by per second out of sight [m/s]; null: no re-identification",
    )


class TrackManager:
    """Rules by which tracks of a roster are confirmed, reported and deleted, and the ids assigned so far.

    options: the system's; corners: (c, 2) of the rig's area [m], None: unlimited.
    """

    def __init__(self, options: TrackManagementOptions, corners: ArrayLike | None) -> None:
        self._limits = options
        self.area = None if corners is None else Area(corners, options.area_margin_m)
        self._next_id = 1

    def to_confirm(
        self, roster: Roster[State], ns: int, frame_ns: int, confirm_s: float | None = None
    ) -> Bool[Mask, "n"]:
        """Return a mask of the tentative tracks, measured at stamp ns, that were measured long and often enough.

        frame_ns: duration that a frame stands for, and so that of a track first measured at this stamp; confirm_s: overrides
        the option.
        """
        confirm_s = self._limits.confirm_s if confirm_s is None else confirm_s
        often = measured_often(roster, ns, self._limits.confirm_hits)
        return often & (ns - roster.born_ns + frame_ns > nanoseconds(confirm_s))

    def confirm(self, roster: Roster[State], new: Bool[Mask, "n"]) -> Roster[State]:
        """Confirm the tracks in a mask, with the next ids in the order of the roster."""
        if not new.any():
            return roster
        return roster.confirm(new, int(self.new_ids(int(new.sum()))[0]))

    def new_ids(self, count: int) -> Int[Index, "k"]:
        """Return the next ids, at least one."""
        first, self._next_id = self._next_id, self._next_id + count
        return first + np.arange(count)

    def lasting(self, roster: Roster[State], ns: int) -> Bool[Mask, "n"]:
        """Return a mask of the tracks measured recently enough to be kept at stamp ns."""
        return coasting_within(roster, ns, self._limits.coast_s, self._limits.tentative_coast_s)

    def reported(self, roster: Roster[State], ns: int) -> Bool[Mask, "n"]:
        """Return a mask of the confirmed tracks measured recently enough to be reported at stamp ns."""
        limit_s = self._limits.report_s
        if limit_s is None:
            return roster.confirmed
        return roster.confirmed & coasting_within(roster, ns, limit_s, 0.0)

    def inside(self, positions: Float[Array, "n 2"]) -> Bool[Mask, "n"]:
        """Return a mask of the positions [m] in the rig's area or its margin; all without an area."""
        if self.area is None or len(positions) == 0:
            return np.ones(len(positions), np.bool_)
        return self.area.contains(positions)

    def beyond(self, points: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
        """Return 1 for points [m] beyond the rig's area and its margin, else 0."""
        return (~self.inside(points.reshape(2, -1).T)).astype(np.float64).reshape(points.shape[1:])

    def may_start(self, positions: Float[Array, "k 2"], tracks: Float[Array, "n 2"]) -> Bool[Mask, "k"]:
        """Return a mask of the positions [m] far enough from every track, and in the area, to initiate a track."""
        return clear_of(positions, tracks, self._limits.start_apart_m) & self.inside(positions)


def reachable(
    last_seen: Float[Array, "n 2"],
    coasted_ns: NDArray[np.int64],
    positions: Float[Array, "k 2"],
    options: ReidentificationOptions,
) -> Bool[Mask, "n k"]:
    """Return a mask of pairs of a track, not measured for `coasted_ns` (n,), and a position [m] that its person may have
    reached.
    """
    if options.reid_speed_m_s is None:
        return np.zeros((len(last_seen), len(positions)), np.bool_)
    reach_m = options.reid_m + options.reid_speed_m_s * (coasted_ns / NS_PER_S)
    return distances(last_seen, positions) <= reach_m[:, None]


def nanoseconds(seconds: Array | float) -> NDArray[np.int64] | int:
    """Return seconds as whole nanoseconds, of the same shape."""
    if isinstance(seconds, float):
        return round(seconds * NS_PER_S)
    return np.rint(np.asarray(seconds) * NS_PER_S).astype(np.int64)


def measured_now(roster: Roster[State], ns: int) -> Bool[Mask, "n"]:
    """Return a mask of the tracks measured at stamp ns; other confirmed ones are coasting."""
    return roster.measured_ns == ns


def measured_often(roster: Roster[State], ns: int, at_least: int) -> Bool[Mask, "n"]:
    """Return a mask of the tentative tracks measured at ns, and `at_least` times in total."""
    return ~roster.confirmed & measured_now(roster, ns) & (roster.n_measured >= at_least)


def coasting_within(
    roster: Roster[State], ns: int, confirmed_s: Array | float, tentative_s: Array | float
) -> Bool[Mask, "n"]:
    """Return a mask of the tracks last measured at most `confirmed_s` ago, tentative ones `tentative_s` [s]."""
    allowed_s = np.where(roster.confirmed, confirmed_s, tentative_s)
    return ns - roster.measured_ns <= nanoseconds(allowed_s)


def clear_of(
    position: Float[Array, "k 2"], bodies: Float[Array, "p 2"], clearance_m: Float[Array, "k"] | float
) -> Bool[Mask, "k"]:
    """Return a mask of the positions farther than `clearance_m` from every body [m]."""
    if len(bodies) == 0:
        return np.ones(len(position), np.bool_)
    return distances(position, bodies).min(axis=1) > clearance_m
