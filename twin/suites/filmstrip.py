"""Pictures of a suite: film strips about the worst time of a case, charts of one metric; words and links of a change."""

from __future__ import annotations

import json
import tempfile
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from trackers.errors import text_near_bound
from trackers.observations import NS_PER_S
from trackers.prior import Prior
from twin.messages import short_path
from twin.recording.reader import Recording
from twin.report.birdseye import Site, floor_extent
from twin.report.floor_panel import PreviewFrame
from twin.report.metrics_table import format_number
from twin.report.palette import IDENTITY_COLOURS, encode_jpeg
from twin.report.preview import TAIL_S, PreviewWriter, fitting_size
from twin.room.building import room_outline
from twin.run.feed import Feed, Preview
from twin.run.inputs import TrustedClasses, choose
from twin.run.tracker_runner import tracker_runners
from twin.scenario.scenario import TrackerChoice
from twin.suites.cache import RecordingCache
from twin.suites.comparison import Change
from twin.suites.expansion import Case
from twin.suites.metrics import METRICS, format_beside, format_metric, mean_over_seeds, metric_named
from twin.suites.permutation_test import ALPHA
from twin.suites.result_files import CASE_METRICS, REPORT, case_page
from twin.suites.results import Group, GroupKey, Results
from twin.suites.store import ResultStore
from twin.suites.worker import RECORDING, case_recording, resolved_scenario
from twin.world.world import World

_OFFSETS_S = (-0.8, 0.0, 0.8)

_HIGH_PX, _STILL_HIGH_PX = 640, 360

_QUALITY = 82

_LAST_S = 0.15
"""Time before the end of a run at which a tracker has still a frame [s]."""

_AROUND_M, _ZOOMED = 2.5, 0.7
"""Surroundings of people that a strip shows [m], and the share of the room's breadth up to which it shows them alone."""


@dataclass(frozen=True)
class FilmstripWork:
    """A case, its recording's cache, and the time to show [s]; `beside`: another tracker's case of the same recording."""

    case: Case
    cache: RecordingCache
    t_s: float
    beside: Case | None = None


def draw_filmstrip(work: FilmstripWork) -> bytes:
    """Draw three pictures side by side, a JPEG: camera and floor plan with tracks and truth, as in the preview.

    The case `beside` is a row below. Tracks the recording again up to there; one no longer in the cache is made again.
    """
    case, scenario = work.case, resolved_scenario(work.case)
    world = World(scenario)
    with case_recording(case, work.cache) as entry:
        bag = Recording(entry / RECORDING)
        model, data = world.scene.model, world.empty_snapshot(0.0).data
        outline, glass = (room_outline(model, data, glass_only=only) for only in (False, True))
        wanted_s = times_within(work.t_s, scenario.duration_s)
        shown = people_shown(bag, wanted_s, floor_extent(bag.rig, outline))
        site = Site(bag.rig, outline, dict(enumerate(scenario.people, start=1)), glass=glass, shown=shown)
        rows = [_side_by_side(_stills(each, bag, site, wanted_s)) for each in (case, work.beside) if each is not None]
    wide = max(row.shape[1] for row in rows)
    rows = [np.pad(row, ((0, 0), (0, wide - row.shape[1]), (0, 0))) for row in rows]
    return encode_jpeg(np.vstack(rows)[..., ::-1], _QUALITY)


def _stills(case: Case, bag: Recording, site: Site, wanted_s: Sequence[float]) -> list[bytes]:
    """Track the recording of a case and draw it at these times [s]."""
    defined = dict(_choice(text) for text in case.tracker_changes)
    chosen = choose([case.tracker], defined, case.id, TrustedClasses(every=True))  # checked by `expand`
    size, camera_width_px = fitting_size(site, _HIGH_PX)
    title = f"{case.scenario}, seed {case.seed}"
    prior = Prior.read(bag.background, case.prior, bag.rig)
    with tempfile.TemporaryDirectory(prefix="roomtwin-strip-") as temporary:
        look = {"tracker": case.tracker, "title": title, "size": size, "camera_width_px": camera_width_px}
        writer = _FilmstripWriter(Path(temporary) / "strip.mp4", site, fps=10, **look)
        writer.wanted_s = deque(wanted_s)
        with writer, tracker_runners(chosen, bag.rig, prior, case.seed, Path(temporary)) as runners:
            _show(Feed(runners, preview := Preview(writer, bag.rig), bag.rig), preview, writer, bag)
            if writer.wanted_s and writer.n_frames:
                writer.stills.append(writer.still())  # the last frame, of a recording that ends before
            return writer.stills


def times_within(t_s: float, duration_s: float) -> list[float]:
    """Return the times of the pictures about a time [s], moved together to lie within a run that long."""
    last_s = max(duration_s - _LAST_S, -_OFFSETS_S[0])
    centre_s = min(max(t_s, -_OFFSETS_S[0]), last_s - _OFFSETS_S[-1])
    return [max(centre_s + offset, 0.0) for offset in _OFFSETS_S]


def people_shown(bag: Recording, times_s: Sequence[float], room: Array) -> Array | None:
    """Return corners (2, 2) [m] about the people in the area at these times; None where the room (k, 2) is hardly larger."""
    first_ns, last_ns = (round(each * NS_PER_S) for each in (times_s[0], times_s[-1]))
    frames = [frame for frame in bag.truth() if first_ns <= frame.stamp_ns <= last_ns]
    places = [(each.x, each.y) for frame in frames for each in frame.people if each.in_area]
    if not places:
        return None
    low, high = np.min(places, axis=0) - _AROUND_M, np.max(places, axis=0) + _AROUND_M
    return np.array([low, high]) if (high - low).max() < _ZOOMED * np.ptp(room, axis=0).max() else None


class _FilmstripWriter(PreviewWriter):
    """Preview of the wanted frames alone: other frames are not drawn."""

    wanted_s: deque[float]

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.stills: list[bytes] = []

    def frame(self, stamp_ns: int, frame: PreviewFrame) -> None:
        """Draw a frame if it is wanted or near enough before one to appear in its tails."""
        t = stamp_ns / NS_PER_S
        if not self.wanted_s or t < self.wanted_s[0] - TAIL_S:
            return
        super().frame(stamp_ns, frame)
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


def _side_by_side(stills: Sequence[bytes]) -> NDArray[np.uint8]:
    pictures = []
    for still in stills:
        picture = cv2.imdecode(np.frombuffer(still, dtype=np.uint8), cv2.IMREAD_COLOR)
        if picture is None:
            raise RuntimeError("OpenCV could not decode its own JPEG")
        width = round(picture.shape[1] * _STILL_HIGH_PX / picture.shape[0])
        pictures.append(cv2.resize(picture, (width, _STILL_HIGH_PX), interpolation=cv2.INTER_AREA))
    if not pictures:
        raise ValueError("no frame lies at or after the time")
    return np.hstack(pictures)


_SHAPES = (
    "M-4.4 0a4.4 4.4 0 1 0 8.8 0a4.4 4.4 0 1 0 -8.8 0Z",
    "M-4 -4H4V4H-4Z",
    "M0 -5.6L5.6 0L0 5.6L-5.6 0Z",
    "M0 -5.2L5 4H-5Z",
)
"""Disc, square, diamond, triangle: marks that distinguish trackers of equal colour."""

_WIDTH, _LEFT, _RIGHT, _TOP, _ROW, _BOTTOM = 178.0, 8.0, 50.0, 8.0, 20.0, 18.0


@dataclass(frozen=True)
class Scale:
    """Range of values of a metric's axis, the same in every scenario."""

    low: float
    high: float

    def x(self, value: float) -> float:
        """Convert a value to its position on the axis [px]."""
        return _LEFT + (value - self.low) / (self.high - self.low) * (_WIDTH - _LEFT - _RIGHT)


def scale_of(metric: str, groups: Iterable[Group]) -> Scale:
    """Choose a scale that fits every seed of every group; counts start at 0, shares end at 1."""
    values = [value for group in groups for value in group.values(metric)]
    if not values:
        return Scale(0.0, 1.0)
    low, high = min(values), max(values)
    figure = METRICS[metric]
    if figure.better == "less":
        low = min(0.0, low)
    else:
        high = max(1.0, high)
    margin = 0.04 * (high - low) or 0.5
    return Scale(low - margin if figure.better == "more" else low - 0.02 * margin, high + margin)


def colour_of(slot: int) -> int:
    """Return the colour number of the tracker in this slot."""
    return slot % len(IDENTITY_COLOURS)


def marker(slot: int, x: float, y: float, said: str = "") -> str:
    """Draw the marker of the tracker in this slot, as SVG."""
    shape = _SHAPES[slot // len(IDENTITY_COLOURS) % len(_SHAPES)]
    title = f"<title>{said}</title>" if said else ""
    return f'<path class="mean f{colour_of(slot)}" transform="translate({x:.1f} {y:g})" d="{shape}">{title}</path>'


def small_multiple(
    metric: str,
    scale: Scale,
    trackers: Sequence[tuple[str, Group]],
    slots: Mapping[str, int],
    before: Mapping[str, Group],
) -> str:
    """Draw the chart as SVG, one row per tracker (name and group).

    slots: a tracker's index, which determines colour and mark; before: the same group of the baseline.
    """
    height = _TOP + _ROW * len(trackers) + _BOTTOM
    right = _WIDTH - _RIGHT
    parts = [f'<svg viewBox="0 0 {_WIDTH:g} {height:g}" role="img" aria-label="{escape(METRICS[metric].name)}">']
    bottom = height - _BOTTOM
    parts.append(f'<path class="frame" d="M{_LEFT:g} {bottom:g}H{right:g}"/>')
    for value, anchor in ((scale.low, "start"), (scale.high, "end")):
        shown = max(0.0, value) if METRICS[metric].better == "less" else min(1.0, value)
        text = format_number(shown, METRICS[metric].decimals or 1)
        x = _LEFT if anchor == "start" else right
        parts.append(f'<text class="axis" x="{x:g}" y="{height - 5:g}" text-anchor="{anchor}">{text}</text>')
    for row, (name, group) in enumerate(trackers):
        y = _TOP + _ROW * (row + 0.5)
        parts += _row(metric, scale, y, group, slots[name], before.get(name))
    return "".join(parts) + "</svg>"


def _row(metric: str, scale: Scale, y: float, group: Group, slot: int, before: Group | None) -> list[str]:
    mean = mean_over_seeds(group.values(metric))
    if mean is None:
        return [f'<text class="axis" x="{_WIDTH - 2:g}" y="{y + 4:g}" text-anchor="end">–</text>']
    parts = [
        f'<circle class="seed f{colour_of(slot)}" cx="{scale.x(value):.1f}" cy="{y:g}" r="2.2"><title>seed {seed}: '
        f"{format_metric(metric, value)}</title></circle>"
        for seed, figures in group.seeds.items()
        if (value := figures.get(metric)) is not None
    ]
    old = mean_over_seeds(before.values(metric)) if before is not None else None
    if old is not None:
        x = min(max(scale.x(old.mean), _LEFT), _WIDTH - _RIGHT)
        parts.append(
            f'<path class="before" d="M{x:.1f} {y - 7:g}V{y + 7:g}">'
            f"<title>before: {format_metric(metric, old.mean)}</title></path>"
        )
    if mean.low is not None and mean.high is not None:
        parts.append(
            f'<path class="interval s{colour_of(slot)}" d="M{scale.x(mean.low):.1f} {y:g}H{scale.x(mean.high):.1f}"/>'
        )
        centre, low, high = (format_metric(metric, value) for value in (mean.mean, mean.low, mean.high))
        said = f"{centre}, 95 %: {low} to {high}"
    else:
        said = format_metric(metric, mean.mean)
    parts.append(marker(slot, scale.x(mean.mean), y, said))
    value = format_number(mean.mean, METRICS[metric].decimals or 1)
    parts.append(f'<text x="{_WIDTH - 2:g}" y="{y + 4:g}" text-anchor="end">{value}</text>')
    return parts


STRIP = "worst.jpg"
"""Name of a film strip in the folder of its case."""
_KIND_OF = {"misidentifications": "misidentification", "lost_tracks": "lost", "id_switches": "switch"}
"""Metrics that count events; for all others the worst second is shown."""


@dataclass(frozen=True)
class IncidentLink:
    """Page of a case, or its picture of the worst second, and time to look at [s]; `what` happened there."""

    page: Path
    t_s: float
    what: str
    kind: str
    case: str = ""  # of several groups

    @property
    def place(self) -> str:
        """The page, or the folder without one, by its shortest path."""
        return short_path(self.page if self.page.name == REPORT else self.page.parent)


def incident_links(
    changes: Iterable[Change], results: Results, store: ResultStore, folder: Path
) -> list[tuple[Change, IncidentLink]]:
    """Find the incidents behind changes, one of each kind per group; of groups judged together that of the worst case alone."""
    found: dict[tuple[GroupKey, str], tuple[Change, IncidentLink]] = {}
    for change in changes:
        if (link := _incident_link(change, results, store, folder)) is not None:
            found.setdefault((change.key, "" if link.case else link.kind), (change, link))
    return list(found.values())


def _incident_link(change: Change, results: Results, store: ResultStore, folder: Path) -> IncidentLink | None:
    """Find the incident behind a change, in the seed with the largest worsening; None if the run lacks that case."""
    key = change.worst_of or change.key
    group = results.groups.get(key)
    case_id = group.cases.get(change.worst_seed) if group is not None and change.worst_seed is not None else None
    if case_id is None:
        return None
    incidents = store.incidents(case_id)
    kind = _KIND_OF.get(change.metric)
    if not incidents:
        return None
    chosen = next((each for each in incidents if each.kind == kind), incidents[0])
    case = f"{key.scenario}, seed {change.worst_seed}" if key != change.key else ""
    page = case_page(folder, case_id, (REPORT, STRIP, CASE_METRICS))
    return IncidentLink(page, chosen.t_s, chosen.what, chosen.kind, case)


def describe_change(change: Change) -> str:
    """Describe a change: "MOTP 0.067 m → 0.091 m (+0.024 m, allowed 0.004 m)"."""
    name, was = metric_named(change.metric).name, format_metric(change.metric, change.before)
    if change.now is None:
        return f"{name} {was} → no longer measured"
    by, allowed = format_beside(change.metric, change.change, change.allowed)
    return (
        f"{name} {was} → {format_metric(change.metric, change.now)} ({by}, allowed {allowed}, {significance(change)})"
    )


def significance(change: Change) -> str:
    """Describe the significance of a change: its p, and a case that collapsed."""
    if change.now is None:
        return "missing"
    p, parts = min(change.p, change.p_better), [change.collapse.text(change.metric)] if change.collapse else []
    chance = f"p {text_near_bound(p, ALPHA, '.3f')}" if p >= 0.0005 else "p < 0.001"
    return ", ".join([*parts, *([chance] if p <= ALPHA or not parts else [])])
