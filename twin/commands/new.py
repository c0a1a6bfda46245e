"""`twin new`: write a commented template of anything, or a random scene as plain files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twin.commands.starts import ROOM, SCENARIO, STUDY, SUITE, TRACKER
from twin.options import Seed, Set

app = typer.Typer(
    help="Write a commented start of your own: room, scenario, tracker, suite, study; or a scene drawn at random.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)


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
            stream.write(SCENARIO.format(name=_name(out), file=path))
        print_paths({"scenario": path})
        return
    loaded = load_scenario("drawn", [*(set_ or []), *([] if seed is None else [f"seed={seed}"])])
    with open_atomic(room) as stream:
        stream.write(Path(loaded.room).read_text(encoding="utf-8"))
    plain = loaded.model_copy(update={"room": room.name, "name": f"drawn-{loaded.seed}"})
    with open_atomic(path) as stream:
        stream.write(dump_scenario(plain))
    print_paths({"scenario": path, "room": room})


@app.command(epilog="Example: twin new room --out office.xml; twin view office.xml")
def room(out: Annotated[Path, typer.Option(metavar="FILE.xml", help="File to write.")] = Path("room.xml")) -> None:
    """Write a room of walls, a door, lamps, a desk and a seat, with comments (MJCF)."""
    _write("room", ROOM, out, ".xml")


@app.command(epilog="Example: twin new tracker --out mine.py; twin check mine:Mine")
def tracker(out: Annotated[Path, typer.Option(metavar="FILE.py", help="File to write.")] = Path("mine.py")) -> None:
    """Write a tracker of 40 lines: clusters of one scanner, each taken for the nearest track."""
    _write("tracker", TRACKER, out, ".py")


@app.command(epilog="Example: twin new suite --out gate.yaml; twin suite run gate.yaml")
def suite(out: Annotated[Path, typer.Option(metavar="FILE.yaml", help="File to write.")] = Path("suite.yaml")) -> None:
    """Write a suite of one scenario, two trackers and two seeds, with a requirement."""
    _write("suite", SUITE, out, ".yaml")


@app.command(epilog="Example: twin new study --out places.yaml; twin study run places.yaml")
def study(out: Annotated[Path, typer.Option(metavar="FILE.yaml", help="File to write.")] = Path("study.yaml")) -> None:
    """Write a study of where one or two scanners should hang in the lab."""
    _write("study", STUDY, out, ".yaml")


def _write(what: str, text: str, path: Path, suffix: str) -> None:
    from trackers.errors import InputError
    from twin.console import print_paths
    from twin.recording.atomic_file import open_atomic

    if path.suffix != suffix or (suffix == ".py" and not path.stem.isidentifier()):
        expected = (
            f"the name of a Python module, {suffix} included," if suffix == ".py" else f"a name ending in {suffix}"
        )
        raise InputError(f"--out {path}: is no file for a {what}; {expected} is expected")
    if path.exists():
        raise InputError(f"--out {path}: is there already; the name of a new file is expected")
    with open_atomic(path) as stream:
        stream.write(text.format(name=_name(path.with_suffix("")), file=path, module=path.stem))
    print_paths({what: path})


def _name(folder: Path) -> str:
    """Make a scenario's name from the folder's: letters, digits, '-' and '_', a letter first."""
    name = "".join(
        each if each.isascii() and (each.isalnum() or each in "-_") else "-" for each in folder.resolve().name
    )
    return name if name[:1].isalpha() else f"scenario-{name}".rstrip("-")
