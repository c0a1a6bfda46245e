"""The room from above: what every scanner sees of the floor, and sensors whose assumed pose is not the true one."""

from __future__ import annotations

from html import unescape
from pathlib import Path

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from trackers.observations import LaserScan, Odometry
from trackers.rig import FloorSensor, LaserSensor, OdometrySensor, Pose, Rig, RigSensor
from twin import load_scenario, run_scenario
from twin.report.assumed_poses import assumed_poses, assumed_poses_svg
from twin.report.birdseye import FloorView, Site, floor_extent
from twin.report.floor_panel import FloorPanel, PreviewFrame
from twin.report.palette import LAYER_COLOURS, IdentityColours

AREA = ((-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0))
SIZE = (400, 400)
SENSOR = (240, 240, 240)


def scanner(x: float, y: float, yaw_deg: float = 0.0, z: float = 0.9) -> LaserSensor:
    return LaserSensor(
        topic=f"/{x:g}/{y:g}/{z:g}/{yaw_deg:g}",
        room_from_sensor=Pose(xyz=(x, y, z), rpy=(0.0, 0.0, np.deg2rad(yaw_deg))),
    )


def rig(**sensors: RigSensor) -> Rig:
    each = {name: sensor.model_copy(update={"topic": f"/{name}"}) for name, sensor in sensors.items()}
    return Rig(sensors=each, area=AREA)


def sector(name: str) -> LaserScan:
    """Beams from straight ahead to 20° either side, all of which meet something at 2 m."""
    return LaserScan(name, 0, np.full(41, 2.0, np.float32), np.deg2rad(-20.0), np.deg2rad(1.0), 0.05, 8.0)


def drawn(
    assumed: Rig, *scans: str, true: Rig | None = None, about: tuple[str, ...] | None = None
) -> NDArray[np.uint8]:
    panel = np.zeros((SIZE[1], SIZE[0], 3), dtype=np.uint8)
    floor = FloorPanel(Site(assumed, true_rig=true), *SIZE, about=about)
    floor.draw(panel, PreviewFrame({name: sector(name) for name in scans}), IdentityColours())
    return panel


def at(panel: NDArray[np.uint8], assumed: Rig, x: float, y: float) -> NDArray[np.int64]:
    """The colour [RGB] of the drawing at a place of the room, off the lines of the grid."""
    view = FloorView.fit(floor_extent(assumed, []), *SIZE)
    column, row = view.pixels(np.array([x, y])).astype(int)
    return panel[row, column].astype(np.int64)


def test_scans_are_drawn_from_where_their_base_is_and_where_it_was_last() -> None:
    moving = scanner(0.0, 0.0).model_copy(update={"mounted_on": "base"})
    assumed = Rig(sensors={"base": OdometrySensor(topic="/odom"), "west": moving}, area=AREA)
    moved = np.eye(4)
    moved[0, 3] = -1.0
    floor, colours = FloorPanel(Site(assumed), *SIZE), IdentityColours()
    panels = []
    for odometry in ({}, {"base": Odometry("base", 0, moved)}, {}):
        panels.append(np.zeros((SIZE[1], SIZE[0], 3), np.uint8))
        floor.draw(panels[-1], PreviewFrame({"west": sector("west"), **odometry}), colours)
    start, now, later = panels
    for place, before in (((-0.5, 0.05), False), ((1.5, 0.05), True)):
        brighter = at(start, assumed, *place) - at(now, assumed, *place)
        assert (brighter > 15).any() if before else (brighter < -15).any()
    assert (later == now).all()


def test_every_scanner_s_free_space_is_seen_in_its_colour_and_through_the_others() -> None:
    assumed = rig(west=scanner(-1.9, 0.1), south=scanner(0.1, -1.9, 90.0))
    alone = {name: drawn(assumed, name) for name in ("west", "south")}
    both = drawn(assumed, "west", "south")
    nowhere = drawn(assumed)
    by_west, by_south, by_both = (-1.4, 0.1), (0.1, -1.4), (-0.1, -0.1)
    for name, place, other in (("west", by_west, by_south), ("south", by_south, by_west)):
        light = at(alone[name], assumed, *place) - at(nowhere, assumed, *place)
        assert light.min() > 0 and light.max() >= 20  # plainly lighter than what no scanner sees
        assert (at(both, assumed, *place) == at(alone[name], assumed, *place)).all()
        assert (at(alone[name], assumed, *other) == at(nowhere, assumed, *other)).all()
    west, south = at(both, assumed, *by_west), at(both, assumed, *by_south)
    assert west[0] - west[2] >= south[0] - south[2] + 20  # amber against turquoise
    assert (at(both, assumed, *by_both) > np.maximum(west, south)).sum() >= 2  # lighter where both see


def test_a_sensor_stands_where_it_is_and_dashed_with_a_label_where_it_is_assumed() -> None:
    true, assumed = rig(waist=scanner(-1.0, -1.0)), rig(waist=scanner(0.5, 0.5, 30.0))
    (pose,) = assumed_poses(assumed, true)
    assert pose.text == "waist assumed 2.1 m, 30° off"
    misled, healthy, without = drawn(assumed, true=true), drawn(true, true=true), drawn(assumed)
    assert (at(healthy, true, -1.0, -1.0) == SENSOR).all() and (at(misled, true, -1.0, -1.0) == SENSOR).all()
    assert (
        at(misled, true, 0.5, 0.5) != SENSOR
    ).any()  # what was the sensor's place where only the assumed pose is known
    assert (at(without, assumed, 0.5, 0.5) == SENSOR).all()
    amber = np.abs(misled.astype(int) - LAYER_COLOURS[0]).max(axis=-1) < 60
    view = FloorView.fit(floor_extent(true, []), *SIZE)
    x, y = view.pixels(np.array([0.5, 0.5]))
    turn = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    ring = amber[np.rint(y + 11 * np.sin(turn)).astype(int), np.rint(x + 11 * np.cos(turn)).astype(int)]
    assert 0.3 < ring.mean() < 0.7 and np.count_nonzero(ring != np.roll(ring, 1)) >= 10  # dashed, not drawn through
    ys, xs = np.nonzero(amber)
    assert np.count_nonzero((np.abs(xs - x) > 20) & (np.abs(ys - y) < 10)) > 200  # the letters, beside it
    assert np.array_equal(drawn(assumed, true=true, about=("knee",)), drawn(true, true=true))


def test_a_true_assumed_pose_has_no_marks() -> None:
    true = rig(waist=scanner(-1.0, -1.0), other=scanner(1.0, 1.0))
    assert assumed_poses(true, true) == [] and assumed_poses(true, None) == [] and svg_of_poses(true, true) == ""
    assert np.array_equal(drawn(true, "waist", true=true), drawn(true, "waist"))


def svg_of_poses(assumed: Rig, true: Rig) -> str:
    return assumed_poses_svg(FloorView.fit(floor_extent(true, []), *SIZE), assumed, true)


def test_height_alone_and_a_floor_that_lies_elsewhere_are_named() -> None:
    (pose,) = assumed_poses(rig(waist=scanner(0, 0, z=0.95)), rig(waist=scanner(0, 0, z=0.9)))
    assert pose.text == "waist assumed 0.05 m off"
    plate = FloorSensor(topic="/f", rows=4, columns=4, pitch_m=0.2)
    moved = plate.model_copy(update={"room_from_sensor": Pose(xyz=(0.5, 0.0, 0.0))})
    assert 'class="assumed"' in svg_of_poses(rig(plate=moved), rig(plate=plate))
    before, after = drawn(rig(plate=plate), true=rig(plate=plate)), drawn(rig(plate=moved), true=rig(plate=plate))
    edge = [(0.5 + 0.8, y) for y in np.linspace(0.05, 0.75, 30)]  # the assumed grid's far edge
    changed = [(at(after, rig(plate=plate), *place) != at(before, rig(plate=plate), *place)).any() for place in edge]
    assert 0.2 < np.mean(changed) < 0.9


@pytest.mark.parametrize("assumed", [True, False])
def test_a_run_s_report_and_video_draw_the_true_sensor_and_the_assumed_one(tmp_path: Path, assumed: bool) -> None:
    changes = ["sensors.knee=null", "sensors.fisheye=null", "people={}", "duration_s=0.5"]
    changes += ["sensors.waist.calibration_error={xyz: [0.6, 0.5, 0]}"] if assumed else []
    scenario = load_scenario("lab-five-people", changes)
    run_scenario(scenario, trackers=["laser-imm"], out=tmp_path)
    page = unescape((tmp_path / "report.html").read_text())
    assert ("waist assumed 0.78 m off" in page) is assumed and ('class="assumed"' in page) is assumed
    with av.open(str(tmp_path / "preview.mp4")) as container:
        picture = next(container.decode(video=0)).to_ndarray(format="rgb24").astype(int)
    white = (picture[44:612] > 225).all(axis=-1)
    rows, columns = np.nonzero(white)
    disc = np.abs(rows - np.median(rows)) < 6, np.abs(columns - np.median(columns)) < 6
    assert 50 < np.count_nonzero(disc[0] & disc[1]) < 120
    # the scanner hangs in the middle of the lab's breadth, whatever is assumed of it
    assert abs(float(np.median(columns)) - 1280 / 2) < 12
