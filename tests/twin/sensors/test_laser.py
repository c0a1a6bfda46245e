"""The ideal scanner: geometry, limits, labels, sweep."""

import mujoco
import numpy as np
import pytest
from capsule_room import CapsuleWorld, capsule_model

from trackers.rig import LaserSensor, Pose
from twin.instant.snapshot import Snapshot
from twin.scenario.sensor_descriptions import LaserDescription
from twin.sensors.laser import Laser, reflected, returns_echo
from twin.sensors.rays import trace_rays

_ARENA = """
<mujoco>
  <worldbody>
    <geom type="box" pos="0 3.05 1" size="10 0.05 1"/>
    <geom type="box" pos="0 1 0.3" size="0.1 0.1 0.3" group="5"/>
    <geom type="box" pos="0 1.5 0.3" size="0.1 0.1 0.3" group="4"/>
    <geom name="coarse" type="box" pos="-2 2 1" size="0.2 0.2 1" group="3"/>
    {people}
  </worldbody>
</mujoco>
"""


def laser(yaw_rad: float = np.pi / 2, height_m: float = 0.95, beams: int = 361, **changes: float) -> Laser:
    pose = Pose(xyz=(0.0, 0.0, height_m), rpy=(0.0, 0.0, yaw_rad))
    options = {"range_min_m": 0.05, "range_max_m": 8.0, "sweep_time_s": 0.0} | changes
    return Laser(
        "waist",
        LaserSensor(topic="/waist/scan", room_from_sensor=pose),
        beams=beams,
        angle_min_rad=-np.pi / 2,
        angle_increment_rad=np.pi / (beams - 1),
        **options,
    )


def look(scanner: Laser, world: CapsuleWorld, t: float = 0.0):
    snapshots = (world.snapshot(t + offset) for offset in scanner.instants_s)
    reading, _ = scanner.observe(round(t * 1e9), snapshots, None, np.random.default_rng(0))
    return reading.observation, reading.truth["person_of_ray"]


def test_ranges_to_a_wall_and_a_capsule_are_exact():
    world = CapsuleWorld(capsule_model({1: (0.5, 2.0)}, _ARENA), speed=0)
    scan, person = look(laser(height_m=1.2), world)
    bearing = np.pi / 2 + scan.angles_rad  # in the room, counter-clockwise from x
    wall = 3.0 / np.sin(bearing)
    free = (person == 0) & (wall > 0) & (wall < 8) & (np.abs(bearing - 3 * np.pi / 4) > 0.3)
    assert free.sum() > 150
    np.testing.assert_allclose(scan.ranges_m[free], wall[free], rtol=1e-6)
    # The trunk is a cylinder of radius 0.15 m at this height: its near side along the beam through its axis.
    axis = np.hypot(0.5, 2.0)
    through = np.argmin(np.abs(bearing - np.arctan2(2.0, 0.5)))
    assert person[through] == 1
    assert scan.ranges_m[through] == pytest.approx(axis - 0.15, abs=2e-4)


def test_beams_go_counter_clockwise_from_the_right():
    world = CapsuleWorld(capsule_model({1: (1.5, 1.0), 2: (-1.5, 1.0)}, _ARENA), speed=0)
    _, person = look(laser(), world)
    assert person[:180].max() == 1
    assert person[181:].max() == 2


def test_no_return_is_inf_and_too_near_is_nan():
    world = CapsuleWorld(capsule_model({1: (0.0, 2.0)}, _ARENA), speed=0)
    scan, person = look(laser(range_min_m=1.9, range_max_m=3.5), world)
    assert np.isnan(scan.ranges_m[180])
    assert person[180] == 1
    assert np.isposinf(scan.ranges_m[0])
    assert person[0] == 0
    far, _ = look(laser(yaw_rad=-np.pi / 2), world)
    assert np.isposinf(far.ranges_m).all()


def test_people_beyond_the_range_are_no_labels():
    world = CapsuleWorld(capsule_model({1: (0.0, 2.0)}, _ARENA), speed=0)
    scan, person = look(laser(range_max_m=1.5), world)
    assert np.isposinf(scan.ranges_m).all()
    assert (person == 0).all()


def test_rays_meet_groups_0_to_3_only():
    world = CapsuleWorld(capsule_model({}, _ARENA), speed=0)
    scan, _ = look(laser(height_m=0.3), world)
    assert scan.ranges_m[180] == pytest.approx(3.0, rel=1e-6)
    assert scan.ranges_m[270] < 2.8  # the coarse body in group 3


def test_labels_agree_with_single_rays(world: CapsuleWorld):
    scan, person = look(laser(), world)
    snapshot = world.snapshot(0.0)
    geom = np.zeros(1, dtype=np.int32)
    for beam in range(0, 361, 7):
        bearing = np.pi / 2 + scan.angles_rad[beam]
        ray = np.array([np.cos(bearing), np.sin(bearing), 0.0])
        distance = mujoco.mj_ray(snapshot.model, snapshot.data, np.array([0, 0, 0.95]), ray, None, 1, -1, geom)
        assert scan.ranges_m[beam] == pytest.approx(distance if 0 <= distance <= 8 else np.inf, rel=1e-6)
        assert person[beam] == (world.person_of_geom[geom[0]] if 0 <= distance <= 8 else 0)
    assert set(np.unique(person)) == {0, 1, 2, 3, 4, 5}


def test_a_tilted_scanner_meets_the_floor():
    pose = Pose(xyz=(0.0, 0.0, 1.0), rpy=(0.0, np.pi / 4, np.pi / 2))
    scanner = Laser(
        "down",
        LaserSensor(topic="/down/scan", room_from_sensor=pose),
        beams=3,
        angle_min_rad=-0.1,
        angle_increment_rad=0.1,
        range_min_m=0.0,
        range_max_m=8.0,
    )
    scan, _ = look(scanner, CapsuleWorld(capsule_model({}), speed=0))
    assert scan.ranges_m[1] == pytest.approx(np.sqrt(2), rel=1e-6)


def test_the_sweep_sees_each_beam_at_its_own_time():
    # A wall of a person passing along x at 2 m/s under a scanner whose sweep takes 0.1 s from right to left.
    world = CapsuleWorld(capsule_model({1: (0.0, 2.0)}, _ARENA), speed=2.0)
    still = laser()
    sweeping = laser(sweep_time_s=0.1)
    assert sweeping.instants_s[0] >= 0
    assert sweeping.instants_s[-1] <= 0.1
    scan, person = look(sweeping, world)
    assert scan.sweep_time_s == 0.1
    beams = np.arange(361)
    for beam in np.flatnonzero(person == 1)[::5]:
        time_of_beam = 0.1 * beams[beam] / 360
        at_time, _ = look(still, world, time_of_beam)
        instant = min(sweeping.instants_s, key=lambda offset: abs(offset - time_of_beam))
        assert abs(instant - time_of_beam) <= 0.0026
        near, _ = look(still, world, instant)
        assert scan.ranges_m[beam] == near.ranges_m[beam]
        assert scan.ranges_m[beam] == pytest.approx(at_time.ranges_m[beam], abs=0.08)
    hit = np.flatnonzero(person == 1).mean()
    assert hit < 175  # met halfway through the sweep, 0.1 m to the right (earlier beams) of where it began


def test_angles_are_as_exact_as_the_message():
    scan, _ = look(laser(), CapsuleWorld(capsule_model({}, _ARENA)))
    for value in (scan.angle_min_rad, scan.angle_increment_rad, scan.range_min_m, scan.range_max_m):
        assert value == float(np.float32(value))


def test_too_few_snapshots_are_loud(world: CapsuleWorld):
    scanner = laser(sweep_time_s=0.05)
    snapshot: Snapshot = world.snapshot(0.0)
    with pytest.raises(ValueError, match="shorter"):
        scanner.observe(0, [snapshot], None, np.random.default_rng(0))


@pytest.mark.parametrize("mount", [{}, {"pitch_deg": 20.0, "roll_deg": -15.0}])
def test_leaving_out_what_the_plane_cannot_meet_changes_no_range(world: CapsuleWorld, mount: dict):
    """The geoms left out of a planar bundle are found by their bounding spheres: every ray must come out the same."""
    snapshot = world.snapshot(0.0)
    rig = LaserDescription.model_validate(
        {"kind": "laser", "rate_hz": 10, "mount": {"xyz": [0, 0.2, 1.0], "yaw_deg": 90, **mount}}
    ).rig_sensor("laser")
    pose = rig.room_from_sensor
    angles = np.linspace(-np.pi, np.pi, 720)
    directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(720)], axis=1) @ pose.rotation.T
    found = []
    for normal in (None, pose.rotation[:, 2]):
        geom, distance_m = np.empty(720, dtype=np.int32), np.empty(720)
        trace_rays(snapshot, pose.translation, directions, geom, distance_m, normal=normal)
        found.append((geom, distance_m))
    assert np.array_equal(found[0][0], found[1][0])
    assert np.array_equal(found[0][1], found[1][1])
    assert (snapshot.person_of_geom[found[0][0]] > 0).any()


def test_echoes_end_where_reflectivity_angle_and_distance_say():
    turned = np.array([0.0, np.sqrt(0.75), 0.5])
    model = mujoco.MjModel.from_xml_string("""
        <mujoco><asset><material name="grey" rgba="0.735 0.2 0.2 1"/></asset>
        <worldbody><geom size="1" rgba="0 0 0 1"/><geom size="1" material="grey"/></worldbody></mujoco>""")
    beams = np.tile([0.0, 0.0, -1.0], (2, 1))
    seen = reflected(model, np.array([0, 1]), np.stack([[0.0, 0.0, 1.0], turned]), beams)
    np.testing.assert_allclose(seen, [0.02, 0.25], atol=1e-3)
    # a surface of 10 % at 4 m is just detected; a quarter of it at half the range
    for share, edge_m in ((0.1, 4.0), (0.025, 2.0), (0.9, 12.0)):
        for distance_m, expected in ((0.7 * edge_m, 1.0), (edge_m, 0.5), (1.4 * edge_m, 0.0)):
            echo = returns_echo(np.full(2000, share), np.full(2000, distance_m), 4.0, np.random.default_rng(0))
            assert echo.mean() == pytest.approx(expected, abs=0.04)


def test_black_clothes_are_lost_before_the_wall_behind_them_and_bright_ones_are_not():
    world = CapsuleWorld(capsule_model({1: (-0.8, 2.0), 2: (0.8, 2.0)}, _ARENA), speed=0)
    every, met = look(laser(height_m=1.2, beams=1441), world)
    scan, person = look(laser(height_m=1.2, beams=1441, range_10_percent_m=1.5), world)
    there = np.isfinite(scan.ranges_m)
    assert np.array_equal(scan.ranges_m[there], every.ranges_m[there])
    assert set(person) == {0, 1} and np.isposinf(scan.ranges_m[met == 2]).all()
    # the bright one's edges, which the beam grazes, are lost
    lost = np.flatnonzero((met == 1) & ~there)
    assert 0 < lost.size < 0.2 * (met == 1).sum()
    far, _ = look(laser(height_m=1.2, beams=1441, range_10_percent_m=40.0), world)
    assert np.isfinite(far.ranges_m[met == 2]).mean() > 0.8
