"""What a recommendation is worth: on held-out seeds, without one of its devices, and hung a little beside its place."""

from __future__ import annotations

from functools import partial

from twin.scenario import Scenario
from twin.studies.aftermath import MISPLACED, NOISE_M, Beside, beside, fewer, misplaced, moved_sensors
from twin.studies.coverage import Seen
from twin.studies.description import Objective
from twin.studies.layout import OWN, Candidate
from twin.studies.trial import Trial, key_of
from twin.studies.trying import Trying, name_of


def _placed_as(run: Trying, candidate: Candidate, key: str, seed: int) -> Scenario:
    return run.scenario(candidate, key)


def held_out(run: Trying, best: Trial, objective: Objective) -> list[Beside]:
    """The recommendation beside the scenario's own placement, by a tracker's figure on seeds that nothing was chosen by."""
    held, rows = run.study.held_out, []
    if held is None:
        return rows
    groups = [("the study's scenarios", _weights(run))]
    groups += [(each.scenario, {f"held-out {key_of(number, each)}": 1.0}) for number, each in enumerate(held.scenarios)]
    for what, weights in groups:
        both = []
        for candidate in (OWN, best.candidate):
            place = partial(_placed_as, run, candidate)
            both.append(run.values(objective, name_of(candidate), weights, place, held.seeds))
        rows.append(beside(what if len(run.study.judged) == 1 else f"{objective.column}, {what}", *both))
    return rows


def _weights(run: Trying) -> dict[str, float]:
    return {key: each.weight for each, key in zip(run.study.scenarios, run.prepared.scenarios, strict=True)}


def with_one_fewer(run: Trying, seen: Seen, best: Trial) -> list[tuple[Candidate, float]]:
    """What each device is worth: the first objective without it, on the search seeds."""
    objective, rows = run.study.objectives[0], []
    for candidate in fewer(run.layout, best.candidate):
        trial = Trial(candidate, run.layout.price(candidate))
        if objective.kind == "metric":
            run.fill([trial], len(best.seeds))
        else:
            trial.coverage, trial.coverage_worst = seen.share(candidate), seen.worst(candidate)
        if not trial.why:
            rows.append((candidate, trial.value(objective, run.study.scenarios)))
    return rows


def hung_beside(run: Trying, best: Trial, objective: Objective) -> list[Beside]:
    """The recommendation hung beside its place, told and not, beside the effect of a millimetre."""
    study = run.study
    seeds = study.held_out.seeds if study.held_out is not None else best.seeds
    own = {key: run.scenario(best.candidate, key) for key in run.prepared.scenarios}
    names = moved_sensors(study, run.prepared.scenario, next(iter(own.values())))
    if not names:
        return []
    base = run.values(objective, name_of(best.candidate), _weights(run), lambda key, _: own[key], seeds)
    wanted = [("1 mm, told: the noise", NOISE_M, 0.0, True)]
    wanted += [
        (f"{what}, {'' if told else 'not '}told", off, turn, told)
        for what, off, turn in MISPLACED
        for told in (True, False)
    ]
    rows = []
    for what, off_m, turn_deg, told in wanted:

        def hung(key: str, seed: int, how: tuple[float, float, bool] = (off_m, turn_deg, told)) -> Scenario:
            return misplaced(own[key], names, *how, seed)

        here = run.values(objective, f"{name_of(best.candidate)} {what}", _weights(run), hung, seeds)
        rows.append(beside(what, base, here))
    return rows
