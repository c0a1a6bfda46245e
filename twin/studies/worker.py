"""Evaluate one placement with one seed on a worker: simulate with cached motion, track, compute metrics."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from trackers.errors import PLUG_IN_ERRORS, InputError, PlugInError
from trackers.feeding import track_frames
from trackers.presets import PRESETS, make_tracker
from trackers.prior import Prior
from trackers.tracks import unused_sensors
from twin.evaluate import evaluate_with_details
from twin.evaluate.summary import Evaluation
from twin.messages import no_warning
from twin.recording.situation_table import situation_table
from twin.recording.tables import TruthTable, track_table, truth_table
from twin.run.inputs import ChosenTracker
from twin.run.tracker_runner import plug_in_fault
from twin.scenario import Scenario
from twin.streams import stream
from twin.suites.cache import RecordingCache
from twin.suites.cache_keys import Provenance, people_key, room_digest, whole_code
from twin.suites.metrics import flatten_metrics
from twin.suites.worker import cached_motion
from twin.truth.truth_types import Situation, TruthDetail, TruthFrame
from twin.world.body_pool import body_pools
from twin.world.simulation import Simulation
from twin.world.world import PoseCache, PrecomputedScene

DETAILED = ("disposal.", "errors.")
"""Metrics that need more truth than people's positions."""
_MOST_SCENES_KEPT = 6
"""Number of scenes with their people that a worker keeps compiled."""


_TIMING = {"rate_hz", "phase_s", "delay_s", "jitter_s", "dropout", "sweep_time_s", "motion_blur"}
"""Settings that determine the stamps at which people are sampled, and so the ticks of interpolation."""


@dataclass(frozen=True)
class EvaluationTask:
    """Placed scenario (seed included) to track, the cache of motions, and the digest of the code.

    details: True for the costly metrics of `DETAILED`, from situations of two people and visibility by sensor. made_from:
    its files' digests at the study's start (None: unknown).
    """

    scenario: Scenario
    trackers: tuple[ChosenTracker, ...]
    cache: RecordingCache
    code: str
    details: bool = False
    made_from: Provenance | None = None


@dataclass
class _CachedScene:
    """Compiled scene with its motion, for any placement; truth and, for scanners alone, poses by sensor timing."""

    precomputed: PrecomputedScene
    truth: dict[str, TruthTable] = field(default_factory=dict)
    pose_caches: dict[str, PoseCache] = field(default_factory=dict)


_scenes: OrderedDict[str, _CachedScene] = OrderedDict()


def _cached_scene(cache: RecordingCache, scenario: Scenario) -> _CachedScene:
    key = people_key(scenario)
    if key not in _scenes:
        _scenes[key] = _CachedScene(cached_motion(cache, scenario))
        if len(_scenes) > _MOST_SCENES_KEPT:
            _scenes.popitem(last=False)
    _scenes.move_to_end(key)
    return _scenes[key]


def _timing(scenario: Scenario) -> str:
    return repr([(name, each.model_dump(include=_TIMING)) for name, each in scenario.sensors.items()])


def evaluate_placement(work: EvaluationTask) -> tuple[dict[str, Evaluation], list[str]]:
    """Evaluate each tracker, by name; return the warnings of the scenario too.

    Raises InputError where the placement cannot be simulated or tracked, PlugInError where a tracker of the user's raises.
    """
    cached, scenario = _cached_scene(work.cache, work.scenario), work.scenario
    timing = _timing(scenario)
    frames: list[TruthFrame] = []
    situations: list[Situation] = []

    def tell(detail: TruthDetail) -> None:
        if isinstance(detail, Situation):
            situations.append(detail)

    known = timing in cached.truth and not work.details
    with Simulation(
        scenario,
        on_truth=None if known else frames.append,
        on_detail=tell if work.details else None,
        precomputed=cached.precomputed,
        shares=work.details,
    ) as simulation:
        if all(each.kind == "laser" for each in scenario.sensors.values()) and not work.details:
            scene = simulation.world.scene
            simulation.world.pose_cache = cached.pose_caches.get(timing) or PoseCache(scene.person_of_geom)
        prior = Prior.read(simulation.background(), scenario.prior, simulation.rig)
        observations, rig = list(simulation), simulation.rig
        warnings = [*simulation.warnings, *simulation.late()]
        if simulation.world.pose_cache is not None and len(body_pools(scenario.people)) == 1:
            cached.pose_caches[timing] = (
                simulation.world.pose_cache
            )  # complete: part of it would be asked for in another order
    truth = cached.truth[timing] if known else truth_table(frames)
    if not work.details:  # visibility depends on the placement
        cached.truth[timing] = truth
    pairs = situation_table(situations, scenario.name) if work.details else None
    found = {}
    for each in work.trackers:
        rng = stream(scenario.seed, "tracker", each.name)
        tracker = None
        try:
            tracker = make_tracker(each.target, rig, prior, rng, each.options)
            # what a placement lets a tracker drop is in its metrics
            tracks = track_table(track_frames(tracker, rig, observations, no_warning))
        except PLUG_IN_ERRORS as error:
            if each.target in PRESETS or (tracker is None and isinstance(error, InputError)):
                raise
            raise PlugInError(plug_in_fault(each, tracker, error)) from error
        found[each.name] = evaluate_with_details(truth, tracks, situations=pairs, unused=unused_sensors(tracker))
    return found, warnings


def _check_files(scenario: Scenario, made: Provenance) -> None:
    for what, now, before in (
        ("the room", room_digest(scenario.room), made.room),
        ("the prior files", scenario.prior.digest(), made.prior),
    ):
        if now != before:
            raise InputError(f"{what} changed after the study was started; --resume evaluates with what it is now")


@dataclass(frozen=True)
class Outcome:
    """The metrics of each tracker, by dotted path, with the warnings of the scenario; or an error."""

    metrics: Mapping[str, Mapping[str, float | None]] = field(default_factory=dict)
    error: str = ""
    warnings: tuple[str, ...] = ()


def evaluate_task(work: EvaluationTask) -> Outcome:
    """Return the metrics of each tracker, and the warnings of the scenario. Raises InputError for code of another version."""
    if work.code != whole_code():
        raise InputError(
            "the worker's code is not that of the study's process; the same version everywhere is expected"
        )
    if work.made_from is not None:
        _check_files(work.scenario, work.made_from)
    found, warnings = evaluate_placement(work)
    metrics = {name: flatten_metrics(each.metrics) for name, each in found.items()}
    if not work.details:
        metrics = {
            name: {key: each[key] for key in each if not key.startswith(DETAILED)} for name, each in metrics.items()
        }
    return Outcome(metrics, warnings=tuple(warnings))


def matched_errors(work: EvaluationTask, tracker: str) -> NDArray[np.float64]:
    """Return matched people (n, 3): x, y of the person [m] and the distance to their track [m]."""
    evaluation = evaluate_placement(work)[0][tracker]
    truth = _cached_scene(work.cache, work.scenario).truth[_timing(work.scenario)]
    keys = {(int(t), int(i)): row for row, (t, i) in enumerate(zip(truth.stamps_ns, truth.id, strict=True))}
    rows = [keys[int(t), int(i)] for t, i in zip(evaluation.match_stamps_ns, evaluation.match_person_ids, strict=True)]
    return np.column_stack([truth.x[rows], truth.y[rows], evaluation.match_distances_m])
