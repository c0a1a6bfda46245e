"""A suite as its YAML file describes it: scenarios × seeds × overrides × trackers, and when a figure is worse."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, JsonValue, field_validator, model_validator

from trackers.configuration import Strict, parse_yaml, read_text, validate
from trackers.errors import InputError
from twin import models
from twin.scenario.model import Name
from twin.suites.figures import GATED

Changes = dict[str, JsonValue]
"""Values by the path of the scenario's field, as `--set path=value` would give them."""


def _seeds(value: Any) -> Any:
    """`seeds: 3` is short for the first three."""
    if isinstance(value, int) and not isinstance(value, bool):
        return tuple(range(value))
    return value


Seed = Annotated[int, Field(ge=0, lt=2**63)]
HowMany = Annotated[int, Field(ge=1)]
SeedList = Annotated[list[Seed], Field(min_length=1)]
Seeds = Annotated[
    tuple[Seed, ...], Field(min_length=1), BeforeValidator(_seeds, json_schema_input_type=HowMany | SeedList)
]
Limit = Annotated[float, Field(gt=0, le=86_400)]


class Tolerance(Strict):
    """How much worse a figure may get, on the mean over a scenario's seeds: absolute + relative × |baseline|."""

    absolute: float = Field(default=0.0, ge=0)
    relative: float = Field(default=0.0, ge=0)

    def allowed(self, baseline: float) -> float:
        """The change that is still tolerated, in the figure's unit."""
        return self.absolute + self.relative * abs(baseline)


class SuiteScenario(Strict):
    """One scenario of a suite, with its own seeds, trackers and time limit where it has them.

    Every combination of the grid's values is run with every one of the variants.
    """

    scenario: str = Field(description="name of a shipped scenario, or path of a YAML file relative to the suite")
    name: Name | None = Field(default=None, description="what to call it in the results; none: the scenario's own name")
    seeds: Seeds | None = None
    trackers: tuple[str, ...] | None = Field(default=None, min_length=1)
    limit_s: Limit | None = None
    set: Changes = Field(default_factory=dict, description="changes to every case, by path")
    grid: dict[str, Annotated[list[JsonValue], Field(min_length=1)]] = Field(
        default_factory=dict, description="values by path, every combination"
    )
    variants: list[Changes] = Field(default=[{}], min_length=1, description="changes by path, one after the other")

    def combinations(self) -> list[Changes]:
        """The overrides of each case, without those of `set`."""
        grids = [dict(zip(self.grid, values, strict=True)) for values in product(*self.grid.values())]
        return [{**grid, **variant} for variant in self.variants for grid in grids]


class Suite(Strict):
    """Scenarios × seeds × overrides × trackers, the time limit of a case, and what counts as worse."""

    name: Name
    description: str = ""
    seeds: Seeds = (0, 1, 2)
    trackers: tuple[str, ...] = ()
    limit_s: Limit = Field(default=600.0, description="how long a case may take, recording and tracking [s]")
    set: Changes = Field(default_factory=dict, description="changes to every case of every scenario, by path")
    scenarios: list[SuiteScenario] = Field(min_length=1)
    tolerances: dict[str, Tolerance] = Field(
        default_factory=dict, description="by figure, instead of the default; see twin/suites/figures.py"
    )

    @field_validator("tolerances")
    @classmethod
    def _known_figures(cls, tolerances: dict[str, Tolerance]) -> dict[str, Tolerance]:
        for name in tolerances:
            if name not in GATED:
                raise ValueError(f"there is no figure {name!r}; valid are {', '.join(GATED)}")
        return tolerances

    @model_validator(mode="after")
    def _somebody_tracks(self) -> Suite:
        for number, entry in enumerate(self.scenarios):
            if not (entry.trackers or self.trackers):
                raise ValueError(
                    f"scenarios.{number} ({entry.scenario}) has no trackers and the suite has none; one is needed"
                )
        return self

    def with_seed_offset(self, offset: int) -> Suite:
        """The same suite with other seeds: this much is added to each."""

        def moved(seeds: tuple[int, ...] | None) -> tuple[int, ...] | None:
            return None if seeds is None else tuple(seed + offset for seed in seeds)

        scenarios = [entry.model_copy(update={"seeds": moved(entry.seeds)}) for entry in self.scenarios]
        return self.model_copy(update={"seeds": moved(self.seeds), "scenarios": scenarios})


def load_suite(name: str | Path) -> tuple[Suite, Path]:
    """The suite of this name (shipped) or path, and its file. Raises InputError, every fault on one line."""
    path = models.find("suites", str(name))
    expected = "a suite (name, scenarios, seeds, trackers)"
    content = parse_yaml(read_text(path, expected), str(path), expected)
    return validate(Suite, content, str(path)), path


def find_scenario(entry: SuiteScenario, suite: Path) -> Path:
    """The scenario's file; raises InputError naming the suite's."""
    try:
        return models.find("scenarios", entry.scenario, suite.parent, f"{suite}: scenarios")
    except InputError as error:
        raise InputError(str(error)) from None
