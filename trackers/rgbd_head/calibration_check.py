"""Which cameras cannot hang where the rig says, by the empty room and by silhouettes of heads, and what comes of it (ours)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from trackers.arrays import Array, Mask
from trackers.cameras.placed import PlacedCamera
from trackers.rgbd_head.calibration import TURNS_DEG
from trackers.vision.calibration_monitor import CalibrationMonitor, silhouette_top

_OFF_RAD = np.radians(3.5)
"""A camera whose median look is farther off than this hangs elsewhere: one that is turned by 5°, and not by 1° or 2°."""
_FEWEST = 10
"""Looks of a camera that a doubt takes."""
_SEARCHED_RAD = np.radians(10)
"""So far about a crown its silhouette's top is searched for; heads with another so near, as a camera sees them, are left out."""
_TOP_M = 0.12
"""So much of a silhouette, from its top down, is the head whose middle counts."""


class Doubts:
    """names: the cameras. by_room: those whose empty room fits the environment better when they are turned.

    leaves_out: whether who is named is not looked at any more. Most cameras are taken to hang right: never are so many left
    out that no more than half remain, and of two in use none is doubted by heads, as nobody can tell which of them is wrong.
    """

    def __init__(self, names: Sequence[str], by_room: Sequence[str], leaves_out: bool) -> None:
        self._numbers = {name: number for number, name in enumerate(names)}
        self._by_room, self._leaves_out = tuple(by_room), leaves_out
        self._by_heads: list[str] = []
        self.left_out: set[str] = set()
        if leaves_out and self._may_miss(len(by_room)):
            self.left_out.update(by_room)
        self._looks = self._none_yet()

    def take(self, name: str, off_rad: Float[Array, "n 2"]) -> None:
        """Remember how far off a camera shows heads (`silhouette_offsets`)."""
        if len(self._numbers) - len(self.left_out) <= 2:
            return
        for each in off_rad[np.isfinite(off_rad[:, 0])]:
            self._looks.take(self._numbers[name], each)
        for doubted in self._doubted() if self._leaves_out and self._may_miss(1) else ():
            self._by_heads.append(doubted)
            self.left_out.add(doubted)
            self._looks = self._none_yet()  # it drew the estimates that the others were compared with

    @property
    def warnings(self) -> list[str]:
        """A sentence of every camera that is named."""
        room = f"fits the environment better when turned by {TURNS_DEG[0]:g}° or more than as the rig has it"
        heads = "shows heads elsewhere than the other cameras do, and cannot hang as the rig says"
        return [
            *(f"what {name} sees of the empty room {room}{self._and_so(name)}" for name in self._by_room),
            *(f"{name} {heads}{self._and_so(name)}" for name in (*self._by_heads, *self._doubted())),
        ]

    def _and_so(self, name: str) -> str:
        return "; it is looked at no more" if name in self.left_out else ""

    def _may_miss(self, n_more: int) -> bool:
        return 2 * (len(self.left_out) + n_more) < len(self._numbers)

    def _doubted(self) -> list[str]:
        names = list(self._numbers)
        return [names[number] for number in self._looks.doubted]

    def _none_yet(self) -> CalibrationMonitor:
        return CalibrationMonitor(len(self._numbers), _OFF_RAD, _FEWEST)


def silhouette_offsets(
    camera: PlacedCamera, mask: Bool[Mask, "height width"], heads: Float[Array, "4 n"], up_m: float
) -> Float[Array, "n 2"]:
    """How far the tops of silhouettes are to the right of heads' crowns, and below them [rad]; NaN where there is none.

    up_m: how high above their middles heads go.
    """
    crowns = heads[:3].T + np.array([0.0, 0.0, up_m])
    pixels, seen = camera.project(crowns)
    fx = camera.intrinsics.fx
    reach = round(fx * np.tan(_SEARCHED_RAD))
    near = (np.abs(pixels[:, None] - pixels).max(axis=2) < reach).sum(axis=1) > 1  # than themselves
    top_px = _TOP_M * fx / np.linalg.norm(crowns - camera.eye_m, axis=1)
    found = np.full((len(crowns), 2), np.nan)
    for row in np.flatnonzero(seen & ~near):  # at most a few people
        off = silhouette_top(mask, pixels[row], reach, max(2, round(top_px[row])))
        if off is not None:
            found[row] = off / fx
    return found
