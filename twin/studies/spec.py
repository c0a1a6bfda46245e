"""Placement study as described by its YAML file: scenarios, devices, objectives and search."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from trackers.configuration import Strict, validate
from trackers.errors import valid_names
from twin import models
from twin.studies.devices import Constraints, Device, Metres
from twin.suites.metrics import METRICS
from twin.suites.spec import EachOnce, Overrides, OwnName, Seeds, Text, TrackerName, list_of, mapping_of, single

if TYPE_CHECKING:
    from twin.scenario import Scenario

NOT_DETERMINISTIC = ("ms_per_frame.mean", "ms_per_frame.p95")
"""Metrics that depend on the machine's load: no objective may use them."""


class StudyScenario(Strict):
    """Scenario in which placements are evaluated, and its weight."""

    scenario: Annotated[str, single("the name of a scenario, or the path of its file,")] = Field(
        description="name of a shipped scenario, or path of a YAML file relative to the study"
    )
    weight: float = Field(default=1.0, gt=0, description="weight in means over scenarios")
    set: Overrides = Field(default={}, description="changes to the scenario, by path")


def scenario_key(number: int, scenario: StudyScenario) -> str:
    """Return the key of a scenario among a study's evaluations; two may have the same name."""
    return f"{number}:{scenario.scenario}"


class HeldOut(Strict):
    """Held-out seeds and scenarios, on which the recommended placement is validated."""

    seeds: Seeds = Field(description="a list of seeds, none of them a search seed")
    scenarios: tuple[StudyScenario, ...] = Field(
        default=(), description="other scenarios with the same sensors, say another crowd; none: the study's own alone"
    )


class Objective(Strict):
    """One objective of a study. The first of several decides the recommendation."""

    kind: Literal["metric", "coverage", "price"] = Field(description="a tracker's metric, coverage, or the price")
    metric: str | None = Field(default=None, description="of kind 'metric': its name, as in metrics.json (hota)")
    tracker: TrackerName | None = Field(default=None, description="the tracker; none: the study's only one")
    over: Literal["mean", "worst", "quantile"] = Field(default="mean", description="over seeds and scenarios")
    quantile: float = Field(default=0.1, gt=0, lt=1, description="of 'quantile': the share of seeds that are worse")
    form: Literal["share", "worst"] = Field(
        default="share",
        description="of coverage: the share seen, or the share of samples in which the worst cell is seen",
    )

    @model_validator(mode="after")
    def _consistent(self) -> Objective:
        if self.kind != "metric":
            if self.metric is not None or self.tracker is not None:
                raise ValueError(f"metric and tracker are of kind 'metric', not of {self.kind!r}")
            return self
        valid = [key for key in METRICS if key not in NOT_DETERMINISTIC]
        if self.metric not in valid:
            raise ValueError(f"unknown metric {self.metric!r}; {valid_names(self.metric, valid)}")
        return self

    @property
    def more_is_better(self) -> bool:
        """True where the objective is maximized."""
        return self.kind == "coverage" or (self.metric is not None and METRICS[self.metric].better == "more")

    @property
    def column(self) -> str:
        """The heading in tables."""
        if self.kind != "metric":
            return self.kind if self.form == "share" or self.kind == "price" else "coverage_worst"
        over = {"mean": "", "worst": " (worst)", "quantile": f" ({self.quantile:g} quantile)"}[self.over]
        return f"{self.tracker or 'metric'}: {self.metric}{over}"


class Coverage(Strict):
    """Visibility that coverage requires: resolution on a place or person, beyond a line of sight."""

    former_names: ClassVar = {"moments": "samples"}

    of: Literal["people", "floor"] = Field(default="people", description="people as they move, or cells of the floor")
    beams: Annotated[int, Field(ge=1)] = Field(default=6, description="a scanner sees a body that so many beams meet")
    px_per_m: float = Field(
        default=125.0,
        gt=0,
        description="a camera sees at so many pixels a metre (EN 62676-4: 25 detect, 63 observe, 125 recognise, 250 identify)",
    )
    target: Literal["body", "head"] = Field(
        default="body", description="what cameras are to see: half of a body, or the head"
    )
    at_least: Annotated[int, Field(ge=1, le=8)] = Field(default=1, description="so many sensors must see it")
    seeds: Seeds = Field(
        default=(900, 901), description="of 'people': seeds of their motion, others than the search seeds"
    )
    samples: Annotated[int, Field(ge=0, le=10_000)] = Field(
        default=100,
        description="time samples per seed, evenly over the scenario; of 'floor': people stand in the way then, 0: none",
    )
    cell_m: float = Field(default=0.1, gt=0.01, description="of 'floor': edge of a cell [m]")
    heights_m: Annotated[tuple[Metres, ...], Field(min_length=1)] = Field(
        default=(0.4, 1.0, 1.6), description="of 'floor': heights that cameras look for [m]; scanners have their own"
    )


class Search(Strict):
    """The method of the search and its limits."""

    method: Literal["exhaustive", "greedy", "exact", "optuna"] = Field(
        description="all of them; one device after another, by coverage; the best by coverage, proven (trackers then follow "
        "what was found); or Optuna's TPE (NSGA-II for several objectives)"
    )
    candidates: Annotated[int, Field(ge=1, le=100_000)] = Field(
        default=96, description="of 'optuna': placements to try"
    )
    generation: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=16, description="of 'optuna': placements asked for before their results are used"
    )
    replicates: Annotated[tuple[Annotated[int, Field(ge=1)], ...], Field(min_length=1)] = Field(
        default=(2, 4, 8, 16), description="seeds that all get, that the better half gets, the better half of that ..."
    )
    limit_s: float = Field(default=60.0, gt=0, description="of 'exact': most time before it settles for a gap [s]")
    seed: Annotated[int, Field(ge=0)] = Field(default=0, description="of 'optuna': what its draws come from")

    @model_validator(mode="after")
    def _more(self) -> Search:
        if list(self.replicates) != sorted(set(self.replicates)):
            raise ValueError(f"replicates: {list(self.replicates)} does not rise; as in [2, 4, 8, 16] is expected")
        return self


class Study(Strict):
    """A placement study."""

    former_names: ClassVar = {"move": "devices"}

    name: OwnName = Field(description="name of the study; it becomes the name of a folder")
    description: Text = Field(default="", description="what the study asks, for readers")
    scenarios: Annotated[
        tuple[StudyScenario, ...],
        Field(min_length=1),
        list_of("a list of scenarios, as in [{scenario: lab-five-people}],"),
    ] = Field(description="where placements are tried")
    trackers: Annotated[tuple[TrackerName, ...], EachOnce] = Field(
        default=(), description="trackers to run; none: coverage alone"
    )
    seeds: Seeds = Field(default=(1000,), description="search seeds: replicates are taken from the front")
    held_out: HeldOut | None = Field(
        default=None, description="seeds and scenarios for validation; none: no validation"
    )
    devices: Annotated[
        dict[OwnName, Device],
        Field(min_length=1),
        mapping_of("a mapping of devices to place, as in {waist: {sensors: [waist], walls: {height_m: 0.95}}},"),
    ] = Field(description="what is placed, by name")
    constraints: Constraints = Field(default=Constraints(), description="what placements must keep")
    objectives: Annotated[
        tuple[Objective, ...], Field(min_length=1), list_of("a list, as in [{kind: metric, metric: hota}],")
    ] = Field(description="what makes a placement good")
    coverage: Coverage = Field(default=Coverage(), description="what counts as visible")
    search: Search = Field(description="how placements are searched")
    cheapest_within: float | None = Field(
        default=None,
        ge=0,
        description="recommend the cheapest placement this near to the best by the first objective; none: the best",
    )

    @property
    def validated(self) -> tuple[Objective, ...]:
        """The objectives that are validated on held-out seeds: trackers' metrics."""
        return tuple(each for each in self.objectives if each.kind == "metric")

    def kept_sensors(self, scenario: Scenario) -> set[str]:
        """Return the names of a scenario's sensors that no device stands for: they stay as they are."""
        return set(scenario.sensors).difference(*(each.sensors_in(scenario) for each in self.devices.values()))

    @model_validator(mode="before")
    @classmethod
    def _only_tracker(cls, content: object) -> object:
        """Complete an objective without a tracker by the only one of the study."""
        if not isinstance(content, dict) or not isinstance(content.get("objectives"), list):
            return content
        trackers = content.get("trackers") or []
        if not (isinstance(trackers, list | tuple) and len(trackers) == 1):
            return content
        objectives = [
            {"tracker": trackers[0], **each} if isinstance(each, dict) and each.get("kind") == "metric" else each
            for each in content["objectives"]
        ]
        return content | {"objectives": objectives}

    @model_validator(mode="after")
    def _consistent(self) -> Study:
        faults = []
        for place, objective in enumerate(self.objectives):
            if objective.kind == "metric" and objective.tracker not in self.trackers:
                valid = valid_names(objective.tracker or "", self.trackers, none="none, as the study has no trackers")
                what = "is missing" if objective.tracker is None else f"{objective.tracker!r} is none of the trackers"
                faults.append(f"objectives.{place}.tracker: {what}; {valid}")
        if self.held_out is not None and not self.validated:
            faults.append(
                "held_out: validates trackers' metrics, and no objective is one; an objective {kind: metric}, or a study "
                "without held_out, is expected"
            )
        if self.held_out is not None and (shared := sorted(set(self.seeds) & set(self.held_out.seeds))):
            faults.append(
                f"held_out.seeds: {shared[0]} is a search seed too; others than {_seed_range(self.seeds)} are expected"
            )
        if shared := sorted(set(self.coverage.seeds) & set(self.held_out.seeds if self.held_out else ())):
            faults.append(f"coverage.seeds: {shared[0]} is held out; others are expected")
        metrics = [each for each in self.objectives if each.kind == "metric"]
        if metrics and self.search.replicates[-1] > len(self.seeds):
            faults.append(
                f"search.replicates: {self.search.replicates[-1]} seeds are asked for and seeds has {len(self.seeds)}; as many "
                "are expected"
            )
        if self.search.method in ("greedy", "exact") and self.objectives[0].column != "coverage":
            faults.append(
                f"search.method: {self.search.method!r} goes by coverage as a share, and objectives.0 is "
                f"{self.objectives[0].column}; {{kind: coverage}} first, or exhaustive or optuna, is expected"
            )
        used = [
            (name, sensor) for name, device in self.devices.items() for sensor in (*device.sensors, *device.together)
        ]
        for (one, sensor), (other, again) in combinations(used, 2):
            if sensor == again:
                faults.append(f"devices.{other}: {sensor!r} is moved by {one!r} already; each sensor once is expected")
        if len({each.column for each in self.objectives}) < len(self.objectives):
            faults.append("objectives: one is there twice; each once is expected")
        if faults:
            raise ValueError("; ".join(faults))
        return self


def _seed_range(seeds: tuple[int, ...]) -> str:
    return f"{min(seeds)} to {max(seeds)}" if len(seeds) > 3 else ", ".join(map(str, seeds))


def load_study(name: str | Path) -> tuple[Study, Path]:
    """Load a shipped study by name, or one by path; return its path too. Raises InputError, one line per mistake."""
    path = models.find("studies", str(name))
    content = models.read_kind(path, "study", "a study (name, scenarios, devices, objectives, search)")
    return validate(Study, content, str(path)), path
