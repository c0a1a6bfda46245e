"""The options of `laser-vision-learning`, gathered from its parts."""

from __future__ import annotations

from pydantic import Field

from trackers.configuration import Strict
from trackers.laser.detection_model import DetectionOptions
from trackers.laser.layer import KneeOptions
from trackers.laser_vision_learning.identities import IdentityOptions
from trackers.laser_vision_learning.looks import LooksOptions
from trackers.laser_vision_learning.points import PointOptions
from trackers.laser_vision_learning.reidentification import RecognitionOptions
from trackers.laser_vision_learning.situations import SituationOptions
from trackers.laser_vision_learning.walking import WalkingOptions


class LifeOptions(Strict):
    """When somebody is seen, confirmed, out of sight, gone or new."""

    seen_legs: float = Field(
        default=0.25, gt=0, description="least legs' widths of points by which a person counts as measured (ours)"
    )
    new_legs: float = Field(default=0.4, gt=0, description="least legs' widths of points that make somebody new (ours)")
    confirm_hits: int = Field(default=6, ge=1, description="measurements that confirm a track (ours)")
    confirm_least_hits: int = Field(
        default=3, ge=1, description="fewer measurements that confirm one measured for longer than `confirm_s` (ours)"
    )
    confirm_s: float = Field(
        default=0.49, ge=0, description="how long a track of fewer measurements must have been measured [s] (ours)"
    )
    tentative_s: float = Field(
        default=0.15, ge=0, description="how long a tentative track goes unmeasured [s], one look at least (ours)"
    )
    coast_s: float = Field(default=1.0, ge=0, description="how long a track may be missing in plain view [s] (ours)")
    coast_hidden_s: float = Field(
        default=3.0, ge=0, description="how long where no scan would show it, behind others and pillars [s] (ours)"
    )
    found: float = Field(
        default=0.5, gt=0, description="how much of that time a second of being seen makes good (ours)"
    )
    again_m: float = Field(
        default=0.6, ge=0, description="how near to somebody out of sight whoever appears is them again [m] (ours)"
    )
    again_m_s: float = Field(
        default=1.0, ge=0, description="and how much farther for every second out of sight [m/s] (ours)"
    )
    show_s: float = Field(default=0.6, ge=0, description="up to which of that time a track is reported [s] (ours)")
    apart_m: float = Field(
        default=0.5,
        ge=0,
        description="no track starts nearer than this to another, nor goes on unconfirmed within half of it [m] (ours)",
    )
    area_margin_m: float = Field(
        default=0.3, ge=0, description="how far outside the area people are reported [m] (ours)"
    )
    before_m: float = Field(
        default=1.5, ge=0, description="how far outside the area people are followed already [m] (ours)"
    )


class LaserVisionLearningOptions(Strict):
    """Every option, by part."""

    particles: int = Field(default=500, ge=1, description="particles a person (not given in the paper)")
    resampling: str = Field(
        default="systematic", description="resampling scheme: systematic, stratified, residual or plain"
    )
    resample_below: float = Field(
        default=0.5, ge=0, le=1, description="effective share of the particles at which they are resampled (ours)"
    )
    scanner: KneeOptions = Field(
        # a lone point shows a leg here, so that one far away is missed no more than one near by
        default=KneeOptions(free_space=DetectionOptions(half_width_m=0.25, hidden_up_to=0.5)),
        description="the scanners, and what of a scan is the room",
    )
    walking: WalkingOptions = Field(default=WalkingOptions(), description="the two-feet walking model")
    points: PointOptions = Field(default=PointOptions(), description="how laser points speak of people")
    camera: bool = Field(default=True, description="a camera, where the rig has one, tells who is who; no: laser only")
    recognition: RecognitionOptions = Field(
        default=RecognitionOptions(), description="when looks are asked, and how much they count"
    )
    looks: LooksOptions = Field(default=LooksOptions(), description="how people's looks are learned")
    identities: IdentityOptions = Field(
        default=IdentityOptions(margin=0.3), description="when a split is decided, and by what"
    )
    situations: SituationOptions = Field(default=SituationOptions(), description="who interacts, is correlated, merges")
    life: LifeOptions = Field(default=LifeOptions(), description="arrival, leaving, and what lies between")
