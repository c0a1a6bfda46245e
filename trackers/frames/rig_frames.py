"""The frames of a rig's low scanners, each standing or on a base: odometry, scan matching, tilt, and the frame of reports.

All scanners share one fixed frame, which begins where the rig says that they are. Of several scanners on one base the first
with a pose is matched, and leads the others.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Bool

from trackers.arrays import Mask
from trackers.frames.odometry import OdometryTrack
from trackers.frames.planar import compose, planar
from trackers.frames.scan_matching import MatchingOptions
from trackers.frames.sensor_frame import SensorFrame
from trackers.laser.bearings import seen_from_above
from trackers.observations import LaserScan, Observation, Odometry
from trackers.rig import Rig

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
        self._reporter = next(stand, rig.main_sensor if rig.main_sensor in poses else names[0])

    @property
    def reporter(self) -> SensorFrame:
        """The frame through which all reports go: of a scanner that stands, else of the main one."""
        return self.of[self._reporter]

    @property
    def warnings(self) -> list[str]:
        """Scanners that were tilted, or whose poses could not be found, and how often."""
        tilted = [
            f"{name} was tilted by more than {np.degrees(_STEEPEST_RAD):.0f}° in {count} scans: they were left out"
            for name, count in self._n_tilted.items()
            if count
        ]
        return tilted + [
            f"the pose of {name} could not be trusted in {frame.n_untrusted} of {frame.n_scan} scans: it was taken to stand, or "
            "to be where odometry says"
            for name, frame in self.of.items()
            if frame.n_untrusted > 0.02 * frame.n_scan
        ]  # fmt: skip

    def add(self, odometry: Odometry) -> None:
        """Keep a pose of a base until scans ask for it; other bases are left out."""
        if odometry.sensor in self.bases:
            self.bases[odometry.sensor][1].add(odometry.stamp_ns, odometry.frame_from_base)

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
            frame.locate(
                scan, still, pose, follows=track.follows(self._located_ns.get(name, scan.stamp_ns), scan.stamp_ns)
            )
        else:
            frame.follow(scan, self.of[leader], pose)
        self._located_ns[name] = scan.stamp_ns
        return frame
