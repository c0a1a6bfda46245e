"""Twins of real recordings, made from their own data: do trackers rank on the twin as they rank on reality?

The recordings are labelled scans of a standing robot (leg_tracker's data set). The room is what most scans show, beam by beam.
People follow the labelled legs, where they were when they were there. The scanner has the recording's beams, range, noise and
lost echoes; its height is not recorded. Twin scans are taken at the recording's stamps. Nothing is tuned on the outcome.

Labels end at the edges of a box. Each tracker gets one figure: F1 of people in the box within 0.5 m, one to one, scan by scan.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from benchmarks.figure import Figure
from benchmarks.recorded_legs import DATA, labelled, on_furniture
from trackers.area import Pose
from trackers.arrays import Array
from trackers.configuration import validate
from trackers.feeding import track_frames
from trackers.filters.gating import distances, max_weight_assignment
from trackers.laser.bearings import returns
from trackers.laser.grouping import pair_off
from trackers.observations import NS_PER_S, LaserScan
from trackers.presets import make_tracker
from trackers.rig import LaserSensor, Rig
from twin import Simulation
from twin.scenario import Scenario
from twin.truth.truth_types import TruthFrame

TRACKERS = ("sort", "laser-kalman", "laser-imm", "laser-vision-learning-laser", "laser-legs", "fusion")
TAUGHT_BY_TWINS = ("laser-legs",)
_SEED = 1000
_GATE_M = 0.5
_HEIGHT_M = 0.3
_RATE_HZ = 7.5
_STANDS = 0.3
"""Share of scans in which a beam must come as far for something to stand there."""
_SAME_M = 0.05
_WALL_M = 0.15
"""Points of neighbouring beams that are nearer than this, or twice their spacing, are on one surface [m]."""
_PAIR_M = 0.7
_STEP_M, _LOST_S = 0.8, 2.5
"""Labels of one person: how far apart in consecutive scans at most [m], and for how long none may be [s]."""
_SMOOTH_S = 0.4
_AWAY = (0.25, 1.5)
"""Room about the labelled box [m]: for edges, and for people to walk."""

People = Mapping[int, Array]
"""Places (n, 2) of people in the box by stamp [ns]."""


def measure() -> Iterator[Figure]:
    """Yield F1 of each tracker on each recording and on its twin, and the rank correlations."""
    if not DATA.is_dir():
        print(f"real-twins: skipped, there are no recorded scans at {DATA}", file=sys.stderr)
        return
    scores = []
    for number in (1, 2, 3):
        scans, real, box = recorded_people(number)
        twin_scans, twin = _twin(scans, real, box)
        rows = np.array([[f1(name, scans, real, box), f1(name, twin_scans, twin, box)] for name in TRACKERS])
        scores.append(rows)
        for tracker, (on_real, on_twin) in zip(TRACKERS, rows.tolist(), strict=True):
            yield Figure(f"positive_{number}, {tracker}: F1 on the recording, {len(scans)} scans", on_real, "", "")
            yield Figure(f"positive_{number}, {tracker}: F1 on its twin, {len(twin_scans)} scans", on_twin, "", "")
        yield from _ranked(f"positive_{number}", rows)
    yield from _ranked("mean of the three", np.mean(scores, axis=0))


def _ranked(name: str, rows: Array) -> Iterator[Figure]:
    """Yield Spearman's rank correlation of all trackers, of those that no twin taught, and how far their F1 are apart."""
    untaught = [place for place, tracker in enumerate(TRACKERS) if tracker not in TAUGHT_BY_TWINS]
    for which, some in (("all trackers", rows), ("trackers that no twin taught", rows[untaught])):
        value = round(float(spearmanr(some[:, 0], some[:, 1]).statistic), 9)  # a fraction, so that 0.9 is 0.9
        yield Figure(f"{name}: rank correlation of {len(some)}, {which}", value, "", ">= 0.9")
        apart = float(np.abs(some[:, 1] - some[:, 0]).mean())
        yield Figure(f"{name}: mean difference of F1, {which}", apart, "", "")


def recorded_people(number: int) -> tuple[list[LaserScan], People, Array]:
    """Return the scans of a recording, people by their labelled legs, and the corners (2, 2) of the box that was labelled [m]."""
    scans, legs = labelled(number)
    legs = legs[~on_furniture(scans, legs)]
    box = np.array([legs[:, 1:].min(axis=0) - _AWAY[0], legs[:, 1:].max(axis=0) + _AWAY[0]])
    people = {scan.stamp_ns: pair_off(legs[legs[:, 0] == place, 1:], _PAIR_M)[0] for place, scan in enumerate(scans)}
    return scans, people, box


def f1(name: str, scans: list[LaserScan], people: People, box: Array) -> float:
    """Return the F1 of a tracker's tracks in the box against people, one to one within the gate."""
    rig = Rig(sensors={"scan": LaserSensor(topic="/scan", room_from_sensor=Pose(xyz=(0, 0, _HEIGHT_M)))})
    tracker = make_tracker(name, rig, (), np.random.default_rng(_SEED))
    right = found = there = 0
    for frame in track_frames(tracker, rig, scans):
        places = np.array([[each.x, each.y] for each in frame.tracks]).reshape(-1, 2)
        away = distances(people[frame.stamp_ns], places)
        person, _ = max_weight_assignment(np.where(away < _GATE_M, _GATE_M - away, 0.0))
        right, there = right + len(person), there + len(away)
        # a track of somebody at the edge is not false
        near = (away < _GATE_M).any(axis=0)
        found += len(person) + int((((places > box[0]) & (places < box[1])).all(axis=1) & ~near).sum())
        found += int(near.sum()) - len(person)
    return 2 * right / max(found + there, 1)


def _twin(scans: list[LaserScan], people: People, box: Array) -> tuple[list[LaserScan], People]:
    """Return the twin's scans nearest to the stamps of the recording's, and its people in the box who can be seen."""
    start_ns = scans[0].stamp_ns
    stamps = (np.array([scan.stamp_ns for scan in scans]) - start_ns) / NS_PER_S
    walks = _walks(stamps, [people[scan.stamp_ns] for scan in scans])
    with tempfile.TemporaryDirectory() as folder:
        room = Path(folder) / "room.xml"
        room.write_text(_room(scans, box))
        content = _scenario(scans, walks, str(room), float(stamps[-1]) + 0.5)
        truth: list[TruthFrame] = []
        with Simulation(validate(Scenario, content, "the twin"), on_truth=truth.append) as simulation:
            taken = [each for each in simulation if isinstance(each, LaserScan)]
    at = np.array([scan.stamp_ns for scan in taken]) / NS_PER_S
    chosen = [taken[place] for place in np.unique(np.abs(at[:, None] - stamps).argmin(axis=0))]
    stands = {
        frame.stamp_ns: np.array([[each.x, each.y] for each in frame.people if each.visible.get("scan", 0) > 0])
        for frame in truth
    }
    inside = {}
    for scan in chosen:
        places = stands[scan.stamp_ns].reshape(-1, 2)
        inside[scan.stamp_ns] = places[((places > box[0]) & (places < box[1])).all(axis=1)]
    return [replace(scan, sensor="scan") for scan in chosen], inside


def _scenario(scans: list[LaserScan], walks: list[Array], room: str, duration_s: float) -> dict[str, Any]:
    first = scans[0]
    return {
        "name": "twin", "seed": _SEED, "duration_s": duration_s, "room": room, "background": "none",
        "people": {
            f"p{number}": {"script": {"kind": "path", "points": walk.tolist()}} for number, walk in enumerate(walks)
        },
        "sensors": {
            "scan": {
                "kind": "laser", "role": "knee", "rate_hz": _RATE_HZ, "mount": {"xyz": [0.0, 0.0, _HEIGHT_M]},
                "beams": first.ranges_m.size, "range_max_m": float(first.range_max_m),
                "field_of_view_deg": float(np.degrees(first.angle_increment_rad) * (first.ranges_m.size - 1)),
                "noise": _noise(scans),
            }
        },
    }  # fmt: skip


def _walks(t: Array, people: list[Array]) -> list[Array]:
    """Link the places of people from scan to scan; return rows t, x, y of each walk [s, m], smoothed."""
    walks: list[list[Array]] = []
    for stamp, places in zip(t, people, strict=True):
        last = [walk for walk in walks if stamp - walk[-1][0] < _LOST_S]
        away = distances(np.array([walk[-1][1:] for walk in last]).reshape(-1, 2), places)
        reach = np.array([_STEP_M + 1.5 * (stamp - walk[-1][0] - 1 / _RATE_HZ) for walk in last])[:, None]
        walk, place = max_weight_assignment(np.where(away < reach, reach - away, 0.0))
        for one, other in zip(walk.tolist(), place.tolist(), strict=True):
            last[one].append(np.array([stamp, *places[other]]))
        new = np.setdiff1d(np.arange(len(places)), place)
        walks += [[np.array([stamp, *places[other]])] for other in new.tolist()]
    kept = [np.array(walk) for walk in walks if walk[-1][0] - walk[0][0] > 1.0]
    for walk in kept:
        weight = np.exp(-0.5 * ((walk[:, None, 0] - walk[:, 0]) / _SMOOTH_S) ** 2)
        walk[:, 1:] = weight @ walk[:, 1:] / weight.sum(axis=1)[:, None]
    return kept


def _standing(scans: list[LaserScan]) -> tuple[Array, Array]:
    """Return how far each beam comes where something stands [m], NaN for nothing, and by how much each echo differs."""
    ranges = np.stack([np.where(returns(scan)[1], scan.ranges_m, np.nan) for scan in scans]).astype(float)
    apart = np.abs(ranges[:, None] - ranges[::7][None])
    share = (apart < _SAME_M).mean(axis=0)  # of scans, by the range of every seventh
    best = share.argmax(axis=0)
    far = np.where(share.max(axis=0) >= _STANDS, ranges[::7][best, np.arange(ranges.shape[1])], np.nan)
    off = ranges - far
    off[~(np.abs(off) < _SAME_M)] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # nothing stands in a beam
        middle = np.nanmedian(off, axis=0)
    return far + middle, off - middle


def _noise(scans: list[LaserScan]) -> dict[str, float]:
    """Measure the noise of echoes of what stands, their step, and the share that is lost."""
    far, off = _standing(scans)
    sigma = 1.4826 * np.nanmedian(np.abs(off))
    ranges = np.unique(np.concatenate([scan.ranges_m[returns(scan)[1]] for scan in scans]))
    lost = ~np.stack([returns(scan)[1] for scan in scans])
    return {
        "sigma_m": float(max(sigma, 1e-3)),
        "quantisation_m": float(np.round(np.median(np.diff(ranges)), 4)),
        "dropout": float(np.median(lost[:, np.isfinite(far)].mean(axis=0))),
        "mixed_pixel": 0.5,
    }


def _room(scans: list[LaserScan], box: Array) -> str:
    """Write what stands as MJCF: a thin wall between points of neighbouring beams, a post for a point alone."""
    far, _ = _standing(scans)
    angle = scans[0].angles_rad
    points = far[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    step = np.hypot(*np.diff(points, axis=0).T)
    joined = step < np.maximum(_WALL_M, 2 * scans[0].angle_increment_rad * np.fmax(far[1:], far[:-1]))
    geoms = []
    for one, other in zip(points[:-1][joined], points[1:][joined], strict=True):
        (x, y), off = (one + other) / 2, other - one
        half, turn = np.hypot(*off) / 2 + 0.002, np.degrees(np.arctan2(off[1], off[0]))
        size, place = f"{half:.4f} 0.005 0.6", f"{x:.4f} {y:.4f} 0.6"
        geoms.append(f'<geom type="box" size="{size}" pos="{place}" euler="0 0 {turn:.2f}"/>')
    alone = np.isfinite(far) & ~np.append(joined, False) & ~np.append(False, joined)
    for place, range_m in zip(points[alone], far[alone], strict=True):
        radius = scans[0].angle_increment_rad * range_m / 2
        geoms.append(f'<geom type="cylinder" size="{radius:.4f} 0.6" pos="{place[0]:.4f} {place[1]:.4f} 0.6"/>')
    (x0, y0), (x1, y1) = box[0] - _AWAY[1], box[1] + _AWAY[1]
    return f"""<mujoco model="recorded">
  <custom><numeric name="walkable_area" data="{x0:.2f} {y0:.2f} {x1:.2f} {y0:.2f} {x1:.2f} {y1:.2f} {x0:.2f} {y1:.2f}"/></custom>
  <worldbody>
    <light type="directional" pos="0 0 5" dir="0 0 -1"/>
    <geom type="plane" size="30 30 1"/>
    {" ".join(geoms)}
  </worldbody>
</mujoco>"""
