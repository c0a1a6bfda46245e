"""Stills of a run: one picture per sensor of the frame with the most tracks; and sensors too silent to show their view."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy.typing import NDArray

from trackers.observations import NS_PER_S, DepthImage, FloorFrame, Image, LaserScan, Observation, Odometry
from trackers.tracks import TrackFrame
from twin.report.birdseye import Site, plan_width_px
from twin.report.camera_panel import CameraPanel
from twin.report.floor_panel import FloorPanel, PreviewFrame, TruePoses
from twin.report.palette import IdentityColours, encode_jpeg

_HIGH_PX = 360
_QUALITY = 85


@dataclass(frozen=True)
class Still:
    """A picture for the report: a JPEG, its subject, and its width over its height."""

    jpeg: bytes
    caption: str
    aspect: float = 1.0


@dataclass(frozen=True)
class RunPictures:
    """Pictures of a frame: its stamp [ns], a still per sensor, and a JPEG poster for the video (empty without one)."""

    stamp_ns: int
    stills: Sequence[Still]
    poster: bytes = b""


class SensorStills:
    """The frame with the most sensors and tracks, the earliest of equals, and one picture of it per sensor."""

    def __init__(self, site: Site) -> None:
        self._site, self._rig = site, site.rig
        self._colours = IdentityColours()
        self._rank = (0, -1)
        self._frame = TrackFrame(0, ())
        self._newest: dict[str, Observation] = {}
        self._truth: TruePoses | None = None

    def keep_best(self, frame: TrackFrame, newest: Mapping[str, Observation], truth: TruePoses | None) -> bool:
        """Keep a frame, the newest observation of each sensor and the truth if it ranks above the one kept."""
        self._colours.add(sorted(track.id for track in frame.tracks))  # in the order of the video and the charts
        rank = (len(newest), len(frame.tracks))
        if rank <= self._rank:
            return False
        self._rank, self._frame, self._newest, self._truth = rank, frame, dict(newest), truth
        return True

    def draw(self, poster: bytes = b"") -> RunPictures | None:
        """Draw the kept frame (None before any): cameras with tracks, scanners and floors on the plan, tracks and truth."""
        if not self._newest:
            return None
        stills = []
        for name in self._rig.sensors:
            seen, kind = self._newest.get(name), self._rig.sensors[name].kind
            caption = name if kind == name else f"{name}, {kind}"
            if isinstance(seen, Image | DepthImage):
                stills.append(_still(self._camera(name, seen), caption))
            elif isinstance(seen, LaserScan | FloorFrame):
                stills.append(_still(self._plan(name, seen), caption))
        return RunPictures(self._frame.stamp_ns, stills, poster)

    def _camera(self, name: str, image: Image | DepthImage) -> NDArray[np.uint8]:
        sensor = self._rig.cameras()[name]
        size_px = round(_HIGH_PX * sensor.intrinsics.width / sensor.intrinsics.height), _HIGH_PX
        panel = np.zeros((size_px[1], size_px[0], 3), dtype=np.uint8)
        CameraPanel(sensor, size_px, name, labelled=False).draw(
            panel, PreviewFrame({name: image}, self._frame.tracks), self._colours
        )
        return panel

    def _plan(self, name: str, seen: LaserScan | FloorFrame) -> NDArray[np.uint8]:
        bases = {base: each for base, each in self._newest.items() if isinstance(each, Odometry)}
        wide = plan_width_px(self._site.true_rig or self._rig, self._site.outline, _HIGH_PX)
        panel = np.zeros((_HIGH_PX, wide, 3), dtype=np.uint8)
        frame = PreviewFrame({**bases, name: seen}, self._frame.tracks, self._truth)
        FloorPanel(self._site, wide, _HIGH_PX, about=[name]).draw(panel, frame, self._colours)
        return panel


def _still(rgb: NDArray[np.uint8], caption: str) -> Still:
    return Still(encode_jpeg(rgb, _QUALITY), caption, rgb.shape[1] / rgb.shape[0])


_GAPS = 3.0
"""Number of usual gaps that is a silence, at least half a second: one message may be lost or late."""
_LEAST_NS = NS_PER_S // 2
_UNKNOWN_NS = NS_PER_S
"""Gap of a sensor that has not reported twice."""
_REMEMBERED = 16


class SilenceMonitor:
    """Monitor of silent sensors, fed with observations in order of arrival.

    Time is the newest stamp of any sensor on arrival, so that a sensor with a wrong clock or late messages is not silent.
    """

    def __init__(self, sensors: Iterable[str]) -> None:
        self._heard_ns: dict[str, int | None] = dict.fromkeys(sensors)
        self._last_ns: dict[str, int] = {}
        self._gaps_ns: dict[str, deque[int]] = {}
        self._first_ns: int | None = None
        self._now_ns = 0

    def add(self, observation: Observation) -> None:
        """Add an observation on arrival."""
        name, ns = observation.sensor, observation.stamp_ns
        if self._first_ns is None:
            self._first_ns = self._now_ns = ns
        self._now_ns = max(self._now_ns, ns)
        self._heard_ns[name] = self._now_ns
        if name in self._last_ns and ns > self._last_ns[name]:
            self._gaps_ns.setdefault(name, deque(maxlen=_REMEMBERED)).append(ns - self._last_ns[name])
        self._last_ns[name] = ns

    def silent(self, now_ns: int | None = None) -> frozenset[str]:
        """Return the sensors that are silent at the newest stamp, or at this later time [ns]."""
        if self._first_ns is None:
            return frozenset()
        if now_ns is not None:
            self._now_ns = max(self._now_ns, now_ns)
        return frozenset(
            name
            for name, heard_ns in self._heard_ns.items()
            if self._now_ns - (self._first_ns if heard_ns is None else heard_ns) > self._patience_ns(name)
        )

    def _patience_ns(self, name: str) -> float:
        gaps_ns = self._gaps_ns.get(name)
        return max(_GAPS * median(gaps_ns), _LEAST_NS) if gaps_ns else _UNKNOWN_NS
