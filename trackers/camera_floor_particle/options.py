"""Options of `camera-floor-particle`: every rule of the paper, and our replacements, "(ours)"."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from pydantic import Field, PositiveInt, model_validator

from trackers.configuration import Strict, described
from trackers.likelihood.floor import FloorLikelihoodOptions
from trackers.tracking.track_manager import TrackManagementOptions
from trackers.user_input.former_options import warn_of_former_name
from trackers.vision.front_end import FrontEndOptions
from trackers.vision.views import WindowOptions

Checks = Literal["soft", "drop"]
_SOFT = {"body": {"unseen": -15.0, "no_foreground": -4.0}, "head": {"unseen": -30.0, "no_foreground": -4.0}}
"""Values of the soft checks that were options."""
_CHECKS = (
    'a particle that a camera does not see, or whose pixel is not foreground: "drop" it (the paper), or it is less likely: as of '
    "a window without any of its colours, so that none flees to where no camera looks (ours)"
)


class MotionOptions(Strict):
    """Options of the motion of particles: s' = s + τ v + ω (eq. 1), ω normal, growing with the person's speed."""

    fixed_values: ClassVar[Mapping[str, Any]] = {"step_s": 0.05}

    still_m: float = Field(
        default=0.025, gt=0, description="standard deviation of ω of a standing person in 0.05 s, x and y [m]"
    )
    per_speed_s: float = Field(
        default=0.05, ge=0, description="what it grows by with the person's speed, in x and y [m per m/s]"
    )
    up_m: float = Field(default=0.015, ge=0, description="standard deviation of ω in z [m]")
    memory: float = Field(
        default=0.7,
        ge=0,
        lt=1,
        description="share of the last velocity that is kept in the next (ours); 0: (p_t − p_{t−1}) / τ alone (eq. 2)",
    )

    def steps(self, dt: float) -> float:
        """Return the number of nominal steps in a time [s]: variances grow, and memory fades with it (ours)."""
        return dt / 0.05


def _with_checks(content: Any, part: str) -> Any:
    """Replace the former options `unseen` and `no_foreground` of a filter by `checks`."""
    former = {name: content[name] for name in _SOFT[part] if name in content} if isinstance(content, dict) else {}
    if not former:
        return content
    for name in former:
        warn_of_former_name("", f"{part}.{name}", "checks")
    if all(value == "drop" for value in former.values()):
        checks = "drop"
    elif former.items() <= _SOFT[part].items():
        checks = "soft"
    else:
        raise ValueError(f"{former} are no options any more; checks: soft or checks: drop is valid")
    return {name: value for name, value in content.items() if name not in former} | {"checks": checks}


class BodyOptions(Strict):
    """Options of the body's particles and their weights."""

    particles: PositiveInt = Field(default=250, le=10_000, description="N, body particles per person")
    motion: MotionOptions = Field(default=MotionOptions(), description="how they move")
    window: WindowOptions = Field(
        default=WindowOptions(size_px=(30, 100), size_m=(0.42, 1.4), stride=7),
        description="the window about a body particle",
    )
    colour: float = Field(default=15.0, gt=0, description="λ of the colour likelihood exp(−λ D²) (eq. 5)")
    checks: Checks = Field(default="soft", description=_CHECKS)
    under_head_m: float = Field(
        default=0.06,
        ge=0,
        description="standard deviation of the body's place about the head's, more by what the head is lower than of an upright "
        "person (ours) [m]; 0: heads say nothing of bodies (the paper)",
    )

    @model_validator(mode="before")
    @classmethod
    def _of_former_checks(cls, content: Any) -> Any:
        return _with_checks(content, "body")


class FacingOptions(Strict):
    """Options of the pan as a distribution over all directions, by views of the head's estimate (ours).

    They also show whether more of the person is above: then nothing is learned, and the head is soon initiated anew on top.
    """

    colour: float = Field(default=3.0, gt=0, description="λ of those looks' likelihood exp(−λ D²)")
    skin: float = Field(
        default=20.0,
        ge=0,
        description="how surely skin shows the face: concentration of the pan, each frame, about the direction of the skin that "
        "cameras see, by the share of their windows and by how far skin has been where that person walks; 0: not",
    )
    parts: tuple[PositiveInt, PositiveInt] = Field(
        default=(2, 2), description="columns and rows in which those looks compare colours part by part"
    )
    learning: float = Field(
        default=60.0,
        ge=0,
        description="so many of the last looks at a side are in its reference; 0: as at detection (the paper)",
    )
    walking: float = Field(
        default=60.0,
        ge=0,
        description="how surely people look where they walk: concentration of the pan about the heading after 1 s at 1 m/s; "
        "0: not",
    )


class HeadOptions(Strict):
    """Options of the head's particles and their weights."""

    former_names: ClassVar[Mapping[str, str]] = {
        "pan_colour": "facing.colour",
        "skin": "facing.skin",
        "parts": "facing.parts",
        "learning": "facing.learning",
        "walking": "facing.walking",
    }
    fixed_values: ClassVar[Mapping[str, Any]] = {"crown_m": 0.15}

    particles: PositiveInt = Field(default=150, le=10_000, description="M, head particles per person")
    motion: MotionOptions = Field(
        default=MotionOptions(still_m=0.012, per_speed_s=0.02, up_m=0.012), description="how they move"
    )
    turn_deg: float = Field(default=8.0, gt=0, description="standard deviation of ω of the pan [°]")
    facing: FacingOptions | None = Field(
        default=FacingOptions(),
        description="the pan is a distribution over all directions (ours); null: a component of the particles (the paper)",
    )
    references: Literal["nearest", "mixed"] = Field(
        default="mixed",
        description="a pan that no camera shows at detection has the reference of the nearest (the paper), or a mixture (ours)",
    )
    share: float = Field(
        default=0.3,
        ge=0,
        le=1,
        description="α, the share of particles drawn about the body by the last offset of the head (eq. 6)",
    )
    window: WindowOptions = Field(
        default=WindowOptions(size_px=(16, 18), size_m=(0.23, 0.255), stride=4),
        description="the window about a head particle",
    )
    colour: float = Field(default=30.0, gt=0, description="λ of the colour likelihood exp(−λ D²) (eq. 5)")
    nearest_m: float = Field(default=0.3, ge=0, description="a head nearer to the middle of its body is dropped [m]")
    farthest_m: float = Field(
        default=0.95, gt=0, description="a head farther from the middle of its body is dropped [m]"
    )
    checks: Checks = Field(default="soft", description=_CHECKS)
    covered: float = Field(
        default=-1.5,
        le=0,
        description="what is added, for each camera, where a point over the crown is foreground (ours); 0: none (the paper)",
    )

    @property
    def parts(self) -> tuple[int, int]:
        """Columns and rows of the parts of references."""
        return (1, 1) if self.facing is None else self.facing.parts

    @model_validator(mode="before")
    @classmethod
    def _of_former_checks(cls, content: Any) -> Any:
        if isinstance(content, dict) and "pan" in content:
            warn_of_former_name("", "head.pan", "facing")
            by_particles = {"facing": None} if content["pan"] == "particles" else {}
            content = {name: value for name, value in content.items() if name != "pan"} | by_particles
        return _with_checks(content, "head")


class ExclusionOptions(Strict):
    """Options of squares about particles on the floor: where those of two persons overlap, both have weight 0."""

    fixed_values: ClassVar[Mapping[str, Any]] = {"grid_m": 0.02}

    side_m: float = Field(default=0.1, ge=0, description="side of a particle's square [m]; 0: no exclusion")
    likelier_stays: bool = Field(
        default=True,
        description="of two persons the one that the last measurement made likelier keeps the particles (ours); false: "
        "neither does (the paper)",
    )


class FloorTrackManagementOptions(TrackManagementOptions):
    """Common track management options, tentative tracks of floor clusters, and deletion and re-identification by colours."""

    fixed_values: ClassVar[Mapping[str, Any]] = {"least_alike": 0.3}

    confirm_s: float = Field(default=0.28, ge=0, description=described(TrackManagementOptions, "confirm_s"))
    confirm_hits: PositiveInt = Field(default=2, description=described(TrackManagementOptions, "confirm_hits"))
    coast_s: float = Field(
        default=2.5,
        ge=0,
        description="a track that neither the floor nor the cameras have shown for longer is deleted [s]",
    )
    start_apart_m: float = Field(
        default=0.45, ge=0, description="a cluster with an element this near to a track belongs to it [m]"
    )
    area_margin_m: float = Field(
        default=0.8,
        ge=0,
        description="how far beyond the tracked area people are followed before they are out of the room [m]",
    )
    least_load_n: float = Field(default=80.0, ge=0, description="load from which a cluster initiates a track [N]")
    unexplained: float = Field(
        default=0.3,
        ge=0,
        le=1,
        description="the floor must bear this share of the cluster more than the tracks' learned weights together",
    )
    reid_distance: float = Field(
        default=0.35,
        ge=0,
        le=1,
        description="a new track at a smaller distance D in colour from a deleted one is that track again (ours); 0: none is",
    )
    stuck_s: float | None = Field(
        default=3.0,
        gt=0,
        description="a load over which no camera has shown a person for longer is the floor's own [s] (ours); null: never",
    )


class CameraFloorParticleOptions(Strict):
    """Options of the whole system with our defaults; the preset `camera-floor-particle-paper` has the paper's."""

    former_names: ClassVar[Mapping[str, str]] = {
        "foreground": "front_end.foreground",
        "shadows": "front_end.shadow_region",
        "gain_from": "front_end.exposure_tolerance",
        "floor.least_value": "least_value",
        "body.no_load": "load.no_load",
        "body.floor_smoothing_m": "load.smoothing_m",
        "detection.apart_m": "track_management.start_apart_m",
        "detection.gone_s": "track_management.coast_s",
        "detection.same_below": "track_management.reid_distance",
        "detection": "track_management",
        "room_margin_m": "track_management.area_margin_m",
    }
    fixed_values: ClassVar[Mapping[str, Any]] = {
        "floor.least_load_n": 0.0,
        "floor.least_cells": 1,
        "histogram.hue": 10,
        "histogram.saturation": 10,
        "histogram.value": 10,
        "histogram.saturation_above": 0.1,
        "histogram.value_above": 0.07,
    }

    use_floor: bool = Field(default=True, description="whether the floor weighs particles; it detects in any case")
    use_cameras: bool = Field(default=True, description="whether pictures are looked at at all")
    least_value: int = Field(
        default=5, ge=1, le=255, description="8-bit value from which an element is loaded; empty ones flicker below it"
    )
    front_end: FrontEndOptions = Field(default=FrontEndOptions(), description="what is done with pictures first")
    load: FloorLikelihoodOptions = Field(
        default=FloorLikelihoodOptions(), description="how the floor weighs body particles"
    )
    body: BodyOptions = Field(default=BodyOptions(), description="the body's filter")
    head: HeadOptions = Field(default=HeadOptions(), description="the head's filter")
    exclusion: ExclusionOptions = Field(default=ExclusionOptions(), description="particles of different persons")
    track_management: FloorTrackManagementOptions = Field(
        default=FloorTrackManagementOptions(), description="when tracks are initiated, confirmed, reported and deleted"
    )
