"""Every kind of sensor keeps the contract, and `check_sensor` finds what breaks it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from capsule_room import CapsuleWorld
from pydantic import TypeAdapter

from trackers.observations import DepthImage, Image, LaserScan
from trackers.rig import FisheyeSensor, OdometrySensor, RigSensor, StereoSensor
from twin.instant.snapshot import Snapshot
from twin.scenario.sensor_descriptions import SensorDescription, build_sensor
from twin.sensors.check import check_sensor
from twin.sensors.odometry import BaseOdometry, OdometryDescription
from twin.sensors.render import RendererOnDemand
from twin.sensors.sensor import Reading, Sensor, State

MOUNT = {"xyz": [0, 0.2, 0.95], "yaw_deg": 90}
LASER = {"kind": "laser", "mount": MOUNT, "rate_hz": 10}
FISHEYE = {"kind": "fisheye", "mount": MOUNT, "rate_hz": 10, "size": [120, 120]}
CAMERA = {"kind": "camera", "mount": MOUNT, "rate_hz": 10, "size": [120, 90], "field_of_view_deg": 80}
STEREO = CAMERA | {"kind": "stereo"}
KINDS = {
    "laser, ideal": LASER | {"noise": "off"},
    "laser": LASER,
    "laser, worse": LASER | {"noise": "worse", "range_max_m": 3.0},
    "laser, sweeping": LASER | {"sweep_time_s": 0.05},
    "laser, two beams": LASER | {"beams": 2},
    "fisheye, ideal": FISHEYE | {"noise": "off"},
    "fisheye": FISHEYE,
    "fisheye, worse": FISHEYE | {"noise": "worse"},
    "fisheye, opencv": FISHEYE | {"lens": "opencv_test_lens", "size": [160, 100]},
    "camera, ideal": CAMERA | {"noise": "off"},
    "camera, worse": CAMERA | {"noise": "worse", "white_balance": [1.3, 1, 0.8]},
    "camera, distorted": CAMERA | {"distortion": {"k1": -0.15, "k2": 0.02, "p1": 0.001}},
    "camera, blurred": CAMERA | {"motion_blur": {"exposure_s": 0.03, "instants": 3}},
    "stereo, matched": STEREO,
    "stereo, ideal": STEREO | {"mode": "ideal", "noise": "off"},
    "stereo, disparity-noise": STEREO | {"mode": "disparity-noise", "noise": "worse"},
}


def build(content: dict, renderer: RendererOnDemand) -> Sensor:
    return build_sensor("one", TypeAdapter(SensorDescription).validate_python(content), renderer)


@pytest.mark.parametrize("kind", KINDS)
def test_every_sensor_keeps_the_contract(kind: str, world: CapsuleWorld, renderer: RendererOnDemand):
    sensor = build(KINDS[kind], renderer)
    assert isinstance(sensor, Sensor)
    assert check_sensor(sensor, world) == []


@pytest.mark.parametrize("kind", KINDS)
def test_without_noise_nothing_is_random(kind: str, world: CapsuleWorld, renderer: RendererOnDemand):
    sensor = build(KINDS[kind] | {"noise": "off"}, renderer)

    def read(seed: int) -> bytes:
        snapshots = (world.snapshot(offset) for offset in sensor.instants_s)
        observation = sensor.observe(0, snapshots, None, np.random.default_rng(seed))[0].observation
        if isinstance(observation, DepthImage):
            return observation.rgb.tobytes() + observation.depth_m.tobytes()
        return (observation.rgb if isinstance(observation, Image) else observation.ranges_m).tobytes()

    assert read(1) == read(2)


@pytest.mark.parametrize("kind", ["laser", "fisheye", "camera, worse", "stereo, matched"])
def test_noise_leaves_the_truth_alone(kind: str, world: CapsuleWorld, renderer: RendererOnDemand):
    readings = [
        build(KINDS[kind] | {"noise": noise}, renderer).observe(
            0, [world.snapshot(0.0)], None, np.random.default_rng(0)
        )[0]
        for noise in ("off", "worse")
    ]
    assert readings[0].truth.keys() == readings[1].truth.keys()
    for name, array in readings[0].truth.items():
        np.testing.assert_array_equal(array, readings[1].truth[name])


def test_a_scanner_never_asks_for_a_renderer(world: CapsuleWorld):
    def refuse() -> None:
        raise AssertionError("EGL was opened")

    assert check_sensor(build(LASER, refuse), world) == []  # type: ignore[arg-type]
    build(FISHEYE, refuse)  # type: ignore[arg-type]


class Broken:
    """A scanner in whose place each test puts a fault."""

    instants_s: tuple[float, ...] = (0.0,)

    def __init__(self, sensor: Sensor) -> None:
        self.name = sensor.name
        self._sensor = sensor
        self._calls = 0

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        reading, state = self._sensor.observe(stamp_ns, snapshots, state, rng)
        self._calls += 1
        assert isinstance(reading.observation, LaserScan)
        return self.spoil(reading, reading.observation), state

    def spoil(self, reading: Reading, scan: LaserScan) -> Reading:
        return reading

    def rig_sensor(self) -> RigSensor:
        return self._sensor.rig_sensor()


class Unsigned(Broken):
    fault = "signed its reading"

    def spoil(self, reading: Reading, scan: LaserScan) -> Reading:
        return Reading(replace(scan, sensor="other"), reading.truth)


class Late(Broken):
    fault = "stamped its reading"

    def spoil(self, reading: Reading, scan: LaserScan) -> Reading:
        return Reading(replace(scan, stamp_ns=scan.stamp_ns + 1), reading.truth)


class Forgetful(Broken):
    fault = "differs from one with the same generator"

    def spoil(self, reading: Reading, scan: LaserScan) -> Reading:
        return Reading(replace(scan, ranges_m=np.full_like(scan.ranges_m, self._calls)), reading.truth)


class Shared(Broken):
    fault = "changed when a later one was taken"
    _buffer = np.zeros(361, dtype=np.float32)

    def spoil(self, reading: Reading, scan: LaserScan) -> Reading:
        self._buffer[:] = 1 + scan.stamp_ns / 1e9
        return Reading(replace(scan, ranges_m=self._buffer), reading.truth)


class Blind(Broken):
    fault = "no person_of_ray"

    def spoil(self, reading: Reading, scan: LaserScan) -> Reading:
        return Reading(scan)


class Coarse(Broken):
    fault = "person_of_ray is int64"

    def spoil(self, reading: Reading, scan: LaserScan) -> Reading:
        return Reading(scan, {"person_of_ray": np.zeros(3, dtype=np.int64)})


class Double(Broken):
    fault = "ranges are float64"

    def spoil(self, reading: Reading, scan: LaserScan) -> Reading:
        return Reading(replace(scan, ranges_m=scan.ranges_m.astype(float)), reading.truth)


class FarSighted(Broken):
    fault = "ranges leave"

    def spoil(self, reading: Reading, scan: LaserScan) -> Reading:
        return Reading(replace(scan, ranges_m=np.full_like(scan.ranges_m, 9.0)), reading.truth)


class Global(Broken):
    fault = "global random stream"

    def __init__(self, sensor: Sensor) -> None:
        super().__init__(sensor)
        np.random.seed(0)  # noqa: NPY002
        np.random.random()  # noqa: NPY002  (a first draw alone would fill the whole state anew)

    def spoil(self, reading: Reading, scan: LaserScan) -> Reading:
        np.random.random()  # noqa: NPY002
        return reading


class Meddling(Broken):
    fault = "changes the world"

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        seen = list(snapshots)
        seen[0].data.geom_xpos[0] += 1
        return super().observe(stamp_ns, seen, state, rng)


class Careless(Broken):
    fault = "took 1 of the 2 instants"
    instants_s = (0.0, 0.01)

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        return super().observe(stamp_ns, [next(iter(snapshots))], state, rng)


class Backwards(Broken):
    fault = "ascending"
    instants_s = (0.02, 0.01)


class Timeless(Broken):
    fault = "at least one finite offset"
    instants_s = ()


class Misplaced(Broken):
    fault = "does not go with FisheyeSensor"

    def rig_sensor(self) -> RigSensor:
        lens = {"width": 9, "height": 9, "fx": 3, "fy": 3, "cx": 4, "cy": 4, "field_of_view_rad": 1}
        return FisheyeSensor.model_validate({"topic": "/one/image/compressed", "intrinsics": lens})


class Depthless(Broken):
    fault = "depth holds values that are no distance"

    def spoil(self, reading: Reading, scan: LaserScan) -> Reading:
        depth_m = np.full((9, 9), np.nan, dtype=np.float32)
        return Reading(DepthImage(self.name, scan.stamp_ns, np.zeros((9, 9, 3), dtype=np.uint8), depth_m))

    def rig_sensor(self) -> RigSensor:
        lens = {"width": 9, "height": 9, "fx": 3, "fy": 3, "cx": 4, "cy": 4}
        return StereoSensor.model_validate({"topic": "/one/image/compressed", "intrinsics": lens})


FAULTS = [
    Unsigned, Late, Forgetful, Shared, Blind, Coarse, Double, FarSighted, Global, Meddling, Careless, Backwards,
    Timeless, Misplaced, Depthless,
]  # fmt: skip


@pytest.mark.parametrize("kind", FAULTS)
def test_each_fault_is_found(kind: type, world: CapsuleWorld, renderer: RendererOnDemand):
    faults = check_sensor(kind(build(LASER | {"noise": "off"}, renderer)), world)
    assert any(kind.fault in fault for fault in faults), faults


class DrivingWorld:
    """A base that goes ahead at 1 m/s, alone."""

    def __init__(self, world: CapsuleWorld) -> None:
        self._world = world

    def snapshot(self, t: float) -> Snapshot:
        pose = np.eye(4)
        pose[0, 3] = t
        return replace(self._world.snapshot(t), bases={"robot": pose})


def test_odometry_keeps_the_contract_and_its_truth_is_a_transform(world: CapsuleWorld):
    odometry = BaseOdometry("robot", OdometrySensor(topic="/odom"), OdometryDescription(slip=1.0))
    assert check_sensor(odometry, DrivingWorld(world)) == []
    observe = odometry.observe

    def untrue(*asked: Any) -> tuple[Reading, State]:
        reading, state = observe(*asked)
        return Reading(reading.observation, {"frame_from_base": np.eye(3)}), state

    odometry.observe = untrue
    assert any("truth frame_from_base" in fault for fault in check_sensor(odometry, DrivingWorld(world)))
