"""Activities of people: the best time to show each action of each person in a scenario."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Mask
from twin.people.population import Population

SAMPLE_S = 0.1
"""Period at which people's actions are sampled [s]."""

_MOVES_M_S = 0.3
_FULL_STRIDE = 0.9
_STANDS_M_S = 0.1
_TURNS_RAD_S = 0.4
_SIDEWAYS_RAD, _BACKWARDS_RAD = np.radians(45), np.radians(135)
_SHORTEST_S = 0.3
_HOLDS = ("sit", "lie", "bend", "reach")
_GOES = ("wander", "walk", "run", "follow", "leave", "path")
_VERBS = {
    "wander": "wanders", "stand": "stands", "walk": "walks", "run": "runs", "turn": "turns", "sit": "sits",
    "lie": "lies", "bend": "bends", "reach": "reaches", "look": "looks", "follow": "follows", "meet": "meets",
    "path": "walks as recorded", "leave": "leaves",
}  # fmt: skip
_ATTEMPTS = {
    "sit": "goes to sit",
    "lie": "goes to lie down",
    "meet": "goes to meet",
    "bend": "bends",
    "reach": "reaches",
}
"""Verbs of an attempted action."""
SIDEWAYS, BACKWARDS = "walks sideways", "walks backwards"


@dataclass(frozen=True)
class Activity:
    """A person's activity at time t [s]."""

    person: str
    verb: str
    t: float

    def __str__(self) -> str:
        """Format the caption of an image."""
        return f"{self.person} {self.verb}, {self.t:.1f} s"


def verb(kind: str, under_way: bool = False) -> str:
    """Return the verb of an action of this kind, as in "anna sits"; `under_way`: "goes to sit", on the way there."""
    return _ATTEMPTS.get(kind, _VERBS[kind]) if under_way else _VERBS[kind]


def activities(population: Population, duration_s: float) -> list[Activity]:
    """Find one time for each activity of each person within the duration, by person, in order of time.

    The time is the middle of the longest stretch that shows the action: of sitting, lying, bending and reaching with the
    posture reached, of a meeting with both standing, of a walk with the person moving. An action that never gets so far is
    shown, and named, as an attempt. The population must be new, and is stepped to the end.
    """
    observed = _observe(population, duration_s)
    found = []
    for place, name in enumerate(population.names):
        for kind in _VERBS:
            at_it = observed.present[:, place] & (observed.doing[:, place] == kind)
            for verb, shows in _shows(kind, observed, place).items():
                there = (at_it if kind != "look" else observed.present[:, place]) & shows
                if kind in _ATTEMPTS and not there.any():
                    verb, there = _ATTEMPTS[kind], at_it
                middle = _middle(there, observed.speed[:, place])
                if middle is not None:
                    found.append(Activity(name, verb, float(observed.t[middle])))
    places = {name: place for place, name in enumerate(population.names)}
    return sorted(found, key=lambda activity: (places[activity.person], activity.t))


@dataclass(frozen=True, eq=False)
class _Observed:
    """Actions and motion of n people at k times; arrays (k, n), t (k,)."""

    t: NDArray[np.float64]
    present: Mask
    doing: NDArray[np.str_]
    holds: Mask
    looks: Mask
    speed: NDArray[np.float64]
    drift_rad: NDArray[np.float64]  # angle between way and heading, 0 to π
    turn_rate: NDArray[np.float64]


def _observe(population: Population, duration_s: float) -> _Observed:
    t = np.arange(0.0, duration_s, SAMPLE_S)
    doing, holds, looks, truths = [], [], [], []
    for sample in t.tolist():
        population.advance(sample)
        doing.append(population.doing)
        holds.append(population.holds_posture())
        looks.append(population.looks())
        truth = population.truth(sample)
        truths.append(replace(truth, present=truth.present.copy()))  # the array is overwritten later
    velocity = np.array([truth.vx + 1j * truth.vy for truth in truths]).reshape(len(t), -1)
    facing = np.exp(1j * np.array([truth.yaw for truth in truths])).reshape(len(t), -1)
    turned = np.zeros(facing.shape)
    turned[1:] = np.angle(facing[1:] / facing[:-1]) / SAMPLE_S
    return _Observed(
        t,
        np.array([truth.present for truth in truths]),
        np.array(doing),
        np.array(holds),
        np.array(looks),
        np.abs(velocity),
        np.abs(np.angle(velocity * facing.conj())),
        turned,
    )


def _shows(kind: str, observed: _Observed, place: int) -> dict[str, Mask]:
    """Return by verb when an action of a kind is visible, (k,)."""
    speed, drift_rad = observed.speed[:, place], observed.drift_rad[:, place]
    moves = speed > _MOVES_M_S
    if kind in _HOLDS:
        return {_VERBS[kind]: observed.holds[:, place]}
    if kind == "walk":
        sideways = (drift_rad > _SIDEWAYS_RAD) & (drift_rad < _BACKWARDS_RAD)
        backwards = drift_rad >= _BACKWARDS_RAD
        return {_VERBS[kind]: moves & ~sideways & ~backwards, SIDEWAYS: moves & sideways, BACKWARDS: moves & backwards}
    if kind in _GOES:
        return {_VERBS[kind]: moves}
    if kind == "turn":
        return {_VERBS[kind]: np.abs(observed.turn_rate[:, place]) > _TURNS_RAD_S}
    if kind == "look":
        return {_VERBS[kind]: observed.looks[:, place] & (observed.doing[:, place] != "meet")}
    return {_VERBS[kind]: (speed < _STANDS_M_S) & (observed.looks[:, place] == (kind == "meet"))}


def _middle(shows: Mask, speed: NDArray[np.float64]) -> int | None:
    """Return the middle of the longest stretch in which the flags (k,) hold; of a walk, at full stride.

    None without a long enough stretch. speed (k,) [m/s].
    """
    change = np.diff(np.concatenate([[0], shows.astype(int), [0]]))
    starts, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    if not len(starts):
        return None
    longest = int(np.argmax(ends - starts))
    if (ends[longest] - starts[longest]) * SAMPLE_S < _SHORTEST_S - 1e-9:
        return None
    stretch = np.arange(starts[longest], ends[longest])
    top = float(speed[stretch].max())
    if top > _MOVES_M_S:
        stretch = stretch[speed[stretch] > _FULL_STRIDE * top]
    middle = 0.5 * (starts[longest] + ends[longest] - 1)
    return int(stretch[np.argmin(np.abs(stretch - middle))])
