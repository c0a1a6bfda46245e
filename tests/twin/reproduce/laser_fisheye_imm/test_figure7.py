"""Figure 7: errors as the paper defines them, the same measurements for all, and what the paper found."""

import numpy as np
import pytest

from trackers.filters.imm import Imm, kalman
from twin.reproduce.laser_fisheye_imm.figure7 import (
    FILTERS,
    FIRST_SCAN,
    IMM,
    KALMAN,
    MAGNITUDE_OF_MEAN,
    MEAN_MAGNITUDE,
    MEAN_VELOCITY,
    PARTICLE,
    READINGS,
    MonteCarlo,
    SquaredErrors,
    curves,
    kalman_estimates,
    measurements,
    particle_estimates,
    simulate,
)
from twin.reproduce.laser_fisheye_imm.walk import PERIOD_S, maneuvering_walk

WALK = maneuvering_walk()


@pytest.fixture(scope="module")
def runs() -> MonteCarlo:
    """The paper's 100 runs."""
    return simulate(WALK, range(100))


@pytest.fixture(scope="module")
def found(runs: MonteCarlo) -> list[dict[str, np.ndarray]]:
    """NPE and NVE at each scan, by filter."""
    return [{name: curve[0] for name, curve in each.by_filter.items()} for each in curves(runs)]


def test_imm_is_below_one_and_below_both_others(found):
    npe, nve = ({name: float(curve.mean()) for name, curve in each.items()} for each in found)
    assert npe[IMM] < 1 and nve[IMM] < 1
    assert npe[IMM] <= 0.92 * npe[PARTICLE] and npe[IMM] <= 0.80 * npe[KALMAN]
    assert nve[IMM] <= 0.50 * nve[PARTICLE] and nve[IMM] <= 0.50 * nve[KALMAN]


def test_imm_is_the_lowest_at_most_scans(found):
    for each in found:
        assert ((each[IMM] < each[KALMAN]) & (each[IMM] < each[PARTICLE])).mean() >= 0.7


def test_a_sharp_turn_at_speed_is_where_the_imm_is_not_the_lowest(runs, found):
    npe, turn = found[0], WALK.maneuvers[4]
    assert turn.kind == "turn"
    during = (runs.scans * PERIOD_S > turn.start_t) & (runs.scans * PERIOD_S <= turn.end_t)
    assert (npe[IMM] - npe[KALMAN])[during].max() > 0.1


def test_measured_errors_are_those_of_equations_8_and_9(runs):
    z = measurements(WALK, runs.seeds)
    for k in (FIRST_SCAN, 40, 84):
        place = k - FIRST_SCAN
        assert runs.scans[place] == k
        np.testing.assert_allclose(runs.position.measured[:, place], ((z[:, k] - WALK.position[k]) ** 2).sum(axis=1))
        speed = np.sqrt(((z[:, k] - z[:, k - 1]) ** 2).sum(axis=1)) / PERIOD_S
        np.testing.assert_allclose(runs.speed[MEAN_MAGNITUDE].measured[:, place], (speed - WALK.speed[k]) ** 2)


def test_errors_normalised_by_the_measurements():
    errors = SquaredErrors({"half": np.array([[1.0, 2.0], [3.0, 2.0]])}, np.array([[4.0, 1.0], [4.0, 1.0]]))
    npe, _ = curves(MonteCarlo(range(2), WALK, np.arange(2), errors, {MEAN_MAGNITUDE: errors}))
    np.testing.assert_allclose(npe.by_filter["half"][0], [0.5, 2.0])


def test_measurements_have_the_papers_variance_and_belong_to_their_seed():
    z = measurements(WALK, range(1000, 1040))
    away = z - WALK.position
    np.testing.assert_allclose(away.var(), 0.01, rtol=0.05)
    assert abs(away.mean()) < 0.006
    np.testing.assert_array_equal(measurements(WALK, range(1020, 1022)), z[20:22])


@pytest.mark.parametrize("imm", [Imm(), kalman()], ids=["imm", "kalman"])
def test_a_run_does_not_depend_on_other_runs(imm):
    z = measurements(WALK, range(1000, 1005))
    together, alone = kalman_estimates(imm, z), kalman_estimates(imm, z[3:4])
    np.testing.assert_allclose(together.position[3], alone.position[0], atol=1e-12)
    np.testing.assert_allclose(together.speed[3], alone.speed[0], atol=1e-12)


def test_estimates_are_finite_and_readings_agree_where_there_is_one_mode(runs):
    for reading in READINGS:
        for name in FILTERS:
            errors = runs.speed[reading].by_filter[name]
            assert np.isfinite(errors).all() and errors.shape == (100, 85 - FIRST_SCAN)
    single = [runs.speed[reading].by_filter[KALMAN] for reading in READINGS]
    np.testing.assert_allclose(single[0], single[1], atol=1e-9)
    np.testing.assert_allclose(single[0], single[2], atol=1e-9)


def test_the_mean_magnitude_is_never_the_smallest_speed():
    z = measurements(WALK, range(1000, 1005))
    for estimates in (kalman_estimates(Imm(), z), particle_estimates(z, np.random.default_rng(0), 200)):
        speed = dict(zip(READINGS, np.moveaxis(estimates.speed, -1, 0), strict=True))
        # |mean| ≤ mean of magnitudes, for numbers and for vectors
        assert (speed[MAGNITUDE_OF_MEAN] <= speed[MEAN_MAGNITUDE] + 1e-12).all()
        assert (speed[MEAN_VELOCITY] <= speed[MEAN_MAGNITUDE] + 1e-12).all()


def test_many_particles_follow_closer_than_few():
    z = measurements(WALK, range(1000, 1010))
    error = {
        p: ((particle_estimates(z, np.random.default_rng(0), p).position - WALK.position[FIRST_SCAN:]) ** 2).mean()
        for p in (30, 2000)
    }
    assert error[2000] < 0.8 * error[30]


def test_the_same_seeds_the_same_errors(runs):
    again = simulate(WALK, range(20))  # one block: the first of the hundred's
    np.testing.assert_array_equal(again.position.by_filter[PARTICLE], runs.position.by_filter[PARTICLE][:20])
    reported: list[float] = []
    simulate(WALK, range(0, 21), lambda what, done, total: reported.append(done / total))
    assert reported == [20 / 21, 1.0]
