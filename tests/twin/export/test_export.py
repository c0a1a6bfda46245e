"""Exports, read back by other people's readers."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from rosbags import rosbag2
from rosbags.highlevel import AnyReader
from typer.testing import CliRunner

from trackers.observations import NS_PER_S
from trackers.rig import placed_camera
from twin.cli import app
from twin.export.coco import run_lengths
from twin.export.labels import KEYPOINTS
from twin.export.pictures import open_recorded
from twin.recording.bags.bag import open_bag
from twin.recording.reader import Recording
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.tables import read_tracks, read_truth
from twin.run.live import run_scenario
from twin.scenario import load_scenario

_SCENARIO = """
name: short
room: lab
duration_s: 1.5
truth: {boxes_hz: 5}
people:
  ann: {start: [-0.4, 1.2], script: {kind: walk, waypoints: [[0.8, 1.6]]}}
  bob: {start: [0.6, 1.0], script: {kind: stand, for_s: 60}}
sensors:
  waist: {kind: laser, role: waist, rate_hz: 10, mount: {xyz: [0, 0, 0.95], yaw_deg: 90}}
  low: {kind: laser, role: knee, rate_hz: 7, mount: {xyz: [0, 0, 0.3], yaw_deg: 90}}
  fish: {kind: fisheye, rate_hz: 5, size: [120, 120], mount: {xyz: [0, 0, 1.05], yaw_deg: 90}, lens: equidistant_185}
  depth: {kind: stereo, rate_hz: 5, size: [96, 72], vertical_field_of_view_deg: 59, baseline_m: 0.12, mode: ideal,
          mount: {xyz: [0.9, -0.05, 2.0], yaw_deg: 100, pitch_deg: 25}}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run with two scanners and two cameras, tracked by the plain tracker."""
    folder = tmp_path_factory.mktemp("export")
    (folder / "short.yaml").write_text(_SCENARIO)
    run_scenario(load_scenario(str(folder / "short.yaml")), trackers=["sort"], out=folder / "run", video=False)
    return folder / "run"


def _export(source: Path, kind: str, out: Path, *options: str) -> Path:
    result = CliRunner().invoke(app, ["export", str(source), "--format", kind, "--out", str(out), *options])
    assert result.exit_code == 0, (result.output, result.exception)
    return out


def test_mot_is_read_by_motmetrics(run: Path, tmp_path: Path) -> None:
    motmetrics = pytest.importorskip("motmetrics")
    out = _export(run, "mot", tmp_path / "mot")
    sequences = (out / "gt/seqmaps/roomtwin-all.txt").read_text().split()[1:]
    assert sequences == ["run-ground", "run-fish", "run-depth"] or sequences == ["run-ground", "run-depth", "run-fish"]
    boxes = np.genfromtxt(run / "truth_boxes.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    for camera in ("fish", "depth"):
        folder = out / "gt/roomtwin-all" / f"run-{camera}"
        read = motmetrics.io.loadtxt(folder / "gt/gt.txt", fmt="mot16").reset_index()
        own = boxes[(boxes["camera"] == camera) & (boxes["id"] > 0)]
        assert len(read) == len(own) > 0
        # motmetrics takes the 1 of MOTChallenge's pixels off again
        assert read[["X", "Y", "Width", "Height"]].to_numpy() == pytest.approx(
            np.stack([own[name] for name in ("left", "top", "width", "height")], axis=-1)
        )
        stamps = np.genfromtxt(folder / "frames.csv", delimiter=",", skip_header=1)
        assert set(stamps[:, 1]) == set(boxes[boxes["camera"] == camera]["t"])
        info = dict(line.split("=") for line in (folder / "seqinfo.ini").read_text().splitlines()[1:])
        assert int(info["seqLength"]) == len(list((folder / "img1").iterdir())) == len(stamps)
        assert float(info["frameRate"]) == pytest.approx(5)
        tracks = motmetrics.io.loadtxt(out / f"trackers/roomtwin-all/sort/data/run-{camera}.txt", fmt="mot16")
        assert len(tracks) > 0
        assert (tracks[["Width", "Height"]].to_numpy() > 0).all()
    ground = np.loadtxt(out / "gt/roomtwin-all/run-ground/gt/gt.txt", delimiter=",")
    truth = read_truth(run / "truth.csv")
    own = np.isin(truth.stamps_ns, np.unique(Recording(run / "recording.mcap").stamps_ns["/waist/scan"]))
    assert ground[:, 7:9] == pytest.approx(np.stack([truth.x[own], truth.y[own]], axis=-1), abs=1e-4)


def _accumulated(motmetrics, truth: np.ndarray, tracks: np.ndarray, distances) -> dict[str, float]:
    """Metrics by motmetrics of rows frame, id, ...; distances: of the rows of one frame, NaN: no pair."""
    accumulator = motmetrics.MOTAccumulator()
    for frame in np.union1d(truth[:, 0], tracks[:, 0]):
        people, reported = truth[truth[:, 0] == frame], tracks[tracks[:, 0] == frame]
        accumulator.update(people[:, 1], reported[:, 1], distances(people, reported), frameid=int(frame))
    names = ["mota", "idf1", "num_misses", "num_false_positives", "num_switches"]
    return motmetrics.metrics.create().compute(accumulator, metrics=names).iloc[0].to_dict()


def _gap_m(people: np.ndarray, reported: np.ndarray) -> np.ndarray:
    """Distances on the ground within the gate of 0.5 m, else NaN."""
    gap = np.linalg.norm(people[:, None, 7:9] - reported[None, :, 7:9], axis=2)
    return np.where(gap <= 0.5, gap, np.nan)


def test_the_ground_is_judged_alike_by_motmetrics_and_by_ourselves(run: Path, tmp_path: Path) -> None:
    """From the exported text and from the tables of the run, within the gate of 0.5 m."""
    motmetrics = pytest.importorskip("motmetrics")
    out = _export(run, "mot", tmp_path / "mot")
    files = [
        out / "gt/roomtwin-all/run-ground/gt/gt.txt",
        out / "trackers/roomtwin-all/sort/data/run-ground.txt",
    ]
    truth, tracks = (np.loadtxt(each, delimiter=",", ndmin=2) for each in files)
    theirs = _accumulated(motmetrics, truth, tracks, _gap_m)
    own = json.loads((run / "metrics.json").read_text())["trackers"]["sort"]
    read = CliRunner().invoke(app, ["evaluate", *map(str, files), "--format", "mot"])
    assert read.exit_code == 0, read.output
    stamps_s = read_tracks(run / "tracks/sort.csv").frame_stamps_ns / NS_PER_S
    assert f"{stamps_s.size} frames judged, {stamps_s[0]:g} to {stamps_s[-1]:g} s" in read.stderr
    for ours in (own, json.loads(read.stdout)):
        assert theirs["mota"] == pytest.approx(ours["mota"]) and theirs["idf1"] == pytest.approx(ours["idf1"])
        assert theirs["num_misses"] == ours["misses"] and theirs["num_switches"] == ours["id_switches"]


def test_the_ground_has_each_id_once_a_frame_where_trackers_report_more_often_than_its_frames(tmp_path: Path) -> None:
    """Two scanners of unlike rates: the main sensor's stamps are frames, and those of the other are not."""
    (tmp_path / "unlike.yaml").write_text(_SCENARIO)
    changes = ["sensors.waist.rate_hz=9.3", "sensors.low.rate_hz=12.1", "sensors.fish=null", "sensors.depth=null"]
    changes.append("truth=null")
    scenario = load_scenario(str(tmp_path / "unlike.yaml"), changes)
    run = run_scenario(scenario, trackers=["sort"], out=tmp_path / "run", video=False, images=False)
    assert run.metrics is not None
    out = _export(tmp_path / "run", "mot", tmp_path / "mot")
    ground = out / "gt/roomtwin-all/run-ground"
    files = [ground / "gt/gt.txt", out / "trackers/roomtwin-all/sort/data/run-ground.txt"]
    n_frame = len((ground / "frames.csv").read_text().splitlines()) - 1
    assert n_frame < len(read_tracks(tmp_path / "run/tracks/sort.csv").frame_stamps_ns)
    for path in files:
        rows = np.loadtxt(path, delimiter=",", ndmin=2)[:, :2]
        assert len(rows) > 1 and len(np.unique(rows, axis=0)) == len(rows)
    read = CliRunner().invoke(app, ["evaluate", *map(str, files), "--format", "mot"])
    assert json.loads(read.stdout)["false_positives"] <= run.metrics["trackers"]["sort"]["false_positives"]


def test_boxes_are_judged_alike_by_trackeval_and_by_motmetrics(run: Path, tmp_path: Path) -> None:
    reason = "trackeval is not installed: it replaces the headless OpenCV, so it has an environment of its own"
    trackeval, motmetrics = pytest.importorskip("trackeval", reason=reason), pytest.importorskip("motmetrics")
    out, sequence = _export(run, "mot", tmp_path / "mot"), "run-fish"
    chosen = {
        "GT_FOLDER": str(out / "gt"), "TRACKERS_FOLDER": str(out / "trackers"), "BENCHMARK": "roomtwin", "SPLIT_TO_EVAL": "all",
        "SEQ_INFO": {sequence: None}, "OUTPUT_FOLDER": str(tmp_path), "PRINT_CONFIG": False, "DO_PREPROC": False,
    }  # fmt: skip
    quiet = {"PRINT_RESULTS": False, "PRINT_CONFIG": False, "TIME_PROGRESS": False, "PLOT_CURVES": False}
    read = trackeval.datasets.MotChallenge2DBox(
        trackeval.datasets.MotChallenge2DBox.get_default_dataset_config() | chosen
    )
    evaluator = trackeval.Evaluator(trackeval.Evaluator.get_default_eval_config() | quiet)
    found, _ = evaluator.evaluate([read], [trackeval.metrics.CLEAR(), trackeval.metrics.Identity()])
    of_trackeval = found["MotChallenge2DBox"]["sort"][sequence]["pedestrian"]
    truth = np.loadtxt(out / "gt/roomtwin-all" / sequence / "gt/gt.txt", delimiter=",", ndmin=2)
    tracks = np.loadtxt(out / "trackers/roomtwin-all/sort/data" / f"{sequence}.txt", delimiter=",", ndmin=2)

    def lack_of_overlap(people: np.ndarray, reported: np.ndarray) -> np.ndarray:
        one, other = people[:, None, 2:6], reported[None, :, 2:6]
        low = np.maximum(one[..., :2], other[..., :2])
        high = np.minimum(one[..., :2] + one[..., 2:], other[..., :2] + other[..., 2:])
        shared = np.prod(np.maximum(high - low, 0), axis=-1)
        both = np.prod(one[..., 2:], axis=-1) + np.prod(other[..., 2:], axis=-1) - shared
        return np.where(shared / both >= 0.5, 1 - shared / both, np.nan)

    theirs = _accumulated(motmetrics, truth[truth[:, 6] > 0], tracks, lack_of_overlap)
    clear = of_trackeval["CLEAR"]
    assert clear["CLR_TP"] + clear["CLR_FN"] == np.count_nonzero(truth[:, 6] > 0) > 0
    assert (theirs["num_misses"], theirs["num_false_positives"]) == (clear["CLR_FN"], clear["CLR_FP"])
    assert theirs["mota"] == pytest.approx(clear["MOTA"])
    assert theirs["idf1"] == pytest.approx(of_trackeval["Identity"]["IDF1"])


def test_labels_of_any_picture_are_those_of_the_run(run: Path, tmp_path: Path) -> None:
    held = _export(run, "mot", tmp_path / "held")
    again = _export(run, "mot", tmp_path / "again", "--labels-hz", "5")
    for camera in ("fish", "depth"):
        name = f"gt/roomtwin-all/run-{camera}/gt/gt.txt"
        assert (held / name).read_text() == (again / name).read_text()


def test_coco_is_read_by_pycocotools(run: Path, tmp_path: Path) -> None:
    coco_module = pytest.importorskip("pycocotools.coco", reason="pycocotools is not installed")
    out = _export(run, "coco", tmp_path / "coco")
    coco = coco_module.COCO(str(out / "annotations.json"))
    assert coco.cats[1]["keypoints"] == list(KEYPOINTS)
    assert len(coco.anns) > 0
    for annotation in coco.anns.values():
        image = coco.imgs[annotation["image_id"]]
        mask = coco.annToMask(annotation).astype(bool)
        assert mask.shape == (image["height"], image["width"])
        assert mask.sum() == annotation["area"]
        rows, columns = np.nonzero(mask)
        left, top, width, height = annotation["bbox"]
        assert (left, top) == (columns.min(), rows.min())
        assert (left + width, top + height) == (columns.max() + 1, rows.max() + 1)
        points = np.array(annotation["keypoints"]).reshape(-1, 3)
        shown = points[points[:, 2] == 2]
        assert (
            (shown[:, :2] >= (left - 1.5, top - 1.5)) & (shown[:, :2] <= (left + width + 1.5, top + height + 1.5))
        ).all()
        assert annotation["num_keypoints"] == (points[:, 2] > 0).sum()
    for image in coco.imgs.values():
        picture = cv2.imread(str(out / "images" / image["file_name"]))
        assert picture.shape[:2] == (image["height"], image["width"])


def test_coco_of_the_bag_alone_has_its_boxes(run: Path, tmp_path: Path) -> None:
    whole = json.loads((_export(run, "coco", tmp_path / "whole") / "annotations.json").read_text())
    held = json.loads((_export(run, "coco", tmp_path / "held", "--labels", "bag") / "annotations.json").read_text())
    assert [each["bbox"] for each in held["annotations"]] == [each["bbox"] for each in whole["annotations"]]
    assert held["images"] == whole["images"]
    assert held["categories"][0]["keypoints"] == ["head", "pelvis"]


def test_run_lengths_start_with_a_run_of_0() -> None:
    mask = np.array([[1, 0], [1, 0], [0, 1]], dtype=bool)
    assert run_lengths(mask) == {"size": [3, 2], "counts": [0, 2, 3, 1]}
    assert run_lengths(~mask) == {"size": [3, 2], "counts": [2, 3, 1]}


def test_calibrations_are_read_by_opencv_and_ros(run: Path, tmp_path: Path) -> None:
    out = _export(run, "images", tmp_path / "images") / "run"
    recording = Recording(run / "recording.mcap")
    points = np.array([[0.2, 1.5, 0.4], [-0.3, 1.8, 1.2], [0.5, 1.2, 0.9]])
    for name, camera in recording.rig.cameras().items():
        storage = cv2.FileStorage(str(out / name / "opencv.yaml"), cv2.FILE_STORAGE_READ)
        matrix, bend = storage.getNode("camera_matrix").mat(), storage.getNode("distortion_coefficients").mat()
        pose = storage.getNode("rvec").mat(), storage.getNode("tvec").mat()
        is_fisheye = storage.getNode("camera_model").string() == "fisheye"
        if is_fisheye:
            pixels, _ = cv2.fisheye.projectPoints(points[None], *pose, matrix, bend)
        else:
            pixels, _ = cv2.projectPoints(points, *pose, matrix, bend)
        ours, shown = placed_camera(camera).project(points)
        assert shown.any()
        assert pixels.reshape(-1, 2)[shown] == pytest.approx(ours[shown], abs=1e-6)
        info = yaml.safe_load((out / name / "camera_info.yaml").read_text())
        assert info["distortion_model"] == ("equidistant" if is_fisheye else "plumb_bob")
        assert np.array(info["camera_matrix"]["data"]) == pytest.approx(camera.intrinsics.matrix.ravel())
        files = {row.split(",")[2] for row in (out / name / "stamps.csv").read_text().splitlines()[1:]}
        found = {path.relative_to(out / name).as_posix() for path in (out / name).rglob("*.[jp][pn]g")}
        assert files == found
        assert len(files) == recording.counts[name] * (1 if is_fisheye else 2)


def test_kitti_projects_points_and_people_into_the_picture(run: Path, tmp_path: Path) -> None:
    root = _export(run, "kitti", tmp_path / "kitti") / "training"
    rows = {
        line.split()[0].strip(":"): np.array(line.split()[1:], dtype=float) for line in (root / "calib/0000.txt").open()
    }
    level_from_velodyne, velodyne_from_room = (rows[name].reshape(3, 4) for name in ("Tr_velo_cam", "Tr_imu_velo"))
    rig = Recording(run / "recording.mcap").rig
    room = np.array([0.3, 1.4, 0.8, 1.0])
    level = level_from_velodyne @ [*(velodyne_from_room @ room), 1.0]
    pixel = rows["P2"].reshape(3, 4) @ [*level, 1.0]
    assert pixel[:2] / pixel[2] == pytest.approx(placed_camera(rig.cameras()["depth"]).project(room[None, :3])[0][0])
    truth = read_truth(run / "truth.csv")
    stamps = np.genfromtxt(root / "frames/0000.csv", delimiter=",", skip_header=1)
    for line in (root / "label_02/0000.txt").read_text().splitlines():
        frame, id_, kind, truncated, occluded, *numbers = line.split()
        alpha, left, top, right, bottom, height, width, length, x, y, z, rotation = map(float, numbers)
        assert kind == "Pedestrian"
        assert truncated in "012"
        assert occluded in "0123"
        at = (truth.stamps_ns == round(stamps[int(frame), 1] * 1e9)) & (truth.id == int(id_))
        place = level_from_velodyne @ [*(velodyne_from_room @ [truth.x[at][0], truth.y[at][0], 0.0, 1.0]), 1.0]
        assert (x, y, z) == pytest.approx(
            place, abs=0.15
        )  # the box's middle: head and pelvis are not one over the other
        assert 1.4 < height < 2.0
        assert 0 <= left < right <= 95
        assert 0 <= top < bottom <= 71
        assert abs(alpha) <= np.pi
    points = np.fromfile(root / "velodyne/0000/000003.bin", dtype=np.float32).reshape(-1, 4)
    assert len(points) > 300
    assert np.abs(np.unique(points[:, 2].round(3))).max() == pytest.approx(0.65, abs=1e-3)  # both scanners' planes


def test_foxglove_copy_plays_and_has_points(run: Path, tmp_path: Path) -> None:
    out = _export(run, "foxglove", tmp_path / "foxglove")
    with AnyReader([out / "run.mcap"]) as reader:
        topics = reader.topics
        assert {"/waist/points", "/low/points", "/room/markers", "/tf_static", "/tracks/sort/markers"} <= set(topics)
        clouds = [c for c in reader.connections if c.topic == "/waist/points"]
        scans = [c for c in reader.connections if c.topic == "/waist/scan"]
        assert clouds[0].msgcount == scans[0].msgcount
        _, _, data = next(reader.messages(clouds))
        cloud = reader.deserialize(data, clouds[0].msgtype)
        _, _, data = next(reader.messages(scans))
        scan = reader.deserialize(data, scans[0].msgtype)
        points = np.frombuffer(cloud.data.tobytes(), dtype="<f4").reshape(-1, 3)
        hits = scan.ranges[(scan.ranges >= scan.range_min) & (scan.ranges < scan.range_max)]
        assert np.hypot(points[:, 0], points[:, 1]) == pytest.approx(hits, rel=1e-5)
        assert cloud.header.frame_id == "waist"
    layout = json.loads((out / "run.layout.json").read_text())
    shown = layout["configById"]["3D!room"]["topics"]
    assert set(shown) <= set(topics)


def test_rerun_says_what_to_install_or_writes_a_file(run: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["export", str(run), "--format", "rerun", "--out", str(tmp_path / "rerun")])
    try:
        import rerun  # noqa: F401
    except ImportError:
        assert "rerun-sdk is not installed" in str(result.exception)
        assert list(tmp_path.iterdir()) == []
    else:
        read = [sys.executable, "-m", "rerun", "rrd"]  # the viewer's own reader
        subprocess.run([*read, "verify", str(tmp_path / "rerun/run.rrd")], check=True, capture_output=True)
        shown = subprocess.run(
            [*read, "print", str(tmp_path / "rerun/run.rrd")], check=True, capture_output=True, text=True
        )
        for entity in ("walls", "truth", "tracks/sort", *(f"sensors/{name}" for name in ("waist", "low", "depth"))):
            assert f"/room/{entity}" in shown.stdout, entity


def test_folder_of_somebody_else_is_refused_and_nothing_half_written(run: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes.txt").write_text("kept")
    result = CliRunner().invoke(app, ["export", str(run), "--format", "images", "--out", str(tmp_path / "mine")])
    assert "was not made by" in str(result.exception)
    assert [path.name for path in tmp_path.rglob("*")] == ["mine", "notes.txt"]


def test_a_sequence_of_any_folder_has_one_printable_name(run: Path, tmp_path: Path) -> None:
    """TrackEval takes the name in seqinfo.ini for that of the folder."""
    odd = shutil.copytree(run, tmp_path / "copied\nlatin-1 \udce9")
    out = _export(odd, "mot", tmp_path / "mot")
    for info in out.rglob("seqinfo.ini"):
        assert info.read_text("utf-8").splitlines()[1] == f"name={info.parent.name}" and info.parent.name.isprintable()
    assert [*out.rglob("seqinfo.ini")]


def test_bag_without_truth_says_what_is_left_out(run: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare.mcap"
    _without_truth(run / "recording.mcap", bare)
    rig = tmp_path / "rig.yaml"
    rig.write_text(Recording(run / "recording.mcap").rig.dump_yaml())
    out = _export(bare, "mot", tmp_path / "mot", "--rig", str(rig))
    assert not (out / "gt/roomtwin-all/bare-fish/gt/gt.txt").exists()
    assert len(list((out / "gt/roomtwin-all/bare-fish/img1").iterdir())) == 8
    told = CliRunner().invoke(
        app, ["export", str(bare), "--rig", str(rig), "--format", "kitti", "--out", str(tmp_path / "kitti")]
    )
    assert "holds no truth: label_02 is left out" in told.output
    result = CliRunner().invoke(
        app, ["export", str(bare), "--rig", str(rig), "--format", "coco", "--out", str(tmp_path / "c")]
    )
    assert "no recording has a camera and truth" in str(result.exception)


@pytest.mark.parametrize("kind", ["mot", "kitti", "images", "foxglove"])
def test_what_a_bag_has_lost_is_told(run: Path, kind: str, tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text(Recording(run / "recording.mcap").rig.dump_yaml())
    _without_truth(run / "recording.mcap", tmp_path / "bare.mcap")
    with open_bag(tmp_path / "bare.mcap") as bag, rosbag2.Writer(tmp_path / "lossy", version=9) as writer:
        kept = {name: topic.msgtype for name, topic in bag.topics.items()}
        of = {name: writer.add_connection(name, kind, typestore=TYPESTORE) for name, kind in kept.items()}
        for number, (name, log_ns, message) in enumerate(bag.messages(list(kept))):
            if hasattr(message, "ranges") and number % 3:
                message.header.stamp.sec = message.header.stamp.nanosec = 0
            writer.write(of[name], log_ns, TYPESTORE.serialize_cdr(message, kept[name]))
    arguments = ["--rig", str(rig), "--format", kind, "--out", str(tmp_path / kind)]
    told = CliRunner().invoke(app, ["export", str(tmp_path / "lossy"), *arguments])
    assert told.exit_code == 0, told.output
    assert told.stderr.count("have no stamp of their own") == 2  # of each scanner
    if kind == "foxglove":  # a layout names what the copy holds, of a bag without room and truth too
        layout = json.loads((tmp_path / kind / "lossy.layout.json").read_text())
        with open_bag(tmp_path / kind / "lossy.mcap") as copy:
            assert set(layout["configById"]["3D!room"]["topics"]) <= set(copy.topics)
    whole = CliRunner().invoke(app, ["export", str(run), "--format", kind, "--out", str(tmp_path / "whole")])
    assert whole.exit_code == 0 and "messages" not in whole.stderr


@pytest.fixture(scope="module")
def own(run: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """The run's bag without its truth, its rig, and a table of truth at every other stamp, by name."""
    folder = tmp_path_factory.mktemp("own")
    _without_truth(run / "recording.mcap", folder / "bare.mcap")
    (folder / "rig.yaml").write_text(Recording(run / "recording.mcap").rig.dump_yaml())
    truth = read_truth(run / "truth.csv")
    kept = np.isin(truth.stamps_ns, truth.frame_stamps_ns[:-3:2])
    columns = [each[kept].tolist() for each in (truth.stamps_ns, truth.id, truth.x, truth.y, truth.head_z)]
    rows = (f"{ns / 1e9:.9f},{'_ab'[id_]},{x},{y},{z}" for ns, id_, x, y, z in zip(*columns, strict=True))
    (folder / "mine.csv").write_text("\n".join(["t,id,x,y,head_z", *rows]))
    return folder / "bare.mcap", folder / "rig.yaml", folder / "mine.csv"


def _known(run: Path, table: Path, sensor: str) -> np.ndarray:
    """Rows stamp [ns], id, x, y of the run's truth at the stamps of a sensor, as far as the table goes and half a period on."""
    truth, until_ns = read_truth(run / "truth.csv"), read_truth(table).frame_stamps_ns[-1]
    rows = np.column_stack([truth.stamps_ns, truth.id, truth.x, truth.y])
    at = Recording(run / "recording.mcap").stamps_of(sensor)
    return rows[(rows[:, 0] <= until_ns + np.median(np.diff(at)) / 2) & np.isin(rows[:, 0], at)]


def test_own_truth_reaches_mot_as_that_of_a_bag_does(run: Path, own: tuple[Path, Path, Path], tmp_path: Path) -> None:
    """Frames are those that the table covers; places between its rows are interpolated; motmetrics judges as we do."""
    motmetrics = pytest.importorskip("motmetrics")
    bag, rig, mine = map(str, own)
    tracked = CliRunner().invoke(
        app,
        ["track", bag, "--rig", rig, "--truth", mine, "--tracker", "sort", "--no-video", "--out", str(tmp_path / "tracked"),
         "--bag", str(tmp_path / "copy.mcap")],
    )  # fmt: skip
    assert tracked.exit_code == 0, tracked.output
    out = _export(tmp_path / "tracked", "mot", tmp_path / "mot", "--rig", rig, "--truth", mine)
    ground = out / "gt/roomtwin-all/tracked-ground"
    truth = np.loadtxt(ground / "gt/gt.txt", delimiter=",")
    expected = _known(run, own[2], "waist")
    assert truth[:, 7:9] == pytest.approx(expected[:, 2:], abs=0.01)
    stamps = np.genfromtxt(ground / "frames.csv", delimiter=",", skip_header=1)
    assert stamps[:, 1] == pytest.approx(np.unique(expected[:, 0]) / 1e9)
    tracks = np.loadtxt(out / "trackers/roomtwin-all/sort/data/tracked-ground.txt", delimiter=",")
    theirs = _accumulated(motmetrics, truth, tracks, _gap_m)
    ours = json.loads((tmp_path / "tracked/metrics.json").read_text())["trackers"]["sort"]
    assert theirs["mota"] == pytest.approx(ours["mota"]) and theirs["num_misses"] == ours["misses"]
    for camera in ("fish", "depth"):
        read = motmetrics.io.loadtxt(out / f"gt/roomtwin-all/tracked-{camera}/gt/gt.txt", fmt="mot16").reset_index()
        of_pixels = motmetrics.io.loadtxt(
            _export(run, "mot", tmp_path / f"whole-{camera}", "--labels-hz", "5")
            / f"gt/roomtwin-all/run-{camera}/gt/gt.txt",
            fmt="mot16",
        ).reset_index()
        both = read.merge(of_pixels, on=["FrameId", "Id"])
        assert len(both) > 5
        middle = (both["X_x"] + both["Width_x"] / 2) - (both["X_y"] + both["Width_y"] / 2)
        assert middle.abs().median() < 5  # px: an upright box stands where the person's pixels are
    copy = Recording(tmp_path / "copy.mcap", rig)
    places = {frame.stamp_ns: frame for frame in copy.truth()}
    for stamp_ns, id_, x, y in expected:
        person = next(each for each in places[int(stamp_ns)].people if each.id == id_)
        assert (person.x, person.y) == pytest.approx((x, y), abs=0.01)


def test_own_truth_reaches_coco_kitti_and_foxglove(run: Path, own: tuple[Path, Path, Path], tmp_path: Path) -> None:
    coco_module = pytest.importorskip("pycocotools.coco", reason="pycocotools is not installed")
    bag, rig, mine = map(str, own)
    given = "--rig", rig, "--truth", mine
    coco = coco_module.COCO(str(_export(own[0], "coco", tmp_path / "coco", *given) / "annotations.json"))
    assert {image["camera"] for image in coco.imgs.values()} == {"fish", "depth"}
    assert max(image["t"] for image in coco.imgs.values()) <= 1.2 and len(coco.anns) > 5
    for annotation in coco.anns.values():
        image, (left, top, width, height) = coco.imgs[annotation["image_id"]], annotation["bbox"]
        assert 0 <= left < left + width <= image["width"] and 0 <= top < top + height <= image["height"]
        assert annotation["area"] == width * height and annotation["visibility"] is None
    root = _export(own[0], "kitti", tmp_path / "kitti", *given) / "training"
    labels = [line.split() for line in (root / "label_02/0000.txt").read_text().splitlines()]
    assert len(labels) > 5
    for _, _, kind, _, occluded, *numbers in labels:
        assert kind == "Pedestrian" and occluded == "3" and np.isfinite(np.array(numbers, dtype=float)).all()
    source = _export(own[0], "foxglove", tmp_path / "foxglove", *given) / "bare.mcap"
    with open_bag(source) as found:
        assert {"/truth/people", "/truth/markers"} <= set(found.topics)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--format", "images"], "has no effect on --format images"),
        (["--format", "coco", "--labels", "bag"], "one of the two is expected"),
    ],
)
def test_own_truth_where_it_has_no_effect_is_refused(
    own: tuple[Path, Path, Path], options: list[str], said: str, tmp_path: Path
) -> None:
    bag, rig, mine = map(str, own)
    result = CliRunner().invoke(
        app, ["export", bag, "--rig", rig, "--truth", mine, "--out", str(tmp_path / "x"), *options]
    )
    assert said in str(result.exception)


def _without_truth(source: Path, target: Path) -> None:
    from twin.recording.bags.bag import open_bag
    from twin.recording.bags.bag_files import McapFile

    with open_bag(source) as original, McapFile(target) as bag:
        kept = [
            each
            for each in original.connections
            if not each.topic.startswith(("/truth", "/rig", "/scenario", "/tracks"))
        ]
        copies = {each.id: bag.connect_as(each) for each in kept}
        for connection, log_time_ns, data in original.raw_messages(kept):
            bag.write_on(copies[connection.id], log_time_ns, data)


def test_tracks_of_a_bag_have_the_stamps_that_they_state_however_late_they_were_logged(
    run: Path, tmp_path: Path
) -> None:
    source = _export(run, "foxglove", tmp_path / "foxglove") / "run.mcap"
    with open_bag(source) as bag, rosbag2.Writer(tmp_path / "late", version=9) as writer:
        kept = {name: topic.msgtype for name, topic in bag.topics.items() if not name.startswith(("/truth", "/camera"))}
        of = {name: writer.add_connection(name, kind, typestore=TYPESTORE) for name, kind in kept.items()}
        for name, log_ns, message in bag.messages(list(kept)):
            late_ns = log_ns + 30_000_000 * name.startswith("/tracks")
            writer.write(of[name], late_ns, TYPESTORE.serialize_cdr(message, kept[name]))
    tracks, late = open_recorded(source).tracks["sort"], open_recorded(tmp_path / "late").tracks["sort"]
    assert len(tracks.t) and late.stamps_ns.tolist() == tracks.stamps_ns.tolist()


def test_a_folder_of_suite_results_is_exported_with_the_tracks_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ROOMTWIN_CACHE", str(tmp_path / "cache"))
    Path("short.yaml").write_text(_SCENARIO)
    Path("suites").mkdir()
    Path("suites/mine.yaml").write_text(
        "name: smoke\nseeds: [1000]\ntrackers: [sort, 'trackers.sort:Sort']\nscenarios: "
        "[{scenario: ../short.yaml, set: {sensors.depth: null, sensors.low: null}}]\n"
    )
    done = CliRunner().invoke(
        app, ["suite", "run", "suites/mine.yaml", "--jobs", "1", "--out", "results", "--allow-plugins"]
    )
    assert done.exit_code == 0, (done.output, done.exception)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    (table,) = Path("../results/cases").glob("*/tracks/sort.csv")

    out = _export(Path("../results"), "mot", tmp_path / "mot")

    (exported,) = out.glob("trackers/*/sort/data/*-ground.txt")
    assert len(np.loadtxt(exported, delimiter=",")) == len(read_tracks(table).x) > 0
    assert list(out.glob("trackers/*/trackers.sort-Sort/data/*-ground.txt"))  # a class, which the export does not run
    edited = Path("../suites/mine.yaml").read_text().replace("[1000]", "[1001]")
    Path("../suites/mine.yaml").write_text(edited)
    told = CliRunner().invoke(app, ["export", "../results", "--format", "mot", "--out", "other"])
    assert "holds the results of other cases than" in str(told.exception)


def test_a_suite_of_bags_and_a_tracked_bag_are_exported_from_anywhere(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    _without_truth(run / "recording.mcap", Path("bare.mcap"))
    Path("rig.yaml").write_text(Recording(run / "recording.mcap").rig.dump_yaml())
    Path("mine.csv").write_text((run / "truth.csv").read_text())
    named = "{recording: bare.mcap, rig: rig.yaml, truth: mine.csv}"
    Path("mine.yaml").write_text(f"name: mine\ntrackers: [sort]\nreports: false\nrecordings: [{named}]\n")
    tracked = ["track", "bare.mcap", "--rig", "rig.yaml", "--tracker", "sort", "--no-video", "--out", "tracked"]
    for command in (["suite", "run", "mine.yaml", "--jobs", "1", "--out", "results"], tracked):
        done = CliRunner().invoke(app, command)
        assert done.exit_code == 0, (done.output, done.exception)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    for source, options in (("../results", []), ("../tracked", ["--truth", "../mine.csv"])):
        out = _export(Path(source), "mot", Path(Path(source).name), *options)
        (truth,), (tracks,) = out.glob("gt/*/*-ground/gt/gt.txt"), out.glob("trackers/*/sort/data/*-ground.txt")
        assert len(np.loadtxt(truth, delimiter=",")) and len(np.loadtxt(tracks, delimiter=","))
        Path("../rig.yaml").unlink(missing_ok=True)  # the tracked folder keeps the rig with which it was made
