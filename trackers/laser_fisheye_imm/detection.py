"""Detections of one frame, before tracking: trunks with their colours, single legs; stateless except for backgrounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from trackers.area import Area
from trackers.arrays import Array, Bool, Float, Mask
from trackers.errors import InputError
from trackers.frames.moving_scanners import frames_of, moving_layers
from trackers.laser.clusters import Detections
from trackers.laser.group import ScannerGroup, scanners_by_role
from trackers.laser_fisheye_imm.options import TORSO_HISTOGRAM, LaserFisheyeImmOptions
from trackers.observations import Image, Observation
from trackers.rig import FisheyeSensor, Rig, Role, StereoSensor
from trackers.tracking.synced_frames import SyncedFrame
from trackers.tracks import Detection
from trackers.vision.histogram import ColourHistogram
from trackers.vision.person_windows import TorsoOptions, TorsoProjector

_LIKELY = 0.5


@dataclass(frozen=True, eq=False)
class Seen:
    """Detections of one frame: trunks with their colours, single legs."""

    trunks: Detections
    legs: Detections
    sufficient: Bool[Mask, "l"]  # the legs with enough samples to initiate a track
    histograms: Float[Array, "k bins"]  # of the trunks; meaningful where comparable
    comparable: Bool[Mask, "k"]
    clear: Bool[Mask, "k"]  # may be learned from


class Detector:
    """Scanners and camera used of a rig, each with its pose and background.

    area: limit of detections (None: unlimited). Raises InputError for a rig without a usable laser scanner.
    """

    def __init__(
        self, rig: Rig, empty_room: Sequence[Observation], options: LaserFisheyeImmOptions, area: Area | None
    ) -> None:
        names, lasers = scanners_by_role(rig, options.layers), rig.lasers()
        self.frames = frames_of(rig, [name for each in names.values() for name in each])
        self._area = area
        self.histogram = ColourHistogram(TORSO_HISTOGRAM)
        bases = rig.mounted()
        beside = {bases.get(name) for name in names.get("waist", ())}  # None: in the room
        cameras = {
            name: each
            for name, each in rig.cameras().items()
            if not isinstance(each, StereoSensor) and bases.get(name) in beside
        }
        self._camera = self._projector = None
        if options.camera and cameras:
            reported = {each.sensor for each in empty_room}
            self._camera = min(
                cameras,
                key=lambda name: (not isinstance(cameras[name], FisheyeSensor), name not in reported, name),
            )
            camera = cameras[self._camera]
            # a torso window needs bearings of the scanner next to the camera
            names["waist"] = _nearest_first(names["waist"], rig, self._camera)
            looks = options.appearance
            torso = TorsoOptions(learn_width_m=looks.learn_width_m, max_overlap=looks.max_overlap)
            self._projector = TorsoProjector(lasers[names["waist"][0]], camera, torso)
            self._intrinsics = camera.intrinsics
        self._groups: dict[Role, ScannerGroup] = {
            role: ScannerGroup(
                {name: lasers[name] for name in names[role]},
                empty_room,
                layer.parameters(options.weak_samples),
                moving_layers(self.frames),
            )
            for role, layer in (("waist", options.waist), ("knee", options.knee))
            if role in names
        }
        self._waist_scans: dict[str, Observation] = {}
        self._waist_p_detect = options.waist.p_detect
        heights = [lasers[name].room_from_sensor.translation[2] for name in names.get("knee", ())]
        self.knee_height_m = float(np.mean(heights)) if heights else 0.0
        """The mean height of the knee scanners above the floor [m]; 0 without one."""

    @property
    def sees_waists(self) -> bool:
        """True with a scanner at waist height, which a camera needs."""
        return "waist" in self._groups

    @property
    def origins(self) -> dict[Role, Float[Array, "s 2"]]:
        """Positions of the scanners of each role [m], in the order of `Detections.scanner`'s columns."""
        return {role: group.origins for role, group in self._groups.items()}

    @property
    def sensors(self) -> list[str]:
        """The sensors used: scanners, waist first, then the camera."""
        scanners = [name for group in self._groups.values() for name in group.names]
        return [*scanners, *([self._camera] if self._camera else [])]

    @property
    def learns_background(self) -> bool:
        """True with a scanner without scans of the empty room."""
        return any(group.learns_background for group in self._groups.values())

    @property
    def learning(self) -> list[str]:
        """The scanners without scans of the empty room, where others have some; else empty."""
        learning = [name for group in self._groups.values() for name in group.learning]
        return [] if len(learning) == sum(len(group.names) for group in self._groups.values()) else learning

    @property
    def is_learning(self) -> bool:
        """True once such a scanner has reported; a silent one does not affect the others' background."""
        return any(group.is_learning for group in self._groups.values())

    def detect(self, synced: SyncedFrame) -> Seen:
        """Detect people of the frame in the area. Raises InputError for an image of another size than the rig's."""
        trunks, legs = self._scanned(synced, "waist"), self._scanned(synced, "knee")
        if "waist" in self._groups:
            names = self._groups["waist"].names
            self._waist_scans |= {name: synced.observations[name] for name in names if name in synced.observations}
        sufficient = self._groups["knee"].sufficient(legs) if "knee" in self._groups else np.empty(0, np.bool_)
        image = None if self._camera is None else synced.observations.get(self._camera)
        histograms, (usable, clear) = np.zeros((len(trunks), self.histogram.size)), np.zeros((2, len(trunks)), np.bool_)
        if self._projector is not None and isinstance(image, Image):
            expected = (self._intrinsics.height, self._intrinsics.width, 3)
            if image.rgb.shape != expected:
                raise InputError(
                    f"image of {image.sensor!r} has shape {image.rgb.shape}; the rig's intrinsics say {expected}"
                )
            own = trunks.select(trunks.scanner[:, 0])  # they come first; the others have no window
            windows, n = self._projector.windows(own), len(own)
            histograms[:n] = self.histogram.of_windows(image.rgb, windows.pixels, windows.inside)
            usable[:n], clear[:n] = windows.usable, windows.clear
        return Seen(trunks, legs, sufficient, histograms, usable, clear)

    def _scanned(self, synced: SyncedFrame, role: Role) -> Detections:
        group = self._groups.get(role)
        detections = Detections.none() if group is None else group.detect(synced.observations, weak=True)
        if self._area is None or len(detections) == 0:
            return detections
        return detections.select(self._area.contains(detections.position))

    def to_detections(self, seen: Seen, ns: int) -> list[Detection]:
        """Return the detections of a frame [ns], trunks first."""
        shown: dict[Role, Detections] = {"waist": seen.trunks, "knee": seen.legs}
        return [each for role, group in self._groups.items() for each in group.to_detections(shown[role], role, ns)]

    def waists_seen(self, points: Float[Array, "k 2"]) -> Bool[Mask, "k"]:
        """Select the points [m] at which the last scans at waist height would rather show a person's trunk than not.

        All of them where nothing is said of when a scanner misses whom.
        """
        if "waist" not in self._groups:
            return np.zeros(len(points), np.bool_)
        if self._waist_p_detect == 0:
            return np.ones(len(points), np.bool_)
        return self._groups["waist"].missed(self._waist_scans, points.T) < _LIKELY

    def seen_behind(self, points: Float[Array, "k 2"]) -> Bool[Mask, "k"]:
        """Select the points [m] behind which a scanner knows the room, or has measured something."""
        return np.logical_or.reduce([group.seen_behind(points) for group in self._groups.values()])

    def missed(self, synced: SyncedFrame, points: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
        """Return the probability that the frame's scans miss a person at points [m]; 0 outside the area, where no person is."""
        shape = points.shape[1:]
        inside = np.ones(shape) if self._area is None else self._area.contains(points.reshape(2, -1).T).reshape(shape)
        chances = (group.missed(synced.observations, points) for group in self._groups.values())
        return reduce(np.multiply, chances, inside)


def _nearest_first(names: tuple[str, ...], rig: Rig, camera: str) -> tuple[str, ...]:
    """Return scanners by distance from a camera [m], those on the same base first; ties keep their order."""
    lasers, bases, place = rig.lasers(), rig.mounted(), rig.sensors[camera].room_from_sensor.translation
    away_m = {name: float(np.linalg.norm(lasers[name].room_from_sensor.translation - place)) for name in names}
    return tuple(sorted(names, key=lambda name: (bases.get(name) != bases.get(camera), away_m[name])))
