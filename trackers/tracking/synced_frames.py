"""Synchronized frames: near-simultaneous observations of several sensors, gathered by a declared policy.

A tracker declares (`SyncPolicy`) which sensors trigger a frame, which are attached to the nearest one, of which the latest
value is used, and which are awaited for how long. Two scanners and a camera: the scanners trigger, the camera is attached.
Cameras and a slower pressure floor: the cameras trigger, with the floor's latest value. Cameras alone, or a floor alone:
they trigger. Scanners and cameras that trigger in turn, each picture at its own stamp: all trigger, the scanners are `joined`.

A frame is complete when every awaited sensor has reported, or when an observation at least `max_wait_s` newer has arrived;
frames leave in order of time. So a silent sensor delays a tracker by little more than `max_wait_s`. A sensor that keeps arriving
after newer observations of others, since it is slow or another clock is ahead, is waited for by as much longer. What arrives too
late (its frame has left) or twice is dropped and counted, as are repetitions (`StaleFrameDetector`), whose frame
leaves nevertheless, unless the sensor is not yet due for a new reading: a driver may publish each scan twice.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field
from statistics import median_low

from trackers.arrival_order import LATE, TWICE, ArrivalLags
from trackers.observations import NS_PER_S, Observation
from trackers.tracking.missing_frames import GAPS, StaleFrameDetector

_DUE = 0.75
"""Share of a sensor's period after which a new reading is due."""

ALONE = "without another sensor's observation near enough in time"
BLANK = "without any reading: no beam of the scan returns, or it has none"
REPEATED = "bit for bit the same as the one before: the sensor or its driver hangs"
"""Reasons for dropping observations, besides those of `trackers.arrival_order`."""


@dataclass(frozen=True)
class SyncPolicy:
    """Policy by which observations become synchronized frames; other sensors are ignored.

    triggers: sensors whose observations start a frame, or join one of each other's. attached: those that join the nearest
    frame and never start one. latest: those whose newest value not after the frame is used, repeatedly if they are slower.
    main: the sensor whose stamp a frame takes, else that of the first of `triggers` in it (None: that one). awaited: the
    sensors waited for (None: all of `triggers` and `attached`); one of `latest` is awaited until its value is of the frame
    or newer. joined: sensors whose observations join one frame up to half of `period_s` apart, or half of the observed period
    of the fastest of them if shorter; others join frames of their own stamp alone (None: all but `latest`).

    Raises ValueError without triggers, for a sensor named twice, and for an unnamed main or awaited one.
    """

    triggers: tuple[str, ...]  # start a frame
    attached: tuple[str, ...] = ()  # join the nearest one
    latest: tuple[str, ...] = ()  # used with their newest value
    main: str | None = None  # whose stamp a frame takes
    awaited: tuple[str, ...] | None = None  # waited for
    period_s: float = 0.1  # of frames [s]
    joined: tuple[str, ...] | None = None  # may differ from their frame by half a period
    max_wait_s: float = 0.15  # for a sensor that is awaited, unless it keeps reporting later [s]

    def __post_init__(self) -> None:
        named = (*self.triggers, *self.attached, *self.latest)
        if not self.triggers:
            raise ValueError("no sensor triggers a frame; at least one in 'triggers' is needed")
        if len(set(named)) < len(named):
            raise ValueError(f"a sensor stands twice among {', '.join(named)}; each has one part")
        if self.main is not None and self.main not in (*self.triggers, *self.attached):
            raise ValueError(f"main is {self.main!r}, which is neither in 'triggers' nor in 'attached'")
        if unknown := set(self.awaited or ()) - set(named):
            raise ValueError(f"awaited are {', '.join(sorted(unknown))}, in none of 'triggers', 'attached', 'latest'")


@dataclass
class SyncedFrame:
    """Observations of one frame, by sensor, each with its own stamp.

    ns: its stamp [ns], see `SyncPolicy.main`. latest: the newest values not after it of the policy's `latest`, with their
    own stamps. repeated: sensors whose reports were stale or blank.
    """

    ns: int  # its stamp [ns]
    observations: dict[str, Observation] = field(default_factory=dict)  # by sensor
    latest: dict[str, Observation] = field(default_factory=dict)  # newest values by sensor
    repeated: frozenset[str] = frozenset()  # sensors that were stale or blank

    @property
    def t(self) -> float:
        """Its stamp [s]."""
        return self.ns / NS_PER_S


class FrameSynchronizer:
    """Synchronizer from observations in order of arrival to frames in order of time.

    Stamps are on one clock: the decoder of messages adds the rig's time offsets.
    """

    def __init__(self, rules: SyncPolicy) -> None:
        self._rules = rules
        self._awaited = (*rules.triggers, *rules.attached) if rules.awaited is None else rules.awaited
        self._stamped_by = rules.triggers if rules.main is None else (rules.main, *rules.triggers)
        self._max_wait_ns = round(rules.max_wait_s * NS_PER_S)
        self._within_ns = round(0.5 * rules.period_s * NS_PER_S)
        self._joined = {*rules.triggers, *rules.attached} if rules.joined is None else set(rules.joined)
        self._last_ns: dict[str, int] = {}
        self._gaps_ns: dict[str, deque[int]] = {name: deque(maxlen=GAPS) for name in rules.triggers}
        self._pending: list[SyncedFrame] = []
        self._waiting: list[Observation] = []  # those to attach, without a frame yet
        self._lags, self._named = ArrivalLags(), {*rules.triggers, *rules.attached, *rules.latest}
        self._latest: dict[str, list[Observation]] = {name: [] for name in rules.latest}  # by stamp
        self._left: SyncedFrame | None = None
        self._repeats = StaleFrameDetector()
        self._read_ns: dict[str, int] = {}  # stamp of each sensor's last reading that was no repetition
        self._renewed_ns: dict[str, deque[int]] = {}  # its last gaps between such readings
        self.losses: Counter[tuple[str, str]] = Counter()
        """Dropped observations, by sensor and reason: too late, twice, no frame to join, or a repetition."""

    @property
    def discarded(self) -> int:
        """Number of dropped observations."""
        return self.losses.total()

    def add(self, observation: Observation) -> list[SyncedFrame]:
        """Add an observation; return the frames now complete, oldest first."""
        rules, sensor, ns = self._rules, observation.sensor, observation.stamp_ns
        if sensor in self._named:
            self._lags.add(sensor, ns)
        if sensor in rules.latest:
            self._hold(observation)
        elif sensor not in rules.triggers and sensor not in rules.attached:
            return []
        elif self._has(sensor, ns):
            self.losses[sensor, TWICE] += 1
            return []
        elif self._came_too_late(sensor, ns):
            again = self._left is not None and (left := self._left.observations.get(sensor)) and left.stamp_ns == ns
            self.losses[sensor, TWICE if again else LATE] += 1
            return []
        elif sensor in rules.triggers:
            self._learn_period(sensor, ns)
            self._put(self._nearest(ns, without=sensor) or self._started(observation), observation)
        else:
            self._waiting.append(observation)
        self._join()
        return self._ready(ns)

    def finish(self) -> list[SyncedFrame]:
        """Return the waiting frames, oldest first; observations without a frame are dropped."""
        frames = self._ready(max((frame.ns for frame in self._pending), default=0) + self._wait_ns())
        self._lose_alone(self._waiting)
        self._waiting = []
        return frames

    def waiting_ns(self, sensor: str) -> list[int]:
        """Return the stamps of a sensor's observations in frames that have not left yet [ns], oldest first."""
        return [each.observations[sensor].stamp_ns for each in self._pending if sensor in each.observations]

    def _learn_period(self, sensor: str, ns: int) -> None:
        """Update the period of frames [s], shorter than declared if sensors report faster."""
        if sensor not in self._joined:
            return
        gap_ns = ns - self._last_ns.get(sensor, ns)
        self._last_ns[sensor] = ns
        if gap_ns > 0:
            self._gaps_ns[sensor].append(gap_ns)
            seen_ns = (median_low(gaps) for gaps in self._gaps_ns.values() if gaps)
            self._within_ns = min(round(self._rules.period_s * NS_PER_S), *seen_ns) // 2

    def _came_too_late(self, sensor: str, ns: int) -> bool:
        left = self._left
        if left is None:
            return False
        # or its frame has left without it
        lacks = sensor not in {*left.observations, *left.repeated}
        return ns <= left.ns or (lacks and ns - left.ns <= self._reach_ns(sensor, left))

    def _has(self, sensor: str, ns: int) -> bool:
        """Return whether an observation of that sensor and stamp is already waiting."""
        waiting = [frame.observations[sensor] for frame in self._pending if sensor in frame.observations]
        waiting += [other for other in self._waiting if other.sensor == sensor]
        return any(other.stamp_ns == ns for other in waiting)

    def _nearest(self, ns: int, without: str) -> SyncedFrame | None:
        """Return the pending frame nearest to `ns`, near enough to join, without an observation of the sensor."""
        near = [
            (abs(frame.ns - ns), frame.ns, place)
            for place, frame in enumerate(self._pending)
            if without not in frame.observations and abs(frame.ns - ns) <= self._reach_ns(without, frame)
        ]
        return self._pending[min(near)[2]] if near else None

    def _reach_ns(self, sensor: str, frame: SyncedFrame) -> int:
        """Return how far from a frame an observation of the sensor may be to join it [ns]."""
        return self._within_ns if {sensor, *frame.observations, *frame.repeated} <= self._joined else 0

    def _started(self, by: Observation) -> SyncedFrame:
        """Start a frame; move to it the observations of another frame that are nearer to it.

        Before a sensor's period is known, or if one reports late, an earlier frame may hold them.
        """
        opened, ns = SyncedFrame(by.stamp_ns), by.stamp_ns
        for other in self._pending:
            for sensor, each in list(other.observations.items()):
                beside = [abs(each.stamp_ns - it.stamp_ns) for it in other.observations.values() if it is not each]
                joins = sensor not in opened.observations and {by.sensor, sensor} <= self._joined
                if joins and beside and abs(each.stamp_ns - ns) < min(beside):
                    opened.observations[sensor] = other.observations.pop(sensor)
            self._stamp(other)
        self._pending.append(opened)
        return opened

    def _put(self, frame: SyncedFrame, observation: Observation) -> None:
        frame.observations[observation.sensor] = observation
        self._stamp(frame)
        self._pending.sort(key=lambda pending: pending.ns)

    def _stamp(self, frame: SyncedFrame) -> None:
        """Set a frame's stamp to that of its main sensor, else of the first trigger in it."""
        stamped_by = next(name for name in (*self._stamped_by, *frame.observations) if name in frame.observations)
        frame.ns = frame.observations[stamped_by].stamp_ns

    def _join(self) -> None:
        waiting, self._waiting = self._waiting, []
        for observation in waiting:
            frame = self._nearest(observation.stamp_ns, without=observation.sensor)
            if frame is None:
                self._waiting.append(observation)
            else:
                self._put(frame, observation)

    def _hold(self, observation: Observation) -> None:
        values, ns = self._latest[observation.sensor], observation.stamp_ns
        handed_out = self._left.latest.get(observation.sensor) if self._left is not None else None
        if any(value.stamp_ns == ns for value in values) or (handed_out is not None and ns <= handed_out.stamp_ns):
            self.losses[observation.sensor, TWICE] += 1
            return
        values.append(observation)
        values.sort(key=lambda value: value.stamp_ns)

    def _ready(self, newest_ns: int) -> list[SyncedFrame]:
        ready = []
        while self._pending:
            head = self._pending[0]
            lacking = [name for name in self._awaited if self._lacks(head, name)]
            if lacking and newest_ns - head.ns < self._wait_ns(lacking):
                break
            self._pending.pop(0)
            if self._left is not None and head.ns <= self._left.ns:
                # another frame took its stamp: the remaining observations are too late
                self.losses.update((name, LATE) for name in head.observations)
                continue
            if self._leave(head):
                ready.append(head)
        # a frame that these could join may start until then
        oldest_ns = newest_ns - max(self._wait_ns(), self._within_ns + 1)
        kept = [observation for observation in self._waiting if observation.stamp_ns > oldest_ns]
        if len(kept) < len(self._waiting):
            self._lose_alone([each for each in self._waiting if each.stamp_ns <= oldest_ns])
        self._waiting = kept
        self._forget_latest_before(min([oldest_ns, *(frame.ns for frame in self._pending[:1])]))
        return ready

    def _lose_alone(self, observations: list[Observation]) -> None:
        self.losses.update((each.sensor, ALONE) for each in observations)

    def _wait_ns(self, sensors: list[str] | None = None) -> int:
        """Return how long some sensors (None: any) are waited for, those that lag for longer [ns]."""
        return self._max_wait_ns + self._lags.beyond(self._max_wait_ns, sensors)

    def _lacks(self, frame: SyncedFrame, sensor: str) -> bool:
        """Return whether an awaited sensor has not yet reported for the frame."""
        if sensor in self._latest:
            return not self._latest[sensor] or self._latest[sensor][-1].stamp_ns < frame.ns
        return sensor not in frame.observations

    def _leave(self, frame: SyncedFrame) -> bool:
        """Add the latest values to a leaving frame, and remove stale readings; return False if no sensor was due."""
        mute: dict[str, str] = {}
        is_due = not frame.observations
        for name, each in frame.observations.items():
            if self._repeats.is_blank(each):
                mute[name] = BLANK
            elif self._repeats.repeats(each):
                mute[name] = REPEATED
            is_due |= mute.get(name) != REPEATED or self._is_due(name, each.stamp_ns)
            if mute.get(name) != REPEATED:
                self._learn_renewal(name, each.stamp_ns)
        for name, reason in mute.items():
            self.losses[name, reason] += 1
            del frame.observations[name]
        frame.repeated = frozenset(mute)
        self._forget_latest_before(frame.ns)
        frame.latest = {
            name: values[0] for name, values in self._latest.items() if values and values[0].stamp_ns <= frame.ns
        }
        self._left = frame
        return is_due

    def _learn_renewal(self, sensor: str, ns: int) -> None:
        if sensor in self._read_ns:
            self._renewed_ns.setdefault(sensor, deque(maxlen=GAPS)).append(ns - self._read_ns[sensor])
        self._read_ns[sensor] = ns

    def _is_due(self, sensor: str, ns: int) -> bool:
        """Return whether a sensor's usual gap between new readings has passed since its last one."""
        gaps = self._renewed_ns.get(sensor)
        return not gaps or ns - self._read_ns[sensor] >= _DUE * median_low(gaps)

    def _forget_latest_before(self, ns: int) -> None:
        """Keep of every sensor of `latest` the newest value up to `ns`, and the later ones."""
        for name, values in self._latest.items():
            n_before = sum(value.stamp_ns <= ns for value in values)
            self._latest[name] = values[max(n_before - 1, 0) :]
