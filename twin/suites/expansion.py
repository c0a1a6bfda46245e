"""Expand a suite to cases (scenario × overrides × seed × tracker), all checked before the first one runs."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path

from trackers.errors import InputError, raise_faults
from trackers.prior import Prior
from trackers.rig import NO_PRIOR, PriorFiles
from trackers.user_input.text_file import refuse_unless_lifted
from twin import models
from twin.recording.reader import Recording
from twin.recording.tables import read_truth
from twin.run.inputs import NONE_TRUSTED, TrustedClasses, defined_trackers, files_for, scenario_of
from twin.run.tracker_runner import file_name
from twin.scenario import load_scenario
from twin.scenario.load import dump_scenario
from twin.scenario.run_size import RunSize, check_size, size_of
from twin.scenario.scenario import Scenario, TrackerChoice
from twin.suites.cache_keys import (
    Provenance,
    RecordedInput,
    bags_of,
    people_key,
    provenance_of,
    recording_key,
    room_digest,
)
from twin.suites.metrics import METRICS, RECORDING_METRICS
from twin.suites.preflight import TrackerCheck, check_measured
from twin.suites.spec import Overrides, Suite
from twin.suites.variants import Variant, format_overrides, place_of, recorded_variant, variants
from twin.world.scene import scene_faults

MOST_CASES = 5000


def with_variant(scenario: str, variant: str) -> str:
    """Name a scenario with its variant, if any."""
    return f"{scenario} ({variant})" if variant else scenario


@dataclass(frozen=True)
class Case:
    """One resolved scenario, recorded with one seed, and one tracker on it.

    overrides: all 'path=value' texts; variant: those that distinguish it from the suite's other cases of the scenario;
    report: True for a page of its own; require: bounds that its tracker has to reach.
    """

    id: str
    scenario: str
    variant: str
    overrides: tuple[str, ...]
    seed: int
    tracker: str
    limit_s: float
    report: bool
    require: Mapping[str, str]
    resolved: str  # YAML of the simulation, without trackers and their prior
    tracker_changes: tuple[str, ...]  # 'trackers.NAME=...' for those defined by the scenario
    prior: PriorFiles
    provenance: Provenance  # by content: other files make another case
    recipe: str  # key of its recording without the renderer
    size: RunSize  # of its recording
    people: str = ""
    """Key of its people's motion: cases with the same key differ in their sensors alone."""
    bag: RecordedInput | None = None
    """Bag that is tracked as it is; None: the recording of `resolved`."""

    @property
    def tracking_changes(self) -> tuple[str, ...]:
        """Overrides for `twin track` of the recording: the scenario's tracker definitions and the files given to trackers."""
        files: Overrides = {} if self.prior == NO_PRIOR else {"prior": self.prior.model_dump(exclude_none=True)}
        return (*self.tracker_changes, *format_overrides(files))

    def check_files(self) -> None:
        """Raise InputError where bag, room, or files given to trackers are missing or changed."""
        if self.bag is not None:
            if RecordedInput.of(self.bag.path, self.bag.rig, self.bag.truth) != self.bag:
                raise InputError(
                    f"{self.id}: {self.bag.path}, its rig or its truth changed after the suite was started; --resume tracks it "
                    "as it is now"
                )
        elif recording_key(self.resolved, "") != self.recipe:
            raise InputError(
                f"{self.id}: its room changed after the suite was started; --resume records it as it is now"
            )
        self.prior.check(self.id)
        if self.prior.digest() != self.provenance.prior:
            described = ", ".join(map(str, self.prior.paths().values()))
            raise InputError(
                f"{self.id}: {described}: changed after the suite was started; --resume tracks with what it is now"
            )


def check_case_count(suite: Suite, path: Path) -> None:
    """Raise InputError for a suite of more than MOST_CASES cases, without making them."""
    if suite.n_case > MOST_CASES:
        refuse_unless_lifted(
            f"{path}: has {suite.n_case} cases (seeds × grid × variants × trackers)", f"at most {MOST_CASES}"
        )


def expand(
    suite: Suite,
    path: Path,
    changes: Sequence[str] = (),
    *,
    plug_ins: bool = True,
    trusted: TrustedClasses = NONE_TRUSTED,
    runs: bool = True,
    limits: bool = False,
    scenes: bool = False,
) -> list[Case]:
    """Expand a suite to its cases, those of one recording in sequence.

    changes: 'path=value' texts for every case, which keeps its id, so that two runs can be compared; plug_ins: whether to
    check the user's own trackers too, which only some machines have; trusted: classes that the suite and its scenarios may
    name; runs: False where no tracker will run, so that none is checked; limits: whether to refuse a recording larger than
    `twin.scenario.run_size` allows; scenes: whether to check, for each seed, that the simulation can begin (`check_scene`).
    Raises InputError, one line per fault, for invalid scenarios, overrides and trackers, for those that do not fit the
    scenario's rig, and for cases given twice. Nothing is simulated.
    """
    cases: dict[str, Case] = {}
    check = TrackerCheck(path, plug_ins=plug_ins, trusted=trusted, runs=runs)
    faults = [
        f"--set {change}: a suite has its seeds under seeds:; --seed N, which adds to each, is expected"
        for change in changes
        if change.partition("=")[0].strip() == "seed"
    ]
    checked: list[_Checked] = []
    for number in range(len(suite.scenarios)):
        try:
            checked += _check_entry(suite, number, path, changes, check, limits=limits)
        except InputError as error:
            faults += str(error).splitlines()
    recorded: list[Case] = []
    for number in range(len(suite.recordings)):
        try:
            recorded += _recorded_cases(suite, number, path, changes, check)
        except InputError as error:
            faults += [f"{path}: recordings.{number}: {line}" for line in str(error).splitlines()]
    faults += check.faults()
    raise_faults(faults)  # before each seed draws a room of its own
    for entry in checked:
        faults += _add_seeded(cases, suite, entry, path, changes, limits, scenes)
    for case in recorded:
        if case.id in cases:
            faults.append(
                f"{path}: recordings: {case.scenario} is there twice; a name of its own for each entry is expected"
            )
        cases[case.id] = case
    raise_faults(faults)
    return list(cases.values())


def _add_seeded(
    cases: dict[str, Case], suite: Suite, entry: _Checked, path: Path, texts: Sequence[str], limits: bool, scenes: bool
) -> list[str]:
    """Add the cases of an entry, one per seed and tracker; return what is wrong with them."""
    try:
        seeded = list(_seeded(suite, entry, path, texts, limits=limits))
        found = list(_cases_of(suite, entry, seeded))
    except InputError as error:  # of a scene drawn by one seed
        return [f"{path}: scenarios.{entry.number}: {line}" for line in str(error).splitlines()]
    faults = []
    if scenes:
        where = partial(place_of, entry.variant, entry.scenario_path)
        faults += [f"{path}: {each}" for each in scene_faults(where, seeded)]
    again = []
    for case in found:
        again += [case] * (case.id in cases)
        cases[case.id] = case
    if again:
        faults.append(f"{path}: scenarios.{entry.number}: {_twice(again)}")
    return faults


def _twice(again: Sequence[Case]) -> str:
    """Say which cases of an entry are there already."""
    first = f"{with_variant(again[0].scenario, again[0].variant)}, seed {again[0].seed}, {again[0].tracker}"
    more = f", as are {len(again) - 1} more of its cases" * (len(again) > 1)
    return f"{first} is there twice{more}; a name of its own for each entry, or variants that differ, is expected"


@dataclass(frozen=True)
class _Checked:
    """One variant of an entry, checked with the scenario's own seed."""

    number: int  # of the entry
    variant: Variant
    scenario: Scenario
    scenario_path: Path
    digest: str  # of the trackers' code and options


def _check_entry(
    suite: Suite, number: int, path: Path, changes: Sequence[str], check: TrackerCheck, *, limits: bool
) -> Iterator[_Checked]:
    entry = suite.scenarios[number]
    scenario_path = models.find("scenarios", entry.scenario, path.parent, f"{path}: scenarios.{number}.scenario")
    for variant in variants(suite, number, changes):
        if "seed" in variant.overrides:
            raise InputError(f"{path}: {variant.written('seed')}: seed is set; `seeds:` beside it is expected")
        try:
            scenario = load_scenario(
                scenario_path, changes, suites=format_overrides(variant.overrides), folder=path.parent
            )
            if limits:
                check_size(scenario)
            own = METRICS.keys() - RECORDING_METRICS.keys()
            check_measured(suite, entry, own, "in a scenario; a bound in an entry of recordings is expected")
            title = with_variant(entry.name or scenario.name, variant.title())
            digest = check.check(variant, scenario, scenario_path, title)
        except InputError as error:
            lines = str(error).splitlines()
            raise InputError("\n".join(f"{path}: scenarios.{number}: {line}" for line in lines)) from error
        yield _Checked(number, variant, scenario, scenario_path, digest)


def _seeded(suite: Suite, checked: _Checked, path: Path, changes: Sequence[str], *, limits: bool) -> Iterator[Scenario]:
    """Yield the variant's scenario with each of its seeds."""
    entry, scenario, overrides = (
        suite.scenarios[checked.number],
        checked.scenario,
        format_overrides(checked.variant.overrides),
    )
    for seed in entry.seeds or suite.seeds:
        of_seed = scenario
        if models.is_kept_room(scenario.room):  # each seed draws a scene of its own
            of_seed = load_scenario(
                checked.scenario_path, [*changes, f"seed={seed}"], suites=overrides, folder=path.parent
            )
            if limits:
                check_size(of_seed)
        yield of_seed.model_copy(update={"seed": seed})


def _cases_of(suite: Suite, checked: _Checked, seeded: Sequence[Scenario]) -> Iterator[Case]:
    entry, variant, scenario = suite.scenarios[checked.number], checked.variant, checked.scenario
    overrides, label, described = (
        format_overrides(variant.overrides),
        entry.name or scenario.name,
        variant.title(),
    )
    for of_seed in seeded:
        seed = of_seed.seed
        untracked = of_seed.model_copy(update={"trackers": {}, "prior": NO_PRIOR})
        resolved, people = dump_scenario(untracked), people_key(untracked)
        room, recipe = room_digest(untracked.room), recording_key(resolved, "")
        for tracker in variant.trackers:
            choice = scenario.trackers.get(tracker, TrackerChoice())
            followed = ((choice.preset or tracker, choice.options),)
            yield Case(
                id=_case_id(label, overrides, seed, tracker),
                scenario=label,
                variant=described,
                overrides=overrides,
                seed=seed,
                tracker=tracker,
                limit_s=entry.limit_s or suite.limit_s,
                report=suite.reports,
                require={**suite.require.get(tracker, {}), **entry.require.get(tracker, {})},
                resolved=resolved,
                size=size_of(of_seed),
                people=people,
                prior=scenario.prior,
                provenance=provenance_of(resolved, room, followed, checked.digest),
                recipe=recipe,
                tracker_changes=_definitions(scenario.trackers),
            )


def _definitions(trackers: Mapping[str, TrackerChoice]) -> tuple[str, ...]:
    return format_overrides(
        {f"trackers.{name}": each.model_dump(mode="json", exclude_none=True) for name, each in trackers.items()}
    )


def _recorded_cases(
    suite: Suite, number: int, path: Path, changes: Sequence[str], check: TrackerCheck
) -> Iterator[Case]:
    """Yield the cases of an entry of `recordings`: bag × seed × tracker."""
    entry, variant = suite.recordings[number], recorded_variant(suite, number, changes)
    bags = bags_of(path.parent, entry.recording)
    if entry.name is not None and len(bags) > 1:
        raise InputError(f"name: {entry.name} would be that of {len(bags)} bags; no name, or one bag, is expected")
    rig, truth = (None if each is None else path.parent / each for each in (entry.rig, entry.truth))
    overrides, followed = format_overrides(variant.overrides), variant.followed(path.parent)
    for bag, own_name in bags.items():
        recording, found = Recording(bag, rig), RecordedInput.of(bag, rig, truth)
        if truth is not None:
            read_truth(truth)
        elif next(recording.truth(), None) is None:
            why = f"without truth, which {bag.name} has not; `truth: FILE.csv`, or bounds of"
            check_measured(suite, entry, RECORDING_METRICS, f"{why} {' and '.join(RECORDING_METRICS)} are expected")
        described = scenario_of(recording)
        files, _ = files_for(recording, described, rig, followed)
        prior = Prior.read((), files, recording.rig)
        name, defined = entry.name or own_name, defined_trackers(described, variant.trackers, followed)
        check.check_recorded(variant, bag, defined, recording.rig, prior, name)
        of_prior = [each for each in followed if not each.startswith("trackers")]
        seconds = RunSize(
            people=None, seconds=recording.duration_s, observations=recording.observation_count, n_bytes=_bytes_of(bag)
        )
        for seed, tracker in product(entry.seeds, variant.trackers):
            choice = defined.get(tracker, TrackerChoice())
            made_by = ((choice.preset or tracker, choice.options),)
            made_from = provenance_of(f"bag {found.digest}", "", made_by, files.digest())
            yield Case(
                id=_case_id(name, overrides, seed, tracker),
                scenario=name,
                variant="",
                overrides=overrides,
                seed=seed,
                tracker=tracker,
                limit_s=entry.limit_s or suite.limit_s,
                report=suite.reports,
                require={**suite.require.get(tracker, {}), **entry.require.get(tracker, {})},
                resolved=f"bag {found.digest}",
                size=seconds,
                prior=files,
                provenance=replace(made_from, simulation=""),
                recipe=f"bag-{found.digest}",
                tracker_changes=(*of_prior, *_definitions({tracker: choice} if tracker in defined else {})),
                bag=found,
            )


def _bytes_of(bag: Path) -> float:
    return float(sum(each.stat().st_size for each in ([bag] if bag.is_file() else bag.rglob("*"))))


def _case_id(label: str, overrides: tuple[str, ...], seed: int, tracker: str) -> str:
    """Make a file name for a case that is the same on every machine at any time."""
    digest = hashlib.sha256(json.dumps([label, overrides, seed, tracker]).encode()).hexdigest()[:8]
    return f"{label}-{seed}-{re.sub(r'[^A-Za-z0-9._-]', '-', file_name(tracker))}-{digest}"
