"""Visibility compared with rays cast one by one and with the lens's own arithmetic."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from twin.instant.snapshot import RAY_GROUPS
from twin.scenario import load_scenario
from twin.studies.spec import Coverage
from twin.studies.visibility import (
    FloorResolution,
    SampledWorld,
    SensorVisibility,
    WorldSample,
    floor_cells,
    visited_cells,
)
from twin.world.body_pool import body_pools
from twin.world.world import PrecomputedScene, precompute_people

COVERAGE = Coverage(beams=6, px_per_m=60, target="head", heights_m=(1.0, 1.6))


@pytest.fixture(scope="module")
def sampled() -> SampledWorld:
    scenario = load_scenario("lab-five-people", ["duration_s=2"])
    return SampledWorld(scenario, PrecomputedScene.of(scenario, *precompute_people(scenario)), [0.3, 1.1, 1.9])


def test_a_scanner_sees_a_person_that_enough_beams_meet(sampled: SampledWorld) -> None:
    visibility = SensorVisibility(sampled.scenario, "waist", COVERAGE)
    found = visibility.people(sampled)
    expected = []
    angles = np.deg2rad(np.linspace(-90, 90, 361) + 90)
    for sample in sampled.samples:
        snapshot, met = sampled.at(sample), []
        for angle in angles:
            geom = np.zeros(1, dtype=np.int32)
            there = np.array([np.cos(angle), np.sin(angle), 0.0])
            mujoco.mj_ray(snapshot.model, snapshot.data, np.array([0, 0, 0.95]), there, RAY_GROUPS, 1, -1, geom, None)
            met.append(int(snapshot.person_of_geom[geom[0]]) if geom[0] >= 0 else 0)
        expected += [met.count(int(each)) >= 6 for each in sample.ids]
    assert found.tolist() == expected and len(found) == sampled.n_person_frame == 15


def test_a_person_of_a_file_is_seen_at_every_stamp(tmp_path: Path) -> None:
    """Others have bodies when others come: a moment among many is the same as alone."""
    rows = [
        f"{k + share * 4},{k},{-1.8 + share * 3.6},{0.9 + 0.8 * (k % 3)}" for k in range(40) for share in (0, 0.5, 1)
    ]
    (tmp_path / "paths.csv").write_text("\n".join(["t,id,x,y", *rows]))
    paths = f"pedestrians={{file: {tmp_path / 'paths.csv'}}}"
    scenario = load_scenario("lab-five-people", ["people=null", paths, "duration_s=42", "sensors.fisheye=null"])
    precomputed = PrecomputedScene.of(scenario, *precompute_people(scenario))
    times = [1.0, 2.5, 20.2, 20.7, 35.0, 41.0]
    together = SampledWorld(scenario, precomputed, times)
    visibility = SensorVisibility(scenario, "knee", COVERAGE)
    seen, cells = visibility.people(together), floor_cells(together.area, 0.3)
    assert len(body_pools(scenario.people)) > 1 and together.n_person_frame == len(seen) > 15 and seen.sum() > 0
    floor, resolution = visibility.floor(together, cells), visibility.resolution(together.empty(), cells)
    del together  # before the other worlds are made
    alone_seen, alone_floor = [], []
    for t in times:
        alone = SampledWorld(scenario, precomputed, [t])
        alone_seen.append(visibility.people(alone))
        alone_floor.append(visibility.floor(alone, cells))
        assert resolution.tolist() == visibility.resolution(alone.empty(), cells).tolist()
        del alone
    assert seen.tolist() == np.concatenate(alone_seen).tolist()
    assert floor.tolist() == np.concatenate(alone_floor).tolist()


def test_a_camera_sees_heads_at_pixels_a_metre(sampled: SampledWorld) -> None:
    lens = "size: [320, 240], vertical_field_of_view_deg: 59"
    camera = f"{{kind: camera, rate_hz: 5, {lens}, mount: {{xyz: [0, 0, 1.6], yaw_deg: 90}}}}"
    scenario = load_scenario("lab-five-people", [f"sensors.camera={camera}"])
    visibility = SensorVisibility(scenario, "camera", COVERAGE)
    cells = np.array([[0.0, 1.0], [0.0, 2.0], [0.0, 2.8], [0.0, -0.1], [2.9, 0.05]])
    focal = 120 / np.tan(np.deg2rad(59 / 2))
    sharp = visibility.resolution(sampled.empty(), cells)
    assert sharp.shape == (2, 5)
    assert sharp[1, :3] == pytest.approx(focal / cells[:3, 1], rel=0.01)  # straight ahead, at the camera's own height
    assert not sharp[:, 3:].any()  # behind it, beside its field
    seen = visibility.people(sampled)
    near = np.concatenate([np.linalg.norm(each.heads_m - [0, 0, 1.6], axis=1) for each in sampled.samples])
    assert seen.any() and (near[seen] < focal / 60 * 1.3).all()


def test_what_stands_before_a_cell_hides_it(sampled: SampledWorld) -> None:
    visibility = SensorVisibility(sampled.scenario, "waist", COVERAGE)
    sample = sampled.samples[0]
    cells = floor_cells(sampled.area, 0.1)
    empty = visibility.resolution(sampled.empty(), cells)[0].copy()
    among = visibility.resolution(sampled.at(sample), cells)[0].copy()
    assert (among <= empty).all() and (among < empty).mean() > 0.02
    gap = np.hypot(*cells.T)
    assert empty == pytest.approx(
        2 * np.degrees(np.arctan2(0.175, gap)) / 0.5
    )  # nothing hides the lab's floor at 0.95 m
    one = SensorVisibility(sampled.scenario, "waist", Coverage(of="floor", beams=6)).floor(sampled, cells)
    assert one.shape == (3 * len(cells),)


def test_a_part_of_the_area_that_nobody_visited_and_no_sensor_sees_is_warned_of():
    world = SampledWorld.__new__(SampledWorld)
    heads = np.array([[0.0, 0.0, 1.7], [2.0, 0.0, 1.7]])
    empty = np.zeros(0)
    world.samples = [WorldSample(0, empty, empty, np.array([1, 2], dtype=np.int16), heads, empty)]
    cells = np.array([[0.3, 0.3], [2.0, 0.4], [1.0, 0.0], [5.0, 5.0]])
    visited = visited_cells([world], cells)
    assert visited.tolist() == [True, True, False, False]

    def warning(*beams: float) -> str:
        return FloorResolution(cells, 0.1, {"low": np.array(beams)}, {"low": 6.0}).unvisited_warning(visited, 2)

    assert not warning(0, 9, 9, 9)
    both = warning(3, 9, 9, 0)
    assert "sees 50.0 % of the area (25.0 % hidden, or beyond every range and view, 25.0 % with too few beams" in both
    assert "; 25.0 % of the area are unseen and were never visited in the 2 person-frames." in both
    assert re.findall(r"[\d.]+ %", warning(9, 9, 9, 5)) == ["25.0 %"] * 2  # of the area, and by its one cause
    assert not visited_cells([], cells).any()


@pytest.mark.parametrize(
    ("resolution", "said"),
    [([0.0, 0.0], "outside its view or hidden"), ([30.0, 62.5], "its best has 62.5"), ([124.0, 125.0], None)],
)
def test_a_sensor_that_sees_no_place_is_told_why(resolution: list[float], said: str | None) -> None:
    floor = FloorResolution(np.zeros((2, 2)), 0.1, {"fisheye": np.array(resolution)}, {"fisheye": 125.0})
    warnings = floor.blind_warnings(load_scenario("lab-five-people"))
    assert len(warnings) == (said is not None) and (said or "") in "".join(warnings)
