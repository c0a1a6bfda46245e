"""A flat room for testing trackers without the twin: ellipses before a wall, two scanners and a fisheye camera at the origin.

Not a model of people, only something with trunks, arms, legs and shirts in the right places: good to see whether a tracker
keeps who is who, no measure of how well it does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from trackers.arrays import Array
from trackers.cameras import FisheyeIntrinsics
from trackers.observations import NS_PER_S, Image, LaserScan, Observation
from trackers.rig import FisheyeSensor, LaserSensor, Pose, Rig
from trackers.tracks import TrackFrame

PERIOD_S = 0.1
AREA = ((-2.0, 0.6), (2.0, 0.6), (2.0, 2.8), (-2.0, 2.8))
SHIRTS = {
    "white": (235, 235, 230),
    "black": (22, 22, 25),
    "pink": (235, 120, 170),
    "blue": (40, 80, 200),
    "purple": (120, 50, 150),
}
WALL_Y, WALL_X = 3.3, 2.7
CAMERA_HEIGHT_M = 1.15
INTRINSICS = FisheyeIntrinsics(
    width=480, height=480, fx=148.0, fy=148.0, cx=239.5, cy=239.5, field_of_view_rad=np.deg2rad(185)
)
GREY_ROOM = np.full((INTRINSICS.height, INTRINSICS.width, 3), (150, 145, 135), np.uint8)


def rig(waist: bool = True, knee: bool = True, camera: bool = True, roles: bool = True) -> Rig:
    """The rig at the origin looking along +y: scanners at 0.95 and 0.45 m, a camera between them at the same place."""
    sensors: dict = {}
    for name, height, there in (("waist", 0.95, waist), ("knee", 0.45, knee)):
        if there:
            pose = Pose(xyz=(0, 0, height), rpy=(0, 0, np.pi / 2))
            sensors[name] = LaserSensor(topic=f"/{name}/scan", room_from_sensor=pose, role=name if roles else None)
    if camera:
        sensors["camera"] = FisheyeSensor(topic="/camera/image", room_from_sensor=camera_pose(), intrinsics=INTRINSICS)
    return Rig(sensors=sensors, area=AREA)


def camera_pose() -> Pose:
    """The camera looking along +y: x right is room +x, y down is −z, z ahead is +y."""
    return Pose.from_matrix(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), (0.0, 0.0, CAMERA_HEIGHT_M))


@dataclass(frozen=True, eq=False)
class Walk:
    """Where people are at every scan: position (n_t, n, 2) [m], heading (n_t, n) [rad], phase of the gait (n_t, n) [rad]."""

    position: Array
    heading: Array
    phase: Array

    def __len__(self) -> int:
        return len(self.position)

    @property
    def n_person(self) -> int:
        return self.position.shape[1]

    def permuted(self, order: Sequence[int]) -> Walk:
        return Walk(self.position[:, order], self.heading[:, order], self.phase[:, order])


def straight_walk(start: Sequence, velocity: Sequence, n: int) -> Walk:
    """People on straight lines from `start` (p, 2) at `velocity` (p, 2) [m/s] for n scans."""
    t = np.arange(n)[:, None, None] * PERIOD_S
    velocity = np.asarray(velocity, float)
    position = np.asarray(start, float) + t * velocity
    heading = np.broadcast_to(np.arctan2(velocity[:, 1], velocity[:, 0]), position.shape[:2])
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    return Walk(position, heading, 2 * np.pi * 0.75 * speed * t[..., 0])


def wandering(n_person: int, n: int, rng: np.random.Generator, apart_m: float = 0.5) -> Walk:
    """People wandering in the area with sudden stops, starts and turns, nobody nearer than about `apart_m` to another."""
    low, high = np.array([-1.6, 0.95]), np.array([1.6, 2.45])
    grid = np.stack(np.meshgrid(np.linspace(-1.4, 1.4, 5), [1.1, 1.7, 2.3]), -1).reshape(-1, 2)
    p = grid[rng.permutation(len(grid))[:n_person]] + rng.uniform(-0.1, 0.1, (n_person, 2))
    heading = rng.uniform(-np.pi, np.pi, n_person)
    speed, phase, pause = np.zeros(n_person), rng.uniform(0, 6, n_person), np.zeros(n_person)
    target, cruise = rng.uniform(low, high, (n_person, 2)), rng.uniform(0.5, 1.4, n_person)
    positions, headings, phases = [], [], []
    step = PERIOD_S / 5
    for k in range(n * 5):
        arrived = np.hypot(*(target - p).T) < 0.15
        changed = arrived | (rng.random(n_person) < step / 3.0)
        target[changed] = rng.uniform(low, high, (changed.sum(), 2))
        cruise[changed] = rng.uniform(0.5, 1.4, changed.sum())
        stopped = rng.random(n_person) < step / 4.0
        pause[stopped] = rng.uniform(0.3, 1.0, stopped.sum())
        pause = np.maximum(pause - step, 0)
        wish = target - p
        wish /= np.maximum(np.hypot(*wish.T), 1e-9)[:, None]
        apart = p[:, None] - p[None]
        gap = np.hypot(apart[..., 0], apart[..., 1]) + np.eye(n_person) * 9
        wish += (apart / gap[..., None] * np.exp(-(gap - apart_m) / 0.12)[..., None]).sum(axis=1)
        wanted = np.arctan2(wish[:, 1], wish[:, 0])
        turn = (wanted - heading + np.pi) % (2 * np.pi) - np.pi
        heading = heading + np.clip(turn, -8 * step, 8 * step)
        goal = np.where(pause > 0, 0.0, cruise * np.clip(np.cos(turn), 0, 1))
        speed = speed + np.clip(goal - speed, -6 * step, 4 * step)
        moved = p + speed[:, None] * step * np.stack([np.cos(heading), np.sin(heading)], 1)
        apart = moved[:, None] - p[None]
        close = (np.hypot(apart[..., 0], apart[..., 1]) + np.eye(n_person) * 9).min(axis=1) < apart_m - 0.08
        speed = np.where(close, 0.0, speed)
        p = np.clip(np.where(close[:, None], p, moved), low, high)
        phase = phase + 2 * np.pi * 0.75 * speed * step
        if k % 5 == 4:
            positions.append(p.copy())
            headings.append(heading.copy())
            phases.append(phase.copy())
    return Walk(np.array(positions), np.array(headings), np.array(phases))


def body(walk: Walk, k: int, height: str) -> tuple[Array, Array, Array, NDArray[np.intp]]:
    """Ellipses at scan k and height `waist` or `knee`: centres (e, 2), semi-axes along and across (e, 2), heading (e,), whose."""
    p, heading, phase = walk.position[k], walk.heading[k], walk.phase[k]
    ahead = np.stack([np.cos(heading), np.sin(heading)], 1)
    left = np.stack([-ahead[:, 1], ahead[:, 0]], 1)
    swing = np.sin(phase)[:, None]
    who = np.arange(walk.n_person)
    if height == "waist":
        centres = [p, p + 0.23 * left + 0.12 * swing * ahead, p - 0.23 * left - 0.12 * swing * ahead]
        axes = [(0.11, 0.165), (0.045, 0.045), (0.045, 0.045)]
    else:
        centres = [p + 0.09 * left - 0.22 * swing * ahead, p - 0.09 * left + 0.22 * swing * ahead]
        axes = [(0.06, 0.06), (0.06, 0.06)]
    n = len(who)
    return (
        np.concatenate(centres),
        np.repeat(np.array(axes), n, axis=0),
        np.tile(heading, len(axes)),
        np.tile(who, len(axes)),
    )


def cast(centres: Array, axes: Array, headings: Array, angles: Array) -> Array:
    """Ranges (n_beam,) from the origin along room bearings to the nearest ellipse or wall [m]."""
    rays = np.stack([np.cos(angles), np.sin(angles)], 1)  # (n, 2)
    with np.errstate(divide="ignore"):
        to_walls = np.minimum(
            np.where(rays[:, 1] > 1e-9, WALL_Y / rays[:, 1], np.inf), WALL_X / np.maximum(np.abs(rays[:, 0]), 1e-9)
        )
    if len(centres) == 0:
        return to_walls
    cos, sin = np.cos(headings), np.sin(headings)

    def local(v: Array) -> Array:  # (..., 2) with the ellipses in the axis before last, scaled to unit circles
        return np.stack([v[..., 0] * cos + v[..., 1] * sin, -v[..., 0] * sin + v[..., 1] * cos], -1) / axes

    direction, centre = local(rays[:, None]), local(centres)
    a = (direction**2).sum(-1)
    b = (direction * centre).sum(-1)
    c = (centre**2).sum(-1) - 1
    root = b * b - a * c
    hit = (root >= 0) & (b > 0)
    ranges = np.where(hit, (b - np.sqrt(np.where(hit, root, 0))) / a, np.inf)
    return np.minimum(ranges.min(axis=1), to_walls)


def scan(walk: Walk | None, k: int, height: str, stamp_ns: int, rng: np.random.Generator) -> LaserScan:
    """361 beams over 180°, σ 5 mm, 10 mm steps, 0.2 % lost beams; of the empty room where `walk` is None."""
    angles = -np.pi / 2 + np.deg2rad(0.5) * np.arange(361)
    ellipses = (np.empty((0, 2)), np.empty((0, 2)), np.empty(0)) if walk is None else body(walk, k, height)[:3]
    ranges = cast(*ellipses, angles + np.pi / 2)
    ranges = np.round(ranges + rng.normal(0, 0.005, ranges.size), 2)
    ranges[rng.random(ranges.size) < 0.002] = np.inf
    return LaserScan(height, stamp_ns, ranges.astype(np.float32), -np.pi / 2, float(np.deg2rad(0.5)), 0.02, 8.0)


def image(walk: Walk, k: int, stamp_ns: int, rng: np.random.Generator, shirts: Sequence[str]) -> Image:
    """People as painted upright ellipses: legs, shirt, head, far ones first, over a grey room, with pixel noise."""
    canvas = GREY_ROOM.copy()
    pose = camera_pose()
    p = walk.position[k]
    parts = ((0.0, 0.9, 0.15, (50, 55, 70)), (0.85, 1.48, 0.2, None), (1.5, 1.75, 0.09, (200, 160, 130)))
    for person in np.argsort(-np.hypot(p[:, 0], p[:, 1])):
        across = np.array([p[person, 1], -p[person, 0]]) / np.hypot(*p[person])
        for low, high, half_width, colour in parts:
            colour = SHIRTS[shirts[person]] if colour is None else colour
            sides = np.concatenate([np.full(9, -half_width), np.full(9, half_width)])
            heights = np.concatenate([np.linspace(low, high, 9), np.linspace(high, low, 9)])
            points = np.column_stack([p[person] + sides[:, None] * across, heights])
            pixels, _ = INTRINSICS.project((points - pose.translation) @ pose.rotation)
            cv2.fillPoly(canvas, [np.rint(pixels).astype(np.int32)], colour)
    noisy = cv2.add(canvas, rng.integers(-8, 9, canvas.shape, np.int16), dtype=cv2.CV_8U)
    return Image("camera", stamp_ns, noisy)


def empty_room(rng: np.random.Generator, n: int = 10) -> list[Observation]:
    """Scans of the room without people, of both scanners."""
    return [
        scan(None, 0, height, round(k * PERIOD_S * NS_PER_S), rng) for k in range(n) for height in ("waist", "knee")
    ]


def observe(
    walk: Walk, seed: int, images: bool = True, shirts: Sequence[str] = tuple(SHIRTS), t0: float = 1.0
) -> list[Observation]:
    """Everything the full rig reports of a walk, in order of arrival; of one walk the same objects each time."""
    return list(_observed(walk, seed, images, tuple(shirts), t0))


@lru_cache(maxsize=4)  # 30 MB each with pictures
def _observed(walk: Walk, seed: int, images: bool, shirts: tuple[str, ...], t0: float) -> tuple[Observation, ...]:
    rng = np.random.default_rng(seed)
    shirts = tuple(shirts[i % len(shirts)] for i in range(walk.n_person))
    observations: list[Observation] = []
    for k in range(len(walk)):
        stamp = round((t0 + k * PERIOD_S) * NS_PER_S)
        observations += [scan(walk, k, height, stamp, rng) for height in ("waist", "knee")]
        if images:
            observations.append(image(walk, k, stamp, rng, shirts))
    for each in observations:
        (each.rgb if isinstance(each, Image) else each.ranges_m).setflags(write=False)  # shared
    return tuple(observations)


@dataclass(frozen=True)
class Score:
    """How tracks compare with a walk, by assignment within 0.5 m that keeps last frame's pairs."""

    switches: int  # a person's track id changes
    misidentified: int  # a track goes on with another person
    misses: int
    false_positives: int
    error_m: float  # mean distance of matches
    n_id: int


def score(walk: Walk, frames: Sequence[TrackFrame], t0: float = 1.0, skip: int = 10) -> Score:
    """Compare frames with a walk, leaving out the first `skip` scans, in which nobody is confirmed yet."""
    by_scan = {round((frame.stamp_ns / NS_PER_S - t0) / PERIOD_S): frame for frame in frames}
    last_id: dict[int, int] = {}
    last_person: dict[int, int] = {}
    switches = misidentified = misses = false_positives = 0
    errors: list[float] = []
    ids: set[int] = set()
    for k in range(skip, len(walk)):
        tracks = by_scan[k].tracks if k in by_scan else ()
        ids |= {track.id for track in tracks}
        at = np.array([(track.x, track.y) for track in tracks]).reshape(-1, 2)
        apart = np.hypot(*np.moveaxis(walk.position[k][:, None] - at[None], -1, 0))
        kept = np.array([[last_id.get(i) == track.id for track in tracks] for i in range(walk.n_person)], bool)
        kept = kept.reshape(apart.shape)
        cost = np.where(apart < 0.5, apart - 10.0 * kept, 1e3)
        rows, columns = linear_sum_assignment(cost)
        pairs = [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if apart[i, j] < 0.5]
        misses += walk.n_person - len(pairs)
        false_positives += len(tracks) - len(pairs)
        for i, j in pairs:
            track_id = tracks[j].id
            errors.append(float(apart[i, j]))
            switches += last_id.get(i, track_id) != track_id
            misidentified += last_person.get(track_id, i) != i
            last_id[i] = track_id
            last_person[track_id] = i
    return Score(switches, misidentified, misses, false_positives, float(np.mean(errors or [np.nan])), len(ids))
