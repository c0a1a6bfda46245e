"""Errors of heads in every frame of a run, by range, visibility and posture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from trackers.arrays import Array, Index, Mask
from trackers.observations import NS_PER_S
from trackers.rig import Rig, placed_camera
from twin.recording.tables import TrackTable, TruthTable

LOST_M, LOST_S = 0.5, 1.0
"""Horizontal distance from the head to the nearest track, and its duration, that make a person lost."""
_SEATED_SHARE = 0.8
"""Height of the pelvis, as a share of its greatest in the run, below which a person sits or bends."""


@dataclass(frozen=True, eq=False)
class HeadErrors:
    """n matches of a person and a track. off_m: track less truth, x, y, z; turned_rad: its yaw less the true one.

    seen_by: number of cameras with a free view of the middle of the head; range_m: from the nearest of them. lost: number of
    people; found_s: time when the last person was found; nan if a person was not.
    """

    stamps_ns: NDArray[np.int64]
    off_m: Array
    turned_rad: Array
    range_m: Array
    seen_by: Index
    seated: Mask
    lost: int
    found_s: float

    @property
    def xy_cm(self) -> Array:
        """Error in XY."""
        return 100 * np.hypot(self.off_m[:, 0], self.off_m[:, 1])

    @property
    def yaw_deg(self) -> Array:
        """Absolute error of the yaw."""
        return np.degrees(np.abs(self.turned_rad))

    def statistics(self) -> dict[str, float]:
        """Compute every statistic of the run, by name."""
        level, up, turned = self.xy_cm, 100 * self.off_m[:, 2], self.yaw_deg
        known = level.size > 0
        return {
            "XY": level.mean() if known else np.nan,
            "XY, standard deviation": level.std() if known else np.nan,
            "XY, largest": level.max() if known else np.nan,
            "Z": np.abs(up).mean() if known else np.nan,
            "Z, standard deviation": np.abs(up).std() if known else np.nan,
            "Z, largest": np.abs(up).max() if known else np.nan,
            "Z, bias": up.mean() if known else np.nan,
            "yaw": turned.mean() if known else np.nan,
            "yaw, median": float(np.median(turned)) if known else np.nan,
            "lost": float(self.lost),
            "found after": self.found_s,
        }


def head_errors(truth: TruthTable, tracks: TrackTable, rig: Rig) -> HeadErrors:
    """Match each person with the nearest track in every frame, distinct within `LOST_M` for several people.

    A single person is matched at any distance, so that a track that slid away is an error and not a miss.
    """
    people = np.unique(truth.id)
    gate = np.inf if people.size == 1 else LOST_M
    near: dict[int, list[tuple[int, bool]]] = {int(each): [] for each in people}
    rows: list[tuple[int, int]] = []
    for stamp in tracks.frame_stamps_ns:
        there, found = np.flatnonzero(truth.stamps_ns == stamp), np.flatnonzero(tracks.stamps_ns == stamp)
        there = there[~np.isnan(truth.head_x[there])]
        away = np.hypot(
            truth.head_x[there, None] - tracks.head_x[found], truth.head_y[there, None] - tracks.head_y[found]
        )
        pairs = dict(zip(*linear_sum_assignment(np.minimum(away, 10.0)), strict=True)) if away.size else {}
        for k, row in enumerate(there):
            distance = away[k, pairs[k]] if k in pairs else np.inf
            near[int(truth.id[row])].append((int(stamp), bool(distance < LOST_M)))
            if k in pairs and distance < gate:
                rows.append((int(row), int(found[pairs[k]])))
    row, track = np.array(rows, np.intp).reshape(-1, 2).T
    place = np.column_stack([truth.head_x, truth.head_y, truth.head_z])[row]
    seen_by, range_m = _sight(place, truth, row, rig)
    turned = tracks.head_yaw[track] - truth.head_yaw[row]
    highest = {int(each): np.nanmax(truth.z[truth.id == each]) for each in people}
    return HeadErrors(
        stamps_ns=truth.stamps_ns[row],
        off_m=np.column_stack([tracks.head_x, tracks.head_y, tracks.head_z])[track] - place,
        turned_rad=(turned + np.pi) % (2 * np.pi) - np.pi,
        range_m=range_m,
        seen_by=seen_by,
        seated=truth.z[row] < _SEATED_SHARE * np.array([highest[int(each)] for each in truth.id[row]]),
        lost=sum(_is_lost(each) for each in near.values()),
        found_s=max((_found_s(each) for each in near.values()), default=np.nan),
    )


def spread_cm(runs: Mapping[int, TrackTable]) -> tuple[Array, Array]:
    """Compute the standard deviation between runs of one recording at each common stamp, in XY and Z [cm]."""
    stamps = sorted(set.intersection(*({int(each) for each in run.stamps_ns} for run in runs.values())))
    places = np.array(
        [
            [
                (run.head_x[at], run.head_y[at], run.head_z[at])
                for at in (int(np.searchsorted(run.stamps_ns, stamp)) for stamp in stamps)
            ]
            for run in runs.values()
        ]
    )
    off = places - places.mean(axis=0)
    return 100 * np.sqrt((off[..., :2] ** 2).sum(axis=-1).mean(axis=0)), 100 * np.sqrt((off[..., 2] ** 2).mean(axis=0))


def _sight(place: Array, truth: TruthTable, row: Index, rig: Rig) -> tuple[Index, Array]:
    """Count the cameras that see each head, and measure the distance to the nearest."""
    seen_by, nearest = np.zeros(len(place), np.intp), np.full(len(place), np.inf)
    for name, sensor in rig.cameras().items():
        camera = placed_camera(sensor)
        seen = camera.project(place)[1] & (truth.visible[name][row] > 0 if name in truth.visible else True)
        away = np.linalg.norm(place - camera.eye_m, axis=1)
        seen_by += seen
        nearest = np.where(seen, np.minimum(nearest, away), nearest)
    return seen_by, nearest


def _is_lost(near: list[tuple[int, bool]]) -> bool:
    """Return whether a person once found was away from every track for too long."""
    since = None
    found = False
    for stamp, here in near:
        found |= here
        since = None if here else since if since is not None else stamp
        if found and since is not None and stamp - since >= LOST_S * NS_PER_S:
            return True
    return not found


def _found_s(near: list[tuple[int, bool]]) -> float:
    """Measure the time from a person's first frame to the first match [s]."""
    return next(((stamp - near[0][0]) / NS_PER_S for stamp, here in near if here), np.nan)
