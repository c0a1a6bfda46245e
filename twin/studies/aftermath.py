"""What a recommendation is worth: on held-out seeds, with one device fewer, and hung a little beside its place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import spearmanr

from trackers.arrays import Array
from trackers.errors import InputError
from twin.scenario import Scenario
from twin.scenario.floor import FloorDescription
from twin.scenario.housings import in_the_room
from twin.scenario.mount import Believed
from twin.streams import stream
from twin.studies.description import Objective, Study
from twin.studies.layout import OWN, Candidate, Layout
from twin.studies.trial import Trial
from twin.suites.results import MeanOverSeeds, mean_over_seeds

MISPLACED = (("5 cm", 0.05, 0.0), ("2°", 0.0, 2.0))
NOISE_M = 0.001
"""A place off by so little means nothing: what it changes is the noise [m]."""


@dataclass(frozen=True)
class Beside:
    """A figure of the recommendation beside that of something else, paired by seed: both means, and this less that."""

    what: str
    other: float
    ours: float
    difference: MeanOverSeeds | None

    @property
    def told(self) -> str:
        """The difference with its 95 % interval."""
        found = self.difference
        if found is None:
            return "–"
        low_high = "" if found.low is None else f" [{found.low:+.4f}, {found.high:+.4f}]"
        return f"{found.mean:+.4f}{low_high}".replace("-", "−")


Values = Callable[[str, Sequence[tuple[str, Scenario]], Sequence[int]], Array]
"""A tracker's figure at each seed, of scenarios (by key) as given, kept under a name; NaN where it failed."""


def beside(what: str, other: Array, ours: Array) -> Beside:
    """Two figures at the same seeds (n,); seeds at which one failed are left out."""
    both = np.isfinite(other) & np.isfinite(ours)
    if not both.any():
        return Beside(what, float("nan"), float("nan"), None)
    difference = mean_over_seeds((ours[both] - other[both]).tolist())
    return Beside(what, float(other[both].mean()), float(ours[both].mean()), difference)


def alike(trials: Sequence[Trial], best: Trial, objective: Objective, study: Study) -> list[tuple[Trial, Beside]]:
    """Every candidate that cannot be told from the best: as many seeds, and an interval of the difference that holds 0."""
    if objective.kind != "metric":
        return []
    found = []
    for trial in trials:
        if trial is best or trial.why or not set(best.seeds) <= set(trial.seeds):
            continue
        seeds = best.seeds
        mine, theirs = (each.by_seed(objective, study.scenarios, seeds) for each in (best, trial))
        difference = beside(str(trial.candidate), theirs, mine)
        interval = difference.difference
        if interval is not None and (interval.low is None or (interval.low <= 0 <= (interval.high or 0))):
            found.append((trial, difference))
    return found


def what_moved(
    trials: Sequence[Trial], layout: Layout, objective: Objective, study: Study
) -> list[tuple[str, float, int]]:
    """Rank correlation (Spearman) of the first objective with number, height and place, over all candidates tried."""
    tried = [each for each in trials if not each.why and each.candidate != OWN]
    if len(tried) < 5:
        return []
    values = [each.value(objective, study.scenarios) for each in tried]
    middle = np.mean([np.array(each).mean(axis=0) for each in layout.positions], axis=0)
    rows: dict[str, list[float]] = {
        "number of devices": [],
        "mean height": [],
        "mean distance from the middle": [],
        "price": [],
    }
    for each in tried:
        places = np.concatenate([layout.positions[number] for number in each.candidate])
        rows["number of devices"].append(len(each.candidate))
        rows["mean height"].append(float(places[:, 2].mean()))
        rows["mean distance from the middle"].append(float(np.hypot(*(places - middle)[:, :2].T).mean()))
        rows["price"].append(each.price)
    return [
        (what, float(spearmanr(numbers, values).statistic), len(tried))
        for what, numbers in rows.items()
        if np.ptp(numbers) > 1e-9 and np.ptp(values) > 0
    ]


def fewer(layout: Layout, candidate: Candidate) -> list[Candidate]:
    """The candidate without one of its devices, each in turn, where more than one is there."""
    return [tuple(each for each in candidate if each != gone) for gone in candidate] if len(candidate) > 1 else []


def misplaced(
    scenario: Scenario, names: Sequence[str], off_m: float, turn_deg: float, told: bool, seed: int
) -> Scenario:
    """The scenario with the named sensors hung off their places in a direction drawn by the seed, and trackers told or not.

    Off level: scanners must stay level. Turned about the vertical. A sensor that is believed elsewhere already stays so, and
    is off by this besides.
    """
    sensors = dict(scenario.sensors)
    for name in names:
        description = in_the_room(scenario, name)
        if isinstance(description, FloorDescription):
            raise InputError(f"{name} is a floor; scanners and cameras are hung beside their places")
        rng = stream(seed, "misplaced", name)
        bearing, sign = rng.uniform(0, 2 * np.pi), rng.choice([-1.0, 1.0])
        x, y, z = description.mount.xyz
        dx, dy = float(off_m * np.cos(bearing)), float(off_m * np.sin(bearing))
        turn = float(sign * turn_deg)
        mount = description.mount.model_copy(
            update={"xyz": (x + dx, y + dy, z), "yaw_deg": description.mount.yaw_deg + turn}
        )
        believed = description.believed
        if not told:
            before = believed or Believed()
            bx, by, bz = before.xyz
            # a tilted camera that is turned about the vertical is believed turned about its own axes
            own = mount.room_from_housing().rotation.T @ description.mount.room_from_housing().rotation
            roll, pitch, yaw = _angles(own)
            believed = before.model_copy(update={"xyz": (bx - dx, by - dy, bz), "rpy_deg": (roll, pitch, yaw)})
        sensors[name] = description.model_copy(update={"mount": mount, "believed": believed})
    return scenario.model_copy(update={"sensors": sensors})


def _angles(rotation: Array) -> tuple[float, float, float]:
    """Roll, pitch and yaw of a rotation matrix [deg]."""
    pitch = np.arcsin(np.clip(-rotation[2, 0], -1, 1))
    yaw, roll = np.arctan2(rotation[1, 0], rotation[0, 0]), np.arctan2(rotation[2, 1], rotation[2, 2])
    return float(np.degrees(roll)), float(np.degrees(pitch)), float(np.degrees(yaw))


def moved_sensors(study: Study, own: Scenario, now: Scenario) -> list[str]:
    """The sensors of a placed scenario that the study moves, floors left out."""
    kept: set[str] = set(own.sensors)
    for move in study.move.values():
        kept -= {*move.sensors, *move.together}
        if move.housing is not None:
            kept -= {name for name, each in own.sensors.items() if getattr(each, "housing", None) == move.housing}
    return [name for name, each in now.sensors.items() if name not in kept and not isinstance(each, FloorDescription)]
