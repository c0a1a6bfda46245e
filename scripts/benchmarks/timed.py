"""Cost of the calls of one function within a larger run."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any


@dataclass
class Spent:
    """Time that calls have taken so far [s]."""

    seconds: float = 0.0


@contextmanager
def timed(owner: Any, name: str) -> Iterator[Spent]:
    """Add up what calls of a function of a module, or of a method of a class, cost while this holds."""
    spent, original = Spent(), getattr(owner, name)

    def measured(*arguments: Any, **options: Any) -> Any:
        start = time.perf_counter()
        try:
            return original(*arguments, **options)
        finally:
            spent.seconds += time.perf_counter() - start

    setattr(owner, name, measured)
    try:
        yield spent
    finally:
        setattr(owner, name, original)
