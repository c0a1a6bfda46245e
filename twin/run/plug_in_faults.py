"""What a tracker of the user's own has done wrong, in one sentence for its author."""

from __future__ import annotations

import traceback
from pathlib import Path
from types import FrameType
from typing import Any

from trackers.observations import NS_PER_S
from twin.run.chosen_trackers import ChosenTracker


def plug_in_fault(chosen: ChosenTracker, tracker: Any, error: BaseException, when: str = "") -> str:
    """Class, method, error, the last line of theirs that ran, and the observation that the tracker was given.

    tracker: None while it is made; when: in place of the observation, where there is none.
    """
    steps = list(traceback.walk_tb(error.__traceback__))
    module = chosen.target.partition(":")[0] if tracker is None else type(tracker).__module__
    called = chosen.target if tracker is None else f"{module}:{type(tracker).__qualname__}"
    theirs = [step for step in steps if _module(step[0]) == module]
    what = f"{type(error).__name__}: {first_line(str(error))}".rstrip(": ")
    where = "".join(f" ({Path(frame.f_code.co_filename).name}, line {line})" for frame, line in theirs[-1:])
    name = "" if chosen.name == called else f"tracker {chosen.name}: "
    return f"{name}{called}: {_method(steps, tracker, module)} raised {what}{where} {when or _given(steps)}"


def first_line(text: str) -> str:
    """The first line that says something."""
    return next((line.strip() for line in text.splitlines() if line.strip()), "")


def _method(steps: list[tuple[FrameType, int]], tracker: Any, module: str) -> str:
    """The method of the tracker's that was called; what it returned, where that is at fault."""
    for frame, _ in steps:
        if tracker is None and _module(frame) == module:
            return "the import" if frame.f_code.co_name == "<module>" else f"{frame.f_code.co_name}()"
        if tracker is not None and any(each is tracker for each in frame.f_locals.values()) and _is_theirs(frame):
            return f"{frame.f_code.co_name}()"
    return "the constructor" if tracker is None else "what it gave"


def _is_theirs(frame: FrameType) -> bool:
    return _module(frame) not in ("trackers.tracks", "twin.run.tracker_at_work", "twin.run.detections")


def _module(frame: FrameType) -> str:
    return frame.f_globals.get("__name__", "")


def _given(steps: list[tuple[FrameType, int]]) -> str:
    """The observation that was handed to the tracker, which need not be the one that arrived last."""
    for frame, _ in reversed(steps):
        observation = frame.f_locals.get("observation")
        if observation is not None and not _is_theirs(frame):
            kind = type(observation).__name__
            return f"at the {kind} of {observation.sensor} stamped {observation.stamp_ns / NS_PER_S:.3f} s"
    return "after the last observation"
