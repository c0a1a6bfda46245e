"""The frames of a rig's low scanners, each standing or on a base: odometry, scan matching, tilt, and the frame of reports.

All scanners share one fixed frame, which begins where the rig says that they are. Of several scanners on one base the first
with a pose is matched, and leads the others. Odometry gives the pose of a base at any stamp but in gaps, and tells jumps
where it was corrected.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Sequence
from statistics import median_low
from typing import Literal

import numpy as np

from trackers.arrays import Array, Bool, Float, Mask
from trackers.frames.scan_matching import MatchingOptions, between, compose, planar
from trackers.frames.sensor_frame import SensorFrame
from trackers.laser.bearings import seen_from_above
from trackers.observations import NS_PER_S, LaserScan, Observation, Odometry
from trackers.rig import Rig

ReportFrame = Literal["rig", "matched", "sensor"]
"""The frame that the rig is given in, the fixed one that scan matching finds, or the main scanner's own, which moves."""

_AHEAD_NS = NS_PER_S // 4
"""A pose is carried on so long after the last one, by its motion, or for longer where poses are rarer; then comes a gap."""
_AHEAD = 1.25
"""The same in usual intervals between poses."""
_INTERVALS = 9
"""Number of last intervals whose median is usual."""
_GAP_NS = NS_PER_S
_FASTEST_M_S, _FASTEST_RAD_S = 6.0, 8.0
"""Robots among people are slower; what moves faster has jumped."""
_KEPT = 512
_FAR_M, _OFF_M = 3.0, 0.15
"""Distance from a base [m], and the error there of its pose, carried on until the next one, that is reported [m]."""
_MOSTLY = 0.9
"""Share of the poses that may be off by less."""


class OdometryTrack:
    """The last poses of one base in its odometry frame, in the plane."""

    def __init__(self) -> None:
        self._ns: list[int] = []
        self._poses: list[Array] = []
        self._up: list[Array] = []  # heights that the base's axes point at
        self._breaks: list[int] = []  # stamps from which on poses do not follow from those before
        self._intervals: deque[int] = deque(maxlen=_INTERVALS)
        self._ahead_ns = _AHEAD_NS
        self.usual_ns = 0
        """The usual interval between poses [ns]."""
        self.off_m: list[float] = []
        """Errors of poses carried on until the next one, at a distance from the base [m]."""

    def add(self, ns: int, frame_from_base: Float[Array, "4 4"]) -> None:
        """Take a pose at a stamp [ns]; one that comes late or twice is left out."""
        if self._ns and ns <= self._ns[-1]:
            return
        pose = planar(frame_from_base)
        if self._ns:
            elapsed_s = (ns - self._ns[-1]) / NS_PER_S
            moved = between(self._poses[-1], pose)
            is_jump = (
                np.hypot(*moved[:2]) > _FASTEST_M_S * elapsed_s + 0.05
                or abs(moved[2]) > _FASTEST_RAD_S * elapsed_s + 0.05
            )
            if not is_jump and len(self._ns) > 1:
                off = between(self._carried(ns), pose)
                self.off_m.append(float(np.hypot(*off[:2]) + _FAR_M * abs(off[2])))
            self._intervals.append(ns - self._ns[-1])
            self.usual_ns = median_low(self._intervals)
            self._ahead_ns = max(_AHEAD_NS, min(round(_AHEAD * self.usual_ns), _GAP_NS))
            if is_jump or ns - self._ns[-1] > _GAP_NS:
                self._breaks.append(ns)
        self._ns.append(ns)
        self._poses.append(pose)
        self._up.append(frame_from_base[2, :3].copy())
        if len(self._ns) > _KEPT:
            del self._ns[:-_KEPT], self._poses[:-_KEPT], self._up[:-_KEPT]
            self._breaks = [each for each in self._breaks if each >= self._ns[0]]

    def at(self, ns: int) -> Float[Array, "3"] | None:
        """Return the pose at a stamp [ns]; None before the first, long after the last, and in a gap."""
        place = bisect_right(self._ns, ns)
        if place == 0:
            return None
        if place == len(self._ns):
            return self._carried(ns) if ns - self._ns[-1] <= self._ahead_ns else None
        first, last = self._ns[place - 1], self._ns[place]
        if last in self._breaks:
            return self._poses[place - 1].copy() if ns - first <= self._ahead_ns else None
        return self._on_line(place, ns)

    def _carried(self, ns: int) -> Float[Array, "3"]:
        """Return the last pose, carried on by the motion since the one before, if it follows from that."""
        if len(self._ns) == 1 or ns == self._ns[-1] or self._ns[-1] in self._breaks:
            return self._poses[-1].copy()
        return self._on_line(len(self._ns) - 1, ns)

    def _on_line(self, place: int, ns: int) -> Float[Array, "3"]:
        """Return the pose at a stamp [ns] on the way from the pose before this place to that in it, and beyond."""
        share = (ns - self._ns[place - 1]) / (self._ns[place] - self._ns[place - 1])
        return compose(self._poses[place - 1], share * between(self._poses[place - 1], self._poses[place]))

    def rarity(self) -> str:
        """Describe poses that are too rare for the motion of the base; '' for any others."""
        off_m = float(np.quantile(self.off_m, _MOSTLY)) if self.off_m else 0.0
        if off_m <= _OFF_M or self.usual_ns <= _AHEAD_NS:
            return ""
        return (
            f"comes every {self.usual_ns / NS_PER_S:.2g} s: carried on until the next one, poses are off by {off_m:.2g} m at "
            f"{_FAR_M:g} m from the base"
        )

    def tilt(self, ns: int, axis: Float[Array, "3"]) -> float:
        """Return the larger angle, of the poses before and after a stamp [ns], of an axis of the base to the vertical [rad]."""
        place = bisect_right(self._ns, ns)
        near = self._up[max(place - 1, 0) : place + 1]
        return float(np.arccos(min([1.0, *(abs(float(up @ axis)) for up in near)])))

    def motion(self, first_ns: int, last_ns: int) -> Float[Array, "3"] | None:
        """Return the mean motion (3,) a second from one stamp to a later one [ns], at the first; None where a pose is missing
        or the last does not follow from the first.
        """
        first, last = self.at(first_ns), self.at(last_ns)
        if first is None or last is None or last_ns <= first_ns or not self.follows(first_ns, last_ns):
            return None
        return between(first, last) / ((last_ns - first_ns) / NS_PER_S)

    def follows(self, before_ns: int, ns: int) -> bool:
        """Tell whether poses at two stamps [ns] follow from each other: no jump and no gap lies between."""
        return not any(before_ns < each <= ns for each in self._breaks)


_STEEPEST_RAD = np.radians(10)
"""A scanner at 0.3 m that is tilted by more meets the floor nearer than 1.7 m, and elsewhere no legs."""


class RigFrames:
    """A `SensorFrame` for each of some scanners; observations in order of time."""

    def __init__(
        self, rig: Rig, names: Sequence[str], options: MatchingOptions, background: Iterable[Observation] = ()
    ) -> None:
        self._options = options
        poses = {name: rig.lasers()[name].room_from_sensor for name in names}
        self._mounts = {name: planar(pose.matrix) for name, pose in poses.items()}
        self._axes = {name: pose.rotation[:, 2] for name, pose in poses.items()}
        self._base_of = {name: base for name, base in rig.mounted().items() if name in poses}
        self._at_waists = [name for name in self._base_of if rig.lasers()[name].layer == "waist"]
        self.bases = {
            base: (planar(rig.odometry()[base].room_from_sensor.matrix), OdometryTrack())
            for base in self._base_of.values()
        }
        # the room that was empty is known to scanners that stand in it
        empty = [
            self.upright(each)
            for each in background
            if isinstance(each, LaserScan) and each.sensor in poses and each.sensor not in self._base_of
        ]
        self.of = {
            name: SensorFrame(mount, options, [scan for scan in empty if scan.sensor == name])
            for name, mount in self._mounts.items()
        }
        self._located_ns: dict[str, int] = {}
        self._leaders: dict[str, str] = {}  # of each base, the scanner that is matched
        self._n_tilted = dict.fromkeys(names, 0)
        stand = (name for name in names if name not in self._base_of)
        self.main = rig.main_sensor if rig.main_sensor in poses else names[0]
        """The main one of the scanners."""
        self._reporter = next(stand, self.main)

    @property
    def reporter(self) -> SensorFrame:
        """The frame through which all reports go: of a scanner that stands, else of the main one."""
        return self.of[self._reporter]

    def reported(
        self, places: Float[Array, "n 2"], velocities: Float[Array, "n 2"], frame: ReportFrame, ns: int
    ) -> tuple[Float[Array, "n 2"], Float[Array, "n 2"]]:
        """Return places and velocities of the matched frame in that of the reports, as of a stamp [ns]."""
        match frame:
            case "matched":
                return places, velocities
            case "rig":
                return self.reporter.to_rig(places, velocities)
            case "sensor":
                after_s = (ns - self._located_ns.get(self.main, ns)) / NS_PER_S
                return self.of[self.main].to_sensor(places, velocities, after_s)

    @property
    def warnings(self) -> list[str]:
        """Scanners that were tilted, or whose poses could not be found, and how often; those that do not see who stands."""
        tilted = [
            f"{name} was tilted by more than {np.degrees(_STEEPEST_RAD):.0f}° in {count} scans: they were left out"
            for name, count in self._n_tilted.items()
            if count
        ]
        rare = [
            f"odometry of {base} {said}, and scans show too little to be matched: tracks jump and drift; 10 poses a second or "
            "more are expected"
            for base, (_, track) in self.bases.items()
            if (said := track.rarity())
            and any(self._is_untrusted(name) for name, on in self._base_of.items() if on == base)
        ]
        blind = [
            f"{name} is at waist height on a base that moves: people who have stood there since it came in sight are not "
            "detected before they walk; a scanner below 0.7 m detects them"
            for name in self._at_waists
        ]
        return blind + tilted + rare + [
            f"the pose of {name} could not be trusted in {frame.n_untrusted} of {frame.n_scan} scans: it was taken to stand, or "
            "to be where odometry says"
            for name, frame in self.of.items()
            if self._is_untrusted(name)
        ]  # fmt: skip

    def _is_untrusted(self, name: str) -> bool:
        return self.of[name].n_untrusted > 0.02 * self.of[name].n_scan

    def add(self, odometry: Odometry) -> bool:
        """Keep a pose of a base until scans ask for it; other bases are left out. Tell whether it was kept."""
        is_ours = odometry.sensor in self.bases
        if is_ours:
            self.bases[odometry.sensor][1].add(odometry.stamp_ns, odometry.frame_from_base)
        return is_ours

    def upright(self, scan: LaserScan) -> LaserScan:
        """Return a scan as a scanner that stands upright at the same place would report it, counter-clockwise."""
        return seen_from_above(scan, is_upside_down=bool(self._axes[scan.sensor][2] < 0))

    def is_tilted(self, scan: LaserScan) -> bool:
        """Tell, and count, whether the base of a scanner tilts it out of the height of legs."""
        base = self._base_of.get(scan.sensor)
        tilted = base is not None and self.bases[base][1].tilt(scan.stamp_ns, self._axes[scan.sensor]) > _STEEPEST_RAD
        self._n_tilted[scan.sensor] += tilted
        return tilted

    def located(self, scan: LaserScan, still: Bool[Mask, "n_beam"]) -> SensorFrame:
        """Return the scanner's frame with the pose of an `upright` scan. still: beams that may have met the room."""
        name = scan.sensor
        frame, base = self.of[name], self._base_of.get(name)
        before_ns, self._located_ns[name] = self._located_ns.get(name, scan.stamp_ns), scan.stamp_ns
        if base is None:
            frame.locate(scan, still, None)
            return frame
        room_from_odometry, track = self.bases[base]
        at = track.at(scan.stamp_ns)
        pose = None if at is None else compose(room_from_odometry, compose(at, self._mounts[name]))
        leader = self._leaders.get(base)
        if leader is None and pose is not None:
            self._leaders[base] = leader = name
            frame = self.of[name] = SensorFrame(pose, self._options)
        if leader in (None, name) or pose is None:
            follows = track.follows(before_ns, scan.stamp_ns)
            frame.locate(scan, still, pose, self._sweeping(scan), follows=follows)
        else:
            frame.follow(scan, self.of[leader], pose)
        return frame

    def _sweeping(self, scan: LaserScan) -> Float[Array, "3"] | None:
        """Return the motion (3,) of a scanner on a base during a sweep by odometry, a second in its frame; None where unknown."""
        _, track = self.bases[self._base_of[scan.sensor]]
        mount, duration_ns = self._mounts[scan.sensor], round(abs(scan.sweep_time_s) * NS_PER_S)
        motion = track.motion(scan.stamp_ns, scan.stamp_ns + duration_ns)
        if motion is None:
            return None
        step_s = duration_ns / NS_PER_S
        return between(mount, compose(motion * step_s, mount)) / step_s
