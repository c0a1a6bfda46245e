"""Occlusions by person: in the area, hidden from every sensor at once, by the truth."""

from __future__ import annotations

import numpy as np
import pytest

from twin.evaluate import PersonOcclusion, long_occlusions
from twin.recording.tables import TruthTable, truth_table
from twin.truth.truth_types import PersonTruth, TruthFrame


def person(id_: int, waist: float, knee: float, in_area: bool = True) -> PersonTruth:
    return PersonTruth(
        id=id_, x=0.0, y=1.0, z=0.9, yaw=0.0, head_x=0.0, head_y=1.0, head_z=1.6, head_yaw=0.0, vx=0.0, vy=0.0,
        in_area=in_area, visible={"waist": waist, "knee": knee},
    )  # fmt: skip


def table(*frames: list[PersonTruth]) -> TruthTable:
    return truth_table([TruthFrame(k * 100_000_000, tuple(people)) for k, people in enumerate(frames)])


def hidden_between(first: int, last: int, n_frame: int = 40) -> TruthTable:
    return table(*([person(1, float(not first <= k <= last), 0.0), person(2, 1.0, 1.0)] for k in range(n_frame)))


def test_an_occlusion_lasts_from_its_first_frame_to_its_last() -> None:
    found = long_occlusions(hidden_between(5, 21), ("waist", "knee"), 1.5)
    assert found == (PersonOcclusion(1, 0.5, 2.1),)
    assert found[0].duration_s == pytest.approx(1.6)


def test_as_long_as_tracks_coast_is_not_longer() -> None:
    assert not long_occlusions(hidden_between(5, 20), ("waist", "knee"), 1.5)
    assert long_occlusions(hidden_between(5, 21), ("waist", "knee"), 1.5)


def test_one_sensor_that_sees_a_hair_is_enough() -> None:
    seen = table(*([person(1, 0.0, 0.01)] for _ in range(30)))
    assert not long_occlusions(seen, ("waist", "knee"), 1.5)
    assert long_occlusions(seen, ("waist",), 1.5) == (PersonOcclusion(1, 0.0, 2.9),)


def test_a_glimpse_or_leaving_ends_it() -> None:
    dark = person(1, 0.0, 0.0)
    for gap in ([person(1, 1.0, 0.0)], [person(1, 0.0, 0.0, in_area=False)], []):
        frames = [[dark]] * 12 + [gap] + [[dark]] * 12
        assert not long_occlusions(table(*frames), ("waist", "knee"), 1.5)


def test_several_come_by_start() -> None:
    frames = [[person(1, float(k < 20), 0.0), person(2, float(k >= 19), 0.0)] for k in range(40)]
    assert [each.person_id for each in long_occlusions(table(*frames), ("waist", "knee"), 1.5)] == [2, 1]


def test_a_sensor_that_truth_does_not_know_is_an_error() -> None:
    with pytest.raises(KeyError, match="elbow"):
        long_occlusions(hidden_between(5, 21), ("elbow",), 1.5)


def test_no_person_there() -> None:
    empty = table(*([] for _ in range(5)))
    assert np.array_equal(empty.id, [])
    assert long_occlusions(empty, (), 1.5) == ()
