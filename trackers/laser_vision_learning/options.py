"""Options of `laser-vision-learning`, gathered from its parts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from pydantic import Field

from trackers.configuration import Strict, described, leaves_of
from trackers.laser.bearings import DetectionOptions
from trackers.laser.layer import KneeOptions, ScannerOptions
from trackers.laser_vision_learning.camera_people import CameraPeopleOptions
from trackers.laser_vision_learning.identities import IdentityOptions
from trackers.laser_vision_learning.looks import LooksOptions
from trackers.laser_vision_learning.reidentification import RecognitionOptions
from trackers.laser_vision_learning.situations import SituationOptions
from trackers.laser_vision_learning.walking_model import WalkingOptions
from trackers.likelihood.laser_points import PointOptions
from trackers.tracking.track_manager import ReidentificationOptions, TrackManagementOptions


class PointTrackManagementOptions(TrackManagementOptions, ReidentificationOptions):
    """Common track management options, the measurement of a track by points, and its greatest missing time."""

    detect_legs: float = Field(
        default=0.25, gt=0, description="least legs' widths of points by which a track is measured (ours)"
    )
    start_legs: float = Field(
        default=0.4, gt=0, description="least legs' widths of unexplained points that initiate a track (ours)"
    )
    confirm_early_hits: ClassVar[int] = 6
    """Measurements that confirm a track before `confirm_s` (ours)."""
    coast_hidden_s: float = Field(
        default=3.0,
        gt=0,
        description="what `coast_s` becomes where no scan would show the track, behind others and pillars [s] (ours)",
    )
    regained: ClassVar[float] = 0.5
    """Reduction of the missing time per second of being measured [s/s] (ours)."""
    report_margin_m: float = Field(
        default=0.3, ge=0, description="how far outside the area tracks are reported [m] (ours)"
    )


class PointScannerOptions(ScannerOptions):
    """Scanners at knee height whose single points are evaluated."""

    half_depth_m: float = Field(default=0.04, ge=0, description=described(ScannerOptions, "half_depth_m"))

    def parameters(self) -> KneeOptions:
        """Return the layer's parameters."""
        # a single point shows a leg here, so that a distant one is not missed
        return self.over(KneeOptions(free_space=DetectionOptions(half_width_m=0.25, hidden_up_to=0.5)))


_SHARED = {
    "cluster.jump_m": "jump_m",
    "background.margin_m": "margin_m",
    "background.memory_s": "memory_s",
    "free_space.detected": "p_detect",
}


class LaserVisionLearningOptions(Strict):
    """All options, by part."""

    former_names: ClassVar[Mapping[str, str]] = {
        "life.seen_legs": "track_management.detect_legs",
        "life.new_legs": "track_management.start_legs",
        "life.confirm_hits": "track_management.confirm_early_hits",
        "life.confirm_least_hits": "track_management.confirm_hits",
        "life.tentative_s": "track_management.tentative_coast_s",
        "life.found": "track_management.regained",
        "life.again_m": "track_management.reid_m",
        "life.again_m_s": "track_management.reid_speed_m_s",
        "life.show_s": "track_management.report_s",
        "life.apart_m": "track_management.start_apart_m",
        "life.area_margin_m": "track_management.report_margin_m",
        "life.before_m": "track_management.area_margin_m",
        "life": "track_management",
        **{f"scanner.{former}": f"scanner.{name}" for former, name in _SHARED.items()},
    }
    fixed_values: ClassVar[Mapping[str, Any]] = {
        "resampling": "systematic",
        "resample_below": 0.5,
        **{
            f"scanner.{path}": value
            for path, value in leaves_of(KneeOptions(free_space=DetectionOptions(half_width_m=0.25, hidden_up_to=0.5)))
            if path not in (*_SHARED, "half_depth_m")
        },
    }

    particles: int = Field(default=500, ge=1, description="particles a person (not given in the paper)")
    scanner: PointScannerOptions = Field(
        default=PointScannerOptions(), description="the scanners, and what of a scan is the room"
    )
    walking: WalkingOptions = Field(default=WalkingOptions(), description="the two-feet walking model")
    points: PointOptions = Field(default=PointOptions(), description="how laser points speak of people")
    camera: bool = Field(default=True, description="a camera, where the rig has one, tells who is who; no: laser only")
    pictures: CameraPeopleOptions = Field(
        default=CameraPeopleOptions(), description="people in the camera's pictures, for tracks that no scanner shows"
    )
    recognition: RecognitionOptions = Field(
        default=RecognitionOptions(), description="when looks are asked, and how much they count"
    )
    looks: LooksOptions = Field(default=LooksOptions(), description="how people's looks are learned")
    identities: IdentityOptions = Field(default=IdentityOptions(), description="when a split is decided, and by what")
    situations: SituationOptions = Field(default=SituationOptions(), description="who interacts, is correlated, merges")
    track_management: PointTrackManagementOptions = Field(
        default=PointTrackManagementOptions(
            confirm_s=0.49,
            confirm_hits=3,
            coast_s=1.0,
            tentative_coast_s=0.15,
            report_s=0.6,
            area_margin_m=1.5,
            reid_m=0.6,
            reid_speed_m_s=1.0,
        ),
        description="when tracks are initiated, confirmed, reported and deleted",
    )

    def idle(self) -> Iterator[str]:
        """Yield the groups of options that differ from their defaults and have no effect without a camera."""
        for group in ("pictures", "recognition", "looks", "identities"):
            if not self.camera and getattr(self, group) != type(self).model_fields[group].default:
                yield f"{group}: has no effect without a camera"
