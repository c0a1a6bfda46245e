"""Scan a scenario's empty room and leave the environment, its picture and on request the point cloud as files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from trackers.environment import EnvironmentOptions, build_environment, save_environment
from trackers.environment.model import Environment
from trackers.errors import InputError
from twin.environment.picture import write_picture
from twin.environment.scan import HEIGHT_M, PointCloud, TiltingScanner, chosen_stations, given_stations, scan_room
from twin.messages import OnProgress
from twin.recording.atomic_file import atomic_path
from twin.scenario import Scenario
from twin.sensors.laser_noise import LASER_NOISE
from twin.world.world import World


def scan_scenario(
    scenario: Scenario,
    stations: Sequence[Sequence[float]] = (),
    *,
    noise: str = "default",
    scanner: TiltingScanner | None = None,
    on_progress: OnProgress | None = None,
) -> tuple[PointCloud, World]:
    """Scan the scenario's room without its people; return the point cloud and the world it was taken in.

    `stations`: x, y or x, y, z [m] of each; none: places from which most is visible. `noise` is a name in LASER_NOISE. Raises
    InputError for a station in things, off the floor or blind.
    """
    world = World(scenario)
    snapshot = world.empty_snapshot(0.0)
    if stations:
        places = [(place[0], place[1], place[2] if len(place) > 2 else HEIGHT_M) for place in stations]
        where = given_stations(places, world.scene, snapshot, "--station")
    else:
        where = chosen_stations(world.scene, snapshot)
    return scan_room(snapshot, where, LASER_NOISE[noise], scenario.seed, scanner, on_progress), world


def scenario_environment(
    scenario: Scenario,
    stations: Sequence[Sequence[float]] = (),
    *,
    noise: str = "default",
    scanner: TiltingScanner | None = None,
    options: EnvironmentOptions | None = None,
    on_progress: OnProgress | None = None,
) -> Environment:
    """Build the environment of the scenario's room from a scan of it; see `scan_scenario`."""
    cloud, world = scan_scenario(scenario, stations, noise=noise, scanner=scanner, on_progress=on_progress)
    return build_environment(cloud, room=scenario.room_name, area=world.scene.area, options=options)


def write_environment(
    scenario: Scenario,
    stations: Sequence[Sequence[float]] = (),
    *,
    noise: str = "default",
    options: EnvironmentOptions | None = None,
    out: Path | None = None,
    cloud_path: Path | None = None,
    on_progress: OnProgress | None = None,
) -> dict[str, Path]:
    """Write the environment (default out/<room>.npz), its picture, and the cloud if asked for; return the files by name."""
    out = out if out is not None else Path("out") / f"{scenario.room_name}.npz"
    for option, path, suffix in (("--out", out, ".npz"), ("--cloud", cloud_path, ".ply")):
        if path is not None and path.suffix.lower() != suffix:
            raise InputError(f"{option} {path}: a name ending in {suffix} is expected")
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
