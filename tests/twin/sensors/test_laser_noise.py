"""The scanner's errors: each has the statistics it claims, alone."""

from pathlib import Path

import numpy as np
import pytest
from static_walls import HOKUYO_SCANS, hokuyo_ranges, simulated, walls_in

from trackers.observations import LaserScan
from twin.sensors.laser_noise import LASER_NOISE, LaserNoise

LASERS = Path(__file__).parents[3].parent / "shared" / "data" / "lasers"


def scan_of(ranges_m: np.ndarray, increment_rad: float = np.deg2rad(0.5)) -> LaserScan:
    return LaserScan("waist", 5, ranges_m.astype(np.float32), -np.pi / 2, increment_rad, 0.05, 8.0)


def corrupt(noise: LaserNoise, ranges_m: np.ndarray, seed: int = 0, **options: float) -> np.ndarray:
    """The ranges with noise; more beams than a turn has at half a degree lie closer, and their footprints are as much smaller."""
    closer = min(1.0, 719 / ranges_m.size)
    if closer < 1:
        noise = noise.model_copy(update={"divergence_deg": noise.divergence_deg * closer})
        options = {"increment_rad": np.deg2rad(0.5) * closer} | options
    noisy, state = noise.corrupt(scan_of(ranges_m, **options), None, np.random.default_rng(seed))
    assert state is None
    return noisy.ranges_m


def test_off_changes_nothing():
    ranges = np.array([1.0, np.inf, np.nan, 7.99])
    assert LASER_NOISE["off"].is_off
    np.testing.assert_array_equal(corrupt(LaserNoise(), ranges), ranges.astype(np.float32))


def test_the_ideal_scan_and_all_but_its_ranges_stay():
    ideal = scan_of(np.linspace(1, 7, 361))
    before = ideal.ranges_m.copy()
    noisy, _ = LASER_NOISE["worse"].corrupt(ideal, None, np.random.default_rng(0))
    np.testing.assert_array_equal(ideal.ranges_m, before)
    assert noisy.ranges_m.dtype == np.float32
    assert (noisy.sensor, noisy.stamp_ns, noisy.angle_min_rad) == ("waist", 5, -np.pi / 2)
    assert (noisy.angle_increment_rad, noisy.range_min_m, noisy.range_max_m) == (np.deg2rad(0.5), 0.05, 8.0)


@pytest.mark.parametrize("range_m", [1.0, 6.0])
def test_gaussian_noise_has_its_sigma(range_m: float):
    noisy = corrupt(LaserNoise(sigma_m=0.01, sigma_per_m=0.005), np.full(20_000, range_m)).astype(float)
    expected = 0.01 + 0.005 * range_m
    assert noisy.mean() == pytest.approx(range_m, abs=4 * expected / np.sqrt(20_000))
    assert noisy.std() == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize(("name", "sigma_m", "step_m"), [("default", 0.005, 0.01), ("hokuyo", 0.0041, 0.001)])
def test_a_named_noise_spreads_as_the_scanner_it_is_named_after(name: str, sigma_m: float, step_m: float):
    """SICK LMS200: σ 5 mm, steps of 10 mm; the Hokuyo of `LASER_NOISE` at 4 m."""
    off = 4.003 + 0.0001 * np.arange(20_000) % 0.01
    noisy = corrupt(LASER_NOISE[name], off) - off
    assert noisy[np.isfinite(noisy)].std() == pytest.approx(np.hypot(sigma_m, step_m / np.sqrt(12)), rel=0.05)


def test_quantised_ranges_are_multiples():
    noisy = corrupt(LaserNoise(sigma_m=0.005, quantisation_m=0.01), np.full(1000, 3.003))
    steps = noisy.astype(float) / 0.01
    np.testing.assert_allclose(steps, steps.round(), atol=1e-4)
    assert len(np.unique(steps.round())) > 2


def test_drop_out_reads_no_return():
    noisy = corrupt(LaserNoise(dropout=0.1), np.full(20_000, 2.0))
    lost = np.isposinf(noisy)
    assert lost.mean() == pytest.approx(0.1, abs=0.007)
    assert (noisy[~lost] == 2).all()


def test_noise_does_not_lead_out_of_the_limits():
    noisy = corrupt(LaserNoise(sigma_m=0.05), np.concatenate([np.full(2000, 0.06), np.full(2000, 7.98)]))
    assert not np.isneginf(noisy).any()
    finite = noisy[np.isfinite(noisy)]
    assert finite.min() >= np.float32(0.05)
    assert finite.max() <= 8.0
    assert np.isnan(noisy[:2000]).any()
    assert np.isposinf(noisy[2000:]).any()


def test_no_return_and_invalid_stay_what_they_are():
    ranges = np.array([np.inf, np.inf, np.nan, 2.0, np.nan, np.inf])
    noisy = corrupt(LASER_NOISE["worse"].model_copy(update={"dropout": 0.0}), ranges)
    np.testing.assert_array_equal(np.isposinf(noisy), np.isposinf(ranges))
    np.testing.assert_array_equal(np.isnan(noisy), np.isnan(ranges))


def edges(count: int = 4000) -> np.ndarray:
    """Steps between 2 m and 4 m, ten beams apart."""
    return np.where(np.arange(count * 10) // 10 % 2 == 0, 2.0, 4.0)


def test_mixed_pixels_lie_between_and_only_at_edges():
    ideal = edges()
    noisy = corrupt(LaserNoise(mixed_pixel=1.0, divergence_deg=0.5), ideal)
    moved = noisy != ideal.astype(np.float32)
    at_edge = np.zeros(ideal.size, dtype=bool)
    jump = np.flatnonzero(np.diff(ideal) != 0)
    at_edge[jump] = at_edge[jump + 1] = True
    assert not moved[~at_edge].any()
    # A footprint as wide as the beam spacing: exactly one of the two beams straddles each edge.
    assert moved[jump].astype(int).sum() + moved[jump + 1].astype(int).sum() == jump.size
    assert noisy[moved].min() > 2.0
    assert noisy[moved].max() < 4.0
    # The far share is even between 0 and one half, so the beam is drawn a quarter of the way on average.
    drawn = np.abs(noisy[moved] - ideal[moved]) / 2.0
    assert drawn.max() <= 0.5
    assert drawn.mean() == pytest.approx(0.25, abs=0.01)


def test_a_narrow_beam_rarely_straddles_an_edge():
    ideal = edges()
    noisy = corrupt(LaserNoise(mixed_pixel=1.0, divergence_deg=0.05), ideal)
    jumps = np.count_nonzero(np.diff(ideal))
    # Footprint a tenth of the spacing: the edge falls into one of the two half footprints one time in ten.
    assert np.count_nonzero(noisy != ideal.astype(np.float32)) / jumps == pytest.approx(0.1, abs=0.015)


def test_mixed_pixel_probability_and_threshold():
    ideal = edges()
    jumps = np.count_nonzero(np.diff(ideal))
    half = corrupt(LaserNoise(mixed_pixel=0.5, divergence_deg=0.5), ideal)
    assert np.count_nonzero(half != ideal.astype(np.float32)) / jumps == pytest.approx(0.5, abs=0.03)
    none = corrupt(LaserNoise(mixed_pixel=1.0, divergence_deg=0.5, edge_m=2.5), ideal)
    np.testing.assert_array_equal(none, ideal.astype(np.float32))


def test_nothing_is_mixed_with_no_return():
    ideal = np.where(np.arange(1000) // 10 % 2 == 0, 2.0, np.inf)
    np.testing.assert_array_equal(corrupt(LaserNoise(mixed_pixel=1.0), ideal), ideal.astype(np.float32))


def test_default_is_like_a_real_scanner():
    """σ within a factor 2 and drop-out within a factor 3 of a Hokuyo's beams that do not move."""
    path = LASERS / "positive_5.npz"
    if not path.exists():
        pytest.skip(f"no real scans at {path}")
    with np.load(path) as file:
        ranges = file["scan_ranges"].astype(float)
    measured = np.isfinite(ranges) & (ranges > 0.06) & (ranges < 11)
    ranges[~measured] = 0
    before, here, after = ranges[:-2], ranges[1:-1], ranges[2:]
    settled = measured[:-2] & measured[2:] & (np.abs(before - after) < 0.05)
    lost = 1 - measured[1:-1][settled].mean()
    steady = settled & measured[1:-1] & (np.abs(here - before) < 0.05) & (here > 1)
    # Median absolute second difference: motion at constant speed cancels; variance 1 + 1/4 + 1/4.
    second = here[steady] - (before[steady] + after[steady]) / 2
    sigma = 1.4826 * np.median(np.abs(second)) / np.sqrt(1.5)
    default = LASER_NOISE["default"]
    assert sigma / 2 < default.sigma_m < sigma * 2
    assert lost / 3 < default.dropout < lost * 3


def test_seeds_repeat_and_differ():
    ideal = np.linspace(1, 7, 361)
    noise = LASER_NOISE["default"]
    np.testing.assert_array_equal(corrupt(noise, ideal, 1), corrupt(noise, ideal, 1))
    assert (corrupt(noise, ideal, 1) != corrupt(noise, ideal, 2)).any()


@pytest.mark.skipif(not HOKUYO_SCANS.exists(), reason=f"no real scans at {HOKUYO_SCANS}")
def test_the_hokuyo_s_errors_are_the_real_one_s_on_walls():
    """σ within 20 % over all walls and at each distance from 2 m to 5 m, and drop-out within 20 %.

    Beyond 5 m the few walls there are faced squarely, and the real one is up to twice as good as its σ(range) says.
    """
    ranges, limits = hokuyo_ranges()
    real = walls_in(ranges)
    assert real.beams.size > 100
    ideal = np.full(ranges.shape[1], np.nan)
    ideal[real.beams] = real.range_m
    scans = simulated(ideal, limits, LASER_NOISE["hokuyo"], 3000)[:, real.beams]
    sigma_m = np.nanstd(scans, axis=0)
    assert np.median(sigma_m) == pytest.approx(np.median(real.sigma_m), rel=0.1)
    assert np.sqrt(np.mean(sigma_m**2)) == pytest.approx(np.sqrt(np.mean(real.sigma_m**2)), rel=0.2)
    for nearest, farthest in ((2, 3), (3, 4), (4, 5)):
        there = (real.range_m >= nearest) & (real.range_m < farthest)
        assert np.median(sigma_m[there]) == pytest.approx(np.median(real.sigma_m[there]), rel=0.2)
    assert LASER_NOISE["hokuyo"].dropout == pytest.approx(real.drop_out, rel=0.2)
    assert np.isnan(scans).mean() == pytest.approx(LASER_NOISE["hokuyo"].dropout, rel=0.5)


def test_what_stands_on_walls_is_measured_whoever_walks_before_them():
    """The measurement on simulated scans gives the noise that was put in, people left out."""
    rng = np.random.default_rng(0)
    angles = np.deg2rad(np.linspace(-60, 60, 241))
    limits = np.array([angles[0], angles[1] - angles[0], 0.05, 11.0])
    wall = 3 / np.cos(angles)
    scans = simulated(wall, limits, LaserNoise(sigma_m=0.006, dropout=0.01), 400)
    for k in range(400):
        leg = int(rng.integers(0, 230))
        scans[k, leg : leg + 5] = 1.5
    found = walls_in(scans)
    assert found.beams.size > 200
    assert np.median(found.sigma_m) == pytest.approx(0.006, rel=0.05)
    assert found.drop_out == pytest.approx(0.01, rel=0.1)
