"""The interactive plan in a browser: a reader drags and turns sensors, and the page says of them what the twin says."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

import pytest
from command_line import twin

from trackers.user_input.plain_data import dump_yaml
from twin.scenario import load_scenario

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
"""Path of a browser that prints a page after its scripts have run; None: none is on this machine."""

pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome is on this machine")

READER = """<script>
HTMLElement.prototype.setPointerCapture = () => {};  // the pointer of a script cannot be captured
const plan = document.getElementById("interactive-plan"), drawing = plan.querySelector("canvas");
const part = (name) => plan.querySelector(`[data-part="${name}"]`), field = (name) => part(name).valueAsNumber;
const point = (kind, x, y) => {
  const box = drawing.getBoundingClientRect();
  drawing.dispatchEvent(new PointerEvent(kind, { clientX: box.left + x, clientY: box.top + y, bubbles: true }));
};
const drag = (from, to) => { point("pointerdown", ...from); point("pointermove", ...to); point("pointerup", ...to); };
const choose = (row) => part("rows").querySelectorAll("tr")[row].click();
const placed = () => ({ name: part("name").textContent, x: field("x"), y: field("y"), yaw: field("yaw") });
const find = (row) => {  // the pixel by which the sensor of this row is taken hold of: one that turns nothing when dragged
  choose(row);
  const before = placed();
  for (let y = 2; y < drawing.clientHeight; y += 8) for (let x = 2; x < drawing.clientWidth; x += 8) {
    point("pointerdown", x, y); point("pointermove", x + 1, y); point("pointerup", x + 1, y);
    const { name, yaw, x: now } = placed();
    if (name === before.name && yaw === before.yaw && now !== before.x) return [x + 1, y];
    if (name !== before.name || yaw !== before.yaw) { part("reset").click(); choose(row); }
  }
};
const said = {};
%s
queueMicrotask(() => {  // after what a click waits for
  const end = { feedback: part("copied").textContent, yaml: part("yaml").value, shares: JSON.parse(plan.dataset.floorShares) };
  document.title = JSON.stringify({ ...said, ...end });
});
</script>"""


def read(page: Path, does: str) -> dict[str, Any]:
    """Return what the page says after a reader has done this, a script that may use the functions of `READER`."""
    assert BROWSER is not None
    changed = page.with_name("read.html")
    changed.write_text(page.read_text("utf-8").replace("</body>", READER % does + "</body>"), "utf-8")
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--window-size=1280,900"]
    command += [
        "--disable-background-networking",
        f"--user-data-dir={page.parent / 'browser'}",
        "--dump-dom",
        changed.as_uri(),
    ]
    shown = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout
    found = re.search(r"<title>(\{.*?\})</title>", shown, re.DOTALL)
    assert found, shown[-2000:]
    return json.loads(unescape(found[1]))


def coverage(scenario: str, *options: str, folder: Path) -> dict[str, float]:
    """Return the shares of the empty room's floor by sensor that the command says, whose page lies in the folder."""
    ended = twin("study", "coverage", scenario, *options, "--samples", "1", "--out", folder)
    assert ended.returncode == 0, ended.stderr
    found = json.loads((folder / "coverage.json").read_text("utf-8"))["sensors"]
    return {name: each["floor"] for name, each in found.items()}


def test_sensors_that_are_dragged_and_turned_see_what_the_twin_says(tmp_path: Path) -> None:
    coverage("drawn", "--seed", "1004", folder=tmp_path)
    said = read(
        tmp_path / "coverage.html",
        """
        const at = find(1); said.before = placed();
        const right = at[0] < drawing.clientWidth / 2 ? 60 : -60, down = at[1] < drawing.clientHeight / 2 ? 40 : -40;
        said.by = [right, -down];  // into the room
        drag(at, [at[0] + right, at[1] + down]); said.after = placed();
        const angle = said.after.yaw * Math.PI / 180;
        const tip = [at[0] + right + 34 * Math.cos(angle), at[1] + down - 34 * Math.sin(angle)];
        drag(tip, [tip[0] + 200, tip[1] + 90]); said.turned = placed();
        """,
    )
    before, after, turned = said["before"], said["after"], said["turned"]
    m_per_pixel = [(after[axis] - before[axis]) / by for axis, by in zip("xy", said["by"], strict=True)]
    assert m_per_pixel[0] == pytest.approx(m_per_pixel[1], abs=0.001)
    assert m_per_pixel[0] > 0
    assert after["yaw"] == before["yaw"]
    assert (turned["x"], turned["y"]) == (after["x"], after["y"])
    assert turned["yaw"] != after["yaw"]
    (tmp_path / "plan.yaml").write_text(said["yaml"], "utf-8")
    expected = coverage(str(tmp_path / "plan.yaml"), folder=tmp_path / "again")
    for name, share in said["shares"].items():
        assert share == pytest.approx(expected[name], abs=0.01)


def test_sensors_that_are_raised_exchanged_and_added_see_what_the_twin_says(tmp_path: Path) -> None:
    coverage("lab-five-people", folder=tmp_path)
    said = read(
        tmp_path / "coverage.html",
        """
        const set = (name, value) => {
          part(name).value = value;
          for (const kind of ["input", "change"]) part(name).dispatchEvent(new Event(kind, { bubbles: true }));
        };
        const at = find(0); said.before = placed();
        choose(1); said.other = placed();
        drag(at, [at[0] + 30, at[1]]); said.moved = placed();
        set("z", 0.6);
        choose(2); set("z", 1.9); set("pitch", 20); said.models = part("model").options.length;
        part("model").selectedIndex = 0; set("model", part("model").value);  // the fisheye camera becomes a scanner
        choose(0); part("add").click(); set("x", said.before.x + 0.5); set("yaw", 60);
        """,
    )
    assert said["before"]["name"] == "waist"
    assert (said["moved"]["name"], said["other"]["name"]) == ("knee", "knee")  # of those at one place the chosen one
    assert said["moved"]["x"] > said["other"]["x"]
    assert said["models"] > 1
    (tmp_path / "plan.yaml").write_text(said["yaml"], "utf-8")
    expected = coverage(str(tmp_path / "plan.yaml"), folder=tmp_path / "again")
    assert len(expected) == len(said["shares"]) == 4
    for name, share in said["shares"].items():
        assert share == pytest.approx(expected[name], abs=0.01), name
    changed = load_scenario(tmp_path / "plan.yaml").sensors
    assert changed["knee"].mount.xyz[2] == 0.6
    assert changed["fisheye"].kind == "laser"
    assert changed["fisheye"].mount.xyz[2] == 1.9


def test_what_a_study_forbids_is_said_and_a_copy_stands_where_it_may(tmp_path: Path) -> None:
    study = {
        "name": "forbids",
        "scenarios": [{"scenario": "lab-five-people", "set": {"duration_s": 1, "sensors.fisheye": None}}],
        "devices": {
            "waist": {
                "sensors": ["waist"],
                "walls": {"height_m": 0.95, "off_m": 0.15, "every_m": 2},
                "aim": "area",
                "price": 1500,
            }
        },
        "constraints": {
            "budget": 2000,
            "apart_m": 1,
            "cable": {"from": [-2.9, 1, 0.3], "price_per_m": 10},
            "keep_free": [{"name": "the door", "doors_m": 0.6}],
        },
        "objectives": [{"kind": "coverage"}],
        "coverage": {"of": "floor", "samples": 0, "cell_m": 0.4},
        "search": {"method": "greedy"},
    }
    (tmp_path / "study.yaml").write_text(dump_yaml(study), "utf-8")
    ended = twin("study", "run", tmp_path / "study.yaml", "--jobs", "1", "--out", tmp_path / "out")
    assert ended.returncode == 0, ended.stderr
    said = read(
        tmp_path / "out" / "report.html",
        """
        Object.defineProperty(navigator, "clipboard", { value: { writeText: (text) => { said.copied ??= text; } } });
        const set = (name, value) => {
          part(name).value = value; part(name).dispatchEvent(new Event("input", { bubbles: true }));
        };
        const row = [...part("rows").querySelectorAll("th")].findIndex((each) => each.textContent === "waist");
        const tell = () => ({ faults: part("faults").textContent, sum: part("sum").textContent });
        choose(row); said.recommended = tell();
        part("add").click(); said.added = { ...tell(), ...placed(), z: field("z") };
        part("copy").click(); said.shown = part("yaml").value;
        set("x", 2.8); set("y", 1.3); said.by_the_door = tell();
        set("x", 9); said.outside = tell();
        part("remove").click(); said.removed = tell(); part("copy").click();
        """,
    )
    summary = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))
    assert said["recommended"]["faults"] == said["removed"]["faults"] == ""
    price = float(said["recommended"]["sum"].rpartition("price with cables: ")[2])
    assert price == pytest.approx(summary["best"]["price"], abs=0.5)
    assert re.fullmatch(r"Not allowed – price [\d.]+: over the budget of 2000.", said["added"]["faults"])
    assert said["copied"] == said["shown"] and said["feedback"].startswith("copied: save it as ")
    (tmp_path / "out" / "plan.yaml").write_text(said["copied"], "utf-8")
    copied, own = (load_scenario(tmp_path / "out" / name).sensors for name in ("plan.yaml", "recommended.yaml"))
    assert copied["waist"] == own["waist"]
    there = own["waist"].mount.model_copy(update={"xyz": tuple(said["added"][axis] for axis in "xyz")})
    assert copied["waist_2"] == own["waist"].model_copy(update={"mount": there})
    assert "in the zone the door" in said["by_the_door"]["faults"]
    assert "waist_2: outside the building" in said["outside"]["faults"]
