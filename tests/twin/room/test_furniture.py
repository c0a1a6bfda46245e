"""Furniture that people use: seats and beds are found where the room's sites say."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from trackers.errors import InputError
from twin.room.furniture import Bed, Seat, furniture_of, nearly_furniture

CHAIR = """<body name="chair" pos="1 2 0" euler="0 0 90">
  <site name="seat_anna" pos="0 0 0.45"/>
  <geom name="seat" type="box" pos="0 0 0.43" size="0.2 0.21 0.02"/>
  <geom name="back" type="box" pos="-0.2 0 0.7" size="0.02 0.2 0.25"/>
</body>"""
BED = """<body name="bed" pos="-1 0 0">
  <site name="bed_low" pos="0 0.05 0.5" xyaxes="-1 0 0 0 -1 0"/>
  <geom name="mattress" type="box" pos="0 0 0.3" size="1 0.45 0.2"/>
</body>"""


def model(bodies):
    return mujoco.MjModel.from_xml_string(f"<mujoco><compiler angle='degree'/><worldbody>{bodies}</worldbody></mujoco>")


def test_a_seat():
    room = model(CHAIR)
    (seat,) = furniture_of(room).values()
    assert isinstance(seat, Seat)
    assert seat.name == "anna"
    assert seat.furniture == "chair"
    assert seat.geoms == {room.geom("seat").id, room.geom("back").id}
    assert seat.yaw == pytest.approx(np.pi / 2)
    assert seat.height == pytest.approx(0.45)
    assert seat.to_front_m == pytest.approx(0.2)


def test_a_bed():
    found = furniture_of(model(CHAIR + BED))
    assert list(found) == ["anna", "low"]
    bed = found["low"]
    assert isinstance(bed, Bed)
    assert abs(bed.yaw) == pytest.approx(np.pi)
    np.testing.assert_allclose(bed.to_edge_m, [0.5, 0.4])
    np.testing.assert_allclose(bed.sides(), [[-1.0, -0.45], [-1.0, 0.45]], atol=1e-9)


def test_a_lamp_over_the_seat_is_not_its_front():
    lamp = CHAIR.replace("</body>", '<geom type="box" pos="0.5 0 1.5" size="0.1 0.1 0.1"/></body>')
    (seat,) = furniture_of(model(lamp)).values()
    assert isinstance(seat, Seat)
    assert seat.to_front_m == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("bodies", "message"),
    [
        ('<site name="seat_x" pos="0 0 0.4"/>', "'seat_x' is in no piece of furniture"),
        (CHAIR.replace('pos="0 0 0.45"', 'pos="0 0 0.45" euler="60 0 0"'), "'seat_anna' is not level"),
        (CHAIR + BED.replace("bed_low", "bed_anna"), "two places are called 'anna'"),
        (CHAIR.replace('pos="0 0 0.45"', 'pos="3 0 0.45"'), "'seat_anna' is not over"),
        (CHAIR.replace('pos="0 0 0.45"', 'pos="0 0 0.7"'), "'seat_anna' is not on top of its furniture"),
        (BED.replace("0 0.05 0.5", "0 0.05 0.3"), "'bed_low' is not on top of its furniture"),
        (
            CHAIR.replace('pos="0 0 0.45"', 'pos="0 0 1.48"'),
            "1.48 m high; lengths in metres, and a seat of 0.15 to 1 m",
        ),
        (CHAIR.replace("seat_anna", "seat_"), "'seat_' has no name of its own"),
    ],
)
def test_sites_that_make_no_sense(bodies, message):
    with pytest.raises(InputError, match=message):
        furniture_of(model(bodies))


@pytest.mark.parametrize(
    ("name", "kind"), [("Seat_1", "seat"), ("SEAT-a", "seat"), ("seat2", "seat"), ("Bed 3", "bed")]
)
def test_sites_that_are_called_nearly_like_a_seat_are_named(name, kind):
    (line,) = nearly_furniture(model(CHAIR + BED.replace("bed_low", name)))
    assert line.startswith(f"{name}: is no {kind}; a site called {kind}_NAME")
    assert nearly_furniture(model(CHAIR + BED.replace("bed_low", "bedside_lamp"))) == []
