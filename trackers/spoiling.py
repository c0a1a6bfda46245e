"""Recordings as they must not be but are: what a tracker has to live through, of every kind of sensor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from trackers.observations import NS_PER_S, DepthImage, FloorFrame, Image, LaserScan, Observation

Recording = list[Observation]
Spoil = Callable[[Recording], Recording]
Kind = TypeVar("Kind", bound=Observation)


def _middle_third(kind: type[Kind] | tuple[type[Kind], ...], change: Callable[[Kind], Kind]) -> Spoil:
    """Spoils the observations of a kind in the middle third; hands back the very recording where there are none."""

    def spoil(recording: Recording) -> Recording:
        n = len(recording)
        spoiled = [
            change(item) if isinstance(item, kind) and n // 3 <= place < 2 * n // 3 else item  # type: ignore[arg-type]
            for place, item in enumerate(recording)
        ]
        return spoiled if any(new is not old for new, old in zip(spoiled, recording, strict=True)) else recording

    return spoil


def _pictures(value: int) -> Spoil:
    """Pictures of one grey, without any depth where they have one: a covered lens, a blinding light."""

    def change(picture: Image | DepthImage) -> Image | DepthImage:
        grey = np.full_like(picture.rgb, value)
        if isinstance(picture, DepthImage):
            return replace(picture, rgb=grey, depth_m=np.zeros_like(picture.depth_m))
        return replace(picture, rgb=grey)

    return _middle_third((Image, DepthImage), change)


def _without_sensor(recording: Recording) -> Recording:
    """The sensor that reports first falls silent after a third."""
    if len({item.sensor for item in recording}) < 2:
        return recording
    silent, third = recording[0].sensor, len(recording) // 3
    return [item for place, item in enumerate(recording) if place < third or item.sensor != silent]


def _frozen(recording: Recording) -> Recording:
    """From the middle on each sensor repeats its last reading under new stamps."""
    last: dict[str, Observation] = {}
    frozen = []
    for place, item in enumerate(recording):
        if place < len(recording) // 2 or item.sensor not in last:
            last[item.sensor] = item
        frozen.append(replace(last[item.sensor], stamp_ns=item.stamp_ns))
    return frozen


def _with_gap(recording: Recording) -> Recording:
    half = len(recording) // 2
    later = [replace(item, stamp_ns=item.stamp_ns + 3 * NS_PER_S) for item in recording[half:]]
    return [*recording[:half], *later]


def _with_late(recording: Recording) -> Recording:
    """The observation at a third of the recording arrives after those of the next second."""
    if not recording:
        return recording
    fed = list(recording)
    late = fed.pop(len(fed) // 3)
    place = next((i for i, item in enumerate(fed) if item.stamp_ns >= late.stamp_ns + NS_PER_S), len(fed))
    return [*fed[:place], late, *fed[place:]]


def _ranges(value: float) -> Spoil:
    return _middle_third(LaserScan, lambda scan: replace(scan, ranges_m=np.full_like(scan.ranges_m, value)))


def _floor(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    return _middle_third(FloorFrame, lambda frame: replace(frame, values=change(frame.values)))


def _stuck(values: np.ndarray) -> np.ndarray:
    stuck = values.copy()
    stuck[0, 0] = 200
    return stuck


SPOILINGS: Mapping[str, Spoil] = {
    "no observations": lambda recording: [],
    "scans that meet nothing": _ranges(np.inf),
    "scans without a reading": _ranges(np.nan),
    "black pictures": _pictures(0),
    "white pictures": _pictures(255),
    "pictures without depth": _middle_third(
        DepthImage, lambda picture: replace(picture, depth_m=np.zeros_like(picture.depth_m))
    ),
    "a depth of 1 mm throughout": _middle_third(
        DepthImage, lambda picture: replace(picture, depth_m=np.full_like(picture.depth_m, 0.001))
    ),
    "a floor that feels nothing": _floor(np.zeros_like),
    "a saturated floor": _floor(lambda values: np.full_like(values, 255)),
    "a stuck element of the floor": _floor(_stuck),
    "a sensor that falls silent": _without_sensor,
    "sensors that freeze": _frozen,
    "a gap of 3 s": _with_gap,
    "every observation twice": lambda recording: [item for item in recording for _ in range(2)],
    "an observation that comes a second late": _with_late,
}
"""What is wrong → the recording (in order of arrival) with it, or the very same where it has no such sensor."""
