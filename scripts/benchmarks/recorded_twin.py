"""Twins of labelled recordings, each made from its own data: the room, the people, the scanner and the labels.

The recordings are labelled scans of a standing robot (leg_tracker's data set). The room is what most scans show, beam by beam.
People follow the labelled legs, and moving clusters without a label where the labelled sector ends. The scanner has the
recording's beams, range, noise and lost echoes; its height is not recorded. Twin scans are taken at the recording's stamps,
and its legs are labelled as the recording's are: the same clusters, in the same sector, of what beams meet people.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.recorded_legs import labelled, on_furniture
from trackers.arrays import Array
from trackers.configuration import validate
from trackers.filters.gating import distances, max_weight_assignment
from trackers.laser.bearings import returns
from trackers.laser.clusters import pair_off
from trackers.observations import NS_PER_S, LaserScan
from twin import Simulation
from twin.scenario import Scenario
from twin.sensors.laser_noise import LASER_NOISE
from twin.truth.truth_types import RayFrame, TruthDetail

HEIGHTS_M = (0.3, 0.45)
"""Heights of the scanner, of which each twin draws one: no recording has it, but its legs are as wide as between these [m]."""
_RATE_HZ = 7.5
_STANDS = 0.3
"""Share of scans in which a beam must come as far for something to stand there."""
_SAME_M = 0.05
_WALL_M = 0.15
"""Points of neighbouring beams that are nearer than this, or twice their spacing, are on one surface [m]."""
_SPLIT_M, _LEAST = 0.13, 3
"""Labelled clusters: gap of consecutive returns between two, and the fewest returns of one, as leg_tracker's [m]."""
_LABEL_M = 0.15
_PAIR_M = 0.7
_STEP_M, _LOST_S, _FITTED = 0.5, 1.5, 8
"""Walks: how far from where it leads a place may be, and the same for each second without one [m]; for how long there may be
none [s]; how many places tell where it leads."""
_SMOOTH_S = 0.4
_ROUND_M = 1.0
"""Room about the people's ways [m]."""

People = Mapping[int, Array]
"""Places (n, 2) of people with a labelled leg by stamp [ns]."""


@dataclass(frozen=True)
class Sector:
    """The sector about the scanner whose legs are labelled: bearings [rad] and the largest range [m]."""

    low_rad: float
    high_rad: float
    range_m: float

    @classmethod
    def around(cls, legs: Array) -> Sector:
        """Return the smallest sector, of bearings alike to both sides, that holds all labels (k, 2) [m]."""
        bearing = np.abs(np.arctan2(legs[:, 1], legs[:, 0])).max()
        return cls(float(-bearing), float(bearing), float(np.hypot(*legs.T).max()))

    def holds(self, places: Array, edge_m: float = 0.0) -> NDArray[np.bool_]:
        """Return a mask (n,) of the places (n, 2) that are in the sector, and at least so far from its edge [m]."""
        range_m = np.hypot(*places.T)
        beside = np.arcsin(np.clip(edge_m / np.maximum(range_m, 1e-9), 0, 1))
        bearing = np.arctan2(places[:, 1], places[:, 0])
        return (
            (bearing >= self.low_rad + beside)
            & (bearing <= self.high_rad - beside)
            & (range_m <= self.range_m - edge_m)
        )


@dataclass(frozen=True)
class Labelled:
    """Scans, the legs in them that have a label (scan, x, y) [m], people by these, and the labelled sector."""

    scans: list[LaserScan]
    legs: Array
    sector: Sector

    @cached_property
    def people(self) -> People:
        """Return the places of people by stamp: pairs of labelled legs, and those left alone."""
        return {
            scan.stamp_ns: pair_off(self.legs[self.legs[:, 0] == place, 1:], _PAIR_M)[0]
            for place, scan in enumerate(self.scans)
        }

    def restamped(self, stamps_ns: Mapping[int, int]) -> Labelled:
        """Return the scans with these numbers at other stamps [ns], in their order."""
        order = sorted(stamps_ns, key=stamps_ns.__getitem__)
        legs = [self.legs[self.legs[:, 0] == place] - (place - number, 0, 0) for number, place in enumerate(order)]
        scans = [replace(self.scans[place], stamp_ns=stamps_ns[place]) for place in order]
        return Labelled(scans, np.concatenate(legs), self.sector)

    @property
    def widths_m(self) -> Array:
        """Return the widths (k,) of the clusters with a label: of all their beams at their range [m]."""
        found = []
        for place, scan in enumerate(self.scans):
            middles, n_beam = _clusters(scan, np.ones(scan.ranges_m.size, np.bool_))
            is_leg = (distances(middles, self.legs[self.legs[:, 0] == place, 1:]) < _LABEL_M / 3).any(axis=1)
            found.append((n_beam * np.hypot(*middles.T))[is_leg] * scan.angle_increment_rad)
        return np.concatenate(found)

    @property
    def gaps_m(self) -> Array:
        """Return the distances (k,) of the two legs of each person with two [m]."""
        apart = []
        for place in range(len(self.scans)):
            legs = self.legs[self.legs[:, 0] == place, 1:]
            if len(legs) == 2 and len(pair_off(legs, _PAIR_M)[0]) == 1:
                apart.append(np.hypot(*(legs[0] - legs[1])))
        return np.array(apart)


def recording(number: int) -> Labelled:
    """Read positive_<number>_extracted.npz; labels on furniture are left out."""
    scans, legs = labelled(number)
    sector = Sector.around(legs[:, 1:])
    return Labelled(scans, legs[~on_furniture(scans, legs)], sector)


def make_twin(real: Labelled, seed: int) -> Labelled:
    """Simulate the twin of a recording; return its scans nearest to the recording's stamps, and the legs labelled in them."""
    start_ns = real.scans[0].stamp_ns
    stamps = (np.array([scan.stamp_ns for scan in real.scans]) - start_ns) / NS_PER_S
    walks = walks_of(real)
    met: dict[int, RayFrame] = {}

    def keep(detail: TruthDetail) -> None:
        if isinstance(detail, RayFrame):
            met[detail.stamp_ns] = detail

    with tempfile.TemporaryDirectory() as folder:
        room = Path(folder) / "room.xml"
        room.write_text(_room(real.scans, np.concatenate(walks)[:, 1:]))
        content = _scenario(real.scans, walks, str(room), float(stamps[-1]) + 0.5, seed)
        with Simulation(validate(Scenario, content, "the twin"), on_detail=keep) as simulation:
            taken = [each for each in simulation if isinstance(each, LaserScan)]
    at = np.array([scan.stamp_ns for scan in taken]) / NS_PER_S
    chosen = [taken[place] for place in np.unique(np.abs(at[:, None] - stamps).argmin(axis=0))]
    legs = []
    for place, scan in enumerate(chosen):
        on_people = np.zeros(scan.ranges_m.size, np.bool_)
        for run in met[scan.stamp_ns].runs:
            on_people[run.first_beam : run.last_beam + 1] = True
        middles, _ = _clusters(scan, on_people)
        middles = middles[real.sector.holds(middles)]
        legs.append(np.column_stack([np.full(len(middles), place), middles]))
    return Labelled([replace(scan, sensor="scan") for scan in chosen], np.concatenate(legs), real.sector)


def _clusters(scan: LaserScan, among: NDArray[np.bool_]) -> tuple[Array, NDArray[np.intp]]:
    """Form clusters as the labelling does; return middles (k, 2) [m] and numbers of beams of those mostly among some beams."""
    there = returns(scan)[1]
    points = _points(scan)
    apart = np.hypot(*np.diff(points[there], axis=0).T) > _SPLIT_M
    groups = np.split(np.flatnonzero(there), np.flatnonzero(apart) + 1)
    kept = [beams for beams in groups if len(beams) >= _LEAST and among[beams].mean() > 0.5]
    middles = np.array([points[beams].mean(axis=0) for beams in kept]).reshape(-1, 2)
    return middles, np.array([beams[-1] - beams[0] + 1 for beams in kept], np.intp)


def _points(scan: LaserScan) -> Array:
    return scan.ranges_m[:, None] * np.column_stack([np.cos(scan.angles_rad), np.sin(scan.angles_rad)])


def walks_of(real: Labelled) -> list[Array]:
    """Link the places of people from scan to scan; return rows t, x, y of each walk with labels [s, m], smoothed.

    Where no leg can be labelled, clusters off what stands carry a walk on.
    """
    far, _ = _standing(real.scans)
    walks: list[list[Array]] = []  # rows t, x, y, and 1 for a place with a label
    for scan, labels in zip(real.scans, real.people.values(), strict=True):
        t = scan.t - real.scans[0].t
        moving, _ = _clusters(scan, ~(np.abs(scan.ranges_m - far) < 2 * _SAME_M))
        beyond, _ = pair_off(moving[~real.sector.holds(moving)], _PAIR_M)
        beyond = beyond[(distances(beyond, labels) > _PAIR_M / 2).all(axis=1)]  # a leg is on either side of the edge
        rows = [np.array([t, *place, with_label]) for with_label in (1, 0) for place in (beyond, labels)[with_label]]
        last = [walk for walk in walks if t - walk[-1][0] < _LOST_S]
        leads = np.array([_lead(np.array(walk[-_FITTED:]), t) for walk in last]).reshape(-1, 2)
        away = distances(leads, np.array(rows).reshape(-1, 4)[:, 1:3])
        reach = np.array([_STEP_M * (1 + t - walk[-1][0]) for walk in last])[:, None]
        walk, place = max_weight_assignment(np.where(away < reach, reach - away, 0.0))
        for one, other in zip(walk.tolist(), place.tolist(), strict=True):
            last[one].append(rows[other])
        walks += [[rows[other]] for other in np.setdiff1d(np.arange(len(rows)), place).tolist()]
    kept = [np.array(walk) for walk in walks if walk[-1][0] - walk[0][0] > 1.0]
    return [smoothed(walk[:, :3]) for walk in kept if walk[:, 3].sum() > 1.0 * _RATE_HZ / 2]


def _lead(rows: Array, t: float) -> Array:
    """Return where the last rows t, x, y of a walk lead [m]: on from the last, at the speed of a line through them."""
    off = rows[:, 0] - rows[:, 0].mean()
    velocity = off @ rows[:, 1:3] / max(float(off @ off), 1e-9) if len(rows) > 2 else np.zeros(2)
    return rows[-1, 1:3] + (t - rows[-1, 0]) * velocity


def smoothed(walk: Array) -> Array:
    """Fit a line about each row, weighted by distance in time: a mean would slow people down at both ends."""
    apart = walk[:, None, 0] - walk[:, 0]  # of each row, from all
    weight = np.exp(-0.5 * (apart / _SMOOTH_S) ** 2)
    weight /= weight.sum(axis=1, keepdims=True)
    middle = (weight * -apart).sum(axis=1, keepdims=True)
    off = -apart - middle
    spread = (weight * off**2).sum(axis=1, keepdims=True)
    lever = weight * (1 - middle * off / np.maximum(spread, 1e-9))
    return np.column_stack([walk[:, 0], lever @ walk[:, 1:]])


def _scenario(scans: list[LaserScan], walks: list[Array], room: str, duration_s: float, seed: int) -> dict[str, Any]:
    first, height_m = scans[0], float(np.random.default_rng(seed).uniform(*HEIGHTS_M))
    return {
        "name": "twin", "seed": seed, "duration_s": duration_s, "room": room, "background": "none",
        "people": {
            f"p{number}": {"script": {"kind": "path", "points": walk.tolist()}} for number, walk in enumerate(walks)
        },
        "sensors": {
            "scan": {
                "kind": "laser", "role": "knee", "rate_hz": _RATE_HZ, "mount": {"xyz": [0.0, 0.0, height_m]},
                "beams": first.ranges_m.size, "range_max_m": float(first.range_max_m),
                "field_of_view_deg": float(np.degrees(first.angle_increment_rad) * (first.ranges_m.size - 1)),
                "noise": _noise(scans),
            }
        },
    }  # fmt: skip


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
        "mixed_pixel": LASER_NOISE["hokuyo"].mixed_pixel,
        "divergence_deg": LASER_NOISE["hokuyo"].divergence_deg,
    }


def _room(scans: list[LaserScan], ways: Array) -> str:
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
    (x0, y0), (x1, y1) = ways.min(axis=0) - _ROUND_M, ways.max(axis=0) + _ROUND_M
    return f"""<mujoco model="recorded">
  <custom><numeric name="walkable_area" data="{x0:.2f} {y0:.2f} {x1:.2f} {y0:.2f} {x1:.2f} {y1:.2f} {x0:.2f} {y1:.2f}"/></custom>
  <worldbody>
    <light type="directional" pos="0 0 5" dir="0 0 -1"/>
    <geom type="plane" size="30 30 1"/>
    {" ".join(geoms)}
  </worldbody>
</mujoco>"""
