"""Recorded scans of `../shared/data`: labelled legs, and people walking past a robot."""

from pathlib import Path

import numpy as np
import pytest

from trackers.observations import NS_PER_S, LaserScan

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "lasers"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"the recorded scans are not at {DATA}")


def labelled(number: int) -> tuple[list[LaserScan], np.ndarray]:
    with np.load(DATA / f"positive_{number}_extracted.npz") as file:
        angle_min, increment, range_min, range_max, _ = file["scan_amin_inc_rmin_rmax_scantime"]
        scans = [
            LaserScan(
                "scan",
                round(t * NS_PER_S),
                ranges,
                float(angle_min),
                float(increment),
                float(range_min),
                float(range_max),
            )
            for t, ranges in zip(file["scan_stamp"], file["scan_ranges"], strict=True)
        ]
        return scans, file["legs_scanidx_x_y"]


def on_furniture(scans: list[LaserScan], legs: np.ndarray) -> np.ndarray:
    """Which labels have a return within 0.1 m in the same beam in half of all scans: no leg stands that long here."""
    ranges = np.stack([scan.ranges_m for scan in scans])
    bearing, label_range = np.arctan2(legs[:, 2], legs[:, 1]), np.hypot(legs[:, 1], legs[:, 2])
    beam = np.abs(scans[0].angles_rad - bearing[:, None]).argmin(axis=1)
    return (np.abs(ranges[:, beam] - label_range) < 0.1).mean(axis=0) >= 0.5


def walkers_in_the_robots_bag() -> list[LaserScan]:
    from rosbags.highlevel import AnyReader

    scans = []
    with AnyReader([DATA / "demo_stationary_simple_environment.bag"]) as reader:
        connections = [c for c in reader.connections if c.msgtype == "sensor_msgs/msg/LaserScan"]
        for connection, _, raw in reader.messages(connections):
            message = reader.deserialize(raw, connection.msgtype)
            stamp_ns = message.header.stamp.sec * NS_PER_S + message.header.stamp.nanosec
            limits = (message.angle_min, message.angle_increment, message.range_min, message.range_max)
            scans.append(LaserScan("scan", stamp_ns, np.asarray(message.ranges, np.float32), *limits))
    return scans
