"""What `twin reproduce camera-floor-particle` makes of runs, and what suites it refuses."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trackers.camera_floor_particle.options import CameraFloorParticleOptions
from trackers.errors import InputError
from trackers.observations import NS_PER_S
from twin.reproduce.camera_floor_particle.plots import head_errors, heads_svg
from twin.reproduce.camera_floor_particle.replays import VARIANTS, closest_s, lowest_s
from twin.reproduce.camera_floor_particle.reproduction import check_suite
from twin.reproduce.camera_floor_particle.tables import (
    ABLATION,
    EXPERIMENTS,
    HOME,
    MOVEMENTS,
    NEEDED,
    OURS,
    PAIR,
    conditions_of,
    results_of,
)
from twin.suites.description import load_suite


def made_up(**of: float) -> dict[str, float | None]:
    figures: dict[str, float | None] = {
        "right_at_end": 1.0, "id_switches": 0, "lost_tracks": 0, "motp_m": 0.03, "body_height_error_m": None,
        "head_error_m.x": 0.01, "head_error_m.y": 0.02, "head_error_m.z": 0.03, "head_yaw_median_rad": np.pi / 18,
        "ms_per_frame.mean": 20.0,
    }  # fmt: skip
    return figures | of


def runs() -> Any:
    """Two seeds of every experiment; without the exclusion one of two pairs is wrong at the end."""
    by_condition, metrics = {}, {}
    for name in NEEDED:
        for seed in (1, 2):
            for tracker in (OURS, f"{OURS}-no-exclusion") if name == PAIR else (OURS,):
                case = SimpleNamespace(id=f"{name}-{seed}-{tracker}", seed=seed)
                by_condition.setdefault(name, {}).setdefault(seed, {})[tracker] = case
                metrics[case.id] = made_up(right_at_end=1.0 if tracker == OURS or seed == 1 else 0.0)
    return SimpleNamespace(by_condition=by_condition, metrics=metrics)


def test_results_hold_the_movements_together_the_papers_heads_and_paired_ablations():
    results = {(each.where, each.row, each.column): each for each in results_of(conditions_of(runs()))}
    together = results[EXPERIMENTS, "four movements, head x", "ours"]
    assert (together.ours, together.paper, together.runs) == (pytest.approx(0.01), 0.049, 2 * len(MOVEMENTS))
    assert results[EXPERIMENTS, "crossing, pan, median", "ours"].ours == pytest.approx(10.0)
    assert results[EXPERIMENTS, f"{HOME}, head z", "ours"].paper == 0.045
    lost = results[ABLATION, f"without the exclusion ({PAIR})", "change of people right at the end"]
    assert lost.ours == pytest.approx(-50.0) and lost.ci95[0] == pytest.approx(-100.0)
    assert not any("height" in row for _, row, _ in results), "what no run has is left out"


def table(stamps_s, people) -> Any:
    """Rows of people (id, x, y, head z) at each stamp, as truth and tracks hold them."""
    rows = [(round(t * NS_PER_S), *row) for t, now in zip(stamps_s, people, strict=True) for row in now]
    stamps_ns, number, x, y, z = map(np.array, zip(*rows, strict=True))
    return SimpleNamespace(stamps_ns=stamps_ns, id=number, x=x, y=y, head_x=x, head_y=y, head_z=z)


def test_moments_and_errors_are_found_in_tables():
    t = [1.0, 2.0, 3.0, 4.0, 5.0]
    truth = table(t, [[(1, k, 0.0, 1.6 - 0.1 * k), (2, 4.0 - 0.5 * k, 0.0, 1.7)] for k in range(5)])
    assert closest_s(truth) == 5.0 and lowest_s(truth) == 5.0
    tracks = table(t[1:], [[(7, k + 0.1, 0.0, 1.6 - 0.1 * k)] for k in range(1, 5)])
    since, off = head_errors(truth, tracks)
    np.testing.assert_allclose(since, [0, 1, 2, 3])
    np.testing.assert_allclose(off[0], [0.1, 0.0, 0.0], atol=1e-9)
    assert heads_svg([(since, off)]).startswith("<?xml")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"name": "elsewhere"}, "none is named crossing"),
        ({"trackers": ("floor-kalman",)}, f"crossing is run without {OURS}"),
    ],
)
def test_suites_without_the_experiments_are_refused(change, words):
    suite, path = load_suite(OURS)
    check_suite(suite, path)
    first, *others = suite.scenarios
    with pytest.raises(InputError, match=words):
        check_suite(suite.model_copy(update={"scenarios": [first.model_copy(update=change), *others]}), path)


@pytest.mark.parametrize("change", VARIANTS.values(), ids=VARIANTS)
def test_every_choice_is_one_of_the_tracker(change):
    assert (CameraFloorParticleOptions.model_validate(change) == CameraFloorParticleOptions()) == (not change)
