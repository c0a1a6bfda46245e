"""`twin run` and `twin render`: a scenario from its first scan to its report."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.presets import make_tracker
from trackers.prior import Prior
from trackers.rig import NO_PRIOR, Rig
from trackers.text_file import AnyPath
from twin.progress import OnProgress, OnWarning
from twin.recording.atomic_file import open_atomic
from twin.recording.detail_tables import DETAIL_FILES, detail_writer
from twin.recording.feet_table import feet_writer, write_names
from twin.recording.losses import lines
from twin.recording.situation_table import read_situations
from twin.recording.tables import read_truth, truth_writer
from twin.recording.track_topics import TrackTopics
from twin.recording.writer import BagWriter
from twin.report.page import RunFacts
from twin.room.building import room_outline
from twin.run.chosen_trackers import NONE_TRUSTED, ChosenTracker, TrustedClasses, choose
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
from twin.run.prior import notes_of
from twin.run.tracker_at_work import file_name
from twin.scenario import Scenario
from twin.scenario.load import dump_scenario
from twin.scenario.model import conditions_of
from twin.streams import stream
from twin.truth.frames import TruthDetail, TruthFrame
from twin.world.heap import heap_trimmed
from twin.world.precomputed import PrecomputedScene
from twin.world.simulation import Simulation

DEFAULT_TRACKER = "laser-fisheye-imm"


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
    on_progress: OnProgress = lambda what, done, total: None,
    on_warning: OnWarning = lambda warning: None,
) -> RunResult:
    """Simulate, record, track, evaluate and report into `out` (default out/<scenario>-<seed>).

    `trackers`: names; None: those the scenario defines, else the default where the rig has what it needs (a warning says
    where it has not); empty: none, and so no metrics and no report. `trusted`: classes that the scenario may name.
    `precomputed`: its people, moved before. `source`: what errors about its trackers call it, its file; default: by its name.
    Every file appears under its name when it is whole. Raises InputError for bad input, before anything is written, and
    PlugInError when every tracker has failed; where others are left, the result says which did.
    """
    names = list(trackers) if trackers is not None else list(scenario.trackers) or [DEFAULT_TRACKER]
    folder = Path(out) if out is not None else Path("out") / f"{scenario.name}-{scenario.seed}"
    source = source or f"scenario {scenario.name}"
    chosen = choose(names, scenario.trackers, source, trusted)
    if chosen:
        scenario.prior.check(source)
    is_default = trackers is None and not scenario.trackers
    with heap_trimmed(), out_folder(folder, _names(names, video)) as out_:
        return _run(scenario, chosen, is_default, out_, video, images, precomputed, on_progress, on_warning)


def _run(
    scenario: Scenario,
    chosen: Sequence[ChosenTracker],
    is_default: bool,
    out: OutFolder,
    video: bool,
    images: bool,
    precomputed: PrecomputedScene | None,
    on_progress: OnProgress,
    on_warning: OnWarning,
) -> RunResult:
    folder, resolved = out.path, dump_scenario(scenario)
    listeners: list[Callable[[TruthFrame], object]] = []
    detail_listeners: list[Callable[[TruthDetail], object]] = []

    def tell(frame: TruthFrame) -> None:
        for listen in listeners:
            listen(frame)

    def tell_detail(detail: TruthDetail) -> None:
        for listen in detail_listeners:
            listen(detail)

    with ExitStack() as stack:
        simulation = stack.enter_context(
            Simulation(scenario, images=images, on_truth=tell, on_detail=tell_detail, precomputed=precomputed)
        )
        scene, rig, warnings = simulation.world.scene, simulation.rig, simulation.warnings
        background = list(simulation.background_messages())
        handed = scenario.prior if chosen else NO_PRIOR
        prior = Prior.read(map(simulation.as_read, background), handed, rig)
        if is_default and (reason := _unfit(rig, prior, scenario.seed)):
            chosen, warnings = [], (*warnings, reason)
        place = Place(
            rig,
            room_outline(scene.model, simulation.world.data),
            {number: name for name, number in scene.ids.items()},
            true_rig=simulation.true_rig,
        )
        fed = stack.enter_context(
            feed(
                folder,
                rig,
                prior,
                chosen,
                scenario.seed,
                video_hz=scenario.sensors[rig.main_sensor].rate_hz if video else None,
                title=f"{scenario.name}, seed {scenario.seed}",
                outline=place.outline,
                person_names=place.person_names,
                true_rig=place.true_rig,
            )
        )
        told = (*warnings, *left_alone(fed.at_work, scenario.faults))
        for warning in told:
            on_warning(warning)
        bag = stack.enter_context(
            BagWriter(folder / "recording.mcap", rig, scenario_yaml=resolved, names=place.person_names)
        )
        fed.on_frame = TrackTopics(bag, [each.name for each in chosen]).write
        table = stack.enter_context(truth_writer(folder / "truth.csv", list(simulation.views)))
        feet = stack.enter_context(feet_writer(folder / "truth_feet.csv", list(rig.floors())))
        listeners += [table.write, feet.write, bag.truth]
        detail_listeners += [stack.enter_context(detail_writer(folder)), bag.detail]
        if fed.shown is not None:
            listeners.append(fed.shown.tell)
        for encoded in background:
            bag.background(encoded)
        gl = simulation.gl_info()

        start = time.perf_counter()
        for delivered in simulation.deliveries():
            bag.observation(delivered.encoded, delivered.arrival_ns)
            fed.observe(delivered.observation)
            on_progress("simulating and tracking", delivered.arrival_ns / NS_PER_S, scenario.duration_s)
        fed.finish()
        doubts = doubts_of(fed.at_work)
        losses = [*fed.heard.missing(), *fed.losses()]
        late = simulation.late()
        new = [each for each in (*late, *lines(losses), *doubts) if each not in told]  # that came on the way
        for each in new:
            on_warning(each)
        spent_s = time.perf_counter() - start
        out.announce()

    files = {
        "recording": folder / "recording.mcap",
        "truth": folder / "truth.csv",
        "truth_people": folder / "truth_people.csv",
        "truth_feet": folder / "truth_feet.csv",
        **{Path(name).stem: folder / name for name in DETAIL_FILES},
        "scenario": folder / "scenario.yaml",
    }
    write_names(files["truth_people"], place.person_names or {})
    with open_atomic(files["scenario"]) as stream:
        stream.write(resolved)
    if fed.shown is not None:
        files["preview"] = folder / "preview.mp4"
    result = RunResult(None, {})
    if chosen:
        on_progress("evaluating and reporting", 0, 1)
        truth, situations = read_truth(files["truth"]), read_situations(files["truth_situations"])
        facts = RunFacts(
            title=scenario.name,
            description=scenario.description,
            seed=scenario.seed,
            duration_s=scenario.duration_s,
            realtime_factor=scenario.duration_s / spent_s,
            versions=versions(gl),
            sensors=simulation.sensor_costs(),
            command=_command(folder, chosen, images),
            notes=(
                *conditions_of(scenario),
                *(f"{each}." for each in (*warnings, *late, *lines(losses))),
                *notes_of(handed),
                *tracker_notes(fed.at_work, scenario.faults),
                *simplifications(scenario),
            ),
        )
        results = evaluate_trackers(folder, fed.at_work, truth, situations)
        result = write_results(folder, facts, results, fed, truth, place, losses=losses)
        for note in result.warnings:
            on_warning(note)
        on_progress("evaluating and reporting", 1, 1)
    files |= result.files
    out.finish(list(files.values()))
    return replace(result, files=files, warnings=(*told, *new, *result.warnings), doubts=tuple(doubts))


def _unfit(rig: Rig, prior: Prior, seed: int) -> str:
    """Why the default tracker cannot work on this rig, as a warning; empty where it can."""
    try:
        make_tracker(DEFAULT_TRACKER, rig, prior, stream(seed, "tracker", DEFAULT_TRACKER))
    except InputError as error:
        return f"recorded without a tracker: none is named, and the default, {DEFAULT_TRACKER}, does not fit: {error}"
    return ""


def _names(trackers: Sequence[str], video: bool) -> list[str]:
    """What a run writes into its folder."""
    truth = ["truth.csv", "truth_people.csv", "truth_feet.csv", *DETAIL_FILES]
    names = ["recording.mcap", *truth, "scenario.yaml", *(["preview.mp4"] if video else [])]
    tables = [f"tracks/{file_name(name)}.csv" for name in trackers]
    return [*names, *tables, *(["metrics.json", "report.html"] if trackers else [])]


def _command(folder: Path, chosen: Sequence[ChosenTracker], images: bool) -> str:
    """The line that runs the resolved scenario again, with every class of somebody's own in it."""
    parts = ["twin", "run", str(folder / "scenario.yaml")]
    for each in chosen:
        parts += ["--tracker", each.name]
        if ":" in each.target and each.target != each.name:
            parts += ["--set", f"trackers.{each.name}.preset={each.target}"]
    return shlex.join([*parts, *([] if images else ["--no-images"])])
