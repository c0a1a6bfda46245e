"""A small room with capsule people, and a world of it in which they walk: no scenario, no people package needed."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np

from twin.instant.snapshot import Snapshot

ROOM = """
<mujoco>
  <statistic extent="8" center="0 2 1"/>
  <visual><headlight active="0"/><quality shadowsize="0"/><map znear="0.005" zfar="10"/></visual>
  <worldbody>
    <light type="directional" pos="0 2 2.9" dir="0.2 0.5 -1" diffuse="0.5 0.5 0.5" ambient="0.3 0.3 0.3"/>
    <geom name="floor" type="plane" size="5 5 0.1" rgba="0.6 0.5 0.4 1"/>
    <geom name="back" type="box" pos="0 4 1.5" size="4 0.05 1.5" rgba="0.8 0.3 0.3 1"/>
    <geom name="right" type="box" pos="4 2 1.5" size="0.05 2.2 1.5" rgba="0.3 0.8 0.3 1"/>
    <geom name="left" type="box" pos="-4 2 1.5" size="0.05 2.2 1.5" rgba="0.3 0.3 0.8 1"/>
    <geom name="ceiling" type="box" pos="0 2 3.05" size="4 2.2 0.05" rgba="0.9 0.9 0.9 1"/>
    {people}
  </worldbody>
</mujoco>
"""

_PERSON = """
<body name="person{id}" mocap="true" pos="{x} {y} 0">
  <site name="site{id}" size="0.3" pos="0 0 1" rgba="1 0 1 1"/>
  <geom type="capsule" fromto="0 0 1.0 0 0 1.35" size="0.15" rgba="{rgb} 1"/>
  <geom type="sphere" pos="0 0 1.62" size="0.11" rgba="{rgb} 1"/>
  <geom type="capsule" fromto="0.1 0 0.9 0.1 0 0.07" size="0.07" rgba="{rgb} 1"/>
  <geom type="capsule" fromto="-0.1 0 0.9 -0.1 0 0.07" size="0.07" rgba="{rgb} 1"/>
  <geom type="capsule" fromto="0.2 0 1.35 0.25 0.1 0.85" size="0.045" rgba="{rgb} 1"/>
  <geom type="ellipsoid" pos="-0.25 0 1.1" size="0.05 0.06 0.3" rgba="{rgb} 1"/>
</body>
"""

PLACES = {1: (-1.5, 1.0), 2: (-0.4, 2.0), 3: (0.7, 1.0), 4: (2.0, 1.8), 5: (2.5, 0.4)}


@dataclass(eq=False)
class CapsuleWorld:
    """People who walk along x at 1 m/s in a box; `taken` lists the times asked for."""

    model: mujoco.MjModel
    speed: float = 1.0
    taken: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.data = mujoco.MjData(self.model)
        owner = np.zeros(self.model.nbody, dtype=np.int16)
        for body in range(self.model.nbody):
            name = self.model.body(body).name
            owner[body] = int(name.removeprefix("person")) if name.startswith("person") else 0
        self.person_of_geom = owner[self.model.geom_bodyid]
        self._start = self.data.mocap_pos.copy()

    def snapshot(self, t: float) -> Snapshot:
        self.taken.append(t)
        self.data.mocap_pos[:, 0] = self._start[:, 0] + self.speed * t
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        return Snapshot(t, self.model, self.data, self.person_of_geom)


def capsule_model(places: dict[int, tuple[float, float]] | None = None, room: str = ROOM) -> mujoco.MjModel:
    colours = ["1 1 1", "0.1 0.1 0.1", "1 0.4 0.7", "0.2 0.2 1", "0.6 0.1 0.7"]
    people = "".join(
        _PERSON.format(id=number, x=x, y=y, rgb=colours[(number - 1) % 5])
        for number, (x, y) in (PLACES if places is None else places).items()
    )
    return mujoco.MjModel.from_xml_string(room.format(people=people))
