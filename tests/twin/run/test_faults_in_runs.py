"""Faults in a run: what each does within its times, and that it does nothing else."""

from __future__ import annotations

from functools import cache
from typing import cast

import numpy as np
import pytest

from trackers.feeding import track_frames
from trackers.observations import NS_PER_S, FloorFrame, Image, LaserScan, Observation
from trackers.presets import make_tracker
from twin.report.floor_panel import PreviewFrame
from twin.report.preview import PreviewWriter
from twin.run.feed import Preview
from twin.scenario import Scenario, load_scenario
from twin.truth.truth_types import TruthFrame
from twin.world.simulation import Delivered, Simulation

pytestmark = pytest.mark.slow

FROM_S, TO_S = 0.3, 0.6
SENSOR_OF = {"laser": "waist", "fisheye": "fisheye", "floor": "floor"}
FAULTS = {
    "dropout": "probability: 0.5",
    "silence": "kind: dropout",
    "freeze": "",
    "delay": "delay_s: 0.25, jitter_s: 0.1",
    "clock": "offset_s: 0.02, drift_ppm: 500",
    "occlusion": "at: [0.4, 0.5], size: 0.5",
    "smear": "kind: occlusion, look: smear",
    "blocked_sector": "bearings_deg: [-30, 20], at_m: 0.2",
    "dead_beams": "share: 0.2, beams: [[10, 20], [300]]",
    "dead_cells": "share: 0.1, rows: [3], columns: [17], cells: [[0, 0]], reads: 9",
}
OF_ANY = ("dropout", "silence", "freeze", "delay", "clock")
CASES = [
    *(("laser", name) for name in (*OF_ANY, "blocked_sector", "dead_beams")),
    *(("fisheye", name) for name in (*OF_ANY, "occlusion", "smear")),
    *(("floor", name) for name in (*OF_ANY, "dead_cells")),
]


def scenario(kind: str, *changes: str) -> Scenario:
    small = ["duration_s=1.0", "background_frames=2", "people=null", "people.ann={}"]
    if kind == "floor":
        return load_scenario("home-three-people", [*small, "sensors.floor.noise=worse", *changes])
    size = ["sensors.fisheye.size=[96, 96]"] if kind == "fisheye" else ["sensors.fisheye=null", "trackers=null"]
    return load_scenario("lab-five-people", [*small, *size, "sensors.waist.noise=worse", *changes])


def fault(kind: str, name: str, sensor: str | None = None) -> str:
    parts = [part for part in ("" if "kind:" in FAULTS[name] else f"kind: {name}", FAULTS[name]) if part]
    times = f"from_s: {FROM_S}, to_s: {TO_S}"
    return f"faults.{name}={{sensor: {sensor or SENSOR_OF[kind]}, {times}, {', '.join(parts)}}}"


@cache
def run(kind: str, *changes: str) -> tuple[list[Delivered], list[TruthFrame], list[bytes]]:
    truth: list[TruthFrame] = []
    with Simulation(scenario(kind, *changes), on_truth=truth.append) as simulation:
        background = [bytes(encoded.data) for encoded in simulation.background_messages()]
        return list(simulation.deliveries()), truth, background


def within(delivered: Delivered) -> bool:
    return round(FROM_S * NS_PER_S) <= delivered.stamp_ns < round(TO_S * NS_PER_S)


def faulty_and_not(kind: str, name: str) -> tuple[list[Delivered], list[Delivered]]:
    """The sensor's observations within the fault's times, with it and without."""
    runs = [run(kind, fault(kind, name)), run(kind)]
    faulty, healthy = (
        [each for each in deliveries if within(each) and each.encoded.observation.sensor == SENSOR_OF[kind]]
        for deliveries, _, _ in runs
    )
    return faulty, healthy


def observed(deliveries: list[Delivered]) -> list[Observation]:
    return [each.encoded.observation for each in deliveries]


@pytest.mark.sample(8)
@pytest.mark.parametrize(("kind", "name"), CASES)
def test_a_fault_is_there_in_its_times_and_nowhere_else(kind: str, name: str) -> None:
    faulty, faulty_truth, faulty_background = run(kind, fault(kind, name))
    healthy, truth, background = run(kind)

    def untouched(deliveries: list[Delivered]) -> dict[tuple[str, int], tuple[bytes, int]]:
        return {
            (each.encoded.observation.sensor, each.stamp_ns): (bytes(each.encoded.data), each.arrival_ns)
            for each in deliveries
            if not within(each) or each.encoded.observation.sensor != SENSOR_OF[kind]
        }

    assert untouched(faulty) == untouched(healthy)
    assert faulty_truth == truth
    assert faulty_background == background
    arrivals = [each.arrival_ns for each in faulty]
    assert arrivals == sorted(arrivals)
    changed = [(bytes(each.encoded.data), each.arrival_ns) for each in faulty if within(each)]
    assert changed != [(bytes(each.encoded.data), each.arrival_ns) for each in healthy if within(each)]
    for one, other in zip(sorted(faulty, key=key), sorted(healthy, key=key), strict=False):
        if name not in ("dropout", "silence"):
            assert one.reading.truth.keys() == other.reading.truth.keys()
            for what, array in one.reading.truth.items():
                np.testing.assert_array_equal(array, other.reading.truth[what])


def key(delivered: Delivered) -> tuple[int, str]:
    return delivered.stamp_ns, delivered.encoded.observation.sensor


@pytest.mark.parametrize("kind", list(SENSOR_OF))
def test_the_same_faults_again(kind: str) -> None:
    changes = [fault(kind, name) for sensor_kind, name in CASES if sensor_kind == kind and name != "silence"]
    first = run(kind, *changes)[0]
    run.cache_clear()
    second = run(kind, *changes)[0]
    assert [bytes(each.encoded.data) for each in first] == [bytes(each.encoded.data) for each in second]


def test_drop_out_loses_its_share_and_other_times_change_no_draw() -> None:
    long = ["duration_s=30", "people={}", "sensors.knee=null"]
    some = "faults.lossy={{sensor: waist, kind: dropout, probability: 0.3, from_s: {}, to_s: {}}}"
    kept = {each.stamp_ns for each in run("laser", *long, some.format(0, 30))[0]}
    assert len(kept) / 300 == pytest.approx(0.7, abs=0.06)
    later = {each.stamp_ns for each in run("laser", *long, some.format(10, 20))[0]}
    middle = set(range(10 * NS_PER_S, 20 * NS_PER_S, NS_PER_S // 10))
    assert later & middle == kept & middle
    assert len(later - middle) == 200


def test_a_silent_sensor_says_nothing_and_costs_nothing_once_it_is_silent_for_good() -> None:
    assert faulty_and_not("laser", "silence")[0] == []
    with Simulation(scenario("laser", f"faults.off={{sensor: waist, kind: dropout, from_s: {FROM_S}}}")) as simulation:
        stamps = [each.stamp_ns for each in simulation.deliveries() if each.encoded.observation.sensor == "waist"]
        assert stamps == [0, 100_000_000, 200_000_000]
        assert simulation.sensor_costs()["waist"]["frames"] == 3


@pytest.mark.parametrize("kind", list(SENSOR_OF))
def test_a_frozen_sensor_repeats_its_last_values_under_new_stamps(kind: str) -> None:
    faulty, healthy = faulty_and_not(kind, "freeze")
    before = max(
        (each for each in run(kind)[0] if each.stamp_ns < FROM_S * NS_PER_S and sensor_of(each) == SENSOR_OF[kind]),
        key=lambda each: each.stamp_ns,
    )
    assert [each.encoded.observation.stamp_ns for each in faulty] == [each.stamp_ns for each in healthy]
    for each in faulty:
        np.testing.assert_array_equal(values(each.encoded.observation), values(before.encoded.observation))


def test_a_sensor_frozen_from_the_start_repeats_its_first_values() -> None:
    deliveries = run("laser", "faults.ice={sensor: waist, kind: freeze, to_s: 0.5}")[0]
    waist = [each for each in deliveries if sensor_of(each) == "waist"]
    first, frozen, thawed = waist[0], waist[1:5], waist[5:]
    for each in frozen:
        np.testing.assert_array_equal(values(each.encoded.observation), values(first.encoded.observation))
    assert not np.array_equal(values(thawed[0].encoded.observation), values(first.encoded.observation), equal_nan=True)


def test_a_delay_is_in_the_arrival_alone() -> None:
    faulty, healthy = faulty_and_not("laser", "delay")
    late = [one.arrival_ns - other.arrival_ns for one, other in zip(faulty, healthy, strict=True)]
    assert min(late) >= 0.25e9
    assert max(late) <= 0.35e9
    assert len(set(late)) == len(late)
    assert [bytes(each.encoded.data) for each in faulty] == [bytes(each.encoded.data) for each in healthy]


def test_a_clock_that_is_off_is_in_the_stamps_alone_and_rises() -> None:
    faulty, healthy = faulty_and_not("laser", "clock")
    said = [each.encoded.observation.stamp_ns for each in faulty]
    assert said == [each.stamp_ns + round(0.02e9 + 500e-6 * (each.stamp_ns - FROM_S * NS_PER_S)) for each in healthy]
    assert said == sorted(set(said))
    assert [each.stamp_ns for each in faulty] == [each.stamp_ns for each in healthy]
    assert [each.arrival_ns for each in faulty] == [each.arrival_ns for each in healthy]
    for one, other in zip(observed(faulty), observed(healthy), strict=True):
        np.testing.assert_array_equal(values(one), values(other))


def test_a_clock_may_be_behind_the_start() -> None:
    deliveries = run("laser", "faults.late={sensor: waist, kind: clock, offset_s: -0.25}")[0]
    said = [each.encoded.observation.stamp_ns for each in deliveries if sensor_of(each) == "waist"]
    assert said[0] == -250_000_000
    assert said == [each - 250_000_000 for each in range(0, NS_PER_S, NS_PER_S // 10)]


def test_a_blocked_sector_reads_what_blocks_it() -> None:
    faulty, healthy = faulty_and_not("laser", "blocked_sector")
    for one, other in zip(observed(faulty), observed(healthy), strict=True):
        assert isinstance(one, LaserScan)
        assert isinstance(other, LaserScan)
        inside = (np.rad2deg(one.angles_rad) > -29) & (np.rad2deg(one.angles_rad) < 19)
        hit = one.ranges_m[inside]
        assert np.nanmedian(hit[np.isfinite(hit)]) == pytest.approx(0.2, abs=0.02)
        assert np.nanstd(hit[np.isfinite(hit)]) > 0.005  # its noise is on it
        assert np.nanmedian(other.ranges_m[inside][np.isfinite(other.ranges_m[inside])]) > 0.5


def test_what_is_too_near_to_be_measured_reads_invalid() -> None:
    near = "faults.cap={sensor: waist, kind: blocked_sector, bearings_deg: [-90, 90], at_m: 0.03}"
    scans = [each.encoded.observation for each in run("laser", near)[0] if sensor_of(each) == "waist"]
    worse = 0.05  # a beam that drops out reads no return, as ever
    assert all(np.isnan(values(scan)).mean() > 1 - 2 * worse for scan in scans)


def test_dead_beams_read_nothing() -> None:
    faulty, healthy = faulty_and_not("laser", "dead_beams")
    dead = np.logical_and.reduce([np.isnan(values(each)) for each in observed(faulty)])
    assert dead[10:21].all()
    assert dead[300]
    assert (dead.sum() - 12) / 349 == pytest.approx(0.2, abs=0.07)
    for one, other in zip(observed(faulty), observed(healthy), strict=True):
        np.testing.assert_array_equal(values(one)[~dead], values(other)[~dead])
    empty = run("laser", "faults.a={sensor: waist, kind: dead_beams, bearings_deg: [0, 0.6], reads: no_return}")[0]
    for each in empty:
        if sensor_of(each) == "waist":
            assert np.isposinf(values(each.encoded.observation)[180:182]).all()


def test_dead_cells_read_the_same() -> None:
    faulty, healthy = faulty_and_not("floor", "dead_cells")
    for one, other in zip(observed(faulty), observed(healthy), strict=True):
        assert isinstance(one, FloorFrame)
        assert isinstance(other, FloorFrame)
        assert (one.values[3] == 9).all()
        assert (one.values[:, 17] == 9).all()
        assert one.values[0, 0] == 9
        changed = (one.values != other.values).mean()
        assert 0.1 < changed < 0.4


def test_an_occluded_lens_hides_and_a_smeared_one_blurs() -> None:
    covered, healthy = faulty_and_not("fisheye", "occlusion")
    smeared, _ = faulty_and_not("fisheye", "smear")
    for one, other in zip(observed(covered), observed(healthy), strict=True):
        assert isinstance(one, Image)
        assert isinstance(other, Image)
        assert one.rgb[48, 38].max() < 60  # the middle of the blob
        assert np.abs(one.rgb[5:20, 44:52].astype(int) - other.rgb[5:20, 44:52]).mean() < 8  # noise and JPEG
        assert one.rgb[0, 0].max() < 12  # a fisheye's corner stays black
    for one, other in zip(observed(smeared), observed(healthy), strict=True):
        middle = np.s_[42:54, 42:54]
        assert np.diff(one.rgb[middle].astype(int), axis=1).std() < np.diff(other.rgb[middle].astype(int), axis=1).std()


def test_several_sensors_at_once_and_several_faults_of_one() -> None:
    both = run("laser", "faults.dead={sensor: [waist, knee], kind: dead_beams, beams: [[0, 5]]}",
               "faults.off={sensor: waist, kind: dropout, from_s: 0.5}",
               "faults.ahead={sensor: knee, kind: clock, offset_s: 1}",
               "faults.faster={sensor: knee, kind: clock, drift_ppm: 1000, from_s: 0.5}")[0]  # fmt: skip
    assert all(np.isnan(values(each)[:6]).all() for each in observed(both))
    assert [each.stamp_ns for each in both if sensor_of(each) == "waist"] == [k * 100_000_000 for k in range(5)]
    knee = [each.encoded.observation.stamp_ns for each in both if sensor_of(each) == "knee"]
    assert knee[-1] == 1_900_000_000 + 400_000


def test_a_tracker_bears_them_all() -> None:
    """A clock that steps back, a frozen layer and a silent one: the tracker goes on, and ends what it cannot see."""
    changes = ["duration_s=4", "faults.step={sensor: waist, kind: clock, offset_s: 0.31, from_s: 1, to_s: 2}",
               "faults.ice={sensor: knee, kind: freeze, from_s: 1.5, to_s: 2.5}",
               "faults.off={sensor: waist, kind: dropout, from_s: 2.6, to_s: 3.2}"]  # fmt: skip
    with Simulation(scenario("laser", *changes)) as simulation:
        tracker = make_tracker("laser-imm", simulation.rig, simulation.background())
        frames = list(track_frames(tracker, simulation.rig, simulation))
    stamps = [frame.stamp_ns for frame in frames]
    assert stamps == sorted(stamps)
    assert len(frames) > 30
    assert frames[-1].tracks


def values(observation: Observation) -> np.ndarray:
    match observation:
        case LaserScan():
            return observation.ranges_m
        case FloorFrame():
            return observation.values
        case Image():
            return observation.rgb
    raise AssertionError(type(observation))


def sensor_of(delivered: Delivered) -> str:
    return delivered.encoded.observation.sensor


class Watched:
    """A preview's writer that keeps how many people were drawn as they truly are, by stamp."""

    def __init__(self) -> None:
        self.people: dict[int, int | None] = {}

    def frame(self, stamp_ns: int, frame: PreviewFrame) -> None:
        self.people[stamp_ns] = None if frame.truth is None else len(frame.truth.ids)


def test_people_are_drawn_near_stamps_of_a_clock_that_is_off() -> None:
    writer = Watched()
    shown: list[Preview] = []
    clock = "faults.ahead={sensor: waist, kind: clock, offset_s: 0.03, from_s: 0.3}"
    with Simulation(scenario("laser", clock), on_truth=lambda frame: shown[0].add_truth(frame)) as simulation:
        shown.append(Preview(cast("PreviewWriter", writer), simulation.rig))
        for observation in simulation:
            shown[0].observe(observation)
            shown[0].draw_untracked(observation)
        shown[0].finish()
    assert 330_000_000 in writer.people
    assert set(writer.people.values()) == {1}
