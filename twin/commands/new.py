"""`twin new`: write a commented start, or a scene drawn at random as plain files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twin.options import Seed, Set

app = typer.Typer(
    help="Write a commented start of your own: a scenario, or one drawn at random.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)

_START = """\
# A scenario of your own; `twin schema > scenario.schema.json` gives editors completion. Run it: twin run {file}
name: {name}
room: lab                       # a shipped room (see `twin list`), or the path of an MJCF file, relative to this one
duration_s: 20
people:                         # what is left out, height and clothes say, is drawn from the seed
  ann: {{height_m: 1.68, shirt: pink, script: {{kind: wander}}}}
  bob:
    start: [-1.5, 1.0]          # metres in the room frame
    script:
      - {{kind: walk, waypoints: [[1.5, 2.0], [-1.5, 1.0]]}}
      - {{kind: stand, for_s: 3}}
      - {{kind: wander}}
sensors:
  waist: {{kind: laser, role: waist, rate_hz: 10, mount: {{xyz: [0, 0, 0.95], yaw_deg: 90}}}}
  knee: {{kind: laser, role: knee, rate_hz: 10, mount: {{xyz: [0, 0, 0.45], yaw_deg: 90}}}}
"""


@app.callback()
def _new() -> None:
    """Make typer keep the name of the only command."""


@app.command(epilog="Example: twin new scenario --drawn --seed 7 --out office; twin run office/scenario.yaml")
def scenario(
    drawn: Annotated[bool, typer.Option("--drawn", help="Room, people and sensors drawn at random.")] = False,
    set_: Set = None,
    seed: Seed = None,
    out: Annotated[Path, typer.Option(help="Folder to write scenario.yaml into, and room.xml of a drawn one.")] = Path(
        "scenario"
    ),
) -> None:
    """Write scenario.yaml into a folder: a commented start, or a drawn scene with its room, as plain files that run."""
    from trackers.errors import InputError
    from twin.console import print_paths
    from twin.recording.atomic_file import open_atomic
    from twin.scenario import load_scenario
    from twin.scenario.load import dump_scenario

    path, room = out / "scenario.yaml", out / "room.xml"
    if not drawn and (set_ or seed is not None):
        option = "--set" if set_ else "--seed"
        raise InputError(f"{option}: changes what is drawn; --drawn beside it is expected")
    for file in (path, *([room] if drawn else [])):
        if file.exists():
            raise InputError(f"{file}: is there already; another folder (--out) is expected")
    if not drawn:
        with open_atomic(path) as stream:
            stream.write(_START.format(name=_name(out), file=path))
        print_paths({"scenario": path})
        return
    loaded = load_scenario("drawn", [*(set_ or []), *([] if seed is None else [f"seed={seed}"])])
    with open_atomic(room) as stream:
        stream.write(Path(loaded.room).read_text(encoding="utf-8"))
    plain = loaded.model_copy(update={"room": room.name, "name": f"drawn-{loaded.seed}"})
    with open_atomic(path) as stream:
        stream.write(dump_scenario(plain))
    print_paths({"scenario": path, "room": room})


def _name(folder: Path) -> str:
    """Make a scenario's name from the folder's: letters, digits, '-' and '_', a letter first."""
    name = "".join(
        each if each.isascii() and (each.isalnum() or each in "-_") else "-" for each in folder.resolve().name
    )
    return name if name[:1].isalpha() else f"scenario-{name}".rstrip("-")
