"""Figures of Suzuki et al.: plots as SVG (5, 7, 9, 11, 12) and pictures as JPEG (6, 8, 10)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from trackers.cameras import Ellipsoids
from trackers.environment import Environment
from trackers.likelihood.stereo_head import StereoHeadOptions
from trackers.observations import DepthImage, Observation
from trackers.rgbd_head.tracker import HeadDebugState
from trackers.rig import Rig, placed_camera
from twin.recording.tables import TrackTable, TruthTable
from twin.report.palette import IDENTITY_COLOURS, INK, QUIET, encode_jpeg, hex_colour, plot_style, to_svg
from twin.reproduce.rgbd_head.results import HeadErrors

_HEIGHTS_M = (0.7, 1.2, 1.6)
_STEP_M = 0.05


def environment_svg(environment: Environment) -> str:
    """Draw figure 5: the weight of a head (eq. 8) over the floor, one panel per height."""
    from matplotlib.figure import Figure

    low, high = environment.grid.origin_m[:2], environment.grid.upper_m[:2]
    x, y = np.arange(low[0], high[0], _STEP_M), np.arange(low[1], high[1], _STEP_M)
    columns, rows = np.meshgrid(x, y)
    with plot_style():
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
        return to_svg(figure)


def trajectories_svg(truth: TruthTable, by_system: Mapping[str, TrackTable]) -> str:
    """Draw figures 7 and 9: the head's path in 3-D, in plan and its height over time; the truth in grey."""
    from matplotlib.figure import Figure

    with plot_style():
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
        return to_svg(figure)


def trap_svg(truth: TruthTable, by_way: Mapping[str, TrackTable], trap: Array) -> str:
    """Draw figures 11 and 12: the first run of each system in plan; truth in grey, the skin-coloured object at `trap` a
    cross.
    """
    from matplotlib.figure import Figure

    with plot_style():
        figure = Figure(figsize=(10, 3.4), layout="constrained")
        panels = figure.subplots(1, len(by_way), sharex=True, sharey=True, squeeze=False)[0]
        for slot, (axes, (name, tracks)) in enumerate(zip(panels, by_way.items(), strict=True)):
            axes.plot(truth.head_x, truth.head_y, color=QUIET, linewidth=4, alpha=0.4)
            axes.plot(tracks.head_x, tracks.head_y, color=hex_colour(IDENTITY_COLOURS[slot]), linewidth=1.2)
            axes.plot(trap[0], trap[1], marker="x", color=INK, markersize=9)
            axes.set(title=name, xlabel="x [m]", aspect="equal")
        panels[0].set_ylabel("y [m]")
        return to_svg(figure)


def errors_svg(by_name: Mapping[str, HeadErrors]) -> str:
    """Draw the error in XY and the signed one in Z over time, one panel per sequence."""
    from matplotlib.figure import Figure

    with plot_style():
        figure = Figure(figsize=(10, 2.1 * len(by_name)), layout="constrained")
        panels = figure.subplots(len(by_name), 1, squeeze=False)[:, 0]
        for axes, (name, each) in zip(panels, by_name.items(), strict=True):
            t = each.stamps_ns / 1e9
            axes.plot(t, each.xy_cm, color=hex_colour(IDENTITY_COLOURS[0]), linewidth=1.3, label="XY")
            axes.plot(t, 100 * each.off_m[:, 2], color=hex_colour(IDENTITY_COLOURS[1]), linewidth=1.3, label="Z")
            axes.set(title=name, ylabel="error [cm]")
        panels[0].legend(loc="upper right", frameon=False, ncols=2)
        panels[-1].set_xlabel("time [s]")
        return to_svg(figure)


_TIMES = 2
"""Enlargement of the views."""
_QUALITY = 86
_GAZE_M = 0.3
_WHITE = (255, 255, 255)
Picture = NDArray[np.uint8]


def head_views(observations: Sequence[Observation], rig: Rig, t_s: float, head: Array) -> bytes:
    """Draw figures 6 and 8: every camera's image at a time with the ellipse of a head (x, y, z, yaw), brighter facing the
    camera.
    """
    drawn = []
    for name in rig.cameras():
        picture = _picture(observations, name, t_s)
        camera = placed_camera(rig.cameras()[name])
        place, yaw = head[:3], head[3]
        towards = camera.eye_m[:2] - place[:2]
        facing = np.cos(np.arctan2(towards[1], towards[0]) - yaw)
        level = int(110 + 72 * (1 + facing))
        ellipses, shown = camera.ellipses(Ellipsoids.upright(place[None], StereoHeadOptions().semi_axes_m, yaw))
        if shown[0]:
            outline = np.rint(_TIMES * ellipses.outline()[0]).astype(np.int32)
            cv2.polylines(picture, [outline], True, (level, level, 0), 2, cv2.LINE_AA)
            ends, _ = camera.project(place + np.outer([0.0, _GAZE_M], [np.cos(yaw), np.sin(yaw), 0.0]))
            if np.isfinite(ends).all():
                start, end = np.rint(_TIMES * ends).astype(int).tolist()
                cv2.arrowedLine(picture, start, end, (level, level, 0), 2, cv2.LINE_AA, tipLength=0.3)
        drawn.append(picture)
    return encode_jpeg(_two_by_two(drawn), _QUALITY)


def weights_picture(
    observations: Sequence[Observation], rig: Rig, t_s: float, state: HeadDebugState, camera_name: str
) -> bytes:
    """Draw figure 10: hypotheses in one camera's image, from blue (least) to red by colour weight, and again by depth
    weight.
    """
    weights = state.likelihoods[camera_name]
    camera = placed_camera(rig.cameras()[camera_name])
    places = state.people.roster.state.state[:3].reshape(3, -1)
    pixels, seen = camera.project(places.T)
    panels = []
    for what, log in (("colour", weights.colour), ("depth", weights.depth)):
        picture = _picture(observations, camera_name, t_s)
        weight = np.exp(log - log[seen].max(initial=-np.inf)) if seen.any() else log
        rank = (255 * weight.argsort().argsort() / max(len(weight) - 1, 1)).astype(np.uint8)
        colours = np.asarray(cv2.applyColorMap(rank[:, None], cv2.COLORMAP_JET))[:, 0, ::-1]
        for k in np.flatnonzero(seen):
            at = np.rint(_TIMES * pixels[k]).astype(int).tolist()
            cv2.circle(picture, at, 2, colours[k].tolist(), -1, cv2.LINE_AA)
        cv2.putText(picture, f"{what} weight", (10, 26), cv2.FONT_HERSHEY_SIMPLEX, 0.8, _WHITE, 2, cv2.LINE_AA)
        panels.append(picture)
    return encode_jpeg(np.hstack(panels), _QUALITY)


def _picture(observations: Sequence[Observation], camera: str, t_s: float) -> Picture:
    """Enlarge the camera's image nearest to a time."""
    taken = [each for each in observations if isinstance(each, DepthImage) and each.sensor == camera]
    nearest = min(taken, key=lambda each: abs(each.t - t_s))
    return np.asarray(
        cv2.resize(nearest.rgb, None, fx=_TIMES, fy=_TIMES, interpolation=cv2.INTER_LINEAR), np.uint8
    ).copy()


def _two_by_two(pictures: Sequence[Picture]) -> Picture:
    padded = [*pictures, *([np.full_like(pictures[0], 255)] * (-len(pictures) % 2))]
    return np.vstack([np.hstack(padded[k : k + 2]) for k in range(0, len(padded), 2)])
