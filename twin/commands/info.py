"""`twin list`, `twin schema` and `twin check`: contents, JSON schemas, and a check of this machine."""

from __future__ import annotations

import shutil
import sys
import textwrap
import time
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from typing import Annotated

import typer

from twin.messages import printable

_DESCRIBED = "scenarios", "suites", "studies"
_SIDE_PX = 400
_FRAMES = 5
_LEAST_COLUMN = 30
"""A column of text that is narrower is hard to read."""


def list_(
    part: Annotated[str | None, typer.Argument(help="Only one of these parts, e.g. trackers; default: all.")] = None,
    rules: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Print the rules of a paper's own system (e.g. laser-fisheye-imm-paper) as a table: stated by the paper, filled "
            "where it is silent, chosen where it is empirical.",
        ),
    ] = None,
) -> None:
    """List scenarios, rooms, trackers, sensors, suites, studies and faults."""
    from trackers.errors import InputError
    from trackers.paper_rules import rules_markdown
    from trackers.presets import available, rules_of
    from twin import models

    if rules is not None:
        if part not in (None, "trackers"):
            raise InputError(f"--rules: is of trackers, not of {part}")
        typer.echo(rules_markdown(rules, rules_of(rules)), nl=False)
        return

    described = {
        folder: {name: models.first_description(folder, name) for name in models.names(folder)} for folder in _DESCRIBED
    }
    parts = {
        "scenarios": described["scenarios"],
        "rooms": dict.fromkeys(models.names("rooms"), ""),
        "trackers": {name: preset.description for name, preset in available().items()},
        "sensors": models.SENSOR_KINDS,
        "suites": described["suites"],
        "studies": described["studies"],
        "faults": models.FAULTS,
    }
    if part is not None and part not in parts:
        raise InputError(f"list: there is none of {part!r}; valid are {', '.join(parts)}")
    for title, entries in parts.items():
        if part not in (None, title):
            continue
        typer.echo(title)
        for line in _columns(entries, shutil.get_terminal_size().columns if sys.stdout.isatty() else None):
            typer.echo(line)


def _columns(entries: Mapping[str, str], width: int | None) -> Iterator[str]:
    """Format names and descriptions in two columns, within `width` characters (None: one line per entry, of any
    length).

    Where a terminal has no room for two columns, a description stands under its name.
    """
    column = max(map(len, entries)) + 4
    for name, description in entries.items():
        if width is None:
            yield printable(f"  {name:{column - 2}}{description}".rstrip())
        elif width - column >= _LEAST_COLUMN:
            first, *rest = textwrap.wrap(printable(description), width - column) or [""]
            yield printable(f"  {name:{column - 2}}{first}".rstrip())
            yield from (" " * column + line for line in rest)
        else:
            yield printable(f"  {name}")
            yield from textwrap.wrap(printable(description), width, initial_indent="    ", subsequent_indent="    ")


def schema(
    kind: Annotated[str, typer.Argument(help="'scenario', 'suite', 'study' or 'rig'.")] = "scenario",
) -> None:
    """Print the JSON schema of a scenario, a suite, a study or a rig, for editors."""
    import json

    from trackers.errors import InputError

    if kind == "scenario":
        from twin.scenario.load import DrawableScenarioFile as Described
    elif kind == "suite":
        from twin.suites.spec import Suite as Described
    elif kind == "study":
        from twin.studies.spec import Study as Described
    elif kind == "rig":
        from trackers.rig import Rig as Described
    else:
        raise InputError(f"schema: there is none of {kind!r}; valid are scenario, suite, study, rig")
    typer.echo(json.dumps(Described.model_json_schema(), indent=2))


def check() -> None:
    """Check that this machine can render: renderer, versions, frame time; and what to do if not."""
    for line in check_machine():
        typer.echo(line)


def check_machine() -> Iterator[str]:
    """Yield one line per thing checked; raise InputError, with what to do, where the machine cannot render."""
    import mujoco
    import numpy as np

    from twin import models
    from twin.sensors.render import OffscreenRenderer
    from twin.sensors.render_scene import RenderView

    yield f"roomtwin    {version('roomtwin')}"
    yield f"mujoco      {mujoco.__version__}"
    model = mujoco.MjModel.from_xml_path(str(models.find("rooms", "lab")))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    with OffscreenRenderer(model) as renderer:
        info = renderer.gl_info()
        yield f"renderer    {info.renderer}"
        yield f"OpenGL      {info.version}"
        pixels = np.zeros((_SIDE_PX, _SIDE_PX, 4), dtype=np.uint8)
        ahead = RenderView((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), -1.0, 1.0, -1.0, 1.0, (0, 0, _SIDE_PX, _SIDE_PX))
        eye_m = np.array([0.0, 0.0, 1.05])
        spent_ms = []
        for _ in range(_FRAMES):
            start = time.perf_counter()
            renderer.render(data, eye_m, [ahead], pixels)
            spent_ms.append(1e3 * (time.perf_counter() - start))
    yield f"frame time  {np.median(spent_ms):.1f} ms for {_SIDE_PX} × {_SIDE_PX} of the lab"
    yield "this machine can render"
