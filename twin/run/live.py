"""Run a scenario from its first scan to its report: `twin run` and `twin render`."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from trackers.errors import InputError, LimitError
from trackers.observations import NS_PER_S
from trackers.presets import make_tracker
from trackers.prior import Prior
from trackers.rig import NO_PRIOR, Rig
from trackers.tracks import TrackFrame
from trackers.user_input.text_file import AnyPath, as_path
from twin.messages import OnProgress, OnWarning, no_progress, warn
from twin.recording.atomic_file import write_atomic
from twin.recording.losses import lines
from twin.recording.situation_table import read_situations
from twin.recording.tables import FrameText, read_truth, truth_writer
from twin.recording.track_topics import TrackTopics
from twin.recording.truth_tables import BASES_FILE, DETAIL_FILES, detail_writer, feet_writer, write_names
from twin.recording.writer import BagWriter
from twin.report.birdseye import Site
from twin.report.page import RunFacts
from twin.run.feed import IN_A_ROW, Feed, open_feed
from twin.run.inputs import NONE_TRUSTED, ChosenTracker, TrustedClasses, check_choices, choose, listed
from twin.run.out_folder import OutFolder, out_folder, taken_back_on_failure
from twin.run.outcome import (
    RunResult,
    early_warnings,
    evaluate_trackers,
    foreseen_refusal,
    not_evaluated,
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
from twin.scenario.load import check_scenario, dump_scenario
from twin.scenario.scenario import describe_conditions
from twin.streams import stream
from twin.truth.truth_types import TruthDetail, TruthFrame
from twin.world.empty_room import empty_room
from twin.world.simulation import Delivered, Simulation
from twin.world.world import PrecomputedScene, heap_trimmed

DEFAULT_TRACKER = "laser-fisheye-imm"
_MORE_TRUTH = ("truth_feet.csv", *DETAIL_FILES)

TruthKept = Literal["all", "positions"]
"""Parts of the truth that a run computes and keeps."""


def run_scenario(
    scenario: Scenario,
    *,
    trackers: Sequence[str] | None = None,
    out: AnyPath | None = None,
    video: bool = True,
    images: bool = True,
    trusted: TrustedClasses = NONE_TRUSTED,
    source: str | None = None,
    precomputed: PrecomputedScene | None = None,
    truth: TruthKept = "all",
    on_progress: OnProgress = no_progress,
    on_warning: OnWarning = warn,
    on_note: OnWarning = lambda note: None,
) -> RunResult:
    """Simulate, record, track, evaluate and report into `out` (default out/<scenario>-<seed>).

    `trackers`: names; None: those of the scenario, else the default if the rig suits it (else a warning); empty: none, and
    so no metrics and no report. `trusted`: classes that the scenario may name. `truth`: "positions" keeps only people's
    positions: no visibility, feet, boxes, beams or situations, nor their metrics. `precomputed`: precomputed motion of its
    people. `source`: name of the trackers' file in errors; default: the scenario's name. `on_note`: receives notes on costs
    without effect on results. Every file appears under its name when complete. Raises InputError for bad input, before
    anything is written, and PlugInError when every tracker has failed; with others left, the result names the failed ones.
    """
    check_scenario(scenario)
    check_choices(truth, video=video, images=images)
    names = listed(trackers) if trackers is not None else list(scenario.trackers) or [DEFAULT_TRACKER]
    folder = as_path(out, "out") if out is not None else Path("out") / f"{scenario.name}-{scenario.seed}"
    source = source or scenario.source
    chosen = choose(names, scenario.trackers, source, trusted)
    if chosen:
        scenario.prior.check(source)
    is_default = trackers is None and not scenario.trackers
    with heap_trimmed(), out_folder(folder, _names(names, video)) as out_:
        with taken_back_on_failure(out_), ExitStack() as stack:
            run = _LiveRun(
                scenario, chosen, is_default, video, images, truth == "all", out_, on_progress, on_warning, on_note
            )
            run.open(stack, precomputed)
            run.record()
            out_.announce()
        return with_failures_shown(run.finish(), on_warning)


@dataclass(eq=False)
class _LiveRun:
    """One run of a scenario: arguments of `run_scenario`, resolved; then simulation, trackers, bag and tables, once opened.

    is_default: no tracker was requested, so the default may be left out.
    """

    scenario: Scenario
    chosen: Sequence[ChosenTracker]
    is_default: bool
    video: bool
    images: bool
    whole_truth: bool
    out: OutFolder
    on_progress: OnProgress
    on_warning: OnWarning
    on_note: OnWarning

    def open(self, stack: ExitStack, precomputed: PrecomputedScene | None) -> None:
        """Open the simulation, the trackers, the bag and the tables, until `stack` is closed."""
        self._held: list[TruthFrame | TruthDetail | Delivered] = []
        self._on_truth: list[Callable[[FrameText], object]] = []
        self._on_detail: list[Callable[[TruthDetail], object]] = []
        self._resolved = dump_scenario(self.scenario)
        self._simulation = stack.enter_context(
            Simulation(
                self.scenario,
                images=self.images,
                on_truth=self._hold,
                on_detail=self._hold if self.whole_truth else None,
                precomputed=precomputed,
                shares=self.whole_truth,
                feet=self.whole_truth,
            )
        )
        self._warnings = self._simulation.warnings
        background = list(self._simulation.background_messages())
        self._prior_files = self.scenario.prior if self.chosen else NO_PRIOR
        prior = Prior.read(map(self._simulation.as_read, background), self._prior_files, self._simulation.rig)
        if self.is_default and (reason := _unfit(self._simulation.rig, prior, self.scenario.seed)):
            self.chosen, self._warnings = [], (*self._warnings, reason)
        self._site = self._described_site()
        self._feed = self._opened_feed(stack, prior)
        self._early = (*self._warnings, *early_warnings(self._feed.runners, self.scenario.faults))
        if self.chosen:
            main = self.scenario.sensors[self._simulation.rig.main_sensor]
            self._early += (*foreseen_refusal(self.scenario, round(self.scenario.duration_s * main.rate_hz)),)
        for warning in self._early:
            self.on_warning(warning)
        self._bag = self._opened_bag(stack)
        for encoded in background:
            self._bag.background(encoded)
        self._gl = self._simulation.gl_info()

    def record(self) -> None:
        """Simulate to the end, write the bag and the truth, feed the trackers; note losses and warnings."""
        start = time.perf_counter()
        self._most_held = 1 if self._simulation.rig.cameras() else IN_A_ROW  # pictures are large
        for delivered in self._simulation.deliveries():
            self._hold(delivered)
        self._release()
        self._feed.on_frame = self._write_frame
        self._feed.finish()
        self._tracker_warnings = tracker_warnings(self._feed.runners, bool(self.scenario.people))
        self._losses = [*self._feed.log.missing(), *self._feed.losses()]
        self._late = (*self._simulation.late(), *self._feed.unfit_scanners())
        found = (*self._late, *lines(self._losses), *self._tracker_warnings)
        self._new = [each for each in found if each not in self._early]
        for each in self._new:
            self.on_warning(each)
        self._spent_s = time.perf_counter() - start
        for note in self._simulation.drawing_notes():
            self.on_note(note)

    def _hold(self, each: TruthFrame | TruthDetail | Delivered) -> None:
        self._held.append(each)
        if len(self._held) >= self._most_held:
            self._release()

    def _release(self) -> None:
        """Track what is held, then write it and the tracks in this order: either is cheaper many times in a row."""
        tracked: list[TruthFrame | TruthDetail | Delivered | tuple[str, TrackFrame]] = []
        self._feed.on_frame = lambda name, frame: tracked.append((name, frame))
        for each in self._held:
            tracked.append(each)
            if isinstance(each, Delivered):
                self._feed.observe(each.observation)
            elif isinstance(each, TruthFrame) and self._feed.preview is not None:
                self._feed.preview.add_truth(each)
        self._held.clear()
        for each in tracked:
            match each:
                case Delivered():
                    self._bag.observation(each.encoded, each.arrival_ns)
                    self.on_progress("simulating and tracking", each.arrival_ns / NS_PER_S, self.scenario.duration_s)
                case TruthFrame():
                    text = FrameText(each)
                    for write in self._on_truth:
                        write(text)
                case (name, frame):
                    self._write_frame(name, frame)
                case detail:
                    for listen in self._on_detail:
                        listen(detail)

    def _more_truth(self) -> tuple[str, ...]:
        if not self.whole_truth:
            return ()
        return (*_MORE_TRUTH, BASES_FILE) if self._simulation.rig.odometry() else _MORE_TRUTH

    def finish(self) -> RunResult:
        """Write the remaining files from the closed tables: names, scenario, metrics and report; return the result."""
        folder = self.out.path
        files = {
            "recording": folder / "recording.mcap",
            "truth": folder / "truth.csv",
            "truth_people": folder / "truth_people.csv",
            **{Path(name).stem: folder / name for name in self._more_truth()},
            "scenario": folder / "scenario.yaml",
        }
        write_names(files["truth_people"], self._site.person_names)
        write_atomic(files["scenario"], self._resolved)
        if self._feed.is_filmed:
            files["preview"] = folder / "preview.mp4"
        result = self._evaluated(files) if self.chosen else RunResult(None, {})
        files |= result.files
        for each in self.out.finish(list(files.values())):
            self.on_warning(each)
        warnings = (*self._early, *self._new, *result.warnings)
        return replace(result, files=files, warnings=warnings, tracker_warnings=tuple(self._tracker_warnings))

    def _evaluated(self, files: Mapping[str, Path]) -> RunResult:
        """Evaluate the trackers and write metrics and report."""
        folder = self.out.path
        self.on_progress("evaluating and reporting", 0, 1)
        truth = situations = None
        unread: list[str] = []
        try:
            situations = read_situations(files["truth_situations"]) if self.whole_truth else None
            truth = read_truth(files["truth"])
        except LimitError as error:
            unread = [not_evaluated(each.name, error) for each in self._feed.runners if not each.failure]
        results, refused = evaluate_trackers(folder, self._feed.runners, truth, situations)
        facts = self._facts()
        result = write_results(
            folder, facts, results, self._feed, truth, self._site, refused=unread or refused, losses=self._losses
        )
        for note in result.warnings:
            self.on_warning(note)
        self.on_progress("evaluating and reporting", 1, 1)
        return result

    def _facts(self) -> RunFacts:
        scenario = self.scenario
        return RunFacts(
            title=scenario.name,
            description=scenario.description,
            seed=scenario.seed,
            duration_s=scenario.duration_s,
            realtime_factor=scenario.duration_s / self._spent_s,
            versions=versions(self._gl),
            sensors=self._simulation.sensor_costs(),
            command=self._command(),
            notes=(
                *describe_conditions(scenario),
                *(f"{each}." for each in (*self._warnings, *self._late, *lines(self._losses))),
                *prior_notes(self._prior_files),
                *tracker_notes(self._feed.runners, scenario.faults),
                *simplifications(scenario),
            ),
        )

    def _command(self) -> str:
        """Return the command that repeats the resolved scenario, with every class of the user's in it."""
        parts = ["twin", "run", str(self.out.path / "scenario.yaml")]
        for each in self.chosen:
            parts += ["--tracker", each.name]
            if ":" in each.target and each.target != each.name:
                parts += ["--set", f"trackers.{each.name}.preset={each.target}"]
        kept = [] if self.whole_truth else ["--truth", "positions"]
        return shlex.join([*parts, *([] if self.images else ["--no-images"]), *kept])

    def _described_site(self) -> Site:
        scene = self._simulation.world.scene
        return Site(
            self._simulation.rig,
            empty_room(self.scenario).outline,
            {number: name for name, number in scene.ids.items()},
            true_rig=self._simulation.true_rig,
            glass=empty_room(self.scenario).glass,
        )

    def _opened_feed(self, stack: ExitStack, prior: Prior) -> Feed:
        scenario, rig = self.scenario, self._simulation.rig
        return stack.enter_context(
            open_feed(
                self.out.path,
                self._site,
                prior,
                self.chosen,
                scenario.seed,
                video_hz=scenario.sensors[rig.main_sensor].rate_hz if self.video else None,
                title=f"{scenario.name}, seed {scenario.seed}",
                stills=bool(self.chosen),
            )
        )

    def _opened_bag(self, stack: ExitStack) -> BagWriter:
        """Open the bag and the tables of the truth, and connect tracks and truth to them."""
        folder, rig = self.out.path, self._simulation.rig
        bag = BagWriter(
            folder / "recording.mcap",
            rig,
            scenario_yaml=self._resolved,
            names=self._site.person_names,
            outline=self._site.outline,
            positions_only=not self.whole_truth,
        )
        stack.enter_context(bag)
        self._write_frame = TrackTopics(bag, [each.name for each in self.chosen]).write
        seen_from = list(self._simulation.views) if self.whole_truth else []
        self._on_truth += [stack.enter_context(truth_writer(folder / "truth.csv", seen_from)), bag.truth]
        if self.whole_truth:
            self._on_truth.append(stack.enter_context(feet_writer(folder / "truth_feet.csv", list(rig.floors()))))
            self._on_detail += [stack.enter_context(detail_writer(folder, with_bases=bool(rig.odometry()))), bag.detail]
        return bag


def _unfit(rig: Rig, prior: Prior, seed: int) -> str:
    """Return a warning if the default tracker cannot work on this rig, else an empty text."""
    try:
        make_tracker(DEFAULT_TRACKER, rig, prior, stream(seed, "tracker", DEFAULT_TRACKER))
    except InputError as error:
        return f"recorded without a tracker: none is named, and the default, {DEFAULT_TRACKER}, does not fit: {error}"
    return ""


def _names(trackers: Sequence[str], video: bool) -> list[str]:
    """List the files of a run in its folder."""
    truth = ["truth.csv", "truth_people.csv", *_MORE_TRUTH]
    names = ["recording.mcap", *truth, "scenario.yaml", *(["preview.mp4"] if video else [])]
    tables = [f"tracks/{file_name(name)}.csv" for name in trackers]
    return [*names, *tables, *(["metrics.json", "report.html"] if trackers else [])]
