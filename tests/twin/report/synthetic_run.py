"""A synthetic run for the report's tests: five people on smooth paths, scans of circles, tracks with known faults."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.cameras import FisheyeIntrinsics
from trackers.observations import NS_PER_S, Image, LaserScan
from trackers.rig import FisheyeSensor, LaserSensor, Pose, Rig
from trackers.tracks import Track, TrackFrame
from twin.recording.tables import TrackTable, TruthTable, track_table, truth_table
from twin.truth.truth_types import PersonTruth, TruthFrame

AREA = ((-2.0, 0.6), (2.0, 0.6), (2.0, 2.8), (-2.0, 2.8))
PERIOD_NS = NS_PER_S // 10


def box(x: float, y: float, width: float, depth: float) -> NDArray[np.float64]:
    """Corners (4, 2) [m] of a box around (x, y)."""
    return np.array([x, y]) + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array([width, depth]) / 2


def room() -> list[NDArray[np.float64]]:
    """Walls and three pieces of furniture."""
    walls = [box(0, -0.35, 6.4, 0.1), box(0, 4.35, 6.4, 0.1), box(-3.2, 2, 0.1, 4.8), box(3.2, 2, 0.1, 4.8)]
    return [*walls, box(-2.7, 3.9, 0.8, 0.6), box(2.75, 3.4, 0.6, 1.4), box(2.8, 0.4, 0.5, 0.8)]


def laboratory() -> Rig:
    """Two scanners and a fisheye camera at the origin, looking along +y."""
    ahead = (0.0, 0.0, np.pi / 2)
    intrinsics = FisheyeIntrinsics(width=320, height=320, fx=98.0, fy=98.0, cx=159.5, cy=159.5, field_of_view_rad=3.22)
    optical = Pose.from_matrix(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), (0.0, 0.0, 1.2))
    return Rig(
        sensors={
            "waist": LaserSensor(topic="/waist/scan", room_from_sensor=Pose(xyz=(0, 0, 0.95), rpy=ahead), role="waist"),
            "knee": LaserSensor(topic="/knee/scan", room_from_sensor=Pose(xyz=(0, 0, 0.45), rpy=ahead), role="knee"),
            "camera": FisheyeSensor(topic="/camera/image", room_from_sensor=optical, intrinsics=intrinsics),
        },
        area=AREA,
    )


def positions(t: float, n_people: int = 5) -> NDArray[np.float64]:
    """Return the positions of all people at t [s], (n, 2) [m]."""
    person = np.arange(n_people)
    phase = 1.3 * person
    x = 1.75 * np.sin(0.31 * t * (1 + 0.07 * person) + phase) * np.cos(0.05 * t + person)
    y = 1.7 + 1.0 * np.sin(0.43 * t * (1 - 0.05 * person) + 2.1 * person)
    return np.column_stack([x, y])


def scan(
    sensor: str, stamp_ns: int, people: NDArray[np.float64], radius_m: float, rng: np.random.Generator
) -> LaserScan:
    """361 beams against circles in a box of a room, from the origin looking along +y."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, 361)
    ray = np.column_stack([np.cos(angles + np.pi / 2), np.sin(angles + np.pi / 2)])
    wall = np.minimum(3.15 / np.maximum(np.abs(ray[:, 0]), 1e-9), 4.3 / np.maximum(ray[:, 1], 1e-9))
    along = ray @ people.T
    off2 = (people**2).sum(axis=1) - along**2
    hit = (off2 < radius_m**2) & (along > 0)
    near = np.where(hit, along - np.sqrt(np.maximum(radius_m**2 - off2, 0)), np.inf).min(axis=1)
    ranges = np.minimum(wall, near) + 0.01 * rng.standard_normal(361)
    return LaserScan(sensor, stamp_ns, ranges.astype(np.float32), -np.pi / 2, np.pi / 360, 0.05, 10.0)


@dataclass(frozen=True)
class SyntheticRun:
    """Everything that a run gives to the report."""

    rig: Rig
    outline: list[NDArray[np.float64]]
    truth_frames: list[TruthFrame]
    track_frames: list[TrackFrame]
    image: Image

    @property
    def truth(self) -> TruthTable:
        return truth_table(self.truth_frames)

    @property
    def tracks(self) -> TrackTable:
        return track_table(self.track_frames)

    def scans(self, index: int) -> dict[str, LaserScan]:
        frame = self.truth_frames[index]
        people = np.array([(person.x, person.y) for person in frame.people]).reshape(-1, 2)
        rng = np.random.default_rng(index)
        apart = np.array([0.09, 0.0])
        legs = np.concatenate([people + apart, people - apart])
        return {
            "waist": scan("waist", frame.stamp_ns, people, 0.18, rng),
            "knee": scan("knee", frame.stamp_ns, legs, 0.06, rng),
        }


def stage(duration_s: float, start_ns: int = 0, n_people: int = 5, seed: int = 1) -> SyntheticRun:
    """A run in which tracks 0 and 1 swap people at half time, track 2 is lost at 60 % and taken up as 11 two seconds later,
    and track 9 follows nobody from 20 % to 35 %."""
    rng = np.random.default_rng(seed)
    truth_frames, track_frames = [], []
    for index in range(round(duration_s * 10)):
        t, stamp_ns = index / 10, start_ns + index * PERIOD_NS
        xy, later = positions(t, n_people), positions(t + 0.01, n_people)
        v = (later - xy) / 0.01
        seen = np.clip(1.2 - 0.5 * np.abs(np.sin(0.7 * t + np.arange(n_people))) ** 8 * 2.4, 0, 1)
        truth_frames.append(
            TruthFrame(
                stamp_ns,
                tuple(
                    PersonTruth(
                        id=person + 1,
                        x=float(xy[person, 0]),
                        y=float(xy[person, 1]),
                        z=0.95,
                        yaw=float(np.arctan2(v[person, 1], v[person, 0])),
                        vx=float(v[person, 0]),
                        vy=float(v[person, 1]),
                        visible={"waist": float(seen[person]), "knee": float(min(1, seen[person] + 0.3))},
                    )
                    for person in range(n_people)
                ),
            )
        )
        tracks = []
        for person in range(n_people):
            identity = person + 1
            if person < 2 and t >= duration_s / 2:
                identity = 2 - person
            if person == 2 and t >= 0.6 * duration_s:
                if t < 0.6 * duration_s + 2:
                    continue
                identity = 11
            where = xy[person] + 0.05 * rng.standard_normal(2)
            status = "coasting" if seen[person] < 0.15 else "confirmed"
            if t > 0.4:
                tracks.append(Track(identity, *where.tolist(), vx=v[person, 0], vy=v[person, 1], status=status))
        if 0.2 * duration_s <= t < 0.35 * duration_s:
            tracks.append(Track(9, 1.9, 2.7 - 0.02 * (t % 5), status="confirmed"))
        track_frames.append(TrackFrame(stamp_ns, tuple(sorted(tracks, key=lambda track: track.id))))
    x, y = np.meshgrid(np.linspace(0, 1, 320), np.linspace(0, 1, 320))
    rgb = np.round(np.stack([60 + 140 * x, 60 + 140 * y, 200 - 140 * x], axis=-1)).astype(np.uint8)
    return SyntheticRun(laboratory(), room(), truth_frames, track_frames, Image("camera", start_ns, rgb))
