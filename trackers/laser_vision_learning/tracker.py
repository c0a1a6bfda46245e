"""People tracking with two low scanners and one high camera, after Song et al.: "Fusion of Laser and Vision for Multiple
Targets Tracking via On-line Learning".
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from trackers.area import Area
from trackers.arrays import Array, Bool, Float, Mask
from trackers.configuration import validate
from trackers.errors import InputError
from trackers.laser.group import ScannerGroup, scanners_by_role
from trackers.laser_vision_learning.camera_people import CameraPeople
from trackers.laser_vision_learning.options import LaserVisionLearningOptions
from trackers.laser_vision_learning.reidentification import Decision, Recognition
from trackers.laser_vision_learning.situations import Situation, situation_names
from trackers.laser_vision_learning.walkers import Walkers
from trackers.observations import DepthImage, Image, Observation
from trackers.prior import Prior
from trackers.rig import Rig
from trackers.tracking.synced_frames import SyncedFrame, SyncPolicy
from trackers.tracking.synchronized_tracker import SynchronizedTracker
from trackers.tracking.track_manager import measured_now
from trackers.tracks import ScoreMap, Track, TrackFrame


class LaserVisionLearning(SynchronizedTracker):
    """Tracker of people from every knee scanner of a rig (see module).

    background: observations of the empty room; a scanner without any learns its background. Options:
    `LaserVisionLearningOptions`. Raises InputError for a wrong option, and for a rig without a knee scanner.
    """

    Options = LaserVisionLearningOptions

    def __init__(
        self, rig: Rig, background: Iterable[Observation] = (), rng: np.random.Generator | None = None, **options: Any
    ) -> None:
        background = Prior.of(background)
        self.options = validate(LaserVisionLearningOptions, options, "tracker laser-vision-learning")
        if idle := [f"tracker laser-vision-learning: {each}" for each in self.options.idle()]:
            raise InputError("\n".join(idle))
        lasers, names = rig.lasers(), scanners_by_role(rig, ("knee",))["knee"]
        self._scanners = ScannerGroup(
            {name: lasers[name] for name in names}, background, self.options.scanner.parameters()
        )
        margin_m = self.options.track_management.report_margin_m
        self._area = None if rig.area is None else Area(rig.area, margin_m)
        self._walkers = Walkers(self._scanners, rig.area, self.options, rng or np.random.default_rng(0))
        self._camera = self._chosen_camera(rig, background) if self.options.camera else None
        self._recognition = self._camera_people = None
        if self._camera is not None:
            if self.options.pictures.detections:
                self._camera_people = CameraPeople(
                    self._camera, rig.cameras()[self._camera], background, rig.area, self.options.pictures
                )
            pictures = [each for each in background if isinstance(each, Image | DepthImage)]
            self._recognition = Recognition(
                rig.cameras()[self._camera],
                [each for each in pictures if each.sensor == self._camera],
                self.options.recognition,
                self.options.looks,
                self.options.identities,
                self._walkers.rng,
                self._inside,
            )
        # one frame per stamp of the main sensor, at any rate
        opens = names if rig.main_sensor in names else (*names, rig.main_sensor)
        joins = () if self._camera is None or self._camera in opens else (self._camera,)
        super().__init__(SyncPolicy(opens, attached=joins, main=rig.main_sensor))
        self.unused_sensors = [name for name in rig.sensors if name not in (*names, self._camera)]
        self._decisions: list[Decision] = []

    @staticmethod
    def _chosen_camera(rig: Rig, empty_room: Sequence[Observation]) -> str | None:
        """Choose a pinhole camera, else a fisheye, else a stereo camera's left view; of several one that has reported."""
        kinds, reported = ("camera", "fisheye", "stereo"), {each.sensor for each in empty_room}
        return min(
            rig.cameras(),
            key=lambda name: (kinds.index(rig.sensors[name].kind), name not in reported, name),
            default=None,
        )

    @property
    def background_learned_causally(self) -> bool:
        """True with a scanner without scans of the empty room."""
        return self._scanners.learns_background

    def tracks(self) -> list[Track]:
        """Return the confirmed tracks in the area of the last frame, by id."""
        people, roster = self._walkers.people, self._walkers.people.roster
        places, velocities = people.places, people.velocities
        shown = roster.confirmed & self._walkers.recently_measured & self._inside(places)
        shown = shown.nonzero()[0]
        shown = shown[roster.id[shown].argsort()]
        situations = self.situations()
        columns = (
            roster.id[shown],
            *places[shown].T,
            *velocities[shown].T,
            measured_now(roster, self._walkers.ns)[shown],
        )
        return [
            Track(number, x, y, vx, vy, status="confirmed" if seen else "coasting", situation=situations[number])
            for number, x, y, vx, vy, seen in zip(*(column.tolist() for column in columns), strict=True)
        ]

    def _inside(self, places: Float[Array, "n 2"]) -> Bool[Mask, "n"]:
        """Mark the places [m] in the area in which tracks are reported."""
        return np.ones(len(places), np.bool_) if self._area is None else self._area.contains(places)

    def situations(self) -> dict[int, Situation]:
        """Return the situation of each confirmed track by id in the last frame."""
        people = self._walkers.people
        deciding = np.zeros(len(people), np.bool_)
        if self._recognition is not None:
            deciding = self._recognition.deciding(people.serial)
        names = situation_names(self._walkers.situations.of(people.serial), deciding)
        return {number: name for number, name in zip(people.roster.id.tolist(), names, strict=True) if number}

    def decisions(self) -> list[Decision]:
        """Return the identities decided after splits, and their basis, in the frames of the last `update` or `finish`."""
        return self._decisions

    def _work_all(self, synced_frames: list[SyncedFrame]) -> list[TrackFrame]:
        self._decisions = []
        return super()._work_all(synced_frames)

    def _work(self, synced: SyncedFrame) -> None:
        walkers = self._walkers
        walkers.step(synced.observations, synced.ns)
        if self._recognition is not None:
            image = synced.observations.get(self._camera or "")
            picture = image if isinstance(image, Image | DepthImage) else None
            if self._camera_people is not None and picture is not None:
                walkers.people = self._camera_people.measure(walkers.people, picture, synced.ns)
            walkers.people = self._recognition.work(walkers.people, walkers.situations, picture, synced.ns)
            self._decisions += self._recognition.decisions

    def _maps(self) -> tuple[ScoreMap, ...]:
        """Return the score maps of the last frame."""
        if self._recognition is None or self._camera is None:
            return ()
        number = dict(zip(self._walkers.people.serial.tolist(), self._walkers.people.roster.id.tolist(), strict=True))
        return tuple(
            ScoreMap(number[serial], self._camera, (int(maps.corner[0]), int(maps.corner[1])), each, maps.centre)
            for whose, maps in self._recognition.maps
            for serial, each in zip(whose.tolist(), maps.maps, strict=True)
        )
