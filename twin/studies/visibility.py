"""Visibility of people and of the floor from each sensor: resolution on a target.

A scanner sees a body on which enough of its beams fall. A camera sees a point in its image and line of sight at enough
pixels per metre (EN 62676-4). Rows are samples of people in the tracked area, with the others as obstacles, or cells of the
floor at heights, in the empty room or once per sample.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from trackers.area import Area
from trackers.arrays import Array, Mask
from trackers.cameras import Intrinsics
from twin.instant.snapshot import Snapshot
from twin.scenario import Scenario
from twin.scenario.housings import in_the_room
from twin.scenario.sensor_descriptions import FloorDescription, LaserDescription
from twin.sensors.rays import RayFan, trace_rays
from twin.studies.spec import Coverage
from twin.truth.visibility import SensorView, first_hits, sensor_view
from twin.world.world import PrecomputedScene, World

_TRUNK_M, _LEGS_M, _TRUNK_FROM_M = 0.35, 0.2, 0.7
"""Width of a standing body where a scan meets it: of the trunk, and of two legs below that height [m]."""
_NUDGE_M = 0.01
_FEW = 0.02
"""Share of the area too small for a warning."""
VISITED_M = 0.5
"""A cell of the floor counts as visited within this distance of a person [m]."""
_SIGHTS = np.array([-2 / 3, 0.0, 2 / 3])
"""Offsets across a body at which beams are tested, as shares of its half width."""


@dataclass(frozen=True, eq=False)
class WorldSample:
    """World at one time: poses of geoms; of the people in the area ids (n,), heads (n, 3), points (n, k, 3) [m]."""

    scene: int  # index of the crowd's scene with these bodies
    geom_xpos: Array
    geom_xmat: Array
    ids: NDArray[np.int16]
    heads_m: Array
    points_m: Array


class SampledWorld:
    """Time samples of a scenario's people, and the empty room."""

    def __init__(self, scenario: Scenario, precomputed: PrecomputedScene | None, times_s: Sequence[float]) -> None:
        """Sample the world at ascending `times_s`; without any, only the empty room."""
        self.scenario = scenario
        world = World(scenario, precomputed, pictures=False)
        self.area = world.scene.area
        area, ids = Area(self.area), np.array([world.scene.ids[name] for name in world.scene.names], dtype=np.int16)
        self.samples: list[WorldSample] = []
        self._scenes: list[Snapshot] = []  # one per set of bodies, which changes as people come
        for t in times_s:
            snapshot = world.snapshot(t)
            if not self._scenes or snapshot.model is not self._scenes[-1].model:
                self._scenes.append(snapshot)
            bodies, data = world.scene.bodies, snapshot.data
            qpos, present = world.people.qpos(t), world.people.present(t)
            there = present & area.contains(qpos[:, :2])
            self.samples.append(
                WorldSample(
                    len(self._scenes) - 1, data.geom_xpos.copy(), data.geom_xmat.copy(), ids[there],
                    data.site_xpos[bodies.head_site[there]].copy(), data.site_xpos[bodies.point_site[there]].copy(),
                )
            )  # fmt: skip
        empty = world.empty_snapshot(0.0)
        self._scenes = [*self._scenes[:-1], empty]
        self._room = empty.data.geom_xpos.copy(), empty.data.geom_xmat.copy()

    def empty(self) -> Snapshot:
        """Return the room without people."""
        return self._snapshot(-1, *self._room)

    def at(self, sample: WorldSample) -> Snapshot:
        """Return the world at a sample, for rays only."""
        return self._snapshot(sample.scene, sample.geom_xpos, sample.geom_xmat)

    def _snapshot(self, scene: int, xpos: Array, xmat: Array) -> Snapshot:
        snapshot = self._scenes[scene]
        snapshot.data.geom_xpos[:], snapshot.data.geom_xmat[:] = xpos, xmat
        return snapshot

    @property
    def n_person_frame(self) -> int:
        """The number of rows of people."""
        return sum(len(sample.ids) for sample in self.samples)


class SensorVisibility:
    """The visibility of people and of cells of the floor from one scanner or camera."""

    _look: tuple[Array, NDArray[np.floating], Array, NDArray[np.intp]] | None = None  # of `_lookup`, for its last cells

    def __init__(self, scenario: Scenario, name: str, coverage: Coverage) -> None:
        description = in_the_room(scenario, name)
        rig = description.rig_sensor(name)
        view = sensor_view(rig, description)
        assert view is not None
        self.view: SensorView = view
        self._coverage = coverage
        self._fan: RayFan | None = None
        if isinstance(description, LaserDescription):
            half = np.deg2rad(description.field_of_view_deg) / 2
            self._angles = np.linspace(-half, half, description.n_beam)
            rotation = view.room_from_sensor_rotation
            rays = np.stack([np.cos(self._angles), np.sin(self._angles), np.zeros(description.n_beam)], axis=1)
            directions = np.ascontiguousarray(rays @ rotation.T)
            self._fan = RayFan(view.room_from_sensor_xyz, directions, rotation[:, 2].copy(), description.range_max_m)

    def people(self, sampled: SampledWorld) -> Mask:
        """Return the visible people over all samples, (n_person_frame,)."""
        visible = [self._bodies(sampled.at(sample), sample) for sample in sampled.samples if len(sample.ids)]
        return np.concatenate([np.zeros(0, dtype=bool), *visible])

    def floor(self, sampled: SampledWorld, cells_m: Array) -> Mask:
        """Return the visible cells (n, 2) [m], at each height and sample in turn: (n,), or more."""
        snapshots = (sampled.at(sample) for sample in sampled.samples) if sampled.samples else iter([sampled.empty()])
        return np.concatenate([(self.resolution(each, cells_m) >= self._wanted).reshape(-1) for each in snapshots])

    @property
    def _wanted(self) -> float:
        return float(self._coverage.beams) if self._fan is not None else self._coverage.px_per_m

    def resolution(self, snapshot: Snapshot, cells_m: Array) -> Array:
        """Return the beams on a body at each cell (1, n), or pixels per metre at each height there (h, n); 0: hidden."""
        if self._fan is not None:
            return self._beams_at(snapshot, cells_m)[None]
        heights = np.array(self._coverage.heights_m)
        points = np.concatenate([np.column_stack([cells_m, np.full(len(cells_m), z)]) for z in heights])
        local = (points - self.view.room_from_sensor_xyz) @ self.view.room_from_sensor_rotation
        sharp = self._px_per_m(local)
        free = sharp > 0
        gap_m = np.linalg.norm(local[free], axis=1)
        directions = (points[free] - self.view.room_from_sensor_xyz) / gap_m[:, None]
        geom, met_m = np.empty(len(gap_m), dtype=np.int32), np.empty(len(gap_m))
        if len(gap_m):
            trace_rays(snapshot, self.view.room_from_sensor_xyz, np.ascontiguousarray(directions), geom, met_m)
        sharp[free] = np.where((met_m < 0) | (met_m >= gap_m - _NUDGE_M), sharp[free], 0.0)
        return sharp.reshape(len(heights), -1)

    def _bodies(self, snapshot: Snapshot, sample: WorldSample) -> Mask:
        """Return the visible people of those in the area at a sample, (n,)."""
        if self._fan is not None:
            geom, _ = self._fan.trace(snapshot, slice(None))
            met = snapshot.person_of_geom[geom[geom >= 0]]
            counts = np.bincount(met, minlength=int(sample.ids.max()) + 1)
            return counts[sample.ids] >= self._coverage.beams
        head = self._coverage.target == "head"
        points = sample.heads_m[:, None] if head else sample.points_m
        _, met = first_hits(self.view, snapshot, points, sample.ids)
        local = (points - self.view.room_from_sensor_xyz) @ self.view.room_from_sensor_rotation
        sharp = self._px_per_m(local.reshape(-1, 3)).reshape(local.shape[:2]) >= self._coverage.px_per_m
        return ((met == sample.ids[:, None]) & sharp).mean(axis=1) >= 0.5

    def _px_per_m(self, local_m: Array) -> Array:
        """Return pixels per metre across the line of sight at points (n, 3) [m] in the camera's frame; 0 outside its picture."""
        lens = self.view.sees
        assert isinstance(lens, Intrinsics)
        pixels, shown = lens.project(local_m)
        found = np.zeros(len(local_m))
        ray = local_m[shown] / np.linalg.norm(local_m[shown], axis=1, keepdims=True)
        across = np.cross(ray, np.array([0.0, 1.0, 0.0]))
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
        nudged, _ = lens.project(local_m[shown] + _NUDGE_M * across)
        found[shown] = np.linalg.norm(nudged - pixels[shown], axis=1) / _NUDGE_M
        return found

    def _beams_at(self, snapshot: Snapshot, cells_m: Array) -> Array:
        """Count the unobstructed beams that would meet a body at each cell (n, 2) [m], (n,)."""
        assert self._fan is not None
        _, range_m = self._fan.trace(snapshot, slice(None))
        reach = np.where(range_m < 0, np.inf, range_m).astype(np.float32)
        if self._look is None or self._look[0] is not cells_m:
            self._look = cells_m, *self._lookup(cells_m)
        _, gap_m, bodies, beam = self._look
        return bodies * ((reach.take(beam) >= gap_m).sum(axis=0, dtype=np.uint8) / len(_SIGHTS))

    def _lookup(self, cells_m: Array) -> tuple[NDArray[np.floating], Array, NDArray[np.intp]]:
        """Return the distance (n,) [m] of cells, beams on a body there (n,), and the beams to test (3, n)."""
        view = self.view
        offset = (
            np.column_stack([cells_m, np.full(len(cells_m), view.room_from_sensor_xyz[2])]) - view.room_from_sensor_xyz
        )
        local = offset @ view.room_from_sensor_rotation
        gap_m = np.maximum(np.hypot(local[:, 0], local[:, 1]), 0.05)
        width = _TRUNK_M if view.room_from_sensor_xyz[2] >= _TRUNK_FROM_M else _LEGS_M
        half = np.arctan2(width / 2, gap_m)
        step = self._angles[1] - self._angles[0]
        place = (np.arctan2(local[:, 1], local[:, 0]) - self._angles[0]) / step
        in_field = (place >= -0.5) & (place <= len(self._angles) - 0.5) & (gap_m <= view.range_max_m)
        beam = np.clip(np.rint(place + _SIGHTS[:, None] * half / step), 0, len(self._angles) - 1).astype(np.intp)
        return gap_m.astype(np.float32), np.where(in_field, 2 * half / step, 0.0), beam


def floor_cells(area: Array, cell_m: float) -> Array:
    """Return the centres (n, 2) [m] of square cells in the tracked area (k, 2)."""
    low, high = area.min(axis=0), area.max(axis=0)
    axes = [np.arange(a + cell_m / 2, b, cell_m) for a, b in zip(low, high, strict=True)]
    cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    return cells[Area(area).contains(cells)]


def visited_cells(sampled: Sequence[SampledWorld], cells_m: Array) -> Mask:
    """Mark the cells (n, 2) [m] within `VISITED_M` of a person at any sample, (n,)."""
    places = [each.heads_m[:, :2] for world in sampled for each in world.samples]
    if not sum(map(len, places)):
        return np.zeros(len(cells_m), dtype=bool)
    gap_m, _ = cKDTree(np.concatenate(places)).query(cells_m, distance_upper_bound=VISITED_M)
    return np.isfinite(gap_m)


def saturation_hint(coverage: Coverage, n: int) -> str:
    """Return what to try where a placement covers all n targets, and coverage tells none of such placements apart."""
    if coverage.of == "people":
        return (
            f"coverage: every one of {n} person-frames is seen, as from any placement that is as good; to tell them apart try "
            f"`of: floor`, or more `samples` (now {coverage.samples})"
        )
    people = "" if coverage.samples else "people in the way (`samples`), "
    return (
        "coverage: every cell of the floor is seen, as from any placement that is as good; to tell them apart try "
        f"{people}more `beams` or `px_per_m`, or `at_least: {coverage.at_least + 1}`"
    )


def packed(visible: Mask) -> NDArray[np.uint64]:
    """Pack bits (..., n) into words (..., w), the last one filled with zeros."""
    padded = np.zeros((*visible.shape[:-1], -(-visible.shape[-1] // 64) * 64), dtype=bool)
    padded[..., : visible.shape[-1]] = visible
    return np.packbits(padded, axis=-1).view(np.uint64)


def is_scanner(scenario: Scenario, name: str) -> bool:
    """Return True for a scanner."""
    return isinstance(scenario.sensors[name], LaserDescription)


def looking_sensors(scenario: Scenario) -> list[str]:
    """Name the scanners and cameras."""
    return [name for name, each in scenario.sensors.items() if not isinstance(each, FloorDescription)]


def cell_size_m(area: Array, most_cells: int) -> float:
    """Return the side of a cell [m], 5 cm or more, at which about so many cover the box around the area."""
    return max(0.05, float(np.sqrt(np.prod(np.ptp(area, axis=0)) / most_cells)))


@dataclass(frozen=True, eq=False)
class FloorResolution:
    """Resolution on k cells of the empty room's floor, by scanner [beams on a body] and camera [px/m at greatest height].

    least: of each sensor, for a cell to be seen.
    """

    cells: Array  # (k, 2) [m]
    cell_m: float
    of_sensor: Mapping[str, Array]  # (k,)
    least: Mapping[str, float]

    @property
    def n_seeing(self) -> NDArray[np.intp]:
        """Number of sensors that see each cell, (k,)."""
        seen = np.zeros(len(self.cells), dtype=np.intp)
        for name, resolution in self.of_sensor.items():
            seen += resolution >= self.least[name]
        return seen

    def blind_warnings(self, scenario: Scenario) -> list[str]:
        """Return a warning for each sensor that sees no cell, with the reason."""
        found = []
        for name, resolution in self.of_sensor.items():
            best, least = float(resolution.max(initial=0.0)), self.least[name]
            unit, option = ("beams on a body", "--beams") if is_scanner(scenario, name) else ("px/m", "--px-per-m")
            if best == 0:
                found.append(f"{name} sees no place of the area: all is outside its view or hidden; see its mount")
            elif best < least:
                found.append(
                    f"{name} sees no place of the area with {least:g} {unit}: its best has {best:.3g} ({option}, a finer "
                    "sensor, or one nearer by)"
                )
        return found

    def unvisited_warning(self, visited: Mask, n_person_frame: int) -> str:
        """Return a warning about cells that no sensor sees and no person visited, (k,); "" for few."""
        blind_cells = self.n_seeing == 0
        missed = float((blind_cells & ~visited).mean())
        if missed <= _FEW:
            return ""
        blind_share, apart = f"{100 * blind_cells.mean():.1f} %", f"{100 * missed:.1f} %"
        met = np.any([each > 0 for each in self.of_sensor.values()], axis=0)
        causes = [
            ("hidden, or beyond every range and view", blind_cells & ~met),
            ("with too few beams or pixels", blind_cells & met),
        ]
        why = ", ".join(f"{100 * cells.mean():.1f} % {cause}" for cause, cells in causes if cells.any())
        rest = "none of it was" if blind_share == apart else f"{apart} of the area are unseen and were never"
        return (
            f"no sensor sees {blind_share} of the area ({why}); {rest} visited in the {n_person_frame} person-frames. Shares of "
            "person-frames leave that part out; shares of the floor count it"
        )

    def best_of_kind(self, scenario: Scenario) -> Iterator[tuple[bool, list[str], Array, float]]:
        """Yield scanners, then cameras, if any: whether scanners, names, the best resolution (k,), and the least."""
        for scanners in (True, False):
            names = [name for name in self.of_sensor if is_scanner(scenario, name) == scanners]
            if names:
                yield scanners, names, np.max([self.of_sensor[name] for name in names], axis=0), self.least[names[0]]


def floor_resolution(
    scenario: Scenario,
    sensors: Mapping[str, SensorVisibility],
    empty_room: Snapshot,
    area: Array,
    coverage: Coverage,
    most_cells: int,
) -> FloorResolution:
    """Compute the resolution of these sensors of a scenario on about so many cells of the area."""
    cell_m = cell_size_m(area, most_cells)
    cells = floor_cells(area, cell_m)
    return FloorResolution(
        cells,
        cell_m,
        {name: each.resolution(empty_room, cells)[-1] for name, each in sensors.items()},
        {name: float(coverage.beams) if is_scanner(scenario, name) else coverage.px_per_m for name in sensors},
    )
