"""The interactive plan: its script sees of the floor what the twin sees, and its YAML is a scenario."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import twin.studies
from trackers.area import Area
from twin.room.doorways import cable_route, doorways
from twin.scenario import load_scenario
from twin.scenario.load import dump_scenario
from twin.scenario.sensor_descriptions import FloorDescription
from twin.studies.candidate_poses import keep_free_zones
from twin.studies.candidate_set import building_of
from twin.studies.devices import Constraints
from twin.studies.interactive_plan import plan_data, section
from twin.studies.spec import Coverage
from twin.studies.visibility import SampledWorld, SensorVisibility, floor_cells
from twin.world.world import World

SCRIPT = Path(twin.studies.__file__).parent / "interactive_plan.js"
WITHIN = 0.01
"""Allowed difference of the seen share of the floor between the page and the twin."""
NODE = shutil.which("node")

SHARES = """
const RoomPlan = require(process.argv[1]), content = JSON.parse(require("fs").readFileSync(0, "utf-8"));
const plan = RoomPlan.planOf(content), cells = RoomPlan.cellsOf(content.area, content.cell_m);
const shares = Object.fromEntries(plan.sensors.map((each) => [each.name, RoomPlan.floorShare(plan, each, cells)]));
const moved = plan.sensors.slice(1).map((each) => ({ ...each, yaw_deg: 30 }));
const yaml = RoomPlan.yamlOf(plan, [...moved, { ...moved[0], name: "another" }], plan.sensors);
const same = RoomPlan.yamlOf(plan, plan.sensors, plan.sensors);
console.log(JSON.stringify({ shares, yaml, same }));
"""

PLACES = """
const RoomPlan = require(process.argv[1]), { places, ...content } = JSON.parse(require("fs").readFileSync(0, "utf-8"));
const plan = RoomPlan.planOf(content), sensor = { is_device: true, price: 0 };
console.log(JSON.stringify(places.map((xyz) => ({
  faults: RoomPlan.faultsOf(plan, { ...sensor, xyz }, []), price: RoomPlan.priceOf(plan, [{ ...sensor, xyz }]),
}))));
"""

ROLES = """
const RoomPlan = require(process.argv[1]), content = JSON.parse(require("fs").readFileSync(0, "utf-8"));
const plan = RoomPlan.planOf(content), [first] = plan.sensors;
const changed = ({ z, pitch_deg }) => ({ ...first, xyz: [first.xyz[0], first.xyz[1], z], pitch_deg });
console.log(JSON.stringify(content.changes.map((each) => RoomPlan.yamlOf(plan, [changed(each)], plan.sensors))));
"""


def computed_by_the_page(plan, script=SHARES):
    """Run the page's own script on a plan: by default shares of the floor by sensor, and the YAML of a changed placement."""
    assert NODE is not None
    done = subprocess.run(
        [NODE, "-e", script, str(SCRIPT)],
        input=json.dumps(plan),
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    return json.loads(done.stdout)


@pytest.mark.skipif(NODE is None, reason="node is not on this machine, which runs the page's script here")
@pytest.mark.parametrize(("name", "seed"), [("home-three-people", 0), ("meeting-three-people", 0), ("drawn", 1004)])
def test_the_page_sees_of_the_floor_what_the_twin_sees(name, seed, tmp_path):
    scenario = load_scenario(name, [f"seed={seed}"]).model_copy(update={"people": {}})
    first, sensor = next(each for each in scenario.sensors.items() if not isinstance(each[1], FloorDescription))
    tilted = sensor.mount.model_copy(update={"pitch_deg": sensor.mount.pitch_deg + 3.0, "roll_deg": 2.0})
    changed = scenario.sensors | {first: sensor.model_copy(update={"mount": tilted})}
    scenario = scenario.model_copy(update={"sensors": changed})
    asked, empty = Coverage(px_per_m=60), SampledWorld(scenario, None, [])
    names = [each for each, sensor in scenario.sensors.items() if not isinstance(sensor, FloorDescription)]
    cell_m = float(np.sqrt(np.prod(np.ptp(empty.area, axis=0)) / 2500))
    cells, building = floor_cells(empty.area, cell_m), building_of(World(scenario).scene)
    plan = plan_data(scenario, names, building, empty.area, asked, cell_m, extends="scenario.yaml")
    found = computed_by_the_page(plan)
    for each in names:
        visible = SensorVisibility(scenario, each, asked).resolution(empty.empty(), cells)[-1]
        least = asked.beams if scenario.sensors[each].kind == "laser" else asked.px_per_m
        assert found["shares"][each] == pytest.approx((visible >= least).mean(), abs=WITHIN)
    (tmp_path / "scenario.yaml").write_text(dump_scenario(scenario), "utf-8")
    (tmp_path / "plan.yaml").write_text(found["yaml"], "utf-8")
    loaded = load_scenario(tmp_path / "plan.yaml")
    assert names[0] not in loaded.sensors and "another" in loaded.sensors
    for each in names[1:]:  # turned, with every other field as it was
        assert loaded.sensors[each] == turned(scenario.sensors[each], 30)
    assert loaded.sensors["another"] == turned(scenario.sensors[names[1]], 30)
    (tmp_path / "same.yaml").write_text(found["same"], "utf-8")
    assert load_scenario(tmp_path / "same.yaml").sensors == scenario.sensors


def turned(sensor, yaw_deg):
    """The sensor in another direction."""
    return sensor.model_copy(update={"mount": sensor.mount.model_copy(update={"yaw_deg": yaw_deg})})


@pytest.mark.skipif(NODE is None, reason="node is not on this machine, which runs the page's script here")
def test_a_scanner_keeps_its_role_until_its_height_or_tilt_is_another_layer_s(tmp_path):
    scenario = load_scenario("lab-five-people", ["sensors.fisheye=null", "sensors.knee=null"])
    building = building_of(World(scenario).scene)
    plan = plan_data(scenario, ["waist"], building, building.outline, Coverage(), 0.1, extends="scenario.yaml")
    expected = {(0.9, 0): "waist", (0.3, 0): "knee", (1.1, 20): "waist", (1.1, 60): None}
    changes = [{"z": z, "pitch_deg": pitch_deg} for z, pitch_deg in expected]
    (tmp_path / "scenario.yaml").write_text(dump_scenario(scenario), "utf-8")
    for text, role in zip(computed_by_the_page(plan | {"changes": changes}, ROLES), expected.values(), strict=True):
        (tmp_path / "plan.yaml").write_text(text, "utf-8")
        assert load_scenario(tmp_path / "plan.yaml").sensors["waist"].role == role


@pytest.mark.skipif(NODE is None, reason="node is not on this machine, which runs the page's script here")
def test_the_page_allows_the_places_that_a_study_allows_at_the_same_price():
    scenario = load_scenario("drawn", ["seed=1004"])
    scene = World(scenario).scene
    building = building_of(scene)
    low, high = building.outline.min(axis=0) - 0.3, building.outline.max(axis=0) + 0.3
    rng = np.random.default_rng(5)
    places = np.column_stack([rng.uniform(low, high, (300, 2)), rng.uniform(0.1, 2.6, 300)]).round(3)
    start = (*building.outline[0].tolist(), 0.3)
    free, cable = [{"name": "doors", "doors_m": 0.8}], {"from": start, "price_per_m": 1}
    constraints = Constraints.model_validate({"keep_free": free, "cable": cable})
    zones = keep_free_zones(constraints, building, "study.yaml")
    plan = plan_data(
        scenario, [], building, building.outline, Coverage(), 0.1, extends="scenario.yaml", constraints=constraints, zones=zones
    )  # fmt: skip
    found = computed_by_the_page(plan | {"places": places.tolist()}, PLACES)
    zoned = np.zeros(len(places), dtype=bool)
    for zone in zones:
        zoned |= Area(np.array(zone.polygon)).contains(places[:, :2]) & (places[:, 2] <= zone.highest_m)
    refused = building.is_solid(places) | ~building.is_indoors(places) | zoned | building.is_walked(places, 2.2)
    edges = np.stack([building.outline, np.roll(building.outline, -1, axis=0)], axis=1)
    way = edges[:, 1] - edges[:, 0]
    along = np.clip(((places[:, None, :2] - edges[:, 0]) * way).sum(axis=2) / (way**2).sum(axis=1), 0, 1)
    gap_m = np.hypot(*np.moveaxis(places[:, None, :2] - edges[:, 0] - along[..., None] * way, 2, 0)).min(axis=1)
    clear = gap_m > 0.1  # the outline is drawn on a grid
    assert 20 < refused[clear].sum() < clear.sum() - 20
    assert (np.array([bool(each["faults"]) for each in found]) == refused)[clear].mean() > 0.99
    doors = doorways(building)
    for place, each in zip(places, found, strict=True):
        assert each["price"] == pytest.approx(cable_route(building, doors, np.array(start), place).length_m, abs=0.01)


def test_panes_of_glass_are_on_the_plan_and_in_no_ray_s_way():
    scenario = load_scenario("drawn", ["seed=1044", "room.glass=1", "room.rooms=[2,2]"])
    building = building_of(World(scenario).scene)
    plan = plan_data(scenario, [], building, building.outline, Coverage(), 0.1, extends="scenario.yaml")
    assert plan["glass"]
    for pane in plan["glass"]:
        middle = np.mean(pane["corners"], axis=0)
        around = [np.array(each["corners"]) for each in plan["prisms"] if each["z"][0] < 1 < each["z"][1]]
        assert not any(inside(middle, corners) for corners in around)


def inside(place, corners):
    """Whether a place is in a convex outline, counter-clockwise."""
    edges, to_place = np.roll(corners, -1, axis=0) - corners, place - corners
    return bool((edges[:, 0] * to_place[:, 1] - edges[:, 1] * to_place[:, 0] > 0).all())


def test_text_of_a_scenario_cannot_leave_the_page_s_data():
    plan = {"sensors": [{"price": None, "name": "</script><script>alert(1)"}]}
    assert "</script" not in section(plan)["plan_json"]
    assert json.loads(section(plan)["plan_json"]) == plan
