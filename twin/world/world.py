"""The world: the scene at any time of the run, and the truth about it; and what serves many worlds in one process.

Motion of people is computed once for scenarios that share it. The C library keeps the space of large images between small
live objects; over many runs in one process that grew to gigabytes, so freed memory is returned to the system.
"""

from __future__ import annotations

import copy
import ctypes
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.area import Area
from trackers.arrays import Array
from trackers.observations import NS_PER_S
from twin.instant.snapshot import Feet, Snapshot, base_body
from twin.people.population import Population, randomized
from twin.people.poses import PopulationMotion, Poses
from twin.room.mjcf import Lighting
from twin.scenario import Scenario
from twin.scenario.housings import driven
from twin.truth.truth_types import FootTruth, PersonTruth, TruthFrame
from twin.truth.visibility import SensorView, visible_share
from twin.world.body_pool import body_pools
from twin.world.scene import Scene, build_scene, populate, precomputed_poses

LONGEST_LOOK_S = 1.0
"""Time by which a motion exceeds the scenario's end, for sweeps and exposures started before [s]."""


class PoseCache:
    """Poses of people's geoms at the times of scans, for scanners with the same times.

    Rays need nothing else: joints, soles, cameras and lights are not kept.
    """

    def __init__(self, person_of_geom: NDArray[np.int16]) -> None:
        self._geoms = np.flatnonzero(person_of_geom > 0)
        self.places: dict[float, tuple[Array, Array]] = {}

    def store(self, t: float, data: mujoco.MjData) -> None:
        """Store the present poses as those of time t [s]."""
        self.places[t] = data.geom_xpos[self._geoms].copy(), data.geom_xmat[self._geoms].copy()

    def restore(self, t: float, data: mujoco.MjData) -> None:
        """Restore the poses of time t [s]."""
        data.geom_xpos[self._geoms], data.geom_xmat[self._geoms] = self.places[t]


@dataclass(frozen=True, eq=False)
class PrecomputedScene:
    """Compiled initial scene of a scenario, and its people's motion; for scenarios with the same people.

    late: a description of each person who had not arrived at the end.
    """

    scene: Scene
    motion: PopulationMotion
    late: tuple[str, ...] = ()

    @classmethod
    def of(cls, scenario: Scenario, motion: PopulationMotion, late: Sequence[str] = ()) -> PrecomputedScene:
        """Build the scene of the scenario's people. Raises InputError as `build_scene` does."""
        return cls(build_scene(randomized(scenario)), motion, tuple(late))

    def scene_for(self, scenario: Scenario) -> Scene:
        """Return the scene for one world, with its own model if the world changes its light."""
        if not scenario.lights:
            return self.scene
        return replace(self.scene, bodies=replace(self.scene.bodies, model=copy.copy(self.scene.model)))


def precompute_people(scenario: Scenario) -> tuple[PopulationMotion, list[str]]:
    """Step a scenario's people to its end; return their motion, and a description of each person who has not arrived.

    Raises InputError as `build_scene` does.
    """
    scenario = randomized(scenario)
    people = populate(scenario, build_scene(scenario, pictures=False))
    return people.motion(scenario.duration_s + LONGEST_LOOK_S), people.late()


_OUT_OF_THE_ROOM_M = -100.0
_SIDES: tuple[Literal["left"], Literal["right"]] = ("left", "right")

CellsOfFeet = Callable[[Feet], Sequence[tuple[tuple[int, ...], tuple[int, ...]]]]
"""Function of a floor: the cells loaded by the left and right foot of each person."""


class World:
    """Scene stepped on a clock: snapshots go forward in time, and back by at most the people's short history."""

    def __init__(
        self, scenario: Scenario, precomputed: PrecomputedScene | None = None, *, pictures: bool = True
    ) -> None:
        """`precomputed`: the scenario's people with bodies and motion; None: they are made and stepped here.

        `pictures`: False for a world that is never drawn (see `build_scene`).
        """
        self._scenario = scenario = randomized(scenario)
        if driven(scenario):
            precomputed = None  # people and bases make way for each other: both are stepped
        if precomputed is not None:
            self.scene = precomputed.scene_for(scenario)
        else:
            self.scene = build_scene(scenario, pictures=pictures)
        """Scene with the bodies of people present now or shortly before; replaced as others come."""
        self._pools = body_pools(scenario.people)
        self._pool = self._pools[0]
        self._area = Area(self.scene.area)
        self.people: Poses = (
            precomputed_poses(self.scene, precomputed.motion)
            if precomputed is not None
            else populate(scenario, self.scene)
        )
        self._late = () if precomputed is None else precomputed.late
        self.data = mujoco.MjData(self.scene.model)
        self._lighting = self._lit()
        self._ids = np.array([self.scene.ids[name] for name in self.scene.names], dtype=np.int16)
        self._pose_time: float | None = None
        self.pose_cache: PoseCache | None = None
        """Cached poses for rays, for worlds with scanners only; unused where bases drive, which it does not hold."""
        self._feet: Feet | None = None
        self._bases: dict[str, Array] = {}
        self._ahead = frozenset[float]()
        self._met: dict[tuple[str, int], NDArray[np.int16]] = {}

    @property
    def population(self) -> Population:
        """People stepped here; raises in a precomputed world."""
        assert isinstance(self.people, Population), "people who move as before have no scripts"
        return self.people

    def late(self) -> list[str]:
        """Describe people who have not arrived in twice the time that their way takes, at the latest time shown."""
        return self.people.late() if isinstance(self.people, Population) else list(self._late)

    def snapshot(self, t: float) -> Snapshot:
        """Pose the world at time t [s] since the start; valid until the next snapshot is taken."""
        self._embody(t)
        cache = None if driven(self._scenario) else self.pose_cache
        if t != self._pose_time and cache is not None and t in cache.places:
            cache.restore(t, self.data)
            self._pose_time, self._feet = t, None
        if t != self._pose_time:
            self.people.advance(t)
            qpos, present, bodies = self.people.qpos(t), self.people.present(t), self.scene.bodies
            assert not np.count_nonzero(present & ~bodies.there), "each person in the room has a body"
            qpos[~present, 2] = _OUT_OF_THE_ROOM_M
            self.data.qpos[bodies.qpos_address[bodies.there]] = qpos[bodies.there]
            self._place_bases(t)
            self._update_poses()
            self._lighting.apply(t)
            self._pose_time = t
            self._feet = self.people.feet(t)
            if cache is not None:
                cache.store(t, self.data)
        return Snapshot(t, self.scene.model, self.data, self.scene.person_of_geom, self._feet, self._bases)

    def prepare(self, times: Sequence[float]) -> bool:
        """Step the people to the last of the times [s] at which snapshots are taken next, in this order.

        Return whether the truth of all may be worked out before: no others have bodies then.
        """
        if self.pose_cache is not None:
            return False
        self.people.prepare(times)
        self._ahead, self._met = frozenset(times), {}
        return self._pool.covers(times[0]) and self._pool.covers(times[-1])

    def empty_snapshot(self, t: float) -> Snapshot:
        """Pose the empty room at time t: the people are moved far below the floor.

        Its light is that of the scenario's start, with only the changes at 0 s.
        """
        bodies = self.scene.bodies
        self.data.qpos[bodies.qpos_address[bodies.there, 2]] = _OUT_OF_THE_ROOM_M
        self.data.mocap_pos[list(self._mocap_of_bases().values()), 2] = _OUT_OF_THE_ROOM_M
        self._update_poses()
        self._lighting.apply(t, until_s=0.0)
        self._pose_time = None
        return Snapshot(t, self.scene.model, self.data, self.scene.person_of_geom)

    def _place_bases(self, t: float) -> None:
        """Put the bodies of housings that drive where they are at time t [s]."""
        bases = self.people.bases if isinstance(self.people, Population) else None
        if bases is None:
            return
        self._bases = bases.at(t)
        for name, mocap in self._mocap_of_bases().items():
            pose = self._bases[name]
            self.data.mocap_pos[mocap] = pose[:3, 3]
            half = 0.5 * np.arctan2(pose[1, 0], pose[0, 0])
            self.data.mocap_quat[mocap] = np.cos(half), 0.0, 0.0, np.sin(half)

    def _mocap_of_bases(self) -> dict[str, int]:
        """Return the number of each base's body among the bodies that are placed, by name; bases without one are left out."""
        model = self.scene.model
        bodies = {
            name: mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, base_body(name)) for name in driven(self._scenario)
        }
        return {name: int(model.body_mocapid[body]) for name, body in bodies.items() if body >= 0}

    def _embody(self, t: float) -> None:
        """Give bodies to the people in the room at time t [s], in a new model if some have none."""
        if self._pool.covers(t):
            return
        self._pool = next(pool for pool in self._pools if t < pool.until_s)
        self.scene = self.scene.with_bodies(self._pool.names)
        self.data = mujoco.MjData(self.scene.model)
        self._lighting = self._lit()
        self._pose_time = None

    def _lit(self) -> Lighting:
        return Lighting(self.scene.model, self._scenario.lights, self._scenario.source)

    def _update_poses(self) -> None:
        mujoco.mj_kinematics(self.scene.model, self.data)
        mujoco.mj_camlight(self.scene.model, self.data)

    def truth(
        self,
        stamp_ns: int,
        views: Mapping[str, SensorView],
        floors: Mapping[str, CellsOfFeet] | None = None,
        *,
        with_feet: bool = True,
    ) -> TruthFrame:
        """Return the truth at a stamp: positions of all people in the room, and their visibility to each sensor.

        `floors`: the floor sensors at this stamp, each as a function to the cells of each foot. Without `with_feet` feet are
        omitted.
        """
        t = stamp_ns / NS_PER_S
        snapshot = self.snapshot(t)
        scene, pose = self.scene, self.people.truth(t)
        head = self.data.site_xpos[scene.bodies.head_site]
        forward = self.data.site_xmat[scene.bodies.head_site].reshape(-1, 3, 3)[:, :, 0]
        points = self.data.site_xpos[scene.bodies.point_site]
        inside = self._area.contains(np.stack([pose.x, pose.y], axis=-1))
        there = pose.present
        shares = {name: np.zeros(len(there)) for name in views}
        if t not in self._ahead:
            self._met = {}
        for name, view in views.items():
            met = np.full(points.shape[:2], -1, dtype=np.int16)
            shares[name][there], met[there] = visible_share(
                view.at(snapshot), snapshot, points[there], self._ids[there]
            )
            self._met[name, stamp_ns] = met
        feet = self._feet_truth(snapshot, floors or {}) if with_feet else [()] * len(there)
        head_yaw = np.arctan2(forward[:, 1], forward[:, 0])
        numbers = (pose.x, pose.y, pose.z, pose.yaw, *head.T, head_yaw, pose.vx, pose.vy, inside)
        columns = [each.tolist() for each in (self._ids, *numbers, *shares.values())]
        rows = list(zip(*columns, strict=True))
        people = [
            PersonTruth(*rows[place][:12], visible=dict(zip(shares, rows[place][12:], strict=True)), feet=feet[place])
            for place in np.argsort(self._ids).tolist()
            if there[place]
        ]
        return TruthFrame(stamp_ns, tuple(people))

    def met(self, sensor: str, stamp_ns: int) -> NDArray[np.int16] | None:
        """Return whom rays from a sensor to each person's points meet (n_people, n_point), if its truth was asked for last, or
        since the last `prepare`.

        Ids as of `first_hits`, people ordered by name; None for another stamp, and where the truth is without shares.
        """
        return self._met.get((sensor, stamp_ns))

    @staticmethod
    def _feet_truth(snapshot: Snapshot, floors: Mapping[str, CellsOfFeet]) -> list[tuple[FootTruth, FootTruth]]:
        """Return both feet of all people, in the order of names."""
        feet = snapshot.feet
        assert feet is not None, "a snapshot of the room with its people has their feet"
        cells = {name: cells_of(feet) for name, cells_of in floors.items()}
        alone = [feet.height[..., None], feet.yaw[..., None], feet.load_n[..., None]]
        numbers = np.concatenate([feet.place, *alone, feet.pressure_point], axis=-1).tolist()  # (n, 2, 7)

        def foot(person: int, side: int) -> FootTruth:
            loaded = {name: of_feet[person][side] for name, of_feet in cells.items()}
            carries = feet.load_n[person, side] > 0
            return FootTruth(_SIDES[side], *numbers[person][side][: None if carries else 5], cells=loaded)

        return [(foot(person, 0), foot(person, 1)) for person in range(len(numbers))]


def trim_heap() -> None:
    """Return freed memory to the system, if the C library can (glibc)."""
    if (trim := _malloc_trim()) is not None:
        trim(0)


@contextmanager
def heap_trimmed() -> Iterator[None]:
    """Trim the heap at the end of the block."""
    try:
        yield
    finally:
        trim_heap()


@cache
def _malloc_trim() -> Any:
    """Return the function of the C library; None if missing: musl, macOS."""
    return getattr(ctypes.CDLL(None), "malloc_trim", None)
