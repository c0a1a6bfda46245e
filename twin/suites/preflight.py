"""Preflight: check that a suite's trackers can be made for its scenarios before any case starts; nothing is simulated.

An error names the line of the suite, or of a file that it overrides, from which the value comes.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from trackers.environment import Environment, load_environment
from trackers.errors import PLUG_IN_ERRORS, InputError, raise_faults, valid_names
from trackers.observations import Observation
from trackers.presets import PRESETS, available, make_tracker
from trackers.prior import Prior
from trackers.rig import Point2, Rig, missing_file
from trackers.tracks import Tracker
from twin.run.inputs import (
    NONE_TRUSTED,
    SCHEDULER,
    SUITE,
    ChosenTracker,
    TrustedClasses,
    choose,
    is_untrusted_scheduler,
    not_asked,
    not_trusted,
    redefined,
)
from twin.scenario import Scenario, load_scenario
from twin.scenario.housings import assumed_rig
from twin.scenario.person import STEADY
from twin.scenario.scenario import TrackerChoice
from twin.streams import stream
from twin.suites.spec import Suite, SuiteRecording, SuiteScenario
from twin.suites.variants import Variant, place_of
from twin.world.empty_room import empty_room
from twin.world.scene import scene_faults

_N_SEED = 10
"""Number of seeds that a scenario is checked with where they make a difference."""


class TrackerCheck:
    """Checker that each tracker can be made for each rig with its options and without a background; collects the faults.

    plug_ins: whether the user's own classes are on this machine too, and not only on a cluster's workers; trusted: those
    that the suite and its scenarios may name; runs: False where none will run, so that every tracker passes. A plug-in that
    raises anything but an InputError, or raises after reading the empty room, is left to its cases: its behaviour on real
    data is unknown here.
    """

    def __init__(
        self, suite: Path, *, plug_ins: bool = True, trusted: TrustedClasses = NONE_TRUSTED, runs: bool = True
    ) -> None:
        self._suite, self._runs = suite, runs
        self._plug_ins = plug_ins
        self._trusted = trusted
        self._walkable: dict[str, tuple[Point2, ...]] = {}
        self._environments: dict[Path, Environment] = {}
        self._digests: dict[str, str] = {}
        self._made: dict[tuple[str, ...], list[tuple[str, str]]] = {}
        self._faults: dict[tuple[str, str], dict[str, None]] = {}  # titles by the sentence before and after them

    def check(self, variant: Variant, scenario: Scenario, file: Path, title: str) -> str:
        """Check every tracker of a variant: its resolved scenario, the scenario's file, its title in messages.

        Returns the digest of the files given to them (see `PriorFiles.digest`).
        """
        rig = self._rig(scenario)
        prior = self._prior(variant, scenario, rig, file)
        self._check_definitions(variant, file, scenario.trackers)
        for name in variant.trackers if self._runs else ():
            choice = scenario.trackers.get(name, TrackerChoice())
            also = f"one that the scenario {scenario.name} defines"
            if self._can_be_made(variant, file, name, choice, also) and prior is not None:
                self._tell_each(variant, file, name, title, self._tried(choice, rig, scenario, name, prior))
        key = scenario.prior.model_dump_json()
        if prior is None:
            return ""
        if key not in self._digests:
            self._digests[key] = scenario.prior.digest()
        return self._digests[key]

    def check_recorded(
        self, variant: Variant, bag: Path, defined: Mapping[str, TrackerChoice], rig: Rig, prior: Prior, title: str
    ) -> None:
        """Check every tracker of a bag of the suite, with the definitions that it and the suite give.

        prior: what its prior files hold, without the empty room.
        """
        self._check_definitions(variant, bag, defined)
        for name in variant.trackers if self._runs else ():
            choice = defined.get(name, TrackerChoice())
            if self._can_be_made(
                variant, bag, name, choice, "a name that set: {trackers: {NAME: {preset: …}}} defines"
            ):
                chosen = ChosenTracker(name, choice.preset or name, choice.options)
                faults = _faults(chosen, rig, prior, 0, has_background=True)
                self._tell_each(variant, bag, name, title, faults)

    def _check_definitions(self, variant: Variant, file: Path, defined: Mapping[str, TrackerChoice]) -> None:
        for name, choice in defined.items() if self._runs else ():
            if name in available() and choice.preset not in (None, name):
                self._tell(redefined(place_of(variant, file, f"trackers.{name}.preset"), name, choice.preset))
            if name not in variant.trackers and not is_known_tracker(choice.preset or name):
                where = place_of(variant, file, f"trackers.{name}.preset" if choice.preset else f"trackers.{name}")
                self._tell(unknown_tracker(where, choice.preset or name, "a preset: next to the options"))

    def _can_be_made(self, variant: Variant, file: Path, name: str, choice: TrackerChoice, also: str) -> bool:
        """Collect an unknown or untrusted tracker as a fault; return whether it can be made here. also: else valid."""
        target = choice.preset or name
        listed = f"{variant.listed}.{variant.trackers.index(name)}"
        where = place_of(variant, file, f"trackers.{name}.preset") if choice.preset else listed
        if not is_known_tracker(target):
            self._tell(unknown_tracker(where, target, also))
        elif target not in available() and not self._trusted.has(target):
            self._tell(not_trusted(where, target, SUITE))
        elif is_untrusted_scheduler(choice, self._trusted):
            self._tell(not_asked(place_of(variant, file, f"trackers.{name}.{SCHEDULER}"), choice, SUITE))
        else:
            return target in PRESETS or self._plug_ins
        return False

    def _tell_each(
        self, variant: Variant, file: Path, name: str, title: str, faults: Iterable[tuple[str, str]]
    ) -> None:
        """Collect the faults of making a tracker, by its option or the field that lists it."""
        for option, message in faults:
            if option:
                self._tell(f"{place_of(variant, file, f'trackers.{name}.{option}')}: {message}")
            else:
                listed = f"{variant.listed}.{variant.trackers.index(name)}"
                self._tell(f"{listed}: {name!r} cannot work on ", title, f": {message}")

    def faults(self) -> list[str]:
        """Format one sentence per fault: the suite's file, the field as written by the user, what is valid."""
        parts = []
        for (start, end), titles in self._faults.items():
            first, *more = titles
            on = f"{first} and {len(more)} more like it" if more else first
            parts.append(f"{self._suite}: {start}{on}{end}")
        return parts

    def _tell(self, start: str, title: str = "", end: str = "") -> None:
        self._faults.setdefault((start, end), {})[title] = None

    def _prior(self, variant: Variant, scenario: Scenario, rig: Rig, file: Path) -> Prior | None:
        """Load the prior files of a scenario without the empty room; None where one is invalid."""
        files = scenario.prior
        missing = files.missing()
        for field, path in missing.items():
            self._tell(f"{place_of(variant, file, f'prior.{field}')}: {missing_file(field, path)}")
        if missing:
            return None
        environment = None
        if files.environment is not None:
            path = Path(files.environment)
            try:
                if path not in self._environments:
                    self._environments[path] = load_environment(path)
                environment = self._environments[path]
                environment.check(str(path), room=rig.room, area=rig.area)
            except InputError as error:
                self._tell(f"{place_of(variant, file, 'prior.environment')}: {error}")
                return None
        try:
            others = Prior.read((), files.model_copy(update={"environment": None}), rig)
        except InputError as error:
            self._tell(f"{place_of(variant, file, 'prior.background')}: {error}")
            return None
        return Prior(others.background, environment, others.learned)

    def _tried(
        self, choice: TrackerChoice, rig: Rig, scenario: Scenario, name: str, prior: Prior
    ) -> list[tuple[str, str]]:
        target, options = choice.preset or name, choice.options
        files = scenario.prior.model_dump_json()
        key = (target, json.dumps(options, sort_keys=True), rig.model_dump_json(), scenario.background, files)
        if key not in self._made:
            chosen, has_background = ChosenTracker(name, target, options), scenario.background != "none"
            self._made[key] = list(_faults(chosen, rig, prior, scenario.seed, has_background))
        return self._made[key]

    def _rig(self, scenario: Scenario) -> Rig:
        """Make the rig of every run of this scenario. Raises InputError for an invalid room."""
        if scenario.room not in self._walkable:
            self._walkable[scenario.room] = tuple((float(x), float(y)) for x, y in empty_room(scenario).walkable)
        return assumed_rig(scenario, scenario.area or self._walkable[scenario.room])


def check_trackers(scenario: Scenario, rig: Rig, source: str) -> None:
    """Raise InputError for a tracker that a scenario defines and that cannot be made for its rig with these options.

    Classes of the user's own are left to a run.
    """
    defined = {name: each for name, each in scenario.trackers.items() if ":" not in (each.preset or name)}
    for each in choose([name for name in defined if (defined[name].preset or name) in PRESETS], defined, source):
        try:
            with warnings_silenced():
                make_tracker(
                    each.target, rig, _AskedBackground(), stream(scenario.seed, "tracker", each.name), each.options
                )
        except InputError as error:
            raise InputError("\n".join(f"{source}: {line}" for line in str(error).splitlines())) from error


def seeds_checked(name: str, scenario: Scenario) -> str:
    """Check that a scenario as loaded from a file can begin with further seeds too; return which, "" if none makes a difference.

    Raises InputError with the seeds where it cannot.
    """
    seeds, seeded = range(scenario.seed, scenario.seed + _N_SEED), []
    for seed in seeds:
        try:
            seeded.append(load_scenario(name, [f"seed={seed}"]))
        except InputError as error:
            raise InputError(f"{error} (with seed {seed})") from error
    is_drawn = any(each.model_copy(update={"seed": scenario.seed}) != scenario for each in seeded)
    if not is_drawn and scenario.randomize == STEADY:
        return ""
    raise_faults(scene_faults(lambda field: f"{name}: {field}" if field else name, seeded))
    return f"checked with seeds {seeds[0]} to {seeds[-1]}, others may differ"


def check_measured(
    suite: Suite, entry: SuiteScenario | SuiteRecording, measured: Collection[str], otherwise: str
) -> None:
    """Raise InputError, one line per fault, for bounds of an entry on metrics that none of its cases has.

    measured: the metrics that they have; otherwise: why they have no others, and what is valid.
    """
    faults = []
    for name in entry.trackers or suite.trackers:
        bounds = {
            **dict.fromkeys(suite.require.get(name, {}), "the suite's "),
            **dict.fromkeys(entry.require.get(name, {}), ""),
        }
        missing = [(metric, whose) for metric, whose in bounds.items() if metric not in measured]
        faults += [f"{whose}require.{name}.{metric}: is not measured {otherwise}" for metric, whose in missing]
    raise_faults(faults)


def is_known_tracker(target: str) -> bool:
    """Return whether a name is that of a tracker of `twin list`, or may be a class, module:Class."""
    return target in available() or ":" in target


def unknown_tracker(where: str, target: str, also: str) -> str:
    """Format the error for a field that names no tracker; `also`: what else is valid there."""
    return f"{where}: there is no tracker {target!r}; {valid_names(target, available(), f', module:Class, or {also}')}"


def _faults(
    chosen: ChosenTracker, rig: Rig, prior: Prior, seed: int, has_background: bool
) -> Iterator[tuple[str, str]]:
    """Yield the faults of making a tracker: the option's path ("" without one), and the message."""
    background, target, options = _AskedBackground(), chosen.target, chosen.options
    try:
        with warnings_silenced():
            handed = replace(prior, background=background)
            tracker = make_tracker(target, rig, handed, stream(seed, "tracker", chosen.name), options)
    except InputError as error:
        unlike_a_run = background.asked and has_background
        if target in PRESETS or not unlike_a_run:
            yield from (_by_option(line, options) for line in str(error).splitlines())
        return
    except PLUG_IN_ERRORS:  # a plug-in's own fault: its case fails with its traceback, and the rest goes on
        return
    if not isinstance(tracker, Tracker):
        yield "", f"{type(tracker).__name__} has not both update(observation) and tracks(); a tracker has"


class _AskedBackground(Sequence[Observation]):
    """An empty background that records whether it was read."""

    def __init__(self) -> None:
        self.asked = False

    def __len__(self) -> int:
        self.asked = True
        return 0

    def __getitem__(self, index: Any) -> Any:
        self.asked = True
        return ()[index]


def _by_option(line: str, options: Mapping[str, Any]) -> tuple[str, str]:
    """Split a line of a tracker's error, 'tracker NAME: option.path: message', into option and message."""
    parts = line.split(": ")
    for place, part in enumerate(parts[:-1]):
        if part.split(".")[0] in options:
            return part, ": ".join(parts[place + 1 :])
    return "", ": ".join(parts[1:]) if parts[0].startswith("tracker ") else line


@contextmanager
def warnings_silenced() -> Iterator[None]:
    """Silence warnings that hold for this check only: the missing background."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(before)
