"""The interactive plan: its script sees of the floor what the twin sees, and its YAML is a scenario."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import twin.studies
from twin.scenario import load_scenario
from twin.scenario.load import dump_scenario
from twin.scenario.sensor_descriptions import FloorDescription
from twin.studies.candidate_set import building_of
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
console.log(JSON.stringify({ shares, yaml }));
"""


def computed_by_the_page(plan):
    """Run the page's own script on a plan: shares of the floor by sensor, and the YAML of a changed placement."""
    assert NODE is not None
    done = subprocess.run(
        [NODE, "-e", SHARES, str(SCRIPT)],
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
    assert loaded.sensors[names[1]].mount.yaw_deg == 30


def test_panes_of_glass_are_on_the_plan_and_in_no_ray_s_way():
    scenario = load_scenario("drawn", ["seed=1044", "room.glass=1", "room.rooms=[2,2]"])
    building = building_of(World(scenario).scene)
    plan = plan_data(scenario, [], building, building.outline, Coverage(), 0.1, extends="scenario.yaml")
    assert plan["glass"]
    for pane in plan["glass"]:
        middle = np.mean(pane, axis=0)
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
