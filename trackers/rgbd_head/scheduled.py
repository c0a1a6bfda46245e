"""Evaluators of cameras on separate Dask workers, like the paper's clients on separate computers.

An evaluator is an actor: a picture is sent once, directly to its worker, and stays there; then hypotheses and weights are
exchanged. All cameras work at once, and their results are put in the cameras' order. A worker that dies or does not answer
is replaced permanently by the local evaluator of its camera. That one has learned from all pictures but the last, which it
then takes, and so gives bit-identical results.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from jaxtyping import Float

from trackers.arrays import Array, Singles
from trackers.errors import InputError
from trackers.likelihood.stereo_head import HeadLikelihoods, StereoHeadOptions
from trackers.observations import DepthImage
from trackers.rgbd_head.evaluators import Evaluator, Evaluators
from trackers.scheduler import connected
from trackers.vision.head_colours import ExpectedColours, HeadModel

if TYPE_CHECKING:
    from distributed import Client, Future

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
                except RuntimeError:  # Dask knows that the worker is gone
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
