"""Results of `twin reproduce camera-floor-particle` from runs, and the suites it refuses."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from trackers.area import Pose
from trackers.camera_floor_particle.options import CameraFloorParticleOptions
from trackers.camera_floor_particle.tracker import DebugState
from trackers.cameras.intrinsics import PinholeIntrinsics
from trackers.errors import InputError
from trackers.observations import NS_PER_S, FloorFrame
from trackers.rig import FloorSensor, PinholeSensor, Rig, placed_camera
from trackers.tracks import Hypotheses, Track, TrackFrame
from trackers.vision.colour_bins import hsv_of
from trackers.vision.views import View, Views
from twin.report.floor_panel import TruePoses
from twin.reproduce.camera_floor_particle.reproduction import check_suite, head_errors_since_detection, heads_svg
from twin.reproduce.camera_floor_particle.results import (
    ABLATION,
    ABLATIONS,
    BASELINE,
    EXPERIMENTS,
    HOME,
    MOVEMENTS,
    NEEDED,
    OURS,
    PAIR,
    PAPER,
    PEOPLE,
    VARIANTS,
    closest_pair_s,
    draw_debug_state,
    frame_at,
    lowest_head_s,
    mask_quality,
    read_conditions,
    results_of,
    standing_people,
)
from twin.scenario import load_scenario
from twin.scenario.load import dump_scenario
from twin.suites.cache import RecordingCache
from twin.suites.spec import load_suite


def made_up(**of: float) -> dict[str, float | None]:
    figures: dict[str, float | None] = {
        "right_at_end": 1.0, "id_switches": 0, "lost_tracks": 0, "motp_m": 0.03, "body_height_error_m": None,
        "head_error_m.x": 0.01, "head_error_m.y": 0.02, "head_error_m.z": 0.03, "head_yaw_median_rad": np.pi / 18,
        "ms_per_frame.mean": 20.0,
    }  # fmt: skip
    return figures | of


def runs() -> Any:
    """Two seeds of every experiment; without the exclusion one of two pairs is wrong at the end."""
    by_condition, metrics = {}, {}
    for name in NEEDED:
        for seed in (1, 2):
            for tracker in (OURS, f"{OURS}-no-exclusion") if name == PAIR else (OURS, PAPER, BASELINE):
                case = SimpleNamespace(id=f"{name}-{seed}-{tracker}", seed=seed)
                by_condition.setdefault(name, {}).setdefault(seed, {})[tracker] = case
                metrics[case.id] = made_up(right_at_end=0.0 if "exclusion" in tracker and seed == 2 else 1.0)
                if tracker == BASELINE:
                    metrics[case.id] |= {f"head_error_m.{axis}": None for axis in "xyz"}
    return SimpleNamespace(by_condition=by_condition, metrics=metrics)


def test_results_hold_the_movements_together_the_papers_heads_and_paired_ablations():
    results = {(each.where, each.row, each.column): each for each in results_of(read_conditions(runs()))}
    together = results[EXPERIMENTS, "four movements, head x", "ours"]
    assert (together.ours, together.paper, together.runs) == (pytest.approx(0.01), 0.049, 2 * len(MOVEMENTS))
    assert together.paper_system is not None and together.paper_system.tracker == PAPER and together.baseline is None
    body = results[EXPERIMENTS, "four movements, body on the floor", "ours"]
    assert body.baseline is not None and (body.baseline.tracker, body.baseline.value) == (BASELINE, pytest.approx(0.03))
    assert results[EXPERIMENTS, f"{PAIR}, head x", "ours"].paper_system is None
    assert results[EXPERIMENTS, "crossing, pan, median", "ours"].ours == pytest.approx(10.0)
    assert results[EXPERIMENTS, f"{HOME}, head z", "ours"].paper == 0.045
    lost = results[ABLATION, f"without the exclusion ({PAIR})", "change of people right at the end"]
    assert lost.ours == pytest.approx(-50.0) and lost.ci95[0] == pytest.approx(-100.0)
    assert not any("height" in row for _, row, _ in results), "what no run has is left out"


def table(stamps_s, people) -> Any:
    """Rows of people (id, x, y, head z) at each stamp, as truth and tracks hold them."""
    rows = [(round(t * NS_PER_S), *row) for t, now in zip(stamps_s, people, strict=True) for row in now]
    stamps_ns, number, x, y, z = map(np.array, zip(*rows, strict=True))
    return SimpleNamespace(stamps_ns=stamps_ns, id=number, x=x, y=y, head_x=x, head_y=y, head_z=z)


def test_times_and_errors_are_found_in_tables():
    t = [1.0, 2.0, 3.0, 4.0, 5.0]
    truth = table(t, [[(1, k, 0.0, 1.6 - 0.1 * k), (2, 4.0 - 0.5 * k, 0.0, 1.7)] for k in range(5)])
    assert closest_pair_s(truth) == 5.0 and lowest_head_s(truth) == 5.0
    tracks = table(t[1:], [[(7, k + 0.1, 0.0, 1.6 - 0.1 * k)] for k in range(1, 5)])
    since, off = head_errors_since_detection(truth, tracks)
    np.testing.assert_allclose(since, [0, 1, 2, 3])
    np.testing.assert_allclose(off[0], [0.1, 0.0, 0.0], atol=1e-9)
    assert heads_svg([(since, off)]).startswith("<?xml")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"name": "elsewhere"}, "none is named crossing"),
        ({"trackers": ("floor-kalman",)}, f"crossing is run without {OURS}"),
    ],
)
def test_suites_without_the_experiments_are_refused(change, words):
    suite, path = load_suite(OURS)
    check_suite(suite, path)
    first, *others = suite.scenarios
    with pytest.raises(InputError, match=words):
        check_suite(suite.model_copy(update={"scenarios": [first.model_copy(update=change), *others]}), path)


def test_every_ablation_is_run_in_the_suite():
    entries = {entry.name or entry.scenario: entry for entry in load_suite(OURS)[0].scenarios}
    for condition, _, tracker, _ in ABLATIONS:
        assert {OURS, tracker} <= set(entries[condition].trackers or ()), condition


def test_as_many_people_stand_as_time_is_taken_of():
    assert [len(standing_people(n).people) for n in (0, *PEOPLE)] == [0, *PEOPLE]


@pytest.mark.parametrize("change", VARIANTS.values(), ids=VARIANTS)
def test_every_choice_is_one_of_the_tracker(change):
    assert (CameraFloorParticleOptions.model_validate(change) == CameraFloorParticleOptions()) == (not change)


def test_frames_are_drawn_with_masks_particles_floor_and_truth():
    lens = PinholeIntrinsics(width=120, height=90, fx=80, fy=80, cx=59.5, cy=44.5)
    camera = PinholeSensor(
        topic="/camera/image", room_from_sensor=Pose(xyz=(0, 0, 2), rpy=(-1.9, 0, 0)), intrinsics=lens
    )
    grid = FloorSensor(topic="/floor", room_from_sensor=Pose(xyz=(-1, 0, 0)), rows=10, columns=10, pitch_m=0.2)
    rig = Rig(sensors={"camera": camera, "floor": grid}, area=((-1, 0), (1, 0), (1, 2), (-1, 2)))
    mask = np.zeros((90, 120), np.bool_)
    mask[40:70, 50:70] = True
    grey = np.full((90, 120, 3), 90, np.uint8)
    floors = {"floor": FloorFrame("floor", 0, np.full((10, 10), 200, np.uint8))}
    truth = TruePoses(np.array([1]), np.array([[0.0, 1.0]]), np.zeros(1))
    cloud = Hypotheses(1, np.array([[0.3, 1.5, 1.0]]), lambda _: (50.0, 40.0, 20.0, 30.0))

    def sides(mask, maps, floors):
        views = Views([View(0, placed_camera(camera), grey, hsv_of(grey), mask)])
        frame = TrackFrame(0, (Track(1, 0.0, 1.0),), maps)
        jpeg = draw_debug_state(DebugState(views, None, None), frame, rig, floors, truth)
        drawn = np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR), np.int16)
        return drawn[:, :1280], drawn[:, 1280:]

    def same(one, other):
        return bool((np.abs(one - other) < 60).all())

    left, right = sides(mask, (cloud,), floors)
    for others, is_left, is_right in (
        (sides(np.zeros_like(mask), (cloud,), floors), False, True),
        (sides(mask, (), floors), False, False),
        (sides(mask, (cloud,), {}), True, False),
    ):
        assert (same(left, others[0]), same(right, others[1])) == (is_left, is_right)
    with pytest.raises(ValueError, match="no camera"):
        draw_debug_state(DebugState(Views(()), None, None), TrackFrame(0, ()), rig, {}, truth)


@pytest.mark.parametrize("shadows", [False, True])
def test_foreground_is_people_with_shadows_and_without(shadows, tmp_path):
    change = ["rendering={shadows: true, samples: 2}"] if shadows else []
    scenario = load_scenario("movements-crossing", ["duration_s=0.3", "seed=3", *change])
    case: Any = SimpleNamespace(id="a case", resolved=dump_scenario(scenario))
    recall, precision = mask_quality(case, RecordingCache(tmp_path, 2**30))
    assert 0.95 < recall <= 1
    assert 0.8 < precision <= 1


@pytest.mark.parametrize(("at_s", "stamp_ns"), [(0.0, 1), (2e-9, 2), (3e-9, 3), (9.0, 3)])
def test_a_picture_shows_the_frame_of_its_time_or_the_last_one_that_a_tracker_holds_back(at_s: float, stamp_ns: int):
    """A tracker reports two frames of three late, the last one at the end."""
    frames = [[], [TrackFrame(1, ())], [TrackFrame(2, ())], []]
    tracker: Any = SimpleNamespace(update=lambda each: frames[each], finish=lambda: [TrackFrame(3, ())])
    assert frame_at(tracker, range(4), at_s).stamp_ns == stamp_ns  # pyright: ignore[reportArgumentType]
