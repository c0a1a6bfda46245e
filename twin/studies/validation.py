"""Validation of a recommended placement: on held-out seeds, with one device fewer, and with its sensors displaced."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackers.arrays import Array
from trackers.errors import InputError
from twin.scenario import Scenario
from twin.scenario.housings import in_the_room
from twin.scenario.mount import CalibrationError, mount_of
from twin.scenario.sensor_descriptions import FloorDescription
from twin.streams import stream
from twin.studies.candidate_set import BASELINE, CandidateSet, Placement
from twin.studies.coverage import PoseCoverage
from twin.studies.devices import format_price
from twin.studies.spec import Objective, Study, scenario_key
from twin.studies.trials import Trial, TrialRunner, losses, placement_id
from twin.suites.metrics import MeanOverSeeds, mean_over_seeds

DISPLACEMENTS = (("5 cm", 0.05, 0.0), ("2°", 0.0, 2.0))
_FEWEST_RANKED = 10
"""Trials below which a rank correlation is noise."""
NOISE_M = 0.001
"""Negligible displacement, whose effect is the noise of the metric [m]."""


@dataclass(frozen=True)
class PairedDifference:
    """Metric of the recommended placement and of a reference, paired by seed: both means, and their difference."""

    what: str
    other: float
    ours: float
    difference: MeanOverSeeds | None

    @property
    def text(self) -> str:
        """The difference with its 95 % interval."""
        found = self.difference
        if found is None:
            return "–"
        low_high = "" if found.low is None else f" [{found.low:+.4f}, {found.high:+.4f}]"
        return f"{found.mean:+.4f}{low_high}".replace("-", "−")


def paired_difference(what: str, other: Array, ours: Array) -> PairedDifference:
    """Compare two metrics at the same seeds (n,), without seeds at which one failed."""
    both = np.isfinite(other) & np.isfinite(ours)
    if not both.any():
        return PairedDifference(what, float("nan"), float("nan"), None)
    difference = mean_over_seeds((ours[both] - other[both]).tolist())
    return PairedDifference(what, float(other[both].mean()), float(ours[both].mean()), difference)


def indistinguishable(
    trials: Sequence[Trial], best: Trial, objective: Objective, study: Study
) -> list[tuple[Trial, PairedDifference]]:
    """Return the trials on as many seeds whose difference from the best has an interval that includes 0."""
    if objective.kind != "metric":
        return []
    found = []
    for trial in trials:
        if trial is best or trial.failure or not set(best.seeds) <= set(trial.seeds):
            continue
        seeds = best.seeds
        mine, theirs = (each.values_by_seed(objective, study.scenarios, seeds) for each in (best, trial))
        difference = paired_difference(str(trial.placement), theirs, mine)
        interval = difference.difference
        if interval is not None and (interval.low is None or (interval.low <= 0 <= (interval.high or 0))):
            found.append((trial, difference))
    return found


def rank_correlations(
    trials: Sequence[Trial], candidate_set: CandidateSet, objective: Objective, study: Study
) -> list[tuple[str, float, int]]:
    """Correlate the first objective with number, height, position and price over all trials (Spearman); nothing for few."""
    tried = [each for each in trials if not each.failure and each.placement != BASELINE]
    if len(tried) < _FEWEST_RANKED:
        return []
    from scipy.stats import spearmanr  # takes a while to load

    values = [each.value(objective, study.scenarios) for each in tried]
    middle = np.mean([np.array(each).mean(axis=0) for each in candidate_set.positions], axis=0)
    rows: dict[str, list[float]] = {
        "number of devices": [],
        "mean height": [],
        "mean distance from the middle": [],
        "price": [],
    }
    for each in tried:
        places = np.concatenate([candidate_set.positions[number] for number in each.placement])
        rows["number of devices"].append(len(each.placement))
        rows["mean height"].append(float(places[:, 2].mean()))
        rows["mean distance from the middle"].append(float(np.hypot(*(places - middle)[:, :2].T).mean()))
        rows["price"].append(each.price)
    return [
        (what, float(spearmanr(numbers, values).statistic), len(tried))
        for what, numbers in rows.items()
        if np.ptp(numbers) > 1e-9 and np.ptp(values) > 0
    ]


def displace_sensors(
    scenario: Scenario, names: Sequence[str], off_m: float, turn_deg: float, is_surveyed: bool, seed: int
) -> Scenario:
    """Displace the named sensors in a direction drawn by the seed; trackers know their true poses (surveyed) or not.

    Horizontally and about the vertical, since scanners must stay level. Existing calibration errors are kept, and this one
    added. Raises InputError for a floor.
    """
    sensors = dict(scenario.sensors)
    for name in names:
        description = in_the_room(scenario, name)
        if isinstance(description, FloorDescription):
            raise InputError(f"{name} is a floor; only scanners and cameras are displaced")
        rng = stream(seed, "misplaced", name)
        bearing, sign = rng.uniform(0, 2 * np.pi), rng.choice([-1.0, 1.0])
        x, y, z = description.mount.xyz
        dx, dy = float(off_m * np.cos(bearing)), float(off_m * np.sin(bearing))
        turn = float(sign * turn_deg)
        mount = description.mount.model_copy(
            update={"xyz": (x + dx, y + dy, z), "yaw_deg": description.mount.yaw_deg + turn}
        )
        assumed = description.calibration_error
        if not is_surveyed:
            before = assumed or CalibrationError()
            bx, by, bz = before.xyz
            # a tilted camera turned about the vertical is assumed turned about its own axes
            own = mount.room_from_housing().rotation.T @ description.mount.room_from_housing().rotation
            turned = mount_of(own, np.zeros(3))
            rpy_deg = turned.roll_deg, turned.pitch_deg, turned.yaw_deg
            assumed = before.model_copy(update={"xyz": (bx - dx, by - dy, bz), "rpy_deg": rpy_deg})
        sensors[name] = description.model_copy(update={"mount": mount, "calibration_error": assumed})
    return scenario.model_copy(update={"sensors": sensors})


def moved_sensors(study: Study, own: Scenario, now: Scenario) -> list[str]:
    """Return the sensors of a placed scenario that the study moves, floors left out."""
    kept = study.kept_sensors(own)
    return [name for name, each in now.sensors.items() if name not in kept and not isinstance(each, FloorDescription)]


def held_out_differences(run: TrialRunner, best: Trial, objective: Objective) -> list[PairedDifference]:
    """Compare the recommended placement with the baseline by a tracker's metric on held-out seeds."""
    held, rows = run.study.held_out, []
    if held is None:
        return rows
    groups = [("the study's scenarios", _weights(run))]
    groups += [
        (each.scenario, {f"held-out {scenario_key(number, each)}": 1.0}) for number, each in enumerate(held.scenarios)
    ]
    for what, weights in groups:
        both = []
        for placement in (BASELINE, best.placement):
            placed = {(seed, key): run.scenario(placement, key) for seed in held.seeds for key in weights}
            both.append(run.metric_by_seed(objective, placement_id(placement), weights, placed))
        rows.append(paired_difference(what if len(run.study.validated) == 1 else f"{objective.column}, {what}", *both))
    return rows


def _weights(run: TrialRunner) -> dict[str, float]:
    return {key: each.weight for each, key in zip(run.study.scenarios, run.prepared.scenarios, strict=True)}


def values_with_one_fewer(run: TrialRunner, coverage: PoseCoverage, best: Trial) -> list[tuple[Placement, float]]:
    """Return the first objective without each device in turn, on the search seeds; none for a single device."""
    objective, rows = run.study.objectives[0], []
    for removed in best.placement if len(best.placement) > 1 else ():
        placement = tuple(each for each in best.placement if each != removed)
        trial = Trial(placement, run.candidate_set.price(placement))
        if objective.kind == "metric":
            run.evaluate([trial], len(best.seeds))
        else:
            trial.measure_coverage(coverage)
        if not trial.failure:
            rows.append((placement, trial.value(objective, run.study.scenarios)))
    return rows


def displaced_differences(run: TrialRunner, best: Trial, objective: Objective) -> list[PairedDifference]:
    """Compare the recommended placement with itself displaced, surveyed and not, and with a displacement by a millimetre."""
    study = run.study
    seeds = study.held_out.seeds if study.held_out is not None else best.seeds
    weights = _weights(run)
    own = {(seed, key): run.scenario(best.placement, key) for seed in seeds for key in weights}
    names = moved_sensors(study, run.prepared.scenario, next(iter(own.values())))
    if not names:
        return []
    base = run.metric_by_seed(objective, placement_id(best.placement), weights, own)
    wanted = [("1 mm, surveyed: the noise", NOISE_M, 0.0, True)]
    wanted += [
        (f"{what}, {'' if is_surveyed else 'not '}surveyed", off, turn, is_surveyed)
        for what, off, turn in DISPLACEMENTS
        for is_surveyed in (True, False)
    ]
    rows = []
    for what, off_m, turn_deg, is_surveyed in wanted:
        displaced = {
            (seed, key): displace_sensors(scenario, names, off_m, turn_deg, is_surveyed, seed)
            for (seed, key), scenario in own.items()
        }
        here = run.metric_by_seed(objective, f"{placement_id(best.placement)} {what}", weights, displaced)
        rows.append(paired_difference(what, base, here))
    return rows


NEARLY = 0.01
"""Share of the best value by the first objective within which a placement counts as nearly as good."""


@dataclass(frozen=True)
class CheaperPlacement:
    """Trial that is cheaper than the recommended one and nearly as good.

    worse: share of the recommended one's value by which it is worse; within: the `cheapest_within` that recommends it.
    """

    trial: Trial
    worse: float
    within: float

    def sentence(self, objective: Objective, value: float) -> str:
        """Tell what it costs and gives; value: by the first objective."""
        share = f"{100 * self.worse:.1f} % {'less' if objective.more_is_better else 'more'}"
        less = share if self.worse >= 5e-4 else "as much"
        return f"{format_price(self.trial.price)} gives {format_value(objective, value)}, {less}"


def nearly_as_good(study: Study, best: Trial, others: Sequence[Trial]) -> CheaperPlacement | None:
    """Return the cheapest of other trials that is cheaper than the best and nearly as good; None if there is none.

    None too where the study recommends the cheapest itself.
    """
    if study.cheapest_within is not None:
        return None
    trials = [best, *others]
    loss = losses(trials, study.objectives, study.scenarios)[:, 0]
    most = NEARLY * abs(loss[0])
    near = [n for n in range(1, len(trials)) if loss[n] - loss[0] <= most and trials[n].price < best.price - 1e-9]
    if not near:
        return None
    least = min(near, key=lambda n: (trials[n].price, loss[n]))
    worse = max(0.0, float(loss[least] - loss[0]))
    return CheaperPlacement(
        trials[least], worse / abs(float(loss[0])) if worse else 0.0, float(np.ceil(1000 * worse) / 1000)
    )


def format_value(objective: Objective, value: float) -> str:
    """Format a value of an objective: a coverage in percent."""
    return f"{100 * value:.1f} %" if objective.kind == "coverage" else f"{objective.column} {value:.4g}"
