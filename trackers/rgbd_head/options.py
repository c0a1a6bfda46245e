"""Options of `rgbd-head`: the paper's rules, and our replacements and additions, "(ours)"."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from pydantic import Field, FiniteFloat, PositiveInt, model_validator

from trackers.configuration import Strict, described
from trackers.likelihood.floor import EnvironmentLikelihoodOptions
from trackers.likelihood.stereo_head import StereoHeadOptions
from trackers.tracking.track_manager import TrackManagementOptions
from trackers.user_input.former_options import warn_of_former_name
from trackers.vision.foreground import ForegroundOptions
from trackers.vision.front_end import FrontEndOptions


class HeadMotionOptions(Strict):
    """Options of heads' motion between frames; the paper gives no motion model, so all are ours."""

    still_m: float = Field(
        default=0.1, gt=0, description="diffusion of a standing person, along x and y, in a second [m per √s]"
    )
    per_speed_m: float = Field(
        default=0.12, ge=0, description="what that grows by with the person's speed [m per √s per m/s]"
    )
    up_m: float = Field(default=0.08, gt=0, description="diffusion along z in a second [m per √s]")
    turn_deg: float = Field(default=60.0, gt=0, description="diffusion of the direction in a second [° per √s]")
    turned: float = Field(
        default=0.1,
        ge=0,
        lt=1,
        description="share of hypotheses that may look anywhere at the next frame: heads turn fast",
    )
    layers: PositiveInt = Field(
        default=3,
        le=10,
        description="so many times a frame hypotheses are weighed, each time by the same root of their weights and drawn anew "
        "from the heavy ones: an annealed particle filter (Deutscher et al. 2000; ours); 1: the paper",
    )
    resample_below: float = Field(
        default=0.7,
        ge=0,
        le=1,
        description="hypotheses are drawn anew when their effective number is at most this share (ours); 1: in every frame "
        "(the paper)",
    )
    nearer: float = Field(
        default=0.5, gt=0, le=1, description="diffusion of a layer, as a share of that of the one before (ours)"
    )
    velocity_s: float = Field(
        default=0.35,
        ge=0,
        description="time constant with which a person's velocity follows their steps [s]; 0: none is carried on",
    )
    directions: bool = Field(
        default=True,
        description="where a head faces is a distribution over all directions, by the colours at its expected place (ours); "
        "false: each hypothesis faces somewhere, and is weighed so (the paper)",
    )
    walking: float = Field(
        default=1.5,
        ge=0,
        description="how surely people look where they walk: concentration about the heading at 1 m/s (ours); 0: not",
    )


class HeadTrackManagementOptions(TrackManagementOptions):
    """Common track management options, and initiation by foreground (all ours: the paper knows each start)."""

    confirm_s: float = Field(default=0.28, ge=0, description=described(TrackManagementOptions, "confirm_s"))
    confirm_hits: PositiveInt = Field(default=3, description=described(TrackManagementOptions, "confirm_hits"))
    tentative_coast_s: float = Field(
        default=0.5, ge=0, description=described(TrackManagementOptions, "tentative_coast_s")
    )
    start_apart_m: float = Field(default=0.5, ge=0, description="foreground nearer to a track belongs to it [m]")
    area_margin_m: float = Field(
        default=100.0, ge=0, description="how far outside the rig's area heads are followed [m]"
    )
    least_m2: float = Field(
        default=0.12,
        gt=0,
        description="area of foreground that cameras see about a place for a person to be there [m²]",
    )
    spread_m: float = Field(default=0.12, gt=0, description="standard deviation of a new track's heads [m]")
    least_shown: float = Field(
        default=0.45,
        ge=0,
        le=1,
        description="detection probability from which a head is measured, on average over the cameras that see it: the share of "
        "foreground in the ellipse times that of background over it",
    )
    same_head_m: float = Field(
        default=0.22,
        gt=0,
        description="nearer to another's head than this there is no head: one is owned by one track [m]",
    )


class Start(Strict):
    """Known position of a head at a time: the initial state of the paper."""

    at_s: float = Field(default=0.0, ge=0, description="when [s]")
    place: tuple[FiniteFloat, FiniteFloat, FiniteFloat] = Field(description="middle of the head [m]")
    yaw_deg: FiniteFloat = Field(description="where it faces [°]")


class RgbdHeadOptions(Strict):
    """Options of the whole system with our defaults; the preset `rgbd-head-paper` has the paper's."""

    former_names: ClassVar[Mapping[str, str]] = {
        "weights.foreground": "front_end.foreground",
        "weights.shadows": "front_end.shadow_region",
        "weights.gain_from": "front_end.exposure_tolerance",
        "weights.colour.directions": "motion.directions",
        "weights": "stereo_head",
        "life.unseen": "stereo_head.out_of_view",
        "life.apart_m": "track_management.start_apart_m",
        "life.confirm": "track_management.confirm_hits",
        "life.tentative_s": "track_management.tentative_coast_s",
        "life.gone_s": "track_management.coast_s",
        "life": "track_management",
    }
    fixed_values: ClassVar[Mapping[str, Any]] = {
        "weights.colour.common_pixels": 60.0,
        "weights.colour.most_pixels": 3000.0,
    }

    heads: PositiveInt = Field(default=256, le=100_000, description="N, hypotheses per person (the paper: 512)")
    front_end: FrontEndOptions = Field(
        default=FrontEndOptions(foreground=ForegroundOptions(least_area_px=1)),
        description="what is done with pictures first",
    )
    stereo_head: StereoHeadOptions = Field(default=StereoHeadOptions(), description="how a picture weighs heads")
    environment: EnvironmentLikelihoodOptions | None = Field(
        default=EnvironmentLikelihoodOptions(), description="how the room weighs heads; null: it does not"
    )
    motion: HeadMotionOptions = Field(default=HeadMotionOptions(), description="how heads move")
    own_stamps: bool = Field(
        default=True,
        description="each picture is weighed with heads moved to its own stamp (ours); false: all pictures of a frame are taken "
        "for simultaneous",
    )
    scheduler: str | None = Field(
        default=None,
        description="address of a Dask scheduler, like tcp://host:8786, with a worker for each camera, where its pictures are "
        "weighed (the paper's clients); none: everything is done here",
    )
    cameras: tuple[str, ...] = Field(
        default=(), description="names of the stereo cameras that are looked at; none: all of the rig's"
    )
    leave_out: bool = Field(
        default=True,
        description="a camera that is named as hanging elsewhere than the rig says is left out, as long as more than half of "
        "them remain (ours); false: it is only named",
    )
    start: tuple[Start, ...] = Field(
        default=(),
        description="heads that are known at a time (the paper), and followed to the end; none: tracks are initiated and "
        "deleted (ours)",
    )
    track_management: HeadTrackManagementOptions = Field(
        default=HeadTrackManagementOptions(),
        description="when tracks are initiated, confirmed, reported and deleted, where no start is known",
    )

    @model_validator(mode="before")
    @classmethod
    def _of_former_switch(cls, content: Any) -> Any:
        """Accept `environment.used`, for one release."""
        environment = content.get("environment") if isinstance(content, dict) else None
        if not isinstance(environment, dict) or "used" not in environment:
            return content
        warn_of_former_name("", "environment.used", "environment: null")
        rest = {name: value for name, value in environment.items() if name != "used"}
        return content | {"environment": rest if environment["used"] else None}
