"""Limits against mistakes and attacks: sizes are compared before anything of that size is made.

`--no-limits` lifts them for the process and its children; nothing in a scenario, a room or a bag can. They cover sizes
bounded by memory, disk or time, not those bounded by a format or OpenGL.
"""

from __future__ import annotations

import os

from trackers.errors import InputError

NO_LIMITS = "TWIN_NO_LIMITS"
"""Environment variable that lifts the limits, also for workers."""


def lift_limits() -> None:
    """Lift the limits for this process and its later children."""
    os.environ[NO_LIMITS] = "1"


def are_limits_lifted() -> bool:
    """Return whether `--no-limits` was given."""
    return bool(os.environ.get(NO_LIMITS))


def refuse_unless_lifted(said: str, valid: str) -> None:
    """Raise InputError for a size above a limit, if the limits hold.

    `said`: start of the sentence, with file, field and size; `valid`: what would be valid.
    """
    if not are_limits_lifted():
        raise InputError(f"{said}; {valid}, or --no-limits, is expected")


def check_limit(asked: float, most: float, said: str, unit: str = "") -> None:
    """Raise InputError where `asked` exceeds `most` and the limits hold.

    `said`: start of the sentence, with file, field and content; `unit` follows the numbers.
    """
    if asked > most:
        what = f" {unit}" if unit else ""
        refuse_unless_lifted(f"{said} {asked:.6g}{what}", f"at most {most:.6g}")
