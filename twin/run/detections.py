"""The table of `twin detections`: a tracker's detections in a recording, one row per detection.

Columns: `t` stamp of the frame [s]; `sensors` that detected it, joined by `+`; `role` (`waist`: a trunk, `knee`: legs); `x`,
`y` ground point in the room frame [m]; `variance` of the position on each axis [m²]; `width` as measured [m]. Numbers are
empty where the detector does not give them. A frame without detections has no row.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TextIO

from trackers.errors import InputError, PlugInError
from trackers.feeding import FedTracker
from trackers.presets import PRESETS
from trackers.prior import Prior
from trackers.text_file import AnyPath
from trackers.tracks import Detection, detections_of
from twin.messages import OnWarning
from twin.recording.losses import dropped_by, lines
from twin.recording.reader import Recording
from twin.recording.tables import number_cell, seconds_cell
from twin.run.inputs import ChosenTracker, chosen_trackers, files_for, scenario_of
from twin.run.tracker_runner import TrackerRunner, plug_in_fault

COLUMNS = ("t", "sensors", "role", "x", "y", "variance", "width")


def write_detections(
    recording: AnyPath,
    file: TextIO,
    *,
    tracker: str,
    rig_path: AnyPath | None = None,
    changes: Sequence[str] = (),
    seed: int | None = None,
    on_warning: OnWarning = lambda warning: None,
) -> None:
    """Track a recording and write the tracker's detections; `rig_path`, `changes`, `seed` as for `twin track`.

    Raises InputError for bad input, a tracker without detections among it, before anything is written.
    """
    bag = Recording(recording, rig_path)
    scenario = scenario_of(bag)
    seed = seed if seed is not None else scenario.seed if scenario is not None else 0
    (chosen,) = chosen_trackers(bag, scenario, [tracker], changes)
    files, missing = files_for(bag, scenario, rig_path, changes)
    warned = [*missing, *lines(bag.losses), *bag.moving]
    for warning in warned:
        on_warning(warning)
    made = TrackerRunner(chosen, bag.rig)
    made.make(Prior.read(bag.background, files, bag.rig), seed, bag.jumps_ns)
    if made.failure:
        raise PlugInError(made.failure)
    detections = detections_of(made.tracker)
    if detections is None:
        raise InputError(
            f"--tracker {tracker}: does not tell what its detector sees; one that has detections() is expected, like sort"
        )
    file.write(",".join(COLUMNS) + "\n")
    n_fed: Counter[str] = Counter()
    fed = FedTracker(made.tracker, bag.rig, on_worked=lambda: file.writelines(map(_row, detections())))
    for observation in bag.observations():
        n_fed[observation.sensor] += 1
        _called(chosen, made.tracker, partial(fed.update, observation))
    _called(chosen, made.tracker, fed.finish)
    for warning in lines([*bag.losses, *dropped_by(made.name, fed.losses, n_fed, bag.ahead_s)]):
        if warning not in warned:
            on_warning(warning)


def _called(chosen: ChosenTracker, tracker: Any, call: Callable[[], object]) -> None:
    """Call a tracker; raises PlugInError for an exception of a plug-in, but passes on that of a tracker of ours."""
    try:
        call()
    except OSError:  # of the file, not the tracker
        raise
    except Exception as error:
        if chosen.target in PRESETS:
            raise
        raise PlugInError(plug_in_fault(chosen, tracker, error)) from error


def _row(each: Detection) -> str:
    numbers = map(number_cell, (each.x, each.y, each.variance_m2, each.width_m))
    return ",".join([seconds_cell(each.stamp_ns), "+".join(each.sensors), each.role, *numbers]) + "\n"
