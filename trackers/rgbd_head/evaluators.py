"""The cameras' evaluators (the paper's clients): each has one camera's picture of the moment and weighs what it is handed.

Handed over and back are pictures, hypotheses, weights and what else stands in a message; so an evaluator may be anywhere
(`trackers.rgbd_head.scheduled`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from trackers.arrays import Array, Index, Singles
from trackers.observations import DepthImage
from trackers.rgbd_head.calibration_check import silhouette_offsets
from trackers.rgbd_head.colours import ExpectedColours
from trackers.rgbd_head.picture import CameraFrontEnd, Picture
from trackers.rgbd_head.weighing import Weigher, Weights

_LOW_M, _HIGH_M = 0.4, 2.2
"""Foreground between is asked for newcomers."""


class Evaluator:
    """One camera and its last picture. What it answers is a function of its pictures and of what it is asked, of nothing else.

    colours: what is expected of everybody; None: the share of skin counts.
    """

    def __init__(self, watcher: CameraFrontEnd) -> None:
        self.watcher = watcher
        self._weigher = Weigher([watcher])
        self.colours: ExpectedColours | None = None
        self._picture: Picture | None = None

    def take(self, image: DepthImage) -> bool:
        """Make a picture ready; whether it shows anything."""
        self._picture = self.watcher.ready(image)
        return self._picture is not None

    def expect(self, colours: ExpectedColours) -> None:
        """From now on these colours are expected."""
        self.colours = colours

    def weights(self, heads: Float[Singles, "4 n p"]) -> Weights:
        """The weights that the picture gives heads at its stamp (`Weigher.weights`)."""
        return self._weigher.weights([self.shown()], heads[:, None], self.tables())[0]

    def facing(self, heads: Float[Array, "4 n"]) -> Float[Singles, "n directions"]:
        """What the picture says of where heads face (`Weigher.facing`)."""
        return self._weigher.facing([self.shown()], heads[:, None], self.tables())[0]

    def silhouette_offsets(self, heads: Float[Array, "4 n"]) -> Float[Array, "n 2"]:
        """How far aside of heads the picture has their silhouettes (`trackers.rgbd_head.calibration_check`)."""
        return silhouette_offsets(self.watcher.camera, self.shown().mask, heads, self.watcher.crown_m)

    def look(self, heads: Float[Array, "4 n"]) -> Int[Index, "3 k"]:
        """The picture's pixels on heads (`Weigher.look`)."""
        return self._weigher.look([self.shown()], heads[:, None])

    def strangers(self, known: Float[Array, "n 2"], apart_m: float) -> Float[Array, "4 k"]:
        """Points of the foreground (`CameraFrontEnd.strangers`) as high as people, farther than `apart_m` from known places.

        Along the ray a point may be wherever its distance may be off: what a far camera sees of somebody lies about them.
        """
        points = self.watcher.strangers(self.shown())
        points = points[:, (points[2] > _LOW_M) & (points[2] < _HIGH_M)]
        if not len(known):
            return points
        if not points.shape[1]:
            return points
        eye, depth = self.watcher.camera.eye_m, self.watcher.options.depth
        ray = points[:3] - eye[:, None]
        off_m = depth.most * (depth.sigma_m + depth.sigma_per_m * (ray * ray).sum(axis=0))
        east, north = ray[:2] / np.maximum(np.hypot(*ray[:2]), 1e-9)
        x, y = (points[:2, :, None] - known.T[:, None]).astype(float)
        along, aside = x * east[:, None] + y * north[:, None], x * north[:, None] - y * east[:, None]
        away = np.hypot(np.maximum(np.abs(along) - off_m[:, None], 0.0), aside)
        return points[:, away.min(axis=1) > apart_m]

    def tables(self) -> Float[Singles, "n entries"] | None:
        """How likely each colour is (`ExpectedColours.tables`)."""
        return None if self.colours is None else self.colours.tables

    def shown(self) -> Picture:
        """The last picture, which shows something."""
        if self._picture is None:
            raise RuntimeError("asked before there was a picture that shows anything")
        return self._picture


class Evaluators:
    """All cameras' evaluators, asked here, where pictures weigh together; answers are in the cameras' order.

    taken_over: cameras whose evaluator was elsewhere and was lost.
    """

    def __init__(self, here: Mapping[str, Evaluator]) -> None:
        self.here = dict(here)
        self.taken_over: list[str] = []
        self._weighers: dict[tuple[str, ...], Weigher] = {}

    def take(self, images: Mapping[str, DepthImage]) -> list[str]:
        """Hand over each camera's picture; those that show anything."""
        shown = self._ask("take", {name: (images[name],) for name in self.here if name in images})
        return [name for name, is_shown in shown.items() if is_shown]

    def expect(self, names: Iterable[str], colours: ExpectedColours) -> None:
        """Tell these cameras which colours are expected."""
        self._ask("expect", dict.fromkeys(names, (colours,)))

    def weights(self, heads: Mapping[str, Float[Singles, "4 n p"]]) -> dict[str, Weights]:
        """What each camera makes of the heads at its picture's stamp."""
        if not heads:
            return {}
        weigher, pictures, tables = self._together(tuple(heads))
        return dict(zip(heads, weigher.weights(pictures, np.stack(list(heads.values()), axis=1), tables), strict=True))

    def facing(self, heads: Mapping[str, Float[Array, "4 n"]]) -> list[Float[Singles, "n directions"]]:
        """What each camera says of where heads face that are there at its picture's stamp."""
        if not heads:
            return []
        weigher, pictures, tables = self._together(tuple(heads))
        return list(weigher.facing(pictures, np.stack(list(heads.values()), axis=1), tables))

    def silhouette_offsets(self, name: str, heads: Float[Array, "4 n"]) -> Float[Array, "n 2"]:
        """How far aside of heads one camera has their silhouettes [rad]."""
        return self._ask("silhouette_offsets", {name: (heads,)})[name]

    def look(self, name: str, heads: Float[Array, "4 n"]) -> Int[Index, "3 k"]:
        """One camera's pixels on heads."""
        return self._ask("look", {name: (heads,)})[name]

    def strangers(self, names: Iterable[str], known: Float[Array, "n 2"], apart_m: float) -> Float[Array, "4 k"]:
        """Points of these cameras' foreground away from known places."""
        found: Sequence[Array] = list(self._ask("strangers", dict.fromkeys(names, (known, apart_m))).values())
        return np.concatenate(found, axis=1)

    def close(self) -> None:
        """Nothing is asked any more."""

    def _together(self, names: tuple[str, ...]) -> tuple[Weigher, list[Picture], Float[Singles, "n entries"] | None]:
        """What weighs heads for these cameras, their pictures, and what all of them expect."""
        if names not in self._weighers:
            self._weighers[names] = Weigher([self.here[name].watcher for name in names])
        return self._weighers[names], [self.here[name].shown() for name in names], self.here[names[0]].tables()

    def _ask(self, what: str, arguments: Mapping[str, tuple[Any, ...]]) -> dict[str, Any]:
        return {name: getattr(self.here[name], what)(*each) for name, each in arguments.items()}
