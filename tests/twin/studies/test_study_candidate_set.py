"""Candidate poses of devices, and the scenarios made of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from small_study import written

from trackers.errors import InputError
from twin.scenario import load_scenario
from twin.scenario.housings import in_the_room
from twin.studies.apply_placement import apply_placement, write_scenario
from twin.studies.candidate_set import BASELINE, CandidateSet
from twin.studies.preflight import PreparedStudy, prepare


def prepared(folder: Path, **changes: Any) -> PreparedStudy:
    return prepare(written(folder, **changes))


def mounts(candidate_set: CandidateSet) -> list[tuple]:
    return [mount.xyz for option in candidate_set.poses for mount in option.mounts]


def test_no_place_is_amid_the_floor_in_a_wall_or_outside(tmp_path: Path) -> None:
    box = {"x_m": [-4, 4], "y_m": [-2, 5], "z_m": [0.95, 2.45], "every_m": 0.5}
    devices = {"waist": {"sensors": ["waist"], "box": box}}
    candidate_set = prepared(tmp_path, devices=devices).candidate_set
    places = np.array(mounts(candidate_set))
    walked = (np.abs(places[:, 0]) < 2.2) & (places[:, 1] > 0.4) & (places[:, 1] < 3.0)
    assert walked.any() and (places[walked, 2] >= 2.2).all()
    assert np.abs(places[:, 0]).max() <= 3.0 and places[:, 1].min() > -0.3 and places[:, 1].max() < 4.3
    assert set(candidate_set.rejected["waist"]) >= {"outside the building", "where people walk below 2.2 m"}
    everywhere = prepared(tmp_path, devices=devices, constraints__walked_below_m=0).candidate_set
    assert len(everywhere.poses) > len(candidate_set.poses)


def test_by_doors_nothing_hangs_lower_than_they_are_high(tmp_path: Path) -> None:
    """The lab's door: 1 m wide in the wall x = 3, its middle at y = 1.3, 2.02 m high."""
    box = {"x_m": [2.0, 2.8], "y_m": [0, 3], "z_m": [0.9, 2.4], "every_m": 0.25}
    devices, all_places = {"waist": {"sensors": ["waist"], "box": box}}, {"walked_below_m": 0}
    zone = {"name": "doors", "doors_m": 0.6}
    free, kept = (
        np.array(mounts(prepared(tmp_path, devices=devices, constraints=all_places | more).candidate_set))
        for more in ({}, {"keep_free": [zone]})
    )
    off_m = np.hypot(np.clip(2.97 - free[:, 0], 0, None), np.clip(np.abs(free[:, 1] - 1.3) - 0.53, 0, None))
    near = (off_m < 0.55) & (free[:, 2] < 2.0)
    far = (off_m > 0.68) | (free[:, 2] > 2.1)
    left = {tuple(each) for each in kept}
    assert near.any() and not left & {tuple(each) for each in free[near]}
    assert far.any() and left >= {tuple(each) for each in free[far]}


def test_more_devices_than_the_budget_pays_for_are_told(tmp_path: Path) -> None:
    candidate_set = prepared(tmp_path, devices__rig__count=[1, 2], constraints={"budget": 2000.5}).candidate_set
    assert candidate_set.over_budget({"rig": 1}) == ""
    assert candidate_set.over_budget({"rig": 2}) == "over the budget of 2000.5: they cost 3000 at least"


def test_a_rig_keeps_its_poses_and_counts_price_cable_and_distance(tmp_path: Path) -> None:
    ready = prepared(
        tmp_path,
        devices__rig__count=[1, 2],
        constraints={"apart_m": 2, "cable": {"from": [0, 0, 0], "price_per_m": 10}},
    )
    candidate_set = ready.candidate_set
    assert (
        candidate_set.prices[0] == pytest.approx(1500 + 10 * candidate_set.poses[0].cable_m)
        and candidate_set.poses[0].cable_m > 0.5
    )
    near = next((a, b) for a in range(9) for b in range(a + 1, 10) if candidate_set.apart_m(a, b) < 2)
    assert "apart_m" in candidate_set.violation(near) and "count" in candidate_set.violation((0, 1, 2))
    moved = apply_placement(ready.study, ready.scenario, [candidate_set.poses[0]])
    waist, knee = (in_the_room(moved, name).mount for name in ("waist", "knee"))
    assert np.array(waist.xyz) - np.array(knee.xyz) == pytest.approx([0, 0, 0.5])
    assert waist.xyz == pytest.approx(candidate_set.poses[0].mounts[0].xyz) and waist.yaw_deg == pytest.approx(
        knee.yaw_deg
    )
    far = next((a, b) for a in range(9) for b in range(a + 1, 10) if candidate_set.apart_m(a, b) > 2)
    two = apply_placement(ready.study, ready.scenario, [candidate_set.poses[each] for each in far])
    assert sorted(two.sensors) == ["knee", "knee-rig-2", "waist", "waist-rig-2"]


def test_pairs_are_mirrored_and_kinds_change_the_sensor(tmp_path: Path) -> None:
    waist = {
        "sensors": ["waist"],
        "places": [{"xyz": [-2.5, 0.2, 0.9], "yaw_deg": 60}],
        "mirrored": {"x_m": 0},
        "kinds": [{"name": "far", "set": {"range_max_m": 20}, "price": 7}, {"name": "near", "set": {"range_max_m": 3}}],
        "price": 5,
    }
    ready = prepared(tmp_path, devices={"waist": waist})
    first, second = ready.candidate_set.poses
    assert [mount.xyz[0] for mount in first.mounts] == [-2.5, 2.5] and first.mounts[1].yaw_deg == pytest.approx(120)
    assert (first.price, second.price) == (14, 10)
    cable = {
        "cable": {"from": [-2.5, 0.2, 1.9], "along": "straight", "price_per_m": 3}
    }  # 1 m above one, 5.1 m off the other
    wired = prepared(tmp_path, devices={"waist": waist}, constraints=cable).candidate_set.poses[0]
    assert (wired.cable_m, wired.price) == (pytest.approx(1 + 26**0.5), pytest.approx(14 + 3 * (1 + 26**0.5)))
    moved = apply_placement(ready.study, ready.scenario, [second])
    assert moved.sensors["waist-2"].range_max_m == 3 and moved.sensors["knee"] == ready.scenario.sensors["knee"]  # pyright: ignore


def test_the_scenarios_own_devices_cost_what_the_kind_costs_that_they_are(tmp_path: Path) -> None:
    kinds = [{"name": "near", "set": {"range_max_m": 3}, "price": 100}, {"name": "far", "price": 400}]
    waist = {"sensors": ["waist"], "places": [{"xyz": [-2.5, 0.2, 0.9], "yaw_deg": 60}], "kinds": kinds}
    assert prepared(tmp_path, devices={"waist": waist}).candidate_set.price(BASELINE) == 400
    near = [{"scenario": "lab-five-people", "set": {"duration_s": 1.5, "sensors.waist.range_max_m": 3}}]
    assert prepared(tmp_path, devices={"waist": waist}, scenarios=near).candidate_set.price(BASELINE) == 100
    pair = {**waist, "sensors": ["waist", "knee"], "kinds": kinds[:1]}
    assert prepared(tmp_path, devices={"waist": pair}).candidate_set.price(BASELINE) == 200
    cable = {
        "cable": {"from": [0, 0, 1.95], "along": "straight", "price_per_m": 3}
    }  # 1 m above one, 1.5 m above the other
    assert prepared(tmp_path, devices={"waist": pair}, constraints=cable).candidate_set.price(BASELINE) == 207.5
    together = {**pair, "sensors": [], "together": ["waist", "knee"]}
    assert prepared(tmp_path, devices={"waist": together}, constraints=cable).candidate_set.price(BASELINE) == 104.5


def test_impossible_candidates_are_refused(tmp_path: Path) -> None:
    (tmp_path / "free.yaml").write_text("extends: lab-faults\nname: free\nsensors: {waist: {role: null}}\n")
    level = [{"name": "level", "set": {"role": "waist"}}]  # poses are rejected by the role of the scenario's own
    tilts = {"places": [{"xyz": [0, 3.6, 0.9]}], "tilt_deg": [0, 60], "tilt_every_deg": 60}
    devices = {"waist": {"sensors": ["waist"], "kinds": level, **tilts}}
    ready = prepared(tmp_path, devices=devices, scenarios=[{"scenario": "free.yaml"}], trackers=["laser-imm"])
    with pytest.raises(
        InputError, match=r"sensors.waist.role: a waist scanner scans level, and this one is tilted by 60°"
    ):
        apply_placement(ready.study, ready.scenario, [ready.candidate_set.poses[1]])


def test_devices_of_an_entry_of_several_take_its_name_with_what_is_said_of_them(tmp_path: Path) -> None:
    (tmp_path / "late.yaml").write_text(
        "extends: library-hall\nname: late\nmain_sensor: east\nsensors: {camera: null}\nduration_s: 5\n"
        "faults: {gone: {kind: dropout, sensor: [west], from_s: 1, to_s: 2}}\n"
    )
    places = [{"xyz": [-12.8, y, 0.35]} for y in (-3.0, -2.0, 3.0)]
    devices = {"scanner": {"sensors": ["west", "east"], "places": places, "count": [1, 3]}}
    ready = prepared(tmp_path, devices=devices, scenarios=[{"scenario": "late.yaml"}], trackers=["sort"])
    moved = apply_placement(ready.study, ready.scenario, list(ready.candidate_set.poses))
    assert sorted(moved.sensors) == ["scanner-1", "scanner-2", "scanner-3"]
    assert moved.main_sensor == "scanner-2" and moved.faults["gone"].sensor == ("scanner-1",)
    one = apply_placement(ready.study, ready.scenario, [ready.candidate_set.poses[0]])
    assert list(one.sensors) == ["scanner-1"] and one.main_sensor is None
    path = tmp_path / "recommended.yaml"
    own_file = tmp_path / "late.yaml"
    write_scenario(path, load_scenario(own_file), moved, own_file, "there", "moved")
    loaded = load_scenario(path)
    assert loaded.sensors == moved.sensors and loaded.faults == moved.faults and loaded.main_sensor == "scanner-2"
    del ready  # before the other is made
    one_sensor = {"finder": {"sensors": ["west"], "places": places, "count": [1, 3]}}
    ready = prepared(tmp_path, devices=one_sensor, scenarios=[{"scenario": "late.yaml"}], trackers=["sort"])
    renamed = apply_placement(ready.study, ready.scenario, list(ready.candidate_set.poses))
    assert sorted(renamed.sensors) == ["east", "finder", "finder-2", "finder-3"]
    assert renamed.main_sensor == "east" and renamed.faults["gone"].sensor == ("finder",)


def test_a_new_device_takes_no_name_of_a_sensor_that_stays(tmp_path: Path) -> None:
    (tmp_path / "taken.yaml").write_text(
        "extends: lab-five-people\nname: taken\nduration_s: 1\n"
        "sensors: {fisheye: null, waist-2: {kind: laser, role: waist, rate_hz: 10, mount: {xyz: [0, 3.6, 0.95], yaw_deg: -90}}}\n"
    )
    places = [{"xyz": [x, 0.2, 0.9], "yaw_deg": 90} for x in (-1.0, 1.0)]
    devices = {"waist": {"sensors": ["waist"], "places": places, "count": [1, 2]}}
    ready = prepared(tmp_path, devices=devices, scenarios=[{"scenario": "taken.yaml"}])
    with pytest.raises(InputError, match=r"devices.waist: 'waist-2' is a sensor that stays; another name of the entry"):
        apply_placement(ready.study, ready.scenario, list(ready.candidate_set.poses))


def test_the_file_that_is_recommended_loads_to_the_placement(tmp_path: Path) -> None:
    ready = prepared(tmp_path)
    own_file = next(iter(ready.files.values()))
    moved = apply_placement(ready.study, ready.scenario, [ready.candidate_set.poses[3]])
    path = tmp_path / "recommended.yaml"
    write_scenario(path, load_scenario(own_file), moved, own_file, "there", "moved")
    loaded = load_scenario(path)
    assert loaded.sensors == moved.sensors and loaded.duration_s == moved.duration_s and loaded.people == moved.people
    content = yaml.safe_load(path.read_text())
    assert content["extends"] == "lab-five-people" and content["sensors"]["fisheye"] is None
    assert set(content["sensors"]["waist"]) == {"mount"}


def test_a_housing_is_moved_with_what_hangs_on_it(tmp_path: Path) -> None:
    (tmp_path / "poled.yaml").write_text(
        "extends: lab-five-people\nname: poled\nduration_s: 1\nhousings: {pole: {mount: {xyz: [0, 0, 0]}}}\n"
        "sensors:\n  fisheye: null\n  waist: {housing: pole}\n  knee: {housing: pole}\n"
    )
    devices = {"pole": {"housing": "pole", "places": [{"xyz": [2.4, 0.2, 0], "yaw_deg": 90}], "count": [1, 1]}}
    ready = prepared(tmp_path, devices=devices, scenarios=[{"scenario": "poled.yaml"}])
    moved = apply_placement(ready.study, ready.scenario, list(ready.candidate_set.poses))
    assert in_the_room(moved, "waist").mount.xyz == pytest.approx((2.4, 0.2, 0.95))
    assert in_the_room(moved, "knee").mount.yaw_deg == pytest.approx(180)


def test_a_pose_with_the_right_eye_of_a_stereo_camera_in_the_wall_is_rejected(tmp_path: Path) -> None:
    """The lab's wall stands at x = 3.05; turned to -x the right eye, half a metre off, is in the room."""
    eye = {"kind": "stereo", "rate_hz": 5, "field_of_view_deg": 60, "baseline_m": 0.5}
    eye["mount"] = {"xyz": [2.9, 2, 1.5], "yaw_deg": 180}
    places = [{"xyz": [2.9, 2, 1.5], "yaw_deg": yaw} for yaw in (90, 180)]
    ready = prepared(
        tmp_path,
        scenarios=[{"scenario": "lab-five-people", "set": {"duration_s": 1.5, "sensors.eye": eye}}],
        devices={"eye": {"sensors": ["eye"], "places": places}},
        constraints={"walked_below_m": 0},
        trackers=["fusion"],
    ).candidate_set
    assert [abs(pose.mounts[0].yaw_deg) for pose in ready.poses] == [180]
    assert sum(ready.rejected["eye"].values()) == 1
