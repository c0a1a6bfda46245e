"""Reproduction of published gait for `twin reproduce gait`: loads over the stance, and gait against speed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.messages import OnProgress, no_progress
from twin.report.palette import IDENTITY_COLOURS, INK, QUIET, SHADE, hex_colour, plot_style, to_svg
from twin.reproduce.gait.gait_comparison import (
    CONTACT_S,
    DIP,
    HUMPS,
    JOGGING_STEPS_MIN,
    NATURAL_M_S,
    PERSON_SPEED_M_S,
    PERSON_STATURE_M,
    PERSON_STEPS_APART,
    ROLL,
    RUNNING_HUMP,
    RUNS_M_S,
    SOURCES,
    STANCE_S,
    STANCE_SHARE,
    STATURE_M,
    STATURE_SPREAD_M,
    SUBJECT_FILE,
    SUBJECT_MASS_KG,
    SUBJECT_SPEED_M_S,
    SUBJECT_STATURE_M,
    WALKS_M_S,
    GaitRuns,
    gait_results,
    read_subject,
    simulate_gait,
    walking_cadence,
    walking_step_m,
)
from twin.reproduce.gait.stride import SteadyGait, load_path, simulate_steady, stance, values_of
from twin.reproduce.registry import Outputs, Request
from twin.reproduce.results import ResultRow, format_rows, write_reproduction

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_OURS, _THEIRS = (hex_colour(IDENTITY_COLOURS[slot]) for slot in (0, 4))
_WHOLE = np.linspace(0, 100, 101)
_DRAWN_WALKS_M_S = (0.8, 1.2, 1.5, 1.8)


def stance_svg(runs: GaitRuns) -> str:
    """Draw the load of a foot over its stance, over the subject's if recorded, and the point of load, as SVG."""
    from matplotlib.figure import Figure

    compared = runs.compared
    with plot_style():
        figure = Figure(figsize=(10, 4.2), layout="constrained")
        axes, roll_axes = figure.subplots(1, 2, width_ratios=(1.6, 1))
        _roll(roll_axes, runs.person)
        _body_weight(axes)
        if compared is None:
            course = simulate_steady(SUBJECT_SPEED_M_S, [SUBJECT_STATURE_M])
            ours = stance(course.load[:, 0, 0], course.rate_hz).curves
        else:
            ours = compared.ours.curves
            for number, curve in enumerate(compared.theirs.curves):
                label = "subject01_walk1, a stance of each foot" if number == 0 else None
                axes.plot(_WHOLE, curve, color=_THEIRS, linewidth=1.2, alpha=0.8, label=label)
            mean = compared.theirs.curves.mean(axis=0)
            axes.plot(_WHOLE, mean, color=_THEIRS, linewidth=2.4, linestyle=(0, (5, 2)), label="their mean")
        axes.fill_between(_WHOLE, ours.min(axis=0), ours.max(axis=0), color=_OURS, alpha=0.18, linewidth=0)
        axes.plot(_WHOLE, ours.mean(axis=0), color=_OURS, linewidth=2.4, label=f"ours, mean of {len(ours)} stances")
        axes.set(xlim=(0, 100), ylim=(0, 1.3), xlabel="stance [%]")
        axes.set_title(
            f"load of a foot [body weights], {SUBJECT_SPEED_M_S:g} m/s, {SUBJECT_STATURE_M:g} m tall", loc="left"
        )
        axes.legend(loc="lower center", frameon=False)
        return to_svg(figure)


def _roll(axes: Axes, person: SteadyGait) -> None:
    """Draw our and the published point of load over the stance."""
    points = load_path(person) / person.shoe_m[0]
    axes.fill_between(_WHOLE, points.min(axis=0), points.max(axis=0), color=_OURS, alpha=0.18, linewidth=0)
    axes.plot(_WHOLE, points.mean(axis=0), color=_OURS, linewidth=2.4, label="ours")
    shares = np.array(list(ROLL.items()))
    axes.plot(100 * shares[:, 0], shares[:, 1], "D", color=_THEIRS, markersize=6, label="pressure plates, ten people")
    axes.set(xlim=(0, 100), ylim=(0, 1), xlabel="stance [%]")
    axes.set_title(f"point of load, share of the shoe, {PERSON_SPEED_M_S:g} m/s", loc="left")
    axes.legend(loc="lower right", frameon=False)


def loads_svg(runs: GaitRuns) -> str:
    """Draw the load of a foot over the time of its stance at several speeds, the published ranges shaded, as SVG."""
    from matplotlib.figure import Figure

    with plot_style():
        figure = Figure(figsize=(10, 3.9), layout="constrained")
        walking, running = figure.subplots(1, 2)
        for axes, speeds in ((walking, _DRAWN_WALKS_M_S), (running, RUNS_M_S)):
            _body_weight(axes)
            for place, speed in enumerate(speeds):
                course = runs.courses[speed]
                person = int(np.argsort(course.stature_m)[len(course.stature_m) // 2])
                found = stance(course.load[:, 0, person], course.rate_hz)
                axes.plot(
                    found.seconds.mean() * _WHOLE / 100, found.curves.mean(axis=0),
                    color=hex_colour(IDENTITY_COLOURS[place]), linewidth=1.8, label=f"{speed:g} m/s",
                )  # fmt: skip
            axes.set(xlim=(0, None), xlabel="time since the foot came down [s]")
        walking.legend(loc="lower center", bbox_to_anchor=(0.33, 0.08), frameon=False)
        running.legend(loc="upper right", frameon=False, ncols=2)
        for low, high in (HUMPS, DIP):
            walking.axhspan(low, high, color=SHADE, linewidth=0)
        running.axhspan(*RUNNING_HUMP, color=SHADE, linewidth=0)
        between = f"{NATURAL_M_S[0]:g} to {NATURAL_M_S[-1]:g} m/s"
        walking.annotate(
            f"humps and dip, {between}: published", (0.99, 0.985), xycoords="axes fraction", ha="right", va="top",
            color=QUIET, fontsize=8,
        )  # fmt: skip
        running.annotate(
            "hump: published", (0.01, RUNNING_HUMP[1]), xycoords=("axes fraction", "data"), va="bottom", color=QUIET,
            fontsize=8,
        )  # fmt: skip
        walking.set(ylim=(0, 1.4))
        running.set(ylim=(0, 3.1))
        walking.set_title("walking [body weights]", loc="left")
        running.set_title("running [body weights]", loc="left")
        return to_svg(figure)


def speeds_svg(runs: GaitRuns) -> str:
    """Draw cadence, step length and stance against speed, of all bodies and published, as SVG."""
    from matplotlib.figure import Figure

    with plot_style():
        figure = Figure(figsize=(10, 3.9), layout="constrained")
        cadence, length, stands = figure.subplots(1, 3)
        walks = np.linspace(WALKS_M_S[0], WALKS_M_S[-1], 50)
        _all_bodies(cadence, runs, "cadence", 1)
        cadence.plot(
            walks, walking_cadence(walks), color=_THEIRS, linewidth=1.8, label="walk ratio 0.0064 m/(steps/min)"
        )
        cadence.plot(*zip(*JOGGING_STEPS_MIN.items(), strict=True), "D", color=_THEIRS, markersize=6)
        cadence.set_title("cadence [steps/min]", loc="left")
        _all_bodies(length, runs, "step_length_m", 1)
        length.plot(walks, walking_step_m(walks), color=_THEIRS, linewidth=1.8)
        length.set_title("step length [m]", loc="left")
        stands.fill_between(
            [WALKS_M_S[0], WALKS_M_S[-1]],
            100 * STANCE_SHARE[0],
            100 * STANCE_SHARE[1],
            color=_THEIRS,
            alpha=0.18,
            linewidth=0,
        )
        _all_bodies(stands, runs, "stance_share", 100)
        for seconds in (STANCE_S, CONTACT_S):
            shares = [
                100 * time / values_of(runs.measures[speed], "stride_s").mean() for speed, time in seconds.items()
            ]
            stands.plot(list(seconds), shares, "D", color=_THEIRS, markersize=6)
        stands.set(ylim=(0, 75))
        stands.set_title("stance [% of the stride]", loc="left")
        for axes in (cadence, length, stands):
            axes.set(xlim=(0.5, 5.3), xlabel="speed [m/s]")
        cadence.plot([], [], "o", color=_OURS, markersize=4, label="ours, all bodies")
        cadence.plot([], [], "D", color=_THEIRS, markersize=6, label="published, measured")
        cadence.legend(loc="lower right", frameon=False, fontsize=8)
        return to_svg(figure)


def _all_bodies(axes: Axes, runs: GaitRuns, name: str, scale: float) -> None:
    for speed, found in runs.measures.items():
        values = scale * values_of(found, name)
        axes.plot(np.full(len(values), speed), values, "o", color=_OURS, markersize=3, alpha=0.25, markeredgewidth=0)
    for speeds in (WALKS_M_S, RUNS_M_S):
        means = [scale * values_of(runs.measures[speed], name).mean() for speed in speeds]
        axes.plot(speeds, means, color=_OURS, linewidth=1.4, marker="o", markersize=4)


def _body_weight(axes: Axes) -> None:
    axes.axhline(1, color=INK, linewidth=0.8, linestyle=":")


def reproduce(folder: Path, request: Request, on_progress: OnProgress = no_progress) -> Outputs:
    """Let one body per seed walk and run; write results, plots and page into `folder`.

    `request.data`: folder of the subject's recording (None: published data only). Raises InputError for a missing or invalid
    recording, and where a file cannot be written.
    """
    seeds, data = request.seed_range, request.data
    subject = None if data is None else read_subject(data)
    runs = simulate_gait(seeds, subject, on_progress)
    results = gait_results(runs)
    drawn = {"stance": stance_svg(runs), "loads": loads_svg(runs), "speeds": speeds_svg(runs)}
    content = _content(runs, results)
    return results, write_reproduction(folder, request.command, "gait/page.html.j2", results, drawn, **content)


def _content(runs: GaitRuns, results: list[ResultRow]) -> dict[str, Any]:
    seeds, compared = runs.seeds, runs.compared
    return {
        "n_run": len(seeds),
        "seeds": f"{seeds.start} to {seeds[-1]}",
        "rows": format_rows(results),
        "apart": None if compared is None else f"{compared.apart:.3f}",
        "feet_apart": None if compared is None else f"{compared.feet_apart:.3f}",
        "stature": f"{STATURE_M:.2f} ± {STATURE_SPREAD_M:.2f} m",
        "person": f"{PERSON_SPEED_M_S:g} m/s, {PERSON_STATURE_M:g} m tall",
        "steps_apart": f"{PERSON_STEPS_APART:g}",
        "subject_file": SUBJECT_FILE,
        "subject_mass": f"{SUBJECT_MASS_KG:g} kg",
        "sources": SOURCES,
    }
