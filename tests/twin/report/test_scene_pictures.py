"""The sheet of people: every portrait in every view, faults of the caller said."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from trackers.errors import InputError
from twin.people.body.appearance import appearance_of
from twin.report.scene_pictures import VIEWS, Portrait, check_picture_name, draw_portraits, write_png
from twin.scenario.person import Person


def portrait(label="anna", **looks):
    return Portrait(label, appearance_of(Person(**looks), np.random.default_rng(0)))


def test_every_portrait_is_seen_from_every_side_and_its_face_from_the_front(tmp_path):
    path = tmp_path / "people.png"
    looks = {"shirt": "#ff0000", "sleeves": "long", "cap": "none", "glasses": False, "hair_style": "bald"}
    write_png(path, draw_portraits([portrait(**looks), portrait("ben", height_m=1.0)], columns=1, cell_px=(60, 100)))
    sheet = cv2.imread(str(path))[..., ::-1].astype(np.int16)
    assert sheet.shape[1] == 60 * len(VIEWS)
    rows = sheet.shape[0] // 2
    first = sheet[rows - 100 : rows].reshape(100, len(VIEWS), 60, 3)
    red = (first[..., 0] > 90) & (first[..., 1] < 30) & (first[..., 2] < 30)
    assert (red.sum(axis=(0, 2)) > 60).all()


def test_a_name_of_no_picture_is_refused():
    with pytest.raises(InputError, match="expected"):
        check_picture_name(Path("people.jpg"))
