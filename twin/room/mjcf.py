"""A room's MJCF file as a static model, and its lamps; without settings of MuJoCo's viewer and engine.

Viewer (`visual`, `statistic`) and engine settings (`option`, `size`) and moving parts (joints, mocap, tendons, actuators,
keyframes) do not affect sensors: everything stands still as in the file, and is drawn with the twin's settings. Lamps are
those that images can show, with the light reflected by walls, and may change over time. `docs/mjcf.md` has the whole table.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import cos, inf, pi
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from trackers.errors import InputError, valid_names
from twin.geometry.geom_hull import FARTHEST_M
from twin.room.files import room_files
from twin.scenario.scenario import EVERY_LIGHT, LightChange

MOST_LAMPS = 8
"""Limit of OpenGL's own lighting; with one more, images are black."""
_THROWN_BACK, _MOST_THROWN_BACK = 0.4, 0.3
"""Reflected share of the lamps' light, if no lamp's ambient light states it, and its limit."""
_CEILING, _WINDOW = ((-0.2, 0.3, -0.9), 0.45), ((0.7, -0.5, -0.4), 0.3)
"""Direction and brightness of the lamps added to a room without any."""

ENOUGH_LIGHT = 0.5
"""Light, as computed by `light_of`, in which an image shows a room's content."""

DARK_LIGHT = 0.05
"""Light in which images are almost black."""


def light_room(spec: mujoco.MjSpec, source: str) -> None:
    """Light a room by its own lamps, without the headlight of MuJoCo's viewer.

    A room without lamps gets two. Where no lamp has ambient light, the headlight becomes uniform ambient light, an
    approximation of reflections by walls; it darkens with the lamps. Raises InputError, naming `source`, for lamps that
    cannot be drawn, and for more than `MOST_LAMPS` active lamps, this light included.
    """
    if not spec.lights:
        for direction, diffuse in (_CEILING, _WINDOW):
            spec.worldbody.add_light(
                type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
                pos=[0.0, 0.0, 2.0],
                dir=direction,
                diffuse=[diffuse] * 3,
                specular=[0.0] * 3,
            )
    for place, lamp in enumerate(spec.lights):
        if lamp.type not in (mujoco.mjtLightType.mjLIGHT_SPOT, mujoco.mjtLightType.mjLIGHT_DIRECTIONAL):
            kind = mujoco.mjtLightType(lamp.type).name.removeprefix("mjLIGHT_").lower()
            raise InputError(
                f"{source}: light {lamp.name or place!r} is of type {kind!r}, which MuJoCo draws as another; "
                "spot or directional is expected"
            )
    shining = [lamp for lamp in spec.lights if lamp.active and np.any([lamp.diffuse, lamp.ambient, lamp.specular])]
    for lamp in spec.lights:
        lamp.active = lamp in shining
    is_thrown_back = bool(shining) and not any(np.any(lamp.ambient) for lamp in shining)
    head = spec.visual.headlight
    head.active = is_thrown_back or not shining  # without any lamp MuJoCo draws everything fully lit
    thrown_back = min(_THROWN_BACK * sum(float(np.max(lamp.diffuse)) for lamp in shining), _MOST_THROWN_BACK)
    head.ambient, head.diffuse, head.specular = [thrown_back] * 3, [0.0] * 3, [0.0] * 3
    if len(shining) + is_thrown_back > MOST_LAMPS:
        most = f"{MOST_LAMPS - 1}, or {MOST_LAMPS} of which one has ambient light," if is_thrown_back else MOST_LAMPS
        raise InputError(
            f"{source}: {len(shining)} <light> shine, more than a picture can show; at most {most} are expected, "
            'others switched off by active="false"'
        )


def light_of(model: mujoco.MjModel) -> float:
    """Sum the brightness of a model's lamps, even behind walls; 1: typical brightness of a room."""
    lamps = (model.light_diffuse + model.light_ambient).max(axis=1, initial=0.0)
    head = model.vis.headlight
    return float(lamps[model.light_active != 0].sum()) + (float(head.ambient.max()) if head.active else 0.0)


class Lighting:
    """Lights of a model under a scenario's changes; a function of time alone.

    Diffuse, ambient and specular light are scaled alike. Reflected light follows each lamp by its share. Raises InputError
    naming `source` for a light that the room does not have.
    """

    def __init__(self, model: mujoco.MjModel, changes: Sequence[LightChange], source: str) -> None:
        self._model = model
        names = [model.light(light).name for light in range(model.nlight)]
        for place, change in enumerate(changes):
            if change.name != EVERY_LIGHT and change.name not in names:
                known = [*sorted(each for each in names if each), EVERY_LIGHT]
                also = " (every light)" + "; the others have no name in the room's file" * (not all(names))
                raise InputError(
                    f"{source}: lights.{place}.name: the room has no light {change.name!r}; "
                    f"{valid_names(change.name, known, also)}"
                )
        in_order = sorted(changes, key=lambda change: change.at_s)
        self._changes = [[change for change in in_order if change.name in (name, EVERY_LIGHT)] for name in names]
        brightness = model.light_diffuse.sum(axis=1) * (model.light_active != 0)
        self._shares = brightness / max(float(brightness.sum()), 1e-9)
        self._room = [array.copy() for array in self._of_lights()]
        self._head = [array.copy() for array in self._of_headlight()]
        self._is_changing = bool(changes)

    def apply(self, t: float, *, until_s: float = inf) -> None:
        """Light the room as at time t [s], by the changes that begin no later than `until_s`."""
        if not self._is_changing:
            return
        factors = self.factors(t, until_s=until_s)
        for array, own in zip(self._of_lights(), self._room, strict=True):
            array[:] = own * factors[:, None]
        for array, own in zip(self._of_headlight(), self._head, strict=True):
            array[:] = own * (self._shares @ factors)

    def factors(self, t: float, *, until_s: float = inf) -> NDArray[np.float64]:
        """Return the factors (n_light,) on the brightness of each light at time t [s]."""
        return np.array([_factor(changes, min(t, until_s), t) for changes in self._changes])

    def _of_lights(self) -> tuple[NDArray, ...]:
        return self._model.light_diffuse, self._model.light_ambient, self._model.light_specular

    def _of_headlight(self) -> tuple[NDArray, ...]:
        head = self._model.vis.headlight
        return head.diffuse, head.ambient, head.specular


def _factor(changes: Sequence[LightChange], started_by_s: float, t: float) -> float:
    """Return the brightness of one light at time t after its changes, which are in order of time."""
    factor, last = 1.0, None
    started = [change for change in changes if change.at_s <= started_by_s]
    for place, change in enumerate(started):
        until = started[place + 1].at_s if place + 1 < len(started) else t
        share = 1.0 if change.over_s == 0 else min(1.0, (until - change.at_s) / change.over_s)
        factor += share * (change.brightness - factor)
        last = change
    if last is None or last.flicker is None:
        return factor
    swing = (1 - cos(2 * pi * last.flicker.hz * (t - last.at_s))) / 2
    return factor * (1 - last.flicker.depth * swing)


NEAR_M = 0.02
"""Near plane of every camera [m]."""
_FAR_M = 20.0
"""Least far plane [m]. Farther ones are this times a power of `_STEP`, so that an added chair moves no plane."""
_STEP = 4.0
_EXTENT = 4.0
"""Distance of the far plane of a room, in extents: half the side of a directional lamp's shadow map."""
_SLICES, _STACKS, _QUADS = 20, 12, 1
"""Of round shapes, and of a flat one's side: lighting is per pixel, so one quad looks like many."""
_WITHOUT_EFFECT = (
    "keys", "sensors", "actuators", "equalities", "tendons", "pairs", "excludes", "tuples", "texts", "joints"
)  # fmt: skip
_NOT_SET = np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)
"""Colour of a geom for which MuJoCo draws its material's."""


def load_room(path: Path) -> mujoco.MjSpec:
    """Load the room of an MJCF file, static, with the twin's settings in place of the file's.

    Raises InputError for files that it may not read, for elements that are not modelled, and for invalid MJCF.
    """
    room_files(path)  # raises for forbidden files
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise InputError(f"{path}: is not a room ({what_is_wrong(error)}); a valid MJCF file is expected") from error
    _put_at_rest(spec)
    _set_settings(spec)
    light_room(spec, str(path))
    return spec


def compiled(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """Compile a room. Raises InputError naming its file where it does not compile."""
    try:
        model = spec.compile()
    except ValueError as error:
        raise InputError(f"{path}: does not compile ({what_is_wrong(error)}); a valid MJCF room is expected") from error
    _check_groups(model, path)
    _check_textures(model, path)
    _agree_where_hidden(model)
    return model


def _check_textures(model: mujoco.MjModel, path: Path) -> None:
    """Raise InputError for a texture that the renderer leaves out: of one channel, as of a file that it does not decode."""
    for place in np.flatnonzero(~np.isin(model.tex_nchannel, (3, 4)))[:1]:
        raise InputError(
            f"{path}: texture {model.tex(int(place)).name or int(place)!r} has {model.tex_nchannel[place]} channel, which "
            "is not drawn; a PNG image, and nchannel of 3 or 4, is expected"
        )


def what_is_wrong(error: Exception) -> str:
    """Return MuJoCo's message and, if given, the element and the line."""
    what, *where = [line.strip().rstrip(".") for line in str(error).strip().splitlines()]
    return ", ".join([what, *(line for line in where if line.startswith("Element"))])


def set_planes(
    spec: mujoco.MjSpec, room: mujoco.MjModel, data: mujoco.MjData, walkable: Array, places: Iterable[Array]
) -> None:
    """Set near and far plane of every camera, and the range of shadows, regardless of the file.

    The far plane is beyond everything in the room, from anywhere in it or from `places` (3,) [m] of cameras. Shadows are
    drawn around `walkable` (k, 2) [m]. `data`, of the compiled `room`, needs kinematics.
    """
    is_plane = room.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    half_m = np.hypot(room.geom_size[:, 0], room.geom_size[:, 1])
    half_m[(room.geom_size[:, :2] == 0).any(axis=1)] = FARTHEST_M  # infinite planes
    reach_m = np.linalg.norm(data.geom_xpos, axis=1) + np.where(is_plane, half_m, room.geom_rbound)
    room_m = min(float(reach_m.max(initial=0.0)), FARTHEST_M)
    farthest_m = max([room_m, *(float(np.linalg.norm(place)) for place in places)])
    people_m = float(np.linalg.norm(walkable - walkable.mean(axis=0), axis=1).max())
    extent_m = _stepped(people_m, _FAR_M / _EXTENT)
    spec.stat.extent = extent_m
    spec.stat.center = [*walkable.mean(axis=0), 0.0]
    spec.visual.map.znear = NEAR_M / extent_m
    spec.visual.map.zfar = _stepped(room_m + farthest_m, _FAR_M) / extent_m


def _stepped(length_m: float, least_m: float) -> float:
    """Return the least of `least_m` times a power of `_STEP` that is at least as long [m]."""
    while least_m < length_m:
        least_m *= _STEP
    return least_m


def _put_at_rest(spec: mujoco.MjSpec) -> None:
    """Remove moving and measuring elements, so that all bodies stand still as in the file."""
    for kind in _WITHOUT_EFFECT:
        for element in list(getattr(spec, kind)):
            spec.delete(element)
    for body in spec.bodies:
        body.mocap, body.sleep = False, mujoco.mjtSleepPolicy.mjSLEEP_AUTO


def _set_settings(spec: mujoco.MjSpec) -> None:
    """Set MuJoCo's default settings of viewer, engine and compiler.

    Kept are those of the compiler that determine how the file is read: angles, folders.
    """
    fresh = mujoco.MjSpec()
    spec.visual, spec.option, spec.stat = fresh.visual, fresh.option, fresh.stat
    quality = spec.visual.quality
    quality.numslices, quality.numstacks, quality.numquads = _SLICES, _STACKS, _QUADS
    for name in ("memory", "njmax", "nconmax", "nstack", "nuserdata", "nkey"):
        setattr(spec, name, getattr(fresh, name))
    for name in (each for each in dir(spec) if each.startswith("nuser_")):
        setattr(spec, name, getattr(fresh, name))
    for name in (
        "fusestatic", "discardvisual", "passthrough", "conflict", "alignfree", "balanceinertia", "boundinertia",
        "boundmass", "settotalmass", "inertiafromgeom", "inertiagrouprange", "fitaabb",
    ):  # fmt: skip
        setattr(spec.compiler, name, getattr(fresh.compiler, name))
    for texture in spec.textures:
        texture.embed = mujoco.MjSpec().add_texture().embed


def _check_groups(model: mujoco.MjModel, path: Path) -> None:
    """Raise InputError for a geom in a group that MuJoCo cannot distinguish."""
    for geom in np.flatnonzero((model.geom_group < 0) | (model.geom_group >= mujoco.mjNGROUP))[:1].tolist():
        name = model.geom(geom).name or f"geom {geom}"
        raise InputError(
            f"{path}: geom {name!r} is in group {model.geom_group[geom]}; a group from 0 to {mujoco.mjNGROUP - 1} is expected "
            "(0 to 2: every sensor sees it, 3: rays alone, 4: cameras alone, 5: none)"
        )


def _agree_where_hidden(model: mujoco.MjModel) -> None:
    """Make rays ignore exactly the geoms that are not drawn, by the alpha of each geom's own colour.

    MuJoCo draws a geom in its own colour, or else in its material's; its rays use the material's alone.
    """
    with_material = model.geom_matid >= 0
    of_material = model.mat_rgba[model.geom_matid, 3] if model.nmat else np.ones(model.ngeom)
    has_own = (model.geom_rgba != _NOT_SET).any(axis=1)
    alpha = np.where(with_material & ~has_own, of_material, model.geom_rgba[:, 3])
    model.geom_rgba[alpha == 0, 3] = 0
    model.geom_matid[with_material & ((alpha == 0) | (of_material == 0))] = -1
