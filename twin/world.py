"""The world: the scene at any moment of the run, and the truth about it."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from trackers.area import Area
from trackers.observations import NS_PER_S
from twin.scenario import Scenario
from twin.scene import build_scene, populate
from twin.snapshot import Snapshot
from twin.truth import PersonTruth, TruthFrame
from twin.visibility import SensorView, visible_share

_OUT_OF_THE_ROOM_M = -100.0


class World:
    """A scene stepped on a clock: snapshots go forward in time and back by at most the people's short history."""

    def __init__(self, scenario: Scenario) -> None:
        self.scene = build_scene(scenario)
        self._area = Area(self.scene.area)
        self.population = populate(scenario, self.scene)
        self.data = mujoco.MjData(self.scene.model)
        self._ids = np.array([self.scene.ids[name] for name in self.scene.names], dtype=np.int16)
        self._posed_at: float | None = None

    def snapshot(self, t: float) -> Snapshot:
        """The world at time t [s] since the start; valid until the next snapshot is taken."""
        if t != self._posed_at:
            self.population.advance(t)
            self.data.qpos[self.scene.qpos_address] = self.population.qpos(t)
            self._update_poses()
            self._posed_at = t
        return Snapshot(t, self.scene.model, self.data, self.scene.person_of_geom)

    def empty_snapshot(self, t: float) -> Snapshot:
        """The room at time t before anybody entered: the people are taken far below the floor."""
        self.data.qpos[self.scene.qpos_address[:, 2]] = _OUT_OF_THE_ROOM_M
        self._update_poses()
        self._posed_at = None
        return Snapshot(t, self.scene.model, self.data, self.scene.person_of_geom)

    def _update_poses(self) -> None:
        mujoco.mj_kinematics(self.scene.model, self.data)
        mujoco.mj_camlight(self.scene.model, self.data)

    def truth(self, stamp_ns: int, views: Mapping[str, SensorView]) -> TruthFrame:
        """Where everybody truly is at a stamp, and how much of them each sensor can see."""
        t = stamp_ns / NS_PER_S
        snapshot = self.snapshot(t)
        scene, pose = self.scene, self.population.truth(t)
        head = self.data.site_xpos[scene.head_site]
        forward = self.data.site_xmat[scene.head_site].reshape(-1, 3, 3)[:, :, 0]
        points = self.data.site_xpos[scene.point_site]
        inside = self._area.contains(np.stack([pose.x, pose.y], axis=-1))
        shares = {name: visible_share(view, snapshot, points, self._ids) for name, view in views.items()}
        people = [
            PersonTruth(
                id=int(self._ids[place]),
                x=float(pose.x[place]),
                y=float(pose.y[place]),
                z=float(pose.z[place]),
                yaw=float(pose.yaw[place]),
                head_x=float(head[place, 0]),
                head_y=float(head[place, 1]),
                head_z=float(head[place, 2]),
                head_yaw=float(np.arctan2(forward[place, 1], forward[place, 0])),
                vx=float(pose.vx[place]),
                vy=float(pose.vy[place]),
                in_area=bool(inside[place]),
                visible={name: float(share[place]) for name, share in shares.items()},
            )
            for place in np.argsort(self._ids)
        ]
        return TruthFrame(stamp_ns, tuple(people))
