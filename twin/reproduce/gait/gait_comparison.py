"""Our gait compared with published gait, and with a recording of one subject, row by row.

The sources are those of `models/people/gait.yaml`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trackers.arrays import Array
from trackers.errors import InputError
from trackers.user_input.text_file import read_text
from twin.messages import OnProgress, no_progress
from twin.reproduce.gait.stride import (
    STANCE_POINTS,
    Stance,
    SteadyGait,
    StrideMeasures,
    load_path,
    measure_people,
    measure_stride,
    simulate_steady,
    stance,
    values_of,
)
from twin.reproduce.results import Bootstrap, ResultRow, interval
from twin.streams import stream

WALK_RATIO = 0.0064
"""Step length over cadence [m/(steps/min)]: Sekiya and Nagasaki (1998)."""
STANCE_SHARE = (0.58, 0.66)
"""Share of the stride in a walker's stance, from a fast walk to a slow one, approximately: Winter (1991)."""
HUMPS, DIP = (1.05, 1.25), (0.65, 0.90)
"""Of a natural walk, 1.2 to 1.5 m/s, approximately: Winter (1991), Nilsson and Thorstensson (1989) [body weights]."""
RUNNING_HUMP = (2.0, 2.8)
"""From a jog to 5 m/s, approximately: Nilsson and Thorstensson (1989) [body weights]."""
CONTACT_S = {3.0: 0.25, 5.0: 0.19}
"""Contact of a runner's foot, by speed [m/s]: Nilsson and Thorstensson (1989)."""
JOGGING_STEPS_MIN = {2.5: 2.6 * 60}
"""Step rate of a jogger, by speed [m/s]: Nilsson and Thorstensson (1987)."""

PERSON_SPEED_M_S, PERSON_STATURE_M, PERSON_MASS_KG = 1.25, 1.83, 85.0
PERSON_STANCE_S, PERSON_TRAVEL_M = 0.754, 0.271
"""Duration of a stance, and path of the point of load along the foot in it, of a person on force plates."""
PERSON_EARLY_LOAD = 0.19
"""That person's load at 5 % of the stance [body weights]."""
PERSON_STEPS_APART = 0.038
"""Root mean square between the loads of two of that person's steps [body weights]."""
STANCE_S = {1.03: 0.749, 1.53: 0.639, 1.93: 0.533}
"""Duration of a walker's stance, mean of ten people, by speed [m/s]."""
ROLL = {0.2: 0.24, 0.3: 0.30, 0.4: 0.41, 0.5: 0.57}
"""Point of load, as a share of the foot from the heel, by share of the stance: pressure plates of ten people."""

SOURCES = (
    'N. Sekiya, H. Nagasaki: "Reproducibility of the walking patterns of normal young adults: test-retest reliability of '
    'the walk ratio". Gait & Posture 7, 1998.',
    'D. A. Winter: "The Biomechanics and Motor Control of Human Gait". University of Waterloo Press, 1991.',
    'J. Nilsson, A. Thorstensson: "Adaptability in frequency and amplitude of leg movements during human locomotion at '
    'different speeds". Acta Physiologica Scandinavica 129, 1987.',
    'J. Nilsson, A. Thorstensson: "Ground reaction forces at different speeds of human walking and running". Acta '
    "Physiologica Scandinavica 136, 1989.",
    f"One person of {PERSON_MASS_KG:g} kg and {PERSON_STATURE_M:g} m on force plates at {PERSON_SPEED_M_S:g} m/s; ten "
    "walkers at three speeds; ten people on pressure plates: figures that were handed to us without their recordings "
    "and without a reference.",
)

SUBJECT_FILE = "subject01_walk1_grf.mot"
SUBJECT_SPEED_M_S, SUBJECT_STATURE_M, SUBJECT_MASS_KG = 1.0, 1.80, 72.6
_GRAVITY_M_S2 = 9.81
_COLUMNS = ("time", "ground_force_vy", "1_ground_force_vy")


def walking_cadence(speed_m_s: Array) -> Array:
    """Compute steps per minute of a walk of constant walk ratio."""
    return np.sqrt(60 * speed_m_s / WALK_RATIO)


def walking_step_m(speed_m_s: Array) -> Array:
    """Compute the step length of a walk of constant walk ratio [m]."""
    return np.sqrt(60 * speed_m_s * WALK_RATIO)


@dataclass(frozen=True, eq=False)
class Subject:
    """Vertical loads of a subject's feet: `load` (k, 2) [body weights], `rate_hz` of the recording."""

    load: Array
    rate_hz: float


def read_subject(folder: Path) -> Subject:
    """Read the loads of OpenSim's gait2354 subject, who walks on a treadmill at 1.0 m/s.

    Raises InputError for a missing file or one without a table of forces.
    """
    path = folder / SUBJECT_FILE
    lines = read_text(path, "in the folder of --data OpenSim's gait2354 recording").splitlines()
    head = next((number for number, line in enumerate(lines) if line.strip() == "endheader"), None)
    names = lines[head + 1].split() if head is not None and head + 1 < len(lines) else []
    missing = [name for name in _COLUMNS if name not in names]
    if head is None or missing:
        raise InputError(f"{path}: has no column {missing[0]}; an OpenSim table of ground forces is expected")
    try:
        table = np.array([[float(number) for number in line.split()] for line in lines[head + 2 :] if line.strip()])
    except ValueError as error:
        raise InputError(f"{path}: is not a table of numbers ({error}); rows of {len(names)} are expected") from error
    if table.ndim != 2 or table.shape[1] != len(names) or len(table) < 2 or not np.isfinite(table).all():
        raise InputError(f"{path}: is not a table of numbers; finite rows of {len(names)} are expected")
    time, *vertical = (table[:, names.index(name)] for name in _COLUMNS)
    rate_hz = (len(time) - 1) / float(time[-1] - time[0])
    return Subject(np.stack(vertical, axis=-1) / (SUBJECT_MASS_KG * _GRAVITY_M_S2), rate_hz)


WALKS_M_S = (0.8, 1.0, 1.2, 1.35, 1.5, 1.8)
RUNS_M_S = (2.5, 3.0, 4.0, 5.0)
NATURAL_M_S = (1.2, 1.35, 1.5)
"""Speeds to which the published humps and dip apply."""
STATURE_M, STATURE_SPREAD_M = 1.75, 0.09
_STATURES_M = (1.50, 2.00)

SUBJECT_SECTION, PERSON_SECTION = "beside the subject", "beside a measured person"
WALKING, RUNNING = "walking", "running"


@dataclass(frozen=True, eq=False)
class SubjectComparison:
    """The subject's stances and ours at equal speed and stature, and their root mean square difference [body weights]."""

    theirs: Stance
    their_measures: StrideMeasures
    ours: Stance
    our_measures: StrideMeasures
    apart: float
    feet_apart: float
    """Difference between the subject's own feet."""


@dataclass(frozen=True, eq=False)
class GaitRuns:
    """All bodies at every speed, by speed [m/s].

    person: a body that walks as the measured person does; compared: with the subject, if there is a recording.
    """

    seeds: range
    courses: dict[float, SteadyGait]
    measures: dict[float, list[StrideMeasures]]
    person: SteadyGait
    compared: SubjectComparison | None


def statures(seeds: range) -> list[float]:
    """Draw statures of adults [m], one per seed: normal, none shorter than 1.50 m or taller than 2.00 m."""
    drawn = []
    for seed in seeds:
        rng = stream(seed, "reproduce", "stature")
        stature = rng.normal(STATURE_M, STATURE_SPREAD_M)
        while not _STATURES_M[0] <= stature <= _STATURES_M[1]:
            stature = rng.normal(STATURE_M, STATURE_SPREAD_M)
        drawn.append(float(stature))
    return drawn


def simulate_gait(seeds: range, subject: Subject | None, on_progress: OnProgress = no_progress) -> GaitRuns:
    """Simulate all bodies at every speed, and one of the subject's stature as the subject walks."""
    people = statures(seeds)
    courses = {}
    speeds = (*sorted({*WALKS_M_S, *STANCE_S}), *RUNS_M_S)
    for done, speed in enumerate(speeds, start=1):
        courses[speed] = simulate_steady(speed, people)
        on_progress("speeds", done, len(speeds))
    found = {speed: measure_people(course) for speed, course in courses.items()}
    person = simulate_steady(PERSON_SPEED_M_S, [PERSON_STATURE_M], 20.0)
    return GaitRuns(seeds, courses, found, person, None if subject is None else compare(subject))


def compare(subject: Subject) -> SubjectComparison:
    """Compare a body of the subject's stature at the subject's speed; raises InputError for a recording without a walk."""
    feet = [stance(subject.load[:, foot], subject.rate_hz) for foot in range(2)]
    theirs = _together(feet)
    try:
        their_measures = measure_stride(subject.load, subject.rate_hz)
    except ValueError as error:
        raise InputError(f"{SUBJECT_FILE}: holds {error}; a walk of a few steps is expected") from error
    if not all(len(each.seconds) for each in feet):
        raise InputError(f"{SUBJECT_FILE}: holds no whole stance of one foot; a walk of a few steps is expected")
    course = simulate_steady(SUBJECT_SPEED_M_S, [SUBJECT_STATURE_M], 20.0)
    ours = _together([stance(course.load[:, foot, 0], course.rate_hz) for foot in range(2)])
    own = [each.curves.mean(axis=0) for each in feet]
    return SubjectComparison(
        theirs,
        their_measures,
        ours,
        measure_people(course)[0],
        _rms(ours.curves.mean(axis=0) - theirs.curves.mean(axis=0)),
        _rms(own[0] - own[1]),
    )


def gait_results(runs: GaitRuns) -> list[ResultRow]:
    """Compute every result: against the subject, of walking and of running; bootstrap intervals over the people."""
    rows = [] if runs.compared is None else _compare_with_subject(runs.compared)
    rows += _compare_with_person(runs.person)
    n_run = len(runs.seeds)
    bootstrap = Bootstrap(n_run, stream(runs.seeds.start, "reproduce", "bootstrap"))

    def add(where: str, speed: float, what: str, values: Array, unit: str, paper: float | None = None) -> None:
        rows.append(ResultRow.of(where, f"{speed:g} m/s", what, interval(bootstrap.mean(values)), unit, n_run, paper))

    for speed in WALKS_M_S:
        found = runs.measures[speed]
        at = np.array(speed)
        add(WALKING, speed, "cadence", values_of(found, "cadence"), "steps/min", float(walking_cadence(at)))
        add(WALKING, speed, "step length", values_of(found, "step_length_m"), "m", float(walking_step_m(at)))
        share = 100 * values_of(found, "stance_share")
        add(WALKING, speed, f"stance of the stride{_range(STANCE_SHARE, 100)}", share, "%")
        add(WALKING, speed, "mean load", values_of(found, "mean"), "BW", 1.0)
        if speed in NATURAL_M_S:
            add(WALKING, speed, f"first hump{_range(HUMPS)}", values_of(found, "first"), "BW")
            add(WALKING, speed, f"dip{_range(DIP)}", values_of(found, "dip"), "BW")
            add(WALKING, speed, f"second hump{_range(HUMPS)}", values_of(found, "second"), "BW")
    for speed, seconds in STANCE_S.items():
        add(WALKING, speed, "stance", values_of(runs.measures[speed], "stance_s"), "s", seconds)
    for speed in RUNS_M_S:
        found = runs.measures[speed]
        add(RUNNING, speed, f"hump{_range(RUNNING_HUMP)}", values_of(found, "hump"), "BW")
        add(RUNNING, speed, "mean load", values_of(found, "mean"), "BW", 1.0)
        add(RUNNING, speed, "contact", values_of(found, "stance_s"), "s", CONTACT_S.get(speed))
        add(RUNNING, speed, "cadence", values_of(found, "cadence"), "steps/min", JOGGING_STEPS_MIN.get(speed))
        add(RUNNING, speed, "step length", values_of(found, "step_length_m"), "m")
    return rows


def _compare_with_subject(compared: SubjectComparison) -> list[ResultRow]:
    theirs, ours = compared.their_measures, compared.our_measures
    row, stances = f"{SUBJECT_SPEED_M_S:g} m/s, {SUBJECT_STATURE_M:g} m", len(compared.ours.seconds)

    def result(what: str, paper: float | None, value: float, unit: str) -> ResultRow:
        return ResultRow(SUBJECT_SECTION, row, what, paper, value, (value, value), unit, stances)

    return [
        result("stance", theirs.stance_s, ours.stance_s, "s"),
        result("stride", theirs.stride_s, ours.stride_s, "s"),
        result("stance of the stride", 100 * theirs.stance_share, 100 * ours.stance_share, "%"),
        result("first hump", theirs.first, ours.first, "BW"),
        result("dip", theirs.dip, ours.dip, "BW"),
        result("second hump", theirs.second, ours.second, "BW"),
        result("mean load", theirs.mean, ours.mean, "BW"),
        result("curves apart, root mean square (paper: the subject's own feet)", compared.feet_apart, compared.apart,
               "BW"),
    ]  # fmt: skip


def _compare_with_person(ours: SteadyGait) -> list[ResultRow]:
    (found,) = measure_people(ours)
    curve = _together([stance(ours.load[:, foot, 0], ours.rate_hz) for foot in range(2)]).curves.mean(axis=0)
    points = load_path(ours)
    row, whole = f"{PERSON_SPEED_M_S:g} m/s, {PERSON_STATURE_M:g} m", np.linspace(0, 1, STANCE_POINTS)

    def result(what: str, paper: float | None, value: float, unit: str) -> ResultRow:
        return ResultRow(PERSON_SECTION, row, what, paper, value, (value, value), unit, len(points))

    travel = float(np.ptp(points, axis=1).mean())
    early = float(np.interp(0.05, whole, curve))
    rows = [
        result("stance", PERSON_STANCE_S, found.stance_s, "s"),
        result("load at 5 % of the stance", PERSON_EARLY_LOAD, early, "BW"),
        result("travel of the point of load", PERSON_TRAVEL_M, travel, "m"),
    ]
    for tenth in range(1, 10):
        share = float(np.interp(tenth / 10, whole, points.mean(axis=0))) / float(ours.shoe_m[0])
        rows.append(
            result(
                f"point of load at {10 * tenth} % of the stance, share of the shoe", ROLL.get(tenth / 10), share, "1"
            )
        )
    return rows


def _together(feet: list[Stance]) -> Stance:
    return Stance(np.concatenate([each.curves for each in feet]), np.concatenate([each.seconds for each in feet]))


def _range(published: tuple[float, float], scale: float = 1) -> str:
    return f" ({scale * published[0]:g} to {scale * published[1]:g} published)"


def _rms(difference: Array) -> float:
    return float(np.sqrt((difference**2).mean()))
