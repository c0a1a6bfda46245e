"""Options of `laser-vision-learning-vision`; the paper gives no constant of its baseline, so all are ours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field, PositiveInt

from trackers.configuration import Strict
from trackers.tracking.track_manager import TrackManagementOptions
from trackers.vision.foreground import ForegroundOptions
from trackers.vision.histogram import HistogramOptions
from trackers.vision.person_detector import SILHOUETTES, DetectorOptions


class ParticleOptions(Strict):
    """Options of the particles: their motion, and their weights by a picture."""

    particles: PositiveInt = Field(default=100, description="particles a person")
    acceleration: float = Field(
        default=1.0, gt=0, description="spectral density of a person's acceleration, white noise [m²/s³]"
    )
    start_speed_m_s: float = Field(default=1.0, gt=0, description="standard deviation of a new person's speed [m/s]")
    slowdown_s: float = Field(
        default=0.6, gt=0, description="time constant with which the speed of who is not detected fades [s]"
    )
    detected_share: float = Field(
        default=0.1, ge=0, lt=1, description="share of a detected person's particles that are drawn about the detection"
    )
    outlier: float = Field(
        default=1e-3,
        gt=0,
        description="likelihood of a place far from the detection, of that in its middle; and of one at which the detector sees "
        "nobody",
    )
    colour_sharpness: float = Field(
        default=10.0,
        ge=0,
        description="λ of the likelihood exp(−λ D²) of the colours at the particles of who is not detected (Pérez et al.)",
    )
    claimed_m: float = Field(
        default=0.3, gt=0, description="standard deviation about a detected person within which scores are theirs [m]"
    )


class AssociationOptions(Strict):
    """Options of the association of detections with tracks."""

    gate: float = Field(default=4.0, gt=0, description="largest Mahalanobis distance of a track and a detection")
    radius_m: float = Field(default=1.2, gt=0, description="and their largest distance [m]")
    colour_weight: float = Field(
        default=6.0, ge=0, description="weight of the colours' distance E beside the Mahalanobis distance"
    )
    unknown_colour: float = Field(
        default=0.3, ge=0, le=1, description="E where a track or a detection has no histogram yet"
    )
    foreign_above: float = Field(
        default=0.8, ge=0, le=1, description="E above which a track and a detection never belong together"
    )


class LearnedColourOptions(Strict):
    """Options of learned colours."""

    learn_covered: float = Field(
        default=0.25,
        ge=0,
        le=1,
        description="share of a person's window that another may cover when colours are learned",
    )
    memory: float = Field(
        default=0.8, ge=0, lt=1, description="share of the old colours kept when new ones are learned"
    )


class DetectionTrackManagementOptions(TrackManagementOptions):
    """Common track management options, and the detections that initiate a track."""

    start_score: float = Field(default=0.4, ge=0, le=1, description="score from which a detection initiates a track")
    start_covered: float = Field(
        default=0.6,
        ge=0,
        le=1,
        description="share of a detection's window that another's may cover when it initiates a track: what is left of a person "
        "in front looks like another behind",
    )


class VisionOnlyOptions(Strict):
    """All options of the baseline by camera."""

    former_names: ClassVar[Mapping[str, str]] = {
        **{f"life.{name}": f"association.{name}" for name in AssociationOptions.model_fields},
        **{f"life.{name}": f"appearance.{name}" for name in LearnedColourOptions.model_fields},
        "life.apart_m": "track_management.start_apart_m",
        "life.confirm_after_s": "track_management.confirm_s",
        "life.show_s": "track_management.report_s",
        "life.margin_m": "track_management.area_margin_m",
        "life": "track_management",
    }

    camera: str | None = Field(
        default=None,
        description="name of the camera; none: the rig's main sensor where it is one, else the first by name",
    )
    most_foreground: float = Field(
        default=0.5,
        gt=0,
        le=1,
        description="share of foreground above which a picture says nothing: light or lens changed",
    )
    foreground: ForegroundOptions = Field(default=SILHOUETTES, description="what in a picture is not the empty room")
    detector: DetectorOptions = Field(default=DetectorOptions(), description="the detector of people")
    histogram: HistogramOptions = Field(
        default=HistogramOptions(hue_bins=36, grey_bins=10, smoothing_deg=10.0),
        description="colour histograms, one of the upper and one of the lower half of a person",
    )
    filter: ParticleOptions = Field(default=ParticleOptions(), description="the particle filter")
    association: AssociationOptions = Field(
        default=AssociationOptions(), description="which detection belongs to which track"
    )
    appearance: LearnedColourOptions = Field(default=LearnedColourOptions(), description="when colours are learned")
    track_management: DetectionTrackManagementOptions = Field(
        default=DetectionTrackManagementOptions(confirm_s=0.2, tentative_coast_s=0.1, report_s=0.4),
        description="when tracks are initiated, confirmed, reported and deleted",
    )
