"""Clusters of scans of drawn rooms, with the truth about each: a person's or not.

A room with people is drawn from a seed, and what low scanners take for legs is put into it: poles, posts, bins, bushes, and
legs of tables and chairs. Scanners of many kinds look at it from many places, heights and times.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from trackers.area import Area
from trackers.arrays import Array
from trackers.configuration import validate
from trackers.laser.clusters import Clusters
from trackers.laser.legs.features import cluster_features, leg_clusters, own_samples
from trackers.observations import LaserScan
from twin.drawn.draw_scene import draw_scene
from twin.instant.snapshot import Snapshot
from twin.scenario import Scenario
from twin.sensors.laser_noise import LaserNoise
from twin.sensors.rays import trace_rays
from twin.streams import stream
from twin.world.world import World

DURATION_S = 8.0
TIMES, PLACES = 9, 6
"""Times of a scene that are looked at, and scanners that look at each."""
_APART_M = 0.12
"""Clutter that comes nearer to a person is left out of that time [m]."""
_LOW_M = 0.8
"""Below this people's geoms are legs [m]."""
MOST_PEOPLE = 64
_LOOSE, _TROUSERS_M = 0.6, (0.05, 0.095)
"""Share of people in wide trousers, and their radius about the shank [m]."""
_STEEP = 2.0
"""Slope of a surface along the beam, by that across it, from which on echoes are lost: 63°."""
_HEIGHT_M = (0.18, 0.62)
_LEAST_M = 0.03
_MISSED_GROUP = 5
"""Group of geoms that rays pass."""
_LEAST_EXTENT_M = 0.04
"""Width of what is seen of a leg, below which it is a splinter [m]."""
_EDGE_M = 0.1
"""Larger steps of the range are edges."""
_KINDS = ("pole", "pair", "post", "bin", "trunk", "bush", "table", "chairs", "star", "plant", "wall", "trolley")
_TRIES = 40


@dataclass(frozen=True, eq=False)
class Samples:
    """k clusters: their features and whether they are a person's legs."""

    features: Array  # (k, features)
    is_leg: NDArray[np.bool_]  # (k,)
    middle: Array  # (k, 2) in the scanner's frame [m]
    scan: NDArray[np.intp]  # (k,) number of the scan


def samples_of(seed: int) -> Samples:
    """Draw the scene of a seed and look at it."""
    rng = stream(seed, "leg samples", "")
    with tempfile.TemporaryDirectory() as folder:
        world, area, is_wide = drawn_world(seed, Path(folder), rng)
    trousers_m = drawn_trousers_m(rng)
    features, is_leg, middle, number = [], [], [], []
    for t in np.linspace(0.5, DURATION_S - 0.5, TIMES):
        snapshot = of_legs(world.snapshot(float(t)))
        clutter = clutter_at(area, is_wide, rng, people_in(snapshot)[2])
        worn = worn_by(snapshot, trousers_m)
        for place in places_in(area, PLACES, rng):
            pose = np.array([[*place, rng.uniform(-np.pi, np.pi)]])
            scan, leg = scanned((snapshot, clutter, worn), Scanner.drawn(rng), pose, rng)
            clusters = leg_clusters(scan)
            if len(clusters) == 0:
                continue
            features.append(cluster_features(scan, clusters))
            is_leg.append(whole_legs(scan, clusters, leg))
            middle.append(clusters.middle)
            number.append(np.full(len(clusters), len(number)))
    return Samples(*(np.concatenate(each) for each in (features, is_leg, middle, number)))


def whole_legs(scan: LaserScan, clusters: Clusters, leg: NDArray[np.int16]) -> NDArray[np.bool_]:
    """Select the clusters that are most of what a scan shows of a leg: splinters beside it are none.

    leg: of each beam, 0: none.
    """
    beam = own_samples(scan, clusters)[0]
    rows = np.repeat(np.arange(len(clusters)), clusters.n_sample)
    count = np.zeros((len(clusters), int(leg.max(initial=0)) + 1), np.intp)
    np.add.at(count, (rows, leg[beam]), 1)
    main = count[:, 1:].argmax(axis=1) + 1 if count.shape[1] > 1 else np.zeros(len(clusters), np.intp)
    own = count[np.arange(len(clusters)), main]
    whole = count.sum(axis=0)[main]
    extent = clusters.n_sample * scan.angle_increment_rad * clusters.range_m
    return (main > 0) & (own > 0.5 * clusters.n_sample) & (own >= 0.5 * whole) & (extent >= _LEAST_EXTENT_M)


def drawn_trousers_m(rng: np.random.Generator) -> Array:
    """Draw the radius of the trousers of each person about the shank [m], 0: tight ones, as the twin's are."""
    return np.where(rng.random(MOST_PEOPLE) < _LOOSE, rng.uniform(*_TROUSERS_M, MOST_PEOPLE), 0.0)


def of_legs(snapshot: Snapshot) -> Snapshot:
    """Return the snapshot with the number of the leg in place of the person's: 2 id, and 2 id + 1 for the right one."""
    model, person = snapshot.model, snapshot.person_of_geom
    right = np.array(["/right_" in model.geom(geom).name for geom in range(model.ngeom)])
    return replace(snapshot, person_of_geom=np.where(person > 0, 2 * person + right, 0).astype(np.int16))


def people_in(snapshot: Snapshot) -> tuple[NDArray[np.int16], Array, Array]:
    """Return who is in a snapshot `of_legs`, the middles (p, 2) of their shanks, and their low geoms (g, 2) [m].

    The middle of both shanks is the place under the pelvis to a few centimetres.
    """
    owner, place = snapshot.person_of_geom, snapshot.data.geom_xpos
    there = _shanks(snapshot) & (place[:, 2] > -1)
    ids = np.unique(owner[there] // 2)
    middles = [place[there & (owner // 2 == each), :2].mean(axis=0) for each in ids]
    low = (owner > 0) & (place[:, 2] > 0) & (place[:, 2] < _LOW_M)
    return ids, np.reshape(middles, (-1, 2)), place[low, :2].copy()


def _shanks(snapshot: Snapshot) -> NDArray[np.bool_]:
    """Select the shanks of people, (n_geom,)."""
    found = np.zeros(snapshot.model.ngeom, np.bool_)
    for geom in np.flatnonzero(snapshot.person_of_geom > 0):
        found[geom] = snapshot.model.geom(geom).name.endswith("_shank")
    return found


def drawn_world(
    seed: int, folder: Path, rng: np.random.Generator, duration_s: float = DURATION_S
) -> tuple[World, Array, bool]:
    """Return a drawn room with people, the corners of where they walk, and whether it is as wide as a yard."""
    kept: list[str] = []

    def keep(name: str, mjcf: str) -> str:
        kept.append(mjcf)
        path = folder / f"{name}.xml"
        path.write_text(mjcf)
        return str(path)

    is_wide = bool(rng.random() < 0.4)
    room = {"kind": "drawn", "turned_deg": [-180, 180], "furniture_per_m2": [0.0, 0.12]}
    wide = {"length_m": [14, 26], "width_m": [10, 20], "rooms": [1, 2], "furniture_per_m2": [0.0, 0.02]}
    activities = {"wander": 4, "walk": 4, "stand": 3, "look": 0.5, "run": 0.3, "sit": 0.5}
    content = draw_scene(
        {
            "name": "legs", "seed": seed, "duration_s": duration_s, "room": room | wide if is_wide else room,
            "people": {"kind": "drawn", "count": [2, 12], "activities": activities, "arriving": 0, "leaving": 0},
            "sensors": {"laser": {"kind": "laser", "rate_hz": 1, "mount": {"xyz": [0, 0, 0.4]}}},
            "background": "none",
        },
        f"seed {seed}",
        keep,
    )  # fmt: skip
    words = kept[0].split('<numeric name="walkable_area" data="')[1].split('"')[0].split()
    area = np.array(words, float).reshape(-1, 2)
    return World(validate(Scenario, content, f"seed {seed}")), area, is_wide


def clutter_at(area: Array, is_wide: bool, rng: np.random.Generator, people: Array | None = None) -> Snapshot:
    """Draw clutter into the area as a scene of its own; pieces that people (n, 2) come near to [m] are left out."""
    scene = _compiled([geom for geom in _clutter(area, is_wide, rng)], [])
    if people is not None and len(people) and scene.model.ngeom:
        away, _ = cKDTree(people).query(scene.data.geom_xpos[:, :2])
        scene.model.geom_group[away < _APART_M + np.hypot(*scene.model.geom_size[:, :2].T)] = _MISSED_GROUP
    return scene


def worn_by(snapshot: Snapshot, radius_m: Array) -> Snapshot:
    """Dress the people of a snapshot `of_legs` in trousers, a cylinder about each shank, as a scene of its own."""
    data, quat, worn = snapshot.data, np.empty(4), []
    for geom in np.flatnonzero(_shanks(snapshot)):
        leg = int(snapshot.person_of_geom[geom])
        if radius_m[leg // 2] > 0:
            mujoco.mju_mat2Quat(quat, data.geom_xmat[geom])
            pos, turn = (" ".join(f"{each:.4f}" for each in values) for values in (data.geom_xpos[geom], quat))
            worn.append(
                (leg, f'<geom type="cylinder" size="{radius_m[leg // 2]:.3f} 0.22" pos="{pos}" quat="{turn}"/>')
            )
    return _compiled([geom for _, geom in worn], [leg for leg, _ in worn])


def _compiled(geoms: list[str], leg: list[int]) -> Snapshot:
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{' '.join(geoms)}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    person = np.zeros(model.ngeom, np.int16)
    person[: len(leg)] = leg
    return Snapshot(0.0, model, data, person)


def places_in(area: Array, count: int, rng: np.random.Generator) -> Array:
    """Draw places in the area [m]."""
    drawn = rng.uniform(area.min(axis=0), area.max(axis=0), (_TRIES * count, 2))
    return drawn[Area(area).contains(drawn)][:count]


def _clutter(area: Array, is_wide: bool, rng: np.random.Generator) -> Iterator[str]:
    """Draw poles, pairs of them, posts, bins, trunks, bushes, plants, legs of tables and chairs, walls and trolleys, as MJCF."""
    size = np.prod(area.max(axis=0) - area.min(axis=0))
    count = int(rng.uniform(0, 0.12 if is_wide else 0.25) * size)
    geom = '<geom type="{}" size="{}" pos="{:.3f} {:.3f} {:.3f}" euler="0 0 {:.1f}"/>'
    weights = rng.dirichlet(np.ones(len(_KINDS)))
    for x, y in places_in(area, count, rng):
        yaw, turn = rng.uniform(-180, 180), np.deg2rad(rng.uniform(-180, 180))
        match _KINDS[int(rng.choice(len(_KINDS), p=weights))]:
            case "pole":
                yield geom.format("cylinder", f"{rng.uniform(0.012, 0.1):.3f} 1", x, y, 1, 0)
            case "pair":
                apart, radius = rng.uniform(0.2, 0.9), rng.uniform(0.015, 0.08)
                for side in (-1, 1):
                    off = side * apart / 2 * _ahead(turn)
                    yield geom.format("cylinder", f"{radius:.3f} 0.6", x + off[0], y + off[1], 0.6, 0)
            case "post":
                yield geom.format("box", "{:.3f} {:.3f} 1".format(*rng.uniform(0.015, 0.15, 2)), x, y, 1, yaw)
            case "bin":
                yield geom.format("cylinder", f"{rng.uniform(0.1, 0.3):.3f} 0.5", x, y, 0.5, 0)
            case "trunk":
                yield geom.format("cylinder", f"{rng.uniform(0.06, 0.35):.3f} 1.2", x, y, 1.2, 0)
            case "bush":
                radius = rng.uniform(0.15, 0.9)
                for _ in range(int(rng.integers(6, 24))):
                    about, leaf = np.clip(rng.normal(0, radius / 2, 2), -1, 1), rng.uniform(0.02, 0.05 + radius / 5)
                    yield geom.format("sphere", f"{leaf:.3f}", x + about[0], y + about[1], rng.uniform(0.1, 0.7), 0)
            case "table":
                half, thick = rng.uniform(0.2, 0.9, 2), rng.uniform(0.008, 0.035)
                form = "cylinder" if rng.random() < 0.5 else "box"
                shape = f"{thick:.3f} 0.4" if form == "cylinder" else f"{thick:.3f} {thick:.3f} 0.4"
                for corner in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
                    off = _turned(np.array(corner) * half, turn)
                    yield geom.format(form, shape, x + off[0], y + off[1], 0.4, np.degrees(turn))
            case "chairs":  # in a row, as people leave them
                half, thick = rng.uniform(0.16, 0.25, 2), rng.uniform(0.008, 0.02)
                form = rng.choice(["cylinder", "box"])
                shape = f"{thick:.3f} 0.25" if form == "cylinder" else f"{thick:.3f} {thick:.3f} 0.25"
                for chair in range(int(rng.integers(1, 5))):
                    about = np.array([x, y]) + rng.normal(0, 0.05, 2) + chair * rng.uniform(0.5, 0.8) * _ahead(turn)
                    for corner in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
                        off = _turned(np.array(corner) * half, turn + rng.normal(0, 0.05))
                        yield geom.format(form, shape, *(about + off), 0.25, np.degrees(turn))
            case "star":  # the foot of a swivel chair, and its column
                yield geom.format("cylinder", f"{rng.uniform(0.02, 0.035):.3f} 0.25", x, y, 0.3, 0)
                reach = rng.uniform(0.22, 0.33)
                for spoke in range(5):
                    off = _turned(np.array([reach, 0.0]), turn + spoke * 2 * np.pi / 5)
                    yield geom.format("sphere", f"{rng.uniform(0.02, 0.05):.3f}", x + off[0], y + off[1], 0.12, 0)
            case "plant":  # stalks from a pot
                yield geom.format(
                    "cylinder", f"{rng.uniform(0.1, 0.22):.3f} {rng.uniform(0.08, 0.2):.3f}", x, y, 0.1, 0
                )
                for _ in range(int(rng.integers(2, 9))):
                    off = rng.normal(0, 0.1, 2)
                    yield geom.format("cylinder", f"{rng.uniform(0.005, 0.03):.3f} 0.5", x + off[0], y + off[1], 0.5, 0)
            case "wall":
                yield geom.format("box", f"{rng.uniform(0.2, 1.5):.3f} {rng.uniform(0.02, 0.2):.3f} 1", x, y, 1, yaw)
            case _:
                yield geom.format("box", "{:.3f} {:.3f} 0.45".format(*rng.uniform(0.15, 0.5, 2)), x, y, 0.55, yaw)


def _ahead(turn: float) -> Array:
    return np.array([np.cos(turn), np.sin(turn)])


def _turned(off: Array, turn: float) -> Array:
    return off[0] * _ahead(turn) + off[1] * _ahead(turn + np.pi / 2)


@dataclass(frozen=True)
class Scanner:
    """A kind of scanner, its height and tilt (slopes of its plane ahead and to the left), and its noise."""

    height_m: float
    tilt: tuple[float, float]
    step_rad: float
    span_rad: float
    range_max_m: float
    noise: LaserNoise
    grazing: float

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Scanner:
        """Draw one of the kinds that robots have."""
        noise = LaserNoise(
            sigma_m=float(np.exp(rng.uniform(np.log(0.001), np.log(0.015)))),
            sigma_per_m=float(rng.choice([0.0, 0.0005, 0.002])),
            quantisation_m=float(rng.choice([0.0, 0.001, 0.01])),
            dropout=float(rng.choice([0.0, 0.001, 0.01])),
            mixed_pixel=float(rng.uniform(0.0, 0.7)),
            divergence_deg=float(rng.uniform(0.2, 0.9)),
        )
        return cls(
            height_m=float(rng.uniform(*_HEIGHT_M)),
            tilt=(float(rng.normal(0, 0.01)), float(rng.normal(0, 0.01))),
            step_rad=float(np.deg2rad(rng.choice([0.25, 0.33, 0.352, 0.5, 0.5, 0.7, 1.0]))),
            span_rad=float(np.deg2rad(rng.choice([180.0, 240.0, 270.0, 360.0]))),
            range_max_m=float(rng.choice([5.6, 8.0, 10.0, 20.0, 30.0])),
            noise=noise,
            grazing=float(rng.uniform(0, 0.4)),
        )


def scanned(
    scenes: tuple[Snapshot, ...],
    scanner: Scanner,
    poses: Array,
    rng: np.random.Generator,
    stamp_ns: int = 0,
    sweep_s: float = 0.0,
) -> tuple[LaserScan, NDArray[np.int16]]:
    """Scan from poses (k, 3) in the room [m, rad], each for its part of the beams; return the leg of each beam, 0: none."""
    step = scanner.step_rad
    count = round(scanner.span_rad / step) + (scanner.span_rad < 6)
    angle = -scanner.span_rad / 2 + step * np.arange(count)
    slope = scanner.tilt[0] * np.cos(angle) + scanner.tilt[1] * np.sin(angle)
    distance, person = np.full(count, np.inf), np.zeros(count, np.int16)
    for (x, y, yaw), beams in zip(poses, np.array_split(np.arange(count), len(poses)), strict=True):
        rays = np.stack([np.cos(angle[beams] + yaw), np.sin(angle[beams] + yaw), slope[beams]], axis=1)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        origin = np.array([x, y, scanner.height_m])
        ahead, left = scanner.tilt
        normal = np.array([left * np.sin(yaw) - ahead * np.cos(yaw), -ahead * np.sin(yaw) - left * np.cos(yaw), 1.0])
        normal /= np.linalg.norm(normal)
        distance[beams], person[beams] = nearest(scenes, origin, rays, scanner.range_max_m, normal)
    distance[distance < _LEAST_M] = np.inf
    person[~np.isfinite(distance)] = 0
    ideal = LaserScan(
        "scan", stamp_ns, distance.astype(np.float32), float(angle[0]), step, _LEAST_M, scanner.range_max_m, sweep_s
    )
    return scanner.noise.corrupt(_without_grazing(ideal, scanner.grazing, rng), None, rng)[0], person


def nearest(
    scenes: tuple[Snapshot, ...], origin: Array, rays: Array, range_max_m: float, normal: Array | None = None
) -> tuple[Array, NDArray[np.int16]]:
    """Return how far rays (n, 3) come in several scenes [m], infinite for nothing met, and the leg that they meet, 0: none.

    normal: of the plane that they lie in.
    """
    distance, person = np.full(len(rays), np.inf), np.zeros(len(rays), np.int16)
    geom, found = np.empty(len(rays), np.int32), np.empty(len(rays))
    for scene in scenes:
        if scene.model.ngeom == 0:
            continue
        trace_rays(scene, origin, rays, geom, found, normal=normal, range_max_m=range_max_m)
        nearer = (geom >= 0) & (found < distance) & (found <= range_max_m)
        distance[nearer], person[nearer] = found[nearer], scene.person_of_geom[geom[nearer]]
    return distance, person


def _without_grazing(scan: LaserScan, share: float, rng: np.random.Generator) -> LaserScan:
    """Lose echoes of beams that graze a surface, which real scanners lose: by its slope from beam to beam, before noise."""
    ranges = np.where(np.isfinite(scan.ranges_m), scan.ranges_m, scan.range_max_m)
    step = np.abs(np.diff(ranges))
    steep = (step > _STEEP * scan.angle_increment_rad * ranges[1:]) & (step < _EDGE_M)
    steep = np.append(steep, False) | np.append(False, steep)
    lost = steep & (rng.random(ranges.size) < share)
    return replace(scan, ranges_m=np.where(lost, np.inf, scan.ranges_m).astype(np.float32))
