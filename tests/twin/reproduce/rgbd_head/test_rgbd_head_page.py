"""Results of `twin reproduce rgbd-head` from tracks, and the suites it refuses."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trackers.area import Pose
from trackers.cameras.intrinsics import PinholeIntrinsics
from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.rig import Rig, StereoSensor
from twin.reproduce.results import pivot_rows
from twin.reproduce.rgbd_head.figures import errors_svg
from twin.reproduce.rgbd_head.reproduction import check_suite
from twin.reproduce.rgbd_head.results import (
    ABLATION,
    EXPERIMENTS,
    NEEDED,
    OURS,
    PAPER,
    TIME,
    WHERE,
    HeadCondition,
    head_errors,
    results_of,
    spread_cm,
)
from twin.suites.spec import load_suite

LENS = PinholeIntrinsics(width=160, height=120, fx=60, fy=60, cx=79.5, cy=59.5)
RIG = Rig(
    sensors={
        f"stereo_{k}": StereoSensor(
            topic=f"/stereo_{k}/image/compressed",
            room_from_sensor=Pose(xyz=(x, y, 3.0), rpy=(np.pi, 0, 0)),
            intrinsics=LENS,
            baseline_m=0.12,
        )
        for k, (x, y) in enumerate([(-1, -1), (1, -1), (1, 1), (-1, 1)], start=1)
    }
)
"""Four cameras under the ceiling that look straight down."""
T = np.arange(20) * 0.25
PEOPLE = {1: (0.3, 0.0, 1.6), 2: (-0.8, 0.5, 1.1)}


def table(rows) -> Any:
    """Heads as truth and tracks hold them: rows of time, id, x, y, z and yaw."""
    t, number, *head = np.array(rows, float).T
    stamps = np.rint(t * NS_PER_S).astype(np.int64)
    names = ("head_x", "head_y", "head_z", "head_yaw")
    return SimpleNamespace(
        stamps_ns=stamps, frame_stamps_ns=np.unique(stamps), id=number.astype(int), visible={},
        z=head[2] - 0.7, **dict(zip(names, head, strict=True)),
    )  # fmt: skip


TRUTH = table([(t, k, *place, 3.0) for t in T for k, place in PEOPLE.items()])


def followed(off=(0.02, 0.0, -0.03), until_s=9.0, turned=0.3, people=PEOPLE) -> Any:
    rows = [(t, 7 + k, *(np.array(place) + off), 3.0 + turned) for t in T for k, place in people.items()]
    return table([row for row in rows if not (row[1] == 8 and row[0] > until_s)])


def test_errors_are_those_of_each_persons_own_track():
    found = head_errors(TRUTH, followed(), RIG)
    figures = found.statistics()
    assert (figures["XY"], figures["Z"], figures["Z, bias"]) == pytest.approx((2.0, 3.0, -3.0))
    assert figures["yaw"] == pytest.approx(np.degrees(0.3)) and (figures["lost"], figures["found after"]) == (0, 0)
    assert set(found.seen_by.tolist()) == {4} and ((found.range_m > 1) & (found.range_m < 4)).all()
    assert errors_svg({"one": found}).startswith("<?xml")


def test_who_has_no_track_for_a_second_is_lost_and_who_slides_away_alone_is_an_error():
    assert head_errors(TRUTH, followed(until_s=2.0), RIG).lost == 1
    assert head_errors(TRUTH, followed(until_s=4.0), RIG).lost == 0, "for less than a second"
    alone = {1: PEOPLE[1]}
    one = table([(t, 1, *PEOPLE[1], 3.0) for t in T])
    slid = head_errors(one, followed(off=(0.8, 0.0, 0.0), people=alone), RIG)
    assert slid.lost == 1 and slid.statistics()["XY"] == pytest.approx(80.0)


def test_the_spread_is_a_standard_deviation_at_each_stamp():
    alone = {1: PEOPLE[1]}
    runs = {k: followed(off=(0.01 * (-1) ** k, 0.0, 0.02 * (-1) ** k), people=alone) for k in range(4)}
    level, up = spread_cm(runs)
    np.testing.assert_allclose(level, 1.0)
    np.testing.assert_allclose(up, 2.0)


def test_results_hold_the_papers_figures_what_each_cue_is_worth_and_where_errors_are():
    conditions = {}
    for name in NEEDED:
        good, bad = head_errors(TRUTH, followed(), RIG), head_errors(TRUTH, followed(off=(0.05, 0.0, 0.1)), RIG)
        figures = {
            tracker: {key: np.array([value, value]) for key, value in (each.statistics() | {TIME: 9.0}).items()}
            for tracker, each in ((OURS, good), (PAPER, bad), ("no-silhouette", bad))
        }
        conditions[name] = HeadCondition(name, (1, 2), figures, [good, good])
    results = {(each.where, each.row, each.column): each for each in results_of(conditions)}
    ours = results[EXPERIMENTS, "sequence-1, XY", OURS]
    assert (ours.ours, ours.paper, ours.unit, ours.runs) == (pytest.approx(2.0), 4.34, "cm", 2)
    assert results[EXPERIMENTS, "sequence-1, XY", "no-silhouette"].paper is None
    change = next(each for each in results.values() if each.where == ABLATION and each.column == "change of Z")
    assert change.ours == pytest.approx(7.0) and change.runs == 8
    assert results[WHERE, "seen by 4 cameras", "Z"].ours == pytest.approx(3.0)
    grid = pivot_rows([each for each in results.values() if each.where == EXPERIMENTS])
    assert ours.paper_system is not None and ours.paper_system.value == pytest.approx(5.0)
    assert ours.baseline is None and (EXPERIMENTS, "sequence-1, XY", PAPER) not in results
    assert grid is not None and len(grid["rows"]) == 2 * len(NEEDED)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"name": "elsewhere"}, "none is named sequence-1"),
        ({"trackers": (OURS,)}, "sequence-1 is run without rgbd-head-paper"),
    ],
)
def test_suites_without_the_experiments_are_refused(change, words):
    suite, path = load_suite(OURS)
    check_suite(suite, path)
    entries = [suite.scenarios[0].model_copy(update=change), *suite.scenarios[1:]]
    with pytest.raises(InputError, match=words):
        check_suite(suite.model_copy(update={"scenarios": entries}), path)
