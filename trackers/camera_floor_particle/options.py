"""The options of `camera-floor-particle`: every rule of the paper, and what we put in its place."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field, PositiveInt

from trackers.arrays import Array
from trackers.cameras.placed import PlacedCamera
from trackers.configuration import Strict
from trackers.floor.clusters import FloorClusterOptions
from trackers.vision.colour_bins import HueSaturationValueBins
from trackers.vision.foreground import ForegroundOptions

Ruling = float | Literal["drop"]
"""What a failed check does to a particle: "drop" it, or add this to its log-likelihood."""


_NEAREST_M = 0.3
"""Whoever is nearer to a camera than this fills no larger a window."""


class WindowOptions(Strict):
    """The window of pixels that a particle looks at."""

    width_px: PositiveInt = Field(description="width of the window [px]")
    height_px: PositiveInt = Field(description="height of the window [px]")
    size_m: tuple[float, float] | None = Field(
        description="width and height of what the window shows, so that it is smaller farther off (ours) [m]; none: it has its "
        "width and height in pixels everywhere (the paper)",
    )
    stride: PositiveInt = Field(
        default=4,
        le=8,
        description="of every so many pixels, along rows and columns, one is looked at; as many of a window of another size",
    )
    pixels: Literal["all", "foreground"] = Field(
        default="foreground",
        description="all pixels of the window count (the paper), or those of the foreground, as a share of the window (ours)",
    )

    @property
    def samples(self) -> tuple[int, int]:
        """Columns and rows of the pixels looked at."""
        return max(1, self.width_px // self.stride), max(1, self.height_px // self.stride)

    def size_px(self, camera: PlacedCamera, places: Float[Array, "3 k"]) -> Float[Array, "k 2"]:
        """Width and height of the windows about places in the room [m], in a camera's picture [px]."""
        if self.size_m is None:
            return np.full((places.shape[1], 2), [self.width_px, self.height_px], float)
        off_m = places - camera.eye_m[:, None]
        away_m = np.maximum(np.sqrt(np.einsum("ck,ck->k", off_m, off_m)), _NEAREST_M)
        return np.array(self.size_m) * (camera.intrinsics.fx / away_m)[:, None]

    def box(self, place: Float[Array, "3"], camera: PlacedCamera) -> tuple[float, float, float, float] | None:
        """Left, top, width and height [px] of the window about a place in the room [m]; None where a picture does not show it."""
        (u, v), seen = camera.project(place)
        width, height = self.size_px(camera, place[:, None])[0].tolist()
        return (float(u) - width / 2, float(v) - height / 2, width, height) if seen else None


class MotionOptions(Strict):
    """How particles move: s' = s + τ v + ω (eq. 1), ω normal, growing with the person's speed."""

    still_m: float = Field(
        default=0.025, gt=0, description="standard deviation of ω of somebody who stands, x and y [m]"
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
    step_s: float = Field(
        default=0.05,
        gt=0,
        description="time step that ω and the memory are for [s]; over another, variances grow in proportion to time and memory "
        "fades exponentially (ours)",
    )

    def steps(self, dt: float) -> float:
        """How many of the steps that ω is for a time [s] makes."""
        return dt / self.step_s


class BodyOptions(Strict):
    """The body's particles, and how they are weighted."""

    particles: PositiveInt = Field(default=250, le=10_000, description="N, body particles a person")
    motion: MotionOptions = Field(default=MotionOptions(), description="how they move")
    window: WindowOptions = Field(
        default=WindowOptions(width_px=30, height_px=100, size_m=(0.42, 1.4), stride=7),
        description="the window about a body particle",
    )
    colour: float = Field(default=15.0, gt=0, description="λ of the colour likelihood exp(−λ D²) (eq. 5)")
    unseen: Ruling = Field(
        default=-15.0,
        description='a particle that a camera does not see: "drop" it (the paper), or this is added: as of a window without any '
        "of its colours, so that nobody flees to where no camera looks (ours)",
    )
    no_foreground: Ruling = Field(
        default=-4.0,
        description='a particle whose pixel is not foreground: "drop" it (the paper), or this is added (ours)',
    )
    no_load: Ruling = Field(
        default=-7.0,
        description='a particle over an element without load: "drop" it (the paper), or it weighs exp of this (ours)',
    )
    floor_smoothing_m: float = Field(
        default=0.12,
        ge=0,
        description="standard deviation by which the cluster's load is smoothed over the floor (ours) [m]; 0: by element (eq. 3)",
    )
    under_head_m: float = Field(
        default=0.06,
        ge=0,
        description="standard deviation of the body's place about the head's, more by what the head is lower than of somebody "
        "upright (ours) [m]; 0: heads say nothing of bodies (the paper)",
    )


class HeadOptions(Strict):
    """The head's particles, and how they are weighted."""

    particles: PositiveInt = Field(default=150, le=10_000, description="M, head particles a person")
    motion: MotionOptions = Field(
        default=MotionOptions(still_m=0.012, per_speed_s=0.02, up_m=0.012), description="how they move"
    )
    turn_deg: float = Field(default=8.0, gt=0, description="standard deviation of ω of the pan [°]")
    pan: Literal["particles", "grid"] = Field(
        default="grid",
        description="the pan is a component of the particles (the paper), or a distribution over all directions by looks at the "
        "head's estimate (ours)",
    )
    pan_colour: float = Field(default=3.0, gt=0, description="λ of those looks' likelihood exp(−λ D²) (ours)")
    skin: float = Field(
        default=20.0,
        ge=0,
        description="how surely skin tells the face: concentration of the pan, each moment, about the direction of the skin that "
        "cameras see, by the share of their windows and by how far skin has been where that person walks (ours); 0: not",
    )
    parts: tuple[PositiveInt, PositiveInt] = Field(
        default=(2, 2), description="columns and rows in which those looks compare colours part by part (ours)"
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
        default=WindowOptions(width_px=16, height_px=18, size_m=(0.23, 0.255), stride=4),
        description="the window about a head particle",
    )
    colour: float = Field(default=30.0, gt=0, description="λ of the colour likelihood exp(−λ D²) (eq. 5)")
    nearest_m: float = Field(default=0.3, ge=0, description="a head nearer to the middle of its body is dropped [m]")
    farthest_m: float = Field(
        default=0.95, gt=0, description="a head farther from the middle of its body is dropped [m]"
    )
    unseen: Ruling = Field(
        default=-30.0,
        description='a particle that a camera does not see: "drop" it (the paper), or this is added: as of a window without any '
        "of its colours, so that nobody flees to where no camera looks (ours)",
    )
    no_foreground: Ruling = Field(
        default=-4.0,
        description='a particle whose pixel is not foreground: "drop" it (the paper), or this is added (ours)',
    )
    crown_m: float = Field(
        default=0.15,
        ge=0,
        description="a point so far above the middle of a head is above all of it (ours) [m]; 0: not looked at (the paper)",
    )
    covered: float = Field(
        default=-1.5,
        le=0,
        description="what is added where that point is foreground all the same, for each camera (ours)",
    )
    learning: float = Field(
        default=60.0,
        ge=0,
        description="so many of the last looks at a side are in its reference (ours); 0: as at detection (the paper)",
    )
    walking: float = Field(
        default=60.0,
        ge=0,
        description="how surely people look where they walk: concentration of the pan about the heading after 1 s at 1 m/s "
        "(ours); 0: not",
    )


class ExclusionOptions(Strict):
    """Squares about particles on the floor: where those of two persons overlap, both weigh nothing."""

    side_m: float = Field(default=0.1, ge=0, description="side of a particle's square [m]; 0: no exclusion")
    grid_m: float = Field(default=0.02, gt=0, description="side of the elements of the grid it is worked out on [m]")
    likelier_stays: bool = Field(
        default=True,
        description="of two persons the one whom the last measurement made likelier keeps the particles (ours); false: "
        "neither does (the paper)",
    )


class DetectionOptions(Strict):
    """When a cluster on the floor is somebody new, and when somebody is gone."""

    confirm_s: float = Field(
        default=0.28,
        ge=0,
        description="a cluster that stays for longer than this is somebody, each of the floor's frames standing for the time "
        "since the one before [s]",
    )
    least_load_n: float = Field(default=80.0, ge=0, description="and bears at least this [N]")
    apart_m: float = Field(
        default=0.45, gt=0, description="a cluster with an element this near to a known person is theirs [m]"
    )
    unexplained: float = Field(
        default=0.3,
        ge=0,
        le=1,
        description="the floor must bear this share of the cluster more than the known persons' learned weights together",
    )
    stuck_s: float = Field(
        default=3.0,
        gt=0,
        description="a load that no camera shows anybody on for so long is the floor's own (ours) [s]",
    )
    gone_s: float = Field(
        default=2.5, gt=0, description="whom neither floor nor cameras have shown for so long is gone [s]"
    )
    least_alike: float = Field(
        default=0.3,
        ge=0,
        le=1,
        description="cameras show somebody where colours are so similar (1 − D²), on average over cameras and particles",
    )
    same_below: float = Field(
        default=0.35,
        ge=0,
        le=1,
        description="somebody new at a smaller distance D in colour from somebody gone is that person again; 0: nobody is",
    )


class CameraFloorParticleOptions(Strict):
    """The whole system; its defaults are what works, the preset `camera-floor-particle-paper` is the paper's own."""

    use_floor: bool = Field(default=True, description="whether the floor weighs particles; it detects in any case")
    use_cameras: bool = Field(default=True, description="whether pictures are looked at at all")
    floor: FloorClusterOptions = Field(default=FloorClusterOptions(), description="what counts as load")
    foreground: ForegroundOptions = Field(default=ForegroundOptions(), description="what counts as foreground")
    histogram: HueSaturationValueBins = Field(default=HueSaturationValueBins(), description="the bins of colours")
    detection: DetectionOptions = Field(default=DetectionOptions(), description="who comes and goes")
    body: BodyOptions = Field(default=BodyOptions(), description="the body's filter")
    head: HeadOptions = Field(default=HeadOptions(), description="the head's filter")
    exclusion: ExclusionOptions = Field(default=ExclusionOptions(), description="particles of different persons")
    room_margin_m: float = Field(
        default=0.8,
        ge=0,
        description="how far beyond the tracked area people are followed before they are out of the room [m]",
    )
    shadows: Literal["floor", "everywhere"] = Field(
        default="floor",
        description="what may be a shadow is left out of the foreground everywhere, or only where a camera sees the floor as far "
        "as people are followed: grey hair before a grey wall is none (ours)",
    )
    gain_from: float = Field(
        default=0.08,
        ge=0,
        description="a picture lighter or darker than the empty room by more than this share is set right (ours); 0: never",
    )
