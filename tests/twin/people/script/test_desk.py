"""Sitting at a desk: people come to the side of a chair that faces one, sit down and turn in, and go the same way."""

from __future__ import annotations

import os

os.environ.setdefault("MUJOCO_GL", "egl")

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.penetration import count_penetrations

from trackers.configuration import validate
from trackers.errors import InputError
from twin.commands.info import room_faults
from twin.commands.new import ROOM
from twin.scenario import Scenario
from twin.world.world import World

HALF_M = 0.22
BACK = '<geom type="box" pos="-0.225 0 0.72" size="0.022 0.2 0.25"/>'
ARMS = '<geom type="box" pos="0 0.2 0.6" size="0.2 0.02 0.02"/><geom type="box" pos="0 -0.2 0.6" size="0.2 0.02 0.02"/>'
LEGS = "".join(
    f'<geom type="box" pos="{0.36 * x} {0.66 * y} 0.35" size="0.03 0.03 0.35"/>' for x in (-1, 1) for y in (-1, 1)
)
TOP = f'<geom type="box" pos="0 0 0.72" size="0.4 0.7 0.02"/>{LEGS}'
SOLID = '<geom type="box" pos="0 0 0.37" size="0.4 0.7 0.37"/>'
WALK = {"kind": "walk", "waypoints": [[-1.5, -1.0]]}


def room(path: Path, gap_m: float, desk: str = TOP, chair: str = "") -> Path:
    """A room with a desk `gap_m` [m] before the front edge of a chair that faces it; the seat's middle is the origin."""
    walls = "".join(
        f'<geom type="box" pos="{3.05 * x} {3.05 * y} 1.3" size="{0.05 + 3 * abs(y)} {0.05 + 3 * abs(x)} 1.3"/>'
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )
    path.write_text(
        f"""<mujoco><worldbody><geom type="box" pos="0 0 -0.05" size="3 3 0.05"/>{walls}
        <body name="desk" pos="{HALF_M + gap_m + 0.4} 0 0">{desk}</body>
        <body name="chair"><geom type="box" pos="0 0 0.42" size="{HALF_M} {HALF_M} 0.02"/>{chair}
        <site name="seat_a" pos="0 0 0.44"/></body></worldbody></mujoco>"""
    )
    return path


def world(file: Path, *script: dict[str, Any], height_m: float = 1.75, **person: Any) -> World:
    anna = {"height_m": height_m, "script": list(script)} | person
    scanner = {"kind": "laser", "rate_hz": 10, "mount": {"xyz": [-2.0, -1.5, 0.4]}}
    content = {
        "name": "desk",
        "room": str(file),
        "duration_s": 30,
        "people": {"anna": anna},
        "sensors": {"low": scanner},
    }
    return World(validate(Scenario, content | {"background": "none"}, "test"))


def seated(told: World, seconds: float) -> np.ndarray:
    """Rows t, x, y, z, yaw and both feet's x, y of the times at which anna sits, to the end; she overlaps nothing."""
    seat = told.scene.ground.furniture["a"]
    rows = []

    def pressed(t: float) -> dict[int, frozenset[int]]:
        (one,) = told.truth(round(t * 1e9), {}).people
        if one.z < 0.6:
            rows.append([t, one.x, one.y, one.z, one.yaw, *(c for foot in one.feet for c in (foot.x, foot.y))])
        return {1: seat.geoms}

    count = count_penetrations(told, np.arange(0.0, seconds, 0.1), pressed)
    assert not count.with_overlap, count
    assert told.population.truth(seconds - 0.1).z[0] > 0.85
    return np.array(rows)


@pytest.mark.parametrize(("gap_m", "chair", "height_m"), [(0.12, "", 1.75), (0.25, BACK, 1.62), (0.28, BACK, 1.85)])
def test_who_sits_at_a_desk_faces_it_with_the_legs_under_its_top(
    tmp_path: Path, gap_m: float, chair: str, height_m: float
) -> None:
    file = room(tmp_path / "room.xml", gap_m, chair=chair)
    told = world(file, {"kind": "sit", "seat": "a", "for_s": 1.5}, WALK, height_m=height_m, start=[-1.5, -1.0])
    sits = seated(told, 24.0)
    assert np.abs(sits[[0, -1], 4]).min() == pytest.approx(np.pi / 2, abs=0.05)  # beside it, before and after
    at_desk = sits[np.abs(sits[:, 4]) < 0.02]
    assert len(at_desk) > 15
    assert np.abs(at_desk[:, 2]).max() < 0.02
    assert np.ptp(sits[:, 5:], axis=0).min() > 0.25  # the feet step along
    shape = told.scene.appearances["anna"].proportions
    shoes_m = shape.shoe_length - shape.heel_behind_ankle
    assert (at_desk[5:-5, [5, 7]] + shoes_m > HALF_M + gap_m).all()
    np.testing.assert_allclose(told.population.truth(23.9).x, -1.5, atol=0.15)


def test_who_is_seated_at_a_desk_from_the_start_leaves_it_by_its_side(tmp_path: Path) -> None:
    file = room(tmp_path / "room.xml", 0.25, chair=BACK)
    sits = seated(world(file, {"kind": "sit", "seat": "a", "seated": True, "for_s": 1.5}, WALK), 12.0)
    assert abs(sits[0, 4]) < 1e-6
    assert abs(sits[-1, 4]) == pytest.approx(np.pi / 2, abs=0.05)


@pytest.mark.parametrize(
    ("gap_m", "desk", "chair", "said"),
    [
        (0.25, SOLID, "", r"'desk', 0\.00 to 0\.74 m high, leaves no room for the legs \(a table top on legs does\)"),
        (0.02, TOP, "", r"'desk', 0\.70 to 0\.74 m high, leaves no room for a body beside it"),
        (0.25, TOP, ARMS, "its arm rest is in the way"),
        (0.25, TOP, '<geom type="box" pos="0 0 0.42" size="0.2 0.6 0.02"/>', "it is too wide"),
    ],
)
def test_desks_at_which_nobody_can_sit_are_named(
    tmp_path: Path, gap_m: float, desk: str, chair: str, said: str
) -> None:
    file = room(tmp_path / "room.xml", gap_m, desk, chair)
    with pytest.raises(InputError, match=f"script.0.seat: nobody of this size can .*its side: {said}.* is expected"):
        world(file, {"kind": "sit", "seat": "a"}, start=[-1.5, -1.0])
    (fault,) = room_faults(str(file))
    assert fault.startswith("seat_a: nobody of this size can come to")


def test_the_seat_of_a_new_room_can_be_used(tmp_path: Path) -> None:
    file = tmp_path / "room.xml"
    file.write_text(ROOM.format(name="room", file=file))
    assert not room_faults(str(file))
    told = world(file, {"kind": "sit", "seat": "desk"}, start=[0.0, -1.0])
    told.snapshot(14.0)
    (anna,) = told.truth(round(14.0 * 1e9), {}).people
    assert anna.z < 0.6
    assert abs(anna.yaw) == pytest.approx(np.pi, abs=0.01)  # towards the desk
