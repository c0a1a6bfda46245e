"""The sheet of people: every figure in every view, faults of the caller said."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trackers.errors import InputError
from twin.people.body.appearance import appearance_of
from twin.report.people_sheet import VIEWS, Figure, write_sheet
from twin.scenario.people import Person


def figure(label="anna", **looks):
    return Figure(label, appearance_of(Person(**looks), np.random.default_rng(0)))


def test_every_figure_is_seen_from_every_side_and_its_face_from_the_front(tmp_path):
    path = tmp_path / "people.png"
    looks = {"shirt": "#ff0000", "sleeves": "long", "cap": "none", "glasses": False, "hair_style": "bald"}
    write_sheet(path, [figure(**looks), figure("ben", height_m=1.0)], columns=1, cell_px=(60, 100))
    sheet = cv2.imread(str(path))[..., ::-1].astype(int)
    assert sheet.shape[1] == 60 * len(VIEWS)
    rows = sheet.shape[0] // 2
    first = sheet[rows - 100 : rows].reshape(100, len(VIEWS), 60, 3)
    red = (first[..., 0] > 90) & (first[..., 1] < 30) & (first[..., 2] < 30)
    assert (red.sum(axis=(0, 2)) > 60).all()


@pytest.mark.parametrize(("name", "figures"), [("people.jpg", [figure()]), ("people.png", [])])
def test_what_cannot_be_drawn_is_said(tmp_path, name, figures):
    with pytest.raises(InputError, match="expected"):
        write_sheet(tmp_path / name, figures)
