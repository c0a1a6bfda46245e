"""The environment scan: how near its walls and tops are to the room's, and what a tracker's questions cost."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from benchmarks.figure import Figure, median_s
from trackers.configuration import validate
from trackers.environment import Environment, build_environment
from twin.environment.run import scan_scenario
from twin.instant.snapshot import Snapshot
from twin.scenario import Scenario
from twin.sensors.rays import trace_rays

_POINTS = 2000
_TOPS = {
    "lab": ("desk_top",),
    "sensing_room": ("table_top", "dresser_top"),
    "meeting_room": ("table_left_top", "table_right_top"),
}


def measure() -> Iterator[Figure]:
    """Scan three rooms with the default noise; compare with the rooms' own geometry; time the queries."""
    worst_wall, worst_top, missed, environment = 0.0, 0.0, 0, None
    for room, tops in _TOPS.items():
        start = time.process_time()
        cloud, world = scan_scenario(_scenario(room))
        scanned = time.process_time()
        environment = build_environment(cloud, room=room)
        built = time.process_time()
        snapshot = world.empty_snapshot(0.0)
        gaps = _wall_gaps(environment, snapshot)
        missed += int((~np.isfinite(gaps)).sum()) + abs(len(environment.walls_m) - len(gaps))
        worst_wall = max(worst_wall, float(gaps[np.isfinite(gaps)].max()))
        worst_top = max([worst_top, *(_top_gap(environment, snapshot, name) for name in tops)])
        yield Figure(f"{room}: {len(cloud.points_m) / 1e6:.2f} million points scanned", scanned - start, "s CPU", "")
        yield Figure(f"{room}: environment of them", built - scanned, "s CPU", "")
    yield Figure("walls of three rooms, worst end off its wall", 100 * worst_wall, "cm", "<= 2")
    yield Figure("walls missed or invented in three rooms", missed, "", "<= 0")
    yield Figure("tops of tables and dresser, worst median error", 100 * worst_top, "cm", "<= 3")
    assert environment is not None
    yield from _queries(environment)


def _queries(environment: Environment) -> Iterator[Figure]:
    low, high = environment.grid.origin_m, environment.grid.upper_m
    points = np.random.default_rng(0).uniform(low, high, (_POINTS, 3))
    camera = np.array([low[0] + 0.3, low[1] + 0.3, 2.4])
    start = time.perf_counter()
    environment.distance_to_surface(points)
    yield Figure("first question to an environment", time.perf_counter() - start, "s", "")
    queries: dict[str, Callable[[], Any]] = {
        "is_free": lambda: environment.is_free(points),
        "distance_to_surface": lambda: environment.distance_to_surface(points),
        "height_under": lambda: environment.height_under(points),
        "head_weight": lambda: environment.head_weight(points),
        "visible": lambda: environment.visible(camera, points),
    }
    for name, query in queries.items():
        yield Figure(f"{name} of {_POINTS} points", 1e3 * median_s(query), "ms", "<= 1")


def _wall_gaps(environment: Environment, snapshot: Snapshot) -> np.ndarray:
    """For each plane of the room named wall_*, how far the nearest wall found has an end off it [m]; inf: none within 0.2."""
    model, data = snapshot.model, snapshot.data
    gaps = []
    for geom in range(model.ngeom):
        if model.geom(geom).name.startswith("wall_"):
            normal = data.geom_xmat[geom].reshape(3, 3)[:2, 2]
            off = np.abs((environment.walls_m - data.geom_xpos[geom, :2]) @ normal).max(axis=1)
            gaps.append(off.min() if off.min() < 0.2 else np.inf)
    return np.array(gaps)


def _top_gap(environment: Environment, snapshot: Snapshot, name: str) -> float:
    """Median error [m] of the height over a box of the room, where nothing stands on it."""
    model, data = snapshot.model, snapshot.data
    geom = model.geom(name).id
    half = model.geom_size[geom]
    x, y = np.meshgrid(*(np.linspace(-size + 0.04, size - 0.04, 25) for size in half[:2]))
    places = np.stack([x.ravel(), y.ravel(), np.full(x.size, half[2])], axis=-1)
    places = data.geom_xpos[geom] + places @ data.geom_xmat[geom].reshape(3, 3).T
    seen = np.array([_first_below(snapshot, place) == geom for place in places])
    return float(np.nanmedian(np.abs(environment.height_under(places[seen]) - places[seen, 2])))


def _first_below(snapshot: Snapshot, place: np.ndarray) -> int:
    """The geom that a ray from 1 m above a place meets first."""
    geom, distance = np.empty(1, dtype=np.int32), np.empty(1)
    trace_rays(snapshot, place + np.array([0.0, 0.0, 1.0]), np.array([[0.0, 0.0, -1.0]]), geom, distance)
    return int(geom[0])


def _scenario(room: str) -> Scenario:
    sensors = {"low": {"kind": "laser", "rate_hz": 10, "mount": {"xyz": [0, 0, 0.4]}}}
    content = {"name": "bench", "room": room, "duration_s": 1, "people": {}, "sensors": sensors}
    return validate(Scenario, content, "benchmark")
