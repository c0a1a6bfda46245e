"""The options of `laser-fisheye-imm`: every constant of the paper, and what we added to it."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from trackers.configuration import Strict
from trackers.filters.motion import (
    IMM_MODELS,
    KALMAN_MODELS,
    MEASUREMENT_VARIANCE_M2,
    MODE_STAYS,
)
from trackers.laser.layer import KneeOptions, WaistOptions
from trackers.laser.roles import Role
from trackers.vision.histogram import HistogramOptions
from trackers.vision.torso import TorsoOptions


class ManagementOptions(Strict):
    """When a track is believed, and when it is given up."""

    confirm_after_s: float = Field(
        default=0.3,
        ge=0,
        description="where the empty room is known, a tentative track measured for longer, each scan standing for its period, "
        "is a person [s] (ours; the paper: 0.5 s)",
    )
    confirm_learned_after_s: float = Field(
        default=0.5, ge=0, description="the same where the background is learned as it goes [s] (the paper's)"
    )
    confirm_unsure_after_s: float = Field(
        default=1.0,
        ge=0,
        description="the same for whoever may be somebody known who is out of sight: where waists are scanned, who has shown "
        "no trunk; where a camera looks as well, who has shown too little of a shirt where somebody known can have come [s] "
        "(ours)",
    )
    confirm_looks: int = Field(
        default=3, ge=0, description="less than this many clear looks is too little of a shirt (ours)"
    )
    confirm_moved_m: float = Field(
        default=0.15,
        ge=0,
        description="where the background is learned as it goes, only who has come this far from where first measured is a "
        "person: nothing else tells somebody standing from furniture seen now and then [m] (ours)",
    )
    coast_s: float = Field(default=1.5, ge=0, description="a person not measured for this long is gone [s]")
    coast_hidden_s: float = Field(
        default=3.0,
        ge=0,
        description="a person not measured for this long is gone even where nothing in the rig's area would show them; "
        "without an area there is only coast_s [s] (ours)",
    )
    hidden_above: float = Field(
        default=0.2,
        ge=0,
        le=1,
        description="one whom the last look would have missed likelier than this counts as out of everybody's sight (ours)",
    )
    coast_slowdown_s: float | None = Field(
        default=0.6,
        gt=0,
        description="a coasting person's speed fades with this time constant; none: it stays [s] (ours)",
    )
    tentative_coast_s: float = Field(
        default=0.15,
        ge=0,
        description="a tentative track not measured for longer was a false alarm [s] (ours: one scan may miss)",
    )
    body_radius_m: float = Field(
        default=0.45,
        ge=0,
        description="nothing new starts this near to a person already tracked or just measured [m] (ours)",
    )
    area_margin_m: float = Field(
        default=0.3, ge=0, description="how far outside the rig's area people are still followed [m]"
    )


class LaserFisheyeImmOptions(Strict):
    """Every constant of the paper, and what we added to it."""

    filter: Literal["imm", "kalman"] = Field(
        default="imm", description="three models, or the single-model baseline (model 3)"
    )
    layers: tuple[Role, ...] = Field(default=("waist", "knee"), min_length=1, description="which scanners to use")
    camera: bool = Field(default=True, description="whether to use the fisheye camera, where there is one")
    imm_variances: tuple[tuple[float, float], ...] = Field(
        default=tuple((model.acceleration_variance, model.turn_acceleration_variance) for model in IMM_MODELS),
        min_length=len(IMM_MODELS),
        max_length=len(IMM_MODELS),
        description="diagonals of Q1, Q2, Q3 [m²/s⁴, rad²/s⁴]",
    )
    kalman_variances: tuple[float, float] = Field(
        default=(KALMAN_MODELS[0].acceleration_variance, KALMAN_MODELS[0].turn_acceleration_variance),
        description="diagonal of Q of the single model [m²/s⁴, rad²/s⁴]",
    )
    mode_stays: float = Field(
        default=MODE_STAYS, gt=0, le=1, description="probability that a mode stays from one scan to the next"
    )
    measurement_variance_m2: float = Field(default=MEASUREMENT_VARIANCE_M2, gt=0, description="diagonal of R [m²]")
    start_speed_m_s: float = Field(
        default=1.5, gt=0, description="standard deviation of a new track's speed [m/s] (ours)"
    )
    colour_weight: float = Field(default=10.0, ge=0, description="w in d = N + w E (inferred; chosen by experiment)")
    unknown_colour: float = Field(
        default=0.3,
        ge=0,
        description="what counts as E where one of two shirts is not known (ours; else who is unknown wins)",
    )
    max_deviations: float = Field(default=4.0, gt=0, description="a pair with a greater N is not believed (ours)")
    foreign_above: float = Field(
        default=0.6, ge=0, description="a pair with a greater E is not believed: another's shirt (ours)"
    )
    recognised_below: float = Field(
        default=0.3,
        ge=0,
        description="a person hidden or astray is known again by an E up to this, beyond the prediction's reach (ours)",
    )
    expected_below: float = Field(
        default=2.0,
        ge=0,
        description="but not in somebody this near, by N, to where somebody in sight is expected; and only this near may a "
        "shirt differ from one that is not known well (ours)",
    )
    looks_to_know: int = Field(
        default=5,
        ge=0,
        description="clear looks after which a shirt is known well; nor do more in a row come from somebody else who passes "
        "by, like whom they look (ours)",
    )
    reach_m_s: float = Field(default=1.5, ge=0, description="how fast a hidden person may have walked [m/s] (ours)")
    period_s: float = Field(
        default=0.1,
        ge=0.001,
        description="scan period that the variances are for; longer gaps are cut into such steps [s]",
    )
    max_wait_s: float = Field(
        default=0.15, ge=0, description="how long a moment waits for a sensor that has not reported [s]"
    )
    waist: WaistOptions = WaistOptions()
    knee: KneeOptions = KneeOptions()
    torso: TorsoOptions = TorsoOptions()
    histogram: HistogramOptions = HistogramOptions()
    management: ManagementOptions = ManagementOptions()
