"""The layer of faults around a sensor: a sensor itself, and true to what it wraps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from capsule_room import CapsuleWorld
from pydantic import TypeAdapter

from trackers.observations import DepthImage, FloorFrame, Image, LaserScan
from twin.scenario.sensor_descriptions import SensorDescription, build_sensor
from twin.sensors.check import check_sensor
from twin.sensors.fault_effects import DeadBeamMask, DeadCellMask, LensCover
from twin.sensors.fault_kinds import DeadBeams, DeadCells, Fault, FaultDescription, LensOcclusion
from twin.sensors.render import RendererOnDemand
from twin.sensors.schedule import MessageFaults
from twin.sensors.sensor import Faulty, Noisy, Sensor, with_faults

LASER = {"kind": "laser", "mount": {"xyz": [0, 0, 0.95], "yaw_deg": 90}, "rate_hz": 10}
CAMERA_MOUNT = {"mount": {"xyz": [0, 0, 1.3], "yaw_deg": 90}, "rate_hz": 10}
FISHEYE = {"kind": "fisheye", "size": [96, 96], **CAMERA_MOUNT}
CAMERA = {"kind": "camera", "size": [96, 64], "field_of_view_deg": 80, **CAMERA_MOUNT}
STEREO = {"kind": "stereo", "size": [160, 120], "field_of_view_deg": 70, "mode": "ideal", **CAMERA_MOUNT}


def build(description: dict[str, Any], renderer: RendererOnDemand) -> Sensor:
    return build_sensor("one", TypeAdapter(SensorDescription).validate_python(description), renderer)


def fault(**fields: Any) -> Fault:
    return TypeAdapter(FaultDescription).validate_python({"sensor": "one", **fields})


@pytest.mark.parametrize("noise", ["off", "worse"])
@pytest.mark.parametrize(
    ("description", "fields"),
    [
        (LASER, {"kind": "dead_beams", "share": 0.1}),
        (LASER, {"kind": "blocked_sector", "bearings_deg": (-10, 10)}),
        (LASER, {"kind": "freeze", "from_s": 0.1}),
        (FISHEYE, {"kind": "occlusion", "from_s": 0.1, "to_s": 0.2}),
        (CAMERA, {"kind": "occlusion", "look": "smear"}),
        (STEREO, {"kind": "occlusion"}),
    ],
)
def test_a_faulty_sensor_keeps_the_contract(
    description: dict[str, Any], fields: dict[str, Any], noise: str, world: CapsuleWorld, renderer: RendererOnDemand
) -> None:
    healthy = build(description | {"noise": noise}, renderer)
    faulty = with_faults(healthy, {"a": fault(**fields)}, 0)
    assert isinstance(faulty, Faulty)
    assert faulty.rig_sensor() == healthy.rig_sensor()
    assert faulty.ideal is (healthy.ideal if isinstance(healthy, Noisy) else healthy)
    assert check_sensor(faulty, world) == []


def test_a_sensor_without_faults_of_its_own_is_left_alone(renderer: RendererOnDemand) -> None:
    healthy = build(LASER, renderer)
    others = {"a": fault(kind="dropout"), "b": fault(kind="freeze").model_copy(update={"sensor": ("other",)})}
    assert with_faults(healthy, others, 0) is healthy


def test_dead_are_the_beams_and_elements_that_are_named_and_no_others() -> None:
    beams = fault(kind="dead_beams", beams=[[3, 5], [8]], bearings_deg=(0, 1))
    scan = LaserScan("one", 0, np.full(20, 2.0, np.float32), np.deg2rad(-15), np.deg2rad(1), 0.05, 8.0)
    assert isinstance(beams, DeadBeams)
    read = DeadBeamMask(beams, np.random.default_rng(0)).apply(scan).ranges_m
    assert np.flatnonzero(np.isnan(read)).tolist() == [3, 4, 5, 8, 15, 16]
    cells = fault(kind="dead_cells", cells=[[1, 2]], rows=[3], columns=[0])
    assert isinstance(cells, DeadCells)
    values = (
        DeadCellMask(cells, np.random.default_rng(0)).apply(FloorFrame("one", 0, np.full((4, 5), 9, np.uint8))).values
    )
    dead = np.zeros((4, 5), np.bool_)
    dead[1, 2] = dead[3] = dead[:, 0] = True
    np.testing.assert_array_equal(values == 0, dead)


def test_a_blob_lies_where_it_says_and_is_as_large(renderer: RendererOnDemand) -> None:
    round_one = LensOcclusion(
        sensor=("one",), kind="occlusion", at=(0.25, 0.75), size=0.5, irregularity=0, softness=0.2
    )
    cover = LensCover(round_one, build(CAMERA, renderer).rig_sensor(), np.random.default_rng(0)).cover(400, 200)
    assert cover.shape == (200, 400)
    assert (cover.min(), cover.max()) == (0, 1)
    row, column = np.indices(cover.shape)
    assert (cover * column).sum() / cover.sum() == pytest.approx(0.25 * 400 - 0.5, abs=0.2)
    radius = 0.5 * 200 / 2
    assert (cover > 0.5).sum() == pytest.approx(np.pi * radius**2, rel=0.02)
    distance = np.hypot(column - 99.5, row - 149.5)
    assert (cover[distance < 0.9 * radius] == 1).all()
    assert not cover[distance > 1.11 * radius].any()


def test_an_outline_is_drawn_from_the_stream_alone(renderer: RendererOnDemand) -> None:
    rig, blob = build(CAMERA, renderer).rig_sensor(), fault(kind="occlusion")
    assert isinstance(blob, LensOcclusion)
    one, same, other = (LensCover(blob, rig, np.random.default_rng(seed)).cover(64, 48) for seed in (0, 0, 1))
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()


def test_a_stereo_camera_has_no_depth_behind_a_blob(world: CapsuleWorld, renderer: RendererOnDemand) -> None:
    healthy = build(STEREO | {"noise": "off"}, renderer)
    faulty = with_faults(healthy, {"a": fault(kind="occlusion", at=(0.3, 0.5), size=0.4)}, 0)
    seen, covered = (
        each.observe(0, [world.snapshot(0.0)], None, np.random.default_rng(0))[0].observation
        for each in (healthy, faulty)
    )
    assert isinstance(seen, DepthImage)
    assert isinstance(covered, DepthImage)
    assert not covered.depth_m[52:68, 40:56].any()
    np.testing.assert_array_equal(covered.depth_m[:, 110:], seen.depth_m[:, 110:])
    assert covered.depth_m[:, 110:].any()


def test_the_noise_of_what_a_fault_changed_is_that_of_the_sensor(
    world: CapsuleWorld, renderer: RendererOnDemand
) -> None:
    """A thumb on the lens is dark, and as noisy as a camera is in the dark."""
    healthy = build(FISHEYE | {"noise": "worse"}, renderer)
    faulty = with_faults(healthy, {"a": fault(kind="occlusion", size=0.8)}, 0)
    reading, _ = faulty.observe(0, [world.snapshot(0.0)], None, np.random.default_rng(0))
    assert isinstance(reading.observation, Image)
    middle = reading.observation.rgb[40:56, 40:56].astype(float)
    assert middle.mean() == pytest.approx(0.7 * np.mean((24, 20, 18)), abs=1.5)
    assert middle[..., 0].std() == pytest.approx(np.sqrt(5.0**2 + 0.2 * 0.7 * 24), rel=0.15)


def test_a_thing_nearer_than_what_blocks_a_sector_stays(world: CapsuleWorld, renderer: RendererOnDemand) -> None:
    healthy = build(LASER | {"noise": "off"}, renderer)
    faulty = with_faults(healthy, {"a": fault(kind="blocked_sector", bearings_deg=(-90, 90), at_m=2.0)}, 0)
    seen, blocked = (
        each.observe(0, [world.snapshot(0.0)], None, np.random.default_rng(0))[0].observation
        for each in (healthy, faulty)
    )
    assert isinstance(seen, LaserScan)
    assert isinstance(blocked, LaserScan)
    np.testing.assert_array_equal(blocked.ranges_m, np.minimum(seen.ranges_m, np.float32(2.0)))
    assert (seen.ranges_m < 2).any()


def test_of_a_clock_stamps_rise_and_drift_begins_with_the_fault() -> None:
    clock = {"a": fault(kind="clock", offset_s=-0.5, drift_ppm=-1000, from_s=10, to_s=110)}
    faults = MessageFaults("one", clock, 0)
    stamps = [k * 100_000_000 for k in range(1200)]
    said = np.array([faults.reported_stamp_ns(stamp) for stamp in stamps])
    assert said[100] == 9_500_000_000
    assert said[1099] == stamps[1099] - 500_000_000 - 99_900_000
    np.testing.assert_array_equal(said[:100], stamps[:100])
    np.testing.assert_array_equal(said[1100:], stamps[1100:])
    assert (np.diff(said[100:1100]) > 0).all()


def test_faults_of_other_sensors_are_none_of_its_own() -> None:
    others = {name: fault(kind=name, **more).model_copy(update={"sensor": ("other",)}) for name, more in
              {"dropout": {}, "delay": {"delay_s": 1}, "clock": {"offset_s": 1}}.items()}  # fmt: skip
    faults = MessageFaults("one", others, 0)
    assert (faults.is_lost(5), faults.is_silent_from(5), faults.extra_delay_ns(5), faults.reported_stamp_ns(5)) == (
        False,
        False,
        0,
        5,
    )
