"""A robot's bag as drivers write it: clocks that jump or start at 1970, scanners that name no limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded import MS, a_scan, write_ros2_bag

from trackers.errors import InputError
from twin.recording.messages import LASER_SCAN, TYPESTORE, encode
from twin.recording.tables import read_tracks
from twin.run.replay import track_recording

NS_PER_DAY = 86_400 * 10**9
EPOCH_NS = 1_700_000_000 * 10**9
REGULAR = [k * 100 * MS for k in range(20)]


def a_bag(folder, stamps_ns, **changes):
    """A robot's bag of scans with these stamps in their headers, logged every 100 ms."""
    messages = []
    for number, stamp_ns in enumerate(stamps_ns):
        message = TYPESTORE.deserialize_cdr(encode(a_scan(stamp_ns)).data, LASER_SCAN)
        messages.append(("/scan", LASER_SCAN, EPOCH_NS + number * 100 * MS, replace(message, **changes)))
    write_ros2_bag(folder / "bag", messages)
    return folder / "bag"


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    "stamps_ns",
    [
        [*REGULAR[:10], *(stamp + 30 * NS_PER_DAY for stamp in REGULAR[10:])],
        [*REGULAR[:10], *(stamp + EPOCH_NS for stamp in REGULAR[10:])],
        [0, *(stamp + EPOCH_NS for stamp in REGULAR)],
    ],
    ids=["30 days", "from 1970", "one stamp of 0"],
)
def test_a_clock_that_jumps_is_a_gap(tmp_path, stamps_ns):
    result = track_recording(a_bag(tmp_path, stamps_ns), trackers=["laser-imm"], out=tmp_path / "out")
    table = read_tracks(result.files["tracks laser-imm"])
    np.testing.assert_array_equal(table.frame_stamps_ns, stamps_ns)
    assert result.files["report"].exists()


@pytest.mark.parametrize("range_max", [1e6, np.inf])
def test_a_scanner_without_a_limit_is_tracked_and_drawn(tmp_path, range_max):
    bag = a_bag(tmp_path, REGULAR, range_max=range_max)
    result = track_recording(bag, trackers=["laser-imm"], out=tmp_path / "out")
    assert len(read_tracks(result.files["tracks laser-imm"]).frame_stamps_ns) == len(REGULAR)


def test_a_scan_whose_beams_are_nowhere_is_refused_with_bag_and_topic(tmp_path):
    bag = a_bag(tmp_path, REGULAR, angle_increment=0.0)
    with pytest.raises(InputError, match=r"bag: topic /scan: scan of 'scan': angle_increment is 0 rad"):
        track_recording(bag, trackers=["laser-imm"], out=tmp_path / "out", video=False)
    assert not (tmp_path / "out" / "report.html").exists()
