"""`twin run` and `twin render`: a scenario from its first scan to its report."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from trackers.observations import NS_PER_S
from twin.outline import room_outline
from twin.preview import preview
from twin.recording.messages import Encoded
from twin.recording.tables import truth_writer
from twin.recording.whole_file import whole_file
from twin.recording.writer import BagWriter
from twin.report.page import write_report
from twin.results import RunResult, evaluate_folder, metrics_document, remove_earlier, write_json
from twin.scenario import Scenario
from twin.scenario.load import dump_scenario
from twin.simulation import Simulation
from twin.tracking import file_name, trackers_at_work
from twin.truth import TruthFrame

OnProgress = Callable[[str, float, float], None]

DEFAULT_TRACKER = "laser-fisheye-imm"


def run_scenario(
    scenario: Scenario,
    *,
    trackers: Sequence[str] | None = None,
    out: Path | None = None,
    video: bool = True,
    images: bool = True,
    on_progress: OnProgress = lambda what, done, total: None,
) -> RunResult:
    """Simulate, record, track, evaluate and report into `out` (default out/<scenario>-<seed>).

    `trackers`: names; None: those the scenario defines, or the default; empty: none. Every file appears under its
    name when it is whole. Raises InputError for bad input, before anything is written.
    """
    names = list(trackers) if trackers is not None else list(scenario.trackers) or [DEFAULT_TRACKER]
    folder = out if out is not None else Path("out") / f"{scenario.name}-{scenario.seed}"
    told: list[Callable[[TruthFrame], object]] = []

    def on_truth(frame: TruthFrame) -> None:
        for tell in told:
            tell(frame)

    with ExitStack() as stack:
        simulation = stack.enter_context(Simulation(scenario, images=images, on_truth=on_truth))
        person_names = {number: name for name, number in simulation.world.scene.ids.items()}
        outline = room_outline(simulation.world.scene.model, simulation.world.data)
        gl = simulation.gl_info()
        background: list[Encoded] = list(simulation.background_messages())
        observed = [encoded.observation for encoded in background]
        seed = scenario.seed
        at_work = stack.enter_context(
            trackers_at_work(names, scenario.trackers, simulation.rig, observed, seed, folder / "tracks")
        )
        bag = stack.enter_context(
            BagWriter(
                folder / "recording.mcap", simulation.rig, scenario_yaml=dump_scenario(scenario), names=person_names
            )
        )
        for encoded in background:
            bag.background(encoded)
        told += [stack.enter_context(truth_writer(folder / "truth.csv", list(simulation.rig.sensors))).write, bag.truth]
        shown = None
        if video:
            rate_hz = scenario.sensors[simulation.rig.main_sensor].rate_hz
            shown = stack.enter_context(
                preview(
                    folder / "preview.mp4",
                    simulation.rig,
                    fps=rate_hz,
                    tracker=names[0] if names else "",
                    title=f"{scenario.name}, seed {seed}",
                    outline=outline,
                    person_names=person_names,
                )
            )
            told.append(shown.tell)

        start = time.perf_counter()
        for delivered in simulation.deliveries():
            observation = delivered.encoded.observation
            bag.observation(delivered.encoded, delivered.arrival_ns)
            if shown is not None:
                shown.observe(observation)
            for place, each in enumerate(at_work):
                for frame in each.update(observation):
                    if place == 0 and shown is not None:
                        shown.draw(frame)
            if shown is not None and not at_work:
                shown.draw_untracked(observation)
            on_progress("simulating and tracking", delivered.arrival_ns / NS_PER_S, scenario.duration_s)
        for place, each in enumerate(at_work):
            for frame in each.finish():
                if place == 0 and shown is not None:
                    shown.draw(frame)
        spent_s = time.perf_counter() - start
        sensors = simulation.sensor_costs()
        rig = simulation.rig
    with whole_file(folder / "scenario.yaml") as stream:
        stream.write(dump_scenario(scenario))

    on_progress("evaluating and reporting", 0, 1)
    evaluated = evaluate_folder(folder, names)
    metrics = metrics_document(
        scenario=scenario.name,
        seed=seed,
        duration_s=scenario.duration_s,
        gl=gl,
        realtime_factor=scenario.duration_s / spent_s,
        sensors=sensors,
        at_work=at_work,
        evaluations=evaluated.evaluations,
    )
    files = {
        "recording": folder / "recording.mcap",
        "truth": folder / "truth.csv",
        **{f"tracks {name}": folder / "tracks" / f"{file_name(name)}.csv" for name in names},
        "scenario": folder / "scenario.yaml",
    }
    if video:
        files["preview"] = folder / "preview.mp4"
    if names:
        write_json(folder / "metrics.json", metrics)
        files["metrics"] = folder / "metrics.json"
        files["report"] = folder / "report.html"
        write_report(folder / "report.html")
    remove_earlier(folder, list(files.values()))
    on_progress("evaluating and reporting", 1, 1)
    return RunResult(metrics, files)
