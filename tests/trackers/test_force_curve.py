"""From values to loads and back, as exactly as 8 bits allow."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from pydantic import ValidationError

from trackers.observations import ForceCurve
from trackers.rig import FloorSensor, Pose, Rig

CURVE = ForceCurve()
curves = st.builds(
    ForceCurve,
    half_scale_n=st.floats(20, 500),
    exponent=st.floats(0.5, 1.5),
    threshold_n=st.floats(0, 20),
    saturation_n=st.floats(200, 3000),
)


@given(curves, st.floats(0, 5000))
def test_the_inverse_is_right_to_half_a_step(curve, load_n):
    value = curve.values(np.array([load_n]))
    back = curve.load_n(value)
    if load_n < curve.threshold_n:
        assert value[0] == 0
    if value[0] == 0:
        assert back[0] == 0
    elif value[0] >= curve.full_value:
        assert back[0] == curve.saturation_n
    else:
        voltage = 255 / (1 + (curve.half_scale_n / back) ** curve.exponent)
        assert voltage[0] == pytest.approx(value[0], abs=1e-6)
        assert abs(curve.signal(np.array(load_n)) - voltage[0]) <= 0.5 + 1e-6


@given(curves)
def test_every_value_of_a_load_gives_itself_back(curve):
    loads = np.linspace(0, 1.2 * curve.saturation_n, 500)
    values = curve.values(loads)
    assert (np.diff(values.astype(int)) >= 0).all()
    again = curve.values(curve.load_n(values))
    seen = curve.load_n(values) >= curve.threshold_n  # a load just above may round to one just below the threshold
    np.testing.assert_array_equal(again[seen], values[seen])


def test_the_shape_of_the_curve():
    loads = np.array([0.0, 4.9, 5.0, 200.0, 700.0, 1422.0, 5000.0])
    values = CURVE.values(loads)
    assert values[0] == values[1] == 0
    assert values[2] > 0
    assert values[3] == 128  # half of the supply, where the resistances are alike
    assert values[5] == values[6] == CURVE.full_value == 218
    # ten times the load, 10^exponent times the conductance
    share = CURVE.signal(np.array([20.0, 200.0])) / 255
    conductance = share / (1 - share)
    assert conductance[1] / conductance[0] == pytest.approx(10**CURVE.exponent)


def test_steps_are_finer_than_a_person():
    """A person of 20 kg on one element or spread over four is weighed to 10 %."""
    for load_n in (196.0, 49.0):
        assert CURVE.load_n(CURVE.values(np.array([load_n])))[0] == pytest.approx(load_n, rel=0.05)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ({"threshold_n": 2000}, "threshold_n 2000 must be below saturation_n 1422"),
        ({"half_scale_n": 1e9}, "no load is ever seen in 8 bits"),
        ({"half_scale_n": 0}, "greater than 0"),
        ({"exponent": 3}, "less than or equal to 2"),
        ({"saturation_n": float("inf")}, "finite number"),
    ],
)
def test_curves_that_cannot_be(content, complaint):
    with pytest.raises(ValidationError, match=complaint):
        ForceCurve.model_validate(content)


def test_a_floor_on_the_rig():
    floor = FloorSensor(
        topic="/floor/floor",
        rows=2,
        columns=3,
        pitch_m=0.5,
        room_from_sensor=Pose(xyz=(1, 2, 0), rpy=(0, 0, np.pi / 2)),
    )
    np.testing.assert_allclose(floor.corners, [(1, 2), (1, 3.5), (0, 3.5), (0, 2)], atol=1e-12)
    np.testing.assert_allclose(floor.centres[0, 0], (0.75, 2.25))
    np.testing.assert_allclose(floor.centres[0, 2], (0.75, 3.25))
    np.testing.assert_allclose(floor.centres[1, 0], (0.25, 2.25))
    values = floor.curve.values(np.full((2, 3), 300.0))
    np.testing.assert_array_equal(floor.curve.values(floor.load_n(values)), values)
    np.testing.assert_allclose(floor.load_n(values), 300, rtol=0.01)  # half an 8-bit step is 2.7 N there
    rig = Rig(sensors={"floor": floor})
    assert rig.floors() == {"floor": floor} and rig.main_sensor == "floor"
    assert Rig.parse(rig.dump_yaml(), "rig.yaml") == rig
