"""Rooms made for a test, what sensors report of them, and whether cameras, rays and people agree on what is there."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twin.instant.snapshot import Snapshot
from twin.report.scene_pictures import axes_towards
from twin.scenario import load_scenario
from twin.scenario.scenario import Scenario
from twin.sensors.rays import trace_rays
from twin.sensors.render import OffscreenRenderer
from twin.sensors.render_scene import RenderView
from twin.world.simulation import Simulation

WALLS = """
<geom name="west" type="box" pos="-3.1 0 1.25" size="0.1 3.2 1.25" rgba=".8 .8 .7 1"/>
<geom name="east" type="box" pos="3.1 0 1.25" size="0.1 3.2 1.25" rgba=".8 .7 .8 1"/>
<geom name="south" type="box" pos="0 -3.1 1.25" size="3.2 0.1 1.25" rgba=".7 .8 .8 1"/>
<geom name="north" type="box" pos="0 3.1 1.25" size="3.2 0.1 1.25" rgba=".7 .7 .8 1"/>
"""
FLOOR = '<geom name="floor" type="plane" size="4 4 0.1" rgba=".5 .5 .5 1"/>'
LAMP = '<light name="lamp" type="directional" dir="0.3 0.4 -1" diffuse=".6 .6 .6"/>'
SCENARIO = """
name: made
room: room.xml
duration_s: 2
people: {ann: {start: [1.5, 1.5], script: {kind: stand}}}
sensors:
  laser: {kind: laser, role: waist, rate_hz: 5, noise: off, mount: {xyz: [-2.6, -2.6, 0.4], yaw_deg: 45}}
  camera: {kind: camera, rate_hz: 5, size: [80, 60], noise: off, field_of_view_deg: 80,
           mount: {xyz: [-2.6, -2.6, 1.8], yaw_deg: 45, pitch_deg: 15}}
  fisheye: {kind: fisheye, rate_hz: 5, size: [80, 80], noise: off, mount: {xyz: [-2.6, 0, 1.5], yaw_deg: 0}}
  depth: {kind: stereo, rate_hz: 5, size: [80, 60], noise: off, mode: ideal, vertical_field_of_view_deg: 60,
          baseline_m: 0.1, mount: {xyz: [-2.6, 2.6, 1.8], yaw_deg: -45, pitch_deg: 15}}
  floor: {kind: floor, rate_hz: 5, noise: off}
"""
_SIDE_PX = 80
Place = tuple[float, float, float]


def room_of(inside: str = "", *, before: str = "", after: str = "", lamp: str = LAMP, floor: str = FLOOR) -> str:
    """A room of 6 m x 6 m with a lamp and these things in it, as MJCF."""
    return f"<mujoco>{before}<worldbody>{lamp}{floor}{WALLS}{inside}</worldbody>{after}</mujoco>"


def scenario_in(folder: Path, room: str, changes: list[str] | None = None) -> Scenario:
    """The scenario of one person who stands in a room, with a sensor of each kind."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "room.xml").write_text(room)
    (folder / "scenario.yaml").write_text(SCENARIO)
    return load_scenario(str(folder / "scenario.yaml"), changes or [])


def reports(scenario: Scenario) -> dict[str, bytes]:
    """What every sensor reports of the first second's end, bit by bit, and the boxes around what cameras see of people."""
    with Simulation(scenario) as simulation:
        looks = simulation.look(10**9)
        boxes = simulation.boxes(1.0)
    found = {name: repr(each).encode() for name, each in boxes.items()}
    for name, look in looks.items():
        for field in ("rgb", "depth_m", "ranges_m", "values"):
            if (values := getattr(look, field, None)) is not None:
                found[f"{name}.{field}"] = np.ascontiguousarray(values).tobytes()
    return found


def disagreements(snapshot: Snapshot, eyes_m: list[Place], target_m: Place) -> list[float]:
    """Share of the pixels of a picture, from each eye towards the target [m], where another geom is drawn than a ray meets."""
    found = []
    numbers = np.zeros((_SIDE_PX, _SIDE_PX, 4), dtype=np.uint8)
    steps = (np.arange(_SIDE_PX) + 0.5) / _SIDE_PX * 2 - 1
    with OffscreenRenderer(snapshot.model) as renderer:
        for eye in map(np.array, eyes_m):
            right, up, forward = axes_towards(eye, np.array(target_m))
            directions = forward + 0.8 * steps[None, :, None] * right + 0.8 * steps[:, None, None] * up
            directions = (directions / np.linalg.norm(directions, axis=-1, keepdims=True)).reshape(-1, 3)
            view = RenderView(tuple(forward), tuple(up), -0.8, 0.8, -0.8, 0.8, (0, 0, _SIDE_PX, _SIDE_PX))
            geom_of_number = renderer.render(snapshot.data, eye, [view], None, numbers=numbers)
            drawn = geom_of_number[numbers[..., :3].astype(int) @ [1, 256, 65536]].reshape(-1)
            met, distance = np.empty(len(directions), dtype=np.int32), np.empty(len(directions))
            trace_rays(snapshot, eye, np.ascontiguousarray(directions), met, distance)
            found.append(float((drawn != met).mean()))
    return found
