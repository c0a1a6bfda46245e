"""The room's lamps: those that images can show, the light reflected by walls, and changes over time."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, inf, pi

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
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
