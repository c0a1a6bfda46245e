"""Whom a ray to a point on a body meets first: bodies that are not cast must change nobody."""

import mujoco
import numpy as np
import pytest

from trackers.cameras import FisheyeIntrinsics
from twin.instant.snapshot import Snapshot
from twin.scenario import load_scenario
from twin.sensors.rays import trace_rays
from twin.truth.visibility import SensorView, first_hits
from twin.world.simulation import Simulation

_TIMES_S = np.arange(0.0, 8.0, 0.5)


def met_one_by_one(view: SensorView, snapshot: Snapshot, points: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """The same by rays at everything, to all points, whether or not they count."""
    if view.is_scanner:
        normal = view.room_from_sensor_rotation[:, 2]
        points = points - ((points - view.room_from_sensor_xyz) @ normal)[..., None] * normal
    way = points - view.room_from_sensor_xyz
    far = np.linalg.norm(way, axis=-1)
    geom, hit_m = np.empty(far.size, dtype=np.int32), np.empty(far.size)
    trace_rays(snapshot, view.room_from_sensor_xyz, (way / far[..., None]).reshape(-1, 3), geom, hit_m)
    reaches = (hit_m < 0) | (hit_m >= far.ravel() - 1e-9)
    return np.where(reaches, np.repeat(ids, far.shape[1]), snapshot.person_of_geom[geom]).reshape(far.shape)


@pytest.mark.parametrize("name", ["lab-five-people", "home-three-people"])
def test_who_hides_whom_is_what_rays_at_everything_say(name: str):
    scenario = load_scenario(name, ["seed=1000", "background=none"])
    with Simulation(scenario) as simulation:
        world, hidden = simulation.world, 0
        ids = np.array([world.scene.ids[each] for each in world.scene.names], dtype=np.int16)
        for t in _TIMES_S:
            snapshot = world.snapshot(float(t))
            points = snapshot.data.site_xpos[world.scene.bodies.point_site]
            for view in simulation.views.values():
                counted, met = first_hits(view, snapshot, points, ids)
                asked = met >= 0
                assert not (asked & ~counted).any()
                assert np.array_equal(met[asked], met_one_by_one(view, snapshot, points, ids)[asked])
                hidden += int((asked & (met != ids[:, None])).sum())
    assert hidden > 100


@pytest.mark.parametrize("is_scanner", [True, False])
@pytest.mark.parametrize(("other_m", "whom"), [(1.5, 2), (2.1, 1), (2.6, 1)])
def test_ones_own_body_comes_before_what_is_inside_it(other_m: float, whom: int, is_scanner: bool):
    """A point on the back of a ball, with another's smaller ball before it, in it and behind it."""
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom type="sphere" pos="2 0 1" size="0.3"/>'
        f'<geom type="sphere" pos="{other_m} 0 1" size="0.05"/></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    snapshot = Snapshot(0.0, model, data, np.array([1, 2], dtype=np.int16))
    turn = np.eye(3) if is_scanner else np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    lens = FisheyeIntrinsics(width=64, height=64, fx=40, fy=40, cx=31.5, cy=31.5, field_of_view_rad=np.pi / 2)
    view = SensorView(np.array([0.0, 0.0, 1.0]), turn, np.pi / 4 if is_scanner else lens, 8.0)
    counted, met = first_hits(view, snapshot, np.array([[[2.3, 0.0, 1.0]]]), np.array([1], dtype=np.int16))
    assert counted.all()
    assert met.tolist() == [[whom]]


def test_a_fisheye_does_not_see_what_its_picture_cuts_off():
    """A lens whose field of view is wider than its picture is high: what lies above the picture's edge is not in it."""
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="sphere" pos="0 0 2" size="0.1"/></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    snapshot = Snapshot(0.0, model, data, np.array([1], dtype=np.int16))
    places = np.array([[[0.0, np.tan(angle) * 2.0, 2.0]] for angle in (0.0, 0.35, 0.55)])
    view = SensorView(
        np.zeros(3),
        np.eye(3),
        FisheyeIntrinsics(width=200, height=80, fx=80, fy=80, cx=99.5, cy=39.5, field_of_view_rad=2.0),
        np.inf,
    )
    _, met = first_hits(view, snapshot, places, np.array([1, 1, 1], dtype=np.int16))
    assert met[:, 0].tolist() == [1, 1, -1]  # the picture ends 0.5 rad above its middle, the field of view 1 rad


def test_a_scanner_counts_what_lies_within_15_cm_of_its_plane():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="sphere" pos="2 0 1" size="0.3"/></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    snapshot = Snapshot(0.0, model, data, np.array([1], dtype=np.int16))
    points = np.array([[[1.8, 0.0, 1.0 + off] for off in (-0.2, -0.14, 0.0, 0.14, 0.16)]])
    view = SensorView(np.array([0.0, 0.0, 1.0]), np.eye(3), np.pi / 4, 8.0)
    counted, met = first_hits(view, snapshot, points, np.array([1], dtype=np.int16))
    assert counted.tolist() == [[False, True, True, True, False]]
    assert met.tolist() == [[-1, 1, 1, 1, -1]]
