"""Observations on their way to trackers and preview, live or from a recording: the part both have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from trackers.observations import Observation
from trackers.prior import Prior
from trackers.rig import Rig
from trackers.tracks import TrackFrame
from twin.recording.losses import Heard, Loss, dropped_by
from twin.report.birdseye import Polygon
from twin.run.chosen_trackers import ChosenTracker
from twin.run.preview import Preview, preview
from twin.run.tracker_at_work import TrackerAtWork, check_somebody_tracks, trackers_at_work

_SLOWEST_HZ, _FASTEST_HZ = 1.0, 60.0
"""What a video is declared as; each picture is shown at its own stamp all the same."""


class Feed:
    """Hands each observation to every tracker, and the first tracker's frames to the preview."""

    def __init__(self, at_work: Sequence[TrackerAtWork], shown: Preview | None) -> None:
        self.at_work = at_work
        self.shown = shown
        self.on_frame: Callable[[str, TrackFrame], object] | None = None
        """Called with each tracker's name and frame, if set."""
        self.heard = Heard()

    def observe(self, observation: Observation) -> None:
        """Feed one observation; raises PlugInError when the last tracker that was left has failed."""
        self.heard.add(observation)
        if self.shown is not None:
            self.shown.observe(observation)
            if not self.at_work or self.at_work[0].failure:
                self.shown.draw_untracked(observation)
        for place, each in enumerate(self.at_work):
            self._show(place, each.update(observation))
        check_somebody_tracks(self.at_work)

    def finish(self) -> None:
        """Let the trackers work off what they hold back."""
        for place, each in enumerate(self.at_work):
            self._show(place, each.finish())
        check_somebody_tracks(self.at_work)
        if self.shown is not None:
            self.shown.finish()

    def losses(self, ahead_s: Mapping[str, float] | None = None) -> list[Loss]:
        """What scanners did not see, and what each tracker has dropped; `ahead_s` as in `twin.recording.losses.dropped_by`."""
        counts = self.heard.counts
        dropped = [dropped_by(each.name, each.losses, counts, ahead_s) for each in self.at_work if not each.failure]
        return [*self.heard.blind(), *(loss for losses in dropped for loss in losses)]

    def _show(self, place: int, frames: list[TrackFrame]) -> None:
        if self.on_frame is not None:
            for frame in frames:
                self.on_frame(self.at_work[place].name, frame)
        if place == 0 and self.shown is not None:
            for frame in frames:
                self.shown.draw(frame)


@contextmanager
def feed(
    folder: Path,
    rig: Rig,
    prior: Prior,
    chosen: Sequence[ChosenTracker],
    seed: int,
    *,
    video_hz: float | None,
    title: str,
    outline: Sequence[Polygon] = (),
    person_names: Mapping[int, str] | None = None,
    true_rig: Rig | None = None,
    jumps_ns: Sequence[int] = (),
) -> Iterator[Feed]:
    """Trackers writing `folder/tracks/<name>.csv`, and `folder/preview.mp4` at `video_hz` pictures a second (None: none).

    `true_rig`: where the sensors truly are, to be drawn where `rig`, what trackers are told, has them elsewhere. `jumps_ns`:
    stamps at which trackers start anew.

    The files are there under their names when the block ends well, but for those of trackers that failed. Raises
    InputError for an unknown tracker or option.
    """
    with ExitStack() as stack:
        at_work = stack.enter_context(trackers_at_work(chosen, rig, prior, seed, folder / "tracks", jumps_ns))
        shown = None
        if video_hz is not None:
            shown = stack.enter_context(
                preview(
                    folder / "preview.mp4",
                    rig,
                    fps=min(max(video_hz, _SLOWEST_HZ), _FASTEST_HZ),
                    tracker=chosen[0].name if chosen else "",
                    title=title,
                    outline=outline,
                    person_names=person_names,
                    true_rig=true_rig,
                )
            )
        yield Feed(at_work, shown)
