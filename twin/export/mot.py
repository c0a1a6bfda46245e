"""MOTChallenge: a sequence per camera with boxes in its pictures, and one on the ground, laid out as TrackEval reads them.

    gt/roomtwin-all/SEQUENCE/seqinfo.ini, img1/, gt/gt.txt, det/det.txt, frames.csv
    gt/seqmaps/roomtwin-all.txt
    trackers/roomtwin-all/TRACKER/data/SEQUENCE.txt

Sequences are `RUN-CAMERA` and `RUN-ground`. A camera's frames are its labelled pictures (all of them without truth), numbered
from 1; frames.csv has their stamps. Boxes are those of a person's visible pixels, in the image, 1-based as in MOTChallenge.
Columns: frame, id, left, top, width, height, confidence, class, visibility. Class 1 is a person in the tracked area; one outside
is a distractor (8, confidence 0), with whom a tracker's box may match unpunished, as in `twin evaluate`. On the ground they are
those of 3D MOT 2015: frame, id, -1, -1, -1, -1, confidence, x, y, z [m], frames the stamps at which trackers report.

Tracks and detections have places on the ground. In pictures they are boxes of upright people: as high as the track's head and
0.12 m, else 1.7 m, and 0.5 m wide, cut at the image's edges. Source: Milan et al., MOT16, arXiv 1603.00831, 2016.
"""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Nanoseconds
from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.rig import CameraSensor
from twin.export.labels import Label, Labeller, open_labeller, upright_boxes
from twin.export.pictures import ExportedPicture, Recorded, frame_rate_hz, pictures
from twin.recording.tables import TrackTable, seconds_cell
from twin.run.feed import write_detections
from twin.run.tracker_runner import file_name

BENCHMARK = "roomtwin-all"
_PERSON, _DISTRACTOR = 1, 8


@dataclass(frozen=True, eq=False)
class PlaceRows:
    """Positions of tracks or detections by stamp: stamps ascending (n,) [ns], ids (n,), -1 for a detection, x, y, z of the
    head. frames_ns: stamps of all frames, also those without anybody, ascending (m,) [ns].
    """

    frames_ns: Nanoseconds
    stamps_ns: Nanoseconds
    id: NDArray[np.int64]
    xy: Array
    head_z: Array

    def near(self, stamp_ns: int, within_ns: float) -> PlaceRows:
        """Return those of the frame nearest to this stamp, none if it is farther than `within_ns`."""
        place = int(np.searchsorted(self.frames_ns, stamp_ns))
        near = [self.frames_ns[each] for each in (place - 1, place) if 0 <= each < self.frames_ns.size]
        best = min(near, key=lambda each: abs(int(each) - stamp_ns), default=None)
        if best is None or abs(int(best) - stamp_ns) > within_ns:
            return self.rows(slice(0, 0))
        return self.rows(slice(*np.searchsorted(self.stamps_ns, [best, best + 1])))

    def rows(self, rows: slice) -> PlaceRows:
        """Return some of the places."""
        return PlaceRows(self.frames_ns, self.stamps_ns[rows], self.id[rows], self.xy[rows], self.head_z[rows])


def export_mot(recordings: Sequence[Recorded], out: Path, *, hz: float | None = None) -> None:
    """Write the sequences of each recording; `hz`: labelled pictures per second, by simulating again (None: the bag's)."""
    sequences: list[str] = []
    for recorded in recordings:
        detections = _detections(recorded)
        sequences.append(_ground(recorded, out, detections))
        with ExitStack() as stack:
            labeller = open_labeller(stack, recorded, simulate=hz is not None, hz=hz)
            sequences += _cameras(recorded, out, labeller, detections)
        if not recorded.has_truth:
            recorded.on_warning(f"{recorded.title}: holds no truth: gt/gt.txt is left out; --truth FILE.csv gives it")
    (out / "gt/seqmaps").mkdir(parents=True)
    (out / "gt/seqmaps" / f"{BENCHMARK}.txt").write_text("name\n" + "".join(f"{name}\n" for name in sequences))


class _Sequence:
    """Files of one sequence, open while its frames come."""

    def __init__(self, stack: ExitStack, out: Path, name: str, recorded: Recorded, *, has_truth: bool) -> None:
        self.name, self.folder = name, out / "gt" / BENCHMARK / name
        self.stamps: list[int] = []
        self.frames = self._open(stack, self.folder / "frames.csv")
        self.frames.write("frame,t\n")
        self.truth = self._open(stack, self.folder / "gt/gt.txt") if has_truth else None
        self.detections = self._open(stack, self.folder / "det/det.txt")
        self.tracks = {
            each: self._open(stack, out / "trackers" / BENCHMARK / file_name(each) / "data" / f"{name}.txt")
            for each in recorded.tracks
        }

    @staticmethod
    def _open(stack: ExitStack, path: Path) -> TextIO:
        path.parent.mkdir(parents=True, exist_ok=True)
        return stack.enter_context(path.open("w", encoding="utf-8"))

    def frame(self, stamp_ns: int) -> int:
        """Start the next frame; return its number."""
        self.stamps.append(stamp_ns)
        self.frames.write(f"{len(self.stamps)},{seconds_cell(stamp_ns)}\n")
        return len(self.stamps)

    def finish(self, width: int = 0, height: int = 0, suffix: str = "") -> None:
        """Write seqinfo.ini."""
        rate_hz = frame_rate_hz(np.array(self.stamps, dtype=np.int64))
        lines = [
            "[Sequence]", f"name={self.name}", "imDir=img1", f"frameRate={rate_hz:.6g}", f"seqLength={len(self.stamps)}",
            f"imWidth={width}", f"imHeight={height}", f"imExt={suffix}",
        ]  # fmt: skip
        (self.folder / "seqinfo.ini").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _cameras(recorded: Recorded, out: Path, labeller: Labeller | None, detections: PlaceRows) -> list[str]:
    cameras = recorded.recording.rig.cameras()
    tracks = {name: _places(table) for name, table in recorded.tracks.items()}
    within = {name: 0.5 * NS_PER_S / frame_rate_hz(table.frame_stamps_ns) for name, table in recorded.tracks.items()}
    detected_within = 0.5 * NS_PER_S / frame_rate_hz(detections.frames_ns)
    with ExitStack() as stack:
        sequences, suffixes = {}, {}
        for picture, labels in _frames(recorded, list(cameras), labeller):
            camera = cameras[picture.camera]
            if picture.camera not in sequences:
                name = f"{recorded.name}-{picture.camera}"
                sequences[picture.camera] = _Sequence(stack, out, name, recorded, has_truth=labeller is not None)
                (sequences[picture.camera].folder / "img1").mkdir()
            sequence = sequences[picture.camera]
            suffixes[picture.camera] = picture.suffix
            number = sequence.frame(picture.stamp_ns)
            picture.save(sequence.folder / "img1", number)
            if sequence.truth is not None:
                sequence.truth.writelines(_truth_row(number, label) for label in labels)
            _write_boxes(sequence.detections, number, detections.near(picture.stamp_ns, detected_within), camera)
            for each, places in tracks.items():
                _write_boxes(sequence.tracks[each], number, places.near(picture.stamp_ns, within[each]), camera)
        for name, sequence in sequences.items():
            lens = cameras[name].intrinsics
            sequence.finish(lens.width, lens.height, suffixes[name])
    if missing := [name for name in cameras if name not in sequences]:
        recorded.on_warning(
            f"{recorded.title}: no labelled picture of {', '.join(missing)}: left out; --labels-hz labels any"
        )
    return [sequence.name for sequence in sequences.values()]


def _frames(
    recorded: Recorded, cameras: list[str], labeller: Labeller | None
) -> Iterator[tuple[ExportedPicture, tuple[Label, ...]]]:
    if labeller is None:
        yield from ((picture, ()) for picture in pictures(recorded, cameras))
    else:
        yield from ((each.picture, each.labels) for each in labeller.labelled(cameras))


def _truth_row(frame: int, label: Label) -> str:
    box = label.box
    kind, confidence = (_PERSON, 1) if label.in_area else (_DISTRACTOR, 0)
    visible = -1 if np.isnan(label.visible) else round(label.visible, 4)
    return f"{frame},{box.id},{box.left + 1},{box.top + 1},{box.width},{box.height},{confidence},{kind},{visible}\n"


def _write_boxes(stream: TextIO, frame: int, places: PlaceRows, camera: CameraSensor) -> None:
    if places.id.size:
        boxes, shown, _ = upright_boxes(camera, places.xy, places.head_z)
        for id_, (left, top, width, height) in zip(places.id[shown], boxes[shown], strict=True):
            stream.write(f"{frame},{id_},{left + 1:.2f},{top + 1:.2f},{width:.2f},{height:.2f},1,-1,-1,-1\n")


def _ground(recorded: Recorded, out: Path, detections: PlaceRows) -> str:
    """Write the sequence on the ground: the truth at the stamps of the sensor at which trackers report."""
    name = f"{recorded.name}-ground"
    stamps = np.unique(recorded.recording.stamps_of(recorded.recording.rig.main_sensor))
    if recorded.own_truth is not None:
        stamps = np.intersect1d(stamps, recorded.own_truth.frame_stamps_ns)
    number_of = {int(stamp): number for number, stamp in enumerate(stamps, start=1)}
    within = 0.5 * NS_PER_S / frame_rate_hz(stamps)
    with ExitStack() as stack:
        sequence = _Sequence(stack, out, name, recorded, has_truth=recorded.has_truth)
        for stamp_ns in stamps.tolist():
            sequence.frame(stamp_ns)
        if sequence.truth is not None:
            for frame in recorded.truth():
                number = number_of.get(frame.stamp_ns, 0)
                for person in frame.people if number else ():
                    sequence.truth.write(_ground_row(number, person.id, int(person.in_area), person.x, person.y))
        files = {"": detections} | {tracker: _places(table) for tracker, table in recorded.tracks.items()}
        for tracker, places in files.items():
            stream = sequence.tracks[tracker] if tracker else sequence.detections
            for number, stamp_ns in enumerate(stamps.tolist(), start=1):
                near = places.near(stamp_ns, within)
                for id_, (x, y) in zip(near.id.tolist(), near.xy.tolist(), strict=True):
                    stream.write(_ground_row(number, id_, 1, x, y))
        sequence.finish()
    return name


def _ground_row(frame: int, id_: int, confidence: int, x: float, y: float) -> str:
    return f"{frame},{id_},-1,-1,-1,-1,{confidence},{x:.4f},{y:.4f},0\n"


def _places(table: TrackTable) -> PlaceRows:
    return PlaceRows(
        table.frame_stamps_ns, table.stamps_ns, table.id, np.stack([table.x, table.y], axis=-1), table.head_z
    )


def _detections(recorded: Recorded) -> PlaceRows:
    """Detect people with the baseline's detector; none if the rig has no scanner."""
    rows = np.zeros((0, 3))
    if recorded.recording.rig.lasers():
        with tempfile.TemporaryFile("w+", encoding="utf-8") as table:
            try:
                write_detections(recorded.recording.path, table, tracker="sort", rig=recorded.rig)
            except InputError as error:
                recorded.on_warning(f"det/det.txt stays empty: {error}")
            table.seek(0)
            rows = np.array(
                [(round(float(row["t"]) * NS_PER_S), row["x"], row["y"]) for row in csv.DictReader(table)], dtype=float
            ).reshape(-1, 3)
    else:
        recorded.on_warning(f"{recorded.title}: has no scanner: det/det.txt stays empty")
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    count, stamps_ns = len(rows), rows[:, 0].astype(np.int64)
    return PlaceRows(np.unique(stamps_ns), stamps_ns, np.full(count, -1), rows[:, 1:], np.full(count, np.nan))
