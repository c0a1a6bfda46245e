"""Suite as described by its YAML file: scenarios × seeds × overrides × trackers, and tolerances."""

from __future__ import annotations

from itertools import product
from json import dumps
from math import prod
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    JsonValue,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    field_validator,
    model_validator,
)

from trackers.configuration import Strict, validate
from trackers.errors import valid_names
from trackers.rig import Name
from twin import models
from twin.suites.metrics import GATED, GATED_SENSOR_METRICS, METRICS, Bound, Tolerance, within_range


def list_of(what: str, *, or_empty: bool = False) -> BeforeValidator:
    """Make a validator of a list field, not empty unless `or_empty`; `what`: start of the error's sentence."""

    def check(value: Any) -> Any:
        if not isinstance(value, list | tuple) or not (value or or_empty):
            raise expected_error(value, f"{what} is expected")
        return value

    return BeforeValidator(check)


def _each_once(values: Any) -> Any:
    """Return a list or tuple, unless a value stands twice in it."""
    seen = set()
    for value in values or ():
        key = dumps(value, sort_keys=True)
        if key in seen:
            raise ValueError(f"{key} stands twice; each once is expected")
        seen.add(key)
    return values


EachOnce = AfterValidator(_each_once)


def mapping_of(what: str) -> BeforeValidator:
    """Make a validator of a mapping field with texts as keys."""

    def check(value: Any) -> Any:
        if not isinstance(value, dict):
            raise expected_error(value, f"{what} is expected")
        for key in value:
            if not isinstance(key, str):
                raise ValueError(f"the key {key!r} is not a text; {what} is expected")
        return value

    return BeforeValidator(check)


def single(what: str) -> WrapValidator:
    """Make a validator of a single value; every error says what is expected."""

    def check(value: Any, inner: ValidatorFunctionWrapHandler) -> Any:
        if not isinstance(value, bool):
            try:
                return inner(value)
            except ValidationError:
                pass
        raise expected_error(value, f"{what} is expected")

    return WrapValidator(check)


def expected_error(value: Any, sentence: str) -> ValueError:
    """Make the error for a value; `validate` itself shows every value except mappings."""
    return ValueError(f"{sentence} (got {value!r})" if isinstance(value, dict) else sentence)


def _metric_name(name: str) -> str:
    if name not in METRICS:
        raise ValueError(f"there is no metric {name!r}; {valid_names(name, METRICS)}")
    return name


MetricBounds = Annotated[
    dict[Annotated[str, AfterValidator(_metric_name)], Bound],
    AfterValidator(within_range),
    mapping_of('a mapping of metrics, as in {mota: ">= 0.97"},'),
]

Requirements = Annotated[
    dict[str, MetricBounds],
    mapping_of('a mapping of trackers, as in {sort: {mota: ">= 0.97", misidentifications: 0}},'),
]
"""Bounds on the mean over the seeds of each scenario, by tracker and metric."""


Overrides = Annotated[dict[str, JsonValue], mapping_of("a mapping of fields' paths to values, as in {duration_s: 10},")]
"""Values by the path of the scenario's field, as for `--set path=value`."""

_MOST_SEEDS = 100_000

_SEEDS_EXPECTED = (
    "a list of seeds, as in [0, 1, 2], how many from 0 on, as in 3, or {from: 1000, count: 200} is expected"
)


class SeedRange(Strict):
    """Consecutive seeds."""

    first: int = Field(alias="from", ge=0, lt=2**62, description="the first seed")
    count: int = Field(ge=1, le=_MOST_SEEDS, description="how many seeds")


def _seeds(value: Any) -> Any:
    """Expand `seeds: 3` to the first three, `{from: 1000, count: 200}` to 200 from 1000 on."""
    if isinstance(value, dict):
        try:
            between = SeedRange.model_validate(value)
        except ValidationError as error:
            raise expected_error(value, _SEEDS_EXPECTED) from error
        return tuple(range(between.first, between.first + between.count))
    if isinstance(value, int) and not isinstance(value, bool):
        if not 1 <= value <= _MOST_SEEDS:
            raise ValueError(f"how many seeds there are from 0 on; 1 to {_MOST_SEEDS} is valid")
        return tuple(range(value))
    if not isinstance(value, list | tuple) or not value:
        raise expected_error(value, _SEEDS_EXPECTED)
    return value


Seed = Annotated[int, Field(ge=0, lt=2**63), single("a seed, a whole number from 0 up,")]

HowMany = Annotated[int, Field(ge=1, le=_MOST_SEEDS)]

SeedList = Annotated[list[Seed], Field(min_length=1)]

Seeds = Annotated[
    tuple[Seed, ...],
    Field(min_length=1),
    BeforeValidator(_seeds, json_schema_input_type=HowMany | SeedList | SeedRange),
    EachOnce,
]

Limit = Annotated[float, Field(gt=0, le=86_400), single("a time above 0, up to 86400 s,")]

Text = Annotated[str, single("a text")]

OwnName = Annotated[Name, single("a name of letters, digits, '-' and '_', a letter first,")]

TrackerName = Annotated[
    str, single("the name of a tracker, as laser-imm, or module:Class (options stand in set: {trackers: {NAME: {…}}}),")
]

_TRACKERS = "a list of trackers' names, as in [laser-imm],"

Values = Annotated[list[JsonValue], Field(min_length=1), list_of("a list of values to try, as in [5, 10],"), EachOnce]


class SuiteScenario(Strict):
    """One scenario of a suite, optionally with its own seeds, trackers and time limit.

    Every combination of the grid's values is run with every one of the variants.
    """

    scenario: Annotated[str, single("the name of a scenario, or the path of its file,")] = Field(
        description="name of a shipped scenario, or path of a YAML file relative to the suite"
    )
    name: OwnName | None = Field(
        default=None, description="what to call it in the results; none: the scenario's own name"
    )
    seeds: Seeds | None = Field(default=None, description="a list of seeds, or how many from 0 on; none: the suite's")
    trackers: Annotated[tuple[TrackerName, ...], Field(min_length=1), list_of(_TRACKERS), EachOnce] | None = Field(
        default=None, description="names of trackers to run; none: the suite's"
    )
    limit_s: Limit | None = Field(
        default=None, description="how long a case may take, recording and tracking [s]; none: the suite's"
    )
    require: Requirements = Field(
        default={}, description="what figures trackers are to reach here, beside and before what the suite says"
    )
    set: Overrides = Field(default={}, description="changes to every case, by path")
    grid: Annotated[dict[str, Values], mapping_of("a mapping of paths to lists, as in {duration_s: [5, 10]},")] = Field(
        default={}, description="values by path, every combination"
    )
    variants: Annotated[
        list[Overrides], Field(min_length=1), list_of("a list of mappings, as in [{}, {duration_s: 5}],"), EachOnce
    ] = Field(default=[{}], description="changes by path, one after the other")

    def combinations(self) -> list[Overrides]:
        """List the overrides of each combination, except those of `set`."""
        grids = [dict(zip(self.grid, values, strict=True)) for values in product(*self.grid.values())]
        return [{**grid, **variant} for variant in self.variants for grid in grids]


def _entry(value: Any) -> Any:
    if not isinstance(value, dict | SuiteScenario):
        name = value if isinstance(value, str) else "lab-five-people"
        raise ValueError(f"a mapping, as {{scenario: {name}}}, is expected")
    return value


class SuiteRecording(Strict):
    """Bags as cases, of the twin or a robot, with or without truth."""

    recording: Annotated[str, single("the path of a bag, or a pattern like bags/*.mcap,")] = Field(
        description="bag, or pattern of several (*, ?, **), relative to the suite"
    )
    name: OwnName | None = Field(default=None, description="what to call it in the results; none: the bag's own name")
    rig: Text | None = Field(
        default=None,
        description="rig.yaml of the bags, relative to the suite; none: the one in the bag, or a single scanner",
    )
    truth: Text | None = Field(
        default=None,
        description="table of the truth (t from the bag's start, id, x, y); none: what the bag holds, if any",
    )
    seeds: Seeds = Field(default=(0,), description="seeds of trackers that draw at random")
    trackers: Annotated[tuple[TrackerName, ...], Field(min_length=1), list_of(_TRACKERS), EachOnce] | None = Field(
        default=None, description="names of trackers to run; none: the suite's"
    )
    limit_s: Limit | None = Field(default=None, description="how long a case may take [s]; none: the suite's")
    require: Requirements = Field(default={}, description="what figures trackers are to reach here")
    set: Overrides = Field(default={}, description="changes to the trackers and their prior files, by path")


class Suite(Strict):
    """Scenarios × seeds × overrides × trackers, the time limit of a case, and the tolerances."""

    former_names: ClassVar = {"beside": "reference"}

    name: OwnName = Field(description="name of the suite; it becomes the name of a folder")
    description: Text = Field(default="", description="what the suite is for, for readers")
    seeds: Seeds = Field(
        default=(0, 1, 2),
        description="of the scenarios: a list of seeds, or how many from 0 on; recordings have their own",
    )
    trackers: Annotated[tuple[TrackerName, ...], list_of(_TRACKERS, or_empty=True), EachOnce] = Field(
        default=(), description="names of trackers to run on every scenario that names none"
    )
    reference: TrackerName | None = Field(
        default=None,
        description="name of the tracker that all others are compared with, paired by scenario and seed; none: no such table",
    )
    limit_s: Limit = Field(default=600.0, description="how long a case may take, recording and tracking [s]")
    reports: bool = Field(
        default=True,
        description="whether each case gets a page of its own, 1 to 3 s of its time; metrics, tracks and incidents are the "
        "same without",
    )
    require: Requirements = Field(
        default={},
        description="what figures trackers are to reach, as a mean over the seeds of each scenario and whatever the baseline "
        "says: a number, or a bound",
    )
    set: Overrides = Field(
        default={}, description="changes to every case, by path; recordings follow those of trackers and prior files"
    )
    scenarios: Annotated[
        list[Annotated[SuiteScenario, BeforeValidator(_entry)]],
        list_of("a list of scenarios, as in [{scenario: lab-five-people}],"),
    ] = Field(default=[], description="what is simulated: scenarios with their own seeds, trackers and changes")
    recordings: Annotated[
        list[SuiteRecording], list_of("a list of bags, as in [{recording: bags/*.mcap, rig: rig.yaml}],")
    ] = Field(default=[], description="bags that are tracked as they are, beside the scenarios")
    tolerances: Annotated[
        dict[str, Annotated[Tolerance, mapping_of("a mapping, as in {absolute: 0.01},")]],
        mapping_of("a mapping of metrics, as in {mota: {absolute: 0.01}},"),
    ] = Field(default={}, description="by figure, instead of the default; see twin/suites/metrics.py")

    @field_validator("tolerances")
    @classmethod
    def _known_metrics(cls, tolerances: dict[str, Tolerance]) -> dict[str, Tolerance]:
        for name in tolerances:
            if name not in (*GATED, *GATED_SENSOR_METRICS):
                raise ValueError(f"there is no metric {name!r}; {valid_names(name, (*GATED, *GATED_SENSOR_METRICS))}")
        return tolerances

    @model_validator(mode="after")
    def _check_trackers(self) -> Suite:
        entries: dict[str, SuiteScenario | SuiteRecording] = {
            **{f"scenarios.{number}": each for number, each in enumerate(self.scenarios)},
            **{f"recordings.{number}": each for number, each in enumerate(self.recordings)},
        }
        if not entries:
            raise ValueError("scenarios: is missing; a list of scenarios, or recordings, is expected")
        if "seeds" in self.model_fields_set and not self.scenarios:
            raise ValueError(
                "seeds: changes nothing, as every case is a recording; seeds: of each recording is expected"
            )
        for where, entry in entries.items():
            if not (entry.trackers or self.trackers):
                what = entry.scenario if isinstance(entry, SuiteScenario) else entry.recording
                raise ValueError(f"{where} ({what}) has no trackers and the suite has none; one is needed")
        named = {name for entry in entries.values() for name in entry.trackers or self.trackers}
        if self.reference is not None and self.reference not in named:
            raise ValueError(
                f"reference: {self.reference!r} is none of the trackers; {valid_names(self.reference, sorted(named))}"
            )
        for where, entry in {"": self, **entries}.items():
            has = named if entry is self else set(entry.trackers or self.trackers)
            for name in sorted(set(entry.require) - has):
                field = f"{where}.require" if where else "require"
                raise ValueError(f"{field}: {name!r} is none of the trackers; {valid_names(name, sorted(has))}")
        return self

    @property
    def n_case(self) -> int:
        """Number of cases, without making them; a pattern of bags counts as one."""
        return sum(len(each.seeds) * len(each.trackers or self.trackers) for each in self.recordings) + sum(
            len(entry.seeds or self.seeds)
            * len(entry.trackers or self.trackers)
            * len(entry.variants)
            * prod(len(values) for values in entry.grid.values())
            for entry in self.scenarios
        )

    def with_seed_offset(self, offset: int) -> Suite:
        """Return the suite with this number added to each seed."""

        def moved(seeds: tuple[int, ...] | None) -> tuple[int, ...] | None:
            return None if seeds is None else tuple(seed + offset for seed in seeds)

        scenarios = [entry.model_copy(update={"seeds": moved(entry.seeds)}) for entry in self.scenarios]
        recordings = [entry.model_copy(update={"seeds": moved(entry.seeds)}) for entry in self.recordings]
        update = {"seeds": moved(self.seeds), "scenarios": scenarios, "recordings": recordings}
        return self.model_copy(update=update)


def load_suite(name: str | Path) -> tuple[Suite, Path]:
    """Load a shipped suite by name, or one by path; return it and its file. Raises InputError, one line with every fault."""
    path = models.find("suites", str(name))
    content = models.read_kind(path, "suite", "a suite (name, scenarios, seeds, trackers)")
    return validate(Suite, content, str(path)), path
