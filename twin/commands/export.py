"""`twin export`: recordings in other formats."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from twin import models
from twin.messages import OnWarning
from twin.options import NoLimits, Rig

if TYPE_CHECKING:
    from twin.export.pictures import Recorded

Format = Literal["mot", "kitti", "coco", "images", "rerun", "foxglove"]


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
        typer.Option(
            metavar="HZ",
            help="Labelled pictures of each camera per second (mot, coco), by simulating again; default: those with boxes, "
            "with --truth all.",
        ),
    ] = None,
    no_limits: NoLimits = False,
) -> None:
    """Write recordings in other people's formats: MOTChallenge, KITTI tracking, COCO, pictures, rerun, Foxglove."""
    from trackers.errors import InputError
    from twin.console import print_paths, print_warning
    from twin.export.coco import export_coco
    from twin.export.foxglove import export_foxglove
    from twin.export.kitti import export_kitti
    from twin.export.mot import export_mot
    from twin.export.pictures import export_images
    from twin.export.rerun_file import export_rerun
    from twin.run.out_folder import whole_folder

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
    with ExitStack() as stack:
        name, recordings = _recordings(stack, source, rig, truth, print_warning)
        folder = out if out is not None else Path("out") / f"{name}-{format_}"
        with whole_folder(folder) as partial:
            match format_:
                case "mot":
                    export_mot(recordings, partial, hz=labels_hz)
                case "kitti":
                    export_kitti(recordings, partial)
                case "coco":
                    export_coco(recordings, partial, simulate=labels == "simulation", hz=labels_hz)
                case "images":
                    export_images(recordings, partial)
                case "rerun":
                    export_rerun(recordings, partial)
                case "foxglove":
                    export_foxglove(recordings, partial)
    print_paths({format_: folder})


def _recordings(
    stack: ExitStack, source: str, rig: Path | None, truth: Path | None, on_warning: OnWarning
) -> tuple[str, list[Recorded]]:
    """Open the recordings of the source and return its name; a suite's stay in the cache while `stack` is open."""
    from trackers.errors import InputError
    from twin.export.pictures import open_recorded

    path = Path(source)
    is_results = (path / "results.sqlite").is_file()
    if path.exists() and path.suffix not in (".yaml", ".yml") and not is_results:
        found = open_recorded(path, rig, on_warning, truth=truth)
        return found.name, [found]
    if truth is not None:
        raise InputError(f"--truth {truth}: is of one recording; a run or a bag is expected, and {source} is neither")
    from twin.suites.cache import RecordingCache, cache_limit_bytes
    from twin.suites.expansion import expand
    from twin.suites.spec import load_suite
    from twin.suites.store_files import read_store
    from twin.suites.worker import suite_recordings

    facts = read_store(path).facts() if is_results else {"suite": source, "changes": []}
    suite, file = load_suite(facts["suite"])
    cases = expand(suite, file, facts["changes"], plug_ins=False)
    cache = RecordingCache(models.cache_folder(), cache_limit_bytes())
    recordings = suite_recordings(stack, cases, path if is_results else None, cache, on_warning)
    return suite.name, [
        open_recorded(each.bag, rig, on_warning, name=each.name, tables=each.tracks) for each in recordings
    ]
