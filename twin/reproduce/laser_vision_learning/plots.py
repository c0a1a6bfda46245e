"""Plots of the hall's runs as SVG: figure 11 a to c, and the densities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from trackers.arrays import Array
from trackers.observations import NS_PER_S
from twin.report.palette import IDENTITY_COLOURS, INK, QUIET, SHADE, hex_colour, plot_style, to_svg
from twin.reproduce.laser_vision_learning.runs import SYSTEMS, HallCondition, HallRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLOURS = {name: hex_colour(IDENTITY_COLOURS[slot]) for slot, name in enumerate(SYSTEMS)}
_PANELS = (
    ("accuracy [%]", "accuracy"),
    ("correlated, disposed of [%]", "correlated"),
    ("merge/split, disposed of [%]", "merge_split"),
    ("time per frame [ms]", "cost"),
)


def figure11_svg(run: HallRun, condition: HallCondition) -> str:
    """Draw figure 11: (a) failures of each system over a run, (b) people and those interacting, (c) time per frame."""
    from matplotlib.figure import Figure

    systems = [name for name in SYSTEMS if name in run.evaluations] or list(run.evaluations)
    with plot_style():
        figure = Figure(figsize=(10, 2.0 + 1.1 * len(systems) + 2.4), layout="constrained")
        grid = figure.subplots(
            len(systems) + 2, 1, squeeze=False, height_ratios=[1.0] * len(systems) + [1.5, 0.35 * len(systems) + 0.4]
        )[:, 0]
        first = run.evaluations[systems[0]]
        t = first.stamps_ns / NS_PER_S
        most = max(int(run.evaluations[name].people.failures.max(initial=1)) for name in systems)
        for axes, name in zip(grid, systems, strict=False):
            _failures(axes, run, name, condition, most)
        grid[0].set_title("(a) failures in each frame, by system", loc="left")
        _people(grid[-2], t, run)
        _costs(grid[-1], condition, systems)
        for axes in grid[:-1]:
            axes.set_xlim(float(t[0]), float(t[-1]))
        return to_svg(figure)


def densities_svg(densities: Sequence[HallCondition]) -> str:
    """Draw accuracy, both disposals, and time per frame against the number of people, each system."""
    from matplotlib.figure import Figure

    with plot_style():
        figure = Figure(figsize=(10, 5.6), layout="constrained")
        panels = figure.subplots(2, 2, sharex=True).ravel()
        for axes, (title, key) in zip(panels, _PANELS, strict=True):
            for tracker in densities[0].trackers:
                known = (
                    each
                    for each in densities
                    if tracker in each.trackers and not np.isnan(_values(each, tracker, key)).all()
                )
                with_it = sorted(known, key=_people_a_frame)
                across = [_people_a_frame(each) for each in with_it]
                colour = _COLOURS.get(tracker, INK)
                for condition, x in zip(with_it, across, strict=True):
                    runs = _values(condition, tracker, key)
                    axes.scatter(np.full(len(runs), x), runs, s=16, color=colour, alpha=0.4, linewidths=0)
                means = [np.nanmean(_values(each, tracker, key)) for each in with_it]
                axes.plot(
                    across,
                    means,
                    "o-",
                    color=colour,
                    linewidth=1.5,
                    markersize=5,
                    label=densities[0].tracker_label(tracker),
                )
            axes.set_title(title, loc="left")
        panels[0].legend(frameon=False)
        for axes in panels[2:]:
            axes.set_xlabel("people in the area")
        panels[-1].set_ylim(bottom=0)
        return to_svg(figure)


def _people_a_frame(condition: HallCondition) -> float:
    return float(condition.place.people.sum() / condition.place.frames.sum())


def _values(condition: HallCondition, tracker: str, key: str) -> Array:
    """Return a panel's value of each run, (n,)."""
    if key == "accuracy":
        return condition.accuracy(tracker)
    if key == "cost":
        return condition.metrics[tracker]["ms_per_frame.mean"]
    return 100 * condition.metrics[tracker][f"disposal.{key}.share"]


def _failures(axes: Axes, run: HallRun, name: str, condition: HallCondition, most: int) -> None:
    from matplotlib.ticker import MaxNLocator

    people = run.evaluations[name].people
    t = run.evaluations[name].stamps_ns / NS_PER_S
    kinds = (
        ("missed", people.missed.sum(axis=0), QUIET),
        ("false location", people.false_locations, hex_colour(IDENTITY_COLOURS[3])),
        ("identity wrong", people.wrong.sum(axis=0), hex_colour(IDENTITY_COLOURS[1])),
    )
    below = np.zeros(len(t))
    for kind, count, colour in kinds:
        axes.fill_between(t, below, below + count, step="post", color=colour, linewidth=0, label=kind)
        below = below + count
    axes.set(ylim=(0, most + 0.5), ylabel=condition.tracker_label(name))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=3))
    axes.tick_params(labelbottom=False)
    if axes.get_subplotspec().rowspan.start == 0:  # pyright: ignore[reportOptionalMemberAccess]
        axes.legend(loc="upper right", frameon=False, ncols=3)


def _people(axes: Axes, t: Array, run: HallRun) -> None:
    axes.fill_between(t, run.people, step="post", color=SHADE, linewidth=0)
    axes.plot(t, run.people, color=INK, linewidth=1.1, drawstyle="steps-post", label="people in the area")
    axes.fill_between(
        t, run.interacting, step="post", color=hex_colour(IDENTITY_COLOURS[1]), alpha=0.6, label="of them interacting"
    )
    axes.set_title("(b) people and interactions", loc="left")
    axes.set(xlabel="time [s]", ylim=(0, 1.35 * run.people.max(initial=1)))
    axes.legend(loc="upper right", frameon=False, ncols=2)


def _costs(axes: Axes, condition: HallCondition, systems: Sequence[str]) -> None:
    for place, name in enumerate(systems):
        metrics = condition.metrics[name]
        mean, p95 = metrics["ms_per_frame.mean"].mean(), metrics["ms_per_frame.p95"].mean()
        axes.barh(place, mean, height=0.55, color=_COLOURS.get(name, INK))
        axes.plot([p95, p95], [place - 0.28, place + 0.28], color=INK, linewidth=1.6)
        text = f"{mean:.1f} ms, 95 %: {p95:.1f} ms"
        axes.annotate(text, (max(mean, p95), place), (6, 0), textcoords="offset points", va="center")
    axes.set_yticks(range(len(systems)), [condition.tracker_label(name) for name in systems])
    axes.set(ylim=(len(systems) - 0.5, -0.5), xlabel="ms")
    axes.margins(x=0.25)
    axes.grid(axis="x")
    axes.grid(visible=False, axis="y")
    axes.set_title(
        "(c) time per frame: mean of all runs, and the time that 19 of 20 frames stay below (line)", loc="left"
    )
