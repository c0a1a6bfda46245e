"""Commands on recordings: `twin track`, `twin detections`, `twin evaluate` and `twin export`.

They run trackers or their detectors, compare two tables, and write other formats.
"""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from trackers.errors import InputError, valid_names
from twin import models
from twin.command_options import Environment, NoLimits, NoVideo, Rig, Seed, Set, Trackers, number, overrides
from twin.commands.memory import exit_with_failures, loading
from twin.messages import OnWarning, printable

if TYPE_CHECKING:
    from twin.export.pictures import Recorded
    from twin.suites.expansion import Case

Format = Literal["mot", "kitti", "coco", "images", "rerun", "foxglove"]


def track(
    recording: Annotated[
        Path, typer.Argument(help="A bag: the twin's recording.mcap, or a robot's ROS 1 or ROS 2 bag.")
    ],
    tracker: Trackers = None,
    rig: Rig = None,
    set_: Set = None,
    environment: Environment = None,
    seed: Seed = None,
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv", help="Table of truth (t,id,x,y suffice) to evaluate against; default: the bag's."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default: out/<recording's name>.")] = None,
    no_video: NoVideo = False,
    bag: Annotated[
        Path | None, typer.Option(metavar="FILE.mcap", help="Write a copy of the recording with the tracks in it.")
    ] = None,
    no_limits: NoLimits = False,
) -> None:
    """Track a recording: the twin's or a robot's."""
    with loading():
        from twin.console import print_metrics, print_paths, print_warning, progress
        from twin.evaluate.judged_frames import describe_judged
        from twin.run.inputs import import_from_here, typed_classes, unused_changes
        from twin.run.replay import track_recording

    import_from_here([*typed_classes(set_ or []), *(tracker or [])])
    tracker = tracker or ["laser-fisheye-imm"]
    for warning in unused_changes(set_ or [], tracker):
        print_warning(warning)
    with progress() as report:
        result = track_recording(
            recording,
            trackers=tracker,
            rig_path=rig,
            truth_path=truth,
            changes=overrides(set_, environment=environment),
            seed=seed,
            out=out,
            video=not no_video,
            bag_copy=bag,
            on_progress=report,
            on_warning=print_warning,
        )
    if result.metrics is not None:
        print_metrics(result.metrics)
    if truth is not None:
        for name, evaluation in result.evaluations.items():
            judged = describe_judged(evaluation.stamps_ns, evaluation.metrics["judged"]["frames_total"])
            sys.stderr.write(f"twin: {name}: {judged}\n")
    print_paths({**result.files, **{f"frame {name}": frame for name, frame in result.frames.items()}})
    exit_with_failures(result.failures)


def detections(
    recording: Annotated[Path, typer.Argument(help="A bag: the twin's recording.mcap, or a robot's.")],
    tracker: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="Tracker whose detector runs: a preset, one the scenario defines, or module:Class."
        ),
    ] = "sort",
    rig: Rig = None,
    set_: Set = None,
    environment: Environment = None,
    seed: Seed = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Table to write; default: stdout.")] = None,
    no_limits: NoLimits = False,
) -> None:
    """Write the detections of a tracker as CSV: t,sensors,role,x,y,variance,width in the room frame [s, m, m²]."""
    from functools import partial

    from twin.console import print_paths, print_warning
    from twin.run.feed import write_detections
    from twin.run.inputs import import_from_here, typed_classes, unused_changes

    import_from_here([*typed_classes(set_ or []), tracker])
    for warning in unused_changes(set_ or [], [tracker]):
        print_warning(warning)
    write = partial(
        write_detections,
        recording,
        tracker=tracker,
        rig=rig,
        changes=overrides(set_, environment=environment),
        seed=seed,
        on_warning=print_warning,
    )
    if out is None:
        write(sys.stdout)
        return
    from twin.recording.atomic_file import open_atomic

    with open_atomic(out) as file:
        write(file)
    print_paths({"detections": out})


def evaluate(
    truth: Annotated[Path, typer.Argument(help="truth.csv")],
    tracks: Annotated[Path, typer.Argument(help="A tracks table.")],
    situations: Annotated[
        Path | None, typer.Option(metavar="FILE", help="truth_situations.csv of the run, for the disposal of merges.")
    ] = None,
    gate: Annotated[float, number("--gate", "A track matches a person within this distance [m].", metavar="M")] = 0.5,
    frame_rate: Annotated[
        float | None, number("--frame-rate", "Frames a second, for tables that count frames [Hz].", metavar="HZ")
    ] = None,
    format_: Annotated[
        Literal["csv", "mot"],
        typer.Option("--format", help="Tables with t,id,x,y in any order, or MOT text with places on the ground."),
    ] = "csv",
    no_limits: NoLimits = False,
) -> None:
    """Compute metrics from two tables, as JSON."""
    import json
    from dataclasses import replace

    import numpy as np

    from twin.console import print_warning, print_warnings
    from twin.evaluate import evaluate_with_details
    from twin.evaluate.judged_frames import describe_judged
    from twin.evaluate.report_clock import empty_ends
    from twin.recording.situation_table import read_situations
    from twin.recording.tables import read_tracks, read_truth
    from twin.recording.truth_tables import MOST_TABLE_BYTES, on_clock_of_tracks
    from twin.tables.contents import sequence_info, sequence_info_of
    from twin.tables.person_rows import exported_stamps_ns, mot_stamp_ns

    if not 0 < gate < float("inf"):
        raise InputError(f"--gate {gate}: is not a distance; a number of metres above 0 is expected")
    is_mot, n_frame, exported = format_ == "mot", 0, None
    if is_mot:
        info = sequence_info_of(truth) or sequence_info_of(tracks)
        if info is not None:
            rate_hz, n_frame = sequence_info(info)
            exported = exported_stamps_ns(info, n_frame) if frame_rate is None else None
            used = "" if frame_rate in (None, rate_hz) else f"; --frame-rate {frame_rate:g} is used"
            used += "" if exported is None else ", at the times of frames.csv"
            sys.stderr.write(f"twin: {printable(str(info))}: {rate_hz:g} frames a second, {n_frame} frames{used}\n")
            frame_rate = frame_rate if frame_rate is not None else rate_hz
    how = MOST_TABLE_BYTES, frame_rate, "--frame-rate"
    tables = read_truth(truth, *how, mot=is_mot), read_tracks(tracks, *how, mot=is_mot)
    if is_mot:  # a frame without rows is a frame without people
        stamps = np.unique(np.concatenate([each.frame_stamps_ns for each in tables]))
        if n_frame and frame_rate is not None:
            stamps = np.union1d(stamps, [mot_stamp_ns(number, frame_rate) for number in range(1, n_frame + 1)])
        times = exported if exported is not None and exported.size == stamps.size else stamps
        truth_ns, tracks_ns = (times[np.searchsorted(stamps, each.stamps_ns)] for each in tables)
        tables = (
            replace(tables[0], frame_stamps_ns=times, stamps_ns=truth_ns),
            replace(tables[1], frame_stamps_ns=times, stamps_ns=tracks_ns),
        )
    if os.path.samefile(truth, tracks):
        print_warning(f"{truth}: is given as truth and as tracks, and is compared with itself")
    tables = on_clock_of_tracks(tables[0], tables[1], tracks), tables[1]
    pairs = read_situations(situations) if situations is not None else None
    evaluation = evaluate_with_details(*tables, gate_m=gate, situations=pairs)
    print_warnings([*evaluation.notes, *empty_ends(*tables)])
    sys.stderr.write(f"twin: {describe_judged(evaluation.stamps_ns, len(tables[1].frame_stamps_ns))}\n")
    typer.echo(json.dumps(evaluation.metrics, indent=2))


def export(
    source: Annotated[
        str,
        typer.Argument(
            metavar="RUN|BAG|SUITE", help="Folder of a run or of twin track, any bag, or a suite: its name or file."
        ),
    ],
    format_: Annotated[Format, typer.Option("--format", help="Format to write.")],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder to make; default: out/<source>-<format>.")
    ] = None,
    rig: Rig = None,
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv",
            help="Table of truth (t,id,x,y suffice) of a run or bag, instead of the bag's; boxes are those of upright people.",
        ),
    ] = None,
    labels: Annotated[
        Literal["simulation", "bag"],
        typer.Option(
            help="Labels of coco: with masks and 17 keypoints, by simulating again; or what the bag's truth holds."
        ),
    ] = "simulation",
    labels_hz: Annotated[
        float | None,
        number(
            "--labels-hz",
            "Labelled pictures of each camera per second (mot, coco), by simulating again; default: those with boxes, "
            "with --truth all.",
            metavar="HZ",
        ),
    ] = None,
    no_limits: NoLimits = False,
) -> None:
    """Write recordings in other people's formats: MOTChallenge, KITTI tracking, COCO, pictures, rerun, Foxglove."""
    from twin.console import print_paths, print_warning
    from twin.recording.losses import lines
    from twin.run.out_folder import whole_folder

    _check_labels(format_, labels, labels_hz, truth)
    with ExitStack() as stack:
        name, recordings = _recordings(stack, source, rig, truth, print_warning)
        folder = out if out is not None else Path("out") / f"{name}-{format_}"
        with whole_folder(folder) as partial:
            _write_as(format_, recordings, partial, simulate=labels == "simulation", hz=labels_hz)
        for each in recordings:
            for warning in (*lines(each.recording.losses), *each.recording.moving):
                print_warning(f"{each.name}: {warning}" if len(recordings) > 1 else warning)
    print_paths({format_: folder})


def _write_as(format_: Format, recordings: list[Recorded], folder: Path, *, simulate: bool, hz: float | None) -> None:
    """Write recordings in a format; simulate, hz: see --labels and --labels-hz."""
    from twin.export.coco import export_coco
    from twin.export.foxglove import export_foxglove
    from twin.export.kitti import export_kitti
    from twin.export.mot import export_mot
    from twin.export.pictures import export_images
    from twin.export.rerun_file import export_rerun

    match format_:
        case "mot":
            export_mot(recordings, folder, hz=hz)
        case "kitti":
            export_kitti(recordings, folder)
        case "coco":
            export_coco(recordings, folder, simulate=simulate, hz=hz)
        case "images":
            export_images(recordings, folder)
        case "rerun":
            export_rerun(recordings, folder)
        case "foxglove":
            export_foxglove(recordings, folder)


def _check_labels(format_: Format, labels: str, labels_hz: float | None, truth: Path | None) -> None:
    """Raise InputError for options of `twin export` about labels without effect on this format."""
    if labels_hz is not None and not 0 < labels_hz < float("inf"):
        raise InputError(f"--labels-hz {labels_hz}: is no rate; a number of pictures per second above 0 is expected")
    if labels_hz is not None and (labels == "bag" or format_ not in ("mot", "coco")):
        raise InputError("--labels-hz: has no effect here; --format mot or coco without --labels bag is expected")
    if labels == "bag" and format_ != "coco":
        raise InputError(f"--labels bag: has no effect on --format {format_}; --format coco is expected")
    if labels == "bag" and truth is not None:
        raise InputError("--labels bag: is the bag's truth, and --truth another; one of the two is expected")
    if truth is not None and format_ == "images":
        raise InputError("--truth: has no effect on --format images; another format is expected")


def _recordings(
    stack: ExitStack, source: str, rig: Path | None, truth: Path | None, on_warning: OnWarning
) -> tuple[str, list[Recorded]]:
    """Open the recordings of the source and return its name; a suite's stay in the cache while `stack` is open."""
    from twin.export.pictures import open_recorded
    from twin.run.tracker_runner import file_name

    path = Path(source)
    is_results = (path / "results.sqlite").is_file()
    if path.exists() and path.suffix not in (".yaml", ".yml") and not is_results:
        found = open_recorded(path, rig, on_warning, truth=truth)
        return found.name, [found]
    if not path.exists() and source not in models.names("suites"):
        suites = valid_names(source, models.names("suites"), start="suites are")
        raise InputError(f"{source}: is not there; the folder of a run, a bag, or a suite is expected; {suites}")
    if truth is not None:
        raise InputError(f"--truth {truth}: is of one recording; a run or a bag is expected, and {source} is neither")
    from twin.suites.cache import RecordingCache, cache_limit_bytes
    from twin.suites.expansion import expand
    from twin.suites.result_files import read_store
    from twin.suites.spec import load_suite
    from twin.suites.worker import RECORDING, case_recording

    suite_name, changes, held = source, (), None
    if is_results:
        with read_store(path) as store:
            facts, held = store.facts(), {each.id for each in store.cases()}
        own, changes = facts.get("file", ""), facts["changes"]
        suite_name = own if os.path.isfile(own) else facts["suite"]
    suite, file = load_suite(suite_name)
    cases = expand(suite, file, changes, runs=False)
    if held is not None and held != {case.id for case in cases}:
        raise InputError(
            f"{source}: holds the results of other cases than {file} has; the suite as it was run is expected"
        )
    cases_of: dict[str, list[Case]] = {}
    for case in cases:
        cases_of.setdefault(case.resolved, []).append(case)
    cache = RecordingCache(models.cache_folder(), cache_limit_bytes())
    recordings = []
    for case, *others in cases_of.values():
        own_rig, own_truth = rig, None
        if case.bag is not None:
            name, bag, own_rig, own_truth = case.scenario, case.bag.path, rig or case.bag.rig, case.bag.truth
        else:
            name = file_name("-".join(filter(None, (case.scenario, case.variant, str(case.seed)))))
            bag = stack.enter_context(case_recording(case, cache, on_warning)) / RECORDING
        tables = {
            each.tracker: path / "cases" / each.id / "tracks" / f"{file_name(each.tracker)}.csv"
            for each in (case, *others)
            if is_results
        }
        tables = {tracker: table for tracker, table in tables.items() if table.is_file()}
        recordings.append(open_recorded(bag, own_rig, on_warning, name=name, tables=tables, truth=own_truth))
    return suite.name, recordings
