"""Limits that catch mistakes and attacks: a size is read and compared before anything of that size is made.

`--no-limits` lifts them for the process and for those that it starts. Nothing in a scenario, a room or a bag can.
"""

from __future__ import annotations

import os

from trackers.errors import InputError

NO_LIMITS = "TWIN_NO_LIMITS"
"""Environment variable that lifts the limits where it is set: so that workers know it too."""


def lift_limits() -> None:
    """Let this process, and those that it starts from now on, make what is larger than the limits."""
    os.environ[NO_LIMITS] = "1"


def are_limits_lifted() -> bool:
    """Whether `--no-limits` was given."""
    return bool(os.environ.get(NO_LIMITS))


def check_limit(asked: float, most: float, said: str, unit: str = "") -> None:
    """Raise InputError where `asked` is more than `most` and the limits hold.

    `said` opens the sentence: file, field and what it makes; `unit` follows the numbers.
    """
    if asked > most and not are_limits_lifted():
        what = f" {unit}" if unit else ""
        raise InputError(f"{said} {asked:.6g}{what}; at most {most:.6g}, or --no-limits, is expected")
