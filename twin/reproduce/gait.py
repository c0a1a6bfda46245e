"""Everything `twin reproduce gait` leaves behind: our walkers and runners beside published ones."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from twin.recording.whole_file import whole_file
from twin.reproduce.gait_plots import loads_svg, speeds_svg, stance_svg
from twin.reproduce.gait_published import (
    PERSON_SPEED_M_S,
    PERSON_STATURE_M,
    PERSON_STEPS_APART,
    SOURCES,
    SUBJECT_FILE,
    SUBJECT_MASS_KG,
    read_subject,
)
from twin.reproduce.gait_results import STATURE_M, STATURE_SPREAD_M, GaitRuns, gait_results, simulate_gait
from twin.reproduce.page import source_of, template, text_of
from twin.reproduce.results import Result, write_results


def write_gait(
    folder: Path,
    seeds: range,
    data: Path | None = None,
    on_progress: Callable[[str, float, float], None] | None = None,
) -> tuple[list[Result], dict[str, Path]]:
    """Let one body a seed walk and run; write results, plots and page into `folder`; the results and the files by name.

    `data`: the folder of the recording that is drawn beside them (none: published figures only). Raises InputError for
    a recording that is missing or no recording, and where a file cannot be written.
    """
    subject = None if data is None else read_subject(data)
    paths = {
        "results": folder / "results.json",
        "stance": folder / "stance.svg",
        "loads": folder / "loads.svg",
        "speeds": folder / "speeds.svg",
        "page": folder / "report.html",
    }
    runs = simulate_gait(seeds, subject, on_progress)
    results = gait_results(runs)
    drawn = {"stance": stance_svg(runs), "loads": loads_svg(runs), "speeds": speeds_svg(runs)}
    write_results(paths["results"], results)
    for name, svg in drawn.items():
        with whole_file(paths[name]) as stream:
            stream.write(svg)
    _write_page(paths["page"], runs, results, drawn, data)
    return results, paths


def _write_page(path: Path, runs: GaitRuns, results: list[Result], drawn: dict[str, str], data: Path | None) -> None:
    seeds = runs.seeds
    command = f"twin reproduce gait --seeds {len(seeds)}"
    command += (f" --seed {seeds.start}" if seeds.start else "") + ("" if data is None else f" --data {data}")
    compared = runs.compared
    page = template("gait.html.j2").render(
        n_run=len(seeds),
        seeds=f"{seeds.start} to {seeds[-1]}",
        rows=[(result, *text_of(result)) for result in results],
        apart=None if compared is None else f"{compared.apart:.3f}",
        feet_apart=None if compared is None else f"{compared.feet_apart:.3f}",
        stature=f"{STATURE_M:.2f} ± {STATURE_SPREAD_M:.2f} m",
        person=f"{PERSON_SPEED_M_S:g} m/s, {PERSON_STATURE_M:g} m tall",
        steps_apart=f"{PERSON_STEPS_APART:g}",
        subject_file=SUBJECT_FILE,
        subject_mass=f"{SUBJECT_MASS_KG:g} kg",
        sources=SOURCES,
        command=command,
        **{name: source_of(svg) for name, svg in drawn.items()},
    )
    with whole_file(path) as stream:
        stream.write(page)
