"""Everything `twin reproduce laser-fisheye-imm` leaves behind."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from twin.recording.whole_file import whole_file
from twin.reproduce.figure7 import simulate
from twin.reproduce.page import write_page
from twin.reproduce.plots import errors_svg, walk_svg
from twin.reproduce.results import Result, curves, figure7_results, write_results
from twin.reproduce.walk import maneuvering_walk


def write_reproduction(
    folder: Path, seeds: range, on_progress: Callable[[str, float, float], None] | None = None
) -> tuple[list[Result], dict[str, Path]]:
    """Run figure 7 over the seeds and write results, plots and page into `folder`; the results and the files by name.

    Raises InputError where a file cannot be written.
    """
    paths = {
        "results": folder / "results.json",
        "figure 6": folder / "figure6.svg",
        "figure 7": folder / "figure7.svg",
        "page": folder / "report.html",
    }
    runs = simulate(maneuvering_walk(), seeds, on_progress)
    results, found = figure7_results(runs), curves(runs)
    figure6, figure7 = walk_svg(runs.walk), errors_svg(runs.walk, runs.scans, found)
    command = f"twin reproduce laser-fisheye-imm --seeds {len(seeds)}" + (
        f" --seed {seeds.start}" if seeds.start else ""
    )
    write_results(paths["results"], results)
    for name, svg in (("figure 6", figure6), ("figure 7", figure7)):
        with whole_file(paths[name]) as stream:
            stream.write(svg)
    write_page(paths["page"], runs, results, found, figure6, figure7, command)
    return results, paths
