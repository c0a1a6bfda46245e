"""Housings that drive: their scanners, their odometry, and people about them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from trackers.configuration import validate
from trackers.errors import InputError
from trackers.observations import LaserScan, Odometry
from twin.recording.bags.bag import open_bag
from twin.recording.reader import Recording
from twin.recording.rig_of_bag.transforms import TransformTree
from twin.run.live import run_scenario
from twin.scenario import Scenario
from twin.sensors.odometry import OdometryDescription
from twin.truth.truth_types import BasesFrame, TruthDetail, TruthFrame
from twin.world.simulation import Simulation
from twin.world.world import PoseCache, World

EXACT: dict[str, Any] = {"drift": 0.0, "noise": 0.0}
STANDS = {"kind": "path", "waypoints": [[0.3, 1.0]]}
AROUND = {"kind": "path", "waypoints": [[1.0, 1.2], [0.9, 2.4], [-1.0, 2.4], [-1.0, 1.0]], "repeat": True}


def driving(drive: Any, housing: dict[str, Any] | None = None, **changes: Any):
    laser = {
        "kind": "laser",
        "rate_hz": 10,
        "mount": {"xyz": [0.1, 0.0, 0.4]},
        "noise": "off",
        "field_of_view_deg": 270,
    }
    mount = {"xyz": [0.3, 1.0, 0.0]}
    return validate(
        Scenario,
        {
            "name": "driving",
            "room": "lab",
            "duration_s": 4,
            "people": {},
            "housings": {"robot": {"mount": mount, "drive": drive, "odometry": EXACT} | (housing or {})},
            "sensors": {"scan": laser | {"housing": "robot", "sweep_time_s": 0.09, "range_max_m": 20}},
        }
        | changes,
        "test",
    )


def readings(scenario, on_detail=None):
    with Simulation(scenario, images=False, on_detail=on_detail) as simulation:
        return simulation, list(simulation.deliveries())


def of(delivered, kind):
    return [each.observation for each in delivered if isinstance(each.observation, kind)]


def test_a_robot_that_stands_records_what_a_sensor_that_stands_there_does():
    _, robot = readings(driving(STANDS))
    _, fixed = readings(driving(None))
    moved, still = of(robot, LaserScan), of(fixed, LaserScan)
    assert len(moved) == len(still) == 40
    for one, other in zip(moved, still, strict=True):
        assert np.allclose(one.ranges_m, other.ranges_m, atol=1e-5)


def test_a_robot_hides_no_person_from_its_own_scanner_in_the_truth():
    seen = {}
    for name, housing in {"bare": {}, "in a body": {"body": {"radius_m": 0.25, "height_m": 0.5}}}.items():
        people = {"anna": {"start": [1.5, 1.6], "script": {"kind": "stand"}}}
        truth: list[TruthFrame] = []
        scenario = driving(STANDS, housing, people=people, duration_s=0.3)
        with Simulation(scenario, images=False, on_truth=truth.append) as simulation:
            list(simulation)
        seen[name] = [each.visible["scan"] for frame in truth for each in frame.people]
    assert min(seen["bare"]) > 0.3
    assert seen["in a body"] == seen["bare"]


def test_odometry_without_errors_is_the_truth_and_walls_are_straight_when_each_beam_is_put_where_it_was_taken():
    details: list[TruthDetail] = []
    simulation, delivered = readings(driving(AROUND), details.append)
    rig = simulation.rig
    start = rig.odometry()["robot"].room_from_sensor.matrix
    poses = of(delivered, Odometry)
    bases = {each.stamp_ns: each.bases for each in details if isinstance(each, BasesFrame)}
    for each in poses:
        (base,), at = bases[each.stamp_ns], start @ each.frame_from_base
        np.testing.assert_allclose((base.x, base.y, base.z, np.cos(base.yaw)), (*at[:3, 3], at[0, 0]), atol=1e-9)
    for each in delivered:
        if isinstance(each.observation, Odometry):
            assert np.allclose(each.observation.frame_from_base, each.reading.truth["frame_from_base"], atol=1e-12)
    ways = np.array([each.frame_from_base[:2, 3] for each in poses])
    assert np.hypot(*np.diff(ways, axis=0).T).sum() > 1.0
    t = np.array([each.t for each in poses])
    x, y = ways.T
    yaw = np.unwrap([np.arctan2(each.frame_from_base[1, 0], each.frame_from_base[0, 0]) for each in poses])
    off_m: dict[str, list[np.ndarray]] = {"deskewed": [], "at the stamp": []}
    for scan in of(delivered, LaserScan)[5:-2]:
        hit = np.isfinite(scan.ranges_m)
        taken = scan.t + np.arange(len(scan.ranges_m)) / (len(scan.ranges_m) - 1) * scan.sweep_time_s
        for name, at in (("deskewed", taken[hit]), ("at the stamp", np.full(hit.sum(), scan.t))):
            turn = np.exp(1j * (np.interp(at, t, yaw) + 0j))
            beam = 0.1 + scan.ranges_m[hit] * np.exp(1j * scan.angles_rad[hit])
            place = np.interp(at, t, x) + 1j * np.interp(at, t, y) + turn * beam
            off_m[name].append(from_walls(np.stack([place.real, place.imag], axis=1) + start[:2, 3], simulation))
    straight, skewed = (np.concatenate(off_m[name]) for name in ("deskewed", "at the stamp"))
    assert np.percentile(straight, 99) < 0.015
    assert np.percentile(skewed, 99) > 3 * np.percentile(straight, 99)


def from_walls(places: np.ndarray, simulation: Simulation) -> np.ndarray:
    """Distances (n,) [m] of places from the nearest surface that a scanner standing amid the room would see."""
    scenario = driving(None, sensors={
        f"s{k}": {"kind": "laser", "rate_hz": 1, "mount": {"xyz": [x, y, 0.4]}, "noise": "off", "field_of_view_deg": 360,
                  "beams": 7200, "range_max_m": 20}
        for k, (x, y) in enumerate([(0.3, 1.0), (-0.8, 1.8), (0.9, 2.2)])
    }, housings={}, duration_s=0.5)  # fmt: skip
    if not SEEN:
        fixed, delivered = readings(scenario)
        for each in delivered:
            scan, pose = each.observation, fixed.rig.sensors[each.observation.sensor].room_from_sensor
            assert isinstance(scan, LaserScan)
            hit = np.isfinite(scan.ranges_m)
            ends = scan.ranges_m[hit, None] * np.stack(
                [np.cos(scan.angles_rad[hit]), np.sin(scan.angles_rad[hit])], axis=1
            )
            SEEN.append(ends + pose.xyz[:2])
    from scipy.spatial import KDTree

    return KDTree(np.concatenate(SEEN)).query(places)[0]


SEEN: list[np.ndarray] = []


def test_people_keep_clear_of_a_robot_and_it_of_them_and_rays_meet_it():
    people = {name: {"script": {"kind": "wander"}} for name in ("ann", "ben", "cleo")}
    housing = {"drive": {"kind": "wander"}, "body": {"radius_m": 0.2, "height_m": 0.5}}
    wall = {"kind": "laser", "rate_hz": 10, "mount": {"xyz": [0.0, 0.15, 0.3], "yaw_deg": 90}, "noise": "off"}
    scenario = driving(None, housing, people=people, duration_s=8, sensors={"wall": wall, **SCAN})
    truth = []
    with Simulation(scenario, images=False, on_truth=truth.append) as simulation:
        delivered = list(simulation.deliveries())
    start = simulation.rig.odometry()["robot"].room_from_sensor.matrix
    where = {each.observation.stamp_ns: (start @ each.observation.frame_from_base)[:2, 3] for each in delivered
             if isinstance(each.observation, Odometry)}  # fmt: skip
    gaps = [
        np.hypot(*(np.array([p.x, p.y]) - where[f.stamp_ns])) for f in truth if f.stamp_ns in where for p in f.people
    ]
    assert min(gaps) > 0.4
    meets = 0
    for scan in of(delivered, LaserScan):
        if scan.sensor == "wall" and scan.stamp_ns in where:
            ends = np.array([0.0, 0.15]) + scan.ranges_m[:, None] * np.stack(
                [-np.sin(scan.angles_rad), np.cos(scan.angles_rad)], axis=1
            )
            meets += bool((np.abs(np.hypot(*(ends - where[scan.stamp_ns]).T) - 0.2) < 0.03).any())
    assert meets > 40
    _, again = readings(scenario)
    assert [each.encoded.data.tobytes() for each in again] == [each.encoded.data.tobytes() for each in delivered]


SCAN = {"scan": {"kind": "laser", "rate_hz": 10, "housing": "robot", "mount": {"xyz": [0.0, 0.0, 0.4]}}}


def test_a_bag_of_a_robot_holds_its_poses_on_its_topic_and_as_transforms(tmp_path):
    scenario = driving(AROUND, {"odometry": {"drift": 0.05, "noise": 0.02, "slip": 1.0}}, duration_s=2)
    run_scenario(scenario, trackers=[], out=tmp_path / "run", video=False, images=False)
    recording = Recording(tmp_path / "run" / "recording.mcap")
    poses = of_kind = [each for each in recording.observations() if isinstance(each, Odometry)]
    assert len(of_kind) == 40 and recording.rig.mounted() == {"scan": "robot"} and recording.background == []
    with open_bag(recording.path) as bag:
        tree = TransformTree.read(bag)
    edge, told = tree.poses("robot/odom", "robot")
    assert np.allclose(told, [each.frame_from_base for each in poses], atol=1e-12)
    assert edge.stamps_ns.tolist() == [each.stamp_ns for each in poses]
    assert [edge.child for edge in tree.chain("scan")] == ["scan", "robot", "robot/odom"]


@pytest.mark.parametrize(
    ("errors", "least_m", "most_m"), [(EXACT, 0.0, 0.0), ({"drift": 0.2, "noise": 0.05}, 0.01, 2.0)]
)
def test_odometry_is_as_wrong_as_described(errors, least_m, most_m):
    _, delivered = readings(driving(AROUND, {"odometry": errors}))
    last = [each for each in delivered if isinstance(each.observation, Odometry)][-1]
    assert isinstance(last.observation, Odometry)
    off = np.hypot(*(last.observation.frame_from_base - last.reading.truth["frame_from_base"])[:2, 3])
    assert least_m <= off <= most_m


REFUSED = {
    "follows nobody": ({"drive": {"kind": "follow", "person": "anna"}}, {}, "housings.robot.drive.person: 'anna' is nobody"),
    "tilted": ({"mount": {"xyz": [0.3, 1, 0], "pitch_deg": 3}}, {}, "stands upright"),
    "two shapes": ({"body": {"radius_m": 0.2, "size_m": [0.3, 0.3]}}, {}, "one of radius_m"),
    "a camera": ({}, {"sensors": {"eye": {"kind": "camera", "rate_hz": 5, "housing": "robot", "size": [64, 48],
                                          "field_of_view_deg": 60, "mount": {"xyz": [0, 0, 0.5]}}}},
                 "a camera cannot drive yet; lasers are valid"),
    "a sensor's name": ({}, {"sensors": {"robot": SCAN["scan"]}}, "housings.robot: a sensor has that name"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_drive_is_refused(name):
    housing, changes, said = REFUSED[name]
    with pytest.raises(InputError, match=said):
        driving(AROUND, housing, **changes)


def test_a_robot_does_not_start_in_a_person():
    person = {"ann": {"start": [0.4, 1.0], "script": {"kind": "stand"}}}
    scenario = driving(AROUND, {"body": {"radius_m": 0.2}}, people=person)
    with pytest.raises(InputError, match=r"housings.robot.mount.xyz: .* is where 'ann' starts"):
        Simulation(scenario, images=False)


def test_odometry_is_described_exact_or_not():
    assert not OdometryDescription().is_exact and OdometryDescription(drift=0, noise=0).is_exact


def test_bases_have_places_in_the_time_that_is_kept_and_no_other():
    bases = World(driving(AROUND)).population.bases
    assert bases is not None
    for t in (-0.1, 0.1):
        with pytest.raises(ValueError, match=r"not between 0.00 and 0.00 s"):
            bases.at(t)
    assert list(bases.at(0.0)) == ["robot"]


def test_poses_shared_by_scanners_leave_a_base_where_it_drives():
    """As placements of one study share them: the second world is asked for what the first has been asked."""
    scenario = driving(AROUND, {"body": {"radius_m": 0.2}})
    shared, seen = None, []
    for _ in range(2):
        world = World(scenario)
        world.pose_cache = shared = shared or PoseCache(world.scene.person_of_geom)
        for t in (0.0, 1.0, 2.0):
            snapshot = world.snapshot(t)
            seen.append((snapshot.bases["robot"].copy(), snapshot.data.mocap_pos.copy()))
    for (pose, body), (again, body_again) in zip(seen[:3], seen[3:], strict=True):
        assert np.array_equal(pose, again) and np.array_equal(body, body_again)
    assert np.hypot(*(seen[2][0] - seen[0][0])[:2, 3]) > 0.3
