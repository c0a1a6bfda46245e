"""Boxes from pictures of ids drawn by hand."""

from __future__ import annotations

import numpy as np

from twin.truth.truth_types import Box
from twin.truth.visibility import person_boxes


def test_a_box_covers_the_pixels_of_one_person():
    people = np.zeros((8, 12), dtype=np.int16)
    people[2:5, 3:7] = 3
    people[4, 5:9] = 1  # before the other
    assert person_boxes(people) == (
        Box(1, left=5, top=4, width=4, height=1, visible_px=4, truncated=False),
        Box(3, left=3, top=2, width=4, height=3, visible_px=10, truncated=False),
    )


def test_parts_of_one_person_share_a_box():
    people = np.zeros((8, 12), dtype=np.int16)
    people[1, 2] = people[6, 9] = 2
    (box,) = person_boxes(people)
    assert (box.left, box.top, box.width, box.height, box.visible_px) == (2, 1, 8, 6, 2)


def test_who_reaches_the_border_or_the_rim_of_the_field_is_truncated():
    people = np.full((9, 9), -1, dtype=np.int16)
    people[1:8, 1:8] = 0
    people[3, 3] = 1  # in the middle
    people[7, 4] = 2  # beside the outside of the field
    full = np.zeros((9, 9), dtype=np.int16)
    full[4, 4], full[8, 2] = 1, 2
    for image in (people, full):
        assert [box.truncated for box in person_boxes(image)] == [False, True]


def test_a_picture_of_nobody_has_no_boxes():
    assert person_boxes(np.zeros((4, 4), dtype=np.int16)) == ()
    assert person_boxes(np.full((4, 4), -1, dtype=np.int16)) == ()
