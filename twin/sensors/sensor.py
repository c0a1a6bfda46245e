"""What makes something a sensor, and the layer that adds noise to one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from trackers.observations import Observation
from trackers.rig import RigSensor
from twin.instant.snapshot import Snapshot

State = Any
"""What a sensor carries from one observation to the next; its own business. None before the first."""


@dataclass(frozen=True, eq=False)
class Reading:
    """One observation, and what only the twin knows about it (never shown to a tracker).

    A scanner's truth holds `person_of_ray` (n_beam,) int16: the id of the person whom the ideal ray meets within range,
    0 for the room or nothing, and `range_m` (n_beam,) float32: the ideal ranges. What a floor's holds stands at
    `twin.sensors.floor.Floor`.
    """

    observation: Observation
    truth: dict[str, NDArray] = field(default_factory=dict)


@runtime_checkable
class Sensor(Protocol):
    """A sensor looks at the world at declared instants and reports one reading; it knows no clock and no delay."""

    @property
    def name(self) -> str:
        """Name on the rig."""
        ...

    @property
    def instants_s(self) -> tuple[float, ...]:
        """When it looks, as offsets from the stamp [s], ascending from 0 or later: one, or many over a sweep."""
        ...

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """The reading stamped `stamp_ns`, from one snapshot for each instant, in order; and the state after it.

        Each snapshot is used up before the next is taken. All randomness comes from `rng`. The arrays of a reading are
        its own: a later observation does not change them.
        """
        ...

    def rig_sensor(self) -> RigSensor:
        """What a tracker is told of this sensor."""
        ...


class Noise(Protocol):
    """Turns the ideal observation into one that a real device might have made."""

    def corrupt(self, observation: Any, state: State, rng: np.random.Generator) -> tuple[Observation, State]:
        """The noisy observation (the ideal one stays untouched), and the noise's state after it (None at first)."""
        ...
