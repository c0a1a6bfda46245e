"""Run one case on a worker: record if necessary, then track and evaluate."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from trackers.arrays import Array
from trackers.configuration import validate
from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.user_input.plain_data import parse_yaml
from twin.console import print_warning
from twin.evaluate.continuity import track_counts
from twin.evaluate.summary import Evaluation
from twin.messages import OnWarning, no_warning
from twin.people.poses import PopulationMotion
from twin.recording.bags.bag import open_bag
from twin.recording.ros.topics import SCAN, sensor_topic
from twin.recording.tables import read_tracks, read_truth
from twin.report.timeline import describe_event
from twin.run.live import run_scenario
from twin.run.replay import track_recording
from twin.run.tracker_runner import file_name
from twin.scenario import Scenario
from twin.scenario.load import dump_scenario
from twin.sensors.render import OffscreenRenderer
from twin.suites.cache import RecordingCache, digests_of
from twin.suites.cache_keys import RecordedInput, people_key, recording_key, whole_code
from twin.suites.expansion import Case
from twin.world.world import PrecomputedScene, precompute_people

RECORDING, TRUTH = "recording.mcap", "truth.csv"

NO_RENDERER = "none"
"""Renderer's name for recordings without images."""

_WITHOUT_RENDERER = ("laser", "floor")
"""Kinds of sensor that need no renderer."""

WORST = "worst"
"""Kind of incident that every case has: its worst second."""

_WINDOW_S = 1.0

_START_S = 1.0
"""Time allowed for a tracker to confirm people; earlier errors are not counted."""

_MOST_EVENTS = 20

_WARNINGS = "warnings.json"
_DIGEST = 16
"""Number of characters of a recording's digest that distinguish it from all others."""


@dataclass(frozen=True)
class CaseWork:
    """A case, the cache, and the state of the code (see `cache_keys.whole_code`) that the run uses."""

    case: Case
    cache: RecordingCache
    code: str
    same_people: bool = False
    """True where other recordings of the suite share the people but not the sensors; their motion is then cached."""


@dataclass(frozen=True)
class Incident:
    """Event of the evaluation, or WORST: the middle of the worst second by OSPA."""

    t_s: float
    kind: str
    what: str
    severity: float


@dataclass(frozen=True)
class CaseResult:
    """Result of a case: the tracker's entry of `metrics.json`, incidents, the files of its folder, provenance.

    recording: digest of the recorded bits; people: of the people's motion; scatter_m: noise of each scanner's ranges, by its
    position; tracker_warnings: of the tracker; scenario_warnings: of its scenario.
    """

    metrics: dict[str, Any]
    incidents: tuple[Incident, ...]
    files: dict[str, bytes]
    renderer: str
    recording: str = ""
    people: str = ""
    scatter_m: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    tracker_warnings: tuple[str, ...] = ()
    scenario_warnings: tuple[str, ...] = ()


def run_case(work: CaseWork) -> CaseResult:
    """Record unless cached, track, evaluate.

    Raises InputError for an invalid scenario or tracker, for files changed since the suite's start, and where this process
    runs other code than the suite.
    """
    if work.code != whole_code():
        raise InputError(
            "the worker's code is not that of the suite's process; the same version of roomtwin on every machine is "
            "expected"
        )
    case = work.case
    case.check_files()
    if case.bag is not None:
        return _track(case, case.bag.path, {}, case.bag)
    scenario = resolved_scenario(case)
    renderer = renderer_of(scenario)
    key, warnings = recording_key(case.resolved, renderer), []

    def make(folder: Path) -> None:
        record(scenario, folder, cached_motion(work.cache, scenario) if work.same_people else None)

    with work.cache.recording(key, make, warnings.append) as (entry, _):
        tracked = _track(case, entry / RECORDING, dict(enumerate(scenario.people, start=1)))
        return replace(
            tracked,
            renderer=renderer,
            recording=digests_of(entry)[RECORDING][:_DIGEST],
            people=people_digest(entry / TRUTH),
            scatter_m=range_scatter_m(entry / RECORDING, scenario),
            warnings=tuple(warnings),
            scenario_warnings=tuple(_warnings_in(entry)),
        )


def _warnings_in(entry: Path) -> list[str]:
    """Return the warnings of the scenario of a recording or a motion in the cache."""
    path = entry / _WARNINGS
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else []


def resolved_scenario(case: Case) -> Scenario:
    """Parse the case's scenario, seed included, without trackers."""
    return validate(Scenario, parse_yaml(case.resolved, case.id, "a resolved scenario"), case.id)


def renderer_of(scenario: Scenario) -> str:
    """Name the OpenGL renderer here and its switches, or NO_RENDERER for a scenario without cameras.

    Raises InputError without OpenGL.
    """
    if all(sensor.kind in _WITHOUT_RENDERER for sensor in scenario.sensors.values()):
        return NO_RENDERER
    return f"{_renderer()}, with {scenario.rendering}" if str(scenario.rendering) else _renderer()


@cache
def _renderer() -> str:
    with OffscreenRenderer(mujoco.MjModel.from_xml_string("<mujoco/>")) as renderer:
        info = renderer.gl_info()
    return f"{info.renderer}, OpenGL {info.version}"


def record(scenario: Scenario, folder: Path, precomputed: PrecomputedScene | None = None) -> None:
    """Simulate a scenario into a folder: its recording, and the truth as a table. `precomputed`: precomputed motion, if any."""
    result = run_scenario(
        scenario, trackers=[], out=folder, video=False, precomputed=precomputed, on_warning=no_warning
    )
    of_scenario = [each for each in result.warnings if each.startswith(("scenario ", "people: "))]
    (folder / _WARNINGS).write_text(json.dumps(of_scenario), encoding="utf-8")


def case_recording(
    case: Case, cache: RecordingCache, on_warning: OnWarning = print_warning
) -> AbstractContextManager[Path]:
    """Yield the folder of a case's recording in the cache, made if missing."""
    return scenario_recording(resolved_scenario(case), cache, case.resolved, on_warning)


@contextmanager
def scenario_recording(
    scenario: Scenario, cache: RecordingCache, resolved: str | None = None, on_warning: OnWarning = print_warning
) -> Iterator[Path]:
    """Yield the folder of a scenario's recording in the cache, made if missing. resolved: the scenario as YAML, if at hand."""
    key = recording_key(resolved or dump_scenario(scenario), renderer_of(scenario))
    with cache.recording(key, partial(record, scenario), on_warning) as (entry, _):
        yield entry


def _track(case: Case, recording: Path, names: Mapping[int, str], bag: RecordedInput | None = None) -> CaseResult:
    """Track and evaluate a recording, people by `names`.

    A suite's own `bag` is evaluated against its table of truth, else the truth in it, else its tracks are counted alone.
    """
    with tempfile.TemporaryDirectory(prefix="roomtwin-case-") as temporary:
        folder = Path(temporary)
        result = track_recording(
            recording,
            trackers=[case.tracker],
            rig_path=None if bag is None else bag.rig,
            truth_path=None if bag is None else bag.truth,
            changes=case.tracking_changes,
            seed=case.seed,
            out=folder,
            video=False,
            report=case.report,
            on_warning=no_warning,
        )
        here = f"{folder}{os.sep}"  # which is deleted when its warnings are read
        if result.failures:
            raise InputError("; ".join(result.failures).replace(here, ""))
        table = f"tracks/{file_name(case.tracker)}.csv"
        metrics: dict[str, Any] = {}
        if bag is not None:
            counts = track_counts(read_tracks(folder / table))
            metrics = {key: counts[key] for key in ("track_count", "tracks_per_frame")}
        elif result.metrics is None:
            raise RuntimeError(f"{recording} holds no truth")
        if result.metrics is not None:
            metrics = result.metrics["trackers"][case.tracker] | metrics
        evaluation = result.evaluations.get(case.tracker)
        own = result.tracker_warnings
        title = recording.name if bag is None else case.scenario
        files = [table, *(each for each in ("report.html", "metrics.json") if (folder / each).is_file())]
        return CaseResult(
            metrics=metrics,
            incidents=tuple(_incidents(evaluation, names)) if evaluation is not None else (),
            files={each: (folder / each).read_bytes() for each in files},
            renderer=NO_RENDERER,
            recording="" if bag is None else bag.digest[:_DIGEST],
            warnings=tuple(f"{title}: {each.replace(here, '')}" for each in result.warnings if each not in own),
            tracker_warnings=tuple(each.replace(here, "") for each in own),
        )


def _incidents(evaluation: Evaluation, names: Mapping[int, str]) -> list[Incident]:
    """List the worst second, then the events, people by `names`; stamps of a twin's recording count from its start."""
    incidents = []
    if evaluation.stamps_ns.size:
        t = evaluation.stamps_ns / NS_PER_S
        # Mean OSPA of each second's frames, from differences of the cumulative sum.
        total = np.concatenate([[0.0], np.cumsum(evaluation.ospa_m)])
        first = np.arange(t.size)
        last = np.searchsorted(t, t + _WINDOW_S, side="left")
        mean = (total[last] - total[first]) / (last - first)
        started = t >= t[0] + _START_S
        worst = int(np.argmax(np.where(started, mean, -1.0))) if started.any() else int(np.argmax(mean))
        middle_s = float(t[worst : last[worst]].mean())
        incidents.append(Incident(middle_s, WORST, f"OSPA {mean[worst]:.3f} m over a second", float(mean[worst])))
    incidents += [
        Incident(event.stamp_ns / NS_PER_S, event.kind, describe_event(event, names), 1.0)
        for event in evaluation.events[:_MOST_EVENTS]
    ]
    return incidents


_FILE = "motion.npz"


def cached_motion(cache: RecordingCache, scenario: Scenario) -> PrecomputedScene:
    """Load the scenario's motion from the cache, or compute it. Raises InputError as a simulation does."""

    def make(folder: Path) -> None:
        motion, late = precompute_people(scenario)
        motion.save(folder / _FILE)
        (folder / _WARNINGS).write_text(json.dumps(late), encoding="utf-8")

    with cache.recording(people_key(scenario), make) as (entry, _):
        return PrecomputedScene.of(scenario, PopulationMotion.load(entry / _FILE), _warnings_in(entry))


_PLACE_M = 1e-4
"""Resolution of positions in digests: coarser than the last bits on other processors, finer than any other walk."""

_ONE_SURFACE_M = 0.05
"""Difference of a beam's consecutive ranges beyond which they are of two surfaces."""


def people_digest(truth: Path) -> str:
    """Digest the positions of people in a `truth.csv`: at its first whole second, and overall; "" without any.

    Independent of sensors and of the people's names; the first part is independent of the duration too.
    """
    table = read_truth(truth)
    places = np.stack([table.x, table.y, table.head_x, table.head_y, table.head_z], axis=-1)
    rows = np.column_stack([table.stamps_ns, np.rint(places / _PLACE_M).astype(np.int64)])
    rows = rows[table.stamps_ns % NS_PER_S == 0]
    if not len(rows):
        return ""
    ordered = rows[np.lexsort(rows.T[::-1])]
    start = ordered[ordered[:, 0] == ordered[0, 0]]
    return "-".join(hashlib.sha256(np.ascontiguousarray(each).tobytes()).hexdigest()[:12] for each in (start, ordered))


def range_scatter_m(recording: Path, scenario: Scenario) -> dict[str, float]:
    """Compute each scanner's σ of a range [m], by its position, from consecutive scans where a beam meets one surface in
    both.

    Moving people add to it, equally in every recording of them. Scanners at one position count as one.
    """
    topics = {
        sensor_topic(name, SCAN): scanner_name(sensor.mount.xyz)
        for name, sensor in scenario.sensors.items()
        if sensor.kind == "laser"
    }
    scans: dict[str, list[Array]] = {topic: [] for topic in topics}
    with open_bag(recording) as bag:
        for topic, _, message in bag.messages(topics):
            scans[topic].append(np.array(message.ranges, dtype=np.float64))
    squares: dict[str, list[Array]] = {}
    for topic, ranges in scans.items():
        with np.errstate(invalid="ignore"):  # inf − inf where neither beam returns
            differences = [after - before for before, after in pairwise(ranges) if after.size == before.size]
        for each in differences:
            squares.setdefault(topics[topic], []).append(each[np.abs(each) < _ONE_SURFACE_M] ** 2)
    pooled = {place: np.concatenate(each) for place, each in squares.items()}
    return {place: float(np.sqrt(each.mean() / 2)) for place, each in pooled.items() if each.size}


def scanner_name(xyz: tuple[float, float, float]) -> str:
    """Name a scanner by its position [m, room frame]: names of sensors may differ between runs."""
    return "scanner at " + ", ".join(f"{value:g}" for value in xyz)
