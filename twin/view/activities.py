"""Activities of people: the best time to show each action of each person, and a sheet of all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Mask
from trackers.errors import InputError
from twin.messages import OnProgress, no_progress
from twin.people.population import Population, randomized
from twin.report.scene_pictures import (
    Portrait,
    check_picture_name,
    draw_portraits,
    label_strip,
    render_picture,
    tile_pictures,
    write_png,
)
from twin.scenario import Scenario
from twin.scenario.behaviour import companions
from twin.sensors.render import RendererOnDemand
from twin.view.free_camera import CameraSpace, standpoint_for
from twin.world.scene import build_scene, populate
from twin.world.world import World

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


_WIDE_PX = 1200
_COLUMNS = 5
_ACTIVITY_PX = (_WIDE_PX // _COLUMNS, 280)
_FIGURES_PER_ROW = 2
_FIGURE_PX = (_WIDE_PX // (4 * _FIGURES_PER_ROW), 250)
_FINER = 2
_COMPANION_WITHIN_M = 2.5
_AZIMUTH_DEG = {"bends": 75.0, "reaches": 60.0, "lies": 90.0, "sits": 40.0, "looks": 15.0}
_AZIMUTH_ELSE_DEG = 30.0
"""Best viewing angle of an action, in degrees from the person's heading."""


def write_people(scenario: Scenario, path: Path, on_progress: OnProgress = no_progress) -> list[Activity]:
    """Write a PNG of each person from the front, the side, behind and high, and of their activities; return these.

    Raises InputError for a scenario without people, a name not of an image, and a file that cannot be written.
    """
    check_picture_name(path)
    if not scenario.people:
        raise InputError(f"{scenario.source}: people: is empty; at least one person is expected")
    scenario = randomized(scenario)
    scene = build_scene(scenario)
    listed = list(scenario.people)
    found = activities(populate(scenario, scene), scenario.duration_s)
    found.sort(key=lambda activity: (listed.index(activity.person), activity.t))
    figures = [Portrait(_label(scenario, name), scene.appearances[name]) for name in listed]
    sheet = [draw_portraits(figures, columns=min(_FIGURES_PER_ROW, len(figures)), cell_px=_FIGURE_PX)]
    if found:
        pictures = _pictures(scenario, found, on_progress)
        panels = [np.vstack([label_strip(str(activity), _ACTIVITY_PX[0]), pictures[activity]]) for activity in found]
        sheet.append(tile_pictures(panels, _COLUMNS))
    write_png(path, _stacked(sheet))
    return found


def _pictures(
    scenario: Scenario, found: Sequence[Activity], on_progress: OnProgress
) -> dict[Activity, NDArray[np.uint8]]:
    """Draw an image of each activity, in the order of time."""
    world = World(scenario)
    names = world.population.names
    pictures = {}
    aspect = _ACTIVITY_PX[0] / _ACTIVITY_PX[1]
    with RendererOnDemand(lambda: world.scene.model) as renderer:
        room = None
        for done, activity in enumerate(sorted(found, key=lambda each: each.t), start=1):
            snapshot = world.snapshot(activity.t)
            room = room or CameraSpace(snapshot, world.scene.floor)
            truth = world.population.truth(activity.t)
            place = names.index(activity.person)
            other = _companion(scenario, activity)
            near = None
            if other is not None and truth.present[names.index(other)]:
                there = names.index(other)
                apart = np.hypot(truth.x[there] - truth.x[place], truth.y[there] - truth.y[place])
                near = world.scene.ids[other] if apart <= _COMPANION_WITHIN_M else None
            stand = standpoint_for(
                snapshot,
                room,
                world.scene.ids[activity.person],
                float(truth.yaw[place]),
                aspect,
                _AZIMUTH_DEG.get(activity.verb, _AZIMUTH_ELSE_DEG),
                near,
            )
            pictures[activity] = render_picture(renderer(), snapshot.data, stand, _ACTIVITY_PX, finer=_FINER)
            on_progress("pictures", done, len(found))
    return pictures


def _companion(scenario: Scenario, activity: Activity) -> str | None:
    """Return the person met or followed; None without one."""
    for action in scenario.people[activity.person].script:
        if action.kind in ("meet", "follow") and verb(action.kind) == activity.verb:
            return companions(action)[0][1]
    return None


def _label(scenario: Scenario, name: str) -> str:
    height = scenario.people[name].height_m
    return name if height is None else f"{name}, {height:.2f} m"


def _stacked(parts: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Stack images vertically, the narrower ones filled up with white."""
    width = max(part.shape[1] for part in parts)
    return np.vstack(
        [np.pad(part, ((0, 0), (0, width - part.shape[1]), (0, 0)), constant_values=255) for part in parts]
    )
