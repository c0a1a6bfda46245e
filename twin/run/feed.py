"""Feed observations, live or from a recording, to the trackers and to the preview video; or to a tracker's detector.

The preview combines a tracker's frame with the newest observations and the truth at its stamp.

Columns of the table of `twin detections`, one row per detection: `t` stamp of the frame [s]; `sensors` that detected it,
joined by `+`; `role` (`waist`: a trunk, `knee`: legs); `x`, `y` ground point in the room frame [m]; `variance` of the
position on each axis [m²]; `width` as measured [m]. Numbers are empty where the detector does not give them. A frame without
detections has no row.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from trackers.errors import PLUG_IN_ERRORS, InputError, PlugInError
from trackers.feeding import FedTracker
from trackers.laser.reach import ScannerReach
from trackers.observations import LaserScan, Observation, Odometry
from trackers.presets import PRESETS
from trackers.prior import Prior
from trackers.rig import Rig
from trackers.tracks import Detection, TrackFrame, detections_of, unused_sensors
from trackers.user_input.text_file import AnyPath
from twin.messages import OnWarning, at_work
from twin.recording.losses import Loss, ObservationLog, dropped_by, lines
from twin.recording.ros.scan_messages import RangeUnits, StandingScanners
from twin.recording.tables import number_cell, seconds_cell
from twin.report.birdseye import Site
from twin.report.floor_panel import PreviewFrame, TruePoses
from twin.report.sensor_stills import RunPictures, SensorStills, SilenceMonitor
from twin.run.inputs import ChosenTracker, chosen_trackers, files_for, scenario_of
from twin.run.tracker_runner import TrackerRunner, check_some_left, plug_in_fault, tracker_runners
from twin.truth.truth_types import TruthFrame

if TYPE_CHECKING:
    from twin.report.preview import PreviewWriter
    from twin.world.simulation import Simulation

_HELD_OBSERVATIONS = 32
_HELD_FOR_STILLS = 4
_HELD_TRUTHS = 256
_NEAR_NS = 50_000_000
"""Greatest time between a stamp and the truth used for it [ns]."""


class Preview:
    """Preview of a tracker's frames: holds observations until a tracker has processed them; draws each frame, keeps one for
    the stills.

    `writer`: of the video, None for none; `stills`: None for none.
    """

    def __init__(self, writer: PreviewWriter | None, rig: Rig, stills: SensorStills | None = None) -> None:
        self._writer = writer
        self._stills = stills
        self._main = rig.main_sensor
        self._observations: dict[str, deque[Observation]] = {}
        self._silence_monitor = SilenceMonitor(rig.sensors)
        self._truths: dict[int, TruthFrame] = {}
        self._waiting: deque[TrackFrame] = deque()
        self._last_ns = -1
        self._poster = b""

    @property
    def is_filmed(self) -> bool:
        """True where a video is made."""
        return self._writer is not None

    def pictures(self) -> RunPictures | None:
        """Draw the stills of the report; None if none are kept."""
        return None if self._stills is None else self._stills.draw(self._poster)

    def observe(self, observation: Observation) -> None:
        """Add an observation for later frames; frames with an earlier stamp are drawn first."""
        while self._waiting and self._waiting[0].stamp_ns < observation.stamp_ns:
            self._draw(self._waiting.popleft())
        self._silence_monitor.add(observation)
        longest = _HELD_OBSERVATIONS if self._writer is not None else _HELD_FOR_STILLS
        held = self._observations.setdefault(observation.sensor, deque(maxlen=longest))
        held.append(observation)

    def add_truth(self, truth: TruthFrame) -> None:
        """Add the truth of a stamp for later frames."""
        self._truths[truth.stamp_ns] = truth
        while len(self._truths) > _HELD_TRUTHS:
            del self._truths[next(iter(self._truths))]

    def draw(self, frame: TrackFrame) -> None:
        """Draw a tracker's frame once every sensor has reported up to its stamp."""
        self._waiting.append(frame)

    def finish(self) -> None:
        """Draw the remaining frames."""
        while self._waiting:
            self._draw(self._waiting.popleft())

    def _draw(self, frame: TrackFrame) -> None:
        if frame.stamp_ns <= self._last_ns:
            return
        self._last_ns = frame.stamp_ns
        silent = self._silence_monitor.silent()
        newest: dict[str, Observation] = {}
        for name, held in self._observations.items():
            due = [each for each in held if each.stamp_ns <= frame.stamp_ns]
            # a silent base stands where it was
            if due and (name not in silent or isinstance(due[0], Odometry)):
                newest[name] = max(due, key=lambda each: each.stamp_ns)
                self._drop_before(name, newest[name].stamp_ns)
        truth = true_poses(self._truth_at(frame.stamp_ns))
        if self._writer is not None:
            self._writer.frame(frame.stamp_ns, PreviewFrame(newest, frame.tracks, truth, silent, frame.maps))
        kept = self._stills is not None and self._stills.keep_best(frame, newest, truth)
        if kept and self._writer is not None:
            self._poster = self._writer.still()

    def _drop_before(self, sensor: str, stamp_ns: int) -> None:
        """Drop a sensor's observations before the one of this stamp, which no later frame shows: pictures are large."""
        held = self._observations[sensor]
        left = [each for each in held if each.stamp_ns >= stamp_ns]
        held.clear()
        held.extend(left)

    def _truth_at(self, stamp_ns: int) -> TruthFrame | None:
        """Return the truth of a stamp, or the nearest one for a stamp by a wrong clock; None if none is near."""
        if stamp_ns in self._truths or not self._truths:
            return self._truths.get(stamp_ns)
        nearest = min(self._truths, key=lambda held: abs(held - stamp_ns))
        return self._truths[nearest] if abs(nearest - stamp_ns) <= _NEAR_NS else None

    def draw_untracked(self, observation: Observation) -> None:
        """Draw a frame without tracks at each observation of the main sensor."""
        if observation.sensor == self._main:
            self.draw(TrackFrame(observation.stamp_ns, ()))


def true_poses(truth: TruthFrame | None) -> TruePoses | None:
    """Convert the truth of a stamp for drawing; None if unknown."""
    if truth is None:
        return None
    people = truth.people
    return TruePoses(
        ids=np.array([person.id for person in people], dtype=np.int64),
        xy_m=np.array([(person.x, person.y) for person in people]).reshape(-1, 2),
        yaw_rad=np.array([person.yaw for person in people]),
    )


IN_A_ROW = 100
"""Number of observations, and of truths, that are read, tracked and written in a row: cheaper than by turns."""
_SLOWEST_HZ, _FASTEST_HZ = 1.0, 60.0
"""Limits of a video's declared rate; each image is shown at its own stamp anyway."""


class _ScannerChecks:
    """Examines scans for what hides people: ranges in another unit, else beams too sparse, too low or too high."""

    def __init__(self, rig: Rig) -> None:
        self._units, self._reach, self._standing = RangeUnits(rig), ScannerReach(rig), StandingScanners(rig)

    def add(self, scan: LaserScan) -> None:
        self._units.add(scan)
        self._reach.add(scan)
        self._standing.add(scan)

    def warnings(self, unused: Collection[str], *, are_moving: bool) -> list[str]:
        """Return sentences on the scanners in use: of one with another unit no other; are_moving: none on motion."""
        units = self._units.warnings(unused)
        left_out = {*unused, *units}
        turns = [] if are_moving else self._standing.warnings(left_out)
        return [*units.values(), *turns, *self._reach.warnings(left_out)]


class Feed:
    """Feeds each observation to every tracker, and the first tracker's frames to the preview."""

    def __init__(self, runners: Sequence[TrackerRunner], preview: Preview | None, rig: Rig) -> None:
        self.runners = runners
        self._scanners = _ScannerChecks(rig)
        self.preview = preview
        self.on_frame: Callable[[str, TrackFrame], object] | None = None
        """Called with each tracker's name and frame, if set."""
        self.log = ObservationLog()

    @property
    def is_filmed(self) -> bool:
        """True where a preview video is made."""
        return self.preview is not None and self.preview.is_filmed

    def observe(self, observation: Observation) -> None:
        """Feed one observation; raises PlugInError when the last remaining tracker has failed."""
        self.log.add(observation)
        if isinstance(observation, LaserScan):
            self._scanners.add(observation)
        if self.preview is not None:
            self.preview.observe(observation)
            if not self.runners or self.runners[0].failure:
                self.preview.draw_untracked(observation)
        for place, each in enumerate(self.runners):
            self._show(place, each.update(observation))
        check_some_left(self.runners)

    def finish(self) -> None:
        """Let the trackers process remaining observations."""
        for place, each in enumerate(self.runners):
            self._show(place, each.finish())
        check_some_left(self.runners)
        if self.preview is not None:
            self.preview.finish()

    def losses(self, ahead_s: Mapping[str, float] | None = None) -> list[Loss]:
        """Return the losses of blind scanners and each tracker's drops; `ahead_s` as in `twin.recording.losses.dropped_by`."""
        counts = self.log.counts
        dropped = [dropped_by(each.name, each.losses, counts, ahead_s) for each in self.runners if not each.failure]
        return [*self.log.blind(), *(loss for losses in dropped for loss in losses)]

    def unfit_scanners(self, *, are_moving: bool = False) -> list[str]:
        """Return sentences on scanners in use that show few people or move; are_moving: other warnings say the latter."""
        unused = [set(unused_sensors(each.tracker)) for each in self.runners if not each.failure]
        return self._scanners.warnings(set.intersection(*unused), are_moving=are_moving) if unused else []

    def _show(self, place: int, frames: list[TrackFrame]) -> None:
        if self.on_frame is not None:
            for frame in frames:
                self.on_frame(self.runners[place].name, frame)
        if place == 0 and self.preview is not None:
            for frame in frames:
                self.preview.draw(frame)


@contextmanager
def open_feed(
    folder: Path,
    site: Site,
    prior: Prior,
    chosen: Sequence[ChosenTracker],
    seed: int,
    *,
    video_hz: float | None,
    title: str,
    jumps_ns: Sequence[int] = (),
    stills: bool = False,
) -> Iterator[Feed]:
    """Open trackers that write `folder/tracks/<name>.csv`, and a preview at `video_hz` images per second (None: none).

    `stills`: whether to keep the stills of a report. `jumps_ns`: stamps at which trackers restart.

    The files appear when the block ends normally, except those of failed trackers. Raises InputError for an unknown tracker
    or option.
    """
    with ExitStack() as stack:
        rig = site.rig
        runners = stack.enter_context(tracker_runners(chosen, rig, prior, seed, folder / "tracks", jumps_ns))
        writer = None
        if video_hz is not None:
            from twin.report.preview import PreviewWriter  # the video encoder is imported only when needed

            fps = min(max(video_hz, _SLOWEST_HZ), _FASTEST_HZ)
            tracker = chosen[0].name if chosen else ""
            film = PreviewWriter(folder / "preview.mp4", site, fps=fps, tracker=tracker, title=title)
            writer = stack.enter_context(film)
        kept = SensorStills(site) if stills else None
        yield Feed(runners, Preview(writer, rig, kept) if writer is not None or kept is not None else None, rig)


def unfit_scanners(simulation: Simulation) -> list[str]:
    """Return a sentence per scanner that, by its scan at the start, cannot show people in most of what it sees."""
    reach, looks = ScannerReach(simulation.rig), simulation.look(0, simulation.rig.lasers())
    for seen in (*looks.values(), *looks.values()):  # the first is examined by the others once they are there
        if isinstance(seen, LaserScan):
            reach.add(seen)
    return reach.warnings()


DETECTION_COLUMNS = ("t", "sensors", "role", "x", "y", "variance", "width")


def write_detections(
    recording: AnyPath,
    file: TextIO,
    *,
    tracker: str,
    rig: Rig | AnyPath | None = None,
    changes: Sequence[str] = (),
    seed: int | None = None,
    on_warning: OnWarning = lambda warning: None,
) -> None:
    """Track a recording and write the tracker's detections; `rig`, `changes`, `seed` as for `twin track`.

    Raises InputError for bad input, a tracker without detections among it, before anything is written.
    """
    from twin.recording.reader import Recording

    bag = Recording(recording, rig)
    scenario = scenario_of(bag)
    seed = seed if seed is not None else scenario.seed if scenario is not None else 0
    (chosen,) = chosen_trackers(bag, scenario, [tracker], changes)
    files, missing = files_for(bag, scenario, rig, changes)
    warned = [*missing, *lines(bag.losses), *bag.moving]
    for warning in warned:
        on_warning(warning)
    made = TrackerRunner(chosen, bag.rig)
    made.make(Prior.read(bag.background, files, bag.rig), seed, bag.jumps_ns)
    if made.failure:
        raise PlugInError(made.failure)
    detections = detections_of(made.tracker)
    if detections is None:
        raise InputError(
            f"--tracker {tracker}: does not tell what its detector sees; one that has detections() is expected, like sort"
        )
    file.write(",".join(DETECTION_COLUMNS) + "\n")
    n_fed: Counter[str] = Counter()
    rows: list[str] = []
    fed = FedTracker(made.tracker, bag.rig, on_worked=lambda: rows.extend(map(_row, detections())))
    scanners = _ScannerChecks(bag.rig)
    for observation in bag.observations():
        n_fed[observation.sensor] += 1
        if isinstance(observation, LaserScan):
            scanners.add(observation)
        _called(chosen, made.tracker, partial(fed.update, observation))
        file.writelines(rows)
        rows.clear()
    _called(chosen, made.tracker, fed.finish)
    file.writelines(rows)
    lost = [*bag.losses, *dropped_by(made.name, fed.losses, n_fed, bag.ahead_s)]
    for warning in (*lines(lost), *scanners.warnings(unused_sensors(made.tracker), are_moving=bool(bag.moving))):
        if warning not in warned:
            on_warning(warning)


def _called(chosen: ChosenTracker, tracker: Any, call: Callable[[], object]) -> None:
    """Call a tracker; raises PlugInError for an exception of a plug-in, but passes on that of a tracker of ours."""
    try:
        with at_work(chosen.name):
            call()
    except PLUG_IN_ERRORS as error:
        if chosen.target in PRESETS:
            raise
        raise PlugInError(plug_in_fault(chosen, tracker, error)) from error


def _row(each: Detection) -> str:
    numbers = map(number_cell, (each.x, each.y, each.variance_m2, each.width_m))
    return ",".join([seconds_cell(each.stamp_ns), "+".join(each.sensors), each.role, *numbers]) + "\n"
