"""The room's lights as they change over time."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, inf, pi

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from twin.scenario.lights import EVERY_LIGHT, LightChange


class Lighting:
    """Sets a model's lights to what a scenario's changes make of them at a time; a function of time alone.

    Diffuse, ambient and specular light are scaled alike; a headlight, if the room has one on, goes with 'all'.
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
        self._changes = [
            [change for change in in_order if change.name in (name, EVERY_LIGHT)] for name in [*names, EVERY_LIGHT]
        ]
        self._room = [array.copy() for array in self._of_lights()]
        self._head = [array.copy() for array in self._of_headlight()]
        self._is_changing = bool(changes)

    def apply(self, t: float, *, until_s: float = inf) -> None:
        """Light the room as at time t [s], by the changes that begin no later than `until_s`."""
        if not self._is_changing:
            return
        factors = self.factors(t, until_s=until_s)
        for array, own in zip(self._of_lights(), self._room, strict=True):
            array[:] = own * factors[:-1, None]
        for array, own in zip(self._of_headlight(), self._head, strict=True):
            array[:] = own * factors[-1]

    def factors(self, t: float, *, until_s: float = inf) -> NDArray[np.float64]:
        """What each light's brightness is multiplied by at time t [s], and last the headlight's, (n_light + 1,)."""
        return np.array([_factor(changes, min(t, until_s), t) for changes in self._changes])

    def _of_lights(self) -> tuple[NDArray, ...]:
        return self._model.light_diffuse, self._model.light_ambient, self._model.light_specular

    def _of_headlight(self) -> tuple[NDArray, ...]:
        head = self._model.vis.headlight
        return head.diffuse, head.ambient, head.specular


def _factor(changes: Sequence[LightChange], begun_by_s: float, t: float) -> float:
    """The brightness that one light's changes, in order of time, have led to at time t."""
    factor, last = 1.0, None
    begun = [change for change in changes if change.at_s <= begun_by_s]
    for place, change in enumerate(begun):
        until = begun[place + 1].at_s if place + 1 < len(begun) else t
        share = 1.0 if change.over_s == 0 else min(1.0, (until - change.at_s) / change.over_s)
        factor += share * (change.brightness - factor)
        last = change
    if last is None or last.flicker is None:
        return factor
    swing = (1 - cos(2 * pi * last.flicker.hz * (t - last.at_s))) / 2
    return factor * (1 - last.flicker.depth * swing)
