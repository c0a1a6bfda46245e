"""Each error of the floor's electronics, alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from trackers.observations import FloorFrame, ForceCurve
from twin.sensors.floor_electronics import (
    FLOOR_ELECTRONICS,
    BuiltElectronics,
    FloorElectronics,
    LoadFrame,
    spread_to_neighbours,
)

CURVE = ForceCurve()


def frame(load_n: np.ndarray) -> LoadFrame:
    return LoadFrame("floor", 5, CURVE.values(load_n), load_n, CURVE)


def report(electronics: FloorElectronics, *loads: np.ndarray, seed: int = 0) -> list[np.ndarray]:
    """The values reported for loads (rows, columns), one after the other."""
    rng, state, values = np.random.default_rng(seed), None, []
    for load_n in loads:
        got, state = electronics.corrupt(frame(load_n), state, rng)
        assert type(got) is FloorFrame
        assert (got.sensor, got.stamp_ns, got.values.dtype) == ("floor", 5, np.uint8)
        values.append(got.values)
    return values


def test_off_is_the_curve_and_8_bits():
    loads = np.random.default_rng(0).uniform(0, 2000, (14, 18))
    assert FLOOR_ELECTRONICS["off"].is_off
    np.testing.assert_array_equal(report(FloorElectronics(), loads)[0], CURVE.values(loads))
    for name in ("default", "worse"):
        assert not FLOOR_ELECTRONICS[name].is_off


@given(arrays(float, st.tuples(st.integers(1, 6), st.integers(1, 6)), elements=st.floats(0, 2000)), st.floats(0, 0.8))
def test_cross_talk_moves_load_and_loses_none(load_n, share):
    spread = spread_to_neighbours(load_n, share)
    assert spread.sum() == pytest.approx(load_n.sum(), rel=1e-12)
    assert (spread >= 0).all()


def test_cross_talk_goes_to_the_four_neighbours():
    load_n = np.zeros((5, 5))
    load_n[2, 2] = 1000
    spread = spread_to_neighbours(load_n, 0.2)
    expected = np.zeros((5, 5))
    expected[2, 2] = 800
    expected[[1, 3, 2, 2], [2, 2, 1, 3]] = 50
    np.testing.assert_allclose(spread, expected)
    np.testing.assert_array_equal(report(FloorElectronics(crosstalk=0.2), load_n)[0], CURVE.values(expected))


def test_threshold_and_saturation_are_the_devices_own():
    loads = np.array([[4.0, 6.0, 1500.0, 9000.0]])
    values = report(FloorElectronics(), loads)[0][0]
    assert values[0] == 0 and values[1] > 0 and values[2] == values[3] == CURVE.full_value


def test_hysteresis_shows_more_when_the_load_goes_than_when_it_comes():
    up = [np.full((1, 1), load) for load in (50.0, 100.0, 300.0)]
    down = [np.full((1, 1), load) for load in (100.0, 50.0, 0.0)]
    values = [int(value[0, 0]) for value in report(FloorElectronics(hysteresis=0.1), *up, *down)]
    ideal = [int(CURVE.values(load)[0, 0]) for load in (*up, *down)]
    assert values[:3] == ideal[:3]
    assert values[3] == CURVE.values(np.array(100 / 0.9)) and values[4] == CURVE.values(np.array(50 / 0.9))
    assert values[5] == 0
    # a small dip is not seen at all
    dip = report(FloorElectronics(hysteresis=0.1), *(np.full((1, 1), load) for load in (300.0, 280.0, 300.0)))
    assert len({int(value[0, 0]) for value in dip}) == 1


def test_resistors_differ_and_stay_as_they_are():
    loads = np.full((40, 40), 300.0)
    first, second = report(FloorElectronics(gain_sigma=0.1), loads, loads)
    np.testing.assert_array_equal(first, second)
    answered = CURVE.load_n(first) / 300
    assert answered.mean() == pytest.approx(1, abs=0.02)
    assert answered.std() == pytest.approx(0.1, rel=0.1)


def test_read_noise_has_its_sigma_and_is_new_in_every_frame():
    loads = np.full((100, 100), 300.0)
    first, second = report(FloorElectronics(read_sigma=2.0), loads, loads)
    assert (first != second).any()
    assert first.astype(float).std() == pytest.approx(np.hypot(2, np.sqrt(1 / 12)), rel=0.05)
    assert report(FloorElectronics(read_sigma=2.0), np.zeros((100, 100)))[0].max() < 12


def test_dead_and_stuck_elements():
    loads = [np.full((50, 50), load) for load in (300.0, 600.0)]
    first, second = report(FloorElectronics(dead=0.1, stuck=0.05), *loads)
    dead = (first == 0) & (second == 0)
    assert dead.mean() == pytest.approx(0.1, abs=0.03)
    stuck = (first == second) & ~dead
    assert stuck.mean() == pytest.approx(0.05 * 0.9, abs=0.02)
    assert len(np.unique(first[stuck])) > 30
    working = ~dead & ~stuck
    np.testing.assert_array_equal(second[working], CURVE.values(loads[1])[working])


def test_named_elements():
    electronics = FloorElectronics(dead_cells=((0, 1),), stuck_cells=((2, 3, 77),))
    (values,) = report(electronics, np.full((3, 4), 300.0))
    expected = CURVE.values(np.full((3, 4), 300.0))
    expected[0, 1], expected[2, 3] = 0, 77
    np.testing.assert_array_equal(values, expected)


@pytest.mark.parametrize(
    ("electronics", "complaint"),
    [
        (
            FloorElectronics(dead_cells=((3, 0),)),
            r"\[3, 0\] of a grid of 3 rows and 4 columns; \[0, 0\] to \[2, 3\] are valid",
        ),
        (FloorElectronics(stuck_cells=((0, 0, 256),)), "stuck at 256; 0 to 255 is valid"),
        (FloorElectronics(dead_cells=((0, 0),), stuck_cells=((0, 0, 5),)), "more than once"),
    ],
)
def test_elements_that_are_not_there(electronics, complaint):
    with pytest.raises(ValueError, match=complaint):
        electronics.check_cells(3, 4)


def test_one_fault_does_not_move_another():
    few, more = (
        FloorElectronics(dead=0.05, stuck=stuck, gain_sigma=0.1).build(20, 20, np.random.default_rng(3))
        for stuck in (0.0, 0.1)
    )
    np.testing.assert_array_equal(few.fixed == 0, (more.fixed == 0) & (few.fixed == 0))
    np.testing.assert_array_equal(few.gain, more.gain)


def test_a_built_floor_has_the_same_faults_in_every_series():
    worse = FLOOR_ELECTRONICS["worse"].model_copy(update={"read_sigma": 0.0})
    built = BuiltElectronics(worse, worse.build(14, 18, np.random.default_rng(1)))
    loads = np.random.default_rng(2).uniform(0, 800, (14, 18))
    first, _ = built.corrupt(frame(loads), None, np.random.default_rng(10))
    second, _ = built.corrupt(frame(loads), None, np.random.default_rng(11))
    np.testing.assert_array_equal(first.values, second.values)


def test_the_ideal_frame_stays_and_seeds_repeat():
    loads = np.random.default_rng(0).uniform(0, 800, (14, 18))
    ideal = frame(loads.copy())
    values = ideal.values.copy()
    for seed in (1, 2):
        worse = FLOOR_ELECTRONICS["worse"]
        one, _ = worse.corrupt(ideal, None, np.random.default_rng(seed))
        other, _ = worse.corrupt(ideal, None, np.random.default_rng(seed))
        np.testing.assert_array_equal(one.values, other.values)
    np.testing.assert_array_equal(ideal.load_n, loads)
    np.testing.assert_array_equal(ideal.values, values)
