"""The real inputs that mutants are made of: the shipped models, and a recording, results and an environment made once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag1
from rosbags.typesys import Stores, get_typestore

from benchmarks.fuzz.direct import made_up
from trackers.environment import PointCloud, build_environment, save_environment
from trackers.observations import LaserScan
from twin.models import MODELS
from twin.recording.bags.bag import open_bag
from twin.recording.reader import Recording
from twin.recording.ros.ros_messages import time_message
from twin.run.live import run_scenario
from twin.scenario import load_scenario
from twin.suites.cache import RecordingCache
from twin.suites.cluster import Workers
from twin.suites.run import run_suite
from twin.suites.spec import load_suite
from twin.suites.worker import CaseResult, CaseWork

SMALL = """\
name: small
room: lab
duration_s: 1
area: [[-2.0, 0.6], [2.0, 0.6], [2.0, 2.8], [-2.0, 2.8]]
people:
  ann: {height_m: 1.68, shirt: pink, script: {kind: wander}}
  bob: {start: [-1.5, 1.0], script: {kind: walk, waypoints: [[1.5, 2.0], [-1.5, 1.0]], repeat: true}}
  cleo:
    start: [1.0, 1.5]
    script:
      - {kind: bend, angle_deg: 80, when: {near: bob, within_m: 1.5}}
      - {kind: look, at: ann}
      - {kind: follow, person: ann, distance_m: 1.0}
housings:
  pole: {mount: {xyz: [0, 0, 0.95], yaw_deg: 90}}
sensors:
  waist: {kind: laser, role: waist, rate_hz: 10, housing: pole, mount: {xyz: [0, 0, 0]}, noise: default}
  knee: {kind: laser, role: knee, rate_hz: 10, mount: {xyz: [0, 0, 0.45], yaw_deg: 90}, field_of_view_deg: 180,
         resolution_deg: 0.5, range_min_m: 0.02, range_max_m: 8, sweep_time_s: 0.02, phase_s: 0.01, noise: {sigma_m: 0.02}}
  fisheye: {kind: fisheye, rate_hz: 10, mount: {xyz: [0, 0, 1.05], yaw_deg: 90}, lens: equidistant_185, size: [96, 96]}
lights: [{at_s: 0.1, name: ceiling_lights, brightness: 0.5}]
faults: {lossy: {sensor: knee, kind: dropout, probability: 0.2, from_s: 0.1, to_s: 0.15}}
trackers:
  laser-imm: {knee: {min_samples: 4}, track_management: {coast_s: 1.2}}
  laser-kalman: {}
"""
"""A scenario with a bit of everything, soon simulated."""

SUITE = """\
name: tiny
description: Two seeds of a short scenario.
limit_s: 60
seeds: [0, 1]
trackers: [laser-imm, laser-kalman]
set: {duration_s: 0.3}
scenarios:
  - scenario: small.yaml
    name: small
    grid: {sensors.knee.rate_hz: [5, 10]}
    variants: [{}, {people.ann.height_m: 1.9}]
  - {scenario: small.yaml, name: other, seeds: 1, trackers: [laser-imm], set: {background: none}}
tolerances: {mota: {absolute: 0.01}, motp_m: {relative: 0.1}}
"""


CACHED = """\
name: cached
seeds: [0]
trackers: [laser-imm]
set: {duration_s: 0.3, sensors.fisheye: null}
scenarios: [{scenario: small.yaml}]
"""
"""A suite of one case, whose recording is in the cache."""


@dataclass(frozen=True)
class Inputs:
    """Real inputs, in a folder of their own.

    scenarios, suites, rooms: texts of shipped files and of ours; recording: a folder that `twin run` left; ros1: a robot's
    bag; messages: what the recording holds, (topic, type, log time [ns], message) each; environment: an .npz. In `folder` are
    results of `SUITE` too (`suite`), `CACHED` as cached.yaml, and its recording (`cache`).
    """

    folder: Path
    scenarios: tuple[str, ...]
    suites: tuple[str, ...]
    rooms: tuple[str, ...]
    recording: Path
    ros1: Path
    messages: tuple[tuple[str, str, int, Any], ...]
    environment: Path


def make_inputs(folder: Path) -> Inputs:
    """The real inputs, made in `folder`; a few seconds."""
    small = folder / "small.yaml"
    small.write_text(SMALL, encoding="utf-8")
    run_scenario(load_scenario(small), trackers=["laser-imm"], out=folder / "run", video=False)
    shipped = {
        kind: [path.read_text(encoding="utf-8") for path in sorted((MODELS / kind).iterdir()) if path.is_file()]
        for kind in ("scenarios", "suites", "rooms")
    }
    _write_ros1(folder / "robot.bag", Recording(folder / "run" / "recording.mcap"))
    _write_environment(folder / "room.npz")
    _run_suite(folder, "suite.yaml", SUITE, folder / "suite", made_up)
    _run_suite(folder, "cached.yaml", CACHED, folder / "cached", None)
    return Inputs(
        folder,
        # Ours more often than the shipped ones, which take longer.
        scenarios=(*[SMALL] * 8, *shipped["scenarios"]),
        suites=(*[SUITE] * 8, *shipped["suites"]),
        rooms=tuple(shipped["rooms"]),
        recording=folder / "run",
        ros1=folder / "robot.bag",
        messages=_messages(folder / "run" / "recording.mcap"),
        environment=folder / "room.npz",
    )


def _run_suite(
    folder: Path, name: str, content: str, out: Path, function: Callable[[CaseWork], CaseResult] | None
) -> None:
    (folder / name).write_text(content, encoding="utf-8")
    suite, path = load_suite(folder / name)
    run_suite(suite, path, out, RecordingCache(folder / "cache", 10**9), Workers(jobs=1), function=function)


def _messages(recording: Path) -> tuple[tuple[str, str, int, Any], ...]:
    with open_bag(recording) as bag:
        types = bag.topics
        return tuple((topic, types[topic].msgtype, log_ns, message) for topic, log_ns, message in bag.messages(types))


def _write_ros1(path: Path, recording: Recording) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    header, scan_message = store.types["std_msgs/msg/Header"], store.types["sensor_msgs/msg/LaserScan"]
    with rosbag1.Writer(path) as writer:
        connection = writer.add_connection("/scan", scan_message.__msgtype__, typestore=store)
        scans = [each for each in recording.observations() if isinstance(each, LaserScan) and each.sensor == "knee"]
        for number, scan in enumerate(scans):
            stamp_ns = scan.stamp_ns + 1_700_000_000 * 10**9
            message = scan_message(
                header=header(seq=number, stamp=time_message(stamp_ns), frame_id="laser"),
                angle_min=scan.angle_min_rad,
                angle_max=-scan.angle_min_rad,
                angle_increment=scan.angle_increment_rad,
                time_increment=0.0,
                scan_time=0.1,
                range_min=scan.range_min_m,
                range_max=scan.range_max_m,
                ranges=scan.ranges_m,
                intensities=np.zeros(0, np.float32),
            )
            writer.write(connection, stamp_ns, store.serialize_ros1(message, scan_message.__msgtype__))


def _write_environment(path: Path) -> None:
    """A box of 4 m x 3 m x 2.5 m, looked at from its middle, a table in a corner."""
    rng = np.random.default_rng(0)
    half = np.array([2.0, 1.5, 1.25])
    rays = rng.standard_normal((60_000, 3))
    points = rays * np.min(half / np.abs(rays), axis=1)[:, None] + [0, 0, 1.25]
    table = np.column_stack([rng.uniform(0.8, 1.6, 4000), rng.uniform(0.4, 1.0, 4000), np.full(4000, 0.7)])
    every = np.concatenate([points, table])
    cloud = PointCloud(every, np.zeros(len(every), np.int16), np.array([[0.0, 0.0, 1.25]]))
    save_environment(build_environment(cloud, room="box"), path)
