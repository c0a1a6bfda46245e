"""truth.csv and tracks/*.csv: written whole or not at all, read back exactly, every fault named."""

import os
from dataclasses import fields
from math import nan

import numpy as np
import pytest

from trackers.errors import InputError
from trackers.tracks import Track, TrackFrame
from twin.recording.tables import (
    FrameText,
    read_tracks,
    read_truth,
    track_table,
    track_writer,
    truth_table,
    truth_writer,
)
from twin.truth.truth_types import PersonTruth, TruthFrame

TRUTH_HEADER = "t,id,x,y,z,yaw,head_x,head_y,head_z,head_yaw,vx,vy,in_area,visible_waist"
TRACK_HEADER = "t,id,x,y,z,vx,vy,head_x,head_y,head_z,head_yaw,status"
TRUTH_ROW = "0.000000000,1,0.5,1.5,0.9,0,0.5,1.5,1.6,0,0,0,1,0.75"
TRACK_ROW = "0.000000000,1,0.5,1.5,,0,0,,,,,confirmed"

TRUTH_FRAMES = [
    TruthFrame(
        1_700_000_000_123_456_789,
        (
            PersonTruth(2, 0.1, 1 / 3, 0.9, -3.1, 0.2, 0.4, 1.6, 3.0, 0.5, -0.25, True, {"waist": 0.5, "knee": 1.0}),
            PersonTruth(1, -1e-17, 2.0, in_area=False),
        ),
    ),
    TruthFrame(1_700_000_000_123_456_790, ()),
    TruthFrame(1_700_000_000_223_456_789, (PersonTruth(1, 0.0, 2.0, visible={"waist": 0.0}),)),
]
TRACK_FRAMES = [
    TrackFrame(-5, (Track(3, 0.1 + 0.2, -1.0, 0.5, nan, status="coasting"),)),
    TrackFrame(0, ()),
    TrackFrame(1, (Track(9, 1.0, 2.0, 0.0, 0.0, 0.9, 1.0, 2.0, 1.6, -3.0), Track(3, 0.3, -1.0))),
]


def write_tracks(path, frames):
    with track_writer(path) as write:
        for frame in frames:
            write(frame)


def assert_same_table(read, made):
    for column in fields(read):
        if column.name in ("source", "notes"):
            continue
        left, right = getattr(read, column.name), getattr(made, column.name)
        if isinstance(left, dict):
            assert left.keys() == right.keys()
            for name in left:
                np.testing.assert_array_equal(left[name], right[name])
        else:
            assert left.dtype == right.dtype
            np.testing.assert_array_equal(left, right, err_msg=column.name)


def test_truth_reads_back_to_the_bit(tmp_path):
    path = tmp_path / "truth.csv"
    with truth_writer(path, ["waist", "knee"]) as write:
        for frame in TRUTH_FRAMES:
            write(FrameText(frame))
    table = read_truth(path)
    assert_same_table(table, truth_table(TRUTH_FRAMES))
    assert table.id.tolist() == [1, 2, 1]
    assert table.stamps_ns[0] == 1_700_000_000_123_456_789
    assert table.frame_stamps_ns.tolist() == [frame.stamp_ns for frame in TRUTH_FRAMES]


def test_tracks_read_back_to_the_bit(tmp_path):
    path = tmp_path / "tracks" / "mine.csv"
    write_tracks(path, TRACK_FRAMES)
    table = read_tracks(path)
    assert_same_table(table, track_table(TRACK_FRAMES))
    assert table.frame_stamps_ns.tolist() == [-5, 0, 1]
    assert table.status.tolist() == ["coasting", "confirmed", "confirmed"]
    assert table.t.tolist() == [-5e-9, 1e-9, 1e-9]


def test_the_text_is_the_contract(tmp_path):
    with truth_writer(tmp_path / "truth.csv", ["waist"]) as write:
        write(FrameText(TruthFrame(1_500_000_000, (PersonTruth(1, 0.5, 1.5, visible={"waist": 0.75}),))))
        write(FrameText(TruthFrame(1_600_000_000, ())))
    assert (tmp_path / "truth.csv").read_text() == (
        f"{TRUTH_HEADER}\n1.500000000,1,0.5,1.5,,,,,,,,,1,0.75\n1.600000000,,,,,,,,,,,,,\n"
    )
    with track_writer(tmp_path / "tracks.csv") as write:
        write(TrackFrame(100_000_000, (Track(4, np.float64(0.1), 2.0, vx=-0.5, vy=0.0),)))
        write(TrackFrame(200_000_000, ()))
    assert (tmp_path / "tracks.csv").read_text() == (
        f"{TRACK_HEADER},radius95_m\n0.100000000,4,0.1,2.0,,-0.5,0.0,,,,,confirmed,\n0.200000000,,,,,,,,,,,,\n"
    )


# --- whole or not at all


@pytest.mark.parametrize("interruption", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_an_interrupted_table_leaves_nothing_and_keeps_the_old_one(tmp_path, interruption):
    path = tmp_path / "truth.csv"
    path.write_text("old")

    def write_and_stop():
        with truth_writer(path) as write:
            write(FrameText(TRUTH_FRAMES[0]))
            raise interruption

    with pytest.raises(interruption):
        write_and_stop()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["truth.csv"]


def test_the_final_name_appears_at_the_end_only(tmp_path):
    path = tmp_path / "tracks.csv"
    with track_writer(path) as write:
        write(TRACK_FRAMES[0])
        assert not path.exists()
    assert os.listdir(tmp_path) == ["tracks.csv"]


def test_rows_are_on_disk_before_the_end(tmp_path):
    # Streaming: what has been written does not wait in memory.
    with track_writer(tmp_path / "tracks.csv") as write:
        for stamp in range(2000):
            write(TrackFrame(stamp, (Track(1, 0.123456789, 2.0),)))
        (partial,) = tmp_path.iterdir()
        assert partial.stat().st_size > 50_000


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file" / "truth.csv", tmp_path):
        with pytest.raises(InputError, match=r"cannot be written"), truth_writer(path):
            pass


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="this system has no /dev/full to stand for a full disk")
def test_a_full_disk_is_an_input_error(tmp_path):
    path = tmp_path / "tracks.csv"
    partial = tmp_path / f".tracks.csv.{os.getpid()}.partial"
    partial.symlink_to("/dev/full")
    with pytest.raises(InputError, match="No space left"), track_writer(path) as write:
        write(TRACK_FRAMES[0])
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ([TrackFrame(5, ()), TrackFrame(5, ())], "stamps must grow"),
        ([TrackFrame(5, ()), TrackFrame(4, ())], "stamps must grow"),
        ([TrackFrame(5, (Track(1, 0, 0), Track(1, 1, 1)))], "repeated"),
        ([TrackFrame(5, (Track(0, 0, 0),))], "a whole number from 1"),
        ([TrackFrame(5, (Track(1, nan, 0),))], "a place is needed"),
        ([TrackFrame(5, (Track(1, 0, 0, vx=float("inf")),))], "finite"),
        ([TrackFrame(5, (Track(1, 0, 0, status="tentative"),))], "status"),  # type: ignore[arg-type]
    ],
)
def test_nonsense_from_a_tracker_is_loud(tmp_path, frames, message):
    with pytest.raises(ValueError, match=message):
        write_tracks(tmp_path / "tracks.csv", frames)
    assert os.listdir(tmp_path) == []


# --- bad tables


def fault_of(read, path) -> str:
    with pytest.raises(InputError) as caught:
        read(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("column", "value", "expected"),
    [
        ("t", "nan", "a time in seconds"),
        ("t", "", "a time in seconds"),
        ("t", "1e999999", "a time in seconds"),
        ("t", "soon", "a time in seconds"),
        ("id", "nan", "a whole number from 0 on, or a name,"),
        ("id", "-1", "a whole number from 0 on, or a name,"),
        ("id", "1.5", "a whole number from 0 on, or a name,"),
        ("id", "inf", "a whole number from 0 on, or a name,"),
        ("id", "", "a whole number from 0 on, or a name,"),
        ("x", "nan", "a finite number"),
        ("x", "", "a finite number"),
        ("y", "-inf", "a finite number"),
        ("y", "1_0", "a finite number"),
        ("z", "high", "a finite number or an empty cell"),
        ("head_yaw", "inf", "a finite number or an empty cell"),
    ],
)
@pytest.mark.parametrize(
    ("read", "header", "row"), [(read_truth, TRUTH_HEADER, TRUTH_ROW), (read_tracks, TRACK_HEADER, TRACK_ROW)]
)
def test_a_bad_cell_is_named(tmp_path, read, header, row, column, value, expected):
    cells = dict(zip(header.split(","), row.split(","), strict=True))
    bad = ",".join({**cells, column: value}.values())
    path = tmp_path / "table.csv"
    path.write_text(f"{header}\n{row}\n{bad.replace('0.000000000', '0.1', 1)}\n")
    message = fault_of(read, path)
    found = f"is {value!r}" if value else "is empty"
    assert message == f"{path}: line 3: {column} {found}; {expected} is expected"


def test_an_unknown_status_is_named(tmp_path):
    path = tmp_path / "tracks.csv"
    path.write_text(f"{TRACK_HEADER}\n{TRACK_ROW.replace('confirmed', 'tentative')}\n")
    assert fault_of(read_tracks, path).endswith("line 2: status is 'tentative'; 'confirmed' or 'coasting' is expected")


def test_a_flag_that_is_none_is_named(tmp_path):
    path = tmp_path / "truth.csv"
    path.write_text(f"{TRUTH_HEADER}\n{TRUTH_ROW.replace(',1,0.75', ',maybe,0.75')}\n")
    assert "line 2: in_area is 'maybe'; 0 or 1 is expected" in fault_of(read_truth, path)


@pytest.mark.parametrize("share", ["1.5", "-0.1", "inf", "most"])
def test_a_visible_share_that_is_none_is_named(tmp_path, share):
    path = tmp_path / "truth.csv"
    path.write_text(f"{TRUTH_HEADER}\n{TRUTH_ROW.replace('0.75', share)}\n")
    assert f"line 2: visible_waist is '{share}'" in fault_of(read_truth, path)


@pytest.mark.parametrize(
    ("read", "header", "row"), [(read_truth, TRUTH_HEADER, TRUTH_ROW), (read_tracks, TRACK_HEADER, TRACK_ROW)]
)
class TestBadFiles:
    def test_missing_file(self, tmp_path, read, header, row):
        assert "cannot be read" in fault_of(read, tmp_path / "none.csv")

    def test_folder(self, tmp_path, read, header, row):
        assert "cannot be read" in fault_of(read, tmp_path)

    def test_empty_file(self, tmp_path, read, header, row):
        path = tmp_path / "table.csv"
        path.write_text("")
        assert "is empty" in fault_of(read, path)

    def test_no_text(self, tmp_path, read, header, row):
        path = tmp_path / "table.csv"
        path.write_bytes(b"\x89PNG\xff\xfe\x00")
        assert "is not a text file in UTF-8" in fault_of(read, path)

    @pytest.mark.parametrize("column", ["t", "id", "x", "y"])
    def test_missing_column(self, tmp_path, read, header, row, column):
        path = tmp_path / "table.csv"
        path.write_text(header.replace(f"{column},", "", 1) + "\n")
        assert f"column '{column}' is missing" in fault_of(read, path)

    def test_column_twice(self, tmp_path, read, header, row):
        path = tmp_path / "table.csv"
        path.write_text(f"{header},x\n{row},0\n")
        assert "column 'x' stands there twice" in fault_of(read, path)

    def test_short_row(self, tmp_path, read, header, row):
        path = tmp_path / "table.csv"
        path.write_text(f"{header}\n{row}\n0.1,2,3\n")
        assert "line 3: has 3 cells" in fault_of(read, path)

    def test_duplicate_row(self, tmp_path, read, header, row):
        path = tmp_path / "table.csv"
        other = row.replace("0.000000000,1", "0.1,1", 1)
        path.write_text(f"{header}\n{row}\n{other}\n{row.replace('0.000000000', '0', 1)}\n")
        assert "line 4: t 0, id 1 stands on line 2 too" in fault_of(read, path)

    def test_frame_without_anybody_and_with_somebody(self, tmp_path, read, header, row):
        path = tmp_path / "table.csv"
        path.write_text(f"{header}\n{row}\n0.0{',' * header.count(',')}\n")
        assert "line 3: t 0.0, id empty contradicts line 2" in fault_of(read, path)

    def test_frame_without_anybody_twice(self, tmp_path, read, header, row):
        path = tmp_path / "table.csv"
        nobody = f"{',' * header.count(',')}\n"
        path.write_text(f"{header}\n0.0{nobody}0.00{nobody}")
        assert "line 3: t 0.00, id empty stands on line 2 too" in fault_of(read, path)

    def test_header_only_is_an_empty_table(self, tmp_path, read, header, row):
        path = tmp_path / "table.csv"
        path.write_text(f"{header}\n")
        table = read(path)
        assert table.id.size == table.frame_stamps_ns.size == 0

    def test_other_peoples_habits(self, tmp_path, read, header, row):
        # A byte order mark, Windows line ends, blank lines, rows out of order, ids as floats, columns of their own.
        path = tmp_path / "table.csv"
        later = row.replace("0.000000000,1", "0.10,2.0", 1)
        text = f"{header},note\n{later},a\n\n{row},b\n"
        path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
        table = read(path)
        assert table.id.tolist() == [1, 2]
        assert table.stamps_ns.tolist() == [0, 100_000_000]


def test_building_a_table_from_repeated_frames_is_loud():
    with pytest.raises(ValueError, match="stands there 2 times"):
        track_table([TrackFrame(1, ()), TrackFrame(1, ())])
    with pytest.raises(ValueError, match="stands there 2 times"):
        truth_table([TruthFrame(1, (PersonTruth(1, 0, 0), PersonTruth(1, 1, 1)))])
