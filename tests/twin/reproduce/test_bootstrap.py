"""The bootstrap: the figure itself first, intervals that hold the truth as often as they say."""

import numpy as np

from twin.reproduce.results import Bootstrap, band, interval


def test_the_runs_as_they_are_come_first():
    rng = np.random.default_rng(0)
    above, below = rng.random((30, 4)), rng.random((30, 4)) + 1
    replicates = Bootstrap(30, rng, 50)
    ratio = replicates.ratio(above, below)
    assert ratio.shape == (51, 4)
    np.testing.assert_allclose(ratio[0], above.sum(axis=0) / below.sum(axis=0))
    np.testing.assert_array_equal(replicates.counts.sum(axis=1), 30)
    middle, low, high = band(ratio)
    np.testing.assert_array_equal(middle, ratio[0])
    assert (low < high).all()
    assert interval(ratio[:, 2]).value == ratio[0, 2] and interval(ratio[:, 2]).low == low[2]


def test_an_interval_of_95_percent_holds_the_truth_about_as_often():
    rng, held = np.random.default_rng(1), 0
    for _ in range(300):
        above, below = rng.normal(2.0, 0.5, (60, 1)), rng.normal(4.0, 0.5, (60, 1))
        found = interval(Bootstrap(60, rng, 400).ratio(above, below)[:, 0])
        held += found.low <= 0.5 <= found.high
    assert 0.90 <= held / 300 <= 0.98


def test_runs_that_agree_have_an_interval_of_no_width():
    found = interval(Bootstrap(5, np.random.default_rng(2)).ratio(np.full((5, 1), 3.0), np.full((5, 1), 4.0))[:, 0])
    np.testing.assert_allclose((found.value, found.low, found.high), 0.75)
