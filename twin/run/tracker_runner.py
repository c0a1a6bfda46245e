"""Runner of one tracker: feeds and times it, writes its frames, and reports a plug-in's faults to its author."""

from __future__ import annotations

import re
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from itertools import count
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from trackers.errors import PLUG_IN_ERRORS, InputError, PlugInError
from trackers.feeding import FedTracker, RestartedTracker
from trackers.observations import NS_PER_S, Observation
from trackers.presets import PRESETS, make_tracker
from trackers.prior import Prior
from trackers.rig import Rig
from trackers.tracks import Tracker, TrackFrame, detections_of, misreported, warnings
from twin.messages import at_work
from twin.recording.tables import track_writer
from twin.run.inputs import ChosenTracker
from twin.streams import stream

_ENOUGH_FRAMES, _OFTEN = 20, 0.2
"""Number of frames, and share of them with detections, above which a tracker without any track is warned about.

Of a tracker that does not tell its detections the frames alone count.
"""


class TrackerRunner:
    """A tracker, the file of its frames, and the cost per frame.

    A plug-in that raises is excluded: `failure` describes the fault, its file does not appear, and the others continue.
    """

    def __init__(self, chosen: ChosenTracker, rig: Rig) -> None:
        self.name = chosen.name
        self.tracker: Any = None
        self.failure = ""
        self._chosen = chosen
        self.rig = rig
        self._file = ExitStack()
        self._fed: FedTracker | None = None
        self._write: Callable[[TrackFrame], None] | None = None
        self._pending_ms = 0.0
        self._frame_ms: list[float] = []
        self._tracked = self._is_finished = False
        self._n_frame = self._n_with_detections = 0

    def make(self, prior: Prior, seed: int, jumps_ns: Sequence[int] = ()) -> None:
        """Make the tracker; raises InputError for a wrong name, wrong options or a wrong class.

        jumps_ns: stamps at which a new one replaces it (`trackers.feeding`).
        """

        def made(streamed: str) -> Tracker:
            rng = stream(seed, "tracker", streamed)
            return make_tracker(self._chosen.target, self.rig, prior, rng, self._chosen.options)

        try:
            with at_work(self.name):
                self.tracker = made(self.name)
                faults = misreported(self.tracker, self.rig)
        except PLUG_IN_ERRORS as error:
            if isinstance(error, InputError):
                raise InputError(_as_named(str(error), self._chosen)) from error
            self._fail(error, "before the first observation")
            return
        if not isinstance(self.tracker, Tracker):
            raise InputError(f"--tracker {self.name}: has not both update(observation) and tracks(); a tracker has")
        if faults:
            raise InputError("\n".join(f"--tracker {self.name}: {fault}" for fault in faults))
        if jumps_ns:
            names = (f"{self.name}/{number}" for number in count(1))
            self.tracker = RestartedTracker(self.tracker, lambda: made(next(names)), jumps_ns, self.rig.main_sensor)
        self._fed = FedTracker(self.tracker, self.rig)

    @property
    def losses(self) -> Mapping[tuple[str, str], int]:
        """Observations dropped so far, by sensor and reason."""
        return self._fed.losses if self._fed is not None else {}

    @contextmanager
    def writing(self, path: Path) -> Iterator[None]:
        """Write the frames to this file, which appears when the block ends normally and the tracker has not failed."""
        with self._file:
            if not self.failure:
                self._write = self._file.enter_context(track_writer(path))
            yield

    def update(self, observation: Observation) -> list[TrackFrame]:
        """Return the completed frames after this observation, written and timed; none of a failed tracker."""
        return self._frames(lambda fed: fed.update(observation))

    def finish(self) -> list[TrackFrame]:
        """Return the remaining frames."""
        self._is_finished = True
        return self._frames(FedTracker.finish)

    def _frames(self, call: Callable[[FedTracker], list[TrackFrame]]) -> list[TrackFrame]:
        if self.failure or self._fed is None or self._write is None:
            return []
        start = time.thread_time()
        try:
            with at_work(self.name):
                frames = call(self._fed)
            self._pending_ms += 1e3 * (time.thread_time() - start)
        except PLUG_IN_ERRORS as error:
            self._fail(error)
            return []
        for frame in frames:
            try:
                self._write(frame)
            except OSError:  # of the disk, not the tracker
                raise
            except Exception as error:
                stamp_ns = getattr(frame, "stamp_ns", None)
                stamp = f"{stamp_ns / NS_PER_S:.3f} s" if isinstance(stamp_ns, int) else f"{stamp_ns!r}"
                self._fail(error, f"in the frame stamped {stamp}")
                return []
        if frames:
            try:
                self._note_silence(frames)
            except PLUG_IN_ERRORS as error:
                self._fail(error, "when asked for its detections")
                return []
            self._frame_ms += [self._pending_ms / len(frames)] * len(frames)
            self._pending_ms = 0.0
        return frames

    def warnings(self, anybody: bool | None = False) -> list[str]:
        """Return warnings: the tracker's, missing options, no track in many frames. anybody: people were there; None: unknown."""
        preset = PRESETS.get(self._chosen.target)
        missing = (
            [] if preset is None else [each for each in preset.needs.items() if each[0] not in self._chosen.options]
        )
        needs = [f"needs the option `{option}`: {what}" for option, what in missing]
        return [*warnings(self.tracker), *needs, *self._silence(anybody)]

    def _silence(self, anybody: bool | None) -> list[str]:
        """Return one clause if no track was reported although something is detected, people were there, or neither is known."""
        n, detected, is_enough = self._n_frame, self._n_with_detections, self._n_frame >= _ENOUGH_FRAMES
        if self._tracked or self.failure:
            return []
        if detections_of(self.tracker) is None:
            return [f"reports no track in any of {n} frames"] * (self._is_finished and is_enough)
        if is_enough and detected >= _OFTEN * n:
            often = f"{detected} of {n} frames"
            return [f"reports no track, although it detects something in {often}; `twin detections` shows what"]
        if self._is_finished and is_enough and anybody is not False:
            who = "people were there" if anybody else "whether anybody was there is not known"
            return [f"reports no track in any of {n} frames, and detects something in {detected} of them; {who}"]
        if self._is_finished and not is_enough and (detected or anybody is not False):
            return [f"reports no track{' of what it detects' if detected else ''}: too few frames, {n}"]
        return []

    def _note_silence(self, frames: Sequence[TrackFrame]) -> None:
        """Count frames with detections until a track is reported."""
        if self._tracked:
            return
        self._tracked = any(frame.tracks for frame in frames)
        detections = detections_of(self.tracker)
        self._n_frame += len(frames)
        # detections of one call belong to its frames
        if detections is not None and detections():
            self._n_with_detections += len(frames)

    def _fail(self, error: BaseException, when: str = "") -> None:
        """Note a plug-in's fault and drop its file; pass on an exception of a tracker of ours."""
        if self._chosen.target in PRESETS:
            raise error
        self.failure = plug_in_fault(self._chosen, self.tracker, error, when)
        self._file.__exit__(*sys.exc_info())

    def ms_per_frame(self) -> dict[str, float | None]:
        """Return mean and 95th percentile of a frame's cost [ms of CPU, of the tracker's own thread]; None before the first."""
        if not self._frame_ms:
            return {"mean": None, "p95": None}
        return {"mean": float(np.mean(self._frame_ms)), "p95": float(np.percentile(self._frame_ms, 95))}


def file_name(tracker: str) -> str:
    """Return the name of a tracker's table without its suffix: 'my_lab.tracker:Mine' becomes 'my_lab.tracker-Mine'."""
    return tracker.replace(":", "-").replace("/", "-")


@contextmanager
def tracker_runners(
    chosen: Sequence[ChosenTracker], rig: Rig, prior: Prior, seed: int, folder: Path, jumps_ns: Sequence[int] = ()
) -> Iterator[list[TrackerRunner]]:
    """Make the chosen trackers, each writing `folder/<name>.csv` in the block; `jumps_ns` as for `TrackerRunner.make`.

    Raises InputError for an unknown tracker or option, PlugInError where none can be made, before anything is written.
    """
    runners = [TrackerRunner(each, rig) for each in chosen]
    for each in runners:
        each.make(prior, seed, jumps_ns)
    check_some_left(runners)
    with ExitStack() as stack:
        for each in runners:
            stack.enter_context(each.writing(folder / f"{file_name(each.name)}.csv"))
        yield runners


def check_some_left(runners: Sequence[TrackerRunner]) -> None:
    """Raise PlugInError if all of at least one tracker have failed."""
    if runners and all(each.failure for each in runners):
        raise PlugInError("\n".join(each.failure for each in runners))


def plug_in_fault(chosen: ChosenTracker, tracker: Any, error: BaseException, when: str = "") -> str:
    """Format class, method, error, the plug-in's last executed line, and the tracker's input observation.

    tracker: None during its making; when: replaces the observation without one.
    """
    steps = list(traceback.walk_tb(error.__traceback__))
    module = chosen.target.partition(":")[0] if tracker is None else type(tracker).__module__
    called = chosen.target if tracker is None else f"{module}:{type(tracker).__qualname__}"
    name_of = "" if chosen.name == called else f"tracker {chosen.name}: "
    theirs = [step for step in steps if _module(step[0]) == module]
    if isinstance(error, ValueError) and not theirs and (method := _method(steps, tracker, module)) == _GIVEN:
        of_ours = "" if isinstance(error, InputError) else f"{method}: "
        return f"{name_of}{called}: {of_ours}{first_line(str(error))} {when or _given(steps)}"
    what = f"{type(error).__name__}: {first_line(str(error))}".rstrip(": ")
    where = "".join(f" ({Path(frame.f_code.co_filename).name}, line {line})" for frame, line in theirs[-1:])
    return f"{name_of}{called}: {_method(steps, tracker, module)} raised {what}{where} {when or _given(steps)}"


def _as_named(fault: str, chosen: ChosenTracker) -> str:
    """Return the lines of a fault of a tracker's options, at the place where the user's own name for it stands."""
    if chosen.name == chosen.target:
        return fault
    return re.sub(rf"^tracker '?{re.escape(chosen.target)}'?: ", f"trackers.{chosen.name}: ", fault, flags=re.MULTILINE)


def first_line(text: str) -> str:
    """Return the first line that is not blank."""
    return next((line.strip() for line in text.splitlines() if line.strip()), "")


_GIVEN = "what it gave"


def _method(steps: list[tuple[FrameType, int]], tracker: Any, module: str) -> str:
    """Return the tracker's method called; 'what it gave' for a fault of its result."""
    for frame, _ in steps:
        if tracker is None and _module(frame) == module:
            return "the import" if frame.f_code.co_name == "<module>" else f"{frame.f_code.co_name}()"
        if tracker is not None and any(each is tracker for each in frame.f_locals.values()) and _is_theirs(frame):
            return f"{frame.f_code.co_name}()"
    return "the constructor" if tracker is None else _GIVEN


def _is_theirs(frame: FrameType) -> bool:
    return _module(frame) not in ("trackers.feeding", "twin.run.feed", "twin.run.tracker_runner", "twin.studies.worker")


def _module(frame: FrameType) -> str:
    return frame.f_globals.get("__name__", "")


def _given(steps: list[tuple[FrameType, int]]) -> str:
    """Return the tracker's input observation, which may differ from the one that arrived last."""
    for frame, _ in reversed(steps):
        observation = frame.f_locals.get("observation")
        if observation is not None and not _is_theirs(frame):
            kind = type(observation).__name__
            return f"at the {kind} of {observation.sensor} stamped {observation.stamp_ns / NS_PER_S:.3f} s"
    return "after the last observation"
