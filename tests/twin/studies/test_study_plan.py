"""The plan that one mounts sensors by."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from trackers.user_input.plain_data import dump_yaml
from twin.scenario import load_scenario
from twin.studies.candidate_set import building_of
from twin.studies.devices import Cable, Constraints, KeepFreeZone
from twin.studies.mounting_plan import floor_plan, margin_m
from twin.studies.plots import PlanSensor, WallDistance, plan_sensors
from twin.world.scene import build_scene

PT_PER_MM = 72 / 25.4
DOOR = KeepFreeZone(name="by the door", polygon=((0, 0), (1, 0), (1, 0.7), (0, 0.7)))
CABLE = Cable.model_validate({"from": [-2.9, 1.0, 0.3]})


@pytest.fixture(scope="module")
def lab():
    scenario = load_scenario("lab-five-people", [])
    scene = build_scene(scenario)
    return scenario, scene, building_of(scene)


def plan_of(lab, constraints: Constraints) -> tuple[ElementTree.Element, int, np.ndarray]:
    """Draw the plan; return the SVG, its scale, and the corner of the paper in the room [m]."""
    scenario, scene, building = lab
    sensors = plan_sensors(scenario, list(scenario.sensors), building)
    places = [np.array([2.0, -0.1, 1.0])]
    svg, scale, _ = floor_plan(
        scenario, scenario, sensors, building, scene.area, constraints, places, constraints.keep_free
    )
    return ElementTree.fromstring(svg), scale, building.outline.min(axis=0) - margin_m(scale)


def test_walls_stand_on_paper_where_they_stand_in_the_room(lab) -> None:
    """The lab's walls are planes at x = -3 and 3; a tenth of a millimetre on paper is what a pencil is wide."""
    svg, scale, corner = plan_of(lab, Constraints())
    numbers = [re.findall(r"-?[\d.]+", path.get("d", "")) for path in svg.iter("{http://www.w3.org/2000/svg}path")]
    x_pt = np.array([float(x) for path in numbers for x in path[::2]])
    for wall_m in (-3.0, 3.0):
        expected_pt = 1000 * (wall_m - corner[0]) / scale * PT_PER_MM
        assert np.abs(x_pt - expected_pt).min() < 0.1 * PT_PER_MM


def test_zones_and_cables_are_drawn(lab) -> None:
    empty, *_ = plan_of(lab, Constraints())
    full, *_ = plan_of(lab, Constraints(cable=CABLE, keep_free=(DOOR,)))
    comments = ElementTree.tostring(full, encoding="unicode")
    assert "pattern" in comments and "pattern" not in ElementTree.tostring(empty, encoding="unicode")
    assert "#2678c4" in comments and "#2678c4" not in ElementTree.tostring(empty, encoding="unicode")


@pytest.mark.parametrize(
    ("yaw_deg", "said"),
    [
        (90, "straight off A"),
        (90.4, "straight off A"),
        (63, "27° right of straight off A"),
        (-153.5, "116° left of straight off A"),
    ],
)
def test_directions_are_seen_from_the_nearest_wall(yaw_deg: float, said: str) -> None:
    """A wall along x, the room above it: straight off it is 90°; at -153.5° one looks to the left and back."""
    wall = WallDistance("A", 0.1, np.zeros(2), np.array([1.0, 0.0]))
    sensor = PlanSensor(1, "low", "laser", 0.0, 0.1, 1.0, yaw_deg, 0.0, (wall,))
    assert sensor.from_wall() == said
    assert sensor.yaw in sensor.label() and sensor.yaw in sensor.lines()[1]


def test_all_text_has_one_size(lab) -> None:
    svg, *_ = plan_of(lab, Constraints(cable=CABLE, keep_free=(DOOR,)))
    texts = {each.text: each.get("style", "") for each in svg.iter("{http://www.w3.org/2000/svg}text")}
    assert {"waist", "h 0.95 m, 90°", DOOR.name, "keep free", "1 m", "0, 0"} <= set(texts)
    sizes = [float(found[1]) for style in texts.values() if (found := re.search(r"([\d.]+)px", style))]
    assert len(sizes) == len(texts) and np.ptp(sizes) < 0.05


BOXES = {  # middle and half the size [m]
    "floor": ("0 0 -0.05", "2 2 0.05"),
    "west": ("-2.05 0 1.3", "0.05 2.1 1.3"),
    "east": ("2.05 0 1.3", "0.05 2.1 1.3"),
    "south": ("0 -2.05 1.3", "2 0.05 1.3"),
    "beside_the_door": ("-1.6 2.05 1.3", "0.4 0.05 1.3"),
    "north": ("1.0 2.05 1.3", "1.0 0.05 1.3"),
    "sideboard": ("-0.5 -1.8 0.4", "0.9 0.15 0.4"),
    "wardrobe": ("1.6 -1.6 1.3", "0.3 0.3 1.3"),
}


def test_walls_are_told_from_furniture_and_labels_of_near_sensors_keep_apart(tmp_path: Path) -> None:
    geoms = "".join(f'<geom name="{name}" type="box" pos="{at}" size="{half}"/>' for name, (at, half) in BOXES.items())
    (tmp_path / "closet.xml").write_text(f"<mujoco><worldbody>{geoms}</worldbody></mujoco>", "utf-8")
    content: dict[str, Any] = {"name": "closet", "room": "closet.xml", "duration_s": 1, "people": {}, "sensors": {}}
    for name, x, y in (("low", 0.0, -1.5), ("by_it", 0.05, -1.45), ("far", 1.5, 1.0)):
        content["sensors"][name] = {"kind": "laser", "rate_hz": 10, "mount": {"xyz": [x, y, 1]}}
    (tmp_path / "closet.yaml").write_text(dump_yaml(content), "utf-8")
    scenario = load_scenario(tmp_path / "closet.yaml", [])
    scene = build_scene(scenario)
    svg, *_ = plan_of((scenario, scene, building_of(scene)), Constraints())
    drawn = ElementTree.tostring(svg, encoding="unicode")
    # five walls; each, the sideboard and the wardrobe
    assert drawn.count("fill: #7a838f") == 5 and drawn.count("fill: #d5d9df") == 7
    texts = list(svg.iter("{http://www.w3.org/2000/svg}text"))
    words = [each.text or "" for each in texts]
    assert {"1,2", "3"} <= set(words)
    sensors = plan_sensors(scenario, list(scenario.sensors), building_of(scene))
    for letter in {each.letter for sensor in sensors for each in sensor.walls}:  # the wall's own, and at a dimension
        assert words.count(letter) == 1 and any(word.endswith(f" {letter}") for word in words)
    assert words.count("4.00 m") == 2  # the room, in both directions
    boxes = [(each.text, *box_of(each)) for each in texts]
    for place, (text, low, high) in enumerate(boxes):
        for other, other_low, other_high in boxes[:place]:
            if not {text, other} <= {"1,2", "3"}:
                assert (low >= other_high).any() or (other_low >= high).any(), (text, other)


def box_of(text: ElementTree.Element) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of a text of the plan [pt], of letters 0.5 em wide and 0.7 em high, unless turned."""
    style, words = text.get("style", ""), text.text or ""
    size = float(re.search(r"([\d.]+)px", style)[1])  # pyright: ignore[reportOptionalSubscript]
    turned = text.get("transform", "")
    at = turned[turned.index("translate") :].partition(")")[0] if "translate" in turned else turned
    x, y = map(float, re.findall(r"-?[\d.]+", at)[-2:])
    width = 0.5 * size * len(words)
    left = width / 2 if "text-anchor: middle" in style else 0.0
    if "rotate(-90" in turned:
        return np.array([x - 0.7 * size, y - width + left]), np.array([x, y + left])
    return np.array([x - left, y - 0.7 * size]), np.array([x - left + width, y])
