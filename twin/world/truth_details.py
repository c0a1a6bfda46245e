"""Detailed truth: boxes in pictures, people met by beams, poses of bases that drive, situations of two people."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from trackers.observations import NS_PER_S, LaserScan
from twin.instant.snapshot import Snapshot
from twin.sensors.sensor import Reading
from twin.truth.body_outlines import BodyOutlines
from twin.truth.situations import (
    CORRELATED_M,
    INTERACTION_M,
    OpenSituations,
    Pair,
    PairState,
    ScanPoints,
    joined_pairs,
    merged_pairs,
    ordered_pairs,
    pairs_within,
    scan_points,
)
from twin.truth.truth_types import BasesFrame, BaseTruth, BoxFrame, RayFrame, RayRun, Situation, TruthDetail, TruthFrame
from twin.truth.visibility import PersonImaging, SensorView, first_hits, person_boxes
from twin.world.world import World


def person_runs(person_of_ray: NDArray[np.int16]) -> tuple[RayRun, ...]:
    """Find runs of equal ids in (n_beam,) ids by beam, those of the room (0) left out."""
    if person_of_ray.size == 0:
        return ()
    changes = ((person_of_ray[1:] != person_of_ray[:-1]).nonzero()[0] + 1).tolist()
    starts, stops = [0, *changes], [*changes, person_of_ray.size]
    runs = zip(person_of_ray[starts].tolist(), starts, stops, strict=True)
    return tuple(RayRun(id_, start, stop - 1) for id_, start, stop in runs if id_ > 0)


def _base(name: str, room_from_base: NDArray[np.float64]) -> BaseTruth:
    x, y, z = room_from_base[:3, 3].tolist()
    return BaseTruth(name, x, y, z, float(np.arctan2(room_from_base[1, 0], room_from_base[0, 0])))


class TruthDetails:
    """Maker of the details, passed to `tell` in the order of stamps, situations when they end.

    It gets the truth of every stamp (`people`), then every reading at that stamp (`look`) as measured, before delays and
    faults; readings that are not made have no truth.

    Simplified: for a sweeping scanner, hidden people are those at the time of the first beam; for a camera with motion blur,
    the box is that at the stamp.
    """

    def __init__(
        self,
        world: World,
        views: Mapping[str, SensorView],
        cameras: Mapping[str, PersonImaging],
        boxes_hz: float,
        tell: Callable[[TruthDetail], object],
    ) -> None:
        """`boxes_hz`: greatest rate of a camera's pictures with boxes; 0: none."""
        self._world = world
        self._views = self._now = views  # as they are, and in the room at the stamp reported last
        self._cameras = cameras
        self._boxes_hz = boxes_hz
        self._tell = tell
        self._outlines = BodyOutlines(world.scene.model, world.scene.person_of_geom)
        self._row = {world.scene.ids[name]: row for row, name in enumerate(world.scene.names)}  # of each id
        self._situations = OpenSituations()
        self._last_period: dict[str, int] = {}
        self._untold: list[Situation] = []
        self._looks: dict[str, ScanPoints] = {}
        self._scanned_ns: int | None = None  # frame of merging for the rig not judged yet
        self._near: dict[Pair, float] = {}
        self._present = np.zeros(0, dtype=np.int16)
        self._places: dict[int, NDArray[np.float64]] = {}  # all positions at the last stamp, (2,) [m] by id

    def correlated(self, frame: TruthFrame) -> dict[Pair, PairState]:
        """Return the pairs of people whose outlines are near each other at a stamp; no other stamp counts."""
        snapshot = self._world.snapshot(frame.stamp_ns / NS_PER_S)
        present = np.array([person.id for person in frame.people], dtype=np.int16)
        if snapshot.model is not self._outlines.model:
            self._outlines = BodyOutlines(snapshot.model, snapshot.person_of_geom)
        pairs, gaps = self._outlines.nearer(snapshot.data, present, CORRELATED_M)
        ids = ordered_pairs(present[pairs[:, 0]], present[pairs[:, 1]])
        return {pair: PairState(least_m=gap) for pair, gap in zip(ids, gaps.tolist(), strict=True)}

    def people(self, frame: TruthFrame, snapshot: Snapshot, correlated: Mapping[Pair, PairState]) -> None:
        """Set the truth of a stamp, its world, and its `correlated` pairs."""
        self._merge_for_the_rig()
        if snapshot.bases:
            self._tell(BasesFrame(frame.stamp_ns, tuple(_base(name, pose) for name, pose in snapshot.bases.items())))
        self._now = {name: view.at(snapshot) for name, view in self._views.items()}
        self._present = np.array([person.id for person in frame.people], dtype=np.int16)
        place_m = np.array([(person.x, person.y) for person in frame.people], dtype=float).reshape(-1, 2)
        self._places = dict(zip(self._present.tolist(), place_m, strict=True))
        self._near = pairs_within(self._present, place_m, INTERACTION_M)
        interacting = {pair: PairState(least_m=distance) for pair, distance in self._near.items()}
        self._tell_all(self._situations.update("interaction", "", frame.stamp_ns, interacting))
        self._tell_all(self._situations.update("correlated", "", frame.stamp_ns, correlated))

    def look(self, sensor: str, stamp_ns: int, reading: Reading) -> None:
        """Process a reading measured at the last stamp of the truth."""
        if "person_of_ray" in reading.truth and isinstance(reading.observation, LaserScan):
            self._scan(sensor, stamp_ns, reading, reading.observation)
        elif sensor in self._cameras and self._is_due(sensor, stamp_ns):
            self._boxes(sensor, stamp_ns)

    def finish(self, end_ns: int) -> None:
        """End all situations at the end of the run."""
        self._merge_for_the_rig()
        self._tell_all(self._situations.finish(end_ns))

    def _merge_for_the_rig(self) -> None:
        """Judge the last frame of scanners, once all of its scans are in."""
        if self._scanned_ns is None:
            return
        stamp_ns, self._scanned_ns = self._scanned_ns, None
        merged = merged_pairs(self._looks, stamp_ns, self._near, self._places)
        self._tell_all(self._situations.update("merged_rig", "", stamp_ns, merged))

    def _tell_all(self, ended: list[Situation]) -> None:
        """Report ended situations in order of their ends, once no earlier end can come."""
        self._untold += ended
        unsure = [ns for ns in (self._situations.first_break_ns, self._scanned_ns) if ns is not None]
        settled = [each for each in self._untold if not unsure or each.end_ns <= min(unsure)]
        if settled:
            self._untold = [each for each in self._untold if unsure and each.end_ns > min(unsure)]
            for situation in sorted(settled, key=attrgetter("end_ns")):
                self._tell(situation)

    def _is_due(self, camera: str, stamp_ns: int) -> bool:
        """Return whether this is the camera's first picture in its period of 1 / boxes_hz."""
        if self._boxes_hz == 0:
            return False
        period = int(stamp_ns * self._boxes_hz / NS_PER_S + 1e-9)
        due = period > self._last_period.get(camera, -1)
        self._last_period[camera] = period
        return due

    def _boxes(self, camera: str, stamp_ns: int) -> None:
        image = self._cameras[camera].person_image(self._world.snapshot(stamp_ns / NS_PER_S))
        self._tell(BoxFrame(stamp_ns, camera, person_boxes(image)))

    def _scan(self, sensor: str, stamp_ns: int, reading: Reading, scan: LaserScan) -> None:
        person_of_ray = reading.truth["person_of_ray"]
        runs = person_runs(person_of_ray)
        self._tell(RayFrame(stamp_ns, sensor, runs))
        unmet, hidden = self._hidden(sensor, stamp_ns, {run.id for run in runs})
        merged = {pair: PairState("hidden", self._near[pair]) for pair in hidden}
        place = self._places
        for first, second in joined_pairs(reading.truth["range_m"], person_of_ray, scan.angle_increment_rad):
            if not {first, second} <= place.keys():  # left during the scan
                continue
            apart_m = float(np.hypot(*(place[first] - place[second])))
            merged[first, second] = PairState("joined", apart_m)
        self._tell_all(self._situations.update("merged", sensor, stamp_ns, merged))
        ideal = replace(scan, stamp_ns=stamp_ns, ranges_m=reading.truth["range_m"])
        self._looks[sensor] = scan_points(ideal, person_of_ray, self._now[sensor], unmet)
        self._scanned_ns = stamp_ns

    def _hidden(self, sensor: str, stamp_ns: int, met_ids: set[int]) -> tuple[frozenset[int], set[Pair]]:
        """Return the people in a scanner's plane and field, near another, who are met by no beam; and the pairs in which one
        hides the other.
        """
        unmet = set(self._present.tolist()) - met_ids
        hidden = sorted(unmet & {id_ for pair in self._near for id_ in pair})
        if not hidden:
            return frozenset(), set()
        rows, met = [self._row[id_] for id_ in hidden], self._world.met(sensor, stamp_ns)
        if met is not None:
            met = met[rows]
        else:
            snapshot = self._world.snapshot(stamp_ns / NS_PER_S)
            points = snapshot.data.site_xpos[self._world.scene.bodies.point_site[rows]]
            _, met = first_hits(self._now[sensor], snapshot, points, np.array(hidden, dtype=np.int16))
        seen = list(zip(hidden, met.tolist(), strict=True))
        pairs = {(min(id_, other), max(id_, other)) for id_, ids in seen for other in set(ids)} & self._near.keys()
        return frozenset(id_ for id_, ids in seen if max(ids) >= 0), pairs
