"""KITTI tracking: calibration, labels of people, scans as velodyne points and pictures, a number per recording.

    training/calib/0000.txt, label_02/0000.txt, velodyne/0000/000000.bin, image_02/0000/000000.png; sequences.csv, frames/0000.csv

The reference camera is the first pinhole or stereo camera by name; frames are its pictures, counted from 0. Pictures are
undistorted. Labels are in level axes at its eye: x right, y straight down, z ahead, so that people stand upright in them. P2
holds the tilt of the camera too and projects these axes into the picture. Without such a camera frames are the stamps at which
trackers report, labels are in the level axes of the main sensor, and their boxes in the picture are −1.

Points are in the frame of the main scanner (x ahead, y left, z up): each scanner's scan nearest to the frame, or without a
scanner the depth camera's points; reflectance is 1. `Tr_imu_velo` takes the room's frame to it.

Labels: a box turned as the trunk around pelvis and head, down to the floor. Truncated: 0 none, 1 less than half, 2 more of the
box is out of the picture. Occluded: 0, 1, 2 for at least 80 %, at least 40 % and less of the body in sight, 3 unknown. Source:
Geiger et al., Vision meets Robotics: The KITTI Dataset, IJRR 2013, and the tracking benchmark's development kit.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from trackers.arrays import Array, Singles
from trackers.cameras import PinholeIntrinsics
from trackers.observations import NS_PER_S, DepthImage, Image, LaserScan
from trackers.rig import PinholeSensor, Rig, RigSensor, StereoSensor
from twin.export.labels import Truth
from twin.export.pictures import Recorded, png_of
from twin.recording.tables import seconds_cell
from twin.truth.truth_types import PersonTruth

_OPTICAL_FROM_BODY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
_HEAD_M, _PELVIS_M = (0.10, 0.08, 0.12), (0.15, 0.24, 0.12)
"""Half the extent of an adult's head, and of the trunk about the pelvis, along, across and up [m]."""
_UPRIGHT_M = 1.7
_STEEP = 0.02
"""Least level share of a camera's axis for it not to look straight down, where up in its picture is ahead."""
_WAIT_NS = NS_PER_S // 2
"""Time after a frame within which its nearest scan may arrive."""


def export_kitti(recordings: Sequence[Recorded], out: Path) -> None:
    """Write each recording as a sequence below `training/`, numbered in this order."""
    root = out / "training"
    for part in ("calib", "label_02", "frames", "velodyne", "image_02"):
        (root / part).mkdir(parents=True)
    with (out / "sequences.csv").open("w", encoding="utf-8") as table:
        table.write("sequence,name\n")
        for number, recorded in enumerate(recordings):
            table.write(f"{number:04d},{recorded.name}\n")
            _SequenceWriter(recorded, root, f"{number:04d}").write()


@dataclass(frozen=True, eq=False)
class _LabelAxes:
    """Level axes of the labels, and the pictures' lens (None: no pictures)."""

    name: str
    rotation: Array  # room_from_level
    eye_m: Array
    lens: PinholeIntrinsics | None
    camera_from_level: Array

    @classmethod
    def of(cls, rig: Rig) -> _LabelAxes:
        cameras = sorted(name for name, each in rig.sensors.items() if isinstance(each, PinholeSensor | StereoSensor))
        name = cameras[0] if cameras else rig.main_sensor
        sensor = rig.sensors[name]
        pose = sensor.room_from_sensor
        optical = pose.rotation if hasattr(sensor, "intrinsics") else pose.rotation @ _OPTICAL_FROM_BODY.T
        looks_down = np.hypot(*optical[:2, 2]) < _STEEP
        ahead = (-optical[:, 1] if looks_down else optical[:, 2]) * (1.0, 1.0, 0.0)
        ahead /= np.linalg.norm(ahead)
        down = np.array([0.0, 0.0, -1.0])
        level = np.stack([np.cross(down, ahead), down, ahead], axis=-1)
        lens = sensor.intrinsics if isinstance(sensor, PinholeSensor | StereoSensor) else None
        return cls(name, level, pose.translation, lens, optical.T @ level)

    def projection(self, shift_m: float = 0.0) -> Array:
        """Return the matrix (3, 4) that projects level axes into the picture of an eye `shift_m` to the right [m]."""
        matrix = np.eye(3) if self.lens is None else self.lens.matrix
        return matrix @ np.column_stack([self.camera_from_level if self.lens else np.eye(3), [-shift_m, 0.0, 0.0]])

    def level_points(self, points: Array) -> Array:
        """Transform points (n, 3) of the room to the level axes."""
        return (points - self.eye_m) @ self.rotation


class _SequenceWriter:
    """One recording, frame by frame."""

    def __init__(self, recorded: Recorded, root: Path, name: str) -> None:
        self._recorded, self._root, self._name = recorded, root, name
        rig = recorded.recording.rig
        self._view = _LabelAxes.of(rig)
        lasers = rig.lasers()
        first = rig.main_sensor if rig.main_sensor in lasers else next(iter(sorted(lasers)), self._view.name)
        self._origin: RigSensor = rig.sensors[first]
        self._scanners: dict[str, deque[tuple[int, Singles]]] = {name: deque() for name in lasers}
        if not lasers:
            self._scanners = {name: deque() for name, each in rig.sensors.items() if isinstance(each, StereoSensor)}
        self._truth = Truth(recorded.truth()) if recorded.has_truth else None

    def write(self) -> None:
        """Write the sequence's files, with a warning about omissions."""
        recorded, view = self._recorded, self._view
        (self._root / "calib" / f"{self._name}.txt").write_text(self._calibration(), encoding="utf-8")
        (self._root / "velodyne" / self._name).mkdir()
        if view.lens is not None:
            (self._root / "image_02" / self._name).mkdir()
        else:
            recorded.on_warning(
                f"{recorded.title}: has no pinhole camera: image_02 is left out, boxes are -1, and labels are in the "
                f"axes of {view.name}"
            )
        if self._truth is None:
            recorded.on_warning(f"{recorded.title}: holds no truth: label_02 is left out; --truth FILE.csv gives it")
        if not self._scanners:
            recorded.on_warning(f"{recorded.title}: has neither scanner nor depth: velodyne stays empty")
        with ExitStack() as stack:
            self._frames = stack.enter_context((self._root / "frames" / f"{self._name}.csv").open("w"))
            self._frames.write("frame,t\n")
            self._labels = (
                stack.enter_context((self._root / "label_02" / f"{self._name}.txt").open("w")) if self._truth else None
            )
            for number, (stamp_ns, points) in enumerate(self._paired()):
                self._frames.write(f"{number},{seconds_cell(stamp_ns)}\n")
                points.tofile(self._root / "velodyne" / self._name / f"{number:06d}.bin")
                frame = self._truth.at(stamp_ns) if self._truth is not None else None
                if self._labels is not None and frame is not None:
                    rows = (_label(number, person, view) for person in frame.people)
                    self._labels.writelines(row for row in rows if row)

    def _paired(self) -> Iterator[tuple[int, Singles]]:
        """Yield each frame's stamp and points (n, 4) float32, once every scanner's nearest scan is known."""
        waiting: deque[int] = deque()
        number, now_ns = 0, 0
        for observation in self._recorded.recording.observations():
            now_ns = max(now_ns, observation.stamp_ns)
            if isinstance(observation, LaserScan) and observation.sensor in self._scanners:
                self._scanners[observation.sensor].append((observation.stamp_ns, self._scan_points(observation)))
            if isinstance(observation, DepthImage) and observation.sensor in self._scanners:
                self._scanners[observation.sensor].append((observation.stamp_ns, self._depth_points(observation)))
            if observation.sensor == self._view.name:
                waiting.append(observation.stamp_ns)
                if isinstance(observation, Image | DepthImage) and self._view.lens is not None:
                    self._save_picture(number, observation.rgb)
                number += 1
            while waiting and (self._is_ready(waiting[0]) or now_ns > waiting[0] + _WAIT_NS):
                yield waiting[0], self._nearest_points(waiting.popleft())
        while waiting:
            yield waiting[0], self._nearest_points(waiting.popleft())

    def _is_ready(self, stamp_ns: int) -> bool:
        return all(scans and scans[-1][0] >= stamp_ns for scans in self._scanners.values())

    def _nearest_points(self, stamp_ns: int) -> Singles:
        found: list[Singles] = [np.zeros((0, 4), dtype=np.float32)]
        for scans in self._scanners.values():
            while len(scans) > 1 and scans[1][0] <= stamp_ns:
                scans.popleft()
            near = min(scans, key=lambda scan: abs(scan[0] - stamp_ns), default=None)
            if near is not None and abs(near[0] - stamp_ns) <= _WAIT_NS:
                found.append(near[1])
        return np.concatenate(found)

    def _scan_points(self, scan: LaserScan) -> Singles:
        pose = self._recorded.recording.rig.sensors[scan.sensor].room_from_sensor
        return self._velodyne(scan.points @ pose.rotation.T + pose.translation)

    def _depth_points(self, image: DepthImage) -> Singles:
        sensor = cast("StereoSensor", self._recorded.recording.rig.sensors[image.sensor])
        points = sensor.points(image.depth_m)
        return self._velodyne(points[image.depth_m > 0])

    def _velodyne(self, points: Array) -> Singles:
        pose = self._origin.room_from_sensor
        turned = self._origin_rotation()
        local = (points - pose.translation) @ turned
        return np.column_stack([local, np.ones(len(local))]).astype(np.float32)

    def _origin_rotation(self) -> Array:
        """Return room_from_velodyne's rotation: axes x ahead, y left, z up, of a camera too."""
        rotation = self._origin.room_from_sensor.rotation
        return rotation @ _OPTICAL_FROM_BODY if hasattr(self._origin, "intrinsics") else rotation

    def _save_picture(self, number: int, rgb: np.ndarray) -> None:
        lens = self._view.lens
        assert lens is not None
        if lens.is_distorted:
            rgb = cv2.undistort(rgb, lens.matrix, np.array(lens.distortion))
        (self._root / "image_02" / self._name / f"{number:06d}.png").write_bytes(png_of(rgb))

    def _calibration(self) -> str:
        view, pose, turned = self._view, self._origin.room_from_sensor, self._origin_rotation()
        sensor = self._recorded.recording.rig.sensors[view.name]
        baseline_m = (sensor.baseline_m or 0.0) if isinstance(sensor, StereoSensor) else 0.0
        left, right = view.projection(), view.projection(baseline_m)
        camera_from_velodyne = np.column_stack(
            [view.rotation.T @ turned, view.rotation.T @ (pose.translation - view.eye_m)]
        )
        velodyne_from_room = np.column_stack([turned.T, -turned.T @ pose.translation])
        rows = {f"P{each}:": right if each in (1, 3) else left for each in range(4)}
        rows |= {"R_rect": np.eye(3), "Tr_velo_cam": camera_from_velodyne, "Tr_imu_velo": velodyne_from_room}
        return "".join(f"{name} {' '.join(f'{value:.12e}' for value in each.ravel())}\n" for name, each in rows.items())


def person_box(person: PersonTruth) -> tuple[Array, Array]:
    """Return centre of the ground face (3,) [m] in the room and size (length, width, height) [m] of the box around a person.

    It is turned as the trunk, and holds pelvis and head as far as known, down to the floor; 1.7 m high if neither is known.
    """
    yaw = _yaw(person)
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    axes = np.stack([ahead, [-ahead[1], ahead[0]]])
    place = np.array([person.x, person.y])
    parts = [(np.zeros(2), person.z, _PELVIS_M)]
    if not np.isnan([person.head_x, person.head_y, person.head_z]).any():
        parts.append((axes @ (np.array([person.head_x, person.head_y]) - place), person.head_z, _HEAD_M))
    flat = np.array([middle for middle, _, _ in parts])
    half = np.array([extent[:2] for _, _, extent in parts])
    low, high = (flat - half).min(axis=0), (flat + half).max(axis=0)
    tops = [z + extent[2] for _, z, extent in parts if not np.isnan(z)]
    top = max(tops, default=_UPRIGHT_M)
    middle = place + (low + high) / 2 @ axes
    return np.array([*middle, 0.0]), np.array([*(high - low), top])


def _yaw(person: PersonTruth) -> float:
    """Return the heading of the trunk [rad], 0 where unknown."""
    return 0.0 if np.isnan(person.yaw) else person.yaw


def _label(frame: int, person: PersonTruth, view: _LabelAxes) -> str:
    """Format a person's line; '' outside the picture."""
    yaw = _yaw(person)
    foot, (length, width, height) = person_box(person)
    ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    across = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    signs = np.array([(i, j, k) for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (0.0, 1.0)])
    corners = foot + signs @ np.stack([length * ahead, width * across, [0.0, 0.0, height]])
    box, truncated = _picture_box(view, view.level_points(corners))
    if box is None:
        return ""
    x, y, z = view.level_points(foot[None])[0]
    facing = ahead @ view.rotation
    rotation_y = float(np.arctan2(-facing[2], facing[0]))
    alpha = float(np.arctan2(np.sin(rotation_y - np.arctan2(x, z)), np.cos(rotation_y - np.arctan2(x, z))))
    visible = person.visible.get(view.name, np.nan)
    occluded = 3 if np.isnan(visible) else 0 if visible >= 0.8 else 1 if visible >= 0.4 else 2
    numbers = (alpha, *box, height, width, length, x, y, z, rotation_y)
    return f"{frame} {person.id} Pedestrian {truncated} {occluded} {' '.join(f'{each:.6f}' for each in numbers)}\n"


def _picture_box(view: _LabelAxes, corners: Array) -> tuple[tuple[float, ...] | None, int]:
    """Return the box in the picture, cut at its edges (None: outside; −1 without pictures), and its truncation."""
    lens = view.lens
    if lens is None:
        return (-1.0, -1.0, -1.0, -1.0), 0
    corners = corners @ view.camera_from_level.T
    ahead = corners[:, 2] > 1e-6
    if not ahead.any():
        return None, 0
    pixels = (corners[ahead] / corners[ahead, 2:]) @ lens.matrix.T
    low, high = pixels[:, :2].min(axis=0), pixels[:, :2].max(axis=0)
    edge = np.array([lens.width - 1.0, lens.height - 1.0])
    cut_low, cut_high = np.clip(low, 0, edge), np.clip(high, 0, edge)
    if (cut_high <= cut_low).any():
        return None, 0
    share = np.prod(cut_high - cut_low) / np.prod(high - low)
    truncated = 2 if share < 0.5 else 1 if share < 1 - 1e-9 or not ahead.all() else 0
    return (*cut_low.tolist(), *cut_high.tolist()), truncated
