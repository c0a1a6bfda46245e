"""Gaps between bodies, against places known by hand and against an exact but slow computation."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from twin.geometry.geom_hull import hull_points
from twin.scenario import load_scenario
from twin.truth.body_outlines import BodyOutlines
from twin.world.scene import Scene
from twin.world.world import World

POSTS = """
<mujoco><worldbody>
  <body name="round" pos="0 0 0"><freejoint/><geom type="cylinder" size="0.2 0.8"/></body>
  <body name="square" pos="1 0 0"><freejoint/>
    <geom type="box" size="0.15 0.15 0.8"/><geom type="sphere" pos="0 0 0.9" size="0.1" group="4"/>
    <geom type="box" pos="-0.3 0 0" size="0.3 0.01 0.01" group="4"/>
  </body>
</worldbody></mujoco>
"""


def posts(x: float, y: float, turn_rad: float = 0.0) -> tuple[mujoco.MjData, BodyOutlines]:
    model = mujoco.MjModel.from_xml_string(POSTS)
    data = mujoco.MjData(model)
    data.qpos[7:14] = [x, y, 0, np.cos(turn_rad / 2), 0, 0, np.sin(turn_rad / 2)]
    mujoco.mj_kinematics(model, data)
    return data, BodyOutlines(model, np.array([1, 2, 2, 2], dtype=np.int16))


@pytest.mark.parametrize(
    ("x", "y", "turn_rad", "gap_m"),
    [
        (0.6, 0.0, 0.0, 0.25),  # face to the round
        (0.6, 0.1, 0.0, 0.25),
        (0.6, 0.0, np.pi / 4, 0.4 - 0.15 * np.sqrt(2)),  # corner to the round
        (0.5, 0.5, 0.0, np.sqrt(2) * 0.35 - 0.2),
        (0.3, 0.0, 0.0, 0.0),  # one in the other
        (0.0, 0.0, 0.3, 0.0),
    ],
)
def test_gaps_of_posts(x: float, y: float, turn_rad: float, gap_m: float):
    """What is only drawn, group 4, belongs to no outline."""
    data, outlines = posts(x, y, turn_rad)
    pairs, gap = outlines.nearer(data, np.array([1, 2]), 0.3)
    np.testing.assert_array_equal(pairs, [[0, 1]])
    assert gap[0] == pytest.approx(gap_m, abs=3e-3)


def test_pairs_are_those_nearer_than_the_limit():
    data, outlines = posts(0.75, 0.0)
    assert outlines.nearer(data, np.array([1, 2]), 0.39)[0].size == 0
    assert len(outlines.nearer(data, np.array([1, 2]), 0.41)[0]) == 1
    assert outlines.nearer(data, np.array([2]), 1.0)[0].size == 0
    assert outlines.nearer(data, np.array([], dtype=int), 1.0)[0].size == 0


def exact_gap(first: NDArray, second: NDArray) -> float:
    """Distance between the hulls (n, 2) of points that lie apart: every corner to every edge."""

    def corners(points: NDArray) -> NDArray:
        return points[ConvexHull(points).vertices]

    def to_edges(points: NDArray, polygon: NDArray) -> float:
        start, along = polygon, np.roll(polygon, -1, axis=0) - polygon
        share = np.einsum("pej,ej->pe", points[:, None] - start, along) / (along**2).sum(axis=1)
        nearest = start + np.clip(share, 0, 1)[..., None] * along
        return float(np.linalg.norm(points[:, None] - nearest, axis=2).min())

    one, other = corners(first), corners(second)
    return min(to_edges(one, other), to_edges(other, one))


def surface(scene: Scene, data: mujoco.MjData, id_: int) -> NDArray:
    """Every corner (n, 2) of a body's meshes, from above."""
    geoms = np.flatnonzero((scene.person_of_geom == id_) & (scene.model.geom_group == 1))
    hulls = [hull_points(scene.model, data, int(geom)) for geom in geoms]
    return np.concatenate([hull for hull in hulls if hull is not None])[:, :2]


def test_gaps_of_walking_people_are_right_to_a_few_millimetres():
    world = World(load_scenario("lab-five-people", ["duration_s=20"]))
    scene = world.scene
    outlines = BodyOutlines(scene.model, scene.person_of_geom)
    ids = np.arange(1, 6)
    compared = 0
    for t in np.arange(0.0, 12.0, 0.75):
        data = world.snapshot(float(t)).data
        points = {int(id_): surface(scene, data, int(id_)) for id_ in ids}
        pairs, gaps = outlines.nearer(data, ids, 0.6)
        found = {tuple(ids[pair].tolist()): gap for pair, gap in zip(pairs, gaps, strict=True)}
        for first in ids.tolist():
            for second in ids.tolist()[first:]:
                exact = exact_gap(points[first], points[second])
                if (first, second) not in found:
                    assert exact > 0.595
                elif found[first, second] > 0:
                    compared += 1
                    assert found[first, second] == pytest.approx(exact, abs=5e-3)
    assert compared > 20
