"""How people moved, tick by tick: kept once, it gives every later look at them the same bits as when they were stepped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.people.body.appearance import Appearance
from twin.people.gait.pose import Moment
from twin.people.poses import Poses
from twin.people.posture.measures import BodyMeasures


@dataclass(frozen=True, eq=False)
class Motion:
    """What a population's memory held at each tick t of n people, from the start on: see `posture.memory`."""

    floor: NDArray[np.complex128]  # (t, FLOOR_ROWS, n)
    rows: NDArray[np.float64]  # (t, ROWS, n)
    posture: NDArray[np.float64]  # (t, POSTURE_ROWS, n), most of it 0
    present: NDArray[np.bool_]  # (t, n)

    def save(self, path: Path) -> None:
        """Write it to a file (.npz); of the postures only what is not 0 to the bit."""
        bits = self.posture.view(np.int64) != 0
        np.savez(
            path, floor=self.floor, rows=self.rows, present=self.present, shape=self.posture.shape,
            which=np.packbits(bits), posture=self.posture[bits],
        )  # fmt: skip

    @classmethod
    def load(cls, path: Path) -> Motion:
        """The motion in a file that `save` has written, to the bit."""
        with np.load(path) as held:
            posture = np.zeros(held["shape"])
            posture[np.unpackbits(held["which"], count=posture.size).reshape(posture.shape).astype(bool)] = held[
                "posture"
            ]
            return cls(held["floor"], held["rows"], posture, held["present"])

    def same(self, other: Motion) -> bool:
        """Whether both are the same to the bit."""
        return all(getattr(self, each.name).tobytes() == getattr(other, each.name).tobytes() for each in fields(self))


class MovedBefore(Poses):
    """People who move as they did before, on the clock of whoever asks.

    Ticks come into the memory one by one as time goes on, as they did when the people were stepped: what lies between the
    last two ticks is then interpolated alike, whatever sensor asks in which order.
    """

    def __init__(
        self, names: Sequence[str], appearances: Mapping[str, Appearance], measures: BodyMeasures, motion: Motion
    ) -> None:
        super().__init__(names, appearances, measures)
        self._motion = motion
        self._step()

    def _step(self) -> None:
        tick = self._memory.tick + 1
        if tick >= len(self._motion.present):
            raise ValueError(
                f"the motion ends after {len(self._motion.present)} ticks; no later moment can be asked for"
            )
        motion = self._motion
        self._memory.remember(Moment(motion.floor[tick], motion.rows[tick]), motion.posture[tick], motion.present[tick])
