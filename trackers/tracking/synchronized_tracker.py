"""Base of trackers that work synchronized frames: a policy, the tracks of each frame, and what was dropped."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

from trackers.observations import Observation
from trackers.tracking.synced_frames import FrameSynchronizer, SyncedFrame, SyncPolicy
from trackers.tracks import Hypotheses, ScoreMap, Track, TrackFrame


class SynchronizedTracker(ABC):
    """Base of trackers that declare a policy, process frames, and have tracks. Other sensors are ignored."""

    takes_any_order = True  # the synchronizer waits for late observations and drops repeated ones

    def __init__(self, rules: SyncPolicy) -> None:
        self._synchronizer = FrameSynchronizer(rules)

    @property
    def discarded(self) -> int:
        """Observations dropped so far: too late, twice, without a frame to join, or stale."""
        return self._synchronizer.discarded

    @property
    def losses(self) -> Mapping[tuple[str, str], int]:
        """Dropped observations by sensor and reason."""
        return self._synchronizer.losses

    def update(self, observation: Observation) -> list[TrackFrame]:
        """Process one observation; return the completed frames, oldest first."""
        return self._work_all(self._synchronizer.add(observation))

    def finish(self) -> list[TrackFrame]:
        """Return the remaining frames after the last observation."""
        return self._work_all(self._synchronizer.finish())

    @abstractmethod
    def tracks(self) -> list[Track]:
        """Return all tracks of the last frame."""

    @abstractmethod
    def _work(self, synced: SyncedFrame) -> None:
        """Update the tracks by one frame."""

    def _maps(self) -> tuple[ScoreMap | Hypotheses, ...]:
        """Return the score maps or hypotheses of the last frame; by default none."""
        return ()

    def _work_all(self, synced_frames: list[SyncedFrame]) -> list[TrackFrame]:
        frames = []
        for synced in synced_frames:
            self._work(synced)
            frames.append(TrackFrame(synced.ns, tuple(self.tracks()), self._maps()))
        return frames
