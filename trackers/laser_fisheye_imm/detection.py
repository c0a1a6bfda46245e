"""What one moment shows of people, before any tracking: trunks with their colours, single legs; nothing is remembered here
but backgrounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.area import Area
from trackers.errors import InputError
from trackers.laser.layer import Detections, LaserLayer
from trackers.laser.roles import Role, scanners_by_role
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.observations import Image, LaserScan, Observation
from trackers.rig import Rig, StereoSensor
from trackers.tracking.moments import Moment
from trackers.vision.histogram import ColourHistogram
from trackers.vision.torso import TorsoProjector, TorsoWindows

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Seen:
    """What one moment shows: trunks with their colours, single legs."""

    trunks: Detections
    legs: Detections
    windows: TorsoWindows | None
    histograms: Array  # (k, bins) of the trunks; meaningful where comparable
    comparable: Mask  # (k,)
    clear: Mask  # (k,) may be learned from


class Detector:
    """The scanners and the camera of a rig that are used, each with its place and background.

    area: where people are looked for (None: everywhere). Raises InputError for a rig without a laser scanner to use.
    """

    def __init__(
        self, rig: Rig, empty_room: Sequence[Observation], options: LaserFisheyeImmOptions, area: Area | None
    ) -> None:
        self._scanners = scanners_by_role(rig, options.layers)
        self._layers: dict[Role, LaserLayer] = {}
        for role, name in self._scanners.items():
            scans = [item for item in empty_room if isinstance(item, LaserScan) and item.sensor == name]
            self._layers[role] = LaserLayer(
                rig.lasers()[name], scans, options.waist if role == "waist" else options.knee
            )
        self._area = area
        self.histogram = ColourHistogram(options.histogram)
        cameras = {name: each for name, each in rig.cameras().items() if not isinstance(each, StereoSensor)}
        self._camera = next(iter(cameras), None) if options.camera and self.sees_waists else None
        self._projector = None
        if self._camera is not None:
            waist = rig.lasers()[self._scanners["waist"]]
            self._projector = TorsoProjector(waist, cameras[self._camera], options.torso)
            self._intrinsics = cameras[self._camera].intrinsics

    @property
    def sees_waists(self) -> bool:
        """Whether there is a scanner at waist height; a camera is of use only beside one."""
        return "waist" in self._scanners

    @property
    def sensors(self) -> list[str]:
        """The sensors used: scanners, waist first, then the camera."""
        return [*self._scanners.values(), *([self._camera] if self._camera else [])]

    @property
    def learns_background(self) -> bool:
        """Whether a scanner came without scans of the empty room."""
        return any(layer.learns_background for layer in self._layers.values())

    def detect(self, moment: Moment) -> Seen:
        """What the moment shows in the area. Raises InputError for an image of another size than the rig's."""
        trunks, legs = self._scanned(moment, "waist"), self._scanned(moment, "knee")
        image = None if self._camera is None else moment.observations.get(self._camera)
        if self._projector is None or not isinstance(image, Image):
            nothing = np.zeros(len(trunks), np.bool_)
            return Seen(trunks, legs, None, np.zeros((len(trunks), self.histogram.size)), nothing, nothing)
        expected = (self._intrinsics.height, self._intrinsics.width, 3)
        if image.rgb.shape != expected:
            raise InputError(
                f"image of {image.sensor!r} has shape {image.rgb.shape}; the rig's intrinsics say {expected}"
            )
        windows = self._projector.windows(trunks)
        histograms = self.histogram.of_windows(image.rgb, windows.pixels, windows.inside)
        return Seen(trunks, legs, windows, histograms, windows.usable, windows.clear)

    def _scanned(self, moment: Moment, role: Role) -> Detections:
        scan = moment.observations.get(self._scanners.get(role, ""))
        if not isinstance(scan, LaserScan):
            return Detections.none()
        detections = self._layers[role].detect(scan)
        if self._area is None or len(detections) == 0:
            return detections
        return detections.select(self._area.contains(detections.position))

    def missed(self, moment: Moment, points: Array) -> Array:
        """How probably the moment's scans show nothing of somebody at points (2, ...), (...); nobody is outside the area."""
        chance = np.ones(points.shape[1:])
        if self._area is not None:
            chance[~self._area.contains(points.reshape(2, -1).T).reshape(chance.shape)] = 0
        for role, name in self._scanners.items():
            scan = moment.observations.get(name)
            if isinstance(scan, LaserScan):
                chance *= self._layers[role].missed(scan, points)
        return chance
