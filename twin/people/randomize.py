"""Randomize the starts, times and speeds of a scenario's people by its seed."""

from __future__ import annotations

from typing import Any

from twin.scenario import Scenario
from twin.scenario.action import TOP_WALK_M_S
from twin.scenario.behaviour import RecordedPath, Walk
from twin.scenario.person import STEADY, Person, Randomize
from twin.streams import stream


def randomized(scenario: Scenario) -> Scenario:
    """Return the scenario with starts, times and speeds of its people randomized by its seed, or unchanged without such a
    wish.
    """
    if scenario.randomize == STEADY:
        return scenario
    people = {name: _drawn(person, scenario.randomize, scenario.seed, name) for name, person in scenario.people.items()}
    return scenario.model_copy(update={"people": people, "randomize": STEADY})


def _drawn(person: Person, randomize: Randomize, seed: int, name: str) -> Person:
    # the stream keeps its first name: another would draw other numbers
    x, y, onset, pace = stream(seed, "vary", name).uniform(-1, 1, 4).tolist()
    moved, later_s, factor = (
        (randomize.start_m * x, randomize.start_m * y),
        randomize.onset_s * onset,
        1 + randomize.speed * pace,
    )
    changes: dict[str, Any] = {"script": tuple(_action(each, moved, later_s, factor) for each in person.script)}
    if person.start is not None:
        changes["start"] = (person.start[0] + moved[0], person.start[1] + moved[1])
    return person.model_copy(update=changes)


def _action(action: Any, moved: tuple[float, float], later_s: float, factor: float) -> Any:
    """Return an action delayed by `later_s` [s] (never before the start), at `factor` times the speed; a path is moved whole
    [m].
    """
    changes: dict[str, Any] = {}
    if action.at_s is not None:
        changes["at_s"] = max(0.0, action.at_s + later_s)
    if isinstance(action, RecordedPath):
        started = action.points[0][0]
        changes["points"] = tuple(  # changes only how long the person stands at first
            (started + (t - started) / factor + (later_s if t > started else 0.0), x + moved[0], y + moved[1])
            for t, x, y in action.points
        )
    if isinstance(action, Walk):
        changes["speed_m_s"] = min(TOP_WALK_M_S, action.speed_m_s * factor)
    return action.model_copy(update=changes)
