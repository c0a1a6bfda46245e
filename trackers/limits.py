"""Limits that catch mistakes and attacks: a size is read and compared before anything of that size is made.

`--no-limits` lifts them for the process and for those that it starts. Nothing in a scenario, a room or a bag can. Every
size that memory, disk or time bounds is refused here; what a format or OpenGL bounds is no limit of this kind.
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
    """Tell whether `--no-limits` was given."""
    return bool(os.environ.get(NO_LIMITS))


def refuse_unless_lifted(said: str, valid: str) -> None:
    """Raise InputError for what is larger than a limit, if the limits hold.

    `said` opens the sentence: file, field and what it makes; `valid` is what would be valid.
    """
    if not are_limits_lifted():
        raise InputError(f"{said}; {valid}, or --no-limits, is expected")


def check_limit(asked: float, most: float, said: str, unit: str = "") -> None:
    """Raise InputError where `asked` is more than `most` and the limits hold.

    `said` opens the sentence: file, field and what it makes; `unit` follows the numbers.
    """
    if asked > most:
        what = f" {unit}" if unit else ""
        refuse_unless_lifted(f"{said} {asked:.6g}{what}", f"at most {most:.6g}")
