"""Housings and beliefs: several sensors moved as one, and trackers told of another rig than the true one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trackers.errors import InputError
from trackers.observations import LaserScan, Observation
from trackers.rig import FisheyeSensor, Rig
from twin.recording.reader import Recording
from twin.recording.writer import BagWriter
from twin.run.live import run_scenario
from twin.scenario import Scenario, load_scenario
from twin.scenario.load import dump_scenario
from twin.scenario.mount import CalibrationError, Mount
from twin.truth.truth_types import TruthFrame
from twin.world.simulation import Simulation

SHORT = ["duration_s=0.5", "background_frames=2", "sensors.fisheye.size=[64, 64]"]
ON_ONE = [
    "housings.rig.mount={xyz: [0.3, 0.1, 0.2], yaw_deg: 30, pitch_deg: 5}",
    *(f"sensors.{name}.housing=rig" for name in ("waist", "knee", "fisheye")),
]


def scenario(*changes: str) -> Scenario:
    return load_scenario("lab-five-people", [*SHORT, *changes])


def simulate(*changes: str) -> tuple[list[bytes], list[TruthFrame], Rig, Rig]:
    truth: list[TruthFrame] = []
    with Simulation(scenario(*changes), on_truth=truth.append) as simulation:
        messages = [bytes(each.encoded.data) for each in simulation.deliveries()]
        return messages, truth, simulation.rig, simulation.true_rig


def poses(rig: Rig) -> dict[str, np.ndarray]:
    """The transform (4, 4) of each sensor's frame to the room's."""
    result = {}
    for name, sensor in rig.sensors.items():
        result[name] = np.eye(4)
        result[name][:3, :3] = sensor.room_from_sensor.rotation
        result[name][:3, 3] = sensor.room_from_sensor.translation
    return result


def test_sensors_on_a_housing_are_moved_as_one() -> None:
    with Simulation(scenario()) as alone, Simulation(scenario(*ON_ONE)) as carried:
        in_room, on_housing = poses(alone.rig), poses(carried.rig)
    mount = Mount(xyz=(0.3, 0.1, 0.2), yaw_deg=30, pitch_deg=5)
    housing = np.eye(4)
    housing[:3, :3], housing[:3, 3] = mount.room_from_housing().rotation, mount.xyz
    for name, pose in in_room.items():
        np.testing.assert_allclose(on_housing[name], housing @ pose, atol=1e-9)


def test_a_sensor_on_a_housing_measures_what_one_that_hangs_there_would() -> None:
    turned = ["housings.rig.mount={xyz: [0.2, 0.1, 0], yaw_deg: 90}", "sensors.waist.housing=rig"]
    on_housing, truth, _, _ = simulate(*turned, "sensors.waist.mount={xyz: [0.3, 0, 0.95], yaw_deg: 0}")
    in_room, same_truth, _, _ = simulate("sensors.waist.mount={xyz: [0.2, 0.4, 0.95], yaw_deg: 90}")
    assert on_housing == in_room
    assert truth == same_truth


@pytest.mark.parametrize("pitch_deg", [0.0, 35.0, 90.0, -90.0])
def test_mounts_compose_however_they_are_turned(pitch_deg: float) -> None:
    outer = Mount(xyz=(1, 2, 3), yaw_deg=200, pitch_deg=pitch_deg, roll_deg=20)
    inner = Mount(xyz=(0.1, -0.2, 0.3), yaw_deg=-70, roll_deg=0)
    both, a, b = (each.room_from_housing() for each in (outer.carrying(inner), outer, inner))
    np.testing.assert_allclose(both.rotation, a.rotation @ b.rotation, atol=1e-7)
    np.testing.assert_allclose(both.translation, a.translation + a.rotation @ b.translation, atol=1e-12)


def test_the_resolved_scenario_runs_again_to_the_same(tmp_path: Path) -> None:
    described = scenario(
        *ON_ONE,
        "housings.rig.mount.xyz=[0.3, 0.1, 0.25]",
        "sensors.fisheye.calibration_error={rpy_deg: [0, 0, 1], focal_scale: 1.02}",
        "faults.dirt={sensor: fisheye, kind: occlusion}",
        "faults.dead={sensor: [waist, knee], kind: dead_beams, beams: [[3], [5, 9]], to_s: 2}",
    )
    (tmp_path / "again.yaml").write_text(dump_scenario(described))
    assert load_scenario(tmp_path / "again.yaml") == described
    assert described.housings["rig"].mount.xyz == (0.3, 0.1, 0.25)


def test_a_housing_in_a_wall_is_refused() -> None:
    with pytest.raises(InputError, match=r"sensors\.waist\.mount\.xyz: .* is inside"):
        Simulation(scenario("housings.rig.mount.xyz=[0, 4.5, 0]", "sensors.waist.housing=rig"))


def test_what_is_believed_changes_the_rig_and_nothing_else() -> None:
    messages, truth, rig, _ = simulate()
    believed = "sensors.{}.calibration_error={{xyz: [0.1, 0.02, -0.03], rpy_deg: [0, 0, 2]{}}}"
    told_messages, told_truth, told, true = simulate(
        believed.format("waist", ""), believed.format("fisheye", ", focal_scale: 1.05, principal_px: [2, -1]")
    )
    assert told_messages == messages
    assert told_truth == truth
    assert true == rig
    for name in ("waist", "fisheye"):
        off = poses(told)[name] @ np.linalg.inv(poses(rig)[name])
        np.testing.assert_allclose(poses(told)[name][:3, 3] - poses(rig)[name][:3, 3], [0.1, 0.02, -0.03], atol=1e-12)
        assert np.rad2deg(np.arccos((np.trace(off[:3, :3]) - 1) / 2)) == pytest.approx(2.0)
        np.testing.assert_allclose(off[:3, 2], [0, 0, 1], atol=1e-9)  # level sensors: turned about the room's z
    assert told.sensors["knee"] == rig.sensors["knee"]
    lens, believed_lens = (each.sensors["fisheye"] for each in (rig, told))
    assert isinstance(lens, FisheyeSensor)
    assert isinstance(believed_lens, FisheyeSensor)
    assert believed_lens.intrinsics.fx == pytest.approx(1.05 * lens.intrinsics.fx)
    assert believed_lens.intrinsics.cx == lens.intrinsics.cx + 2
    assert believed_lens.intrinsics.cy == lens.intrinsics.cy - 1


def test_a_camera_is_believed_turned_about_the_axes_of_its_mount() -> None:
    """Roll about where it looks, pitch downwards, yaw to the left, as for any sensor."""
    mount = Mount(xyz=(0, 0, 1), yaw_deg=90)
    down = CalibrationError(rpy_deg=(0, 10, 0)).mount(mount).room_from_optical().rotation[:, 2]
    np.testing.assert_allclose(down, [0, np.cos(np.pi / 18), -np.sin(np.pi / 18)], atol=1e-12)
    left = CalibrationError(rpy_deg=(0, 0, 10)).mount(mount).room_from_optical().rotation[:, 2]
    np.testing.assert_allclose(left, [-np.sin(np.pi / 18), np.cos(np.pi / 18), 0], atol=1e-12)


def test_a_floor_is_believed_elsewhere() -> None:
    changes = ["duration_s=0.3", "sensors.floor.calibration_error={xyz: [0.1, 0, 0], rpy_deg: [0, 0, 3]}"]
    with Simulation(load_scenario("home-three-people", changes)) as simulation:
        true, told = simulation.true_rig.sensors["floor"], simulation.rig.sensors["floor"]
    np.testing.assert_allclose(told.room_from_sensor.translation - true.room_from_sensor.translation, [0.1, 0, 0])
    assert np.rad2deg(told.room_from_sensor.rpy[2]) == pytest.approx(3)


def test_the_bag_carries_what_is_believed_and_replays_to_what_trackers_got_live(tmp_path: Path) -> None:
    """Clock and belief together: a clock 0.3 s ahead of which the rig knows gives the true stamps."""
    changes = ["duration_s=1", "sensors.fisheye=null", "trackers=null",
               "sensors.waist.calibration_error={xyz: [0.05, 0, 0], time_offset_s: -0.3}",
               "faults.ahead={sensor: waist, kind: clock, offset_s: 0.3}"]  # fmt: skip
    described = load_scenario("lab-five-people", changes)
    with Simulation(described) as simulation:
        live = list(simulation)
        rig = simulation.rig
        assert {each.stamp_ns for each in live if each.sensor == "waist"} == {k * 100_000_000 for k in range(10)}
    with Simulation(described) as simulation, BagWriter(tmp_path / "recording.mcap", simulation.rig) as writer:
        for encoded in simulation.background_messages():
            writer.background(encoded)
        for delivered in simulation.deliveries():
            writer.observation(delivered.encoded, delivered.arrival_ns)
    recording = Recording(tmp_path / "recording.mcap")
    assert recording.rig == rig
    assert recording.rig.sensors["waist"].time_offset_s == -0.3
    assert [summary(each) for each in recording.observations()] == [summary(each) for each in live]
    with Simulation(described) as simulation:
        assert [summary(each) for each in recording.background] == [summary(each) for each in simulation.background()]


def summary(observation: Observation) -> tuple[str, int, bytes]:
    assert isinstance(observation, LaserScan)
    return observation.sensor, observation.stamp_ns, observation.ranges_m.tobytes()


def test_a_wrong_belief_shows_in_the_figures(tmp_path: Path) -> None:
    changes = ["duration_s=6", "sensors.fisheye=null", "trackers=null"]
    runs = {}
    for name, off in (("right", []), ("wrong", [f"sensors.{s}.believed.xyz=[0.2, 0, 0]" for s in ("waist", "knee")])):
        described = load_scenario("lab-five-people", [*changes, *off])
        runs[name] = run_scenario(described, trackers=["laser-imm"], out=tmp_path / name, video=False).metrics
    motp = {name: metrics["trackers"]["laser-imm"]["motp_m"] for name, metrics in runs.items()}
    assert motp["wrong"] > motp["right"] + 0.08
    assert (tmp_path / "right" / "truth.csv").read_bytes() == (tmp_path / "wrong" / "truth.csv").read_bytes()
