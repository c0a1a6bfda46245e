"""A fan keeps what it met of the room: every cast must come out as if it had not."""

import mujoco
import numpy as np
import pytest
from capsule_room import CapsuleWorld, capsule_model

from trackers.rig import Pose
from twin.instant.snapshot import Snapshot
from twin.sensors.rays import RayFan, trace_rays

_BEAMS = 720
_RANGE_M = 6.0
_DOOR_ROOM = """
<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <geom type="box" pos="0 4 1.5" size="4 0.05 1.5"/>
    <body name="door" mocap="true" pos="-3 2 1"><geom type="box" size="0.5 0.05 1"/></body>
    {people}
  </worldbody>
</mujoco>
"""


def fan_and_rays(pitch_rad: float = 0.0) -> tuple[RayFan, np.ndarray, np.ndarray]:
    pose = Pose(xyz=(0.0, 0.2, 1.0), rpy=(0.0, pitch_rad, np.pi / 2))
    angles = np.linspace(-np.pi, np.pi, _BEAMS)
    rays = np.stack([np.cos(angles), np.sin(angles), np.zeros(_BEAMS)], axis=1) @ pose.rotation.T
    return RayFan(pose.translation, rays, pose.rotation[:, 2], _RANGE_M), pose.translation, rays


def cast_anew(snapshot: Snapshot, origin_m: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    geom, distance_m = np.empty(_BEAMS, dtype=np.int32), np.empty(_BEAMS)
    trace_rays(snapshot, origin_m, rays, geom, distance_m, range_max_m=_RANGE_M)
    return geom, distance_m


@pytest.mark.parametrize("pitch_rad", [0.0, 0.3])
def test_every_cast_is_that_of_all_rays_at_everything(world: CapsuleWorld, pitch_rad: float):
    fan, origin_m, rays = fan_and_rays(pitch_rad)
    people = 0
    for t in np.arange(0.0, 2.0, 0.25):
        snapshot = world.snapshot(float(t))
        geom, distance_m = cast_anew(snapshot, origin_m, rays)
        found = [fan.trace(snapshot, slice(first, first + 240)) for first in range(0, _BEAMS, 240)]
        assert np.array_equal(np.concatenate([each for each, _ in found]), geom)
        assert np.array_equal(np.concatenate([each for _, each in found]), distance_m)
        people += int((snapshot.person_of_geom[geom[geom >= 0]] > 0).sum())
    assert people > 300


def test_a_room_that_moves_is_met_where_it_is():
    world = CapsuleWorld(capsule_model({1: (0.5, 2.0)}, _DOOR_ROOM))  # the door walks as the person does
    fan, origin_m, rays = fan_and_rays()
    door = mujoco.mj_name2id(world.model, mujoco.mjtObj.mjOBJ_BODY, "door")
    met = []
    for t in (0.0, 1.0, 2.0):
        snapshot = world.snapshot(t)
        geom, distance_m = cast_anew(snapshot, origin_m, rays)
        found = fan.trace(snapshot, slice(None))
        assert np.array_equal(found[0], geom)
        assert np.array_equal(found[1], distance_m)
        met.append(np.flatnonzero(world.model.geom_bodyid[geom] == door))
    assert all(each.size for each in met)
    assert not np.array_equal(met[0], met[2])


def test_another_model_is_another_room(world: CapsuleWorld):
    fan, origin_m, rays = fan_and_rays()
    fan.trace(world.snapshot(0.0), slice(None))
    empty = CapsuleWorld(capsule_model({})).snapshot(0.0)
    geom, distance_m = fan.trace(empty, slice(None))
    assert np.array_equal(geom, cast_anew(empty, origin_m, rays)[0])
    assert np.array_equal(distance_m, cast_anew(empty, origin_m, rays)[1])
