"""A sheet of pictures of people: each from the front, the side, behind and high up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from twin.people.body.appearance import Appearance
from twin.people.body.body import NQ_PERSON, person_spec
from twin.recording.atomic_file import atomic_path
from twin.report.lettering import write
from twin.report.look_at import picture
from twin.report.palette import RGB
from twin.sensors.render import OffscreenRenderer

VIEWS = {"front": (0.0, 0.35), "side": (90.0, 0.35), "back": (180.0, 0.35), "high": (35.0, 2.0)}
"""Where each picture is taken from: degrees left of where the person faces, metres above the head's half height."""

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
class Figure:
    """One row of the sheet: looks, and joint coordinates (NQ_PERSON,) near the origin; None stands straight, facing +x."""

    label: str
    appearance: Appearance
    coordinates: NDArray[np.float64] | None = None

    def standing(self) -> NDArray[np.float64]:
        """The coordinates, those of standing straight where none are given."""
        if self.coordinates is not None:
            return self.coordinates
        straight = np.zeros(NQ_PERSON)
        straight[2], straight[3] = self.appearance.proportions.hip_height, 1.0
        return straight


def write_sheet(
    path: Path, figures: Sequence[Figure], *, columns: int = 2, cell_px: tuple[int, int] = (150, 250)
) -> None:
    """Write a PNG of every figure in every one of `VIEWS`, each figure's pictures side by side under its label.

    `columns`: figures side by side; `cell_px`: breadth and height of one picture. Raises InputError where nobody is
    given, the name is not a picture's, the file cannot be written, or there is no EGL.
    """
    check_picture_name(path)
    if not figures:
        raise InputError(f"{path}: nobody to draw; at least one person is expected")
    write_png(path, drawn_sheet(figures, columns=columns, cell_px=cell_px))


def drawn_sheet(figures: Sequence[Figure], *, columns: int, cell_px: tuple[int, int]) -> NDArray[np.uint8]:
    """The picture that `write_sheet` writes, RGB (height, width, 3), of one figure or more."""
    model = _studio(figures)
    data = mujoco.MjData(model)
    with OffscreenRenderer(model) as renderer:
        panels = [_panel(renderer, model, data, figures, place, cell_px) for place in range(len(figures))]
    return tiled(panels, columns)


def tiled(panels: Sequence[NDArray[np.uint8]], columns: int, blank_rgb: RGB = (255, 255, 255)) -> NDArray[np.uint8]:
    """Panels of one size (height, width, 3) in rows of `columns`, the last row filled up with a colour."""
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
    with atomic_path(path) as partial:
        partial.write_bytes(png.tobytes())


def _studio(figures: Sequence[Figure]) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(_STUDIO)
    for number, figure in enumerate(figures):
        spec.attach(person_spec(figure.appearance), prefix=f"{number}/", frame=spec.worldbody.add_frame())
    return spec.compile()


def _panel(
    renderer: OffscreenRenderer,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    figures: Sequence[Figure],
    place: int,
    cell_px: tuple[int, int],
) -> NDArray[np.uint8]:
    """One figure in every view, alone in the studio, its label above."""
    figure = figures[place]
    coordinates = data.qpos.reshape(len(figures), NQ_PERSON)
    coordinates[:] = 0.0
    coordinates[:, 2], coordinates[:, 3] = _AWAY_M, 1.0
    coordinates[place] = figure.standing()
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    width, height = cell_px
    pelvis = coordinates[place, :3]
    w, x, y, z = coordinates[place, 3:7]
    heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    middle = np.array([pelvis[0], pelvis[1], 0.5 * figure.appearance.height_m])
    pictures = []
    for turn_deg, up in VIEWS.values():
        angle = heading + np.deg2rad(turn_deg)
        eye = middle + _FAR_M * np.array([np.cos(angle), np.sin(angle), 0.0]) + np.array([0.0, 0.0, up])
        tall = 0.62 * max(figure.appearance.height_m, 1.2) / _FAR_M
        pictures.append(picture(renderer, data, eye, middle, tall, (width, height), finer=_FINER))
    return np.vstack([lettered(figure.label, width * len(pictures)), np.hstack(pictures)])


def lettered(label: str, width: int) -> NDArray[np.uint8]:
    """A strip of `width` [px] that holds a label."""
    strip = np.full((_LINE_PX, width, 3), 250, dtype=np.uint8)
    write(strip, label, 4, _LINE_PX - 5, _INK, _LETTERS_PX)
    return strip
