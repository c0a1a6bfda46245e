"""Agreement of sensors on synthetic places: a delay is told from all other errors by walks that bend alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from trackers.filters.imm import Imm
from trackers.fusion.agreement import Agreement
from trackers.fusion.person_state import PersonMotion
from trackers.fusion.person_tracks import People
from trackers.observations import NS_PER_S

RATE_HZ = 10.0
SIGMA_M = np.array([0.03, 0.08, 0.3, 0.1])
"""Standard deviations that the sources state [m]."""
PHASE_S = np.array([0.0, 0.017, 0.034, 0.051])
"""Times of their looks in each period [s]."""


def bending(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return amplitudes [m], angular rates [rad/s] and phases of n walks that bend, (n, 2) each."""
    return rng.uniform(0.6, 1.6, (n, 2)), rng.uniform(0.5, 1.1, (n, 2)), rng.uniform(0, 6.3, (n, 2))


def on_bends(walks: tuple[np.ndarray, np.ndarray, np.ndarray], t_s: float) -> np.ndarray:
    amplitude_m, rate, phase = walks
    return amplitude_m * np.sin(rate * t_s + phase)


def observed(
    truth: Callable[[float], np.ndarray],
    delays_s: list[float],
    errors: np.ndarray,
    sigma_m: np.ndarray = SIGMA_M,
    phase_s: np.ndarray = PHASE_S,
    every: Sequence[int] = (1,) * len(PHASE_S),
    rate_hz: float = RATE_HZ,
) -> tuple[list[tuple[float, int, str]], Agreement]:
    """Feed what sources show of people, truth(t) and errors (t, s, n, 2) [m]; return findings (time, source, sentence).

    delays_s: of each source, the time by which it shows people late; phase_s: of its looks; every: their periods, in those
    of the rate. The agreement comes along.
    """
    agreement = Agreement([[f"sensor_{k}"] for k in range(len(delays_s))])
    n = errors.shape[2]
    people = People.started(Imm(PersonMotion()).start(truth(0.0), None, 0.3**2), np.zeros((n, 2)), 0, 1, len(delays_s))
    roster = people.roster.changed(id=np.arange(1, n + 1), confirmed=np.ones(n, np.bool_))
    people = people.changed(existence=np.full(n, 0.999), roster=roster)
    findings, asked = [], np.zeros(n)
    for k in range(len(errors)):
        for source in np.argsort(phase_s[: len(delays_s)]).tolist():
            if k % every[source]:
                continue
            t_s = 100.0 + k / rate_hz + float(phase_s[source])
            ns = round(t_s * NS_PER_S)
            agreement.age(people, ns)
            agreement.take(source, np.full(n, sigma_m[source]), asked, asked > 0)
            known = set(agreement.findings)
            agreement.found()
            findings += [(k / rate_hz, each, agreement.findings[each]) for each in set(agreement.findings) - known]
            seen_ns, seen_at = people.seen_ns.copy(), people.seen_at.copy()
            seen_ns[:, source], seen_at[:, source] = ns, truth(t_s - delays_s[source]) + errors[k, source]
            people = people.changed(seen_ns=seen_ns, seen_at=seen_at)
    return findings, agreement


def alike(rng: np.random.Generator, shape: tuple[int, ...], sigma_m: float, for_s: float) -> np.ndarray:
    """Return errors of a standard deviation [m] and a correlation time [s]: a first-order autoregressive process."""
    kept = np.exp(-1 / (RATE_HZ * for_s))
    errors = sigma_m * rng.normal(size=shape)
    for k in range(1, len(errors)):
        errors[k] = kept * errors[k - 1] + np.sqrt(1 - kept**2) * errors[k]
    return errors


@pytest.mark.parametrize("stated_m", [0.03, 0.33, 1.0])
@pytest.mark.parametrize("delay_s", [-0.5, -0.3, 0.3, 0.5])
@pytest.mark.parametrize("late", [0, 2])
def test_a_delayed_source_is_named_within_seconds_whatever_it_states(
    stated_m: float, delay_s: float, late: int
) -> None:
    rng = np.random.default_rng(round(10 * delay_s) + 100)
    walks = bending(rng, 3)
    errors = alike(rng, (120, 3, 3, 2), 0.06, 0.3) + rng.normal(scale=0.1, size=(1, 3, 3, 2))
    delays_s = [delay_s if k == late else 0.0 for k in range(3)]
    sigma_m = np.where(np.arange(3) == late, stated_m, 0.05)
    findings, agreement = observed(lambda t: on_bends(walks, t), delays_s, errors, sigma_m)
    assert [source for _, source, _ in findings] == [late]
    assert findings[0][0] < 8.0
    assert agreement.suspect.tolist() == [k == late for k in range(3)]
    assert abs(agreement.delays_s[late] - abs(delay_s)) < 0.1


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("delay_s", [-0.8, 0.7, 1.0, 1.5])
def test_a_delay_beyond_the_longest_shift_is_named_as_at_least_that(seed: int, delay_s: float) -> None:
    """On ways that are straight until then it may have been named as an offset."""
    rng = np.random.default_rng(seed)
    walks = bending(rng, 3)
    errors = alike(rng, (140, 3, 3, 2), 0.06, 0.3) + rng.normal(scale=0.1, size=(1, 3, 3, 2))
    findings, agreement = observed(lambda t: on_bends(walks, t), [0.0, delay_s, 0.0], errors, np.full(3, 0.05))
    assert {source for _, source, _ in findings} == {1}
    assert " s or more off the time " in agreement.findings[1]
    assert agreement.offsets_m.max() < 0.2


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("delay_s", "off_m"), [(0.3, 0.0), (-0.3, 0.0), (0.0, 0.6)])
@pytest.mark.parametrize("n", [4, 5])
def test_two_of_four_that_err_alike_name_nobody_and_two_of_five_are_named(
    seed: int, delay_s: float, off_m: float, n: int
) -> None:
    rng = np.random.default_rng(seed)
    walks, wrong = bending(rng, 3), [1, 2]
    errors = alike(rng, (120, n, 3, 2), 0.05, 0.3)
    errors[:, wrong] += [off_m, 0.0]
    delays_s = [delay_s * (k in wrong) for k in range(n)]
    phase_s = 0.01 * np.arange(n)
    findings, agreement = observed(lambda t: on_bends(walks, t), delays_s, errors, np.full(n, 0.05), phase_s, [1] * n)
    assert {source for _, source, _ in findings} == (set(wrong) if n == 5 else set())
    assert agreement.suspect.tolist() == [n == 5 and k in wrong for k in range(n)]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("delay_s", "off_m"), [(0.3, 0.0), (0.0, 0.5), (0.0, 0.0)])
@pytest.mark.parametrize("every", [5, 10])
def test_a_source_of_one_or_two_looks_a_second_is_judged_too(
    seed: int, delay_s: float, off_m: float, every: int
) -> None:
    rng = np.random.default_rng(seed)
    walks = bending(rng, 3)
    errors = alike(rng, (200, 3, 3, 2), 0.06, 0.3) + rng.normal(scale=0.05, size=(1, 3, 3, 2))
    errors[:, 1] += [off_m, 0.0]
    findings, agreement = observed(
        lambda t: on_bends(walks, t), [0.0, delay_s, 0.0], errors, np.full(3, 0.05), every=[1, every, 1]
    )
    assert {source for _, source, _ in findings} == ({1} if delay_s or off_m else set())
    assert agreement.suspect.tolist() == [False, bool(delay_s or off_m), False]
    assert abs(agreement.delays_s[1] - delay_s) < 0.1


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("delay_s", "off_m"), [(0.4, 0.0), (-0.4, 0.0), (0.0, 0.6), (0.0, 0.0)])
@pytest.mark.parametrize("phases", [(0.0, 0.0, 0.0), (0.0, 0.1, 0.2), (0.0, 0.33, 0.65)])
@pytest.mark.parametrize("rate_hz", [1.0, 1.7, 2.5, 3.3, 8.0])
def test_sources_are_judged_at_any_rate_of_all_and_in_any_turn(
    seed: int, delay_s: float, off_m: float, phases: tuple[float, ...], rate_hz: float
) -> None:
    """phases: of the looks of each source, in periods."""
    rng = np.random.default_rng(seed)
    walks = bending(rng, 3)
    errors = rng.normal(scale=0.06, size=(round(12 * rate_hz), 3, 3, 2)) + rng.normal(scale=0.05, size=(1, 3, 3, 2))
    errors[:, 1] += [off_m, 0.0]
    findings, agreement = observed(
        lambda t: on_bends(walks, t),
        [0.0, delay_s, 0.0],
        errors,
        np.full(3, 0.05),
        phase_s=np.array(phases) / rate_hz,
        rate_hz=rate_hz,
    )
    assert {source for _, source, _ in findings} == ({1} if delay_s or off_m else set())
    assert agreement.suspect.tolist() == [False, bool(delay_s or off_m), False]
    assert all(t_s < 10.0 for t_s, _, _ in findings)


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 10**6), n=st.integers(1, 5), offset_m=st.floats(0, 0.3), along_m=st.floats(-0.3, 0.3),
    scale=st.floats(-0.1, 0.1),
)  # fmt: skip
def test_errors_that_stay_alike_on_straight_ways_are_no_delay(
    seed: int, n: int, offset_m: float, along_m: float, scale: float
) -> None:
    """Neither a constant one, nor one along the sight from a camera, constant or a share of the distance."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-3, 3, (n, 2))
    velocity = rng.uniform(0.3, 1.5, (n, 1)) * rng.normal(size=(n, 2))
    errors = alike(rng, (80, 4, n, 2), 0.03, 0.2)
    for k in range(80):
        sight = start + velocity * k / RATE_HZ - [4.0, 4.0]
        away_m = np.maximum(np.linalg.norm(sight, axis=1, keepdims=True), 1.0)
        errors[k, 2] += offset_m + (along_m + scale * away_m) * sight / away_m
    _, agreement = observed(lambda t: start + velocity * (t - 100.0), [0.0] * 4, errors)
    assert not any(" off the time " in each for each in agreement.findings.values())


@pytest.mark.parametrize(("sigma_m", "for_s"), [(0.05, 0.5), (0.15, 0.5), (0.1, 1.5), (0.15, 1.0)])
def test_errors_that_are_correlated_in_time_are_hardly_ever_taken_for_a_delay(sigma_m: float, for_s: float) -> None:
    n_false = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        walks = bending(rng, 3)
        errors = alike(rng, (200, 3, 3, 2), sigma_m, for_s)
        findings, _ = observed(lambda t, walks=walks: on_bends(walks, t), [0.0] * 3, errors)
        n_false += sum(" off the time " in sentence for _, _, sentence in findings)
    assert n_false == 0  # in 400 s


@pytest.mark.parametrize("seed", range(4))
def test_a_moved_source_is_named_and_errors_of_each_person_are_not(seed: int) -> None:
    """Five people are off by as much the same way before a moved source, each another way before one that errs."""
    rng = np.random.default_rng(seed)
    walks = bending(rng, 5)
    errors = alike(rng, (80, 4, 5, 2), 0.04, 0.3) + rng.normal(scale=0.12, size=(4, 5, 2)) * (
        SIGMA_M[:, None, None] > 0.2
    )
    findings, _ = observed(lambda t: on_bends(walks, t), [0.0] * 4, errors)
    assert findings == []
    errors[:, 2] += rng.permuted([0.45, 0.0])
    findings, _ = observed(lambda t: on_bends(walks, t), [0.0] * 4, errors)
    assert [source for _, source, _ in findings] == [2]
    assert " m off " in findings[0][2]


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), angle=st.floats(0, 6.3), order=st.permutations(range(4)))
def test_a_turned_room_and_sources_in_another_order_are_judged_alike(seed: int, angle: float, order: list[int]) -> None:
    rng = np.random.default_rng(seed)
    walks, delays_s = bending(rng, 3), [0.0, 0.0, 0.3, 0.0]
    errors = alike(rng, (60, 4, 3, 2), 0.05, 0.3)
    errors[:, 1] += 0.5
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    _, first = observed(lambda t: on_bends(walks, t), delays_s, errors)
    _, turned = observed(lambda t: on_bends(walks, t) @ turn.T, delays_s, errors @ turn.T)
    _, ordered = observed(
        lambda t: on_bends(walks, t), [delays_s[k] for k in order], errors[:, order], SIGMA_M[order], PHASE_S[order]
    )
    assert first.offsets_m[1] > 0.2
    for other, of in ((turned, slice(None)), (ordered, order)):
        np.testing.assert_allclose(other.offsets_m, first.offsets_m[of], atol=1e-9)
        np.testing.assert_allclose(other.delays_s, first.delays_s[of], atol=1e-6)
