"""Preflight of a study: resolve scenarios, trackers and candidate poses; report every mistake before writing anything."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trackers.configuration import Strict
from trackers.errors import InputError, raise_faults, valid_names
from trackers.presets import make_tracker
from trackers.prior import Prior
from trackers.tracks import unused_sensors
from twin import models
from twin.run.inputs import NONE_TRUSTED, STUDY, ChosenTracker, TrustedClasses, choose
from twin.scenario import Scenario, load_scenario
from twin.scenario.housings import assumed_rig
from twin.scenario.sensor_descriptions import FloorDescription
from twin.streams import stream
from twin.studies.apply_placement import apply_placement
from twin.studies.candidate_set import CandidateSet
from twin.studies.spec import Study, StudyScenario, load_study, scenario_key
from twin.studies.visibility import floor_cells, is_scanner, looking_sensors
from twin.suites.preflight import is_known_tracker, unknown_tracker, warnings_silenced
from twin.suites.variants import deeper, format_overrides
from twin.world.scene import Scene, build_scene, scene_faults


@dataclass(frozen=True, eq=False)
class PreparedStudy:
    """A study with all that its file names: scenarios by key, held-out ones too, trackers, and the candidate set.

    warnings: one per field that has no effect.
    """

    study: Study
    path: Path
    scenarios: dict[str, Scenario]
    files: dict[str, Path]
    held_out: dict[str, Scenario]
    trackers: tuple[ChosenTracker, ...]
    scene: Scene
    candidate_set: CandidateSet
    warnings: tuple[str, ...]

    @property
    def scenario(self) -> Scenario:
        """The first scenario: its room and sensors are the study's."""
        return next(iter(self.scenarios.values()))


def prepare(name: str | Path, *, seed_offset: int = 0, trusted: TrustedClasses = NONE_TRUSTED) -> PreparedStudy:
    """Load and check a study, without simulating or writing. Raises InputError, one line per mistake.

    seed_offset: added to every seed of the study; trusted: classes that it and its scenarios may name.
    """
    written, path = load_study(name)
    study = _with_offset(written, seed_offset)
    scenarios, files = _loaded(study.scenarios, path, "scenarios")
    others, _ = _loaded(study.held_out.scenarios if study.held_out else (), path, "held_out.scenarios")
    first = next(iter(scenarios.values()))
    every = {f"scenarios.{key}": each for key, each in scenarios.items()}
    every |= {f"held_out.scenarios.{key}": each for key, each in others.items()}
    raise_faults([*_device_faults(study, every, path), *_tracker_faults(study, path, scenarios)])
    raise_faults(_scene_faults(study, list(scenarios.values()), list(others.values()), path))
    chosen = tuple(choose(study.trackers, first.trackers, str(path), trusted, STUDY)) if study.trackers else ()
    scene = build_scene(first, pictures=False)
    candidate_set = CandidateSet.of(study, first, scene, str(path))
    raise_faults([*_kind_faults(study, candidate_set, path), *_cell_faults(study, scene, path)])
    raise_faults(_unused_sensor_faults(study, candidate_set, chosen, scene, path))
    warnings = tuple(f"{path}: {each}" for each in _idle_fields(written, candidate_set))
    return PreparedStudy(study, path, scenarios, files, scenarios | others, chosen, scene, candidate_set, warnings)


def _with_offset(study: Study, offset: int) -> Study:
    def moved(seeds: Sequence[int]) -> tuple[int, ...]:
        return tuple(seed + offset for seed in seeds)

    held = study.held_out
    return study.model_copy(
        update={
            "seeds": moved(study.seeds),
            "held_out": held and held.model_copy(update={"seeds": moved(held.seeds)}),
            "coverage": study.coverage.model_copy(update={"seeds": moved(study.coverage.seeds)}),
        }
    )


def _loaded(entries: Sequence[StudyScenario], path: Path, field: str) -> tuple[dict[str, Scenario], dict[str, Path]]:
    found, files, faults = {}, {}, []
    for number, entry in enumerate(entries):
        key = scenario_key(number, entry) if field == "scenarios" else f"held-out {scenario_key(number, entry)}"
        try:
            file = models.find("scenarios", entry.scenario, path.parent, f"{path}: {field}.{number}.scenario")
            found[key] = load_scenario(file, suites=format_overrides(entry.set), folder=path.parent)
            files[key] = file
        except InputError as error:
            faults += [
                line if line.startswith(str(path)) else f"{path}: {field}.{number}: {line}"
                for line in str(error).splitlines()
            ]
    raise_faults(faults)
    return found, files


def _device_faults(study: Study, scenarios: dict[str, Scenario], path: Path) -> Iterator[str]:
    """Report devices of missing or misplaced sensors, and scenarios in other rooms."""
    first = next(iter(scenarios.values()))
    for key, scenario in scenarios.items():
        if scenario.room != first.room:
            yield f"{path}: {key}: is in the room {scenario.room}, and the first in {first.room}; one room is expected of a study"
        for name, device in study.devices.items():
            named = [*(("sensors", each) for each in device.sensors), *(("together", each) for each in device.together)]
            for field, sensor in named:
                if sensor not in scenario.sensors:
                    yield (
                        f"{path}: devices.{name}.{field}: {scenario.name} has no sensor {sensor!r}; "
                        f"{valid_names(sensor, scenario.sensors)}"
                    )
                elif scenario.sensors[sensor].kind != first.sensors[sensor].kind:
                    yield f"{path}: {key}: {sensor!r} is another kind of sensor than in the first scenario; the same is expected"
            if device.housing is not None and device.housing not in scenario.housings:
                valid = valid_names(device.housing, scenario.housings, none="none, as it has no housings")
                yield f"{path}: devices.{name}.housing: {scenario.name} has no housing {device.housing!r}; {valid}"
            elif device.housing is not None and not device.sensors_in(scenario):
                yield f"{path}: devices.{name}.housing: nothing hangs on {device.housing!r}; a housing with sensors is expected"
    for name, device in study.devices.items():
        for sensor in (*device.sensors, *device.together):
            if isinstance(first.sensors.get(sensor), FloorDescription) and (
                device.walls or device.ceiling or device.together
            ):
                yield (
                    f"{path}: devices.{name}: {sensor!r} is a pressure floor, which lies on the floor; places or a box with "
                    "z = 0 are expected"
                )


def _scene_faults(study: Study, own: Sequence[Scenario], others: Sequence[Scenario], path: Path) -> Iterator[str]:
    """Report scenarios that cannot begin with one of their seeds, by whatever is not placed."""
    held = study.held_out
    fields = [("scenarios", study.scenarios, own), ("held_out.scenarios", held.scenarios if held else (), others)]
    validating = held.seeds if held else ()
    covering = study.coverage.seeds if any(each.kind == "coverage" for each in study.objectives) else ()
    for field, entries, scenarios in fields:
        tracked = (
            (*(study.seeds[: study.search.replicates[-1]] if study.trackers else ()), *validating, *covering)
            if scenarios is own
            else validating
        )
        for number, (entry, scenario) in enumerate(zip(entries, scenarios, strict=True)):
            here = f"{field}.{number}"

            def place(of: str, entry: StudyScenario = entry, here: str = here) -> str:
                reached = next((each for path in reversed(entry.set) if (each := deeper(path, of))), None)
                return f"{here}.set.{reached}" if reached and of else f"{here} ({entry.scenario}){f': {of}' * bool(of)}"

            seeded = [scenario.model_copy(update={"seed": seed}) for seed in dict.fromkeys(tracked) or (scenario.seed,)]
            moved = set(scenario.sensors) - study.kept_sensors(scenario)
            yield from (f"{path}: {each}" for each in scene_faults(place, seeded, moved))


def _tracker_faults(study: Study, path: Path, scenarios: dict[str, Scenario]) -> Iterator[str]:
    first = next(iter(scenarios.values()))
    for place, name in enumerate(study.trackers):
        choice = first.trackers.get(name)
        target = (choice.preset if choice else None) or name
        if not is_known_tracker(target):
            where = f"{path}: trackers.{place}"
            yield unknown_tracker(where, target, "one that the first scenario defines")


def _kind_faults(study: Study, candidate_set: CandidateSet, path: Path) -> Iterator[str]:
    """Report kinds that are no valid sensor, once each; faults that depend on the pose are reported by its trials."""
    for name, device in study.devices.items():
        for number, kind in enumerate(device.kinds):
            if not kind.set:
                continue
            mine = [
                candidate_set.poses[each]
                for each in candidate_set.by_device[name]
                if candidate_set.poses[each].kind == number
            ]
            faults = []
            for pose in mine[:: max(1, len(mine) // 20)]:
                try:
                    apply_placement(study, candidate_set.scenario, [pose])
                    break
                except InputError as error:
                    faults.append(str(error))
            else:
                reason = faults[0].splitlines()[0] if faults else "has no place"
                yield f"{path}: devices.{name}.kinds.{number}.set: {reason}"


def _cell_faults(study: Study, scene: Scene, path: Path) -> Iterator[str]:
    """Report cells of the floor too large for the tracked area."""
    area, cell_m = np.array(scene.area, float), study.coverage.cell_m
    if study.coverage.of == "floor" and not len(floor_cells(area, cell_m)):
        wide_m, deep_m = np.ptp(area, axis=0)
        yield (
            f"{path}: coverage.cell_m: a cell of {cell_m:g} m has no place in the tracked area of {wide_m:.3g} m x "
            f"{deep_m:.3g} m; a smaller one is expected"
        )


def _unused_sensor_faults(
    study: Study, candidate_set: CandidateSet, chosen: Sequence[ChosenTracker], scene: Scene, path: Path
) -> list[str]:
    """Report trackers that cannot work on a placement, or that ignore moved sensors though an objective needs them.

    The search would pay for them in vain; coverage and price need no tracker.
    """
    validated, kept = {objective.tracker for objective in study.validated}, study.kept_sensors(candidate_set.scenario)
    area = tuple((float(x), float(y)) for x, y in scene.area)
    faults = []
    with warnings_silenced():
        for example in _examples(study, candidate_set):
            try:
                scenario = apply_placement(
                    study, candidate_set.scenario, [candidate_set.poses[each] for each in example]
                )
            except InputError:  # reported with the trial
                continue
            rig = assumed_rig(scenario, area)
            for place, each in enumerate(chosen):
                rng = stream(scenario.seed, "tracker", each.name)
                try:
                    tracker = make_tracker(each.target, rig, Prior.read((), scenario.prior, rig), rng, each.options)
                except InputError as error:
                    sensors = ", ".join(scenario.sensors)
                    faults.append(
                        f"{path}: trackers.{place}: {each.name!r} cannot work on a placement of {sensors}: {error}"
                    )
                    continue
                ignored = [name for name in unused_sensors(tracker) if name not in kept]
                if ignored and each.name in validated:
                    faults.append(
                        f"{path}: trackers.{place}: {each.name!r} makes no use of {', '.join(ignored)}, which the study moves; a "
                        "tracker that uses what is placed, or other sensors under devices, is expected"
                    )
    return faults


def _idle_fields(study: Study, candidate_set: CandidateSet) -> Iterator[str]:
    """Yield a clause for each tracker that no objective uses, each price of nothing, and each field without effect here."""
    used = {objective.tracker for objective in study.validated}
    for name in study.trackers:
        if name not in used:
            yield f"trackers: no objective uses {name}; it is run for the table of candidates alone"
    if not candidate_set.prices.any():
        priced = [f"objectives.{place}" for place, each in enumerate(study.objectives) if each.kind == "price"]
        priced += ["cheapest_within"] * bool(study.cheapest_within) + ["constraints.budget"] * bool(
            study.constraints.budget
        )
        for field in priced:
            yield f"{field}: decides nothing, as every placement costs nothing; a price of a device is expected"
    search, coverage, scenario = study.search, study.coverage, candidate_set.scenario
    scanners = {is_scanner(scenario, name) for name in looking_sensors(scenario)}
    fields: list[tuple[str, Strict, str, bool, str]] = [
        ("search", search, "candidates, generation, seed", search.method == "optuna", "search.method optuna"),
        ("search", search, "limit_s", search.method == "exact", "search.method exact"),
        ("search", search, "replicates", bool(study.trackers), "trackers"),
        ("", study, "seeds", bool(study.trackers), "trackers"),
        ("coverage", coverage, "cell_m, heights_m", coverage.of == "floor", "coverage.of floor"),
        ("coverage", coverage, "px_per_m, target", False in scanners, "cameras"),
        ("coverage", coverage, "beams", True in scanners, "scanners"),
    ]
    for place, each in enumerate(study.objectives):
        here = f"objectives.{place}"
        fields.append((here, each, "over", each.kind == "metric", "kind metric"))
        fields.append((here, each, "quantile", each.over == "quantile", "over quantile"))
        fields.append((here, each, "form", each.kind == "coverage", "kind coverage"))
    for name, each in study.devices.items():
        here = f"devices.{name}"
        fields.append((here, each, "yaw_every_deg", each.yaw_deg is not None, "yaw_deg"))
        fields.append((here, each, "tilt_every_deg", each.tilt_deg is not None, "tilt_deg"))
    for where, model, names, has_effect, owner in fields:
        for name in names.split(", "):
            if not has_effect and getattr(model, name) != type(model).model_fields[name].default:
                yield f"{'.'.join(filter(None, (where, name)))}: has no effect without {owner}"


def _examples(study: Study, candidate_set: CandidateSet) -> Iterator[tuple[int, ...]]:
    """Yield one placement per kind of each device, with as many as allowed and as few others as possible."""
    for name, device in study.devices.items():
        for kind in range(len(device.kinds)):
            chosen: list[int] = []
            for other, each in study.devices.items():
                wanted = each.counts[1] if other == name else max(1, each.counts[0])
                numbers = candidate_set.by_device[other]
                mine = [n for n in numbers if candidate_set.poses[n].kind == kind] if other == name else numbers
                step = max(1, len(mine) // 40)
                for number in mine[::step]:
                    if wanted and number not in chosen and not candidate_set.conflict([*chosen, number]):
                        chosen.append(number)
                        wanted -= 1
            if chosen:
                yield tuple(sorted(chosen))
