"""Figure 5, the environment in slices; figures 7 and 9, trajectories in 3-D and plan; figures 11 and 12, the trap. As SVG."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from trackers.arrays import Array
from trackers.environment import Environment
from twin.recording.tables import TrackTable, TruthTable
from twin.report.palette import IDENTITY_COLOURS, hex_colour
from twin.reproduce.drawing import INK, QUIET, look, svg_of
from twin.reproduce.rgbd_head.errors import HeadErrors

_HEIGHTS_M = (0.7, 1.2, 1.6)
_STEP_M = 0.05


def environment_svg(environment: Environment) -> str:
    """Figure 5: the weight of a head (eq. 8) over the floor, a panel a height."""
    from matplotlib.figure import Figure

    low, high = environment.grid.origin_m[:2], environment.grid.upper_m[:2]
    x, y = np.arange(low[0], high[0], _STEP_M), np.arange(low[1], high[1], _STEP_M)
    columns, rows = np.meshgrid(x, y)
    with look():
        figure = Figure(figsize=(10, 3.3), layout="constrained")
        panels = figure.subplots(1, len(_HEIGHTS_M), sharey=True)
        for axes, height in zip(panels, _HEIGHTS_M, strict=True):
            places = np.column_stack([columns.ravel(), rows.ravel(), np.full(columns.size, height)])
            weight = environment.head_weight(places).reshape(columns.shape)
            extent = (low[0], high[0], low[1], high[1])
            axes.imshow(weight, origin="lower", extent=extent, cmap="gray", vmin=0, vmax=1)
            axes.set(title=f"a head {height:g} m high", xlabel="x [m]")
            axes.grid(visible=False)
        panels[0].set_ylabel("y [m]")
        figure.colorbar(panels[-1].images[0], ax=panels, label="weight", shrink=0.8)
        return svg_of(figure)


def trajectories_svg(truth: TruthTable, by_system: Mapping[str, TrackTable]) -> str:
    """Figures 7 and 9: the head's way in 3-D, beside it in plan and its height over time; the truth in grey."""
    from matplotlib.figure import Figure

    with look():
        figure = Figure(figsize=(10, 6.4), layout="constrained")
        grid = figure.add_gridspec(2, 2, height_ratios=(2.2, 1))
        space, plan = figure.add_subplot(grid[0, 0], projection="3d"), figure.add_subplot(grid[0, 1])
        height = figure.add_subplot(grid[1, :])
        for slot, (name, of) in enumerate({"truth": truth, **by_system}.items()):
            colour = QUIET if name == "truth" else hex_colour(IDENTITY_COLOURS[slot - 1])
            style = {"color": colour, "linewidth": 4 if name == "truth" else 1.2, "label": name}
            style["alpha"] = 0.4 if name == "truth" else 1.0
            space.plot(of.head_x, of.head_y, of.head_z, **style)
            plan.plot(of.head_x, of.head_y, **style)
            height.plot(of.stamps_ns / 1e9, of.head_z, **style)
        space.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
        plan.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
        height.set(xlabel="time [s]", ylabel="z [m]")
        plan.legend(loc="best", frameon=False)
        return svg_of(figure)


def trap_svg(truth: TruthTable, by_way: Mapping[str, TrackTable], trap: Array) -> str:
    """Figures 11 and 12: the first run of each way in plan; truth in grey, the skin-coloured thing at `trap` a cross."""
    from matplotlib.figure import Figure

    with look():
        figure = Figure(figsize=(10, 3.4), layout="constrained")
        panels = figure.subplots(1, len(by_way), sharex=True, sharey=True, squeeze=False)[0]
        for slot, (axes, (name, tracks)) in enumerate(zip(panels, by_way.items(), strict=True)):
            axes.plot(truth.head_x, truth.head_y, color=QUIET, linewidth=4, alpha=0.4)
            axes.plot(tracks.head_x, tracks.head_y, color=hex_colour(IDENTITY_COLOURS[slot]), linewidth=1.2)
            axes.plot(trap[0], trap[1], marker="x", color=INK, markersize=9)
            axes.set(title=name, xlabel="x [m]", aspect="equal")
        panels[0].set_ylabel("y [m]")
        return svg_of(figure)


def errors_svg(by_name: Mapping[str, HeadErrors]) -> str:
    """The error in XY and the signed one in Z over time, a panel a sequence."""
    from matplotlib.figure import Figure

    with look():
        figure = Figure(figsize=(10, 2.1 * len(by_name)), layout="constrained")
        panels = figure.subplots(len(by_name), 1, squeeze=False)[:, 0]
        for axes, (name, each) in zip(panels, by_name.items(), strict=True):
            t = each.stamps_ns / 1e9
            axes.plot(t, each.level_cm, color=hex_colour(IDENTITY_COLOURS[0]), linewidth=1.3, label="XY")
            axes.plot(t, 100 * each.off_m[:, 2], color=hex_colour(IDENTITY_COLOURS[1]), linewidth=1.3, label="Z")
            axes.set(title=name, ylabel="error [cm]")
        panels[0].legend(loc="upper right", frameon=False, ncols=2)
        panels[-1].set_xlabel("time [s]")
        return svg_of(figure)
