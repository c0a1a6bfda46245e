"""Figure 6, the straight course by three systems, and the head's errors over time since detection, as SVG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trackers.arrays import Array
from trackers.observations import NS_PER_S
from twin.recording.tables import TrackTable, TruthTable
from twin.report.palette import IDENTITY_COLOURS, hex_colour
from twin.reproduce.drawing import INK, QUIET, look, svg_of

Errors = tuple[Array, Array]
"""Time since the detection of a track [s], and the errors of the head along x, y, z there [m], (n,) and (n, 3)."""


def course_svg(truth: TruthTable, by_system: Mapping[str, TrackTable]) -> str:
    """Trajectories on the floor of the straight course, a panel a system, the truth in grey."""
    from matplotlib.figure import Figure

    with look():
        figure = Figure(figsize=(10, 1.9 * len(by_system)), layout="constrained")
        panels = figure.subplots(len(by_system), 1, squeeze=False, sharex=True, sharey=True)[:, 0]
        for slot, (axes, (name, tracks)) in enumerate(zip(panels, by_system.items(), strict=True)):
            axes.plot(truth.x, truth.y, color=QUIET, linewidth=4, alpha=0.35, label="truth")
            axes.plot(tracks.x, tracks.y, color=hex_colour(IDENTITY_COLOURS[slot]), linewidth=1.1, label=name)
            axes.set(ylabel="y [m]", ylim=(truth.y.min() - 0.35, truth.y.max() + 0.35))
            axes.legend(loc="upper right", frameon=False, ncols=2)
        panels[-1].set_xlabel("x [m]")
        return svg_of(figure)


def heads_svg(errors: Sequence[Errors]) -> str:
    """Mean absolute error of the head on each axis against time since detection, all runs together."""
    from matplotlib.figure import Figure

    since, off = np.concatenate([each[0] for each in errors]), np.abs(np.concatenate([each[1] for each in errors]))
    edges = np.arange(0.0, since.max() + 0.5, 0.5)
    bin_of = np.digitize(since, edges) - 1
    with look():
        figure = Figure(figsize=(10, 3.2), layout="constrained")
        axes = figure.subplots()
        for slot, axis in enumerate("xyz"):
            means = [100 * off[bin_of == k, slot].mean() if (bin_of == k).any() else np.nan for k in range(len(edges))]
            axes.plot(edges + 0.25, means, color=hex_colour(IDENTITY_COLOURS[slot]), linewidth=1.6, label=axis)
        axes.axhline(5.0, color=INK, linewidth=0.8, linestyle=":", label="the paper, about")
        axes.set(xlabel="time since detection [s]", ylabel="mean absolute error [cm]", ylim=(0, None))
        axes.legend(loc="upper right", frameon=False, ncols=4)
        return svg_of(figure)


def head_errors(truth: TruthTable, tracks: TrackTable, gate_m: float = 0.5) -> Errors:
    """Errors of the heads of each track's rows that have a person within the gate, and when since the track began."""
    since, off = [], []
    began = {number: tracks.stamps_ns[tracks.id == number].min() for number in np.unique(tracks.id).tolist()}
    for stamp in np.unique(tracks.stamps_ns):
        there, rows = np.flatnonzero(truth.stamps_ns == stamp), np.flatnonzero(tracks.stamps_ns == stamp)
        there = there[~np.isnan(truth.head_x[there])]
        if not there.size:
            continue
        away = np.hypot(tracks.x[rows, None] - truth.x[there], tracks.y[rows, None] - truth.y[there])
        nearest = away.argmin(axis=1)
        for row, person, distance in zip(rows, there[nearest], away.min(axis=1), strict=True):
            if distance < gate_m and not np.isnan(tracks.head_x[row]):
                since.append((stamp - began[int(tracks.id[row])]) / NS_PER_S)
                off.append([getattr(tracks, f"head_{k}")[row] - getattr(truth, f"head_{k}")[person] for k in "xyz"])
    return np.array(since, float), np.array(off, float).reshape(-1, 3)
