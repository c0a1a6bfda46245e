"""The floor as a sensor: its contract, its truth, its frames under a walk, and the empty room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from footfalls import WalkedWorld, moved, soles, somewhere, walking
from pydantic import TypeAdapter

from trackers.observations import FloorFrame, LaserScan
from trackers.rig import FloorSensor
from twin.instant.snapshot import Feet, Snapshot
from twin.scenario.sensor_descriptions import SensorDescription, build_sensor
from twin.sensors.check import check_sensor
from twin.sensors.floor_electronics import LoadFrame
from twin.sensors.sensor import Reading, Sensor

KINDS = {
    "ideal": {"noise": "off"},
    "default": {},
    "worse": {"noise": "worse"},
    "fine": {"rows": 56, "columns": 72, "pitch_m": 0.05},
    "turned": {"mount": {"xyz": [3.6, 2.8, 0], "yaw_deg": 180}},
    "one element": {"rows": 1, "columns": 1, "pitch_m": 2.0},
}


def build(content: dict | None = None, people: int = 1, device: np.random.Generator | None = None) -> Sensor:
    description = TypeAdapter(SensorDescription).validate_python({"kind": "floor", **(content or {})})

    def refuse() -> None:
        raise AssertionError("EGL was opened")

    return build_sensor("floor", description, refuse, shapes=lambda: soles(people), device=device)  # type: ignore[arg-type]


def look(sensor: Sensor, feet: Feet | None, seed: int = 0) -> Reading:
    snapshot = replace(WalkedWorld().snapshot(0.0), feet=feet)
    return sensor.observe(0, [snapshot], None, np.random.default_rng(seed))[0]


def values(reading: Reading) -> np.ndarray:
    assert isinstance(reading.observation, FloorFrame)
    return reading.observation.values


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("empty", [False, True])
def test_the_floor_keeps_the_contract(kind: str, empty: bool):
    sensor = build(KINDS[kind])
    assert isinstance(sensor, Sensor)
    assert check_sensor(sensor, WalkedWorld(empty)) == []


def test_without_noise_nothing_is_random():
    sensor = build({"noise": "off"})
    np.testing.assert_array_equal(values(look(sensor, walking(0.2), 1)), values(look(sensor, walking(0.2), 2)))


def test_noise_leaves_the_truth_alone():
    readings = [look(build({"noise": noise}), walking(0.2)) for noise in ("off", "worse")]
    assert readings[0].truth.keys() == readings[1].truth.keys()
    for name, array in readings[0].truth.items():
        np.testing.assert_array_equal(array, readings[1].truth[name])
    assert (values(readings[0]) != values(readings[1])).any()
    assert isinstance(readings[0].observation, LoadFrame) and not isinstance(readings[1].observation, LoadFrame)


def test_the_ideal_frame_is_the_curve_of_the_true_loads():
    sensor = build({"noise": "off"}, people=5)
    feet = somewhere(np.random.default_rng(0), 5, (0.5, 0.5), (3.1, 2.3))
    reading = look(sensor, feet)
    rig = sensor.rig_sensor()
    assert isinstance(rig, FloorSensor)
    np.testing.assert_allclose(reading.truth["centre_m"], feet.pressure_point, atol=1e-3)
    np.testing.assert_allclose(reading.truth["foot_n"], feet.load_n, rtol=1e-3)
    load_n = reading.truth["load_n"]
    assert load_n.sum() == pytest.approx(feet.load_n.sum(), rel=3e-4)
    np.testing.assert_array_equal(values(reading), rig.curve.values(load_n))
    told = rig.load_n(values(reading))
    felt = (load_n > 20) & (load_n < 1400)
    np.testing.assert_allclose(told[felt], load_n[felt], rtol=0.06)


def test_nobody_and_nothing():
    for feet in (None, replace(walking(0.2), present=np.zeros(1, dtype=bool), load_n=np.zeros((1, 2)))):
        reading = look(build({"noise": "off"}), feet)
        assert not values(reading).any() and not reading.truth["load_n"].any() and not reading.truth["newton"].size
    far = moved(walking(0.2), (50.0, 50.0), 0.0)
    assert not values(look(build({"noise": "off"}), far)).any()


def test_an_empty_floor_needs_no_soles():
    description = TypeAdapter(SensorDescription).validate_python({"kind": "floor"})
    sensor = build_sensor("floor", description, lambda: None)  # type: ignore[arg-type, return-value]
    assert not look(sensor, None).truth["load_n"].any()
    with pytest.raises(ValueError, match="without the soles of its people"):
        look(sensor, walking(0.2))


@pytest.mark.parametrize("yaw_deg", [0, 90, -37])
def test_a_floor_that_lies_elsewhere_feels_the_same(yaw_deg: float):
    home = look(build({"noise": "off"}), walking(0.25))
    away = build({"noise": "off", "mount": {"xyz": [-4, 7, 0], "yaw_deg": yaw_deg}})
    there = look(away, moved(walking(0.25), (-4, 7), np.radians(yaw_deg)))
    np.testing.assert_allclose(there.truth["load_n"], home.truth["load_n"], atol=1e-6)
    pressure = moved(walking(0.25), (-4, 7), np.radians(yaw_deg)).pressure_point[0, 0]
    np.testing.assert_allclose(there.truth["centre_m"][0, 0], pressure, atol=1e-3)
    rig = away.rig_sensor()
    assert isinstance(rig, FloorSensor)
    middle = (rig.centres * there.truth["load_n"][..., None]).sum(axis=(0, 1)) / there.truth["load_n"].sum()
    place = moved(walking(0.25), (-4, 7), np.radians(yaw_deg)).pressure_point[0, 0]
    assert np.linalg.norm(middle - place) < 0.15  # what 200 mm cells can tell


@pytest.mark.parametrize(
    ("noise", "share", "within_m"),
    [
        ("off", 1.0, 0.08),
        ("default", 1.0, 0.08),
        ("worse", 0.6, 0.15),
    ],  # a dead element may hide a footfall, a stuck one add to it
)
def test_a_walk_is_followed_by_its_8_bit_frames(noise: str, share: float, within_m: float):
    """The frames' own centre of load goes where the pressure goes, as far as 200 mm cells can tell."""
    sensor = build({"noise": noise}, device=np.random.default_rng(4))
    rig = sensor.rig_sensor()
    assert isinstance(rig, FloorSensor)
    rng, state, loaded, errors_m = np.random.default_rng(0), None, set(), []
    for k in range(4, 26):
        feet = walking(k * 0.1)
        snapshot = replace(WalkedWorld().snapshot(0.0), feet=feet)
        reading, state = sensor.observe(k * 100_000_000, [snapshot], state, rng)
        truth = (feet.pressure_point * feet.load_n[..., None]).sum(axis=(0, 1)) / feet.load_n.sum()
        load_n = rig.load_n(values(reading))
        far = np.linalg.norm(rig.centres - truth, axis=-1) > 0.6
        load_n[(load_n < 30) | far] = 0  # not the stuck elements elsewhere
        centre = (rig.centres * load_n[..., None]).sum(axis=(0, 1)) / load_n.sum()
        errors_m.append(np.linalg.norm(centre - truth))
        loaded.add(tuple(np.flatnonzero(load_n.sum(axis=0) > 100)))
    assert np.quantile(errors_m, share) < within_m
    assert len(loaded) > 8  # heel, flat and toe light different columns


def test_within_one_step_the_load_moves_from_the_heels_column_to_the_toes():
    sensor = build({"noise": "off"})
    landed = walking(0.0).place[0, 0, 0]
    columns = []
    for t in np.arange(0.05, 0.6, 0.1):  # the left foot's stance, ten frames a second
        feet = walking(t)
        left = replace(feet, load_n=feet.load_n * [1.0, 0.0])
        frame = values(look(sensor, left)).astype(float)
        columns.append((frame.sum(axis=0) @ (np.arange(18) + 0.5)) / frame.sum() * 0.2 - landed)
    assert columns[-1] - columns[0] > 0.1
    assert columns == sorted(columns)


def test_dead_elements_are_the_same_in_the_empty_room_and_in_the_run():
    sensor = build({"noise": {"stuck": 0.1}}, device=np.random.default_rng(1))
    empty, again = (values(look(sensor, None, seed)) for seed in (5, 6))
    assert 10 < np.count_nonzero(empty) < 45
    np.testing.assert_array_equal(empty, again)


class Careless:
    """A floor in whose place each test puts a fault."""

    name, instants_s = "floor", (0.0,)

    def __init__(self, **change: object) -> None:
        self._sensor, self._change = build({"noise": "off"}), change

    def rig_sensor(self) -> FloorSensor:
        rig = self._sensor.rig_sensor()
        assert isinstance(rig, FloorSensor)
        return rig

    def observe(self, stamp_ns: int, snapshots: list[Snapshot], state: object, rng: np.random.Generator):
        reading, state = self._sensor.observe(stamp_ns, snapshots, state, rng)
        frame, truth = FloorFrame("floor", stamp_ns, values(reading)), dict(reading.truth)
        for name, value in self._change.items():
            if name == "values":
                frame = replace(frame, values=value)
            elif value is None:
                del truth[name]
            else:
                truth[name] = value(truth[name])
        return Reading(frame, truth), state


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"values": np.zeros((14, 18))}, "values are float64"),
        ({"values": np.zeros((18, 14), dtype=np.uint8)}, r"uint8 (14, 18) is expected of its grid"),
        ({"person": None}, "truth holds no person"),
        ({"load_n": lambda load_n: load_n * 1.01}, "load_n is not the sum"),
        ({"load_n": lambda load_n: load_n - 1}, "newtons from 0 on is expected"),
        ({"cell": lambda cell: cell + 300}, "0 to 251 is expected"),
        ({"newton": lambda newton: newton[:-1]}, "differ in shape"),
    ],
)
def test_the_check_finds_each_fault(change: dict, fault: str):
    faults = check_sensor(Careless(**change), WalkedWorld())  # type: ignore[arg-type]
    assert any(fault in each for each in faults), faults


def test_the_check_finds_another_kinds_observation():
    class Scanner(Careless):
        def observe(self, stamp_ns, snapshots, state, rng):
            _, state = super().observe(stamp_ns, snapshots, state, rng)
            return Reading(LaserScan("floor", stamp_ns, np.ones(3, dtype=np.float32), 0, 0.1, 0.1, 8)), state

    faults = check_sensor(Scanner(), WalkedWorld())  # type: ignore[arg-type]
    assert any("LaserScan, which does not go with FloorSensor" in each for each in faults)
