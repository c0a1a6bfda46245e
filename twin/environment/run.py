"""Scan a scenario's empty room; write the environment, its picture and, on request, the point cloud.

The picture shows the plan, the known voxels at two heights, and a vertical cut.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from trackers.environment import Environment, EnvironmentOptions, PointCloud, build_environment, save_environment
from trackers.errors import InputError
from twin.environment.scan import HEIGHT_M, TiltingScanner, chosen_stations, given_stations, scan_room
from twin.messages import OnProgress, no_progress
from twin.recording.atomic_file import atomic_path
from twin.run.out_folder import check_others
from twin.scenario import Scenario
from twin.sensors.laser_noise import LASER_NOISE
from twin.world.world import World

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_INK, _QUIET = "#1b1f27", "#606977"
_UNKNOWN, _FREE, _MET = "#b9bdc6", "#ffffff", "#c2542d"
_WALL, _STATION, _AREA = "#1b1f27", "#1769aa", "#2b8a57"
_LOW_CUT_M, _HEAD_M = 0.5, 1.6


def write_picture(environment: Environment, path: Path) -> None:
    """Write a PNG: furniture's heights and the walls; the voxels half a metre up; the likelihood of heads; a cut."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    low, high = environment.grid.origin_m, environment.grid.upper_m
    tall = 5.6 * (high[1] - low[1]) / (high[0] - low[0])
    cut_tall = 5.6 * (high[2] - low[2]) / (high[0] - low[0])
    with rc_context({"font.size": 8.5, "axes.edgecolor": _QUIET, "text.color": _INK, "axes.titlesize": 9}):
        figure = Figure(figsize=(13.4, tall + max(tall, cut_tall) + 1.5), dpi=110, layout="constrained")
        (heights, slice_), (weights, cut) = figure.subplots(2, 2)
        _draw_heights(heights, environment)
        _draw_states(slice_, environment)
        _draw_weights(weights, environment)
        _draw_cut(cut, environment)
        for axes in (heights, slice_, weights):
            _draw_plan(axes, environment)
        figure.suptitle(_caption(environment), fontsize=10)
        figure.savefig(path, format="png", metadata={"Software": None})


def _caption(environment: Environment) -> str:
    ceiling = "" if np.isnan(environment.ceiling_m) else f", ceiling at {environment.ceiling_m:.3f} m"
    stations, walls = len(environment.stations_m), len(environment.walls_m)
    return (
        f"{environment.room}: seen from {stations} station{'s' * (stations != 1)}; {walls} walls, floor at "
        f"{environment.floor_m:.3f} m{ceiling}; voxels of {100 * environment.grid.voxel_m:g} cm"
    )


def _draw_heights(axes: Axes, environment: Environment) -> None:
    from matplotlib import colormaps

    colours = colormaps["YlOrBr"].with_extremes(bad=_UNKNOWN)
    top = environment.top_m - environment.floor_m
    image = axes.imshow(top.T, origin="lower", extent=_plan_extent(environment), cmap=colours, vmin=0, vmax=2.0)
    axes.figure.colorbar(image, ax=axes, label="m above the floor", shrink=0.8)
    axes.set_title("height of what stands there (grey: not seen), walls, stations, tracked area", loc="left")


def _draw_states(axes: Axes, environment: Environment) -> None:
    layer = _layer(environment, environment.floor_m + _LOW_CUT_M)
    axes.imshow(_painted(environment.state[:, :, layer].T), origin="lower", extent=_plan_extent(environment))
    axes.set_title(f"{_LOW_CUT_M:g} m up: free (white), met (red), unknown (grey)", loc="left")


def _draw_weights(axes: Axes, environment: Environment) -> None:
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    grid = environment.grid
    flat = np.arange(grid.shape[0] * grid.shape[1]) * grid.shape[2]
    places = grid.centres(flat)
    places[:, 2] = environment.floor_m + _HEAD_M
    weight = environment.head_weight(places).reshape(grid.shape[:2])
    pale = ListedColormap(colormaps["Greens"](np.linspace(0.0, 0.5, 256)))  # lines stay legible on it
    image = axes.imshow(weight.T, origin="lower", extent=_plan_extent(environment), cmap=pale, vmin=0, vmax=1)
    axes.figure.colorbar(image, ax=axes, label="weight", shrink=0.8)
    axes.set_title(f"how likely a head is {_HEAD_M:g} m up: nowhere 0, over furniture 0.5, else 1", loc="left")


def _draw_cut(axes: Axes, environment: Environment) -> None:
    grid, low, high = environment.grid, environment.grid.origin_m, environment.grid.upper_m
    x, y = environment.stations_m[0, :2]
    row = min(int((y - low[1]) / grid.voxel_m), grid.shape[1] - 1)
    axes.imshow(
        _painted(environment.state[:, row].T), origin="lower", extent=(float(low[0]), float(high[0]), low[2], high[2])
    )
    axes.plot(x, environment.stations_m[0, 2], marker="^", color=_STATION, markersize=7)
    axes.set(xlabel="x [m]", ylabel="z [m]")
    axes.set_title(f"cut along x through the first station, y = {y:.2f} m", loc="left")


def _draw_plan(axes: Axes, environment: Environment) -> None:
    for start, end in environment.walls_m:
        axes.plot(*np.stack([start, end]).T, color=_WALL, linewidth=1.6)
    if len(environment.area_m):
        axes.plot(*np.vstack([environment.area_m, environment.area_m[:1]]).T, "--", color=_AREA, linewidth=1)
    axes.plot(*environment.stations_m[:, :2].T, "^", color=_STATION, markersize=7)
    axes.set(xlabel="x [m]", ylabel="y [m]")


def _plan_extent(environment: Environment) -> tuple[float, float, float, float]:
    low, high = environment.grid.origin_m, environment.grid.upper_m
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _layer(environment: Environment, z: float) -> int:
    return int((z - environment.grid.origin_m[2]) / environment.grid.voxel_m)


def _painted(state: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return a colour for each voxel of a slice."""
    from matplotlib.colors import to_rgb

    return np.array([to_rgb(colour) for colour in (_UNKNOWN, _FREE, _MET)])[state]


def scan_scenario(
    scenario: Scenario,
    stations: Sequence[Sequence[float]] = (),
    *,
    noise: str = "default",
    scanner: TiltingScanner | None = None,
    on_progress: OnProgress = no_progress,
) -> tuple[PointCloud, World]:
    """Scan the scenario's room without its people; return the point cloud and its world.

    `stations`: x, y or x, y, z [m] of each; none: places of greatest visibility. `noise` is a name in LASER_NOISE. Raises
    InputError for a station in objects, off the floor or blind.
    """
    world = World(scenario, pictures=False)
    snapshot = world.empty_snapshot(0.0)
    if stations:
        places = [(place[0], place[1], place[2] if len(place) > 2 else HEIGHT_M) for place in stations]
        where = given_stations(places, world.scene, snapshot, "--station")
    else:
        where = chosen_stations(world.scene, snapshot)
    return scan_room(snapshot, where, LASER_NOISE[noise], scenario.seed, scanner, on_progress), world


def write_environment(
    scenario: Scenario,
    stations: Sequence[Sequence[float]] = (),
    *,
    noise: str = "default",
    options: EnvironmentOptions | None = None,
    out: Path | None = None,
    cloud_path: Path | None = None,
    on_progress: OnProgress = no_progress,
) -> dict[str, Path]:
    """Write the environment (default out/<room>.npz), its picture, and the cloud if requested; return the files by name.

    Raises InputError for names with other endings.
    """
    out = out if out is not None else Path("out") / f"{scenario.room_name}.npz"
    for option, path, suffix in (("--out", out, ".npz"), ("--cloud", cloud_path, ".ply")):
        if path is not None and path.suffix.lower() != suffix:
            raise InputError(f"{option} {path}: a name ending in {suffix} is expected")
    check_others(out.parent, (out.with_suffix(".png").name,), out.name)
    cloud, world = scan_scenario(scenario, stations, noise=noise, on_progress=on_progress)
    environment = build_environment(cloud, room=scenario.room_name, area=world.scene.area, options=options)
    files = {"environment": out, "picture": out.with_suffix(".png")}
    with atomic_path(out) as partial:
        save_environment(environment, partial)
    with atomic_path(files["picture"]) as partial:
        write_picture(environment, partial)
    if cloud_path is not None:
        files["cloud"] = cloud_path
        with atomic_path(cloud_path) as partial:
            cloud.write_ply(partial)
    return files
