"""What the feet carry: the body's own motion, shaped like published ground reaction forces."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from led_bodies import TICK_S, Course, lead, stances, steady

from twin.people.body.appearance import appearance_of
from twin.people.body.person_spec import JOINT_PLACE, person_spec
from twin.people.gait.gait_state import FEET_HEIGHT, FEET_PITCH, FEET_YAW, ROWS, foot_loads
from twin.people.gait.gait_table import GaitTable
from twin.scenario.person import Person

STATURES = (1.3, 1.55, 1.75, 1.95)
_USUAL = 2  # the person of 1.75 m
WALKS = (0.8, 1.0, 1.2, 1.35, 1.5, 1.8)
RUNS = (2.5, 3.0, 4.0, 5.0)
MEASURED = Path(__file__).parents[5] / "shared" / "data" / "gait" / "subject01_walk1_grf.mot"


@pytest.fixture(scope="module", params=WALKS)
def walk(request) -> tuple[float, Course]:
    return request.param, steady(request.param, STATURES)


@pytest.fixture(scope="module", params=RUNS)
def run(request) -> tuple[float, Course]:
    return request.param, steady(request.param, STATURES)


@pytest.fixture(scope="module", params=WALKS[::2] + RUNS[::2])
def gait(request) -> Course:
    return steady(request.param, STATURES)


def strides(course: Course, person: int, foot: int = 0) -> slice:
    """From a foot's first landing to its last."""
    starts = [each.start for each in stances(course.load[:, foot, person] > 0)]
    return slice(starts[0], starts[-1])


def test_who_stands_weighs_one_and_sways_a_little():
    course = lead(lambda t: 0.0, STATURES, 20.0)
    np.testing.assert_allclose(course.load.sum(axis=1), 1.0, atol=0.005)
    assert (np.abs(course.load - 0.5) < 0.06).all()
    assert (np.ptp(course.load[:, 0], axis=0) > 0.005).all()
    assert (np.ptp(course.ahead, axis=0) < 0.012).all()


def test_the_mean_load_of_a_walk_is_one_body_weight(walk):
    _, course = walk
    for person in range(len(STATURES)):
        assert course.load[strides(course, person), :, person].sum(axis=1).mean() == pytest.approx(1.0, abs=0.01)


def test_the_mean_load_of_a_run_is_one_body_weight(run):
    _, course = run
    for person in range(len(STATURES)):
        assert course.load[strides(course, person), :, person].sum(axis=1).mean() == pytest.approx(1.0, abs=0.02)


def test_a_walker_stands_for_three_fifths_of_the_stride(walk):
    _, course = walk
    for person in range(len(STATURES)):
        # as a floor reads it, between the ticks too
        t = np.arange(course.t[0], course.t[-1], TICK_S / 10)
        stands = np.interp(t, course.t, course.load[:, 0, person]) > 0.02
        starts = [each.start for each in stances(stands)]
        assert 0.58 < stands[starts[0] : starts[-1]].mean() < 0.66


@pytest.mark.parametrize("speed", [1.2, 1.35, 1.5])
def test_a_foot_has_two_humps_in_a_natural_walk(speed):
    course = steady(speed, STATURES)
    for person in range(len(STATURES)):
        for foot in range(2):
            for stance in stances(course.load[:, foot, person] > 0):
                load = course.load[stance, foot, person]
                third = len(load) // 3
                assert 1.05 < load[: len(load) // 2].max() <= 1.25
                assert 1.05 < load[len(load) // 2 :].max() < 1.25
                assert 0.65 < load[third:-third].min() < 0.9


def test_a_running_foot_has_one_hump_and_then_both_are_in_the_air(run):
    _, course = run
    for person in range(len(STATURES)):
        for foot in range(2):
            for stance in stances(course.load[:, foot, person] > 0):
                load = course.load[stance, foot, person]
                assert 2.0 <= load.max() <= 2.8
                rising = np.diff(load) > 0
                assert np.count_nonzero(np.diff(rising.astype(int))) == 1
        whole = strides(course, person)
        assert (course.load[whole, 0, person] > 0).mean() < 0.45
        flight = course.load[whole, :, person].sum(axis=1) == 0
        assert 0.15 < flight.mean() < 0.45
        assert (course.height[whole, :, person][flight] >= 0).all()


def test_the_load_travels_from_heel_to_toe(gait):
    # as a floor reads it, between the ticks too
    t = np.arange(gait.t[0], gait.t[-1], TICK_S / 10)
    for person, length in enumerate(gait.skeleton.shoe):
        load = np.interp(t, gait.t, gait.load[:, 0, person])
        ahead = np.interp(t, gait.t, gait.ahead[:, 0, person]) / length
        heel = gait.skeleton.heel[person] / length
        found = stances(load > 0.03)
        assert len(found) >= 3
        for stance in found:
            assert ahead[stance.stop - 1] - ahead[stance.start] > 0.6
            assert (np.diff(ahead[stance]) >= -1e-9).all()
            assert (ahead[stance] > -heel).all()
            assert (ahead[stance] < 1 - heel).all()


@pytest.mark.parametrize("person", range(len(STATURES)))
def test_the_point_of_load_rolls_as_under_measured_walkers(person):
    """Pressure plates of ten people: 0.24, 0.30, 0.41 and 0.57 of the foot at 20, 30, 40 and 50 % of the stance."""
    course = steady(1.2, STATURES)
    t = np.arange(course.t[0], course.t[-1], TICK_S / 10)
    load = np.interp(t, course.t, course.load[:, 0, person])
    ahead = np.interp(t, course.t, course.ahead[:, 0, person])
    share = (ahead + course.skeleton.heel[person]) / course.skeleton.shoe[person]
    whole = np.linspace(0, 1, 11)
    found = stances(load > 0.02)
    points = np.mean([np.interp(whole, np.linspace(0, 1, len(share[each])), share[each]) for each in found], axis=0)
    np.testing.assert_allclose(points[[2, 3, 4, 5]], [0.24, 0.30, 0.41, 0.57], atol=0.02)
    assert (points[0], points[-1]) == (pytest.approx(0.06, abs=0.03), pytest.approx(0.96, abs=0.03))


@pytest.mark.parametrize("speed", [0.8, 1.0, 1.35, 1.5, 2.0])
def test_a_walker_s_heel_comes_up_once_the_load_is_on_the_ball(speed):
    course = steady(speed, STATURES)
    share = (course.ahead + course.skeleton.heel) / course.skeleton.shoe
    up = (course.load > 0.05) & (course.rows[:, FEET_PITCH] > 0.1)
    assert up.any()
    # the heads of the metatarsals lie between 0.6 and 0.75 of a shoe
    assert share[up].min() > 0.62


@pytest.mark.parametrize("speed", [0.8, 1.0, 1.2, 1.5, 1.8])
def test_the_load_acts_under_the_body_in_the_mean(speed):
    """Else the body would tip over: what carries it must lie, over whole strides, where its weight is."""
    course = steady(speed, STATURES)
    whole = strides(course, _USUAL)
    point = (course.place.real + course.ahead - course.coordinates[:, None, :, 0])[whole, :, _USUAL]
    load = course.load[whole, :, _USUAL]
    assert abs((point * load).sum() / load.sum()) < 0.033


@pytest.mark.parametrize("speed", [1.2, 1.5, 1.8])
def test_steps_take_as_long_as_their_table_says(speed):
    course = steady(speed, STATURES)
    starts = [each.start for each in stances(course.load[:, 0, _USUAL] > 0)]
    stride = np.diff(course.t[starts]).mean()
    table = GaitTable(course.skeleton)
    # feet that are left too far behind would hurry
    assert stride == pytest.approx(
        2 * table.at(table.similar(np.full(len(STATURES), speed))).step_time[_USUAL], rel=0.01
    )


def test_the_load_is_the_pelvis_s_own_motion(gait):
    course = gait
    height = course.coordinates[:, :, 2]
    felt = 1 + np.diff(height, 2, axis=0) / TICK_S**2 / 9.81
    off = np.abs(felt - course.load.sum(axis=1)[1:-1])
    assert np.median(off) < 1e-9
    assert (off < 0.02).mean() > 0.97


def test_feet_in_the_air_carry_nothing(gait):
    assert gait.load[gait.rows[:, FEET_HEIGHT] > 1e-6].max() < 0.02


TRANSITIONS = {
    "start and stop": (lambda t: np.interp(t, [1, 1.4, 3, 3.4], [0, 1.3, 1.3, 0]), lambda t: 0.0),
    "walk to run and back": (lambda t: np.interp(t, [0, 1, 2, 5, 6, 9], [0, 1.3, 1.3, 4, 4, 1.0]), lambda t: 0.0),
    "run and stop": (lambda t: np.interp(t, [0, 1.2, 3, 4], [0, 4, 4, 0]), lambda t: 0.0),
    "turn on the spot": (lambda t: 0.0, lambda t: 2.5 if 1 < t < 3 else -2.0 if 4 < t < 6 else 0.0),
    "curve": (lambda t: np.interp(t, [0, 1], [0, 1.3]), lambda t: 1.0 if 2 < t < 4 else -1.5 if 5 < t < 8 else 0.0),
    "sideways": (lambda t: 1j * np.interp(t, [0, 0.5, 4, 5, 5.5], [0, 0.6, 0.6, 0, -0.6]), lambda t: 0.0),
    "backwards": (lambda t: np.interp(t, [0, 0.5, 4, 4.4], [0, -0.8, -0.8, 0]), lambda t: 0.0),
}


@pytest.mark.parametrize("name", TRANSITIONS)
def test_changes_keep_loads_and_joints_continuous(name):
    velocity, turn_rate = TRANSITIONS[name]
    course = lead(velocity, STATURES, 9.0, turn_rate)
    total = course.load.sum(axis=1)
    runs = "run" in name
    assert np.isfinite(course.rows).all()
    assert course.load.min() >= 0
    assert total.max() < (2.8 if runs else 1.5)
    # a runner's load rises by 2.5 body weights in 0.1 s
    assert np.abs(np.diff(course.load, axis=0)).max() < (2.0 if runs else 0.7)
    assert course.load[course.rows[:, FEET_HEIGHT] > 1e-6].max() < 0.03
    speeds = np.abs(np.diff(course.coordinates[:, :, 7:], axis=0)) / TICK_S
    assert speeds.max() < (30.0 if runs else 20.0)
    knees = course.coordinates[:, :, [JOINT_PLACE["left_knee"], JOINT_PLACE["right_knee"]]]
    assert knees.min() > 0.1
    assert course.lowered.max() < 0.045
    assert total[-1] == pytest.approx(1.0, abs=0.01) or abs(velocity(9.0)) > 0


@pytest.mark.parametrize("speed", [0.4, 0.8, 1.35, 2.0, 2.5, 4.0, 5.0])
def test_adults_joints_turn_as_fast_as_peoples(speed):
    course = steady(speed, STATURES)
    speeds = np.abs(np.diff(course.coordinates[:, 1:, 7:], axis=0)) / TICK_S
    assert speeds.max() < (18.0 if speed < 2.3 else 27.0)
    assert course.lowered[:, 1:].max() < 0.005


@pytest.mark.parametrize("velocity", [0.5, 1.3, 2.0, 3.0, 4.5, 0.6j, -0.8, 0.6 + 0.4j])
def test_the_ball_of_a_loaded_foot_stays_where_it_is(velocity):
    course = lead(lambda t: velocity * min(t / 1.2, 1.0), (1.75,), 7.0).after(2.0)
    looks = appearance_of(Person(height_m=1.75), np.random.default_rng(0))
    model = person_spec(looks).compile()
    data = mujoco.MjData(model)
    ball = np.zeros((len(course.t), 2, 3))
    for tick, coordinates in enumerate(course.coordinates[:, 0]):
        data.qpos[:] = coordinates
        mujoco.mj_kinematics(model, data)
        ball[tick] = [data.body(f"{side}_toes").xpos for side in ("left", "right")]
    flat = (course.load[:, :, 0] > 0.05) & (course.rows[:, FEET_PITCH, 0] >= 0)
    slips = [
        np.linalg.norm(ball[stance, foot] - ball[stance.start, foot], axis=1).max()
        for foot in range(2)
        for stance in stances(flat[:, foot])
    ]
    assert len(slips) >= 6
    assert max(slips) < 0.005


def test_who_sits_takes_no_steps():
    course = lead(lambda t: -0.5 if 2 < t < 2.5 else 0.0, STATURES, 4.0, still=lambda t: np.full(4, t > 1.0))
    assert np.ptp(course.place.real, axis=0).max() == 0
    assert np.ptp(course.rows[:, FEET_HEIGHT.start : FEET_YAW.stop], axis=0).max() == 0


@pytest.mark.parametrize("speed", [0.0, 0.5, 1.3, 3.5])
def test_who_enters_is_in_stride(speed):
    """Half of the people are put elsewhere at three seconds; the others do not feel it."""

    def enter(t, led, gait):
        if abs(t - 3.0) < 1e-9:
            who = np.array([True, False, True, False])
            led.place = np.where(who, led.place + 5.0 + 3.0j, led.place)
            gait.place_anew(who, led)

    course = lead(lambda t: speed, STATURES, 4.2, before_tick=enter)
    reference = lead(lambda t: speed, STATURES, 4.2)
    np.testing.assert_array_equal(course.rows[:, :, [1, 3]], reference.rows[:, :, [1, 3]])
    later = course.after(2.99)
    reach = np.abs(later.place - (later.place.mean(axis=1))[:, None])
    assert reach.max() < 1.0
    speeds = np.abs(np.diff(later.coordinates[:, :, 7:], axis=0)) / TICK_S
    assert speeds.max() < 35.0
    assert (later.load >= 0).all()
    assert later.load.sum(axis=1)[:40].mean() == pytest.approx(1.0, abs=0.15)
    assert later.lowered.max() < 0.02


def test_moments_between_ticks_keep_the_sum():
    course = steady(1.3, (1.75,), 4.0)
    assert course.rows.shape[1] == ROWS
    between = 0.5 * (course.load[1:] + course.load[:-1])
    assert between.sum(axis=1).mean() == pytest.approx(1.0, abs=0.02)
    loads = foot_loads(course.gait.state, course.skeleton)
    np.testing.assert_array_equal(loads.load[:, 0], course.load[-1, :, 0])
    assert loads.yaw.shape == loads.place.shape == (2, 1)


def measured_stances() -> tuple[np.ndarray, float]:
    """Vertical load of the subject's feet over whole stances, resampled (k, 101) [body weights]; stance time [s]."""
    table = np.loadtxt(MEASURED, skiprows=7)
    weight = 72.6 * 9.81
    curves, times = [], []
    for column in (2, 8):
        load = table[:, column] / weight
        for stance in stances(load > 0.02):
            curves.append(np.interp(np.linspace(0, 1, 101), np.linspace(0, 1, len(load[stance])), load[stance]))
            times.append(len(load[stance]) / 600)
    return np.array(curves), float(np.mean(times))


def our_stances(speed: float, stature: float) -> tuple[np.ndarray, float]:
    """The same of ours, with loads between ticks as they are interpolated."""
    course = steady(speed, (stature,), 20.0)
    fine = np.arange(course.t[0], course.t[-1], 1 / 600)
    load = np.interp(fine, course.t, course.load[:, 0, 0])
    found = stances(load > 0.02)
    curves = [np.interp(np.linspace(0, 1, 101), np.linspace(0, 1, len(load[each])), load[each]) for each in found]
    return np.array(curves), float(np.mean([each.stop - each.start for each in found])) / 600


@pytest.mark.skipif(not MEASURED.exists(), reason="the recording of subject01 is not there")
def test_a_foot_loads_the_floor_as_the_subject_s_does():
    """The subject, about 1.8 m tall, walks at 1.0 m/s (the belt under the standing foot): stance 0.79 s of 1.235 s."""
    theirs, their_time = measured_stances()
    ours, our_time = our_stances(1.0, 1.80)
    assert their_time == pytest.approx(0.79, abs=0.02)
    assert our_time == pytest.approx(their_time, rel=0.02)
    difference = ours.mean(axis=0) - theirs.mean(axis=0)
    assert np.sqrt((difference**2).mean()) < 0.035
    # the subject's own two feet differ by as much
    assert np.sqrt((np.ptp(theirs, axis=0) ** 2).mean()) > 0.03
