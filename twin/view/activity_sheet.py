"""Sheet of a scenario's people: each from four sides, and below all activities of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from twin.people.randomize import randomized
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
from twin.view.activities import Activity, activities, verb
from twin.view.free_camera import CameraSpace, standpoint_for
from twin.world.scene import build_scene, populate
from twin.world.world import World

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


def write_people(
    scenario: Scenario, path: Path, on_progress: Callable[[str, float, float], None] | None = None
) -> list[Activity]:
    """Write a PNG of each person from the front, the side, behind and high, and of their activities; return these.

    Raises InputError for a scenario without people, a name not of an image, and a file that cannot be written.
    """
    check_picture_name(path)
    if not scenario.people:
        raise InputError(f"scenario {scenario.name!r}: people: is empty; at least one person is expected")
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
    scenario: Scenario, found: Sequence[Activity], on_progress: Callable[[str, float, float], None] | None
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
            pictures[activity] = render_picture(
                renderer(), snapshot.data, stand.eye, stand.target, stand.half_height, _ACTIVITY_PX, finer=_FINER
            )
            if on_progress is not None:
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
