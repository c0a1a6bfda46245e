"""Film strip: three pictures before, at and after the worst time of a case."""

from __future__ import annotations

import json
import tempfile
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from trackers.observations import NS_PER_S
from trackers.prior import Prior
from twin.recording.reader import Recording
from twin.report.preview import PreviewWriter, fitting_size
from twin.room.building import room_outline
from twin.run.feed import Feed, Preview
from twin.run.inputs import TrustedClasses, choose
from twin.run.tracker_runner import tracker_runners
from twin.scenario.scenario import TrackerChoice
from twin.suites.cache import RecordingCache
from twin.suites.cache_keys import recording_key
from twin.suites.expansion import Case
from twin.suites.worker import RECORDING, record, renderer_of, resolved_scenario
from twin.world.world import World

_OFFSETS_S = (-0.8, 0.0, 0.8)

_TAIL_S = 2.0

_HIGH_PX, _STILL_HIGH_PX = 640, 360

_QUALITY = 82


@dataclass(frozen=True)
class FilmstripWork:
    """A case, its recording's cache, and the time to show [s]."""

    case: Case
    cache: RecordingCache
    t_s: float


def draw_filmstrip(work: FilmstripWork) -> bytes:
    """Draw three pictures side by side, a JPEG: camera and floor plan with tracks and truth, as in the preview.

    Tracks the recording again up to there; a recording no longer in the cache is made again.
    """
    case, scenario = work.case, resolved_scenario(work.case)
    defined = dict(_choice(text) for text in case.tracker_changes)
    chosen = choose([case.tracker], defined, case.id, TrustedClasses(every=True))  # checked by `expand`
    world = World(scenario)
    key = recording_key(case.resolved, renderer_of(scenario))
    with (
        work.cache.recording(key, lambda folder: record(scenario, folder)) as (entry, _),
        tempfile.TemporaryDirectory(prefix="roomtwin-strip-") as temporary,
    ):
        folder = Path(temporary)
        bag = Recording(entry / RECORDING)
        outline = room_outline(world.scene.model, world.empty_snapshot(0.0).data)
        size, camera_width_px = fitting_size(bag.rig, outline, _HIGH_PX)
        writer = _FilmstripWriter(
            folder / "strip.mp4",
            bag.rig,
            fps=10,
            tracker=case.tracker,
            title=f"{case.scenario}, seed {case.seed}",
            outline=outline,
            size=size,
            camera_width_px=camera_width_px,
            person_names=dict(enumerate(scenario.people, start=1)),
        )
        writer.wanted_s = deque(work.t_s + offset for offset in _OFFSETS_S)
        prior = Prior.read(bag.background, case.prior, bag.rig)
        with writer, tracker_runners(chosen, bag.rig, prior, case.seed, folder) as runners:
            _show(Feed(runners, preview := Preview(writer, bag.rig)), preview, writer, bag)
        return _side_by_side(writer.stills)


class _FilmstripWriter(PreviewWriter):
    """Preview of the wanted frames alone: other frames are not drawn."""

    wanted_s: deque[float]

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.stills: list[bytes] = []

    def frame(self, stamp_ns: int, *arguments: Any, **options: Any) -> None:
        """Draw a frame if it is wanted or near enough before one to appear in its tails."""
        t = stamp_ns / NS_PER_S
        if not self.wanted_s or t < self.wanted_s[0] - _TAIL_S:
            return
        super().frame(stamp_ns, *arguments, **options)
        if t >= self.wanted_s[0]:
            self.wanted_s.popleft()
            self.stills.append(self.still())


def _show(fed: Feed, shown: Preview, writer: _FilmstripWriter, bag: Recording) -> None:
    """Feed the recording until every wanted frame is drawn, or to its end."""
    truths = deque(bag.truth())
    for observation in bag.observations():
        while truths and truths[0].stamp_ns <= observation.stamp_ns:
            shown.add_truth(truths.popleft())
        fed.observe(observation)
        if not writer.wanted_s:
            return
    fed.finish()


def _choice(text: str) -> tuple[str, TrackerChoice]:
    """Parse 'trackers.NAME={...}' to a name and a tracker of the scenario."""
    path, _, value = text.partition("=")
    return path.removeprefix("trackers."), TrackerChoice.model_validate(json.loads(value))


def _side_by_side(stills: Sequence[bytes]) -> bytes:
    pictures = []
    for still in stills:
        picture = cv2.imdecode(np.frombuffer(still, dtype=np.uint8), cv2.IMREAD_COLOR)
        if picture is None:
            raise RuntimeError("OpenCV could not decode its own JPEG")
        width = round(picture.shape[1] * _STILL_HIGH_PX / picture.shape[0])
        pictures.append(cv2.resize(picture, (width, _STILL_HIGH_PX), interpolation=cv2.INTER_AREA))
    if not pictures:
        raise ValueError("no frame lies at or after the moment")
    done, jpeg = cv2.imencode(".jpg", np.hstack(pictures), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not done:
        raise RuntimeError("OpenCV could not encode a JPEG")
    return jpeg.tobytes()
