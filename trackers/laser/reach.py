"""Reach of a rig's scanners: places where their scans can show people, by the spacing and the height of the beams.

A scanner shows a body where the smallest cluster of its layer is more likely than not (`bearings.DetectionModel`), and where
its beams are neither in the floor nor over the heads, as those of a tilted scanner are. Places are those of the tracked area;
a rig by hand may have a scanner that sees none of it.
Without one, beams are to be above the floor at the returns, and close enough together where something has moved; on a moving
base only the former can be known.

Scanners that stand contradict each other where one sees past what the other shows of somebody who moves: a pose in the rig is
wrong, or a scan mirrored.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from math import asin, degrees, floor, hypot, log10, sin

import numpy as np

from trackers.area import Area
from trackers.arrays import Array, Bool, Float, Index, Mask
from trackers.errors import text_near_bound
from trackers.laser.layer import KneeOptions, WaistOptions
from trackers.observations import NS_PER_S, LaserScan
from trackers.rig import LaserSensor, Rig
from trackers.rig_sensors import MOST_TILT_DEG, Role

_SHOWN = 0.5
"""Share of the places below which a warning is made."""
_PLACES = 4000
"""Places in the rectangle about a tracked area."""
_LOOKS_NS = NS_PER_S
"""Time between two scans that are examined; people and things move meanwhile."""
_HEIGHTS_M = 0.05, 1.5
"""Heights at which a beam meets an adult: above the soles, below the top of the head [m]."""
_TALLEST_M, _LEVEL_M = 2.2, 0.01
"""Height above which a level beam meets nobody [m]; rise of one by the rounding of its pose's angles, as of one upside down."""
_CONTRADICTED = 1 / 4
"""Share of the places of moving bodies past which another scanner sees, above which a warning is made."""
_FEWEST, _MOST_PLACES = 40, 100
"""Places seen past, in all, for a warning; and those compared in one scan."""
_TOLERANCE_M = 0.5
"""Distance within which two scanners show the same body, its motion between the scans included [m]."""
_BESIDE_M = 0.1
"""Distance of two returns side by side that are of one surface [m]: a beam alone may be mixed of two."""
_TOGETHER_NS = NS_PER_S // 6
"""Time between scans that are compared [ns]."""
_BEARINGS = 720
"""Bearings whose farthest return is kept."""
_BIN_M, _BINS = 0.5, 100
"""Size [m] and number of the steps of distance in which returns are counted."""
_STANDS = 2
"""Looks at a return of about the same bearing and distance after which it is of a thing: an edge now met, now missed."""


@dataclass(frozen=True)
class _BodyPart:
    """Part of people that a layer shows: its word, its width [m], and the samples of its smallest cluster."""

    word: str
    width_m: float
    least: int

    @property
    def widest_gap_m(self) -> float:
        """Spacing of beams at which the smallest cluster is as likely as not."""
        return self.width_m / (self.least - 0.5)


def _bodies() -> dict[Role, _BodyPart]:
    waist, knee = WaistOptions(), KneeOptions()
    assert waist.body_width_m is not None
    assert knee.free_space.width_m is not None
    return {
        "waist": _BodyPart("trunk", waist.body_width_m, waist.cluster.min_samples),
        "knee": _BodyPart("leg", knee.free_space.width_m, knee.cluster.min_samples),
    }


@dataclass
class _Tally:
    """Counts of places, and of those at which no scanner shows people; median distances of the places, one per scan [m]."""

    n_place: int = 0
    n_lost: int = 0
    far_m: list[float] = field(default_factory=list)

    def add(self, distance_m: Float[Array, "n"], lost: Bool[Mask, "n"]) -> None:
        """Count the places of one scan."""
        if len(lost):
            self.n_place += len(lost)
            self.n_lost += int(lost.sum())
            self.far_m.append(float(np.median(distance_m)))

    @property
    def is_short(self) -> bool:
        """True where people are shown at less than half of the places."""
        return self.n_lost > (1 - _SHOWN) * self.n_place

    def shown(self) -> str:
        """Return the share of the places at which people are shown, as a clause."""
        return f"shows people in {100 * (1 - self.n_lost / self.n_place):.0f} % of what it sees"


class _Scanner:
    """One scanner: its latest scan, and tallies of the places where its beams are too sparse, and too low or too high."""

    def __init__(self, sensor: LaserSensor, body: _BodyPart) -> None:
        pose = sensor.room_from_sensor
        self.base = sensor.mounted_on
        self.body = body
        self.scan: LaserScan | None = None
        self.examined_ns: int | None = None
        self.spacing, self.height, self.n_below = _Tally(), _Tally(), 0
        self.n_for_area = 0  # scans with returns that were examined for places of the tracked area
        self._height_m = pose.xyz[2]
        self._up = pose.rotation[2, :2]
        self._tilt_rad = asin(min(1.0, hypot(*self._up)))
        low, high = _HEIGHTS_M
        # a level scanner at the height of a head, or in the floor, is as high as meant
        highest_m = max(high, self._height_m + _LEVEL_M) if self._height_m < _TALLEST_M else high
        self._heights_m = min(low, self._height_m - _LEVEL_M), highest_m
        self._origin_m, self._room_from_scan = pose.translation[:2], pose.rotation[:2, :2]
        self._scan_from_room = np.linalg.pinv(self._room_from_scan)
        self._farthest_m = np.zeros(_BEARINGS)
        self._n_look = np.zeros((_BEARINGS, _BINS + 2), np.int32)  # with a return there, or a step nearer or farther

    def returns(self) -> tuple[Float[Array, "n 2"], Bool[Mask, "n"]]:
        """Return the places of the latest scan's returns [m], and a mask of those nearer than an earlier one behind them."""
        assert self.scan is not None
        ranges, angles, bearing = self._polar()
        moved = ranges < self._farthest_m[bearing] - self.body.width_m
        moved &= self._n_look[bearing, _bins(ranges)] < _STANDS
        local = ranges * np.stack([np.cos(angles), np.sin(angles)])
        return (self._room_from_scan @ local).T + self._origin_m, moved

    def _polar(self) -> tuple[Float[Array, "n"], Float[Array, "n"], Index]:
        """Return ranges [m], bearings [rad] and their numbers of the latest scan's returns."""
        assert self.scan is not None
        hit = np.isfinite(self.scan.ranges_m) & (self.scan.ranges_m <= self.scan.range_max_m)
        angles = self.scan.angles_rad[hit]
        return (
            np.asarray(self.scan.ranges_m[hit], np.float64),
            angles,
            np.floor(angles / (2 * np.pi) * _BEARINGS).astype(np.intp) % _BEARINGS,
        )

    def learn(self) -> None:
        """Keep the farthest return of each bearing, of the latest scan too."""
        ranges, _, bearing = self._polar()
        np.maximum.at(self._farthest_m, bearing, ranges)
        # once per cell, however many beams meet it
        self._n_look[bearing[:, None], _bins(ranges)[:, None] + np.array([-1, 0, 1])] += 1

    def witness(self, places: Float[Array, "n 2"]) -> tuple[Bool[Mask, "n"], Bool[Mask, "n"]]:
        """Return masks of places of moving bodies [m]: shown as moving here too, and seen past, with a return behind."""
        assert self.scan is not None
        own, moved = self.returns()
        gap_m = np.hypot(*(places[:, None] - own[moved]).transpose(2, 0, 1))
        distance, free, _, _ = self.look(places)
        beyond = np.zeros(len(places), np.bool_)
        ranges = np.where(np.isfinite(self.scan.ranges_m), self.scan.ranges_m, 0.0)
        beyond[free] = ranges[self._beams(places[free])[0]] > distance[free] + _TOLERANCE_M
        shown = gap_m.min(axis=1, initial=np.inf) <= _TOLERANCE_M
        return shown, beyond & ~shown & ~self.is_sparse(distance)

    def look(
        self, places: Float[Array, "n 2"]
    ) -> tuple[Float[Array, "n"], Bool[Mask, "n"], Bool[Mask, "n"], Bool[Mask, "n"]]:
        """Return distances along the beams [m], and masks of places: seen freely, beams in the floor there, over the heads.

        What is behind the point where a tilted beam meets floor or ceiling would be seen by a level one, for all that is known.
        """
        assert self.scan is not None
        scan, count = self.scan, self.scan.ranges_m.size
        beam, x, y = self._beams(places)
        distance = np.hypot(x, y)
        inside = (beam >= 0) & (beam < count) & (distance <= scan.range_max_m)
        reach_m = np.where(np.isnan(scan.ranges_m), 0.0, np.minimum(scan.ranges_m, scan.range_max_m))
        free = inside & (reach_m[np.where(inside, beam, 0)] >= distance - self.body.width_m)
        height_m = self._height_m + self._up @ np.stack([x, y])
        below, above = inside & (height_m < self._heights_m[0]), inside & (height_m > self._heights_m[1])
        return distance, free & ~below & ~above, below, above

    def _beams(self, places: Float[Array, "n 2"]) -> tuple[Index, Float[Array, "n"], Float[Array, "n"]]:
        """Return the number of the beam nearest to each place, outside of the scan too, and the places along x and y [m]."""
        assert self.scan is not None
        scan, count = self.scan, self.scan.ranges_m.size
        x, y = self._scan_from_room @ (places - self._origin_m).T
        middle_rad = scan.angle_min_rad + 0.5 * (count - 1) * scan.angle_increment_rad
        bearing = np.arctan2(y, x) - middle_rad
        bearing -= 2 * np.pi * np.rint(bearing / (2 * np.pi))
        return np.rint(bearing / scan.angle_increment_rad + 0.5 * (count - 1)).astype(np.intp), x, y

    def is_sparse(self, distance_m: Float[Array, "n"]) -> Bool[Mask, "n"]:
        """Return a mask of the distances at which too few beams meet a body."""
        return distance_m * self._spacing_rad > self.body.widest_gap_m

    @property
    def _spacing_rad(self) -> float:
        assert self.scan is not None
        return abs(self.scan.angle_increment_rad)

    def sentences(self) -> list[str]:
        """Describe what is too coarse or tilted, with what would be valid."""
        tilt_deg = degrees(self._tilt_rad)
        if round(tilt_deg, 6) > MOST_TILT_DEG and self.scan is not None:
            tilt = text_near_bound(tilt_deg, MOST_TILT_DEG, ".3g")
            return [f"scans no layer of people: it is tilted by {tilt}°; {MOST_TILT_DEG:g}° or less is expected"]
        if self.n_for_area and not self.spacing.n_place:
            return ["sees nothing of the tracked area; another pose, or another area, is expected"]
        found, body = [], self.body
        if self._height_m >= _TALLEST_M and self.height.is_short and not self.n_below:
            height = text_near_bound(self._height_m, _HEIGHTS_M[1], ".3g")
            return [f"hangs {height} m high, over all heads; a height up to {_HEIGHTS_M[1]:g} m is expected"]
        if self.spacing.is_short:
            gap_m, far_m = body.widest_gap_m, float(np.median(self.spacing.far_m))
            most_deg = _rounded_down(degrees(gap_m / max(far_m, gap_m)))
            apart = text_near_bound(degrees(self._spacing_rad), most_deg, ".3g")
            found.append(
                f"{self.spacing.shown()}: its beams are {apart}° apart, and beyond "
                f"{gap_m / self._spacing_rad:.2g} m fewer than {body.least} meet a {body.word} of {body.width_m:g} m; "
                f"{most_deg:g}° or less is expected here"
            )
        if self.height.is_short:
            low, high = self._heights_m
            is_below = self.n_below > 0.5 * self.height.n_lost
            spare_m, far_m = (
                self._height_m - low if is_below else high - self._height_m,
                float(np.median(self.height.far_m)),
            )
            most_deg = _rounded_down(degrees(asin(min(1.0, spare_m / max(far_m, 1e-9)))))
            found.append(
                f"{self.height.shown()}: it is tilted by {text_near_bound(tilt_deg, most_deg, '.3g')}°, and its beams "
                f"{'meet the floor' if is_below else 'pass over heads'} from {spare_m / sin(self._tilt_rad):.2g} m on; "
                f"{most_deg:g}° or less is expected here"
            )
        return found


class ScannerReach:
    """Examines the scans of a run for places that the scanners see but at which they cannot show people."""

    def __init__(self, rig: Rig) -> None:
        bodies = _bodies()
        self._scanners = {name: _Scanner(sensor, bodies[sensor.layer]) for name, sensor in rig.lasers().items()}
        self._places = None if rig.area is None else _places_in(np.array(rig.area, float))
        self._pairs: dict[tuple[str, str], _Tally] = {}  # places that one of two shows, and past which the other sees

    def add(self, scan: LaserScan) -> None:
        """Take the next scan; one per second and scanner is examined, by the latest of the others, once they have scanned."""
        mine = self._scanners.get(scan.sensor)
        if mine is None or scan.ranges_m.size < 2 or not scan.angle_increment_rad:
            return
        is_first, mine.scan = mine.scan is None, scan
        if is_first and any(each.scan is None and each.base == mine.base for each in self._scanners.values()):
            return
        if mine.examined_ns is not None and 0 <= scan.stamp_ns - mine.examined_ns < _LOOKS_NS:
            return
        mine.examined_ns = scan.stamp_ns
        places, moved = mine.returns()
        mine.learn()
        if mine.base is None:
            self._compare(mine, places[moved])
        if mine.base is None and self._places is not None:
            self._examine(mine, self._places, spacing=True, height=True)
            mine.n_for_area += bool(np.isfinite(scan.ranges_m).any())
            return
        self._examine(mine, places, height=True)
        if mine.base is None:
            self._examine(mine, places[moved], spacing=True)

    def _compare(self, mine: _Scanner, places: Float[Array, "n 2"]) -> None:
        """Count the places of moving bodies, in order of the beams, that others show too, and past which they see."""
        assert mine.scan is not None
        if len(places) < 2:
            return
        beside = np.linalg.norm(np.diff(places, axis=0), axis=1) <= _BESIDE_M
        places = places[np.append(beside, False) | np.insert(beside, 0, False)]
        places = places[:: -(-len(places) // _MOST_PLACES) or 1]
        for name, other in self._scanners.items():
            if other is mine or other.base is not None or other.scan is None:
                continue
            if abs(other.scan.stamp_ns - mine.scan.stamp_ns) <= _TOGETHER_NS:
                shown, past = other.witness(places)
                first, second = sorted((mine.scan.sensor, name))
                tally = self._pairs.setdefault((first, second), _Tally())
                tally.n_place += int((shown | past).sum())
                tally.n_lost += int(past.sum())

    def _examine(
        self, mine: _Scanner, places: Float[Array, "n 2"], *, spacing: bool = False, height: bool = False
    ) -> None:
        """Count the places that a scanner sees and none on its base shows."""
        distance, free, below, above = mine.look(places)
        seen, sparse = free | below | above, mine.is_sparse(distance)
        lost = seen & (sparse | below | above)  # by mine alone: usually nowhere
        for other in self._scanners.values():
            if lost.any() and other is not mine and other.scan is not None and other.base == mine.base:
                far, free, _, _ = other.look(places[lost])
                lost[lost] = ~(free & ~other.is_sparse(far))
        if spacing:
            mine.spacing.add(distance[seen], (lost & sparse)[seen])
        if height:
            mine.height.add(distance[seen], (lost & (below | above))[seen])
            mine.n_below += int((lost & below).sum())

    def warnings(self, unused: Collection[str] = ()) -> list[str]:
        """Return sentences on scanners that show people in less than half of what they see, or contradict each other.

        unused: scanners left out.
        """
        found = [
            f"{name}: {sentence}"
            for name, each in self._scanners.items()
            if name not in unused
            for sentence in each.sentences()
        ]
        for (first, second), tally in self._pairs.items():
            is_far = tally.n_lost >= _FEWEST and tally.n_lost > _CONTRADICTED * tally.n_place
            if is_far and first not in unused and second not in unused:
                found.append(
                    f"{first}: contradicts {second}: of {tally.n_place} places where one shows somebody who moves, the other "
                    f"sees past {100 * tally.n_lost / tally.n_place:.0f} %; poses in the rig that fit both (metres, radians, "
                    "upside down or not), and scans that are not mirrored, are expected"
                )
        return found


def _bins(ranges_m: Float[Array, "n"]) -> Index:
    """Return the steps of distance of ranges [m], from 1 on."""
    return 1 + np.minimum(ranges_m / _BIN_M, _BINS - 1).astype(np.intp)


def _rounded_down(number: float) -> float:
    """Return the number with two significant digits, rounded down."""
    if number <= 0:
        return 0.0
    digits = 1 - floor(log10(number))
    return round(floor(number * 10.0**digits) / 10.0**digits, digits)


def _places_in(corners: Float[Array, "c 2"]) -> Float[Array, "n 2"]:
    """Return places on a grid in a polygon (c, 2) [m]."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    step_m = float(np.sqrt(np.prod(np.maximum(high - low, 1e-3)) / _PLACES))
    axes = [np.arange(start + step_m / 2, end, step_m) for start, end in zip(low, high, strict=True)]
    places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    return places[Area(corners).contains(places)]
