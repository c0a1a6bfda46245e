"""Evaluators of cameras (the paper's clients): each has one camera's picture of the frame and weighs heads by it.

Only messages are exchanged (pictures, hypotheses, likelihoods), so an evaluator may run on a Dask worker, like the paper's
clients on separate computers. It is an actor then: a picture is sent once, directly to its worker, and stays there; then
hypotheses and weights are exchanged. All cameras work at once, and their results are put in the cameras' order. A worker that
dies or does not answer is replaced permanently by the local evaluator of its camera. That one has learned from all pictures
but the last, which it then takes, and so gives bit-identical results.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from trackers.arrays import Array, Float, Index, Int, Singles
from trackers.errors import InputError
from trackers.likelihood.stereo_head import HeadLikelihoods, RangeOptions, StereoHeadOptions, StereoHeads
from trackers.observations import DepthImage
from trackers.rgbd_head.calibration import HeadOffsets, crowns, crowns_jacobian, silhouettes_off_rad
from trackers.scheduler import connected
from trackers.vision.head_colours import ExpectedColours, HeadModel
from trackers.vision.stereo_picture import PackedPicture, StereoCamera

if TYPE_CHECKING:
    from distributed import Client, Future

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
        return self._heads.facing(self._heads.close_look([self.picture()], heads[:, None]), self.tables())[0]

    def silhouettes_off_rad(self, crowns: Float[Array, "n 3"]) -> Float[Array, "n 2"]:
        """Return the offsets of silhouettes from heads' crowns (`trackers.rgbd_head.calibration.silhouettes_off_rad`)."""
        return silhouettes_off_rad(self.camera.camera, self.picture().mask, crowns)

    def colours_on(self, heads: Float[Array, "4 n"]) -> Int[Index, "3 k"]:
        """Return the picture's pixels on heads (`StereoHeads.colours_on`)."""
        return self._heads.colours_on(self._heads.close_look([self.picture()], heads[:, None]))

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
        look = together.close_look(pictures, np.stack(list(heads.values()), axis=1))
        return list(together.facing(look, tables))

    def head_offsets(self, heads: Mapping[str, Float[Array, "4 n"]]) -> dict[str, HeadOffsets]:
        """Return the offsets of each camera's silhouettes from heads at its stamp."""
        at = {name: crowns(each, self._options.semi_axes_m[2]) for name, each in heads.items()}
        off_rad = self._ask("silhouettes_off_rad", {name: (each,) for name, each in at.items()})
        return {
            name: HeadOffsets(off_rad[name], crowns_jacobian(self.here[name].camera.camera, at[name])) for name in at
        }

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


_ANSWER_S = 10.0
"""Time limit of a worker's answer, after which it counts as dead."""
_START_S = 60.0


class ScheduledEvaluators(Evaluators):
    """Raises InputError without a scheduler at the address, and for fewer workers than cameras."""

    def __init__(
        self, here: Mapping[str, Evaluator], model: HeadModel, options: StereoHeadOptions, address: str
    ) -> None:
        super().__init__(here, model, options)
        self._last: dict[str, DepthImage] = {}
        self._colours: ExpectedColours | None = None
        self._client = connected(address, f"tracker rgbd-head: scheduler: {address}", direct=True)
        try:
            self._kept = _sent(self._client, self.here, address)  # Dask drops unreferenced futures
            with self._client.as_current():
                self._actors = {name: each.result(timeout=_START_S) for name, each in self._kept.items()}
        except BaseException:
            self.close()
            raise

    def take(self, images: Mapping[str, DepthImage]) -> list[str]:
        """Send as `Evaluators` does; keep the last picture of each camera, and learn from earlier ones."""
        for name in self._actors.keys() & images.keys():
            if name in self._last:
                self.here[name].camera.front_end.pass_over(self._last[name])
            self._last[name] = images[name]
        return super().take(images)

    def expect(self, names: Iterable[str], colours: ExpectedColours) -> None:
        """Set as `Evaluators` does; keep the colours for evaluators taken over later."""
        self._colours = colours
        super().expect(names, colours)

    def log_likelihood(self, heads: Mapping[str, Float[Singles, "4 n p"]]) -> dict[str, HeadLikelihoods]:
        """Weigh as `Evaluators` does, but each camera's on its worker."""
        return self._ask("log_likelihood", {name: (each,) for name, each in heads.items()})

    def facing(self, heads: Mapping[str, Float[Array, "4 n"]]) -> list[Float[Singles, "n directions"]]:
        """Weigh as `Evaluators` does, but each camera's on its worker."""
        return list(self._ask("facing", {name: (each,) for name, each in heads.items()}).values())

    def close(self) -> None:
        """Disconnect from the workers."""
        self._client.close()

    def _ask(self, what: str, arguments: Mapping[str, tuple[Any, ...]]) -> dict[str, Any]:
        asked, answers = {}, {}
        with self._client.as_current():
            for name in arguments.keys() & self._actors.keys():
                try:
                    asked[name] = getattr(self._actors[name], what)(*arguments[name])
                except RuntimeError:  # Dask knows that the worker has died
                    self._take_over(name, what)
            for name, each in asked.items():
                try:
                    answers[name] = each.result(timeout=_ANSWER_S)
                except OSError:  # no answer, or none in time
                    self._take_over(name, what)
        missing = {name: each for name, each in arguments.items() if name not in answers}
        answers |= super()._ask(what, missing)
        return {name: answers[name] for name in arguments}

    def _take_over(self, name: str, what: str) -> None:
        """Take over a camera's evaluator permanently, with its last picture unless it is about to take another."""
        del self._actors[name]
        self.taken_over.append(name)
        last = self._last.pop(name, None)
        if last is not None and what != "take":
            self.here[name].take(last)
            self.here[name].colours = self._colours


def _sent(client: Client, here: Mapping[str, Evaluator], address: str) -> dict[str, Future]:
    """Send the evaluators as actors, each to its own worker."""
    workers = sorted(client.scheduler_info(n_workers=-1)["workers"])
    if len(workers) < len(here):
        raise InputError(
            f"tracker rgbd-head: scheduler: {address} has {len(workers)} workers for {len(here)} cameras; "
            "one for each is expected"
        )
    with client.as_current():  # copied, since workers may be in this process
        return {
            name: client.submit(copy.deepcopy, each, actor=True, workers=[worker], pure=False)
            for (name, each), worker in zip(here.items(), workers, strict=False)
        }
