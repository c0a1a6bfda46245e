"""Penetrations: overlaps are found at their depth, and nothing else is; the shipped scenarios have none."""

from __future__ import annotations

import os

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np
import pytest
from benchmarks.penetration import PenetrationCheck, PenetrationCount, count_penetrations, penetrations

from twin.instant.snapshot import Snapshot
from twin.scenario.load import load_scenario
from twin.world.world import World

ROOM = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="5 5 1"/>
  <geom name="wall" type="plane" pos="2 0 1" size="1 1 1" zaxis="-1 0 0"/>
  <geom name="rug" type="box" pos="0 0 0.005" size="3 3 0.005"/>
  <geom name="hidden" type="box" pos="0 0 1" size="3 3 1" rgba="0 0 0 0"/>
  <geom name="chair" type="box" pos="-1 0 0.2" size="0.2 0.2 0.2"/>
  <body name="anna"><freejoint/>
    <geom name="anna_trunk" type="ellipsoid" size="0.12 0.2 0.3" group="1"/>
    <geom name="anna_leg" type="capsule" pos="0 0 -0.6" size="0.08 0.32" group="1"/>
    <geom name="anna_nose" type="sphere" pos="0.2 0 0" size="0.1" group="2"/></body>
  <body name="bert"><freejoint/><geom name="bert_trunk" type="ellipsoid" size="0.12 0.2 0.3" group="1"/></body>
</worldbody></mujoco>"""


@pytest.fixture(scope="module")
def two():
    model = mujoco.MjModel.from_xml_string(ROOM)
    owner = np.zeros(model.ngeom, dtype=np.int16)
    for name, number in (("anna_trunk", 1), ("anna_leg", 1), ("anna_nose", 1), ("bert_trunk", 2)):
        owner[model.geom(name).id] = number
    return model, mujoco.MjData(model), owner


def posed(two, anna, bert):
    model, data, owner = two
    data.qpos[:] = [*anna, 1, 0, 0, 0, *bert, 1, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    return Snapshot(1.5, model, data, owner)


def test_people_apart_overlap_nothing(two):
    assert penetrations(posed(two, (0, 0, 1), (0, 1, 1))) == []


def test_the_depth_between_two_people(two):
    (found,) = penetrations(posed(two, (0, 0, 1), (0.2, 0, 1)))
    assert (found.t, found.person, found.other) == (1.5, 1, 2)
    assert (found.geom, found.other_geom) == ("anna_trunk", "bert_trunk")
    assert found.depth_m == pytest.approx(0.04, abs=1e-3)
    assert penetrations(posed(two, (0, 0, 1), (0.235, 0, 1))) == []
    assert len(penetrations(posed(two, (0, 0, 1), (0.235, 0, 1)), least_m=0.004)) == 1


def test_furniture_counts_unless_it_is_allowed(two):
    snapshot = posed(two, (-1.0, 0.25, 1.0), (3, 3, 1))
    (found,) = penetrations(snapshot)
    assert (found.person, found.other, found.geom, found.other_geom) == (1, 0, "anna_leg", "chair")
    assert found.depth_m == pytest.approx(0.03, abs=1e-3)
    chair = snapshot.model.geom("chair").id
    assert penetrations(snapshot, {1: {chair}}) == []
    assert len(penetrations(snapshot, {2: {chair}})) == 1


def test_a_wall_is_hit_on_its_face_only(two):
    (found,) = penetrations(posed(two, (1.93, 0, 1), (3, 3, 1)))
    assert found.other_geom == "wall"
    assert found.depth_m == pytest.approx(0.05, abs=1e-3)
    assert penetrations(posed(two, (1.93, 1.4, 1), (3, 3, 1))) == []  # beside its end
    assert penetrations(posed(two, (2.6, 0, 1), (3, 3, 1))) == []  # in the next room


def test_the_floor_and_people_who_are_gone_do_not_count(two):
    assert penetrations(posed(two, (0, 0, 0.9), (0, 1, 0.2))) == []
    assert penetrations(posed(two, (0, 0, -100), (0, 0, -100))) == []


def test_a_count_keeps_the_deepest_of_each_pair(two):
    model, _, owner = two
    check, count = PenetrationCheck(model, owner), PenetrationCount()
    for distance in (1.0, 0.2, 0.15, 0.22):
        count.add(check.at(posed(two, (0, 0, 1), (distance, 0, 1))))
    assert (count.samples, count.with_overlap) == (4, 3)
    assert count.depth_m == pytest.approx(0.09, abs=1e-3)
    assert len(count.deepest) == 1
    assert "3 of 4 samples" in str(count)
    assert "9.0 cm" in str(count)


@pytest.mark.parametrize("seed", [0, 1])
def test_nobody_passes_through_anybody_in_the_lab(seed):
    scenario = load_scenario("lab-five-people", [f"seed={seed}"])
    count = count_penetrations(World(scenario), np.arange(0.0, scenario.duration_s, 0.1))
    assert count.samples == 262
    assert count.with_overlap == 0, str(count)
