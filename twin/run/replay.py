"""`twin track`: any recording through any tracker, the twin's or a robot's."""

from __future__ import annotations

import json
import shlex
import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice, pairwise
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field

from trackers.configuration import Strict, validate
from trackers.errors import InputError
from trackers.observations import NS_PER_S, LaserScan, Observation
from trackers.plain_data import parse_yaml
from trackers.prior import Prior
from trackers.rig import PriorFiles
from trackers.text_file import AnyPath
from trackers.tracks import TrackFrame
from twin.limits import are_limits_lifted
from twin.progress import OnProgress, OnWarning
from twin.recording.atomic_file import open_atomic
from twin.recording.detail_tables import DETAIL_FILES
from twin.recording.losses import documents, lines
from twin.recording.reader import Recording
from twin.recording.situation_table import situation_table
from twin.recording.tables import truth_table
from twin.recording.track_topics import check_copy, copy_with_tracks
from twin.report.birdseye import Polygon
from twin.report.page import RunFacts
from twin.report.scan_density import ScanDensity
from twin.room.building import room_outline
from twin.run.chosen_trackers import (
    TRACK,
    ChosenTracker,
    TrustedClasses,
    changed_trackers,
    choose,
    typed_classes,
    typed_schedulers,
)
from twin.run.feed import feed
from twin.run.out_folder import OutFolder, out_folder
from twin.run.outcome import (
    Place,
    RunResult,
    doubts_of,
    evaluate_trackers,
    left_alone,
    simplifications,
    tracker_notes,
    versions,
    write_results,
)
from twin.run.prior import files_for, notes_of
from twin.run.tracker_at_work import file_name
from twin.scenario import Scenario, TrackerChoice
from twin.scenario.load import apply_overrides
from twin.scenario.size import check_size
from twin.world.heap import heap_trimmed
from twin.world.world import World

_RATE_PROBE = 20
_ABOUT = "recording.json"
"""Says of a recording what the tables of tracks do not: the stamp of t = 0, and what of it was lost."""
_BESIDES = ("metrics.json", "preview.mp4", _ABOUT)


def track_recording(
    recording: AnyPath,
    *,
    trackers: Sequence[str],
    rig_path: AnyPath | None = None,
    changes: Sequence[str] = (),
    seed: int | None = None,
    out: AnyPath | None = None,
    video: bool = True,
    report: bool = True,
    bag_copy: AnyPath | None = None,
    on_progress: OnProgress = lambda what, done, total: None,
    on_warning: OnWarning = lambda warning: None,
) -> RunResult:
    """Track a recording into `out`: tracks, report, and metrics where the bag holds truth.

    The default folder is out/<its name>, for the twin's out/<its run>-tracked. `changes`: overrides like
    'trackers.NAME.field=value' and 'prior.environment=FILE'; `seed`: of trackers that draw at random (default: that of
    the run that wrote the bag, else 0); `report`: whether to write one; `bag_copy`: where to write a copy
    of the recording that holds the tracks too. A class (`module:Class`) is taken from `trackers` and `changes`, never from
    the bag. Raises InputError for bad input, before anything is written, and PlugInError when every tracker has failed;
    where others are left, the result says which did.
    """
    recording, rig_path, out, bag_copy = Path(recording), _path(rig_path), _path(out), _path(bag_copy)
    bag = Recording(recording, rig_path)
    scenario = scenario_of(bag)
    names = list(trackers)
    chosen = chosen_trackers(bag, scenario, names, changes)
    files, missing = files_for(bag, scenario, rig_path, changes)
    if bag_copy is not None:
        check_copy(recording, bag_copy)
    seed = seed if seed is not None else scenario.seed if scenario is not None else 0
    folder = out if out is not None else _default_folder(recording, bag)
    command = _command(recording, names, rig_path, changes, seed)
    files_made = [*(f"tracks/{file_name(name)}.csv" for name in names), "report.html", *_BESIDES]
    with heap_trimmed(), out_folder(folder, files_made) as place:
        return _track(
            bag,
            scenario,
            chosen,
            files,
            missing,
            seed,
            place,
            video,
            report,
            bag_copy,
            command,
            on_progress,
            on_warning,
        )


def _path(given: AnyPath | None) -> Path | None:
    return None if given is None else Path(given)


def _track(
    bag: Recording,
    scenario: Scenario | None,
    chosen: Sequence[ChosenTracker],
    files: PriorFiles,
    missing: Sequence[str],
    seed: int,
    out: OutFolder,
    video: bool,
    report: bool,
    bag_copy: Path | None,
    command: str,
    on_progress: OnProgress,
    on_warning: OnWarning,
) -> RunResult:
    folder, recording = out.path, bag.path
    title = scenario.name if scenario is not None else recording.stem
    truth_frames = list(bag.truth())
    truth = truth_table(truth_frames, str(recording)) if truth_frames else None
    situations = situation_table(bag.situations(), str(recording))
    person_names = {number: name for number, name in enumerate(scenario.people, start=1)} if scenario else None
    outline = _outline(scenario) if report or video else []
    faults = scenario.faults if scenario is not None else {}
    place = Place(bag.rig, outline, person_names, None if outline or not report else ScanDensity(bag.rig))

    with feed(
        folder,
        bag.rig,
        Prior.read(bag.background, files, bag.rig),
        chosen,
        seed,
        video_hz=_rate_hz(bag) if video else None,
        title=title,
        outline=outline,
        person_names=person_names,
        jumps_ns=bag.jumps_ns,
    ) as fed:
        frames: list[tuple[str, TrackFrame]] = []
        if bag_copy is not None:
            fed.on_frame = lambda name, frame: frames.append((name, frame))
        warnings = [*missing, *lines(bag.losses), *bag.moving, *left_alone(fed.at_work, faults)]
        for warning in warnings:
            on_warning(warning)
        untold = deque(truth_frames)
        start = time.perf_counter()
        for observation in _counted(bag.observations(), bag.observation_count, on_progress):
            if isinstance(observation, LaserScan) and place.scans is not None:
                place.scans.add(observation)
            while fed.shown is not None and untold and untold[0].stamp_ns <= observation.stamp_ns:
                fed.shown.tell(untold.popleft())
            fed.observe(observation)
        fed.finish()
        doubts = doubts_of(fed.at_work)
        losses = [*bag.losses, *fed.losses(bag.ahead_s)]
        new = [each for each in (*lines(losses), *doubts) if each not in warnings]  # that came on the way
        for each in new:
            on_warning(each)
        spent_s = time.perf_counter() - start
        out.announce()

    duration_s = scenario.duration_s if scenario is not None else bag.duration_s
    facts = RunFacts(
        title=title,
        description=f"recorded in {recording.name}"
        + ("" if bag.is_twin else f"; t = 0 is the stamp {bag.start_ns} ns"),
        seed=seed,
        duration_s=duration_s,
        realtime_factor=duration_s / spent_s,
        versions=versions(None),
        command=command,
        start_stamp_ns=bag.start_ns,
        notes=(
            *notes_of(files),
            *(f"{each}." for each in (*lines(losses), *bag.moving)),
            *tracker_notes(fed.at_work, faults),
            *(simplifications(scenario) if bag.is_twin else ()),
        ),
    )
    results = evaluate_trackers(folder, fed.at_work, truth, situations)
    about = {"recording": str(recording), "start_stamp_ns": bag.start_ns, "losses": documents(losses)}
    with open_atomic(folder / _ABOUT) as stream:
        json.dump(about, stream, indent=2, allow_nan=False)
        stream.write("\n")
    result = write_results(folder, facts, results, fed, truth, place, losses=losses, report=report)
    for note in result.warnings:
        on_warning(note)
    left = result.files | {"about": folder / _ABOUT}
    out.finish(
        list(left.values()),
        kept=("recording.mcap", "truth.csv", "truth_people.csv", "truth_feet.csv", *DETAIL_FILES, "scenario.yaml"),
    )
    if bag_copy is not None:
        names = [each.name for each in fed.at_work if not each.failure]
        frames = [(name, frame) for name, frame in frames if name in names]
        copy_with_tracks(bag, bag_copy, names, frames, on_warning)
        left = left | {"bag": bag_copy}
    return replace(result, files=left, warnings=(*warnings, *new, *result.warnings), doubts=tuple(doubts))


def _default_folder(recording: Path, bag: Recording) -> Path:
    """Every run of the twin's leaves a recording.mcap: its folder tells them apart."""
    name = f"{recording.resolve().parent.name}-tracked" if bag.is_twin else recording.stem
    return Path("out") / name


def _outline(scenario: Scenario | None) -> list[Polygon]:
    """The plan of the room that a twin's bag was recorded in; none where the room is not on this machine."""
    if scenario is None:
        return []
    try:
        world = World(scenario.model_copy(update={"people": {}}))  # who walks there is no part of its plan
    except InputError:
        return []
    return room_outline(world.scene.model, world.empty_snapshot(0.0).data)


def scenario_of(bag: Recording) -> Scenario | None:
    """The scenario carried in a twin's bag; raises InputError for one that is none, or larger than the limits."""
    if bag.scenario_yaml is None:
        return None
    source = f"{bag.path}, topic /scenario"
    scenario = validate(Scenario, parse_yaml(bag.scenario_yaml, source, "a resolved scenario"), source)
    if not are_limits_lifted():
        check_size(scenario, source=source)
    return scenario


def chosen_trackers(
    bag: Recording, scenario: Scenario | None, names: Sequence[str], changes: Sequence[str]
) -> list[ChosenTracker]:
    """The trackers called `names`, as the bag's scenario defines them, with the overrides applied; InputError for bad ones."""
    source = "--set" if scenario is None else f"{bag.path}, topic /scenario"
    trusted = TrustedClasses(typed_classes(changes) | typed_schedulers(changes))
    return choose(names, _defined(scenario, names, changes), source, trusted, TRACK)


def _defined(scenario: Scenario | None, names: Sequence[str], changes: Sequence[str]) -> dict[str, TrackerChoice]:
    """The trackers that the bag's scenario defines, with the overrides applied; of those that nobody asks for, none."""
    asked = {*names, *changed_trackers(changes)}
    content = {
        "trackers": {
            name: choice.model_dump(exclude_none=True) for name, choice in scenario.trackers.items() if name in asked
        }
        if scenario is not None
        else {}
    }
    return validate(_Changeable, apply_overrides(content, changes), "--set").trackers


class _Changeable(Strict):
    """What `--set` may change of a recording: only the trackers, and what they are handed (see `twin.run.prior`)."""

    former_names: ClassVar[Mapping[str, str]] = {"knowledge": "prior"}

    trackers: dict[str, TrackerChoice] = Field(default_factory=dict)
    prior: PriorFiles | None = None


def _rate_hz(bag: Recording) -> float:
    """How often the main sensor reports, from its first few observations; 10 where it cannot be told."""
    main = (each.stamp_ns for each in bag.observations() if each.sensor == bag.rig.main_sensor)
    stamps = list(islice(main, _RATE_PROBE))
    gaps_ns = [later - earlier for earlier, later in pairwise(stamps) if later > earlier]
    return float(NS_PER_S / np.median(gaps_ns)) if gaps_ns else 10.0


def _counted(observations: Iterable[Observation], total: int, on_progress: OnProgress) -> Iterator[Observation]:
    for number, observation in enumerate(observations, start=1):
        yield observation
        on_progress("tracking", number, total)


def _command(recording: Path, names: Sequence[str], rig_path: Path | None, changes: Sequence[str], seed: int) -> str:
    """The line that tracks the recording again."""
    parts = ["twin", "track", str(recording)]
    for name in names:
        parts += ["--tracker", name]
    if rig_path is not None:
        parts += ["--rig", str(rig_path)]
    for change in changes:
        parts += ["--set", change]
    parts += ["--seed", str(seed)]
    return shlex.join(parts)
