"""Results of every condition with the paper's values where printed, and ablations paired by run.

Recordings are replayed through the tracker, with changed options or up to one drawn frame.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.area import Area
from trackers.camera_floor_particle.tracker import DebugState
from trackers.observations import NS_PER_S, FloorFrame, Image, Observation
from trackers.presets import make_tracker
from trackers.prior import Prior
from trackers.rig import Rig
from trackers.tracks import TrackFrame
from trackers.vision.front_end import FrontEndOptions, front_ends
from trackers.vision.views import CameraViews
from twin.evaluate import evaluate_tracks
from twin.messages import OnProgress
from twin.recording.reader import Recording
from twin.recording.tables import TruthTable, read_truth, track_table
from twin.report.birdseye import Site
from twin.report.camera_panel import CameraGrid
from twin.report.floor_panel import FloorPanel, PreviewFrame, TruePoses
from twin.report.palette import IdentityColours, encode_jpeg
from twin.reproduce.results import ResultRow, SystemValue
from twin.reproduce.suite_runs import Condition, SuiteRuns, metric_arrays
from twin.scenario import Scenario, load_scenario
from twin.streams import stream
from twin.suites.cache import RecordingCache
from twin.suites.expansion import Case
from twin.suites.worker import RECORDING, TRUTH, case_recording, resolved_scenario, scenario_recording
from twin.world.simulation import Simulation

OURS, PAPER, BASELINE = "camera-floor-particle", "camera-floor-particle-paper", "floor-kalman"
MOVEMENTS = ("crossing", "turning", "going-around", "going-back")
COURSE, HOME, PAIR = "straight-course", "home", "pair"
NEEDED = (*MOVEMENTS, COURSE, HOME, PAIR)
EXPERIMENTS, BEYOND, ABLATION = "experiments", "beyond the paper", "beyond the paper, ablations"
RIGHT = "people right at the end"
_STREAM = "camera-floor bootstrap"

_MEANS = (
    (RIGHT, "right_at_end", 100.0, "%"),
    ("identity switches", "id_switches", 1.0, "/run"),
    ("people lost", "lost_tracks", 1.0, "/run"),
    ("body on the floor", "motp_m", 1.0, "m"),
    ("body, height", "body_height_error_m", 1.0, "m"),
    ("head x", "head_error_m.x", 1.0, "m"),
    ("head y", "head_error_m.y", 1.0, "m"),
    ("head z", "head_error_m.z", 1.0, "m"),
    ("pan, median", "head_yaw_median_rad", 180 / np.pi, "°"),
    ("time per frame", "ms_per_frame.mean", 1.0, "ms"),
)
_PAPER_HEAD = {"head x": 0.049, "head y": 0.054, "head z": 0.045}
ABLATIONS = (
    ("three-black-cameras", "without the floor", "camera-floor-particle-colour", RIGHT),
    (HOME, "without the cameras", "camera-floor-particle-floor", "body on the floor"),
    (PAIR, "without the exclusion", "camera-floor-particle-no-exclusion", RIGHT),
    ("pair-by-one-camera", "without the exclusion", "camera-floor-particle-no-exclusion", RIGHT),
    (HOME, "without the mixture", "camera-floor-particle-no-mixture", "head z"),
    (HOME, "all rules the paper's", PAPER, RIGHT),
)
"""Ablations: condition, omitted part, preset, and the metric affected."""


def read_conditions(runs: SuiteRuns) -> dict[str, Condition]:
    """Collect every condition of the suite by name."""
    return {
        name: Condition(name, tuple(by_seed), metric_arrays(by_seed.values(), runs.metrics))
        for name, by_seed in runs.by_condition.items()
    }


def results_of(conditions: Mapping[str, Condition]) -> list[ResultRow]:
    """Compute every result: the four movements together, then each condition, then ablations."""
    movements = [conditions[name] for name in MOVEMENTS]
    by_all = [tracker for tracker in movements[0].metrics if all(tracker in each.metrics for each in movements)]
    together = Condition(
        "four movements",
        tuple(seed for each in movements for seed in each.seeds),
        {
            tracker: {
                key: np.concatenate([each.metrics[tracker][key] for each in movements]) for _, key, _, _ in _MEANS
            }
            for tracker in by_all
        },
    )
    found = list(_means(together, EXPERIMENTS))
    for name, condition in conditions.items():
        found += _means(condition, EXPERIMENTS if name in NEEDED else BEYOND)
    return found + list(_ablations(conditions))


def tracker_label(tracker: str) -> str:
    """Shorten a tracker's name for tables."""
    return "ours" if tracker == OURS else tracker.removeprefix(f"{OURS}-")


def _means(condition: Condition, where: str) -> Iterator[ResultRow]:
    has_paper = where == EXPERIMENTS and condition.name not in (COURSE, PAIR)
    draws = condition.seeds[0], _STREAM
    for tracker, metrics in condition.metrics.items():
        for row, key, times, unit in _MEANS:
            paper, others = None, []
            if tracker == OURS:
                paper = _PAPER_HEAD.get(row) if has_paper else None
                others = [
                    SystemValue.mean(each, times * condition.metrics[each][key], *draws)
                    if each in condition.metrics
                    else None
                    for each in (PAPER, BASELINE)
                ]
            name, column = f"{condition.name}, {row}", tracker_label(tracker)
            yield from ResultRow.of_runs(where, name, column, times * metrics[key], unit, *draws, paper, *others)


def _ablations(conditions: Mapping[str, Condition]) -> Iterator[ResultRow]:
    """Compute the effect of omitting a part, paired by run: the metric without less the metric with."""
    units = {row: (key, times, unit) for row, key, times, unit in _MEANS}
    for name, what, tracker, row in ABLATIONS:
        condition = conditions.get(name)
        if condition is None or tracker not in condition.metrics:
            continue
        key, times, unit = units[row]
        change = times * (condition.metrics[tracker][key] - condition.metrics[OURS][key])
        label, column = f"{what} ({name})", f"change of {row}"
        yield from ResultRow.of_runs(ABLATION, label, column, change, unit, condition.seeds[0], _STREAM)


SHOWN = ("crossing", "shadows")
"""Conditions that differ only in shadows."""
_EVERY_S = 0.5


def mask_results(runs: SuiteRuns) -> list[ResultRow]:
    """Measure recall and precision of foreground pixels in the first run of each condition, all cameras together."""
    found = []
    for name in SHOWN:
        if name not in runs.by_condition:
            continue
        case = next(iter(runs.first_cases(name).values()))
        recall, precision = mask_quality(case, runs.cache)
        for row, share in (("of people's pixels, foreground", recall), ("of foreground, people's", precision)):
            value = 100 * share
            found.append(ResultRow(BEYOND, f"{name}, {row}", "ours", None, value, (value, value), "%", 1))
    return found


def mask_quality(case: Case, cache: RecordingCache) -> tuple[float, float]:
    """Compute the share of people's pixels in the foreground, and of the foreground on people."""
    both = people = found = 0
    with case_recording(case, cache) as entry, Simulation(resolved_scenario(case)) as simulation:
        for image, mask in _foreground(entry / RECORDING):
            true = simulation.person_images(image.stamp_ns / NS_PER_S)[image.sensor] > 0
            both, people, found = both + (mask & true).sum(), people + true.sum(), found + mask.sum()
    return float(both / people), float(both / found)


def _foreground(path: Path) -> Iterator[tuple[Image, NDArray[np.bool_]]]:
    """Yield the tracker's foreground in each camera's image, one per half second."""
    bag = Recording(path)
    area = None if bag.rig.area is None else Area(bag.rig.area)
    cameras = CameraViews(front_ends(bag.rig.cameras(), list(bag.background), FrontEndOptions(), area))
    last_ns: dict[str, int] = {}
    for image in bag.observations():
        if isinstance(image, Image) and image.stamp_ns - last_ns.get(image.sensor, -NS_PER_S) >= _EVERY_S * NS_PER_S:
            last_ns[image.sensor] = image.stamp_ns
            for view in cameras.views({image.sensor: image}):
                yield image, view.mask


CHOICE, TIME = "beyond the paper, choice", "beyond the paper, time"
SEED = 1000
"""Development seed, by which the constants that the paper does not give were chosen."""
_SCENARIO = "movements-crossing"
PEOPLE = (1, 3, 6, 10)
_STANDING_S = 4
_STARTS = [*((x, y) for y in (-0.2, -1.15, 0.7) for x in (-1.35, -0.35, 0.55)), (1.3, -1.15)]
VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "as chosen": {},
    "λ of the body 7": {"body": {"colour": 7.0}},
    "λ of the body 30": {"body": {"colour": 30.0}},
    "λ of the head 15": {"head": {"colour": 15.0}},
    "λ of the head 60": {"head": {"colour": 60.0}},
    "α 0.1": {"head": {"share": 0.1}},
    "α 0.6": {"head": {"share": 0.6}},
    "half of ω": {"body": {"motion": {"still_m": 0.012, "per_speed_s": 0.025}}},
    "twice ω": {"body": {"motion": {"still_m": 0.05, "per_speed_s": 0.1}}},
    "strides 3 and 2": {"body": {"window": {"stride": 3}}, "head": {"window": {"stride": 2}}},
    "strides 8 and 6": {"body": {"window": {"stride": 8}}, "head": {"window": {"stride": 6}}},
    "half the particles": {"body": {"particles": 125}, "head": {"particles": 75}},
    "twice the particles": {"body": {"particles": 500}, "head": {"particles": 300}},
    "the paper's references of the pan": {"head": {"facing": None, "references": "nearest"}},
}


def standing_people(n_person: int, duration_s: float = _STANDING_S) -> Scenario:
    """Make a scenario of up to ten standing people in the room of the home scene."""
    people = ", ".join(
        f"p{k}: {{start: [{x}, {y}], script: {{kind: stand}}}}" for k, (x, y) in enumerate(_STARTS[:n_person])
    )
    removed = "anna: null, ben: null, cleo: null"
    change = f"people={{{removed}{', ' if people else ''}{people}}}"
    return load_scenario("home-cameras", [f"duration_s={duration_s}", f"seed={SEED}", change])


def compare_choices(cache: RecordingCache, on_progress: OnProgress) -> list[ResultRow]:
    """Replay development recordings: one per choice of the constants, and one per number of people."""
    crossing = load_scenario(_SCENARIO, [f"seed={SEED}"])
    runs = [(CHOICE, name, crossing, change) for name, change in VARIANTS.items()]
    runs += [(TIME, f"{n} {'person' if n == 1 else 'people'}", standing_people(n), {}) for n in PEOPLE]
    found = []
    for number, (where, name, scenario, change) in enumerate(runs):
        on_progress("choices of the constants, and time by people", number, len(runs))
        with scenario_recording(scenario, cache) as entry:
            found += _evaluate(where, name, change, Recording(entry / RECORDING), read_truth(entry / TRUTH))
    return found


def _evaluate(where: str, name: str, change: Mapping[str, Any], bag: Recording, truth: TruthTable) -> list[ResultRow]:
    """Measure errors of body, head and pan, and CPU time per frame."""
    tracker: Any = make_tracker(OURS, bag.rig, Prior.of(bag.background), stream(SEED, "tracker", OURS), change)
    frames: list[TrackFrame] = []
    spent = 0.0
    for observation in bag.observations():
        start = time.process_time()
        frames += tracker.update(observation)
        spent += time.process_time() - start
    frames += tracker.finish()
    metrics = evaluate_tracks(truth, track_table(frames))
    head_m = float(np.mean([metrics["head_error_m"][axis] for axis in "xyz"]))
    columns = (
        ("body on the floor", metrics["motp_m"], "m"),
        ("head, mean of the axes", head_m, "m"),
        ("pan, median", float(np.degrees(metrics["head_yaw_median_rad"])), "°"),
        ("CPU time per frame", 1e3 * spent / len(frames), "ms"),
    )
    return [ResultRow(where, name, column, None, value, (value, value), unit, 1) for column, value, unit in columns]


def frame_picture(case: Case, cache: RecordingCache, t_s: float) -> bytes:
    """Draw the tracker's debug state at one time of a case as a JPEG (`draw_debug_state`)."""
    with case_recording(case, cache) as entry:
        bag = Recording(entry / RECORDING)
        tracker: Any = make_tracker(OURS, bag.rig, Prior.of(bag.background), stream(case.seed, "tracker", OURS), None)
        floors: dict[str, FloorFrame] = {}
        frame = frame_at(tracker, _kept(bag.observations(), floors), t_s)
        return draw_debug_state(tracker.debug_state(), frame, bag.rig, floors, _poses(entry / TRUTH, t_s))


def frame_at(tracker: Any, observations: Iterable[Observation], t_s: float) -> TrackFrame:
    """Track up to a time; return the frame of that look, or the last one where the observations end before.

    Raises IndexError where the tracker has no frame at all.
    """
    frames: list[TrackFrame] = []
    for observation in observations:
        frames += tracker.update(observation)
        if frames and frames[-1].stamp_ns >= t_s * NS_PER_S:
            break
    else:
        frames += tracker.finish()
    return frames[-1]


def _kept(observations: Iterable[Observation], floors: dict[str, FloorFrame]) -> Iterator[Observation]:
    """Yield observations, and keep the floors' newest."""
    for each in observations:
        yield each
        if isinstance(each, FloorFrame):
            floors[each.sensor] = each


_START_S = 1.5


def closest_pair_s(truth: TruthTable) -> float:
    """Find the time of the least distance between two people, after the start [s]."""
    best, at = np.inf, _START_S
    for stamp in np.unique(truth.stamps_ns)[::4]:
        now = truth.stamps_ns == stamp
        places = np.column_stack([truth.x[now], truth.y[now]])
        places = places[~np.isnan(places).any(axis=1)]
        away = np.linalg.norm(places[:, None] - places, axis=-1) + 9.0 * np.eye(len(places))
        if stamp >= _START_S * 1e9 and away.size and away.min() < best:
            best, at = away.min(), stamp / 1e9
    return float(at)


def lowest_head_s(truth: TruthTable) -> float:
    """Find the time of the lowest head [s]."""
    return float(truth.stamps_ns[np.nanargmin(truth.head_z)] / 1e9)


def _poses(path: Path, t_s: float) -> TruePoses:
    """Read the true positions nearest to a time, with the yaw of the heads, as the tracker estimates them."""
    truth = read_truth(path)
    now = truth.stamps_ns == truth.stamps_ns[np.abs(truth.stamps_ns - t_s * NS_PER_S).argmin()]
    return TruePoses(truth.id[now], np.column_stack([truth.x, truth.y])[now], truth.head_yaw[now])


_SIDE_PX = 1280
_QUALITY = 86
_MASK = (255, 255, 255)


def draw_debug_state(
    state: DebugState,
    frame: TrackFrame,
    rig: Rig,
    floors: Mapping[str, FloorFrame],
    truth: TruePoses,
) -> bytes:
    """Draw one frame as the preview does, enlarged, with the outline of each view's foreground in white; a JPEG.

    Figures 2, 4 and 5 of Mori et al. Raises ValueError where no camera has a view in that frame.
    """
    if not len(state.views):
        raise ValueError("no camera has a view in that frame")
    cameras = list(rig.cameras())
    images = {
        cameras[view.number]: Image(cameras[view.number], frame.stamp_ns, _outlined(view.rgb, view.mask))
        for view in state.views
    }
    shown = PreviewFrame({**images, **floors}, frame.tracks, truth, maps=frame.maps)
    colours = IdentityColours()
    colours.add(sorted(track.id for track in frame.tracks))
    left = np.empty((_SIDE_PX, _SIDE_PX, 3), np.uint8)
    CameraGrid(rig.cameras(), (_SIDE_PX, _SIDE_PX)).draw(left, shown, colours)
    right = np.empty_like(left)
    FloorPanel(Site(rig), _SIDE_PX, _SIDE_PX).draw(right, shown, colours)
    return encode_jpeg(np.hstack([left, right]), _QUALITY)


def _outlined(rgb: np.ndarray, mask: np.ndarray) -> np.ndarray:
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    return cv2.drawContours(rgb.copy(), outlines, -1, _MASK, 1)
