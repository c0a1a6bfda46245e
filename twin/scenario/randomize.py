"""Runs that differ: what of a scenario's people each seed has otherwise, beside looks and noise."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pydantic import Field

from trackers.configuration import Strict
from twin.scenario.behaviour import TOP_WALK_M_S, Path, Walk
from twin.scenario.people import Person
from twin.streams import stream

if TYPE_CHECKING:
    from twin.scenario.model import Scenario


class Randomize(Strict):
    """How far each person's start, times and speed are drawn from what their script says, evenly, by the scenario's seed."""

    start_m: float = Field(default=0.0, ge=0, le=2, description="most that x and y of a start, or of a path, move [m]")
    onset_s: float = Field(
        default=0.0, ge=0, le=10, description="most that a person's `at_s`, or path, come earlier or later [s]"
    )
    speed: float = Field(default=0.0, ge=0, le=0.5, description="most that a person walks slower or faster, as a share")


STEADY = Randomize()


def randomized(scenario: Scenario) -> Scenario:
    """The scenario with its people as this seed has them; itself where nothing varies."""
    if scenario.randomize == STEADY:
        return scenario
    people = {name: _drawn(person, scenario.randomize, scenario.seed, name) for name, person in scenario.people.items()}
    return scenario.model_copy(update={"people": people, "randomize": STEADY})


def _drawn(person: Person, randomize: Randomize, seed: int, name: str) -> Person:
    # the stream is called as it always was: another name would draw other numbers
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
    """One action, its time later (none before the start), walked `factor` as fast; a path moved as a whole."""
    changes: dict[str, Any] = {}
    if action.at_s is not None:
        changes["at_s"] = max(0.0, action.at_s + later_s)
    if isinstance(action, Path):
        begun = action.points[0][0]
        changes["points"] = tuple(  # the person stands at first for longer or shorter
            (begun + (t - begun) / factor + (later_s if t > begun else 0.0), x + moved[0], y + moved[1])
            for t, x, y in action.points
        )
    if isinstance(action, Walk):
        changes["speed_m_s"] = min(TOP_WALK_M_S, action.speed_m_s * factor)
    return action.model_copy(update=changes)
