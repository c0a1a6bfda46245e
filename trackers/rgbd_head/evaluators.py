"""Evaluators of cameras (the paper's clients): each has one camera's picture of the frame and weighs heads by it.

Only messages are exchanged (pictures, hypotheses, likelihoods), so an evaluator may be remote
(`trackers.rgbd_head.scheduled`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from trackers.arrays import Array, Index, Singles
from trackers.likelihood.stereo_head import HeadLikelihoods, RangeOptions, StereoHeadOptions, StereoHeads
from trackers.observations import DepthImage
from trackers.rgbd_head.calibration import head_offsets
from trackers.vision.head_colours import ExpectedColours, HeadModel
from trackers.vision.stereo_picture import PackedPicture, StereoCamera

_LOW_M, _HIGH_M = 0.4, 2.2
"""Heights of foreground searched for new heads."""


class Evaluator:
    """One camera and its last picture; its results depend only on pictures and requests.

    colours: expected per person; None: the share of skin counts.
    """

    def __init__(self, camera: StereoCamera, model: HeadModel, options: StereoHeadOptions) -> None:
        self.camera, self._options = camera, options
        self._heads = StereoHeads([camera.camera], model, options)
        self.colours: ExpectedColours | None = None
        self._picture: PackedPicture | None = None

    def take(self, image: DepthImage) -> bool:
        """Prepare a picture; return whether it is usable."""
        self._picture = self.camera.pack(image)
        return self._picture is not None

    def expect(self, colours: ExpectedColours) -> None:
        """Set the expected colours."""
        self.colours = colours

    def log_likelihood(self, heads: Float[Singles, "4 n p"]) -> HeadLikelihoods:
        """Weigh heads at the picture's stamp (`StereoHeads.log_likelihood`)."""
        return self._heads.log_likelihood([self.picture()], heads[:, None], self.tables())[0]

    def facing(self, heads: Float[Array, "4 n"]) -> Float[Singles, "n directions"]:
        """Weigh directions of heads (`StereoHeads.facing`)."""
        return self._heads.facing([self.picture()], heads[:, None], self.tables())[0]

    def head_offsets(self, heads: Float[Array, "4 n"]) -> Float[Array, "n 2"]:
        """Return the offsets of silhouettes from heads (`trackers.rgbd_head.calibration.head_offsets`)."""
        return head_offsets(self.camera.camera, self.picture().mask, heads, self._options.semi_axes_m[2])

    def colours_on(self, heads: Float[Array, "4 n"]) -> Int[Index, "3 k"]:
        """Return the picture's pixels on heads (`StereoHeads.colours_on`)."""
        return self._heads.colours_on([self.picture()], heads[:, None])

    def unassigned(self, known: Float[Array, "n 2"], apart_m: float) -> Float[Array, "4 k"]:
        """Return foreground points (`StereoCamera.foreground_points`) at the height of people, farther than `apart_m` from
        tracks.

        The distance along the ray allows for the error of depth: a far camera scatters a person's points along it.
        """
        points = self.camera.foreground_points(self.picture())
        points = points[:, (points[2] > _LOW_M) & (points[2] < _HIGH_M)]
        if not len(known) or not points.shape[1]:
            return points
        depth = self._options.depth or RangeOptions()
        ray = points[:3] - self.camera.camera.eye_m[:, None]
        off_m = depth.most * depth.sigma((ray * ray).sum(axis=0))
        east, north = ray[:2] / np.maximum(np.hypot(*ray[:2]), 1e-9)
        x, y = (points[:2, :, None] - known.T[:, None]).astype(float)
        along, across = x * east[:, None] + y * north[:, None], x * north[:, None] - y * east[:, None]
        away = np.hypot(np.maximum(np.abs(along) - off_m[:, None], 0.0), across)
        return points[:, away.min(axis=1) > apart_m]

    def tables(self) -> Float[Singles, "n entries"] | None:
        """Return the log-likelihood of each colour (`ExpectedColours.tables`); None where none are expected."""
        return None if self.colours is None else self.colours.tables

    def picture(self) -> PackedPicture:
        """Return the last picture, which is usable."""
        if self._picture is None:
            raise RuntimeError("asked before there was a picture that shows anything")
        return self._picture


class Evaluators:
    """Evaluators of all cameras in this process, which weigh jointly; results are in the cameras' order.

    taken_over: cameras whose remote evaluator was lost.
    """

    def __init__(self, here: Mapping[str, Evaluator], model: HeadModel, options: StereoHeadOptions) -> None:
        self.here = dict(here)
        self.taken_over: list[str] = []
        self._model, self._options = model, options
        self._heads: dict[tuple[str, ...], StereoHeads] = {}

    def take(self, images: Mapping[str, DepthImage]) -> list[str]:
        """Send each camera's picture; return the cameras with a usable one."""
        shown = self._ask("take", {name: (images[name],) for name in self.here if name in images})
        return [name for name, is_shown in shown.items() if is_shown]

    def expect(self, names: Iterable[str], colours: ExpectedColours) -> None:
        """Set the expected colours of these cameras."""
        self._ask("expect", dict.fromkeys(names, (colours,)))

    def log_likelihood(self, heads: Mapping[str, Float[Singles, "4 n p"]]) -> dict[str, HeadLikelihoods]:
        """Weigh heads at each camera's stamp."""
        if not heads:
            return {}
        together, pictures, tables = self._together(tuple(heads))
        found = together.log_likelihood(pictures, np.stack(list(heads.values()), axis=1), tables)
        return dict(zip(heads, found, strict=True))

    def facing(self, heads: Mapping[str, Float[Array, "4 n"]]) -> list[Float[Singles, "n directions"]]:
        """Weigh directions of heads at each camera's stamp."""
        if not heads:
            return []
        together, pictures, tables = self._together(tuple(heads))
        return list(together.facing(pictures, np.stack(list(heads.values()), axis=1), tables))

    def head_offsets(self, name: str, heads: Float[Array, "4 n"]) -> Float[Array, "n 2"]:
        """Return the offsets of one camera's silhouettes from heads [rad]."""
        return self._ask("head_offsets", {name: (heads,)})[name]

    def colours_on(self, name: str, heads: Float[Array, "4 n"]) -> Int[Index, "3 k"]:
        """Return one camera's pixels on heads."""
        return self._ask("colours_on", {name: (heads,)})[name]

    def unassigned(self, names: Iterable[str], known: Float[Array, "n 2"], apart_m: float) -> Float[Array, "4 k"]:
        """Return points of these cameras' foreground away from tracks."""
        found: Sequence[Array] = list(self._ask("unassigned", dict.fromkeys(names, (known, apart_m))).values())
        return np.concatenate(found, axis=1)

    def close(self) -> None:
        """Stop using the evaluators."""

    def _together(
        self, names: tuple[str, ...]
    ) -> tuple[StereoHeads, list[PackedPicture], Float[Singles, "n entries"] | None]:
        """Return the joint likelihood of these cameras, their pictures, and their common expected colours."""
        if names not in self._heads:
            cameras = [self.here[name].camera.camera for name in names]
            self._heads[names] = StereoHeads(cameras, self._model, self._options)
        return self._heads[names], [self.here[name].picture() for name in names], self.here[names[0]].tables()

    def _ask(self, what: str, arguments: Mapping[str, tuple[Any, ...]]) -> dict[str, Any]:
        return {name: getattr(self.here[name], what)(*each) for name, each in arguments.items()}
