"""The options of `laser-fisheye-imm`: every constant of the paper, and what we added to it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from trackers.configuration import Strict, described
from trackers.filters.motion import (
    IMM_MODELS,
    KALMAN_MODELS,
    MODE_STAYS,
)
from trackers.filters.velocity_motion import VelocityMotion
from trackers.laser.layer import KneeOptions, WaistOptions
from trackers.laser.roles import Role
from trackers.laser_fisheye_imm.posture import PostureOptions
from trackers.tracking.track_manager import ReidentificationOptions, TrackManagementOptions
from trackers.vision.histogram import HistogramOptions
from trackers.vision.torso import TorsoOptions

Share = Annotated[float, Field(ge=0, le=1)]
Variance = Annotated[float, Field(ge=0)]


class ImmTrackManagementOptions(TrackManagementOptions, ReidentificationOptions):
    """Those of every tracker, and rules for a background that is learned, for existence, and for what is reported."""

    confirm_s: float = Field(
        default=0.15,
        ge=0,
        description=described(TrackManagementOptions, "confirm_s")
        + "; where the background is known (ours; the paper: 0.5 s)",
    )
    confirm_learned_s: float = Field(
        default=0.5,
        ge=0,
        description="a tentative track is confirmed once it was measured for longer than this, where the "
        "background is learned from the scans [s] (the paper's)",
    )
    confirm_moved_m: float = Field(
        default=0.15,
        ge=0,
        description="where the background is learned, a tentative track is confirmed only this far from where it started, "
        "since a standing person looks like furniture [m]; 0: anywhere (ours)",
    )
    coast_s: float = Field(
        default=1.5,
        ge=0,
        description="a confirmed track not measured for longer is deleted [s], but for one that still exists",
    )
    survival_s: float | None = Field(
        default=30.0,
        gt=0,
        description="how long people whom nothing shows stay on average, from which, and from how probably each scan would have "
        "shown them, follows whether a track still exists [s]; null: that is not asked, and a track is reported while it "
        "coasts (ours)",
    )
    exists_above: float = Field(
        default=0.5,
        ge=0,
        lt=1,
        description="probability above which a coasting track is reported, and, of existence alone, goes on after `coast_s` in "
        "a rig with an area (ours)",
    )
    within_m: float | None = Field(
        default=0.5,
        gt=0,
        description="a coasting track is reported while its person exists and stands within this radius of the reported place "
        "more probably than `exists_above` [m]; null: while the person exists, wherever that may be (ours)",
    )
    apart_m: float = Field(
        default=0.3,
        ge=0,
        description="distance within which there is never a second person: an unseen one is not where another is seen, a third "
        "leg so near a trunk's is a bag of theirs, and a measurement so near a prediction is never gated off [m]; 0: there may "
        "be (ours)",
    )
    start_apart_m: float = Field(
        default=0.6,
        ge=0,
        description="no track is initiated nearer than this to a track or a measurement of one [m]; 0: anywhere (ours)",
    )


class LaserFisheyeImmOptions(Strict):
    """Every constant of the paper, and what we added to it; `trackers.laser_fisheye_imm.rules` switches ours off."""

    former_names: ClassVar[Mapping[str, str]] = {
        "period_s": "step_s",
        "management.confirm_after_s": "track_management.confirm_s",
        "management.confirm_learned_after_s": "track_management.confirm_learned_s",
        "management.body_radius_m": "track_management.start_apart_m",
        "reach_m_s": "track_management.reid_speed_m_s",
        "management": "track_management",
    }

    filter: Literal["imm", "kalman"] = Field(
        default="imm",
        description="interacting multiple models, or the paper's baseline: one model for all that people do, a Kalman filter",
    )
    layers: tuple[Role, ...] = Field(
        default=("waist", "knee"), min_length=1, description="roles of the scanners to use, where the rig has them"
    )
    camera: bool = Field(default=True, description="whether to use the camera, where the rig has one")
    motions: tuple[tuple[Share, Variance], ...] | None = Field(
        default=tuple((model.kept, model.acceleration_variance) for model in VelocityMotion().models),
        min_length=1,
        description="modes of the filter: the share of the velocity that a step keeps, and the variance of white acceleration "
        "in any direction, on each axis [m²/s⁴]: people walk on, change their way, or stand (ours, since a heading cannot tell "
        "to which side a standing person steps); null: the paper's models of heading and speed",
    )
    kalman_motion: tuple[Share, Variance] = Field(
        default=(1.0, 3.0),
        description="mode of the Kalman filter: the share of the velocity that a step keeps, and the variance of white "
        "acceleration [m²/s⁴]: the best of 1, 3 and 9, measured (ours); used unless `motions` is null",
    )
    imm_variances: tuple[tuple[float, float], ...] = Field(
        default=tuple((model.acceleration_variance, model.turn_acceleration_variance) for model in IMM_MODELS),
        min_length=len(IMM_MODELS),
        max_length=len(IMM_MODELS),
        description="process noise of heading and speed: diagonals of Q1, Q2, Q3 [m²/s⁴, rad²/s⁴]; used where "
        "`motions` is null",
    )
    kalman_variances: tuple[float, float] = Field(
        default=(KALMAN_MODELS[0].acceleration_variance, KALMAN_MODELS[0].turn_acceleration_variance),
        description="process noise of the paper's single model, of sudden turns: diagonal of Q [m²/s⁴, rad²/s⁴]; used where "
        "`motions` is null",
    )
    mode_stays: float = Field(
        default=MODE_STAYS, gt=0, le=1, description="probability that a mode stays from one step to the next"
    )
    measurement_variance_m2: float = Field(
        default=0.0015,
        gt=0,
        description="measurement noise: diagonal of R, that of a trunk in full view [m²] (ours, measured; the paper: "
        "0.01)",
    )
    start_speed_m_s: float = Field(
        default=1.5, gt=0, description="standard deviation of a new track's speed [m/s] (the paper does not say)"
    )
    start_by_single_legs: bool = Field(
        default=False,
        description="whether in a rig with a waist scanner a track starts by a single leg as well, not by a trunk or both legs "
        "alone (ours: it does not)",
    )
    colour_weight: float = Field(
        default=60.0, ge=0, description="weight w of the appearance E, in the paper's distance d = N + w E (inferred)"
    )
    even_at: float = Field(
        default=0.37,
        ge=0,
        le=1,
        description="E of a look that is as likely the same person's as another's, so that an unknown shirt is neither alike nor "
        "different (ours, measured; the paper: 0)",
    )
    wrong_look: float = Field(
        default=0.005,
        ge=0,
        lt=1,
        description="share of looks at a torso that show what hides it, so that a wrong shirt costs so much and no more (ours)",
    )
    new_density_m2: float | None = Field(
        default=1e-3,
        gt=0,
        description="density of measurements of new people and of clutter [1/m²]: a pair costs −2 ln of "
        "how much likelier it is than those, and is taken where that is likelier than that the track was not shown (ours); "
        "null: a pair costs N, and as many are taken as can be, as in the paper",
    )
    lone_leg_density_m2: float = Field(
        default=0.1,
        gt=0,
        description="the same of a single leg in a rig that sees waists: there a leg whose trunk is not seen is rarely a person "
        "[1/m²] (ours)",
    )
    degrees_of_freedom: float | None = Field(
        default=10.0,
        gt=0,
        description="of Student's t, the density of a measurement about its prediction, since people turn and clusters are cut "
        "more often than a Gaussian says (ours); null: a Gaussian; used where pairs cost −2 ln of a likelihood",
    )
    max_deviations: float | None = Field(
        default=6.0,
        gt=0,
        description="gate on N, the Mahalanobis distance, beyond `track_management.apart_m`; null: the validation region alone "
        "gates (ours)",
    )
    recognised_below: float = Field(
        default=0.3,
        ge=0,
        description="E up to which two looks are taken for the same person in re-identification (ours)",
    )
    expected_below: float = Field(
        default=2.0,
        ge=0,
        description="N up to which a track in sight explains a measurement, so that no occluded track is re-identified in "
        "it (ours)",
    )
    step_s: float = Field(
        default=0.1,
        ge=0.001,
        description="time step that process and measurement noise, changes of mode and the detection probability are for; longer "
        "gaps are predicted in such steps, and looks that follow sooner tell together what one a step would, since gait, clothes "
        "and what hides a leg last (ours) [s]",
    )
    max_wait_s: float = Field(
        default=0.15, ge=0, description="how long a moment waits for a sensor that has not reported [s]"
    )
    smoothed_s: float = Field(
        default=0.0,
        ge=0,
        le=10,
        description="how late frames may leave, so that what is measured meanwhile counts: people are reported from their first "
        "measurement on and between measurements [s]; 0: at once (ours)",
    )
    waist: WaistOptions = Field(default=WaistOptions(), description="scanners at waist height")
    knee: KneeOptions = Field(default=KneeOptions(), description="scanners at knee height")
    posture: PostureOptions = Field(
        default=PostureOptions(), description="sitting people, told by their legs, and lying ones"
    )
    torso: TorsoOptions = Field(default=TorsoOptions(), description="torso windows in the camera's picture")
    histogram: HistogramOptions = Field(
        default=HistogramOptions(grey_bins=0, smoothing_deg=0.0), description="colour histograms of torsos"
    )
    track_management: ImmTrackManagementOptions = Field(
        default=ImmTrackManagementOptions(), description="when tracks are initiated, confirmed, reported and deleted"
    )
