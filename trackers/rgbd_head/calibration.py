"""Calibration check (ours): detects cameras displaced from the rig's poses, by the empty room and by silhouettes of heads."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from trackers.arrays import Array, Bool, Float, Mask, Singles
from trackers.cameras.placed import PlacedCamera
from trackers.environment.model import Environment
from trackers.vision.front_end import CalibrationMonitor, projection_jacobian, silhouette_offsets
from trackers.vision.stereo_picture import StereoCamera

TURNS_DEG = (5.0, 9.0)
"""Turns of a camera whose empty room is compared: a better fit after one than after none or a tolerated one is an error."""
_TOLERATED_DEG = 2.0
_NEAR_M = 4.0
"""Distance beyond which depth is too inaccurate."""
_WITHIN_M = 0.1
"""Distance of points from a known surface that counts as on it."""
_EVERY = 8
_FITS, _SIGMAS = 0.5, 2.0
"""Least share of points on known surfaces after a turn that counts, and its gain in standard deviations: far and slanting
surfaces fit hardly by any turn, and then by chance best after one or another.
"""
_AXES = np.array([axis for axis in itertools.product((-1, 0, 1), repeat=3) if any(axis)], float)
"""Axes of the cube: of the picture, and between them, in both senses."""


_OFF_RAD = np.radians(1.75)
"""Median residual above which a camera is displaced. Of four cameras, one turned by 2° keeps about .028 rad (a camera's mean
leverage is 3/8), one 20 cm aside .03 to .04; all correct ones less than .002.
"""
_SEARCHED_RAD = np.radians(10)
"""Search radius for a silhouette's top about a crown; heads with another within it in the picture are left out."""


class HeadOffsets(NamedTuple):
    """Offsets of n silhouettes from heads' crowns (`silhouettes_off_rad`).

    jacobian: of the projection by crowns [rad/m].
    """

    off_rad: Float[Array, "n 2"]
    jacobian: Float[Array, "n 2 3"]


class CalibrationCheck:
    """Checker of the cameras `names`. by_room: those whose empty room fits the environment better after a turn.

    leaves_out: whether displaced cameras are no longer used. Most cameras are assumed correct: more than half always remain,
    and of two in use none is excluded by heads, as it is unknown which is wrong.
    """

    def __init__(self, names: Sequence[str], by_room: Sequence[str], leaves_out: bool) -> None:
        self._numbers = {name: number for number, name in enumerate(names)}
        self._by_room, self._leaves_out = tuple(by_room), leaves_out
        self._by_heads: list[str] = []
        self.left_out: set[str] = set()
        if leaves_out and self._may_miss(len(by_room)):
            self.left_out.update(by_room)
        self._looks = self._none_yet()

    def take(self, heads: Mapping[str, HeadOffsets], shown: Bool[Mask, "n"]) -> None:
        """Add the offsets of one frame's heads in each camera that shows it (`head_offsets`). shown: those that count."""
        off_rad = np.full((len(self._numbers), len(shown), 2), np.nan)
        jacobian = np.zeros((*off_rad.shape, 3))
        for name, each in heads.items():
            off_rad[self._numbers[name]], jacobian[self._numbers[name]] = each
        self._looks.take_heads(off_rad[:, shown], jacobian[:, shown])
        for suspect in self._suspect() if self._leaves_out and self._may_miss(1) else ():
            self._by_heads.append(suspect)
            self.left_out.add(suspect)
            self._looks = self._none_yet()  # the others were compared with it

    @property
    def warnings(self) -> list[str]:
        """One sentence per displaced camera."""
        room = f"fits the environment better when turned by {TURNS_DEG[0]:g}° or more than as the rig has it"
        heads = "shows heads elsewhere than the other cameras do, and cannot hang as the rig says"
        return [
            *(f"the empty room that {name} sees {room}{self._and_so(name)}" for name in self._by_room),
            *(f"{name} {heads}{self._and_so(name)}" for name in (*self._by_heads, *self._suspect())),
        ]

    def _and_so(self, name: str) -> str:
        return "; its pictures are not used any more" if name in self.left_out else ""

    def _may_miss(self, n_more: int) -> bool:
        return 2 * (len(self.left_out) + n_more) < len(self._numbers)

    def _suspect(self) -> list[str]:
        names = list(self._numbers)
        return [names[number] for number in self._looks.suspect]

    def _none_yet(self) -> CalibrationMonitor:
        return CalibrationMonitor(len(self._numbers), _OFF_RAD)


def turned(cameras: Mapping[str, StereoCamera], environment: Environment | None) -> list[str]:
    """Name the displaced cameras, as far as the room is known."""
    if environment is None:
        return []
    return [
        name
        for name, each in cameras.items()
        if each.empty_depth_m.size > 1 and is_turned(each.camera, each.empty_depth_m, environment)
    ]


def is_turned(camera: PlacedCamera, depth_m: Float[Singles, "height width"], environment: Environment) -> bool:
    """Return whether the camera's depth of the empty room fits the environment best after more than the tolerated turn."""
    known = (depth_m > 0) & (depth_m < _NEAR_M)
    points = camera.points(np.where(known, depth_m, np.float32(0)))[::_EVERY, ::_EVERY].reshape(-1, 3)
    off = points[np.isfinite(points).all(axis=1)] - camera.eye_m
    if not len(off):
        return False
    axes = _AXES / np.linalg.norm(_AXES, axis=1, keepdims=True) @ camera.rotation.T

    def agreement(turn_deg: float) -> float:
        turns = Rotation.from_rotvec(np.radians(turn_deg) * (axes if turn_deg else axes[:1]))
        return max(environment.agreement(turn.apply(off) + camera.eye_m, _WITHIN_M) for turn in turns)

    as_is, after = max(agreement(0.0), agreement(_TOLERATED_DEG)), max(map(agreement, TURNS_DEG))
    sigma = np.sqrt(after * (1 - after) + 1 / len(off)) / np.sqrt(len(off))
    return bool(after >= _FITS and after - as_is > _SIGMAS * sigma)


def silhouettes_off_rad(
    camera: PlacedCamera, mask: Bool[Mask, "height width"], crowns: Float[Array, "n 3"]
) -> Float[Array, "n 2"]:
    """Return the offsets of silhouettes from heads' crowns, to the right and down; NaN without one."""
    focal_px = camera.intrinsics.fx
    reach_px = np.full(len(crowns), round(focal_px * np.tan(_SEARCHED_RAD)), float)
    return silhouette_offsets(camera, mask, crowns, reach_px, reach_px) / focal_px


def crowns(heads: Float[Array, "4 n"], up_m: float) -> Float[Array, "n 3"]:
    """Return the crowns of heads. up_m: height of a crown above the middle of a head."""
    return heads[:3].T + np.array([0.0, 0.0, up_m])


def crowns_jacobian(camera: PlacedCamera, crowns: Float[Array, "n 3"]) -> Float[Array, "n 2 3"]:
    """Return the Jacobian of the projection by crowns [rad/m]."""
    return projection_jacobian(camera, crowns) / camera.intrinsics.fx
