"""Recordings to export, and their pictures as they are stored, the bytes of each JPEG or PNG, with cameras' calibrations.

A recording is a bag with the people's names and the tracks of its run, with its truth on demand. A picture's number counts
those of its camera from 1 in the order in which they arrived, in every format. Bytes are copied where the message holds a
JPEG or PNG; raw and other pictures become PNG. `export_images` writes a folder per camera.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TextIO

import cv2
import numpy as np

from trackers.arrays import Nanoseconds
from trackers.cameras import FisheyeIntrinsics, PinholeIntrinsics
from trackers.configuration import validate
from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.rig import CameraSensor, Rig
from trackers.user_input.plain_data import dump_yaml, parse_json
from trackers.user_input.text_file import AnyPath, as_path, read_text
from twin.evaluate.report_clock import truth_at
from twin.messages import OnWarning, printable_name
from twin.recording.bags.bag import Copies, decoded, open_bag
from twin.recording.reader import Recording
from twin.recording.ros import topics
from twin.recording.ros.colour_images import check_picture, decode_compressed, decode_raw
from twin.recording.ros.depth_images import PNG_FORMAT, decode_depth, encode_png
from twin.recording.ros.ros_messages import COMPRESSED_IMAGE, STRING
from twin.recording.tables import STATUSES, TRACK_COLUMNS, TrackTable, TruthTable, read_tracks, seconds_cell
from twin.recording.track_topics import tracker_names
from twin.recording.truth_tables import ABOUT, read_own_truth, truth_frames
from twin.run.inputs import scenario_of
from twin.scenario import Scenario
from twin.truth.truth_types import TruthFrame

RECORDING = "recording.mcap"
TRACK_NUMBERS = tuple(name for name in TRACK_COLUMNS[2:] if name != "status")
"""Numeric columns of a table of tracks, after t and id."""
_LONGEST_S = 1e9


@dataclass(frozen=True, eq=False)
class Recorded:
    """Recording, the name of its exported sequence, the tracks of its run by tracker, and the user's truth, if any.

    rig: that was given; own_truth: taken instead of the bag's, where it is known at the sensors' stamps; title: for warnings.
    """

    name: str
    recording: Recording
    tracks: Mapping[str, TrackTable] = field(default_factory=dict)
    rig: Rig | AnyPath | None = None
    own_truth: TruthTable | None = None
    on_warning: OnWarning = lambda warning: None
    title: str = ""

    @cached_property
    def scenario(self) -> Scenario | None:
        """Scenario in a twin's bag; None in a robot's."""
        return scenario_of(self.recording)

    @property
    def has_truth(self) -> bool:
        """True where people's positions are known."""
        return self.own_truth is not None or topics.TRUTH_PEOPLE in self.recording.topics

    def truth(self) -> Iterator[TruthFrame]:
        """Yield the truth in order of time; nothing where there is none."""
        return self.recording.truth() if self.own_truth is None else truth_frames(self.own_truth)

    @property
    def person_names(self) -> dict[int, str]:
        """People's names by id, from the user's truth or the scenario; empty where neither has them."""
        if self.own_truth is not None:
            return dict(self.own_truth.labels)
        return {} if self.scenario is None else dict(enumerate(self.scenario.people, start=1))


def open_recorded(
    path: AnyPath,
    rig: AnyPath | None = None,
    on_warning: OnWarning = lambda warning: None,
    *,
    name: str | None = None,
    tables: Mapping[str, Path] | None = None,
    truth: Path | None = None,
) -> Recorded:
    """Open a bag, or the folder of a run or of `twin track`; its tracks are those of `tables` by tracker, else of the folder
    or the bag. Its rig is `rig`, else the one with which `twin track` made the folder.

    `name`: of its sequence; default: that of the run or bag. `truth`: table to take instead of the bag's. Raises InputError.
    """
    path = as_path(path, "recording")
    is_run = path.is_dir() and ((path / RECORDING).is_file() or (path / ABOUT).is_file())
    of_run = rig if rig is not None or not is_run else _rig_of(path)
    recording = Recording(_bag_of(path) if is_run else path, of_run)
    own = None if truth is None else _own_truth(truth, recording, on_warning)
    if tables is None and is_run:
        tables = {each.stem: each for each in sorted((path / "tracks").glob("*.csv"))}
    tracks = _tracks_in(recording) if tables is None else {each: read_tracks(file) for each, file in tables.items()}
    whole = path.resolve()
    own_name = printable_name(whole.name if is_run else whole.parent.name if path.name == RECORDING else whole.stem)
    return Recorded(name or own_name, recording, tracks, of_run, own, on_warning, name or str(recording.path))


def _own_truth(path: Path, recording: Recording, on_warning: OnWarning) -> TruthTable:
    """Return the user's truth at the sensors' stamps; warn of what was guessed in it, and of frames that it does not cover."""
    table = read_own_truth(path, recording)
    main = recording.rig.main_sensor
    frames = np.unique(recording.stamps_of(main))
    found = truth_at(table, recording.all_stamps_ns(), frames)
    known = np.isin(frames, found.frame_stamps_ns)
    for note in table.notes:
        on_warning(note)
    if not known.all():
        where = f"{frames[~known][0] / NS_PER_S:.3f} s the first"
        on_warning(f"{path}: {known.sum()} of {known.size} frames of {main} have truth, the others ({where}) no labels")
    return found


def _bag_of(folder: Path) -> Path:
    """Return the bag of a folder of results: the run's own, or the one that `twin track` read, as it wrote there."""
    if (folder / RECORDING).is_file():
        return folder / RECORDING
    named = _about(folder).get("recording")
    if not isinstance(named, str) or not Path(named).exists():
        raise InputError(f"{folder / ABOUT}: recording: there is no bag {named!r} here; the bag itself is expected")
    return Path(named)


def _rig_of(folder: Path) -> Rig | None:
    """Return the rig.yaml with which `twin track` made a folder; None where it was given none."""
    content = _about(folder).get("rig") if (folder / ABOUT).is_file() else None
    return None if content is None else validate(Rig, content, f"{folder / ABOUT}: rig")


def _about(folder: Path) -> dict[str, Any]:
    """Read what `twin track` wrote about its recording."""
    expected = "the facts that `twin track` writes there"
    content = parse_json(read_text(folder / ABOUT, expected), str(folder / ABOUT), expected)
    return content if isinstance(content, dict) else {}


def _tracks_in(recording: Recording) -> dict[str, TrackTable]:
    """Read the tracks that a bag holds under `/tracks`, by tracker.

    Their stamps are those that they state; an empty frame, which states none, has its log time.
    """
    found: dict[str, list[dict[str, Any]]] = {
        name: []
        for name, topic in recording.topics.items()
        if re.fullmatch(r"/tracks/(?!start$)[^/]+", name) and topic.msgtype == STRING
    }
    stamps: dict[str, list[int]] = {topic: [] for topic in found}
    with open_bag(recording.path) as bag:
        for topic, log_time_ns, message in bag.messages(found):
            stamp_ns = log_time_ns - recording.start_ns - recording.logged_after_ns
            try:
                rows = json.loads(message.data)
                stated = {float(row["t"]) for row in rows if row.get("t") is not None}
                if len(stated) == 1 and abs(t := stated.pop()) < _LONGEST_S:
                    stamp_ns = round(t * NS_PER_S)
                found[topic] += [{**row, "stamp_ns": stamp_ns} for row in rows if row["id"] is not None]
            except (ValueError, KeyError, TypeError) as error:
                raise InputError(
                    f"{recording.path}: topic {topic}: holds {message.data[:60]!r}; a JSON list of tracks is expected"
                ) from error
            stamps[topic].append(stamp_ns)
    names = tracker_names(found)
    return {names[each]: _table(f"{recording.path}, {each}", stamps[each], rows) for each, rows in found.items()}


def _table(source: str, stamps: list[int], rows: list[dict[str, Any]]) -> TrackTable:
    return TrackTable(
        source,
        np.unique(np.array(stamps, dtype=np.int64)),
        np.array([row["stamp_ns"] for row in rows], dtype=np.int64),
        np.array([row["id"] for row in rows], dtype=np.int64),
        **dict[str, Any]({name: np.array([row.get(name) for row in rows], dtype=np.float64) for name in TRACK_NUMBERS}),
        status=np.array([row.get("status", STATUSES[0]) for row in rows], dtype="<U9"),
    )


def frame_rate_hz(stamps_ns: Nanoseconds) -> float:
    """Return the rate of frames by the median gap of their stamps [Hz]; 1 for a single frame."""
    gaps = np.diff(np.unique(stamps_ns))
    return float(NS_PER_S / np.median(gaps)) if gaps.size else 1.0


_SUFFIXES = {b"\xff\xd8\xff": ".jpg", b"\x89PNG": ".png"}


@dataclass(frozen=True, eq=False, slots=True)
class ExportedPicture:
    """One picture of a camera: number from 1 in order of arrival, stamp [ns], and its file's bytes and suffix.

    is_depth: depth along the optical axis, 16 bits, in millimetres, 0 for none.
    """

    camera: str
    number: int
    stamp_ns: int
    data: bytes
    suffix: str
    is_depth: bool = False

    def save(self, folder: Path, number: int | None = None) -> str:
        """Write `NNNNNN.jpg` or `.png` into the folder, under another number if one is given; return the file's name."""
        name = f"{self.number if number is None else number:06d}{self.suffix}"
        (folder / name).write_bytes(self.data)
        return name


def pictures(recorded: Recorded, cameras: Collection[str], *, depth: bool = False) -> Iterator[ExportedPicture]:
    """Yield the pictures of these cameras in order of arrival, read one at a time; with `depth` those of depth too.

    A message that holds no picture keeps its number and is left out, with one warning for each camera.
    """
    recording = recorded.recording
    found = recording.sensor_topics
    names = {topic: name for topic, name in found.sensors.items() if name in cameras}
    depths = {topic: name for topic, name in found.depths.items() if name in cameras} if depth else {}
    types = {topic: found.types[topic] for topic in (*names, *depths)}
    numbers, warned = dict.fromkeys(types, 0), set()
    copies = Copies()
    with open_bag(recording.path) as bag:
        for topic, log_ns, data, is_ros1 in bag.encoded_messages(types, in_file_order=recording.is_as_written):
            if copies.add(topic, log_ns, data, is_ros1):
                continue
            number = numbers[topic] = numbers[topic] + 1
            camera, is_depth = names.get(topic) or depths[topic], topic in depths
            stamp_ns = int(recording.stamps_ns[topic][number - 1])
            try:
                message = decoded(data, types[topic], is_ros1)
                content, suffix = _depth_file(message, camera) if is_depth else _colour_file(message, camera)
            except InputError as error:
                if topic not in warned:
                    recorded.on_warning(f"{recorded.title}: topic {topic}: left out what is no picture: {error}")
                warned.add(topic)
                continue
            yield ExportedPicture(camera, number, stamp_ns, content, suffix, is_depth)


def _colour_file(message: Any, camera: str) -> tuple[bytes, str]:
    if message.__msgtype__ == COMPRESSED_IMAGE:
        data = bytes(message.data)
        for magic, suffix in _SUFFIXES.items():
            if data.startswith(magic):
                check_picture(data, f"image of {camera!r}: format is {message.format!r}")
                return data, suffix
        return png_of(decode_compressed(message, f"image of {camera!r}")), ".png"
    return png_of(decode_raw(message, f"image of {camera!r}")), ".png"


def png_of(rgb: np.ndarray) -> bytes:
    """Encode a picture (height, width, 3) RGB as PNG, fast rather than small."""
    _, data = cv2.imencode(".png", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return data.tobytes()


def _depth_file(message: Any, camera: str) -> tuple[bytes, str]:
    if message.__msgtype__ == COMPRESSED_IMAGE and message.format == PNG_FORMAT:
        return bytes(message.data), ".png"
    return encode_png(decode_depth(message, camera))[0].tobytes(), ".png"


def write_calibration(folder: Path, name: str, camera: CameraSensor) -> None:
    """Write `camera_info.yaml` (as ROS's camera_calibration writes it) and `opencv.yaml` (cv2.FileStorage) of a camera.

    opencv.yaml holds camera_matrix, distortion_coefficients (k1 k2 p1 p2 k3, or of a fisheye k1 to k4 for cv2.fisheye), and
    the extrinsics as OpenCV has them: rvec, tvec take points of the room [m] to the camera.
    """
    lens = camera.intrinsics
    (folder / "camera_info.yaml").write_text(_camera_info_yaml(name, lens), encoding="utf-8")
    camera_from_room = camera.room_from_sensor.rotation.T
    storage = cv2.FileStorage(str(folder / "opencv.yaml"), cv2.FILE_STORAGE_WRITE)
    storage.write("camera_name", name)
    storage.write("camera_model", "pinhole" if isinstance(lens, PinholeIntrinsics) else "fisheye")
    storage.write("image_width", lens.width)
    storage.write("image_height", lens.height)
    storage.write("camera_matrix", lens.matrix)
    storage.write("distortion_coefficients", np.array([_coefficients(lens)]))
    storage.write("rvec", cv2.Rodrigues(camera_from_room)[0])
    storage.write("tvec", (-camera_from_room @ camera.room_from_sensor.translation).reshape(3, 1))
    if (baseline_m := getattr(camera, "baseline_m", None)) is not None:
        storage.write("baseline_m", baseline_m)
    storage.release()


def _coefficients(lens: FisheyeIntrinsics | PinholeIntrinsics) -> list[float]:
    return list(lens.distortion if isinstance(lens, PinholeIntrinsics) else lens.k)


def _camera_info_yaml(name: str, lens: FisheyeIntrinsics | PinholeIntrinsics) -> str:
    """Format the calibration as camera_calibration_parsers reads it."""

    def matrix(rows: int, columns: int, values: np.ndarray | list[float]) -> dict[str, Any]:
        return {"rows": rows, "cols": columns, "data": [float(value) for value in np.ravel(values)]}

    coefficients = _coefficients(lens)
    return dump_yaml(
        {
            "image_width": lens.width,
            "image_height": lens.height,
            "camera_name": name,
            "camera_matrix": matrix(3, 3, lens.matrix),
            "distortion_model": "plumb_bob" if isinstance(lens, PinholeIntrinsics) else "equidistant",
            "distortion_coefficients": matrix(1, len(coefficients), coefficients),
            "rectification_matrix": matrix(3, 3, np.eye(3)),
            "projection_matrix": matrix(3, 4, np.hstack([lens.matrix, np.zeros((3, 1))])),
        }
    )


def export_images(recordings: Sequence[Recorded], out: Path) -> None:
    """Write `SEQUENCE/CAMERA/` with `NNNNNN.jpg`, `depth/NNNNNN.png` (16 bits, mm), `stamps.csv` and calibrations.

    Raises InputError where no recording has a camera.
    """
    if not any(each.recording.rig.cameras() for each in recordings):
        raise InputError("--format images: the recording has no camera; one with pictures is expected")
    for recorded in recordings:
        cameras = recorded.recording.rig.cameras()
        with ExitStack() as stack:
            tables = {name: _opened(stack, out / recorded.name / name) for name in cameras}
            for name, camera in cameras.items():
                write_calibration(out / recorded.name / name, name, camera)
            for picture in pictures(recorded, cameras, depth=True):
                kind = "depth/" if picture.is_depth else ""
                folder = out / recorded.name / picture.camera / kind
                folder.mkdir(exist_ok=True)
                name = picture.save(folder)
                tables[picture.camera].write(f"{picture.number},{seconds_cell(picture.stamp_ns)},{kind}{name}\n")


def _opened(stack: ExitStack, folder: Path) -> TextIO:
    folder.mkdir(parents=True)
    table = stack.enter_context((folder / "stamps.csv").open("w", encoding="utf-8"))
    table.write("frame,t,file\n")
    return table
