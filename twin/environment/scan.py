"""Tilting scanner on a tripod in the empty room: its stations and point cloud.

Suzuki et al. (2007) measure their room's shape beforehand with a SICK LMS200. A similar planar scanner, tilted by a tilt
unit, sees half of the sphere around it; turned about once more, the other half.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from trackers.area import Area
from trackers.arrays import Array
from trackers.configuration import Strict
from trackers.environment import PointCloud
from trackers.errors import InputError
from trackers.observations import LaserScan
from twin.instant.snapshot import Snapshot
from twin.messages import OnProgress, no_progress
from twin.people.crowd.crowd import planar
from twin.room.building import check_mount
from twin.room.obstacles import Footprints
from twin.sensors.laser_noise import LaserNoise
from twin.sensors.rays import trace_rays
from twin.streams import stream
from twin.world.scene import Scene

HEIGHT_M = 1.2
"""Height of the scanner's mirror on its tripod [m]."""


class TiltingScanner(Strict):
    """Planar scanner whose fan of beams is tilted about its own left-right axis, once for each heading of the tripod.

    A fan of 180 degrees tilted from straight down to straight up covers the half sphere ahead; two opposite headings cover
    all but what the tripod's legs hide. `tilt_sigma_deg` is the error of the tilt's encoder at each stop.

    Simplified: the scanner stops at each tilt, and the tripod's pose is known exactly.
    """

    beams: int = Field(default=361, ge=2, le=4000, description="beams of the fan")
    fan_deg: float = Field(default=180.0, gt=0, le=270, description="angle between the first beam and the last")
    tilt_deg: tuple[float, float] = Field(default=(-90.0, 90.0), description="lowest and highest tilt, up is positive")
    tilt_step_deg: float = Field(default=0.25, gt=0, le=10, description="between one tilt and the next")
    tilt_sigma_deg: float = Field(default=0.05, ge=0, le=5, description="standard deviation of the tilt's error")
    headings_deg: tuple[float, ...] = Field(default=(0.0, 180.0), min_length=1, description="how the tripod is turned")
    legs_deg: float = Field(
        default=75.0, gt=0, le=90, description="steeper beams below are hidden by the tripod's legs"
    )
    range_min_m: float = Field(default=0.1, ge=0, description="nothing nearer is measured")
    range_max_m: float = Field(default=32.0, gt=0, description="nothing farther is measured")

    @model_validator(mode="after")
    def _ranges_are_ranges(self) -> TiltingScanner:
        low, high = self.tilt_deg
        if not -90 <= low <= high <= 90:
            raise ValueError(f"tilt_deg: {low:g} to {high:g} is no range of tilts; two within -90 to 90 are expected")
        if self.range_min_m >= self.range_max_m:
            raise ValueError(
                f"range_min_m: {self.range_min_m:g} m is not below range_max_m, {self.range_max_m:g} m, as is expected"
            )
        return self


def scan_room(
    snapshot: Snapshot,
    stations_m: Array,
    noise: LaserNoise,
    seed: int,
    scanner: TiltingScanner | None = None,
    on_progress: OnProgress = no_progress,
) -> PointCloud:
    """Return the point cloud of the room in a snapshot from stations (s, 3) [m], each with its own random stream.

    Use the empty room's snapshot (`World.empty_snapshot`): people would become furniture.
    """
    scanner = scanner or TiltingScanner()
    points: list[Array] = []
    for number, place in enumerate(stations_m):
        on_progress("scanning the room", number, len(stations_m))
        rng = stream(seed, "environment scan", str(number))
        points.append(_scan_from(snapshot, np.asarray(place, dtype=float), noise, scanner, rng))
    station = np.repeat(np.arange(len(points), dtype=np.int16), [len(each) for each in points])
    return PointCloud(np.concatenate(points), station, np.array(stations_m, dtype=float))


def _scan_from(
    snapshot: Snapshot, place: Array, noise: LaserNoise, scanner: TiltingScanner, rng: np.random.Generator
) -> Array:
    """Return the points (n, 3) [m] measured from one station."""
    increment = np.deg2rad(scanner.fan_deg) / (scanner.beams - 1)
    bearing = increment * np.arange(scanner.beams) - np.deg2rad(scanner.fan_deg) / 2
    fan = np.stack([np.cos(bearing), np.sin(bearing), np.zeros(scanner.beams)], axis=-1)
    legs = -np.sin(np.deg2rad(scanner.legs_deg))
    found = []
    for heading in scanner.headings_deg:
        tilts = _tilts(scanner)
        errors = scanner.tilt_sigma_deg * rng.standard_normal(len(tilts))
        for said, true in zip(_rotations(heading, tilts), _rotations(heading, tilts + errors), strict=True):
            directions = np.ascontiguousarray(fan @ true.T)
            ranges = _measure_fan(snapshot, place, directions, true[:, 2], increment, noise, scanner, rng)
            seen = np.isfinite(ranges) & (directions[:, 2] > legs)
            found.append(place + ranges[seen, None] * (fan[seen] @ said.T))
    return np.concatenate(found)


def _measure_fan(
    snapshot: Snapshot,
    place: Array,
    directions: Array,
    normal: Array,
    increment: float,
    noise: LaserNoise,
    scanner: TiltingScanner,
    rng: np.random.Generator,
) -> Array:
    """Return the ranges (n,) [m] along the directions (n, 3) of one fan; not finite without a return."""
    geom, distance = np.empty(len(directions), dtype=np.int32), np.empty(len(directions))
    trace_rays(snapshot, place, directions, geom, distance, normal=normal, range_max_m=scanner.range_max_m)
    ranges = distance.astype(np.float32)
    ranges[distance < scanner.range_min_m] = np.nan
    ranges[(distance < 0) | (distance > scanner.range_max_m)] = np.inf
    if not noise.is_off:
        ideal = LaserScan("environment", 0, ranges, 0.0, increment, scanner.range_min_m, scanner.range_max_m)
        ranges = noise.corrupt(ideal, None, rng)[0].ranges_m
    return np.array(ranges, dtype=np.float64)


def _tilts(scanner: TiltingScanner) -> Array:
    """Return the tilts [deg] at which the scanner stops."""
    low, high = scanner.tilt_deg
    return low + scanner.tilt_step_deg * np.arange(
        int((high - low) / scanner.tilt_step_deg + 1e-9) + 1, dtype=np.float64
    )


def _rotations(heading_deg: float, tilts_deg: Sequence[float] | Array) -> Array:
    """Return the rotation from the scanner's frame (x ahead, y left, z up) to the room's at each tilt, (t, 3, 3)."""
    angles = np.deg2rad([(heading_deg, -tilt) for tilt in tilts_deg])  # pitch is positive down
    return Rotation.from_euler("ZY", angles).as_matrix()


_TRIPOD_M = 0.4
"""Reach of the tripod's feet from its middle [m]."""
_SPACING_M = 0.5
_MOST_CANDIDATES = 80
_MOST_STATIONS = 8
_WORTH_IT = 0.04
"""Least share of new cells that makes another station worthwhile."""
_CELL_M = 0.15
"""Small enough that rays from a far station miss most of them: only near stations see them well."""
_LOOK_RAYS = 8000
_LOOK_M = 30.0


def given_stations(places: Sequence[tuple[float, float, float]], scene: Scene, snapshot: Snapshot, field: str) -> Array:
    """Return the requested stations (s, 3) [m]; raises InputError, naming `field`, for one in objects or off the floor."""
    for place in places:
        x, y, z = place
        written = f"{field} {x:g},{y:g},{z:g}"
        if not np.isfinite(place).all() or not Area(scene.floor).contains(np.array([[x, y]]))[0]:
            low, high = scene.floor.min(axis=0), scene.floor.max(axis=0)
            raise InputError(
                f"{written}: is not over the room's floor; a place within x {low[0]:g} to {high[0]:g} m, "
                f"y {low[1]:g} to {high[1]:g} m is expected"
            )
        if z <= 0:
            raise InputError(f"{written}: is not above the floor; a height above 0 m is expected")
        check_mount(snapshot.model, snapshot.data, written, np.array(place))
        if (_look(snapshot, np.array(place))[0] >= 0).mean() < 0.2:
            raise InputError(f"{written}: sees next to nothing of the room; a place between its walls is expected")
    return np.array(places, dtype=float).reshape(-1, 3)


def chosen_stations(scene: Scene, snapshot: Snapshot) -> Array:
    """Choose up to eight free places (s, 3) [m] for the tripod, each adding the most visible cells.

    Candidates over the walkable area are compared by a coarse scan (next best view, Connolly 1985, by greedy cover). Raises
    InputError without room for a tripod.
    """
    places = _candidates(scene, snapshot, HEIGHT_M)
    seen = [_cells_seen(snapshot, place) for place in places]
    chosen: list[int] = []
    covered: set[int] = set()
    while len(chosen) < _MOST_STATIONS:
        gains = [len(cells - covered) for cells in seen]
        best = int(np.argmax(gains))
        if chosen and gains[best] < _WORTH_IT * len(covered):
            break
        chosen.append(best)
        covered |= seen[best]
    return places[chosen]


def _candidates(scene: Scene, snapshot: Snapshot, height_m: float) -> Array:
    """Return places (c, 3) [m] on a square grid over the walkable area where a tripod can stand."""
    area = scene.walkable
    low, high = area.min(axis=0), area.max(axis=0)
    spacing = max(_SPACING_M, float(np.sqrt((high - low).prod() / _MOST_CANDIDATES)))
    ticks = [np.arange(low[axis] + spacing / 2, high[axis], spacing) for axis in (0, 1)]
    grid = np.stack(np.meshgrid(*ticks), axis=-1).reshape(-1, 2)
    grid = grid[Area(area).contains(grid)]
    obstacles = scene.ground.obstacles
    if len(obstacles) and len(grid):
        grid = grid[Footprints(obstacles).gaps(planar(grid))[1].min(axis=1) >= _TRIPOD_M]
    free = [place for place in np.column_stack([grid, np.full(len(grid), height_m)]) if _is_free(snapshot, place)]
    if not free:
        raise InputError(
            f"--station: furniture leaves no place {_TRIPOD_M:g} m clear of everything for the scanner's tripod; a place "
            "as X,Y,Z [m] is expected"
        )
    return np.array(free)


def _is_free(snapshot: Snapshot, place: Array) -> bool:
    try:
        check_mount(snapshot.model, snapshot.data, "", place)
    except InputError:
        return False
    return True


def _cells_seen(snapshot: Snapshot, place: Array) -> set[int]:
    """Return the cells hit by a coarse scan from a place."""
    distance, directions = _look(snapshot, place)
    met = distance >= 0
    cell = np.floor((place + distance[met, None] * directions[met]) / _CELL_M).astype(np.int64) + 2**15
    return set(((cell[:, 0] << 40) + (cell[:, 1] << 20) + cell[:, 2]).tolist())


def _look(snapshot: Snapshot, place: Array) -> tuple[Array, Array]:
    """Return distances (n,) [m], -1 for none, along directions (n, 3) spread evenly over the sphere (a golden spiral)."""
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(_LOOK_RAYS)
    up = 1 - (2 * np.arange(_LOOK_RAYS) + 1) / _LOOK_RAYS
    flat = np.sqrt(1 - up**2)
    directions = np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=-1)
    geom, distance = np.empty(_LOOK_RAYS, dtype=np.int32), np.empty(_LOOK_RAYS)
    trace_rays(snapshot, place, directions, geom, distance, range_max_m=_LOOK_M)
    return distance, directions
