"""What faults do to the messages of a sensor: lost on the way, late, or stamped by a clock that is off."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from trackers.observations import NS_PER_S
from twin.sensors.fault_kinds import Clock, Delay, Dropout, Fault
from twin.streams import stream

_PPM = 1e-6


class MessageFaultsOf:
    """The faults of one sensor that its schedule knows of, by name; everything is asked by the true stamp [ns].

    What is drawn is drawn for each stamp from a stream of its own: no fault changes another's draws, and moving the ends of
    one changes nothing in what is left of it.
    """

    def __init__(self, sensor: str, faults: Mapping[str, Fault], seed: int) -> None:
        self._sensor, self._seed = sensor, seed
        own = {name: fault for name, fault in faults.items() if sensor in fault.sensor}
        self._dropouts = {name: fault for name, fault in own.items() if isinstance(fault, Dropout)}
        self._delays = {name: fault for name, fault in own.items() if isinstance(fault, Delay)}
        self._clocks = [fault for fault in own.values() if isinstance(fault, Clock)]
        silences = [fault for fault in self._dropouts.values() if fault.to_s is None and fault.probability == 1]
        self._silent_from_ns = min((fault.from_ns for fault in silences), default=None)

    def lost(self, stamp_ns: int) -> bool:
        """Whether the observation is lost on its way."""
        return any(
            fault.holds(stamp_ns) and self._moment(name, stamp_ns).random() < fault.probability
            for name, fault in self._dropouts.items()
        )

    def mute(self, stamp_ns: int) -> bool:
        """Whether every observation of this time is lost."""
        return any(fault.probability == 1 and fault.holds(stamp_ns) for fault in self._dropouts.values())

    def silent(self, stamp_ns: int) -> bool:
        """Whether nothing arrives from here on, so that nothing need be measured."""
        return self._silent_from_ns is not None and stamp_ns >= self._silent_from_ns

    def late_ns(self, stamp_ns: int) -> int:
        """How much later than without faults the observation arrives [ns]."""
        late_s = 0.0
        for name, fault in self._delays.items():
            if fault.holds(stamp_ns):
                late_s += fault.delay_s + fault.jitter_s * self._moment(name, stamp_ns).random()
        return round(late_s * NS_PER_S)

    def said_ns(self, stamp_ns: int) -> int:
        """What the message gives as the stamp [ns]; below 0 for a clock that is behind the start."""
        said_ns = stamp_ns
        for fault in self._clocks:
            if fault.holds(stamp_ns):
                gained_ns = fault.drift_ppm * _PPM * (stamp_ns - fault.from_ns)
                said_ns += round(fault.offset_s * NS_PER_S + gained_ns)
        return said_ns

    def _moment(self, fault: str, stamp_ns: int) -> np.random.Generator:
        return stream(self._seed, "fault", f"{fault}/{self._sensor}/{stamp_ns}")
