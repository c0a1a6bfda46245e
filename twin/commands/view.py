"""`twin view`: pictures and videos of a scenario, its people and its sensors' images."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackers.errors import InputError
from twin.command_options import NoLimits, RoomRoot, Seed, Set, number, overrides, shipped, whole_number

if TYPE_CHECKING:
    from twin.scenario import Scenario


def view(
    scenario: Annotated[
        str | None,
        typer.Argument(
            help="Name of a shipped scenario or room (see `twin list`), or path of a YAML or MJCF file; "
            "--drawn shows rooms drawn at random without it.",
            autocompletion=shipped("scenarios", "rooms"),
            show_default=False,
        ),
    ] = None,
    at: Annotated[float, number("--at", "Time to show [s].", metavar="S")] = 0.0,
    people: Annotated[
        bool, typer.Option("--people", help="Each person from all sides, and each of their actions.")
    ] = False,
    video: Annotated[Path | None, typer.Option(metavar="FILE.mp4", help="Write a video by a free camera.")] = None,
    from_: Annotated[float, number("--from", "Start of the video [s].", metavar="S")] = 0.0,
    to: Annotated[float | None, number("--to", "End of the video [s]; default: of the scenario.", metavar="S")] = None,
    follow: Annotated[str | None, typer.Option(metavar="NAME", help="Person that the video's camera follows.")] = None,
    room_root: RoomRoot = None,
    no_limits: NoLimits = False,
    drawn: Annotated[
        int | None,
        whole_number(
            "--drawn", "N seeds of the scenario side by side, from --seed on; at most 200.", least=1, most=200
        ),
    ] = None,
    set_: Set = None,
    seed: Seed = None,
    out: Annotated[Path | None, typer.Option(help="The picture to write; default: view.png or people.png.")] = None,
) -> None:
    """Draw the room and every sensor's view at one time, its people (--people), a video of them (--video), or a room's plan."""
    from twin.console import print_paths, print_warnings, progress
    from twin.scenario import load_scenario
    from twin.scenario.run_size import check_size
    from twin.view import write_video, write_view

    if scenario is None and drawn is None:
        raise InputError("scenario: is missing; a name of `twin list`, or the path of a YAML or MJCF file, is expected")
    scenario, path = scenario or "drawn", out or Path("view.png")
    if _is_room(scenario):
        given: dict[str, object] = {"--at": at, "--people": people, "--video": video, "--from": from_, "--to": to}
        given |= {"--follow": follow, "--drawn": drawn, "--set": set_, "--seed": seed}
        return _view_room(scenario, path, given)
    if drawn is not None and (people or video is not None):
        raise InputError(f"--drawn {drawn}: is a picture of its own beside --people and --video; one is expected")
    check_options(at=at, people=people, video=video, start_s=from_, end_s=to, follow=follow, out=out)
    if drawn is not None:
        overrides(set_, seed or 0)  # refuses --set seed beside --seed
        seeds = range(seed or 0, (seed or 0) + drawn)
        return _view_drawn(scenario, set_ or [], seeds, at, out or Path("drawn.png"))
    loaded = load_scenario(scenario, overrides(set_, seed))
    check_size(loaded)
    if video is not None:
        with progress() as report:
            write_video(loaded, video, start_s=from_, end_s=to, follow=follow, on_progress=report)
        print_paths({"video": video})
    elif people:
        _view_people(loaded, out or Path("people.png"))
    else:
        print_warnings(write_view(loaded, at, path))
        print_paths({"view": path})


def _view_people(scenario: Scenario, path: Path) -> None:
    """Draw each person from all sides, and print their actions."""
    from twin.console import print_paths, progress
    from twin.view import write_people

    with progress() as report:
        found = write_people(scenario, path, on_progress=report)
    for activity in found:
        typer.echo(str(activity))
    print_paths({"people": path})


def _view_drawn(scenario: str, changes: list[str], seeds: range, at: float, path: Path) -> None:
    """Draw the scenes of these seeds side by side."""
    from twin.console import print_paths, print_warnings, progress
    from twin.view import write_drawn

    with progress() as report:
        warnings = write_drawn(scenario, changes, seeds, at, path, on_progress=report)
    print_warnings(warnings)
    print_paths({"drawn": path})


def _view_room(room: str, path: Path, given: Mapping[str, object]) -> None:
    """Draw a room's plan. Raises InputError where an option about a scenario is given, by its value in `given`."""
    from twin.console import print_paths, print_warnings
    from twin.view import write_room

    not_given = {"--at": 0.0, "--from": 0.0, "--people": False}
    for option, value in given.items():
        if value not in (None, [], not_given.get(option)):
            raise InputError(f"{option} {value}: is about a scenario, and {room} is a room; --out alone is expected")
    print_warnings(write_room(room, path))
    print_paths({"view": path})


def _is_room(name: str) -> bool:
    """Return whether a name is a room's: an MJCF file, or a shipped room whose name no scenario has."""
    from twin import models

    return name.endswith(".xml") or (name in models.names("rooms") and name not in models.names("scenarios"))


def check_options(
    *,
    at: float,
    people: bool,
    video: Path | None,
    start_s: float,
    end_s: float | None,
    follow: str | None,
    out: Path | None,
) -> None:
    """Raise InputError for options of `twin view` without effect on the requested picture."""
    if people and video is not None:
        raise InputError("--people: is a picture of its own beside --video; one of the two is expected")
    if people and at:
        raise InputError(
            f"--at {at:g}: has no effect with --people, which shows the whole run; one of the two is expected"
        )
    if video is not None and (at or out is not None):
        option = f"--at {at:g}" if at else f"--out {out}"
        raise InputError(f"{option}: has no effect on a video; --video FILE.mp4 with --from and --to is expected")
    if video is None:
        given = [("--from", start_s or None), ("--to", end_s), ("--follow", follow)]
        for option, value in given:
            if value is not None:
                raise InputError(f"{option} {value}: is about a video; --video FILE.mp4 beside it is expected")
