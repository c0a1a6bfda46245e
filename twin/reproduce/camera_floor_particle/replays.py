"""Recordings replayed through the tracker, with changed options or up to one drawn frame."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from trackers.camera_floor_particle.tracker import DebugState
from trackers.observations import NS_PER_S, FloorFrame, Image
from trackers.presets import make_tracker
from trackers.prior import Prior
from trackers.rig import Rig
from trackers.tracks import TrackFrame
from twin.evaluate import evaluate_tracks
from twin.messages import OnProgress
from twin.recording.reader import Recording
from twin.recording.tables import TruthTable, read_truth, track_table
from twin.report.camera_panel import CameraGrid
from twin.report.floor_panel import FloorPanel, TruePoses
from twin.report.palette import IdentityColours, encode_jpeg
from twin.reproduce.camera_floor_particle.results import OURS
from twin.reproduce.results import ResultRow
from twin.reproduce.suite_runs import case_recording
from twin.scenario import Scenario, load_scenario
from twin.streams import stream
from twin.suites.cache import RecordingCache
from twin.suites.expansion import Case
from twin.suites.worker import RECORDING, TRUTH, scenario_recording

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
        floors, frames = {}, []
        for observation in bag.observations():
            frames = tracker.update(observation)
            if frames and frames[-1].stamp_ns >= t_s * NS_PER_S:
                break
            if isinstance(observation, FloorFrame):
                floors[observation.sensor] = observation
        return draw_debug_state(tracker.debug_state(), frames[-1], bag.rig, floors, _poses(entry / TRUTH, t_s))


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
    colours = IdentityColours()
    colours.add(sorted(track.id for track in frame.tracks))
    left = np.empty((_SIDE_PX, _SIDE_PX, 3), np.uint8)
    CameraGrid(rig.cameras(), (_SIDE_PX, _SIDE_PX)).draw(left, images, frame.tracks, colours, maps=frame.maps)
    right = np.empty_like(left)
    tails = {track.id: [(frame.stamp_ns, track.x, track.y)] for track in frame.tracks}
    FloorPanel(rig, (), _SIDE_PX, _SIDE_PX).draw(
        right, {}, {}, frame.tracks, tails, colours, truth, {}, floors, maps=frame.maps
    )
    return encode_jpeg(np.hstack([left, right]), _QUALITY)


def _outlined(rgb: np.ndarray, mask: np.ndarray) -> np.ndarray:
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    return cv2.drawContours(rgb.copy(), outlines, -1, _MASK, 1)
