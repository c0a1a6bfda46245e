"""What a recording holds, in short: whose walk it shows, and how far its scanners scatter."""

from __future__ import annotations

import hashlib
from itertools import pairwise
from pathlib import Path

import numpy as np

from trackers.arrays import Array
from trackers.observations import NS_PER_S
from twin.recording.bag import open_bag
from twin.recording.tables import read_truth
from twin.recording.topics import SCAN, sensor_topic
from twin.scenario import Scenario

_PLACE_M = 1e-4
"""Places are told apart so finely: coarser than what another processor's last bits come to, finer than any other walk."""
_ONE_SURFACE_M = 0.05
"""Ranges of one beam, a scan apart, that differ by more are of two surfaces."""


def people_digest(truth: Path) -> str:
    """Digests of where people are in a `truth.csv`, at its first whole second and at all; "" where no moment is one.

    They are the same whatever sensors look at them, and in whatever order they are named; the first one is also the same
    however long they are looked at.
    """
    table = read_truth(truth)
    places = np.stack([table.x, table.y, table.head_x, table.head_y, table.head_z], axis=-1)
    rows = np.column_stack([table.stamps_ns, np.rint(places / _PLACE_M).astype(np.int64)])
    rows = rows[table.stamps_ns % NS_PER_S == 0]
    if not len(rows):
        return ""
    ordered = rows[np.lexsort(rows.T[::-1])]
    start = ordered[ordered[:, 0] == ordered[0, 0]]
    return "-".join(hashlib.sha256(np.ascontiguousarray(each).tobytes()).hexdigest()[:12] for each in (start, ordered))


def start_of(people: str) -> str:
    """The part of such digests that tells where people are at first."""
    return people.partition("-")[0]


def range_scatter_m(recording: Path, scenario: Scenario) -> dict[str, float]:
    """Of each scanner, by where it is, the σ of a range [m]: of two scans in a row, where a beam meets one surface in both.

    People who move add to it, the same in every recording of them. Scanners at one place count as one.
    """
    topics = {
        sensor_topic(name, SCAN): scanner_name(sensor.mount.xyz)
        for name, sensor in scenario.sensors.items()
        if sensor.kind == "laser"
    }
    scans: dict[str, list[Array]] = {topic: [] for topic in topics}
    with open_bag(recording) as bag:
        for topic, _, message in bag.messages(topics):
            scans[topic].append(np.array(message.ranges, dtype=np.float64))
    squares: dict[str, list[Array]] = {}
    for topic, ranges in scans.items():
        with np.errstate(invalid="ignore"):  # inf − inf where neither beam returns
            differences = [after - before for before, after in pairwise(ranges) if after.size == before.size]
        for each in differences:
            squares.setdefault(topics[topic], []).append(each[np.abs(each) < _ONE_SURFACE_M] ** 2)
    pooled = {place: np.concatenate(each) for place, each in squares.items()}
    return {place: float(np.sqrt(each.mean() / 2)) for place, each in pooled.items() if each.size}


def scanner_name(xyz: tuple[float, float, float]) -> str:
    """A scanner by where it is [m, room frame]: whatever it is called, from there it sees what it saw."""
    return "scanner at " + ", ".join(f"{value:g}" for value in xyz)
