"""`twin list`, `twin schema`, `twin check`: contents, JSON schemas, checks of files, trackers, sensors and this machine."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from trackers.errors import PLUG_IN_ERRORS, InputError, PlugInError, check_no_path, valid_names
from twin import version_of
from twin.command_options import (
    PARTS,
    CheckedTracker,
    ListedPart,
    OptionsOf,
    RulesOf,
    completed_from,
    print_listed,
    shipped,
)
from twin.commands.memory import EXIT_BAD_INPUT, EXIT_DONE, EXIT_FELL_SHORT
from twin.messages import printable, sentence

_SCHEMAS = {
    "scenario": "twin.scenario.load:DrawableScenarioFile",
    "suite": "twin.suites.spec:Suite",
    "study": "twin.studies.spec:Study",
    "rig": "trackers.rig:Rig",
}
_CHECKED_S = 4.0
_PLACES = 200
"""Number of places to stand, drawn at random, that a room must have."""
_TRACKER = "a tracker, a class made as Class(rig, background, rng, **options) with update(observation) and tracks()"
_SENSOR = "a callable without arguments that returns a sensor with observe()"


def list_(
    part: ListedPart = None,
    rules: RulesOf = None,
    options: OptionsOf = None,
    cite: Annotated[bool, typer.Option("--cite", help="Print BibTeX of the papers behind the trackers.")] = False,
) -> None:
    """List scenarios, rooms, trackers, sensors, suites, studies and faults."""
    from trackers.paper_rules import bibtex, rules_markdown
    from trackers.presets import available, options_of, rules_of

    if part is not None and part not in PARTS:
        raise InputError(f"list: there is none of {part!r}; {valid_names(part, PARTS)}")
    asked = (
        [f"--rules {rules}"] * (rules is not None)
        + [f"--options {options}"] * (options is not None)
        + ["--cite"] * cite
    )
    if asked and part not in (None, "trackers"):
        raise InputError(f"{asked[0].split()[0]}: is of trackers, not of {part}")
    if len(asked) > 1:
        raise InputError(f"{asked[0]}: is a table of its own beside {asked[1].split()[0]}; one of the two is expected")
    if options is not None:
        from trackers.configuration import options_markdown
        from twin.run.inputs import import_from_here

        import_from_here([options])
        typer.echo(options_markdown(*options_of(options)), nl=False)
        return
    if rules is not None:
        typer.echo(rules_markdown(rules, rules_of(rules)), nl=False)
        return
    if cite:
        typer.echo(bibtex(each.citation for each in available().values()))
        return
    for title in PARTS if part is None else [part]:
        print_listed(title, _described(title, with_sensors=part is not None))


def _described(part: str, *, with_sensors: bool) -> dict[str, str]:
    """Return the entries of one part, each with a line of description; scenarios with sensors if asked, which takes a while."""
    from trackers.presets import available
    from twin import models

    if part == "trackers":
        return {name: preset.summary for name, preset in available().items()}
    if part in ("sensors", "faults"):
        return dict(models.SENSOR_KINDS if part == "sensors" else models.FAULTS)
    found = {name: models.first_description(part, name) for name in models.names(part)}
    if part == "scenarios" and with_sensors:
        return {name: f"{text} Sensors: {', '.join(models.scenario_sensors(name))}." for name, text in found.items()}
    return found


def schema(
    kind: Annotated[
        str,
        typer.Argument(help="'scenario', 'suite', 'study' or 'rig'.", autocompletion=completed_from(lambda: _SCHEMAS)),
    ] = "scenario",
) -> None:
    """Print the JSON schema of a scenario, a suite, a study or a rig, for editors."""
    import json

    if kind not in _SCHEMAS:
        raise InputError(f"schema: there is none of {kind!r}; {valid_names(kind, _SCHEMAS)}")
    typer.echo(json.dumps(_imported(_SCHEMAS[kind], kind, "").model_json_schema(), indent=2))


def check(
    subjects: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[FILE|NAME]...",
            help="Scenarios, rooms, suites, studies or rigs, as files or by their shipped names; trackers or sensors as "
            "module:name. Default: this machine.",
            autocompletion=shipped("scenarios", "rooms", "suites", "studies"),
        ),
    ] = None,
    tracker: CheckedTracker = None,
    sensor: Annotated[
        str | None,
        typer.Option(
            metavar="MODULE:MAKE", help="Check a sensor instead: what MAKE() returns, before five people in the lab."
        ),
    ] = None,
    allow_plugins: Annotated[
        bool, typer.Option("--allow-plugins", help="Run the classes (module:Class) that a suite or a study names.")
    ] = False,
) -> None:
    """Check files without running them, the contract of a tracker or a sensor, or that this machine renders.

    Of several, all are checked; the exit code is the greatest of theirs.
    """
    from twin.run.inputs import import_from_here

    if sum(bool(each) for each in (subjects, tracker, sensor)) > 1:
        raise InputError("FILE, --tracker, --sensor: one of the three is expected")
    import_from_here([*(subjects or ()), tracker or "", sensor or ""], files_trusted=allow_plugins)
    if tracker is not None or sensor is not None:
        _check_contract("tracker" if tracker is not None else "sensor", tracker or sensor or "")
    elif not subjects:
        for line in check_machine():
            typer.echo(line)
    elif len(subjects) == 1:
        _check_subject(subjects[0], allow_plugins)
    elif code := max(_code_of_check(each, allow_plugins) for each in subjects):
        raise typer.Exit(code)


def _code_of_check(subject: str, allow_plugins: bool) -> int:
    """Check one of several; return its exit code, its error printed."""
    try:
        _check_subject(subject, allow_plugins)
    except (InputError, PlugInError) as error:
        sys.stdout.flush()
        sys.stderr.write(f"twin: {sentence(str(error))}\n")
        return EXIT_BAD_INPUT if isinstance(error, InputError) else EXIT_FELL_SHORT
    except typer.Exit as end:
        return end.exit_code
    return EXIT_DONE


def _check_subject(subject: str, allow_plugins: bool) -> None:
    kind = kind_of(subject)
    if kind in ("tracker", "sensor"):
        _check_contract(kind, subject)
        return
    typer.echo(printable(f"{subject}: {checked_file(kind, subject, allow_plugins)}"))
    _print_faults(subject, room_faults(subject) if kind == "room" else [])


def _check_contract(kind: str, name: str) -> None:
    faults, tried = check_own_tracker(name) if kind == "tracker" else (check_own_sensor(name), "")
    _print_faults(name, faults)
    typer.echo(f"{name}: keeps the contract of a {kind}{tried}")


def _print_faults(name: str, faults: list[str]) -> None:
    """Print a line per fault; end the command as fallen short where there is one."""
    for fault in faults:
        typer.echo(printable(f"{name}: {fault}"))
    if faults:
        raise typer.Exit(EXIT_FELL_SHORT)


def room_faults(name: str) -> list[str]:
    """Return a sentence for each seat and bed of a room, shipped or a user's file, to which an adult cannot come."""
    from twin.view.room_sheet import empty_world
    from twin.world.scene import unusable_furniture

    return unusable_furniture(empty_world(name).scene)


def kind_of(subject: str) -> str:
    """Return the kind of a file or name: scenario, room, suite, study, rig, tracker or sensor.

    A YAML file is of the kind that knows most of its fields and misses fewest of its own. Raises InputError for none.
    """
    from trackers.presets import available
    from trackers.rig import Rig
    from trackers.user_input.plain_data import parse_yaml
    from trackers.user_input.text_file import read_text
    from twin import models
    from twin.scenario.load import ScenarioFile
    from twin.studies.spec import Study
    from twin.suites.spec import Suite

    valid = "the path of a .yaml or .xml file, a shipped name (see `twin list`) or module:name is expected"
    known = {
        "scenario": models.names("scenarios"),
        "room": models.names("rooms"),
        "tracker": available(),
        "suite": models.names("suites"),
        "study": models.names("studies"),
    }
    if found := next((kind for kind, names in known.items() if subject in names), None):
        return found
    if Path(subject).suffix == ".xml":
        return "room"
    if Path(subject).suffix in (".yaml", ".yml"):
        content = parse_yaml(read_text(Path(subject), "a scenario, suite, study or rig"), subject, "fields by name")
        scores = {}
        for kind, described in (("scenario", ScenarioFile), ("suite", Suite), ("study", Study), ("rig", Rig)):
            required = {name for name, field in described.model_fields.items() if field.is_required()}
            missing = set() if kind == "scenario" and "extends" in content else required - set(content)
            scores[kind] = len(set(content) & set(described.model_fields)), -len(missing)
        best = max(scores, key=lambda kind: scores[kind])
        if not scores[best][0]:
            raise InputError(f"{subject}: is no scenario, suite, study or rig; `twin schema KIND` describes the fields")
        return best
    if ":" not in subject:
        check_no_path(subject if subject.endswith(".py") else "", subject)
        what = "no file that is known here" if Path(subject).exists() else "there is no such file or name"
        raise InputError(f"{subject}: {what}; {valid}")
    made = _imported(subject, subject, valid)
    if not isinstance(made, type) or hasattr(made, "observe"):
        return "sensor"
    if not hasattr(made, "update") and not hasattr(made, "tracks"):
        raise InputError(f"{subject}: has the methods of neither; {_TRACKER}, or {_SENSOR}, is expected")
    return "tracker"


def _imported(name: str, source: str, valid: str) -> Any:
    """Return what `module:name` names. Raises InputError where there is none, PlugInError where its module raises."""
    from importlib import import_module

    from trackers.check import raised

    check_no_path(name, source)
    try:
        return getattr(import_module(name.partition(":")[0]), name.partition(":")[2])
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(f"{source}: {error}; {valid}") from error
    except PLUG_IN_ERRORS as error:
        raise PlugInError(f"{source}: the import {raised(error)}") from error


def checked_file(kind: str, name: str, allow_plugins: bool = False) -> str:
    """Load a file with all that it names, build its room, and return one line about it. Raises InputError naming each fault."""
    from dataclasses import replace

    import numpy as np

    from trackers.rig import Rig
    from twin.console import print_warnings
    from twin.recording.rig_of_bag.rig_guess import undecided_lines
    from twin.run.feed import unfit_scanners
    from twin.run.inputs import TrustedClasses
    from twin.scenario import load_scenario
    from twin.scenario.run_size import check_size
    from twin.studies.preflight import prepare
    from twin.suites.expansion import expand
    from twin.suites.preflight import check_trackers, seeds_checked
    from twin.suites.run import idle_changes, idle_settings
    from twin.suites.spec import load_suite
    from twin.view.room_sheet import empty_world, extent_text, left_out
    from twin.world.simulation import Simulation

    trusted = TrustedClasses(every=allow_plugins)
    match kind:
        case "scenario":
            scenario = load_scenario(name)
            check_size(scenario)
            with Simulation(scenario) as simulation:
                print_warnings([*simulation.warnings, *unfit_scanners(simulation)])
                check_trackers(scenario, simulation.rig, name)
            about = f"people: {len(scenario.people)}, sensors: {', '.join(scenario.sensors)}, {scenario.duration_s:g} s"
            about += f"; {checked}" if (checked := seeds_checked(name, scenario)) else ""
        case "room":
            scene = empty_world(name).scene
            print_warnings(left_out(name))
            replace(scene.ground, source=name).free_places(_PLACES, np.random.default_rng(0))
            seats = ", ".join(scene.ground.furniture) or "none"
            about = f"{extent_text(scene.walkable, [each.corners for each in scene.ground.obstacles])}; seats and beds: {seats}"
        case "suite":
            suite, path = load_suite(name)
            cases = expand(suite, path, trusted=trusted, limits=True, scenes=True)
            print_warnings([*idle_settings(suite), *idle_changes(cases)])
            about = f"cases: {len(cases)}"
        case "study":
            study = prepare(name, trusted=trusted)
            print_warnings(study.warnings)
            about = f"devices: {', '.join(study.study.devices)}"
        case _:
            about = f"sensors: {', '.join(Rig.load(name).sensors)}"
            print_warnings([each.line for each in undecided_lines(name)])
    return f"a valid {kind}; {about}"


def check_own_tracker(name: str) -> tuple[list[str], str]:
    """List contract violations of a tracker on five people in the lab, and describe the runs that were tried."""
    from trackers.check import check_tracker, runs_of
    from trackers.presets import make_tracker
    from twin.scenario import load_scenario
    from twin.world.simulation import Simulation

    with Simulation(load_scenario("lab-five-people", [f"duration_s={_CHECKED_S}"])) as simulation:
        rig, background, observations = simulation.rig, simulation.background(), list(simulation)
    tried = f", tried on {_CHECKED_S:g} s of five people ({', '.join(rig.sensors)}): {', '.join(runs_of(observations))}"
    return check_tracker(lambda *made: make_tracker(name, *made), rig, observations, background), tried


def check_own_sensor(name: str) -> list[str]:
    """List contract violations of a sensor of `module:make` among five people. Raises InputError for no callable."""
    from trackers.check import raised
    from twin.scenario import load_scenario
    from twin.sensors.check import check_sensor
    from twin.world.world import World

    make = _imported(name, f"--sensor {name}", "MODULE:MAKE, a callable that returns a sensor, is expected")
    try:
        made = make()
    except TypeError as error:
        raise InputError(
            f"--sensor {name}: {error}; {_SENSOR} is expected; {_TRACKER}, is checked by --tracker {name}"
        ) from error
    except PLUG_IN_ERRORS as error:
        return [f"making it {raised(error)}"]
    return check_sensor(made, World(load_scenario("lab-five-people")))


def check_machine() -> Iterator[str]:
    """Yield one line per item checked; raise InputError, with a remedy, where the machine cannot render."""
    from importlib.metadata import version

    from twin import models
    from twin.sensors.check import check_rendering

    yield f"roomtwin    {version_of('roomtwin')}"
    yield f"mujoco      {version('mujoco')}"
    yield from check_rendering(models.find("rooms", "lab"))
    yield "this machine can render"
