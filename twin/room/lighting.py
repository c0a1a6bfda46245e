"""The room's lamps: which of them a picture can show, the light that walls throw back, and how all change over time."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, inf, pi

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from twin.scenario.scenario import EVERY_LIGHT, LightChange

MOST_LAMPS = 8
"""That OpenGL's own lighting has; one more and its picture is black."""
_THROWN_BACK, _MOST_THROWN_BACK = 0.4, 0.3
"""Share that walls throw back of the lamps' light where no lamp of a room has ambient light that says it, and the most of it."""
_CEILING, _WINDOW = ((-0.2, 0.3, -0.9), 0.45), ((0.7, -0.5, -0.4), 0.3)
"""Direction and brightness of the lamps of a room without any."""

ENOUGH_LIGHT = 0.5
"""Light, as `light_of` has it, in which a picture shows what is in a room."""

DARK_LIGHT = 0.05
"""Light in which pictures are next to black."""


def light_room(spec: mujoco.MjSpec, source: str) -> None:
    """Light a room by its own lamps: what lights MuJoCo's viewer from the eye, the headlight, is no lamp of a room.

    A room without any gets two. Where no lamp has ambient light, the headlight is made light that is the same everywhere
    and from everywhere, as what walls throw back is about; it goes dark with the lamps. Raises InputError, naming `source`,
    for lamps that cannot be drawn, and for more than `MOST_LAMPS` lamps that shine, that light included.
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
    head.active = is_thrown_back or not shining  # without any lamp MuJoCo draws everything as if lit
    thrown_back = min(_THROWN_BACK * sum(float(np.max(lamp.diffuse)) for lamp in shining), _MOST_THROWN_BACK)
    head.ambient, head.diffuse, head.specular = [thrown_back] * 3, [0.0] * 3, [0.0] * 3
    if len(shining) + is_thrown_back > MOST_LAMPS:
        most = f"{MOST_LAMPS - 1}, or {MOST_LAMPS} of which one has ambient light," if is_thrown_back else MOST_LAMPS
        raise InputError(
            f"{source}: {len(shining)} <light> shine, more than a picture can show; at most {most} are expected, "
            'others switched off by active="false"'
        )


def light_of(model: mujoco.MjModel) -> float:
    """Sum the brightness of a model's lamps, those behind walls too; 1: as bright as lamps of a room are."""
    lamps = (model.light_diffuse + model.light_ambient).max(axis=1, initial=0.0)
    head = model.vis.headlight
    return float(lamps[model.light_active != 0].sum()) + (float(head.ambient.max()) if head.active else 0.0)


class Lighting:
    """Sets a model's lights to what a scenario's changes make of them at a time; a function of time alone.

    Diffuse, ambient and specular light are scaled alike. What walls throw back goes with the lamps, each by its share.
    Raises InputError naming `source` for a light that the room does not have.
    """

    def __init__(self, model: mujoco.MjModel, changes: Sequence[LightChange], source: str) -> None:
        self._model = model
        names = [model.light(light).name for light in range(model.nlight)]
        for place, change in enumerate(changes):
            if change.name != EVERY_LIGHT and change.name not in names:
                valid = ", ".join(sorted(each for each in names if each))
                raise InputError(
                    f"{source}: lights.{place}.name: the room has no light {change.name!r}; "
                    f"valid are {valid + ', ' if valid else ''}{EVERY_LIGHT}"
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
    """Return the brightness that one light's changes, in order of time, have led to at time t."""
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
