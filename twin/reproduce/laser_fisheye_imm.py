"""Everything `twin reproduce laser-fisheye-imm` leaves behind."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from trackers.errors import InputError
from twin.recording.whole_file import whole_file
from twin.reproduce.figure7 import MonteCarlo, simulate
from twin.reproduce.figure9 import figure9_svg
from twin.reproduce.lab_conditions import LabRuns
from twin.reproduce.lab_page import lab_content
from twin.reproduce.lab_plots import conditions_svg, densities_svg, table_one_svg
from twin.reproduce.lab_runs import check_suite, read_lab, with_seeds
from twin.reproduce.lab_strips import Strip, chosen_moments, draw_strips, write_moments, write_runs, write_strips
from twin.reproduce.page import figure7_content, write_page
from twin.reproduce.plots import errors_svg, walk_svg
from twin.reproduce.results import Result, curves, figure7_results, write_results
from twin.reproduce.table_one import lab_results
from twin.reproduce.walk import maneuvering_walk
from twin.suites.cache import RecordingCache, cache_folder, cache_limit_bytes
from twin.suites.description import load_suite
from twin.suites.run import Place, Watcher, run_suite
from twin.suites.tasks import State

OnProgress = Callable[[str, float, float], None]

SUITE = "laser-fisheye-imm"
"""The shipped suite of the conditions."""
N_SEED, N_RUN = 10, 100
CASES = "suite"
"""The folder of the suite's results within the reproduction's."""


@dataclass(frozen=True)
class Asked:
    """What to reproduce: twin runs of each condition, one a seed; Monte-Carlo runs of figure 7; and where it runs.

    suite: name or path of the conditions; resume: do the rest of an interrupted reproduction.
    """

    seed: int = 0
    n_seed: int = N_SEED
    n_run: int = N_RUN
    suite: str = SUITE
    jobs: int | None = None
    resume: bool = False

    @property
    def command(self) -> str:
        """How to get the same again."""
        parts = ["twin reproduce laser-fisheye-imm", f"--seeds {self.n_seed}", f"--runs {self.n_run}"]
        parts += [f"--seed {self.seed}"] if self.seed else []
        parts += [f"--suite {shlex.quote(self.suite)}"] if self.suite != SUITE else []
        return " ".join(parts)


def write_reproduction(
    folder: Path, asked: Asked, on_progress: OnProgress | None = None
) -> tuple[list[Result], dict[str, Path]]:
    """Run figure 7 and the suite and write results, plots, strips and page into `folder`; the results and the files.

    Raises InputError for a suite that cannot be, for a folder that holds another reproduction's runs (or the same one's,
    without `resume`), for conditions with fewer than two whole runs, and where a file cannot be written.
    """
    suite, path = load_suite(asked.suite)
    suite = with_seeds(suite, range(asked.seed, asked.seed + asked.n_seed))
    check_suite(suite, path)
    try:
        (folder / CASES).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"--out {folder}: cannot be written ({error.strerror}); a writable folder is needed"
        ) from error
    cache = RecordingCache(cache_folder(), cache_limit_bytes())
    place = Place(asked.jobs)
    watcher = Watcher(failed=_tell_failure, state=lambda now: _tell(now, on_progress))
    run_suite(suite, path, folder / CASES, cache, place, resume=asked.resume, watcher=watcher)
    lab = read_lab(suite, path, folder / CASES, cache)
    runs = simulate(maneuvering_walk(), range(asked.seed, asked.seed + asked.n_run), on_progress)
    strips = draw_strips(
        chosen_moments(lab), CASES, cache, place, on_progress, lambda what: _tell_failure("strip", what)
    )
    return write_all(folder, runs, lab, strips, asked.command)


def write_all(
    folder: Path, runs: MonteCarlo, lab: LabRuns, strips: list[Strip], command: str
) -> tuple[list[Result], dict[str, Path]]:
    """Write what was found: results, tables of runs and moments, plots, strips, page. Raises InputError as files do."""
    found = curves(runs)
    results = [*figure7_results(runs), *lab_results(lab)]
    drawn = {
        "figure6": walk_svg(runs.walk),
        "figure7": errors_svg(runs.walk, runs.scans, found),
        "figure9": figure9_svg(lab.first, lab.area),
        "table1": table_one_svg(lab.papers),
    }
    if len(lab.densities) > 1:
        drawn["densities"] = densities_svg(lab.densities, lab.area_m2)
    if lab.others:
        drawn["conditions"] = conditions_svg([lab.papers, *lab.others])
    paths = {"results": folder / "results.json", "runs": folder / "runs.csv", "moments": folder / "moments.csv"}
    paths |= {name: folder / f"{name}.svg" for name in drawn} | {"page": folder / "report.html"}
    write_results(paths["results"], results)
    write_runs(paths["runs"], lab)
    write_moments(paths["moments"], lab, CASES)
    write_strips(folder / "strips", strips)
    for name, svg in drawn.items():
        with whole_file(paths[name]) as stream:
            stream.write(svg)
    write_page(
        paths["page"],
        results=results,
        command=command,
        drawn=drawn,
        figure7=figure7_content(runs, found),
        lab=lab_content(lab, strips),
    )
    return results, paths


def _tell(now: State, on_progress: OnProgress | None) -> None:
    if on_progress is not None:
        on_progress("twin runs", now.done + now.failed, now.waiting + now.running + now.done + now.failed)


def _tell_failure(case_id: str, error: str) -> None:
    sys.stderr.write(f"twin: warning: {case_id} failed: {error.splitlines()[0] if error else ''}\n")
