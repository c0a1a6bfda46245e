"""The options of `rgbd-head`: the paper's rules, and what we put in their place or beside them, "(ours)"."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, FiniteFloat, PositiveInt

from trackers.configuration import Strict
from trackers.vision.foreground import ForegroundOptions

Length = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Linear = tuple[FiniteFloat, FiniteFloat]


class ColourOptions(Strict):
    """How the colours in the ellipse weigh a head."""

    used: bool = Field(default=True, description="whether colours weigh heads at all")
    by_person: bool = Field(
        default=True,
        description="where on the head the person's own colours of face and hair are (ours); false: the share of skin in the "
        "ellipse (the paper, eq. 4 and 5)",
    )
    power: float = Field(
        default=12.0, ge=0, description="what the mean logarithm over the ellipse's pixels counts (ours)"
    )
    directions: bool = Field(
        default=True,
        description="where a head faces is a distribution over all directions, by the colours at its expected place (ours); "
        "false: each hypothesis faces somewhere, and is weighed so (the paper)",
    )
    common_pixels: float = Field(
        default=60.0,
        gt=0,
        description="what is common among people counts as so many pixels of a person's own (ours)",
    )
    most_pixels: float = Field(
        default=3000.0, gt=0, description="of a person's own pixels so many are remembered, of face and of hair (ours)"
    )
    linear: Linear = Field(
        default=(1.0, 1.0), description="a and b of the weight a − b |c̄ − ĉ| (eq. 5; the paper gives neither)"
    )
    front: float = Field(
        default=0.7, ge=0, le=1, description="ĉ of a head seen from the front, its largest (the paper gives no formula)"
    )
    behind: float = Field(default=0.05, ge=0, le=1, description="ĉ of a head seen from behind, its smallest")


class DepthOptions(Strict):
    """How the distances in the ellipse weigh a head."""

    used: bool = Field(default=True, description="whether distances weigh heads at all")
    by_range: bool = Field(
        default=True,
        description="the difference along the ray counts by how sure a distance is so far away (ours); false: in metres, from "
        "the middle of the head (the paper, eq. 6 and 7)",
    )
    sigma_m: float = Field(default=0.02, gt=0, description="standard deviation of a distance close by (ours) [m]")
    sigma_per_m: float = Field(
        default=0.006, ge=0, description="what it grows by with the square of the distance (ours) [m per m²]"
    )
    most: float = Field(
        default=3.0, gt=0, description="a pixel is off by no more than so many standard deviations (ours)"
    )
    power: float = Field(default=4.0, ge=0, description="what the mean over the ellipse's pixels counts (ours)")
    linear: Linear = Field(
        default=(1.0, 2.0),
        description="a and b [1/m] of the weight a − b · mean |d − d̂| (eq. 7; the paper gives neither)",
    )
    most_m: float = Field(
        default=0.45, gt=0, description="a pixel is off by no more than this (ours; the paper has no cap) [m]"
    )


class SilhouetteOptions(Strict):
    """Foreground inside the ellipse and background over it (ours)."""

    power: float = Field(default=6.0, ge=0, description="power of the two shares; 0: not looked at (the paper)")
    ring: float = Field(default=1.3, gt=1, description="size of the half ring over the ellipse, in its semi-axes")
    ring_points: PositiveInt = Field(default=8, le=128, description="points looked at on the half ring")
    floor: float = Field(default=0.02, gt=0, lt=1, description="a share counts at least as this")


class WeightOptions(Strict):
    """How one picture weighs heads."""

    semi_axes_m: tuple[Length, Length, Length] = Field(
        default=(0.10, 0.08, 0.125), description="semi-axes of a head: ahead, to the side, up [m]"
    )
    points: PositiveInt = Field(default=20, le=512, description="points looked at in each ellipse")
    foreground: ForegroundOptions = Field(
        default=ForegroundOptions(least_area_px=1), description="what counts as foreground"
    )
    shadows: Literal["floor", "everywhere"] = Field(
        default="floor",
        description="what may be a shadow is left out of the foreground everywhere, or only where a camera sees the floor of the "
        "tracked area: grey hair before a grey wall is none (ours)",
    )
    gain_from: float = Field(
        default=0.08,
        ge=0,
        description="a picture lighter or darker than the empty room by more than this share is set right (ours); 0: never",
    )
    colour: ColourOptions = Field(default=ColourOptions(), description="colours")
    depth: DepthOptions = Field(default=DepthOptions(), description="distances")
    silhouette: SilhouetteOptions = Field(default=SilhouetteOptions(), description="silhouettes (ours)")


class EnvironmentOptions(Strict):
    """How likely a head is anywhere in the room (eq. 8), where the environment is known."""

    used: bool = Field(default=True, description="whether the room weighs heads at all")
    above_furniture: float = Field(
        default=0.5, ge=0, le=1, description="weight over furniture, region B; over chairs, where people sit, too"
    )
    odd_height: float = Field(default=0.2, ge=0, le=1, description="weight too low and too high, region C")
    low_m: FiniteFloat = Field(default=0.8, description="what is lower is too low (the paper gives no height) [m]")
    high_m: FiniteFloat = Field(default=1.9, description="what is higher is too high (the paper gives no height) [m]")
    radius_m: float = Field(
        default=0.08,
        ge=0,
        description="a head's middle is at least so far from what region A holds (ours); 0: the paper [m]",
    )


class MotionOptions(Strict):
    """How heads move between moments; the paper gives no motion model, so that all of it is ours."""

    still_m: float = Field(
        default=0.1, gt=0, description="diffusion of who stands, along x and y, in a second [m per √s]"
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
        description="share of hypotheses that may look anywhere at the next moment: heads turn fast",
    )
    layers: PositiveInt = Field(
        default=3,
        le=10,
        description="so many times a moment hypotheses are weighed, each time by the same root of their weights and drawn anew "
        "from the heavy ones: an annealed particle filter (Deutscher et al. 2000; ours); 1: the paper",
    )
    nearer: float = Field(
        default=0.5, gt=0, le=1, description="diffusion of a layer, as a share of that of the one before (ours)"
    )
    velocity_s: float = Field(
        default=0.35,
        ge=0,
        description="time constant with which a person's velocity follows their steps [s]; 0: none is carried on",
    )
    walking: float = Field(
        default=1.5,
        ge=0,
        description="how surely people look where they walk: concentration about the heading at 1 m/s (ours); 0: not",
    )


class LifeOptions(Strict):
    """Own start: when somebody is found, confirmed, and gone (all ours: the paper knows where the head is at first)."""

    least_m2: float = Field(
        default=0.12,
        gt=0,
        description="area of foreground that cameras see about a place for somebody to be there [m²]",
    )
    apart_m: float = Field(default=0.5, gt=0, description="foreground nearer to a known person is theirs [m]")
    spread_m: float = Field(default=0.12, gt=0, description="standard deviation of a new person's heads [m]")
    least_shown: float = Field(
        default=0.45,
        ge=0,
        le=1,
        description="share of foreground in the ellipse times that of background over it from which a head is shown, on average "
        "over the cameras that see it",
    )
    confirm: PositiveInt = Field(default=3, description="moments at which a new head is shown until it is confirmed")
    confirm_s: float = Field(
        default=0.28,
        ge=0,
        description="and it is shown for longer than this, each moment standing for the time since the one before [s]",
    )
    tentative_s: float = Field(default=0.5, ge=0, description="a tentative head not shown for longer is none [s]")
    gone_s: float = Field(default=2.0, gt=0, description="whose head is not shown for so long is gone [s]")
    same_head_m: float = Field(
        default=0.22,
        gt=0,
        description="nearer to another's head than this there is no head: one is owned by one track [m]",
    )
    unseen: float = Field(
        default=0.7,
        ge=0,
        description="a hypothesis that a picture does not show weighs what the person's do on average, less this",
    )


class Start(Strict):
    """Where a head is known to be at a time: the initial state of the paper."""

    at_s: float = Field(default=0.0, ge=0, description="when [s]")
    place: tuple[FiniteFloat, FiniteFloat, FiniteFloat] = Field(description="middle of the head [m]")
    yaw_deg: FiniteFloat = Field(description="where it faces [°]")


class RgbdHeadOptions(Strict):
    """The whole system; its defaults are what works, the preset `rgbd-head-paper` is the paper's own."""

    heads: PositiveInt = Field(default=256, le=100_000, description="N, hypotheses a person (the paper: 512)")
    weights: WeightOptions = Field(default=WeightOptions(), description="how a picture weighs them")
    environment: EnvironmentOptions = Field(default=EnvironmentOptions(), description="how the room weighs them")
    motion: MotionOptions = Field(default=MotionOptions(), description="how heads move")
    own_stamps: bool = Field(
        default=True,
        description="each picture is weighed with heads moved to its own stamp (ours); false: all pictures of a moment are taken "
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
        description="a camera that is named as hanging elsewhere than the rig says is looked at no more, as long as more than "
        "half of them remain (ours); false: it is only named",
    )
    start: tuple[Start, ...] = Field(
        default=(),
        description="heads that are known at a time (the paper), and followed to the end; none: people are found and "
        "end (ours)",
    )
    life: LifeOptions = Field(default=LifeOptions(), description="who comes and goes, where no start is known")
