"""Stretches of time: from stamped samples to the spans in which something was so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_GAP_FACTOR = 1.5


@dataclass(frozen=True)
class Span:
    """From `start_ns` to `end_ns`; `label` is what was so (a track id, a level, 0 where nothing is told apart)."""

    start_ns: int
    end_ns: int
    label: int = 0


def usual_period_ns(*frame_stamps_ns: NDArray[np.int64]) -> int:
    """The usual time from one frame to the next [ns], of the slowest of several tables; 0.1 s where unknown.

    The slowest, because truth is written at the stamps of every sensor, which stand closer and less evenly than the
    frames of a tracker.
    """
    return max((int(np.median(np.diff(stamps))) for stamps in frame_stamps_ns if stamps.size > 1), default=100_000_000)


def unbroken(
    stamps_ns: NDArray[np.int64], period_ns: int, labels: NDArray[np.int64] | None = None
) -> list[NDArray[np.intp]]:
    """Indices of the samples (ascending stamps) in pieces without a gap above 1.5 periods and of one label each."""
    if stamps_ns.size == 0:
        return []
    breaks = np.diff(stamps_ns) > _GAP_FACTOR * period_ns
    if labels is not None:
        breaks |= np.diff(labels) != 0
    return np.split(np.arange(stamps_ns.size), np.flatnonzero(breaks) + 1)


def spans(stamps_ns: NDArray[np.int64], period_ns: int, labels: NDArray[np.int64] | None = None) -> list[Span]:
    """The spans samples stand for, half a period either way; a gap above 1.5 periods or another label ends one."""
    half = period_ns // 2
    return [
        Span(
            int(stamps_ns[piece[0]]) - half,
            int(stamps_ns[piece[-1]]) + half,
            0 if labels is None else int(labels[piece[0]]),
        )
        for piece in unbroken(stamps_ns, period_ns, labels)
    ]


def without(whole: Sequence[Span], parts: Sequence[Span], shortest_ns: int) -> list[Span]:
    """What is left of `whole` outside `parts` (each in order, without overlap), pieces above `shortest_ns`."""
    left = []
    for span in whole:
        start = span.start_ns
        for part in parts:
            if part.end_ns <= start or part.start_ns >= span.end_ns:
                continue
            if part.start_ns - start > shortest_ns:
                left.append(Span(start, part.start_ns, span.label))
            start = max(start, part.end_ns)
        if span.end_ns - start > shortest_ns:
            left.append(Span(start, span.end_ns, span.label))
    return left
