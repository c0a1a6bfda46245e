"""Feed any recording, the twin's or a robot's, to any tracker: `twin track`."""

from __future__ import annotations

import json
import shlex
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from itertools import chain, islice, pairwise
from pathlib import Path

import numpy as np

from trackers.errors import InputError
from trackers.observations import NS_PER_S, LaserScan, Observation, Odometry
from trackers.prior import Prior
from trackers.rig import PriorFiles
from trackers.tracks import TrackFrame
from trackers.user_input.text_file import AnyPath, as_path
from twin.evaluate.report_clock import truth_at
from twin.messages import OnProgress, OnWarning, no_progress, warn
from twin.recording.atomic_file import write_atomic
from twin.recording.losses import documents, lines
from twin.recording.reader import Recording
from twin.recording.situation_table import situation_table
from twin.recording.tables import TruthTable, truth_table
from twin.recording.track_topics import check_copy, copy_with_tracks
from twin.recording.truth_tables import ABOUT, TRUTH_FILES, read_own_truth, truth_frames
from twin.report.birdseye import Polygon, Site
from twin.report.page import RunFacts
from twin.report.path_map import ScanDensity
from twin.run.feed import IN_A_ROW, Feed, open_feed
from twin.run.inputs import ChosenTracker, chosen_trackers, files_for, listed, scenario_of
from twin.run.out_folder import OutFolder, out_folder, taken_back_on_failure
from twin.run.outcome import (
    RunResult,
    early_warnings,
    evaluate_trackers,
    frames_of_tracks,
    other_frame_warnings,
    prior_notes,
    simplifications,
    tracker_notes,
    tracker_warnings,
    versions,
    with_failures_shown,
    write_results,
)
from twin.run.tracker_runner import file_name
from twin.scenario import Scenario
from twin.scenario.load import override_texts
from twin.world.empty_room import empty_room
from twin.world.world import heap_trimmed

_RATE_PROBE = 20
_OF_THE_RUN = ("recording.mcap", *TRUTH_FILES, "scenario.yaml")
"""Files of a run in the folder, which a replay into it keeps."""
_EXTRA_FILES = ("metrics.json", "preview.mp4", ABOUT)


def track_recording(
    recording: AnyPath,
    *,
    trackers: Sequence[str],
    rig_path: AnyPath | None = None,
    truth_path: AnyPath | None = None,
    changes: Sequence[str] = (),
    seed: int | None = None,
    out: AnyPath | None = None,
    video: bool = True,
    report: bool = True,
    bag_copy: AnyPath | None = None,
    on_progress: OnProgress = no_progress,
    on_warning: OnWarning = warn,
) -> RunResult:
    """Track a recording into `out`: tracks, report, and metrics where there is truth.

    The default folder is out/<its name>, for the twin's out/<its run>-tracked. `truth_path`: a table of truth (t, id, x, y
    suffice; t from the start or as stamped), taken instead of the bag's. `changes`: overrides like
    'trackers.NAME.field=value' and 'prior.environment=FILE'; `seed`: of trackers that draw at random (default: that of
    the run that wrote the bag, else 0); `report`: whether to write one; `bag_copy`: where to write a copy
    of the recording that holds the tracks too. A class (`module:Class`) is taken from `trackers` and `changes`, never from
    the bag. Raises InputError for bad input, before anything is written, and PlugInError when every tracker has failed;
    where others are left, the result says which did.
    """
    names, changes = listed(trackers), override_texts(changes, "changes")
    if not names:
        raise InputError("trackers: none is named; a list of names, as ['sort'], is expected")
    recording, out = as_path(recording, "recording"), _path(out, "out")
    rig_path, truth_path = _path(rig_path, "rig_path"), _path(truth_path, "truth_path")
    bag_copy = _path(bag_copy, "bag_copy")
    bag = Recording(recording, rig_path)
    truth = read_own_truth(truth_path, bag) if truth_path is not None else None
    scenario = scenario_of(bag)
    chosen = chosen_trackers(bag, scenario, names, changes)
    files, missing = files_for(bag, scenario, rig_path, changes)
    if bag_copy is not None:
        check_copy(recording, bag_copy)
    seed = seed if seed is not None else scenario.seed if scenario is not None else 0
    folder = out if out is not None else _default_folder(recording, bag)
    replay = _Replay(
        bag=bag,
        rig_path=rig_path,
        scenario=scenario,
        chosen=chosen,
        prior_files=files,
        missing=missing,
        seed=seed,
        own_truth=truth,
        video=video,
        report=report,
        bag_copy=bag_copy,
        command=_command(recording, names, rig_path, truth_path, changes, seed),
        on_progress=on_progress,
        on_warning=on_warning,
    )
    files_made = [*(f"tracks/{file_name(name)}.csv" for name in names), "report.html", *_EXTRA_FILES]
    with heap_trimmed(), out_folder(folder, files_made) as out_:
        replay.read()
        with taken_back_on_failure(out_), replay.opened_feed(out_.path) as fed:
            replay.track(fed)
            out_.announce()
        return with_failures_shown(replay.finish(fed, out_), on_warning)


def _path(given: AnyPath | None, name: str) -> Path | None:
    return None if given is None else as_path(given, name)


@dataclass(eq=False)
class _Replay:
    """One replay of a recording: arguments of `track_recording`, resolved; its truth, once read, and the results so far.

    missing: warnings about files named only by the bag; own_truth: the user's, instead of the bag's.
    """

    bag: Recording
    rig_path: Path | None
    scenario: Scenario | None
    chosen: Sequence[ChosenTracker]
    prior_files: PriorFiles
    missing: Sequence[str]
    seed: int
    own_truth: TruthTable | None
    video: bool
    report: bool
    bag_copy: Path | None
    command: str
    on_progress: OnProgress
    on_warning: OnWarning

    def read(self) -> None:
        """Read the truth and the room."""
        bag, scenario = self.bag, self.scenario
        self._title = scenario.name if scenario is not None else bag.path.stem
        self._faults = scenario.faults if scenario is not None else {}
        self._truth = self.own_truth
        self._truth_frames = list(bag.truth() if self.own_truth is None else truth_frames(self.own_truth))
        if self.own_truth is None and self._truth_frames:
            self._truth = truth_table(self._truth_frames, str(bag.path))
        of_the_bag = bag.has_situations and self.own_truth is None
        self._situations = situation_table(bag.situations(), str(bag.path)) if of_the_bag else None
        names = dict(enumerate(scenario.people, start=1)) if scenario else {}
        if self.own_truth is not None and self.own_truth.labels:
            names = dict(self.own_truth.labels)
        outline, glass = plan_of(scenario) if self.report or self.video else ([], [])
        self._scans = None if outline or not self.report else ScanDensity(bag.rig)
        self._site = Site(bag.rig, outline, names, glass=glass)
        self._frames: list[tuple[str, TrackFrame]] = []

    def opened_feed(self, folder: Path) -> AbstractContextManager[Feed]:
        """Make the trackers and the preview; see `twin.run.feed.open_feed`."""
        bag = self.bag
        return open_feed(
            folder,
            self._site,
            Prior.read(bag.background, self.prior_files, bag.rig),
            self.chosen,
            self.seed,
            video_hz=_rate_hz(bag) if self.video else None,
            title=self._title,
            jumps_ns=bag.jumps_ns,
            stills=self.report,
        )

    def track(self, fed: Feed) -> None:
        """Feed all observations, and the truth up to each; note losses and warnings."""
        bag, scans = self.bag, self._scans
        if self.bag_copy is not None:
            fed.on_frame = lambda name, frame: self._frames.append((name, frame))
        self._early = [*self.missing, *lines(bag.losses), *bag.moving, *early_warnings(fed.runners, self._faults)]
        for warning in self._early:
            self.on_warning(warning)
        waiting = deque(self._truth_frames)
        start = time.perf_counter()
        in_a_row = 1 if bag.rig.cameras() else IN_A_ROW  # pictures are large
        for observation in _counted(bag.observations(), bag.observation_count, in_a_row, self.on_progress):
            if isinstance(observation, LaserScan) and scans is not None:
                scans.add(observation)
            if isinstance(observation, Odometry) and scans is not None:
                scans.move(observation)
            while fed.preview is not None and waiting and waiting[0].stamp_ns <= observation.stamp_ns:
                fed.preview.add_truth(waiting.popleft())
            fed.observe(observation)
        fed.finish()
        anybody = None if self._truth is None else bool(self._truth.id.size)
        self._tracker_warnings = tracker_warnings(fed.runners, anybody)
        self._losses = [*bag.losses, *fed.losses(bag.ahead_s)]
        self._unfit = fed.unfit_scanners(are_moving=bool(bag.moving))
        found = (*lines(self._losses), *self._unfit, *self._tracker_warnings)
        self._new = [each for each in found if each not in self._early]
        for each in self._new:
            self.on_warning(each)
        self._spent_s = time.perf_counter() - start

    def finish(self, fed: Feed, out: OutFolder) -> RunResult:
        """Evaluate and write metrics, report and the bag's copy; return the result."""
        folder = out.path
        placed = frames_of_tracks(self.bag, fed.runners)
        self._frame_of = {name: each.text for name, each in placed.items()}
        facts = self._facts(fed)
        results, refused = evaluate_trackers(folder, fed.runners, self._truth, self._situations)
        self._write_about(folder / ABOUT)
        result = write_results(
            folder,
            facts,
            results,
            fed,
            self._truth,
            self._site,
            refused=refused,
            losses=self._losses,
            report=self.report,
            scans=self._scans,
            recording=self.bag.path,
        )
        elsewhere = other_frame_warnings(self.bag.rig, results) if self.own_truth is not None else []
        result = replace(result, frames=self._frame_of, warnings=(*result.warnings, *elsewhere))
        for note in result.warnings:
            self.on_warning(note)
        left = result.files | {"about": folder / ABOUT}
        for each in out.finish(list(left.values()), kept=_OF_THE_RUN):
            self.on_warning(each)
        if self.bag_copy is not None:
            names = [each.name for each in fed.runners if not each.failure]
            frames = [(name, frame) for name, frame in self._frames if name in names]
            # the user's truth at the stamps of the sensors, as a twin's bag has it
            own = (
                None
                if self.own_truth is None
                else truth_at(self.own_truth, self.bag.all_stamps_ns(), self.bag.stamps_of(self.bag.rig.main_sensor))
            )
            frame_ids = {name: each.frame_id for name, each in placed.items()}
            copy_with_tracks(self.bag, self.bag_copy, names, frames, self.on_warning, truth=own, frame_ids=frame_ids)
            left = left | {"bag": self.bag_copy}
        warnings = (*self._early, *self._new, *result.warnings)
        return replace(result, files=left, warnings=warnings, tracker_warnings=tuple(self._tracker_warnings))

    def _facts(self, fed: Feed) -> RunFacts:
        bag, scenario = self.bag, self.scenario
        duration_s = scenario.duration_s if scenario is not None else bag.duration_s
        start = "" if bag.is_twin else f"; t = 0 is the stamp {bag.start_ns} ns"
        return RunFacts(
            title=self._title,
            description=f"recorded in {bag.path.name}{start}",
            seed=self.seed,
            duration_s=duration_s,
            realtime_factor=duration_s / self._spent_s,
            versions=versions(None),
            sensors={name: {"frames": count, "ms_mean": None} for name, count in bag.counts.items()},
            command=self.command,
            start_stamp_ns=bag.start_ns,
            notes=(
                *prior_notes(self.prior_files),
                *(f"{each}." for each in (*lines(self._losses), *bag.moving, *self._unfit)),
                *tracker_notes(fed.runners, self._faults),
                *(
                    f"Tracks of {name} are in the frame {frame}."
                    for name, frame in self._frame_of.items()
                    if not bag.is_twin
                ),
                *(simplifications(scenario) if bag.is_twin else ()),
            ),
        )

    def _write_about(self, path: Path) -> None:
        """Write `recording.json`."""
        bag, losses = self.bag, documents(self._losses)
        rig = None if self.rig_path is None else bag.rig.model_dump(mode="json", exclude_none=True)
        about = {"recording": str(bag.path.absolute()), "start_stamp_ns": bag.start_ns, "rig": rig, "losses": losses}
        about["frames"] = self._frame_of
        if self._truth is not None and self._truth.labels:
            about["people"] = {str(number): label for number, label in self._truth.labels.items()}
        write_atomic(path, json.dumps(about, indent=2, allow_nan=False) + "\n")


def _default_folder(recording: Path, bag: Recording) -> Path:
    """Return the default folder, named after the run's folder, since every run's bag is recording.mcap."""
    name = f"{recording.resolve().parent.name}-tracked" if bag.is_twin else recording.stem
    return Path("out") / name


def plan_of(scenario: Scenario | None) -> tuple[list[Polygon], list[Polygon]]:
    """Return the plan of the room of a twin's bag: convex outlines (k, 2) [m], and those of glass among them.

    Both empty if the room is not on this machine.
    """
    if scenario is None:
        return [], []
    try:
        room = empty_room(scenario)
    except InputError:
        return [], []
    return room.outline, room.glass


def _rate_hz(bag: Recording) -> float:
    """Estimate the main sensor's rate [Hz] from its first few observations; 10 if impossible."""
    main = (each.stamp_ns for each in bag.observations() if each.sensor == bag.rig.main_sensor)
    stamps = list(islice(main, _RATE_PROBE))
    gaps_ns = [later - earlier for earlier, later in pairwise(stamps) if later > earlier]
    return float(NS_PER_S / np.median(gaps_ns)) if gaps_ns else 10.0


def _counted(bag: Iterable[Observation], total: int, in_a_row: int, on_progress: OnProgress) -> Iterator[Observation]:
    """Yield the observations of a bag and count them; so many are read `in_a_row`."""
    counted = enumerate(bag, start=1)
    while held := list(islice(counted, in_a_row)):
        for number, observation in held:
            yield observation
            on_progress("tracking", number, total)


def _command(
    recording: Path,
    names: Sequence[str],
    rig_path: Path | None,
    truth_path: Path | None,
    changes: Sequence[str],
    seed: int,
) -> str:
    """Return the command that tracks the recording again."""
    trackers, settings = [("--tracker", name) for name in names], [("--set", change) for change in changes]
    options = (*trackers, ("--rig", rig_path), ("--truth", truth_path), *settings, ("--seed", seed))
    given = [(option, str(value)) for option, value in options if value is not None]
    return shlex.join(["twin", "track", str(recording), *chain.from_iterable(given)])
