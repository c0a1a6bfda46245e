"""`twin list`, `twin schema` and `twin check`: what there is, how it is described, and whether this machine can draw it."""

from __future__ import annotations

from typing import Annotated

import typer


def list_() -> None:
    """What there is: scenarios, rooms, trackers, sensors, faults."""
    from trackers.presets import available
    from twin import models

    typer.echo("scenarios")
    for name in models.names("scenarios"):
        typer.echo(f"  {name:24}{models.first_description(name)}")
    typer.echo("rooms")
    for name in models.names("rooms"):
        typer.echo(f"  {name}")
    typer.echo("trackers")
    for name, preset in available().items():
        typer.echo(f"  {name:24}{preset.description}")
    typer.echo("sensors")
    for name, description in models.SENSOR_KINDS.items():
        typer.echo(f"  {name:24}{description}")
    typer.echo("suites")
    for name in models.names("suites"):
        typer.echo(f"  {name}")
    typer.echo("studies")
    for name in models.names("studies"):
        typer.echo(f"  {name}")
    typer.echo("faults")
    for name, description in models.FAULTS.items():
        typer.echo(f"  {name:24}{description}")


def schema(
    kind: Annotated[str, typer.Argument(help="'scenario', 'suite', 'study' or 'rig'.")] = "scenario",
) -> None:
    """The JSON schema of a scenario, a suite, a study or a rig, for editors."""
    import json

    from trackers.errors import InputError

    if kind == "scenario":
        from twin.scenario.load import DrawableScenarioFile as Described
    elif kind == "suite":
        from twin.suites.description import Suite as Described
    elif kind == "study":
        from twin.studies.description import Study as Described
    elif kind == "rig":
        from trackers.rig import Rig as Described
    else:
        raise InputError(f"schema: there is none of {kind!r}; valid are scenario, suite, study, rig")
    typer.echo(json.dumps(Described.model_json_schema(), indent=2))


def check() -> None:
    """Can this machine render: renderer, versions, frame time; and what to do if not."""
    from twin.check import check_machine

    for line in check_machine():
        typer.echo(line)
