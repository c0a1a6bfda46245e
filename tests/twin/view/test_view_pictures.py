"""The pictures and the video of `twin view`: what is in them, where their cameras are, what is refused."""

from __future__ import annotations

from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from trackers.configuration import validate
from trackers.errors import InputError
from twin.commands.view import check_options
from twin.room.building import check_mount
from twin.scenario import Scenario, load_scenario
from twin.view import write_people, write_video, write_view
from twin.view.contact_sheet import drawn_view
from twin.view.free_camera import CameraSpace, FollowCamera, body_parts, overview, seen_share, standpoint_for
from twin.view.video import FPS
from twin.world.world import World

pytestmark = pytest.mark.slow

FLOOR = {
    "kind": "floor",
    "rate_hz": 10,
    "rows": 14,
    "columns": 18,
    "pitch_m": 0.2,
    "mount": {"xyz": [-1.8, -1.4, 0]},
    "noise": "off",
}
NOTHING = {"at": 0.0, "people": False, "video": None, "start_s": 0.0, "end_s": None, "follow": None, "out": None}


def small(**more) -> Scenario:
    people = {
        "anna": {"start": [0.3, -0.2], "shirt": "#ff0000", "script": {"kind": "stand"}},
        "ben": {"start": [0.0, 0.6], "arrive_s": 1.0, "script": {"kind": "walk", "waypoints": [[-0.8, 0.2]]}},
    }
    content = {
        "name": "small",
        "room": "sensing_room",
        "people": people,
        "sensors": {"floor": FLOOR},
        "duration_s": 2.0,
    }
    return validate(Scenario, content | more, "test")


def read(path: Path) -> np.ndarray:
    picture = cv2.imread(str(path))
    assert picture is not None
    return picture


@pytest.fixture(scope="module")
def world() -> World:
    return World(small())


def test_a_standpoint_is_free_and_sees_the_person(world):
    snapshot = world.snapshot(0.5)
    room = CameraSpace(snapshot, world.scene.floor)
    stand = standpoint_for(snapshot, room, 1, 0.0, 0.8, 30.0)
    check_mount(snapshot.model, snapshot.data, "eye", stand.eye)
    assert room.is_free(snapshot, stand.eye)
    assert seen_share(snapshot, stand.eye, 1) > 0.4
    parts, _ = body_parts(snapshot, 1)
    way = stand.target - stand.eye
    up = np.array([0, 0, 1.0]) - way * way[2] / (way @ way)
    local = parts - stand.eye
    high = np.abs(local @ (up / np.linalg.norm(up))) / (local @ (way / np.linalg.norm(way)))
    assert (high < stand.half_height).all()


def test_no_camera_stands_in_a_wall_in_furniture_or_outside(world):
    snapshot = world.snapshot(0.5)
    room = CameraSpace(snapshot, world.scene.floor)
    for eye in ([2.49, 0.0, 1.5], [3.5, 0.0, 1.5], [-1.44, 1.6, 0.3], [0.0, 0.0, 2.59]):
        assert not room.is_free(snapshot, np.array(eye))
    assert room.is_free(snapshot, np.array([0.0, -0.9, 1.5]))


def test_the_overview_sees_where_people_are(world):
    snapshot = world.empty_snapshot(0.0)
    room = CameraSpace(snapshot, world.scene.floor)
    points = np.array([[x, y, z] for x in (-1.0, 0.0, 1.0) for y in (-0.8, 0.6) for z in (0.2, 1.6)])
    stand = overview(snapshot, room, points, 16 / 9)
    assert room.is_free(snapshot, stand.eye)
    assert stand.eye[2] > 1.8


def test_the_sheet_of_people_holds_everybody_and_everything(tmp_path):
    path = tmp_path / "people.png"
    found = write_people(small(), path)
    assert [(each.person, each.verb) for each in found] == [("anna", "stands"), ("ben", "walks")]
    sheet = read(path)[..., ::-1].astype(int)
    red = (sheet[..., 0] > 90) & (sheet[..., 1] < 40) & (sheet[..., 2] < 40)
    half = sheet.shape[0] // 2
    assert red[:half].sum() > 1000 and red[half:].sum() > 1000


def test_a_contact_sheet_shows_every_sensor(tmp_path):
    path = tmp_path / "view.png"
    assert write_view(small(), 1.5, path) == ()
    one_row = read(path)
    camera = {"kind": "fisheye", "rate_hz": 10, "size": [160, 160], "mount": {"xyz": [-2.3, -0.4, 1.5]}, "noise": "off"}
    write_view(small(sensors={"floor": FLOOR, "eye": camera, "other": camera}), 1.5, path)
    two_rows = read(path)
    assert two_rows.shape == (2 * one_row.shape[0], *one_row.shape[1:])
    smaller, _ = drawn_view(small(), 1.5, (260, 195))
    assert 1.8 * smaller.shape[1] < one_row.shape[1]


def test_a_sheet_s_plan_has_a_floor_where_it_is_and_says_where_it_is_believed(tmp_path):
    def plan(**calibration_error) -> np.ndarray:
        write_view(small(people={}, sensors={"floor": FLOOR | calibration_error}), 1.5, tmp_path / "view.png")
        return read(tmp_path / "view.png")[35 : 35 + 390, 535:1055].astype(int)

    true, misled = plan(), plan(calibration_error={"xyz": [0.6, 0.4, 0]})
    disc = (true > 235).all(axis=-1)  # at the grid's corner, where its frame is
    assert 50 < disc.sum() < 120 and (misled[disc] > 225).all()
    assert ((misled - true) > 100).all(axis=-1).sum() > 300  # the dashed outline and the letters beside it


def pictures(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        assert container.streams.video[0].codec_context.name == "h264"
        return [frame.to_ndarray(format="rgb24").astype(np.int16) for frame in container.decode(video=0)]


def test_a_video_has_25_pictures_a_second_and_shows_the_pressure(tmp_path):
    path = tmp_path / "people.mp4"
    write_video(small(), path, start_s=0.5, end_s=0.9)
    shown = pictures(path)
    assert len(shown) == round(0.4 * FPS)
    empty = tmp_path / "unfelt.mp4"
    scanner = {"low": {"kind": "laser", "rate_hz": 10, "mount": {"xyz": [-2.4, -0.4, 0.4]}}}
    write_video(small(sensors=scanner), empty, start_s=0.5, end_s=0.54)
    pressed = [
        int(((each[..., 0] > 190) & (each[..., 1] < 170) & (each[..., 2] < 130) & (each[..., 1] > 80)).sum())
        for each in (shown[-1], pictures(empty)[-1])
    ]
    assert pressed[0] > pressed[1] + 200


def test_a_video_follows_somebody(tmp_path):
    path = tmp_path / "follow.mp4"
    write_video(small(), path, start_s=1.2, end_s=1.4, follow="ben")
    assert len(pictures(path)) == round(0.2 * FPS)


def test_who_walks_up_to_the_following_camera_is_seen_from_elsewhere():
    walk = {"kind": "walk", "waypoints": [[0.2, 0.2], [0.6, 0.9]]}
    world = World(small(people={"anna": {"start": [-1.6, 0.0], "script": walk}}, duration_s=3.0))
    camera = FollowCamera(CameraSpace(world.empty_snapshot(0.0), world.scene.floor), 1, 1.5)
    away = []
    for t in np.arange(0.0, 3.0, 0.1):
        snapshot = world.snapshot(t)
        eye = camera.at(snapshot, facing_rad=0.0).eye
        away.append(np.linalg.norm(body_parts(snapshot, 1)[0].mean(axis=0) - eye))
    assert min(away) < 1.2 < away[-1]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"start_s": 3.0}, "--from 3.*0 up to 2 s"),
        ({"start_s": 1.0, "end_s": 0.5}, "--to 0.5.*more than 1"),
        ({"end_s": 9.0}, "--to 9.*at most 2 s"),
        ({"follow": "eve"}, "--follow eve.*anna, ben"),
        ({"follow": "ben", "end_s": 0.2}, "--follow ben.*another time"),
    ],
)
def test_a_video_that_cannot_be_is_refused(tmp_path, options, words):
    with pytest.raises(InputError, match=words):
        write_video(small(), tmp_path / "people.mp4", **options)
    assert not list(tmp_path.iterdir())


def test_a_video_s_name_is_checked(tmp_path):
    with pytest.raises(InputError, match="ending in .mp4"):
        write_video(small(), tmp_path / "people.avi")
    with pytest.raises(InputError, match="ending in .png"):
        write_people(small(), tmp_path / "people.jpg")


def test_nobody_is_no_sheet(tmp_path):
    with pytest.raises(InputError, match="is empty"):
        write_people(small(people={}), tmp_path / "people.png")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"people": True, "video": Path("a.mp4")}, "--people.*one of the two"),
        ({"people": True, "at": 3.0}, "--at 3"),
        ({"video": Path("a.mp4"), "at": 3.0}, "--at 3.*--from and --to"),
        ({"video": Path("a.mp4"), "out": Path("b.png")}, "--out b.png"),
        ({"start_s": 2.0}, "--from 2.*--video"),
        ({"people": True, "end_s": 2.0}, "--to 2.*--video"),
        ({"follow": "anna"}, "--follow anna.*--video"),
    ],
)
def test_options_that_do_not_go_together_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        check_options(**NOTHING | options)
    check_options(**NOTHING)


def test_the_shipped_scenarios_have_sensors_for_their_trackers():
    assert set(load_scenario("everyday").sensors) == {"waist", "knee", "fisheye", "floor"}
    assert set(load_scenario("plaza-runners").sensors) == {"low"}
