"""Losses of a recording or a run: messages that do not reach the tracks, by sensor and reason, reported above a threshold.

A run has one list of losses from all sources: the reader of a bag (malformed messages, clocks, a topic without messages),
the schedule (missing messages), the trackers (dropped observations). Reported ones go to stderr, to the report and to
`metrics.json`.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackers.area import rotation_angles
from trackers.arrays import Nanoseconds
from trackers.arrival_order import LATE
from trackers.feeding import NOTED_LOSS
from trackers.observations import NS_PER_S, DepthImage, Image, LaserScan, Observation, Odometry

_GAP = 1.75
"""Ratio of a gap to the usual one from which messages are missing."""
_NEARLY_WHOLE = 0.2
_MOSTLY = 0.8
_MOST_PERIODS = 4.5
"""Length of the third quartile of the gaps, in periods, of messages that are lost one by one."""
_SHORT = 0.2
"""Least share of gaps of one period among messages lost one by one: of two thirds lost a third is left."""
_LONGEST_PATTERN = 8
"""Number of gaps after which a rhythm of unlike gaps repeats itself, at most."""
_IRREGULAR_GAP = 4.0
"""The same in third quartiles of the gaps, for a sensor without a period."""
_CROWD = 6
_DENSE = 1.3
"""Length of two gaps, in usual ones, which six times in succession is no jitter."""
_BY_CHANCE = 0.01
"""Expected number of such successions in messages lost at random below which two streams are the cause."""
_SAMPLED = 8
"""Rows and columns of a picture of which one is looked at first."""
_SHADES = 16
"""Levels of 256 within which a picture shows nothing: noise of a covered lens, or 12 bits in the place of 16."""
_DARK, _HOLES = "show one colour throughout, but for noise", "have no distance in any pixel"


@dataclass(frozen=True, slots=True)
class Loss:
    """Messages of a sensor that were lost or corrected, the total, and the reason as a clause after 'messages'.

    remedy: what to do, or to type. always: reported even if few. A total of 0 means unknown. topic: stands for {topic} in
    `what`, so that what many sensors have in common is one warning.
    """

    sensor: str
    count: int
    total: int
    what: str
    remedy: str = ""
    always: bool = False
    topic: str = ""

    @property
    def is_reported(self) -> bool:
        """True where the loss is above the threshold, or reported always."""
        return self.always or self.count > NOTED_LOSS * self.total

    @property
    def line(self) -> str:
        """The loss as a warning, on one line."""
        end = f"; {self.remedy}" if self.remedy else ""
        counted = f"{self.count} of {self.total} messages " if self.total else ""
        return f"{self.sensor}: {counted}{self.said}{end}"

    @property
    def said(self) -> str:
        """The reason, with its topic."""
        return self.what.replace("{topic}", self.topic)

    @property
    def document(self) -> dict[str, Any]:
        """The loss as an entry of `losses` in metrics.json."""
        return {
            "sensor": self.sensor,
            "count": self.count,
            "total": self.total,
            "what": self.said,
            "remedy": self.remedy or None,
        }


def lines(losses: Iterable[Loss]) -> list[str]:
    """Format the warnings: one line per reported loss, and one for the same, uncounted, of several sensors."""
    alike: dict[tuple[object, ...], list[Loss]] = {}
    for loss in losses:
        if loss.is_reported:
            counted = (loss.sensor, loss.count, loss.total) if loss.total else ()
            alike.setdefault((loss.what, loss.remedy, *counted), []).append(loss)
    return [_of_all(each).line for each in alike.values()]


def _of_all(losses: Sequence[Loss]) -> Loss:
    """Return one loss of the sensors, and of the topics, of several."""
    sensors, topics = (
        ", ".join(dict.fromkeys(each)) for each in zip(*((x.sensor, x.topic) for x in losses), strict=True)
    )
    return replace(losses[0], sensor=sensors, topic=topics)


def missing(sensor: str, stamps_ns: Nanoseconds, from_ns: int, to_ns: int) -> Loss | None:
    """Estimate how many messages of a sensor are missing between two times, from the gaps between its stamps [ns].

    A sensor's usual gap is the median. Returns None if none is missing, or for too few messages.
    """
    ordered = np.unique(stamps_ns)
    gaps = np.diff(ordered)
    if gaps.size < 2:
        return None
    usual, least = _rhythm(gaps)
    ends = np.array([ordered[0] - from_ns, to_ns - ordered[-1]], dtype=float)
    end_least = max(3 * least, NS_PER_S / 2)  # sensors start and stop at different times
    all_gaps = np.concatenate([gaps[gaps > least], ends[ends > end_least]])
    count = int(np.maximum(np.rint(all_gaps / usual) - 1, 0).sum())
    if not count:
        return None
    starts = np.concatenate([ordered[:-1][gaps > least], np.array([from_ns, ordered[-1]])[ends > end_least]])
    longest = int(all_gaps.argmax())
    start_s, lasts_s = starts[longest] / NS_PER_S, all_gaps[longest] / NS_PER_S
    silent = f"silent for up to {lasts_s:.3g} s, from {start_s:.2f} s on"
    what = f"are missing, as its usual gap of {usual / NS_PER_S:.3g} s tells: {silent}"
    return Loss(sensor, count, ordered.size + count, what, "see whether driver, network or recorder lost them")


def _rhythm(gaps: Nanoseconds) -> tuple[float, float]:
    """Return the usual gap, and the least gap (of n gaps [ns]) that holds missing messages [ns].

    If most gaps are multiples of the short ones, these are the period, though two thirds of the messages be missing: then four
    of five gaps are of one to four periods. Where more are longer, the short ones lie within bursts; so they do where few are
    short and the gaps repeat themselves, which they do not where messages are lost at random.
    """
    short = gaps[gaps < _GAP * np.quantile(gaps, 0.1)]
    period = float(np.median(short))
    times, share = gaps / period, short.size / gaps.size
    whole = np.rint(times)
    of_periods = np.mean(np.abs(times - whole) < _NEARLY_WHOLE) > _MOSTLY and np.quantile(times, 0.75) < _MOST_PERIODS
    if of_periods and (share >= 0.5 or (share > _SHORT and not _repeats(whole))):
        return period, _GAP * period
    return float(np.median(gaps)), _IRREGULAR_GAP * float(np.quantile(gaps, 0.75))


def _repeats(numbers: NDArray[np.float64]) -> bool:
    """Tell whether most numbers (n,) equal those some places before them, of one and the same count."""
    lags = range(1, min(_LONGEST_PATTERN, numbers.size - 1) + 1)
    return any(np.mean(numbers[lag:] == numbers[:-lag]) > _MOSTLY for lag in lags)


def crowded(sensor: str, stamps_ns: Nanoseconds, usual: float = 0.5) -> Loss | None:
    """Count messages twice as dense as the sensor's others; None without any.

    Two streams overlap there: the recorder's clock was set back, or two drivers publish on one topic. Where messages are lost
    at random, some follow each other for a while too, by chance. `usual`: quantile of the gaps that is the sensor's period.
    """
    ordered = np.sort(stamps_ns)
    if ordered.size < 4 * _CROWD:
        return None
    dense = ordered[2:] - ordered[:-2] < _DENSE * float(np.quantile(np.diff(ordered), usual))
    lasting = np.convolve(dense, np.ones(_CROWD), "valid") >= _CROWD - 1
    count = int(np.count_nonzero(np.convolve(lasting, np.ones(_CROWD)) > 0))
    if not lasting.any() or dense.all():
        return None
    longest = int(np.diff(np.flatnonzero(np.concatenate([[True], ~dense, [True]]))).max())  # gaps in succession
    if dense.size * min(float(dense.mean()), 0.5) ** (0.5 * longest) > _BY_CHANCE:
        return None
    start_s = float(ordered[int(lasting.argmax())]) / NS_PER_S
    what = f"come twice as dense as the others, from {start_s:.2f} s on: two streams lie over one another"
    remedy = (
        "the clock of the recorder was set back, or two drivers write on one topic; record again, or cut the bag there"
    )
    return Loss(sensor, count, stamps_ns.size, what, remedy)


_FASTEST_MPS, _FASTEST_RADPS = 15.0, 20.0
_SLACK_M, _SLACK_RAD = 0.3, 0.3
"""No base among people is faster; the slack is for stamps that jitter."""


def _steps_too_far(stamps_ns: Nanoseconds, poses: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the numbers of the poses to which a base would have had to go faster than any does."""
    steps = np.linalg.inv(poses[:-1]) @ poses[1:]
    passed_s = np.abs(np.diff(stamps_ns)) / NS_PER_S
    far = np.linalg.norm(steps[:, :3, 3], axis=1) > _FASTEST_MPS * passed_s + _SLACK_M
    turned = rotation_angles(steps[:, :3, :3]) if len(steps) else np.zeros(0)
    return np.flatnonzero(far | (turned > _FASTEST_RADPS * passed_s + _SLACK_RAD)) + 1


def pose_jumps(name: str, stamps_ns: Nanoseconds, poses: NDArray[np.float64]) -> Iterator[Loss]:
    """Yield a loss where the poses (n, 4, 4) of a base jump further than any base drives."""
    if (where := _steps_too_far(stamps_ns, poses)).size:
        when = ", ".join(f"{(stamps_ns[k] - stamps_ns[0]) / NS_PER_S:.2f} s" for k in where[:5])
        what = f"jump, further than any base drives, at {when} from the first"
        yield Loss(name, where.size, len(poses), what, "trackers take them as they come", always=True)


class ObservationLog:
    """Log of the observations so far: the stamps of each sensor, beams with a return per scan, and pictures of nothing."""

    def __init__(self) -> None:
        self._stamps_ns: dict[str, array[int]] = {}
        self._readings: dict[str, array[int]] = {}
        self._of_nothing: Counter[tuple[str, str]] = Counter()
        self._places_m: dict[str, array[float]] = {}

    def add(self, observation: Observation) -> None:
        """Add an observation on arrival."""
        name = observation.sensor
        self._stamps_ns.setdefault(name, array("q")).append(observation.stamp_ns)
        if isinstance(observation, LaserScan):
            valid = int(np.count_nonzero(np.isfinite(observation.ranges_m)))
            self._readings.setdefault(name, array("q")).append(valid)
        if isinstance(observation, Odometry):
            self._places_m.setdefault(name, array("d")).extend(observation.frame_from_base[:3, 3])
        if isinstance(observation, Image | DepthImage) and _is_even(observation.rgb):
            self._of_nothing[name, _DARK] += 1
        if isinstance(observation, DepthImage) and not observation.depth_m.any():
            self._of_nothing[name, _HOLES] += 1

    @property
    def counts(self) -> dict[str, int]:
        """Number of observations of each sensor."""
        return {name: len(stamps) for name, stamps in self._stamps_ns.items()}

    def drives(self) -> dict[str, tuple[NDArray[np.int64], NDArray[np.float64]]]:
        """Return the stamps (n,) [ns] and places (n, 3) of each base in its odometry frame [m]."""
        return {
            name: (np.array(self._stamps_ns[name], dtype=np.int64), np.array(places).reshape(-1, 3))
            for name, places in self._places_m.items()
        }

    def missing(self) -> list[Loss]:
        """Estimate the missing messages by each sensor's own rhythm, from the first stamp of all to the last."""
        stamps = {name: np.array(each, dtype=np.int64) for name, each in self._stamps_ns.items()}
        if not stamps:
            return []
        from_ns, to_ns = (
            min(int(each.min()) for each in stamps.values()),
            max(int(each.max()) for each in stamps.values()),
        )
        found = [missing(name, each, from_ns, to_ns) for name, each in stamps.items()]
        return [loss for loss in found if loss is not None]

    def blind(self) -> list[Loss]:
        """Count the scans with returns in less than half of the scanner's usual number of beams, and pictures of nothing."""
        remedy = "see whether the camera is covered, its pixels fill their bits, and nothing else is on its topic"
        counts = self.counts
        losses = [Loss(name, n, counts[name], what, remedy) for (name, what), n in self._of_nothing.items()]
        for name, each in self._readings.items():
            valid = np.array(each)
            usual = float(np.median(valid))
            few = int(np.count_nonzero((valid < 0.5 * usual) | (valid == 0)))
            if few:
                what = (
                    f"have returns in less than half of the {usual:.0f} beams that usually have one"
                    if usual
                    else "have no return in any beam"
                )
                losses.append(
                    Loss(
                        name,
                        few,
                        valid.size,
                        what,
                        "see whether the scanner is covered, in error, or gives ranges in another unit than m",
                    )
                )
        return losses


def _is_even(rgb: NDArray[np.uint8]) -> bool:
    """Return True for a picture of one colour, but for noise; most others are known by a few of their pixels."""
    parts = (rgb[::_SAMPLED, ::_SAMPLED], rgb)
    return rgb.size > 0 and all(bool((np.ptp(part, axis=(0, 1)) < _SHADES).all()) for part in parts)


def dropped_by(
    tracker: str,
    losses: Mapping[tuple[str, str], int],
    totals: Mapping[str, int],
    ahead_s: Mapping[str, float] | None = None,
) -> list[Loss]:
    """Convert a tracker's dropped observations, by sensor and reason (`trackers.tracks.Reporting.losses`), to losses.

    totals: observations fed, by sensor. ahead_s: lead of a sensor's stamps over the others' logged at the same time [s]; it
    gives the remedy for lateness.
    """
    found = []
    for (sensor, reason), count in losses.items():
        remedy = ""
        if reason == LATE:
            remedy = "a longer delay than trackers wait for; see what holds the messages up"
            off_s = (ahead_s or {}).get(sensor, 0.0)
            if abs(off_s) >= _LEAST_OFFSET_S:
                others = ", ".join(name for name in ahead_s or {} if name != sensor)
                remedy = f"`time_offset_s: {-off_s:.3f}` for {sensor} in rig.yaml, if its clock is off"
                remedy += f", and not that of {others}" if others else ""
        total = totals.get(sensor, sum(totals.values())) if sensor else sum(totals.values())
        found.append(Loss(sensor or "all sensors", count, total, f"were dropped by {tracker}: {reason}", remedy))
    return found


_LEAST_OFFSET_S = 0.1


def documents(losses: Sequence[Loss]) -> list[dict[str, Any]]:
    """Return all losses, below the threshold too, as `losses` of metrics.json."""
    return [loss.document for loss in losses]
