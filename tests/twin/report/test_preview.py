"""The preview video: decodable, whole or absent, with what was handed in drawn on it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from synthetic_run import PERIOD_NS, SyntheticRun

from trackers.cameras import PinholeIntrinsics
from trackers.errors import InputError
from trackers.observations import NS_PER_S, DepthImage, Image
from trackers.rig import LaserSensor, PinholeSensor, Rig
from trackers.tracks import Hypotheses, ScoreMap, Track
from twin.report.birdseye import Site
from twin.report.floor_panel import PreviewFrame, TruePoses
from twin.report.palette import IDENTITY_COLOURS
from twin.report.preview import PreviewWriter

N = 12


def poses(synthetic: SyntheticRun, index: int) -> TruePoses:
    people = synthetic.truth_frames[index].people
    return TruePoses(
        np.array([person.id for person in people]),
        np.array([(person.x, person.y) for person in people]),
        np.array([person.yaw for person in people]),
    )


def write(path: Path, synthetic: SyntheticRun, n: int = N) -> bytes:
    with PreviewWriter(path, Site(synthetic.rig, synthetic.outline), fps=10, tracker="t", title="s") as writer:
        for index in range(n):
            frame = synthetic.track_frames[index]
            newest = {"camera": synthetic.image, **synthetic.scans(index)}
            writer.frame(frame.stamp_ns, PreviewFrame(newest, frame.tracks, poses(synthetic, index)))
        return writer.still()


def decoded(path: Path) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    with av.open(str(path)) as container:
        for picture in container.decode(video=0):
            assert picture.time is not None
            yield picture.time, np.asarray(picture.to_ndarray(format="rgb24"), dtype=np.uint8)


def jpeg(data: bytes) -> NDArray[np.uint8]:
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
    assert picture is not None
    return np.asarray(picture, dtype=np.uint8)


def near(picture: NDArray[np.uint8], colour: tuple[int, int, int], tolerance: int = 30) -> int:
    """Count the pixels of about this colour."""
    return int((np.abs(picture.astype(int) - colour).max(axis=-1) <= tolerance).sum())


def test_video_has_every_frame_at_its_time(tmp_path: Path, synthetic: SyntheticRun) -> None:
    still = write(tmp_path / "preview.mp4", synthetic)
    frames = list(decoded(tmp_path / "preview.mp4"))
    assert len(frames) == N
    np.testing.assert_allclose([t for t, _ in frames], np.arange(N) / 10, atol=1e-4)
    assert all(picture.shape == (640, 1280, 3) for _, picture in frames)
    assert np.abs(jpeg(still).astype(int) - frames[-1][1]).mean() < 6
    with av.open(str(tmp_path / "preview.mp4")) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264"
        assert stream.codec_context.pix_fmt == "yuv420p"
    assert list(tmp_path.iterdir()) == [tmp_path / "preview.mp4"]


def test_a_browser_can_start_before_the_end(tmp_path: Path, synthetic: SyntheticRun) -> None:
    write(tmp_path / "preview.mp4", synthetic)
    content = (tmp_path / "preview.mp4").read_bytes()
    assert 0 < content.index(b"moov") < content.index(b"mdat")


def test_same_input_same_file(tmp_path: Path, synthetic: SyntheticRun) -> None:
    write(tmp_path / "a.mp4", synthetic, n=4)
    write(tmp_path / "b.mp4", synthetic, n=4)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_times_follow_the_stamps_across_a_gap(tmp_path: Path, synthetic: SyntheticRun) -> None:
    start = 1_700_000_000 * NS_PER_S  # a robot's clock
    with PreviewWriter(tmp_path / "v.mp4", Site(synthetic.rig), fps=10) as writer:
        for index in (0, 1, 5):
            writer.frame(start + index * PERIOD_NS, PreviewFrame({}))
    assert [t for t, _ in decoded(tmp_path / "v.mp4")] == pytest.approx([0.0, 0.1, 0.5], abs=1e-4)


def test_stamps_must_rise(tmp_path: Path, synthetic: SyntheticRun) -> None:
    with PreviewWriter(tmp_path / "v.mp4", Site(synthetic.rig), fps=10) as writer:
        writer.frame(5, PreviewFrame({}))
        with pytest.raises(ValueError, match="not later"):
            writer.frame(5, PreviewFrame({}))


def test_exception_leaves_nothing_new(tmp_path: Path, synthetic: SyntheticRun) -> None:
    path = tmp_path / "preview.mp4"
    path.write_bytes(b"older")

    def interrupted() -> None:
        with PreviewWriter(path, Site(synthetic.rig), fps=10) as writer:
            writer.frame(0, PreviewFrame(synthetic.scans(0), synthetic.track_frames[5].tracks))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_bytes() == b"older"
    assert list(tmp_path.iterdir()) == [path]


def test_no_frame_no_file(tmp_path: Path, synthetic: SyntheticRun) -> None:
    with (
        PreviewWriter(tmp_path / "v.mp4", Site(synthetic.rig), fps=10) as writer,
        pytest.raises(ValueError, match="no frame"),
    ):
        writer.still()
    assert list(tmp_path.iterdir()) == []


def test_unwritable_place_is_named(tmp_path: Path, synthetic: SyntheticRun) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"v\.mp4: cannot be written"):
        PreviewWriter(tmp_path / "file" / "v.mp4", Site(synthetic.rig), fps=10)
    (tmp_path / "v.mp4").mkdir()
    with pytest.raises(InputError, match=r"v\.mp4: cannot be written"):
        PreviewWriter(tmp_path / "v.mp4", Site(synthetic.rig), fps=10)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_full_disk_is_named(tmp_path: Path, synthetic: SyntheticRun, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("twin.report.preview.partial_path", lambda path: Path("/dev/full"))
    monkeypatch.setattr(Path, "unlink", lambda self, missing_ok=False: None)
    with pytest.raises(InputError, match="No space left on device"):
        write(tmp_path / "v.mp4", synthetic)
    assert list(tmp_path.iterdir()) == []


def test_without_camera_the_floor_takes_the_width(tmp_path: Path, synthetic: SyntheticRun) -> None:
    rig = Rig(sensors={"scan": LaserSensor(topic="/scan")})
    scan = replace(synthetic.scans(0)["waist"], sensor="scan")
    with PreviewWriter(tmp_path / "v.mp4", Site(rig), fps=10) as writer:
        writer.frame(0, PreviewFrame({"scan": scan}, [Track(1, 1.0, 0.0), Track(2, 2.0, 1.0, status="coasting")]))
        picture = jpeg(writer.still())
    assert near(picture[:, :600], IDENTITY_COLOURS[0]) + near(picture[:, 600:], IDENTITY_COLOURS[0]) > 50
    assert len(list(decoded(tmp_path / "v.mp4"))) == 1


def test_track_is_drawn_in_both_panels_where_it_is(tmp_path: Path, synthetic: SyntheticRun) -> None:
    blue = IDENTITY_COLOURS[0]
    with PreviewWriter(tmp_path / "v.mp4", Site(synthetic.rig), fps=10) as writer:
        writer.frame(0, PreviewFrame({}))
        empty = jpeg(writer.still(95))
        writer.frame(PERIOD_NS, PreviewFrame({}, [Track(3, -1.5, 1.5)]))
        left = jpeg(writer.still(95))
    assert near(empty, blue) == 0
    camera, floor = left[44:, :596], left[44:612, 596:]
    # x = −1.5 m is left of the middle in the image (camera looks along +y) and on the plan, whose middle is x = 0.
    for panel in (camera, floor):
        columns = np.flatnonzero((np.abs(panel.astype(int) - blue).max(axis=-1) <= 30).any(axis=0))
        assert columns.size > 5
        assert columns.max() < panel.shape[1] / 2


def pinholes(synthetic: SyntheticRun, names: str) -> Rig:
    """Cameras like the fisheye, but without its bend."""
    camera = synthetic.rig.cameras()["camera"]
    lens = PinholeIntrinsics(width=320, height=240, fx=200, fy=200, cx=159.5, cy=119.5)
    pinhole = PinholeSensor(topic="/c/image", room_from_sensor=camera.room_from_sensor, intrinsics=lens)
    sensors = {name: pinhole.model_copy(update={"topic": f"/{name}/image"}) for name in names}
    return Rig(sensors=sensors, area=synthetic.rig.area)


def test_a_pinhole_shows_tracks_and_cuts_windows_at_its_edge(tmp_path: Path, synthetic: SyntheticRun) -> None:
    blue = IDENTITY_COLOURS[0]
    with PreviewWriter(tmp_path / "v.mp4", Site(pinholes(synthetic, "a")), fps=10) as writer:
        seen = []
        for index, x in enumerate((0.0, 1.6, 3.0)):  # in the middle, at the edge (39° off), outside
            writer.frame(index * PERIOD_NS, PreviewFrame({}, [Track(1, x, 2.0)]))
            panel = jpeg(writer.still(95))[44:, :596]
            seen.append(near(panel, blue))
    assert seen[0] > seen[1] > 10
    assert seen[2] == 0


def test_four_cameras_share_the_square(tmp_path: Path, synthetic: SyntheticRun) -> None:
    red = DepthImage("a", 0, np.full((240, 320, 3), (200, 0, 0), np.uint8), np.zeros((240, 320), np.float32))
    green = Image("d", 0, np.full((240, 320, 3), (0, 200, 0), np.uint8))
    with PreviewWriter(tmp_path / "v.mp4", Site(pinholes(synthetic, "abcd")), fps=10) as writer:
        writer.frame(0, PreviewFrame({"a": red, "d": green}))
        panel = jpeg(writer.still(95))[44:, :596]
    size = 298 * 298 * 3 / 4
    assert near(panel[:298, :298], (200, 0, 0)) > 0.95 * size
    assert near(panel[298:, 298:], (0, 200, 0)) > 0.95 * size
    assert near(panel, (200, 0, 0)) + near(panel, (0, 200, 0)) < 2.05 * size


def test_track_behind_the_camera_has_no_window(tmp_path: Path, synthetic: SyntheticRun) -> None:
    with PreviewWriter(tmp_path / "v.mp4", Site(synthetic.rig), fps=10) as writer:
        writer.frame(0, PreviewFrame({}, [Track(1, 0.0, -2.0)]))
        assert near(jpeg(writer.still(95))[44:, :596], IDENTITY_COLOURS[0]) == 0


def test_heads_and_hypotheses_are_drawn_in_the_picture(tmp_path: Path, synthetic: SyntheticRun) -> None:
    head = Track(1, 0.5, 1.5, head_x=0.5, head_y=1.5, head_z=1.6, head_yaw=0.3)
    cloud = Hypotheses(1, np.array([0.5, 1.5, 1.6]) + 0.2 * np.random.default_rng(0).normal(size=(64, 3)))
    coloured = []
    for name, tracks, maps in (("none", [], ()), ("head", [head], ()), ("cloud", [head], (cloud,))):
        with PreviewWriter(tmp_path / f"{name}.mp4", Site(synthetic.rig), fps=10) as writer:
            writer.frame(0, PreviewFrame({}, tracks, maps=maps))
            coloured.append(near(jpeg(writer.still(95))[44:, :596], IDENTITY_COLOURS[0], 60))
    assert coloured[0] < coloured[1] < coloured[2]


def test_windows_that_a_tracker_tells_take_the_place_of_the_torso_window(
    tmp_path: Path, synthetic: SyntheticRun
) -> None:
    tracks = [Track(1, 0.5, 1.5)]
    places = np.array([[0.5, 1.5, 1.0]])
    with_maps = Hypotheses(1, places, lambda _: (100.0, 60.0, 40.0, 80.0))
    stills = {}
    for name, maps in (("plain", ()), ("places", (Hypotheses(1, places),)), ("with_maps", (with_maps,))):
        with PreviewWriter(tmp_path / f"{name}.mp4", Site(synthetic.rig), fps=10) as writer:
            writer.frame(0, PreviewFrame({}, tracks, maps=maps))
            stills[name] = jpeg(writer.still(95))[44:].astype(int)
    camera = synthetic.rig.cameras()["camera"].intrinsics
    scale = 596 / max(camera.width, camera.height)
    top, left = np.array([60.0, 100.0]) * scale + (596 - scale * np.array([camera.height, camera.width])) / 2
    edge = stills["with_maps"][round(top + 40 * scale), round(left) - 1 : round(left) + 2]
    assert np.abs(edge - IDENTITY_COLOURS[0]).sum(axis=-1).min() < 120
    assert near(stills["places"][:, :596], IDENTITY_COLOURS[0], 60) > near(
        stills["with_maps"][:, :596], IDENTITY_COLOURS[0], 60
    )
    assert (np.abs(stills["places"][:, 596:] - stills["plain"][:, 596:]) > 40).any(), "places are dots on the floor"


def test_scan_points_lie_on_the_wall(tmp_path: Path, synthetic: SyntheticRun) -> None:
    with PreviewWriter(tmp_path / "v.mp4", Site(synthetic.rig, synthetic.outline), fps=10) as writer:
        writer.frame(0, PreviewFrame({"waist": synthetic.scans(0)["waist"]}))
        floor = jpeg(writer.still(95))[44:612, 596:]
    amber = (floor[..., 0].astype(int) - floor[..., 2]) > 40  # the page's greys are bluish
    rows = np.flatnonzero(amber.sum(axis=1) > 20)
    scale = min(684 / (6.5 + 0.8), 568 / (4.8 + 0.8))
    wall = 568 / 2 - (4.3 - 2.0) * scale  # the room's middle is y = 2 m
    assert np.abs(rows - wall).min() <= 3


def test_the_floor_plan_says_the_situation_and_the_picture_shows_the_score_map(
    tmp_path: Path, synthetic: SyntheticRun
) -> None:
    score = np.zeros((40, 30))
    score[10:20, 10:20] = 1.0
    found = ScoreMap(1, "camera", (20, 30), score, np.array([[30.0, 45.0]]))
    stills = {}
    for name, situation, maps in (("plain", "apart", ()), ("with_maps", "merged", (found,)), ("other", "merged", ())):
        with PreviewWriter(tmp_path / f"{name}.mp4", Site(synthetic.rig), fps=10) as writer:
            tracks = [Track(1, 0.5, 1.5, situation=situation)]
            newest = {"camera": synthetic.image, **synthetic.scans(0)}
            writer.frame(0, PreviewFrame(newest, tracks, maps=maps))
            stills[name] = jpeg(writer.still())
    side = 640 - 44
    assert (stills["plain"][44:, :side] == stills["other"][44:, :side]).all()  # words stand in the floor plan
    assert (np.abs(stills["plain"][44:, side:].astype(int) - stills["other"][44:, side:]) > 60).any()
    tile = stills["with_maps"][-side // 6 :, : side // 3].astype(int)
    assert (np.abs(tile - stills["other"][-side // 6 :, : side // 3]) > 60).any()
