"""`twin environment`: scan a scenario's empty room with a tilting scanner and write it for trackers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twin.options import NoLimits, RoomRoot, ScenarioName, Seed, SetOfScenario, overrides

_NOISE = ("off", "default", "worse")


def environment(
    scenario: ScenarioName,
    station: Annotated[
        list[str] | None,
        typer.Option(
            "--station", metavar="X,Y[,Z]", help="Place of the tripod [m]; Z 1.2. Repeatable; default: chosen."
        ),
    ] = None,
    voxel: Annotated[float | None, typer.Option(metavar="M", help="Side of a voxel [m]; default: 0.05.")] = None,
    noise: Annotated[str, typer.Option(help="The scanner's errors: off, default or worse.")] = "default",
    no_limits: NoLimits = False,
    room_root: RoomRoot = None,
    set_: SetOfScenario = None,
    seed: Seed = None,
    out: Annotated[Path | None, typer.Option(help="The file to write, .npz; default: out/<room>.npz.")] = None,
    cloud: Annotated[Path | None, typer.Option(help="Write the point cloud too, as .ply.")] = None,
) -> None:
    """Scan the empty room with a tilting scanner: walls, furniture and free space, in a file for trackers."""
    from trackers.environment import EnvironmentOptions
    from trackers.errors import InputError
    from twin.console import print_paths, progress
    from twin.environment.run import write_environment
    from twin.scenario import load_scenario

    if noise not in _NOISE:
        raise InputError(f"--noise {noise}: there is no such noise; valid are {', '.join(_NOISE)}")
    if voxel is not None and not 0.01 <= voxel <= 0.5:
        raise InputError(f"--voxel {voxel:g}: is not the side of a voxel; 0.01 to 0.5 m is expected")
    stations = [_point(text) for text in station or []]
    options = EnvironmentOptions() if voxel is None else EnvironmentOptions(voxel_m=voxel)
    with progress() as report:
        files = write_environment(
            load_scenario(scenario, overrides(set_, seed)),
            stations,
            noise=noise,
            options=options,
            out=out,
            cloud_path=cloud,
            on_progress=report,
        )
    print_paths(files)


def _point(text: str) -> tuple[float, ...]:
    """Parse 'X,Y' or 'X,Y,Z'; raise InputError for anything else."""
    from trackers.errors import InputError

    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) not in (2, 3):
        raise InputError(f"--station {text}: is no place; X,Y or X,Y,Z [m] is expected, 1.5,0.8 for instance")
    return numbers
