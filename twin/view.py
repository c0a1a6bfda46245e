"""A look inside a scenario at one moment: the room from above and from a corner, and every sensor's view."""

from __future__ import annotations

from math import isfinite
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from trackers.observations import NS_PER_S, FloorFrame, Image, LaserScan, Observation
from trackers.tracks import Track
from twin.outline import room_outline
from twin.preview import true_poses
from twin.recording.whole_file import whole_path
from twin.report.palette import LAYER_COLOURS, IdentityColours
from twin.report.panels import FloorPanel
from twin.scenario import Scenario
from twin.sensors.render import OffscreenRenderer, View
from twin.simulation import Simulation

_SIDE_PX = 640


def write_view(scenario: Scenario, t: float, path: Path) -> None:
    """Write a PNG of the scenario at time t [s]: from a corner, from above with the scans, each camera.

    Raises InputError for a time outside the scenario and a file that cannot be written.
    """
    if not (isfinite(t) and 0 <= t < scenario.duration_s):
        raise InputError(f"--at {t:g}: is not in the scenario; 0 up to {scenario.duration_s:g} s is expected")
    if path.suffix.lower() != ".png":
        raise InputError(f"--out {path}: is not the name of a picture; a name ending in .png is expected")
    with Simulation(scenario) as simulation:
        panels = [_from_a_corner(simulation, t)]
        looks = simulation.look(round(t * NS_PER_S))
        panels.append(_from_above(simulation, t, looks))
        panels += [_fitted(look) for look in looks.values() if isinstance(look, Image)]
    sheet = np.hstack(panels)
    _, png = cv2.imencode(".png", sheet[..., ::-1])
    with whole_path(path) as partial:
        partial.write_bytes(png.tobytes())


def _from_a_corner(simulation: Simulation, t: float) -> NDArray[np.uint8]:
    """The room from high in the corner beside the rig, looking across the tracked area."""
    area = simulation.world.scene.area
    snapshot = simulation.world.snapshot(t)
    middle = np.array([*area.mean(axis=0), 0.8])
    low = area.min(axis=0)
    eye_m = np.array([low[0] - 0.5, low[1] - 0.5, 2.3])
    forward = (middle - eye_m) / np.linalg.norm(middle - eye_m)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    view = View(tuple(forward), tuple(up), -0.9, 0.9, -0.9, 0.9, (0, 0, _SIDE_PX, _SIDE_PX))
    pixels = np.zeros((_SIDE_PX, _SIDE_PX, 4), dtype=np.uint8)
    with OffscreenRenderer(snapshot.model) as renderer:
        renderer.render(snapshot.data, eye_m, [view], pixels)
    return pixels[::-1, :, :3]


def _from_above(simulation: Simulation, t: float, looks: dict[str, Observation]) -> NDArray[np.uint8]:
    """The plan with the true people, what the scanners see and what the floors feel."""
    scans = {name: look for name, look in looks.items() if isinstance(look, LaserScan)}
    floors = {name: look for name, look in looks.items() if isinstance(look, FloorFrame)}
    world = simulation.world
    snapshot = world.snapshot(t)
    poses = true_poses(world.truth(round(t * NS_PER_S), {}))
    panel = np.zeros((_SIDE_PX, _SIDE_PX, 3), dtype=np.uint8)
    floor = FloorPanel(simulation.rig, room_outline(snapshot.model, snapshot.data), _SIDE_PX, _SIDE_PX)
    layers = {name: LAYER_COLOURS[place % len(LAYER_COLOURS)] for place, name in enumerate(simulation.rig.lasers())}
    names = {number: name for name, number in world.scene.ids.items()}
    nobody: list[Track] = []
    floor.draw(panel, scans, layers, nobody, {}, IdentityColours(), poses, names, floors)
    return panel


def _fitted(image: Image) -> NDArray[np.uint8]:
    """The picture scaled into a square, on black."""
    height, width, _ = image.rgb.shape
    scale = _SIDE_PX / max(height, width)
    small = cv2.resize(image.rgb, (round(width * scale), round(height * scale)), interpolation=cv2.INTER_AREA)
    panel = np.zeros((_SIDE_PX, _SIDE_PX, 3), dtype=np.uint8)
    top, left = (_SIDE_PX - small.shape[0]) // 2, (_SIDE_PX - small.shape[1]) // 2
    panel[top : top + small.shape[0], left : left + small.shape[1]] = small
    return panel
