"""A camera that keeps one person in the picture: it stays where it is and turns, and cuts to a better place in time."""

from __future__ import annotations

from math import exp

import numpy as np

from trackers.arrays import Array
from twin.instant.snapshot import Snapshot
from twin.view.standpoint import Room, Standpoint, body_parts, fitting, seen_share, standpoint_for

_ASIDE_DEG = 35.0
_SEEN_AT_LEAST = 0.4
_NEAREST_M, _FARTHEST_M = 1.2, 4.5
_CUTS_APART_S = 2.0
_TURNS_WITHIN_S = 0.25
_ZOOMS_WITHIN_S = 0.6
_WIDER = 1.25
"""The picture is wider than the body by so much, that there is room to walk into."""


class CameraMan:
    """Follows a person (id); `aspect`: width over height of the picture."""

    def __init__(self, room: Room, person: int, aspect: float) -> None:
        self._room, self._person, self._aspect = room, person, aspect
        self._stand: Standpoint | None = None
        self._cut_at_s = -np.inf

    def at(self, snapshot: Snapshot, facing_rad: float) -> Standpoint:
        """The camera at the snapshot's time; times rise."""
        parts, radius = body_parts(snapshot, self._person)
        middle = 0.5 * (parts.min(axis=0) + parts.max(axis=0))
        stand = self._stand
        if stand is None or (
            snapshot.t - self._cut_at_s > _CUTS_APART_S and self._is_badly_seen(snapshot, stand, middle)
        ):
            found = standpoint_for(snapshot, self._room, self._person, facing_rad, self._aspect, _ASIDE_DEG)
            stand = Standpoint(found.eye, found.target, _WIDER * found.half_height)
            self._cut_at_s = snapshot.t
        else:
            dt = snapshot.t - self._seen_at_s
            target = stand.target + (1 - exp(-dt / _TURNS_WITHIN_S)) * (middle - stand.target)
            fits = _WIDER * fitting(stand.eye, target, parts, radius, self._aspect)
            half_height = stand.half_height + (1 - exp(-dt / _ZOOMS_WITHIN_S)) * (fits - stand.half_height)
            stand = Standpoint(stand.eye, target, half_height)
        self._stand, self._seen_at_s = stand, snapshot.t
        return stand

    def _is_badly_seen(self, snapshot: Snapshot, stand: Standpoint, middle: Array) -> bool:
        away = float(np.linalg.norm(middle - stand.eye))
        return not _NEAREST_M < away < _FARTHEST_M or seen_share(snapshot, stand.eye, self._person) < _SEEN_AT_LEAST
