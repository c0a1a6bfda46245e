"""The type checks of the test run (`tests/conftest.py`): which checker, and how many calls it looks at.

A check costs more than most of what it checks: of every call it would be two thirds of the time of the trackers' tests.
So in each file of tests a function is checked at its first calls, and then now and then; `scripts/test --all` checks all.
"""

from __future__ import annotations

import functools
import inspect
import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import jaxtyping
from beartype import BeartypeConf, FrozenDict, beartype
from numpy.typing import ArrayLike

_UNCHECKED = FrozenDict({hint: Any for hint in (Self, ArrayLike, ArrayLike | None)})
checked = beartype(conf=BeartypeConf(is_pep484_tower=True, hint_overrides=_UNCHECKED))
"""beartype that takes an int for a float, as type checkers do (PEP 484).

It knows Self in whole classes only, and takes no list or tuple for what numpy makes an array of."""

CHECKED = (
    "trackers.camera_floor_particle",
    "trackers.cameras",
    "trackers.environment",
    "trackers.filters",
    "trackers.likelihood.floor",
    "trackers.laser",
    "trackers.laser_fisheye_imm",
    "trackers.laser_vision_learning",
    "trackers.learning",
    "trackers.rgbd_head",
    "trackers.tracking",
    "trackers.vision",
)
FIRST, EVERY = (5, 499) if os.environ.get("ROOMTWIN_SHAPE_CHECKS") != "all" else (0, 1)
"""Calls of a function in a file of tests: the first so many are checked, then each so manieth; a prime, so that no loop's
rhythm always shows the same call."""

_jaxtyped = jaxtyping.jaxtyped
_calls: Counter[int] = Counter()
"""In the current file, by the id of the code: a function within a function is made anew at each call of that one."""
_file: Path | None = None


def begin_test_of(file: Path | None) -> None:
    """Count the calls of every function from the start, if the last test was of another file."""
    global _file
    if file != _file:
        _calls.clear()
    _file = file


def _sampled(fn: Any, *, typechecker: Any) -> Any:
    """`jaxtyping.jaxtyped` that checks some calls of a function; the checks are made when they are first needed."""
    if not inspect.isfunction(fn):
        return _jaxtyped(fn, typechecker=typechecker)
    check: Callable[..., Any] | None = None
    code = id(fn.__code__)  # hashing it would take longer

    @functools.wraps(fn)
    def wrapped(*args: Any, **kwargs: Any) -> Any:
        nonlocal check
        _calls[code] = count = _calls[code] + 1
        if count > FIRST and count % EVERY:
            return fn(*args, **kwargs)
        if check is None:
            check = _jaxtyped(fn, typechecker=typechecker)
        return check(*args, **kwargs)

    return wrapped


def install() -> None:
    """Check calls into the modules `CHECKED`, as far as they are imported from now on."""
    jaxtyping._decorator.jaxtyped = _sampled  # looked up there by the hook's decorators, and for what classes hold
    jaxtyping.install_import_hook(CHECKED, "shape_checks.checked")
