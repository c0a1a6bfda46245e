"""Published data of walking and running for comparison, and a recording of one subject.

The sources are those of `models/people/gait.yaml`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trackers.arrays import Array
from trackers.errors import InputError
from trackers.text_file import read_text

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
