"""truth_boxes.csv, truth_rays.csv and truth_situations.csv: written row by row, situations read back exactly; and their JSON."""

from __future__ import annotations

import json
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackers.errors import InputError
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import STRING
from twin.recording.situation_table import decode_situation, read_situations, situation_table
from twin.recording.truth_tables import (
    DETAIL_FILES,
    DETAIL_TOPICS,
    detail_writer,
    encode_detail,
)
from twin.truth.truth_types import BasesFrame, BaseTruth, Box, BoxFrame, RayFrame, RayRun, Situation, TruthDetail

BOX_HEADER = "t,camera,id,left,top,width,height,visible_px,truncated"
RAY_HEADER = "t,sensor,id,first_beam,last_beam"
SITUATION_HEADER = "kind,first_id,second_id,sensor,start_t,end_t,complete,how,least_m"

SITUATIONS = [
    Situation("merged", 1, 3, "waist", 100, 1_700_000_000_123_456_789, complete=True, how="both", least_m=0.1 + 0.2),
    Situation("correlated", 2, 4, "", 5, 5, complete=False),
    Situation("interaction", 2, 4, "", 5, 10, complete=False, least_m=1.25),
]
DETAILS: list[TruthDetail] = [
    BoxFrame(0, "north", (Box(1, 0, 5, 10, 30, 250, True), Box(4, 11, 6, 1, 1, 1, False))),
    RayFrame(0, "waist", (RayRun(4, 0, 3), RayRun(1, 4, 4))),
    BoxFrame(0, "south", ()),
    RayFrame(1_700_000_000_123_456_789, "waist", ()),
    RayFrame(1_700_000_000_123_456_789, "knee", (RayRun(2, 100, 120),)),
    BasesFrame(1_500_000_000, (BaseTruth("robot", 1.5, -0.25, 0.0, 3.125),)),
    *SITUATIONS,
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with detail_writer(tmp_path, with_bases=True) as write:
        for detail in DETAILS:
            write(detail)
        assert not [path for path in tmp_path.iterdir() if path.suffix == ".csv"]
    return tmp_path


def test_boxes_and_rays_are_a_row_each_and_a_frame_without_people_is_one(folder: Path):
    stamp = "1700000000.123456789"
    assert (folder / "truth_boxes.csv").read_text().splitlines() == [
        BOX_HEADER,
        "0.000000000,north,1,0,5,10,30,250,1",
        "0.000000000,north,4,11,6,1,1,1,0",
        "0.000000000,south,,,,,,,",
    ]
    assert (folder / "truth_rays.csv").read_text().splitlines() == [
        RAY_HEADER,
        "0.000000000,waist,4,0,3",
        "0.000000000,waist,1,4,4",
        f"{stamp},waist,,,",
        f"{stamp},knee,2,100,120",
    ]


def test_situations_read_back(folder: Path):
    read, made = read_situations(folder / "truth_situations.csv"), situation_table(SITUATIONS)
    for name in ("kind", "first_id", "second_id", "sensor", "start_ns", "end_ns", "complete", "how", "least_m"):
        np.testing.assert_array_equal(getattr(read, name), getattr(made, name), err_msg=name)


def test_situations_come_out_of_the_bag_as_they_went_in():
    merged = Situation("merged_rig", 2, 7, "", 40_000_000, 1_720_000_000, complete=False, how="both", least_m=0.61)
    for situation in (*SITUATIONS[1:], merged):
        _, _, data = encode_detail(situation)
        assert repr(decode_situation(TYPESTORE.deserialize_cdr(data, STRING).data)) == repr(situation)
    for text in ("nothing", "[]", '[{"kind": "near"}]'):
        with pytest.raises(InputError, match=r"a JSON list of one object with kind,first_id"):
            decode_situation(text)


def test_frames_of_situations():
    table = situation_table(
        [
            Situation("merged", 1, 2, "waist", 1_000_000_000, 2_000_000_000),
            Situation("merged", 1, 2, "knee", 1_500_000_000, 2_000_000_000),
        ]
    )
    stamps = np.arange(0, 4_000_000_000, 500_000_000)
    assert np.flatnonzero(table.frames(stamps)[0]).tolist() == [2, 3]
    assert np.flatnonzero(table.frames(stamps, after_s=1.0)[0]).tolist() == [2, 3, 4, 5]
    assert table.select("merged", "knee").pair_frames(stamps) == 1
    assert len(table.select("correlated")) == 0
    assert table.select("correlated").pair_frames(stamps) == 0


def rows_of(detail: TruthDetail) -> list[dict[str, Any]]:
    _, _, data = encode_detail(detail)
    return json.loads(TYPESTORE.deserialize_cdr(data, STRING).data)


def test_the_bag_has_the_columns_of_the_tables(folder: Path):
    headers = {
        topic: (folder / name).read_text().splitlines()[0]
        for topic, name in zip((*DETAIL_TOPICS, "/truth/bases"), (*DETAIL_FILES, "truth_bases.csv"), strict=True)
    }
    assert list(headers.values()) == [BOX_HEADER, RAY_HEADER, SITUATION_HEADER, "t,base,x,y,z,yaw"]
    (base,) = (folder / "truth_bases.csv").read_text().splitlines()[1:]
    assert base == "1.500000000,robot,1.5,-0.25,0.0,3.125"
    for detail in DETAILS:
        topic, _, _ = encode_detail(detail)
        for row in rows_of(detail):
            assert ",".join(row) == headers[topic]
    assert rows_of(DETAILS[0])[1] == {
        "t": 0.0, "camera": "north", "id": 4, "left": 11, "top": 6, "width": 1, "height": 1, "visible_px": 1, "truncated": 0,
    }  # fmt: skip
    assert rows_of(BoxFrame(0, "south", ()))[0]["id"] is None
    assert rows_of(SITUATIONS[1])[0]["sensor"] is None
    assert [encode_detail(each)[:2] for each in SITUATIONS[1:]] == [("/truth/situations", 5), ("/truth/situations", 10)]


def test_a_number_that_is_none_is_not_written(tmp_path: Path):
    with pytest.raises(ValueError, match="inf"), detail_writer(tmp_path) as write:
        write(Situation("correlated", 1, 2, "", 0, 1, least_m=float("inf")))
    assert list(tmp_path.iterdir()) == []
    with detail_writer(tmp_path) as write:
        write(Situation("correlated", 1, 2, "", 0, 1, least_m=nan))
    assert np.isnan(read_situations(tmp_path / "truth_situations.csv").least_m).all()


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (["near,1,2,,0,1,1,,"], "kind is 'near'; 'interaction' or 'correlated' or"),
        (
            ["merged,2,1,a,0,1,1,hidden,"],
            "second_id is '1'; an id above first_id, 2,",
        ),
        (["merged,1,2,,0,1,1,hidden,"], "sensor is empty; the name of a scanner"),
        (["correlated,1,2,a,0,1,1,,"], "sensor is 'a'; an empty cell"),
        (["merged_rig,1,2,a,0,1,1,both,"], "sensor is 'a'; an empty cell"),
        (["correlated,1,2,,3,1,1,,"], "end_t is '1'; a time from start_t, 3, on"),
        (
            ["correlated,1,2,,0,1,1,,-1"],
            "least_m is '-1'; 0 or more, or an empty cell",
        ),
        (["merged,1,2,a,0,1,1,near,"], "how is 'near'; '' or 'joined'"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, rows: list[str], said: str):
    path = tmp_path / "table.csv"
    path.write_text("\n".join([SITUATION_HEADER, *rows]) + "\n")
    with pytest.raises(InputError) as caught:
        read_situations(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_run_without_details_leaves_headers(tmp_path: Path):
    with detail_writer(tmp_path):
        pass
    headers = [(tmp_path / name).read_text() for name in DETAIL_FILES]
    assert headers == [f"{header}\n" for header in (BOX_HEADER, RAY_HEADER, SITUATION_HEADER)]
    assert len(read_situations(tmp_path / "truth_situations.csv")) == 0
