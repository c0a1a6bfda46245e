"""Outcome of a run: metrics.json, the report, and their notes and warnings."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trackers.errors import LimitError
from trackers.rig import Pose, PriorFiles, Rig
from trackers.tracks import background_learned_causally, report_frame, unused_sensors
from trackers.user_input.text_file import check_limit
from twin import version_of
from twin.evaluate import evaluate_with_details
from twin.evaluate.summary import MOST_PAIRS, PAIRS, Evaluation
from twin.messages import OnWarning, warn
from twin.recording.atomic_file import write_atomic
from twin.recording.losses import Loss, documents
from twin.recording.ros.topics import ROOM_FRAME
from twin.recording.situation_table import SituationTable
from twin.recording.tables import TruthTable, read_tracks
from twin.report.birdseye import Site
from twin.report.page import RunFacts, TrackerResult, write_report
from twin.report.path_map import Drive, ScanDensity
from twin.run.feed import Feed
from twin.run.tracker_runner import TrackerRunner, file_name
from twin.scenario import Scenario
from twin.sensors.fault_kinds import Fault
from twin.sensors.gl_context import GlInfo

if TYPE_CHECKING:
    from twin.recording.reader import Recording

_RECORDED = {"recording": ".mcap", "truth": ".csv", "scenario": ".yaml"}
"""Files that a run writes before its results."""
_SIMPLIFICATIONS = (
    "People are kinematic: the standing foot is planted and the body follows it, but no forces act on it.",
    "Laser beams are rays: a mixed pixel at an edge is drawn at random, and every surface reflects alike.",
    "Images are rasterised at one instant (several, averaged, with motion blur): {no}no mirror images.",
)

_version = lru_cache(version_of)


def simplifications(scenario: Scenario | None) -> list[str]:
    """List the twin's physical simplifications for a report; scenario None: unknown."""
    has_shadows = scenario is not None and scenario.rendering.shadows
    return [each.format(no="" if has_shadows else "no shadows, ") for each in _SIMPLIFICATIONS]


@dataclass(frozen=True, eq=False)
class RunResult:
    """Result of a run: metrics (None without truth), files by name, warnings.

    tracker_warnings: those of trackers among the warnings; evaluations: of each tracker, with truth; failures: the fault of
    each failed plug-in, and the reason why a tracker's tracks are too many to evaluate; the metrics are those of the others.
    frames: that of each tracker's tracks, of a recording.
    """

    metrics: dict[str, Any] | None
    files: dict[str, Path]
    warnings: tuple[str, ...] = ()
    tracker_warnings: tuple[str, ...] = ()
    failures: tuple[str, ...] = ()
    evaluations: Mapping[str, Evaluation] = field(default_factory=dict)
    frames: Mapping[str, str] = field(default_factory=dict)


def evaluate_trackers(
    folder: Path, runners: Sequence[TrackerRunner], truth: TruthTable | None, situations: SituationTable | None
) -> tuple[list[TrackerResult], list[str]]:
    """Read and evaluate the table of each successful tracker, from `folder/tracks`; without truth, only read it.

    Return the results, and a sentence for each tracker whose tracks are above the limits of an evaluation: it has none.
    """
    results, refused = [], []
    for each in runners:
        if each.failure:
            continue
        try:
            tracks, evaluation = read_tracks(folder / "tracks" / f"{file_name(each.name)}.csv"), None
        except LimitError as error:
            refused.append(not_evaluated(each.name, error))
            continue
        if truth is not None:
            unused = unused_sensors(each.tracker)
            try:
                evaluation = evaluate_with_details(truth, tracks, situations=situations, unused=unused)
            except LimitError as error:
                refused.append(not_evaluated(each.name, error))
        results.append(TrackerResult(each.name, tracks, evaluation, each.ms_per_frame(), _in_a_base(each)))
    return results, refused


def foreseen_refusal(scenario: Scenario, n_frame: int) -> list[str]:
    """Return a warning where the limits forbid the evaluation of a tracker that finds all people in each frame."""
    source = f"scenario {scenario.name}: people: {len(scenario.people)} people in {n_frame} frames"
    try:
        check_limit(n_frame * len(scenario.people) ** 2, MOST_PAIRS, f"{source} make up to", PAIRS)
    except LimitError as error:
        return [f"a tracker that finds everybody will not be evaluated; {error}"]
    return []


def not_evaluated(tracker: str, error: LimitError) -> str:
    """Format the reason why a tracker has tracks and no metrics."""
    return f"{tracker}: is not evaluated; {error}"


def evaluation_notes(results: Sequence[TrackerResult]) -> tuple[str, ...]:
    """Return the notes on the evaluations, each once."""
    return tuple(dict.fromkeys(note for each in results if each.evaluation for note in each.evaluation.notes))


@dataclass(frozen=True)
class FrameOfTracks:
    """Frame in which a tracker's tracks are: as a reader knows it, and the frame_id of their markers in a copy of the bag."""

    text: str
    frame_id: str


def frames_of_tracks(bag: Recording, runners: Sequence[TrackerRunner]) -> dict[str, FrameOfTracks]:
    """Name the frame of each tracker's tracks: the rig's `room`, or, where that is no other, the frame of odometry or scanner.

    A tracker that makes no use of odometry has those of a scanner on a base in the base's frame. Markers are in `room` where
    no transforms name the frame.
    """
    rig, frames = bag.rig, {}
    main, mounted = rig.main_sensor, rig.mounted()
    for each in runners:
        sensor = mounted.get(main, main)
        own = next(iter(sorted(bag.frames.get(sensor, ()))), "").strip("/")
        pose = rig.sensors[sensor].room_from_sensor
        is_at_origin = isinstance(pose, Pose) and not any((*pose.xyz, *pose.rpy))
        if sensor != main and sensor in unused_sensors(each.tracker):
            base = rig.odometry()[sensor].base_frame
            frames[each.name] = FrameOfTracks(f"{base or f'the base of {sensor}'} (which moves)", base or ROOM_FRAME)
        elif named := report_frame(each.tracker):
            if moving := named in rig.sensors:
                named = next(iter(sorted(bag.frames.get(named, ()))), named).strip("/")
            frames[each.name] = FrameOfTracks(
                f"{named} (which moves)" if moving else named, named if moving else ROOM_FRAME
            )
        else:
            in_rig = own if own and is_at_origin and not bag.is_twin else ROOM_FRAME
            frames[each.name] = FrameOfTracks(in_rig, in_rig)
    return frames


def other_frame_warnings(rig: Rig, results: Sequence[TrackerResult]) -> list[str]:
    """Return a warning where tracks that leave in the frame of an odometry are near nobody of the user's truth."""
    if not any(each.evaluation and each.evaluation.is_misplaced for each in results):
        return []
    frames = {
        name: each.frame or "its odometry"
        for name, each in rig.odometry().items()
        if not any(each.room_from_sensor.xyz)
    }
    return [
        f"{name}: tracks leave in the frame of {frame}; for a truth in another frame, as map, `frame: map` of {name} in "
        "rig.yaml, or the pose of its odometry frame there (room_from_sensor), is expected"
        for name, frame in frames.items()
    ]


def with_failures_shown(result: RunResult, on_warning: OnWarning) -> RunResult:
    """Return the result; in a script, whose warnings are Python's, warn of each plug-in that failed. A command prints them."""
    if on_warning is warn:
        for failure in result.failures:
            warn(f"no results of {failure}")
    return result


def write_results(
    folder: Path,
    facts: RunFacts,
    results: Sequence[TrackerResult],
    feed: Feed,
    truth: TruthTable | None,
    site: Site,
    *,
    refused: Sequence[str] = (),
    losses: Sequence[Loss] = (),
    report: bool = True,
    scans: ScanDensity | None = None,
    recording: Path | None = None,
) -> RunResult:
    """Write `report.html`, if requested and not all tracks are too many to be read again, and `metrics.json` if there is truth.

    refused: of trackers whose evaluation the limits forbid; losses: those of the recording and of the trackers; the metrics
    hold all, the notes in `facts` the reported ones. scans: those of a robot's bag; recording: the bag that was tracked, None
    for the run's own.
    """
    done = [each.name for each in feed.runners if not each.failure]
    files = {f"tracks {name}": folder / "tracks" / f"{file_name(name)}.csv" for name in done}
    if feed.is_filmed:
        files["preview"] = folder / "preview.mp4"
    metrics = None
    if truth is not None:
        metrics = _metrics_document(facts, results, losses)
        files["metrics"] = folder / "metrics.json"
        write_atomic(files["metrics"], json.dumps(metrics, indent=2, allow_nan=False) + "\n")
    notes = evaluation_notes(results)
    if report and results:
        files["report"] = folder / "report.html"
        write_report(
            files["report"],
            replace(facts, notes=(*(f"{note}." for note in (*refused, *notes)), *facts.notes)),
            results,
            site,
            truth=truth,
            scans=scans,
            silent=[name for name in site.rig.sensors if name not in feed.log.counts],
            drives=Drive.of(site.true_rig or site.rig, feed.log.drives()),
            links=_links(folder, files, recording),
            pictures=feed.preview.pictures() if feed.preview is not None else None,
        )
    return RunResult(
        metrics,
        files,
        notes,
        failures=(*(each.failure for each in feed.runners if each.failure), *refused),
        evaluations={each.name: each.evaluation for each in results if each.evaluation is not None},
    )


def _links(folder: Path, files: Mapping[str, Path], recording: Path | None) -> dict[str, str]:
    """Return the files of a run by kind, relative to its folder, including those written before its results."""
    beside = {each: folder / f"{each}{suffix}" for each, suffix in _RECORDED.items()}
    before = {name: path for name, path in beside.items() if path.is_file()}
    found = {**before, **({"recording": recording} if recording is not None else {}), **files}
    return {kind: Path(os.path.relpath(path, folder)).as_posix() for kind, path in found.items() if kind != "report"}


def prior_notes(files: PriorFiles) -> list[str]:
    """Format a note on the prior files given to trackers."""
    found = ", ".join(f"{field} from {path}" for field, path in files.paths().items())
    return [f"Prior files of the trackers: {found}."] if found else []


def tracker_warnings(runners: Sequence[TrackerRunner], anybody: bool | None = False) -> list[str]:
    """Return the warnings of each tracker so far; anybody: whether people were there, None: not known."""
    return [f"{each.name}: {warning}" for each in runners for warning in each.warnings(anybody)]


def early_warnings(runners: Sequence[TrackerRunner], faults: Mapping[str, Fault]) -> list[str]:
    """Return the warnings of each tracker, and its unused sensors, whose faults affect no track."""
    found = tracker_warnings(runners)
    for each in runners:
        unused = unused_sensors(each.tracker)
        if not unused:
            continue
        names = {sensor: [name for name, fault in faults.items() if sensor in fault.sensor] for sensor in unused}
        faulty = [f"{sensor} ({', '.join(of)})" for sensor, of in names.items() if of]
        among = f"; among them with a fault, which shows in no track: {', '.join(faulty)}" if faulty else ""
        found.append(f"{each.name}: makes no use of {', '.join(unused)}{among}")
        if in_a_base := _in_a_base(each):
            found.append(f"{each.name}: {in_a_base}")
    return found


def _in_a_base(runner: TrackerRunner) -> str:
    """Return a clause where a tracker takes a scanner to stand that is mounted on a moving base; "" elsewhere."""
    unused = unused_sensors(runner.tracker)
    moved = [sensor for sensor, base in runner.rig.mounted().items() if base in unused and sensor not in unused]
    if not moved:
        return ""
    return (
        f"takes {', '.join(moved)} to stand, mounted on a base that moves: tracks are in the base's frame, in which things that "
        "stand look like people; a tracker that uses odometry is expected"
    )


def tracker_notes(runners: Sequence[TrackerRunner], faults: Mapping[str, Fault]) -> list[str]:
    """Return notes on the trackers: unused sensors, failures, a background learned during the run."""
    notes = [f"{found}." for found in early_warnings(runners, faults)]
    for each in runners:
        if each.failure:
            notes.append(f"A tracker failed and has no results: {each.failure}.")
            continue
        if background_learned_causally(each.tracker):
            notes.append(
                f"{each.name}: sensors without a recording of the empty room; their background was learned from what came."
            )
    return notes


def versions(gl: GlInfo | None) -> dict[str, str | None]:
    """Return the versions of all that a result depends on besides the scenario."""
    # numpy lists the available instruction sets: sin, exp and arctan differ between them.
    simd: Any = np.show_config(mode="dicts")
    return {
        "twin": _version("roomtwin"),
        "mujoco": _version("mujoco"),
        "numpy": _version("numpy"),
        "opencv": _version("opencv-python-headless"),
        "cpu_features": " ".join(simd["SIMD Extensions"].get("found", [])),
        "gl_renderer": gl.renderer if gl else None,
        "gl_version": gl.version if gl else None,
    }


def _metrics_document(facts: RunFacts, results: Sequence[TrackerResult], losses: Sequence[Loss]) -> dict[str, Any]:
    return {
        "scenario": facts.title,
        "seed": facts.seed,
        "duration_s": facts.duration_s,
        "versions": dict(facts.versions),
        "realtime_factor": facts.realtime_factor,
        "sensors": {name: dict(costs) for name, costs in facts.sensors.items()},
        "losses": documents(losses),
        "start_stamp_ns": facts.start_stamp_ns,
        "trackers": {
            each.name: each.evaluation.metrics | {"ms_per_frame": dict(each.ms_per_frame)}
            for each in results
            if each.evaluation is not None
        },
    }
