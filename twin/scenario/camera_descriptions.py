"""Pinhole and stereo cameras in a scenario."""

from __future__ import annotations

from math import ceil, radians, tan
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import Field, FiniteFloat, model_validator

from trackers.cameras import PinholeIntrinsics
from trackers.cameras.intrinsics import Side
from trackers.configuration import Strict
from trackers.rig import DepthMode, PinholeSensor, StereoSensor
from trackers.rig_sensors import Baseline
from twin.scenario.mount import Mounted, NoiseName, by_name
from twin.sensors.camera import (
    CAMERA_NOISE,
    STEREO_NOISE,
    CameraNoise,
    FocalLengthOfRows,
    Matching,
    PrincipalColumn,
    PrincipalRow,
    StereoNoise,
    WhiteBalance,
)

DEEPEST_M = 65.0
"""Greatest depth in a message: whole millimetres in 16 bits."""

CameraNoiseByName = Annotated[
    CameraNoise, by_name(CAMERA_NOISE, "parameters like {read_sigma: 2}", NoiseName | CameraNoise)
]
"""The noise of a camera, by name or by its parameters."""
_StereoNoise = Annotated[
    StereoNoise, by_name(STEREO_NOISE, "parameters like {disparity_sigma_px: 0.3}", NoiseName | StereoNoise)
]


class Distortion(Strict):
    """Brown–Conrady coefficients, named as in OpenCV and ROS (`plumb_bob`); all 0: none."""

    k1: FiniteFloat = Field(
        default=0.0, description="radial coefficient of r², r the tangent of the angle from the axis"
    )
    k2: FiniteFloat = Field(default=0.0, description="radial coefficient of r⁴")
    p1: FiniteFloat = Field(default=0.0, description="first tangential coefficient")
    p2: FiniteFloat = Field(default=0.0, description="second tangential coefficient")
    k3: FiniteFloat = Field(default=0.0, description="radial coefficient of r⁶")


class MotionBlur(Strict):
    """Motion blur: exposure time from the stamp on [s], and the number of evenly spaced instants averaged."""

    exposure_s: float = Field(gt=0, le=0.25, description="how long the shutter is open, from the stamp on [s]")
    instants: int = Field(
        default=5,
        ge=2,
        le=64,
        description="number of instants, evenly spaced over the exposure, at which light is gathered",
    )


class PerspectiveDescription(Mounted):
    """Common part of pinhole and stereo cameras: mount, size and focal length.

    The mount's x axis is the optical axis. The focal length is given by one of `field_of_view_deg` (horizontal, edge to
    edge, of the undistorted picture), `vertical_field_of_view_deg`, or `fx` [px] (and `fy`, by default `fx`). The principal
    point `cx`, `cy` [px] is the middle of the picture by default (pixel centres are integers).

    `exposure` multiplies the sensor's light and `white_balance` its channels [red, green, blue], both in addition to those
    of the noise.
    """

    size: tuple[Side, Side] = Field(default=(640, 480), description="width and height of the picture [px]")
    field_of_view_deg: float | None = Field(
        default=None,
        gt=0,
        lt=180,
        description="horizontal field of view, edge to edge, of the undistorted picture [deg]; none: given otherwise",
    )
    vertical_field_of_view_deg: float | None = Field(
        default=None,
        gt=0,
        lt=180,
        description="vertical field of view, edge to edge, of the undistorted picture [deg]; none: given otherwise",
    )
    fx: float | None = Field(
        default=None, gt=0, allow_inf_nan=False, description="focal length along a row [px]; none: given otherwise"
    )
    fy: FocalLengthOfRows = None
    cx: PrincipalColumn = None
    cy: PrincipalRow = None
    exposure: float = Field(
        default=1.0, gt=0, le=10, description="factor on the light that the sensor gathers, beside that of the noise"
    )
    white_balance: WhiteBalance = Field(
        default=(1.0, 1.0, 1.0), description="factors on red, green and blue, beside those of the noise"
    )

    @model_validator(mode="after")
    def _one_focal_length(self) -> PerspectiveDescription:
        given = [name for name in ("field_of_view_deg", "vertical_field_of_view_deg", "fx") if getattr(self, name)]
        if len(given) != 1:
            what = "none is given" if not given else f"{' and '.join(given)} are given"
            raise ValueError(f"{what}; one of field_of_view_deg, vertical_field_of_view_deg and fx is expected")
        if self.fy is not None and self.fx is None:
            raise ValueError(f"fy {self.fy:g} is given without fx; both, or a field of view, are expected")
        return self

    def intrinsics(self) -> PinholeIntrinsics:
        """Return the intrinsics without distortion."""
        width, height = self.size
        if self.field_of_view_deg is not None:
            fx = width / 2 / tan(radians(self.field_of_view_deg) / 2)
        elif self.vertical_field_of_view_deg is not None:
            fx = height / 2 / tan(radians(self.vertical_field_of_view_deg) / 2)
        else:
            assert self.fx is not None
            fx = self.fx
        return PinholeIntrinsics(
            width=width,
            height=height,
            fx=fx,
            fy=self.fy or fx,
            cx=self.cx if self.cx is not None else (width - 1) / 2,
            cy=self.cy if self.cy is not None else (height - 1) / 2,
        )


class PinholeDescription(PerspectiveDescription):
    """Pinhole camera with Brown–Conrady `distortion` and optional `motion_blur`."""

    kind: Literal["camera"] = Field(description="the kind of sensor: a pinhole camera")
    distortion: Distortion = Field(default=Distortion(), description="distortion of the lens, Brown–Conrady")
    motion_blur: MotionBlur | None = Field(
        default=None, description="how long the shutter is open; none: pictures are instants"
    )
    noise: CameraNoiseByName = Field(
        default=CAMERA_NOISE["default"], description="noise of the image sensor: off, default, worse, or its parameters"
    )

    @model_validator(mode="after")
    def _renderable(self) -> PinholeDescription:
        self.intrinsics().check_view()
        return self

    def intrinsics(self) -> PinholeIntrinsics:
        """Return the intrinsics with distortion."""
        lens = self.distortion
        return super().intrinsics().model_copy(update={"distortion": (lens.k1, lens.k2, lens.p1, lens.p2, lens.k3)})

    @property
    def instants_s(self) -> tuple[float, ...]:
        """Instants of a picture, as offsets from the stamp [s]."""
        if self.motion_blur is None:
            return (0.0,)
        count = self.motion_blur.instants
        return tuple(float(each) for each in (np.arange(count) + 0.5) / count * self.motion_blur.exposure_s)

    @property
    def electronics(self) -> CameraNoise:
        """The noise at this exposure and white balance."""
        return _exposed(self.noise, self)

    def rig_sensor(self, name: str) -> PinholeSensor:
        """Return the camera as a sensor of a rig."""
        return PinholeSensor(
            topic=f"/{name}/image/compressed",
            room_from_sensor=self.mount.room_from_optical(),
            intrinsics=self.intrinsics(),
        )


class StereoDescription(PerspectiveDescription):
    """A stereo RGB-D camera: two views `baseline_m` apart, rectified, and from them the depth of each left pixel.

    `mode`: 'matched' (two noisy pictures through a real matcher, `matching`), 'ideal' (the true depth), or
    'disparity-noise' (the true depth with the noise's `disparity_sigma_px` on its disparity). The mount is the left
    view's; the right one hangs `baseline_m` to the right. Depth outside `range_min_m` to `range_max_m` is not reported.
    """

    kind: Literal["stereo"] = Field(description="the kind of sensor: a stereo camera, colour and depth")
    size: tuple[Side, Side] = Field(default=(320, 240), description="width and height of the picture [px]")
    baseline_m: Baseline = Field(default=0.12, description="how far the right view is to the right of the left one [m]")
    mode: DepthMode = Field(
        default="matched",
        description="how depth is made: two noisy pictures matched, the true depth, or that with noise on its disparity",
    )
    range_min_m: float = Field(default=0.5, gt=0, description="nearest depth that is reported [m]")
    range_max_m: float = Field(default=10.0, gt=0, le=DEEPEST_M, description="farthest depth that is reported [m]")
    matching: Matching = Field(default=Matching(), description="settings of the matcher, in mode 'matched'")
    noise: _StereoNoise = Field(
        default=STEREO_NOISE["default"],
        description="noise of both pictures and of the disparity: off, default, worse, or its parameters",
    )

    @model_validator(mode="after")
    def _sees_depth(self) -> StereoDescription:
        if self.range_min_m >= self.range_max_m:
            raise ValueError(f"range_min_m {self.range_min_m:g} must be below range_max_m {self.range_max_m:g}")
        intrinsics = self.intrinsics()
        intrinsics.check_view()
        if self.mode == "matched" and self.baseline_m * intrinsics.fx / self.range_min_m > intrinsics.width:
            nearest_m = ceil(1e3 * self.baseline_m * intrinsics.fx / intrinsics.width) / 1e3
            raise ValueError(
                f"range_min_m {self.range_min_m:g} is too near to be in both views; from {nearest_m:g} on is valid "
                f"at baseline_m {self.baseline_m:g}"
            )
        return self

    @property
    def electronics(self) -> StereoNoise:
        """The noise at this exposure and white balance."""
        return _exposed(self.noise, self)

    def rig_sensor(self, name: str) -> StereoSensor:
        """Return the camera as a sensor of a rig."""
        return StereoSensor(
            topic=f"/{name}/image/compressed",
            depth_topic=f"/{name}/depth/compressed",
            room_from_sensor=self.mount.room_from_optical(),
            intrinsics=self.intrinsics(),
            baseline_m=self.baseline_m,
            mode=self.mode,
        )


_Noise = TypeVar("_Noise", bound=CameraNoise)


def _exposed(noise: _Noise, camera: PerspectiveDescription) -> _Noise:
    red, green, blue = (a * b for a, b in zip(noise.white_balance, camera.white_balance, strict=True))
    return noise.model_copy(
        update={"exposure_gain": noise.exposure_gain * camera.exposure, "white_balance": (red, green, blue)}
    )
