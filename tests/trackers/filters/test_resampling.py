"""Resampling: unbiased, never a particle of weight 0, each scheme's own promise, and the edges of rounding."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from trackers.errors import InputError
from trackers.filters.resampling import SCHEMES, resample

ALL = pytest.mark.parametrize("scheme", SCHEMES)


@st.composite
def distributions(draw, most=12):
    """Weights (p,) that sum to 1, many of them 0, some tiny."""
    size = draw(st.integers(1, most))
    element = st.one_of(st.just(0.0), st.floats(1e-12, 1.0), st.floats(0.1, 1.0))
    weights = draw(arrays(float, size, elements=element))
    if weights.sum() == 0:
        weights[draw(st.integers(0, size - 1))] = 1.0
    return weights / weights.sum()


def counts(ancestors: np.ndarray) -> np.ndarray:
    return np.array([np.bincount(row, minlength=ancestors.shape[1]) for row in ancestors])


def drawn(scheme: str, weights: np.ndarray, n: int = 1, seed: int = 0) -> np.ndarray:
    """How often each particle is taken, (n, p), in n draws of the same weights (p,)."""
    return counts(resample(scheme, np.tile(weights, (n, 1)), np.random.default_rng(seed)))


@ALL
@settings(max_examples=40, deadline=None, derandomize=True)
@given(weights=distributions(), seed=st.integers(0, 2**32))
def test_unbiased(scheme, weights, seed):
    n, p = 3000, len(weights)
    mean = drawn(scheme, weights, n, seed).mean(axis=0)
    # no scheme's count varies more than independent draws', but for rounding a part of a copy up or down
    deviation = np.sqrt(np.maximum(p * weights * (1 - weights), 0.25) / n)
    assert (abs(mean - p * weights) <= 5.5 * deviation).all()


@ALL
@settings(max_examples=60, deadline=None, derandomize=True)
@given(weights=distributions(most=40), seed=st.integers(0, 2**32))
def test_never_a_particle_of_weight_zero(scheme, weights, seed):
    taken = drawn(scheme, weights, 20, seed)
    assert (taken.sum(axis=1) == len(weights)).all()
    assert (taken[:, weights == 0] == 0).all()


@settings(max_examples=60, deadline=None, derandomize=True)
@given(weights=distributions(most=40), seed=st.integers(0, 2**32))
def test_systematic_counts_are_rounded_up_or_down(weights, seed):
    p = len(weights)
    low, high = np.floor(p * weights - 1e-9), np.ceil(p * weights + 1e-9)
    systematic = drawn("systematic", weights, 20, seed)
    assert ((systematic >= low) & (systematic <= high)).all()


@pytest.mark.parametrize("p", [1, 2, 49, 1000])
def test_equal_weights_keep_every_particle(p):
    assert (drawn("systematic", np.full(p, 1 / p), 50) == 1).all()


def test_plain_draws_are_multinomial():
    weights = np.array([0.5, 0.3, 0.2])
    taken = drawn("plain", weights, 40_000)
    expected = 3 * (np.diag(weights) - np.outer(weights, weights))
    np.testing.assert_allclose(np.cov(taken.T), expected, atol=0.02)


def test_the_better_scheme_adds_less_variance():
    weights = np.random.default_rng(1).dirichlet(np.ones(50))
    spread = {scheme: drawn(scheme, weights, 2000).var(axis=0).sum() for scheme in SCHEMES}
    assert spread["systematic"] < spread["plain"]


@ALL
def test_sets_do_not_mix(scheme):
    n, p = 2000, 7
    chosen = np.random.default_rng(3).integers(0, p, n)
    ancestors = resample(scheme, np.eye(p)[chosen], np.random.default_rng(4))
    assert (ancestors == chosen[:, None]).all()


class Always(np.random.Generator):
    """A source of one and the same number in [0, 1)."""

    def __init__(self, value):
        super().__init__(np.random.PCG64(0))
        self.value = value

    def random(self, shape):
        return np.full(shape, self.value)


@ALL
@pytest.mark.parametrize("value", [0.0, np.nextafter(1.0, 0.0)])
def test_the_ends_of_the_unit_interval(scheme, value):
    weights = np.tile([0.0, 0.25, 0.0, 0.75, 0.0], (200, 1))  # in a late set numbers are coarser
    taken = counts(resample(scheme, weights, Always(value)))  # type: ignore[arg-type]
    assert (taken.sum(axis=1) == 5).all()
    assert (taken[:, [0, 2, 4]] == 0).all()


@ALL
def test_the_same_generator_the_same_ancestors(scheme):
    weights = np.random.default_rng(5).dirichlet(np.ones(30), 4)
    first, second = (resample(scheme, weights, np.random.default_rng(6)) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert first.shape == (4, 30) and first.dtype == np.intp


@ALL
def test_no_set_at_all(scheme):
    assert resample(scheme, np.zeros((0, 5)), np.random.default_rng(0)).shape == (0, 5)


@pytest.mark.parametrize(
    "weights",
    [[[0.0, 0.0]], [[0.5, 0.4]], [[1.5, -0.5]], [[np.nan, 1.0]], [[np.inf, 1.0]], [0.5, 0.5], [[]]],
)
def test_what_is_no_distribution_is_refused(weights):
    with pytest.raises(InputError, match="expected"):
        resample("plain", np.array(weights), np.random.default_rng(0))


def test_an_unknown_scheme_is_told_the_known_ones():
    with pytest.raises(InputError, match="'best'; valid are systematic, plain"):
        resample("best", np.ones((1, 1)), np.random.default_rng(0))
