"""Pictures of a scene from any viewpoint, and portraits of people from the front, the side, behind and above."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from trackers.errors import InputError
from twin.people.body.appearance import BodyAppearance
from twin.people.body.person_spec import NQ_PERSON, person_spec
from twin.recording.atomic_file import write_atomic
from twin.report.palette import RGB, write
from twin.room.mjcf import ENOUGH_LIGHT, MOST_LAMPS, light_of
from twin.sensors.render import OffscreenRenderer
from twin.sensors.render_scene import Mark, RenderView

DARK_NOTE = ", dark: lit for this view"
"""Note on a picture of a room with less light than `ENOUGH_LIGHT`."""


@dataclass(frozen=True, eq=False)
class Standpoint:
    """A camera: `eye` and `target` (3,) in the room frame [m], and the tangent of half its vertical field."""

    eye: Array
    target: Array
    half_height: float


def axes_towards(eye_m: Array, target_m: Array) -> tuple[Array, Array, Array]:
    """Compute unit vectors right, up and forward (3,) of an upright camera at `eye_m` (3,) that looks at `target_m`
    (3,) [m].
    """
    forward = (target_m - eye_m) / np.linalg.norm(target_m - eye_m)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return right, np.cross(right, forward), forward


@contextmanager
def fill_light(model: mujoco.MjModel) -> Iterator[None]:
    """Light a model from the eye during the block, as far as its lamps fall short of `ENOUGH_LIGHT`."""
    head, missing = model.vis.headlight, ENOUGH_LIGHT - light_of(model)
    if missing <= 0:
        yield
        return
    own = head.active, head.ambient.copy(), head.diffuse.copy(), model.light_active.copy()
    head.active = True
    head.ambient[:] += missing
    head.diffuse[:] += 0.5 * missing
    if np.count_nonzero(model.light_active) >= MOST_LAMPS:  # no slot for one more
        model.light_active[:] = False
    try:
        yield
    finally:
        head.active, head.ambient[:], head.diffuse[:], model.light_active[:] = own


def render_picture(
    renderer: OffscreenRenderer,
    data: mujoco.MjData,
    stand: Standpoint,
    size_px: tuple[int, int],
    *,
    finer: int = 1,
    marks: Sequence[Mark] = (),
) -> NDArray[np.uint8]:
    """Render the scene from a standpoint that looks not straight up or down: RGB (height, width, 3).

    `size_px`: width and height; `finer`: factor of supersampling, which smooths edges. `data` needs kinematics and light
    poses. A dark room is lit from the eye, unlike for sensors.
    """
    _, up, forward = axes_towards(stand.eye, stand.target)
    width, height = finer * size_px[0], finer * size_px[1]
    half_height, half_width = stand.half_height, stand.half_height * width / height
    pixels = np.zeros((height, width, 4), dtype=np.uint8)
    view = RenderView(
        (float(forward[0]), float(forward[1]), float(forward[2])),
        (float(up[0]), float(up[1]), float(up[2])),
        -half_width, half_width, -half_height, half_height, (0, 0, width, height),
    )  # fmt: skip
    with fill_light(renderer.model):
        renderer.render(data, stand.eye, [view], pixels, marks)
    upright = np.ascontiguousarray(pixels[::-1, :, :3])
    return upright if finer == 1 else np.asarray(cv2.resize(upright, size_px, interpolation=cv2.INTER_AREA), np.uint8)


VIEWS = {"front": (0.0, 0.35), "side": (90.0, 0.35), "back": (180.0, 0.35), "high": (35.0, 2.0)}
"""Viewpoints: degrees left of the person's heading, metres above half the person's height."""

_STUDIO = """
<mujoco model="studio">
  <statistic center="0 0 1" extent="5"/>
  <visual>
    <headlight active="0"/>
    <quality offsamples="0" numslices="20" numstacks="12" numquads="6"/>
    <map znear="0.01" zfar="40"/>
  </visual>
  <asset>
    <texture name="sky" type="skybox" builtin="flat" rgb1="0.82 0.85 0.87" width="8" height="48"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1="0.70 0.70 0.68" rgb2="0.64 0.64 0.62" width="64" height="64"/>
    <material name="tiles" texture="tiles" texrepeat="10 10" specular="0" shininess="0"/>
  </asset>
  <worldbody>
    <light type="directional" dir="-0.5 0.4 -0.75" diffuse="0.50 0.50 0.49" ambient="0.48 0.48 0.49" specular="0 0 0"
           castshadow="false"/>
    <light type="directional" dir="0.7 -0.5 -0.3" diffuse="0.26 0.26 0.27" specular="0 0 0" castshadow="false"/>
    <light type="directional" dir="0.2 0.8 0.2" diffuse="0.12 0.12 0.12" specular="0 0 0" castshadow="false"/>
    <geom type="plane" size="5 5 1" material="tiles" contype="0" conaffinity="0"/>
  </worldbody>
</mujoco>
"""
_AWAY_M = -50.0
_FAR_M = 4.0
_LINE_PX, _LETTERS_PX = 18, 13
_FINER = 2
_INK = (40, 44, 48)


@dataclass(frozen=True, eq=False)
class Portrait:
    """Person to draw: label, appearance, and joint coordinates (NQ_PERSON,) near the origin; None: standing straight, facing
    +x.
    """

    label: str
    appearance: BodyAppearance
    coordinates: NDArray[np.float64] | None = None

    def pose(self) -> NDArray[np.float64]:
        """Return the joint coordinates, by default those of standing straight."""
        if self.coordinates is not None:
            return self.coordinates
        straight = np.zeros(NQ_PERSON)
        straight[2], straight[3] = self.appearance.proportions.hip_height, 1.0
        return straight


def draw_portraits(portraits: Sequence[Portrait], *, columns: int, cell_px: tuple[int, int]) -> NDArray[np.uint8]:
    """Draw each person in all `VIEWS`, side by side under the label: RGB (height, width, 3).

    `columns`: people side by side; `cell_px`: width and height of one picture. Raises InputError without EGL.
    """
    model = _studio(portraits)
    data = mujoco.MjData(model)
    with OffscreenRenderer(model) as renderer:
        panels = [_panel(renderer, model, data, portraits, place, cell_px) for place in range(len(portraits))]
    return tile_pictures(panels, columns)


def tile_pictures(
    panels: Sequence[NDArray[np.uint8]], columns: int, blank_rgb: RGB = (255, 255, 255)
) -> NDArray[np.uint8]:
    """Arrange pictures of one size (height, width, 3) in rows of `columns`; fill up the last row with a colour."""
    blank = np.broadcast_to(np.array(blank_rgb, dtype=np.uint8), panels[0].shape)
    whole = [*panels, *[blank] * (-len(panels) % columns)]
    return np.vstack([np.hstack(whole[start : start + columns]) for start in range(0, len(whole), columns)])


def check_picture_name(path: Path) -> None:
    """Raise InputError unless the name is that of a PNG."""
    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: is not the name of a picture; a name ending in .png is expected")


def write_png(path: Path, rgb: NDArray[np.uint8]) -> None:
    """Write a picture (height, width, 3), RGB; raises InputError where the file cannot be written."""
    _, png = cv2.imencode(".png", rgb[..., ::-1])
    write_atomic(path, png.tobytes())


def _studio(portraits: Sequence[Portrait]) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(_STUDIO)
    for number, portrait in enumerate(portraits):
        spec.attach(person_spec(portrait.appearance), prefix=f"{number}/", frame=spec.worldbody.add_frame())
    return spec.compile()


def _panel(
    renderer: OffscreenRenderer,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    portraits: Sequence[Portrait],
    place: int,
    cell_px: tuple[int, int],
) -> NDArray[np.uint8]:
    """Draw one portrait in every view, alone in the studio, its label above."""
    portrait = portraits[place]
    coordinates = data.qpos.reshape(len(portraits), NQ_PERSON)
    coordinates[:] = 0.0
    coordinates[:, 2], coordinates[:, 3] = _AWAY_M, 1.0
    coordinates[place] = portrait.pose()
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    pelvis = coordinates[place, :3]
    w, x, y, z = coordinates[place, 3:7]
    heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    middle = np.array([pelvis[0], pelvis[1], 0.5 * portrait.appearance.height_m])
    pictures = []
    for turn_deg, up in VIEWS.values():
        angle = heading + np.deg2rad(turn_deg)
        eye = middle + _FAR_M * np.array([np.cos(angle), np.sin(angle), 0.0]) + np.array([0.0, 0.0, up])
        tall = 0.62 * max(portrait.appearance.height_m, 1.2) / _FAR_M
        pictures.append(render_picture(renderer, data, Standpoint(eye, middle, tall), cell_px, finer=_FINER))
    return np.vstack([label_strip(portrait.label, cell_px[0] * len(pictures)), np.hstack(pictures)])


def label_strip(label: str, width: int) -> NDArray[np.uint8]:
    """Draw a strip of `width` [px] with a label."""
    strip = np.full((_LINE_PX, width, 3), 250, dtype=np.uint8)
    write(strip, label, 4, _LINE_PX - 5, _INK, _LETTERS_PX)
    return strip
