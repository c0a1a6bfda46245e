"""Contracts of a sensor and of a layer of noise."""

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
"""State of a sensor between observations, private to it; None before the first."""


@dataclass(frozen=True, eq=False)
class Reading:
    """Observation and its truth, which is never given to a tracker.

    A scanner's truth holds `person_of_ray` (n_beam,) int16: id of the person met by the ideal ray within range, 0 for the
    room or nothing, and `range_m` (n_beam,) float32: the ideal ranges. A floor's truth: see `twin.sensors.floor.Floor`.
    """

    observation: Observation  # what a tracker is given
    truth: dict[str, NDArray] = field(default_factory=dict)  # arrays by name


@runtime_checkable
class Sensor(Protocol):
    """A sensor observes the world at declared instants and reports one reading; it has no clock and no delay."""

    @property
    def name(self) -> str:
        """Name on the rig."""
        ...

    @property
    def instants_s(self) -> tuple[float, ...]:
        """Instants of an observation, as offsets from the stamp [s], ascending from 0 or later: one, or many over a sweep."""
        ...

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """Return the reading stamped `stamp_ns`, from one snapshot per instant, in order; and the new state.

        Each snapshot is used up before the next is taken. All randomness comes from `rng`. The arrays of a reading are its
        own: later observations do not change them.
        """
        ...

    def rig_sensor(self) -> RigSensor:
        """Return the tracker's view of this sensor."""
        ...


class Noise(Protocol):
    """Layer that turns the ideal observation into a real device's."""

    def corrupt(self, observation: Any, state: State, rng: np.random.Generator) -> tuple[Observation, State]:
        """Return the noisy observation (the ideal one stays untouched), and the noise's state after it (None at first)."""
        ...
