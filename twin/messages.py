"""Messages to users: callbacks for progress and warnings, and text that is safe in a terminal."""

from __future__ import annotations

import logging
import re
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import ClassVar

OnProgress = Callable[[str, float, float], None]
"""Called with the name of a task, the amount done and the total, in the same unit."""

OnWarning = Callable[[str], None]
"""Called with each warning about a result as soon as known."""


def no_progress(what: str, done: float, total: float) -> None:
    """Leave progress unreported."""


def no_warning(warning: str) -> None:
    """Leave a warning to the result, which holds them all."""


def warn(warning: str) -> None:
    """Show a warning as Python does (UserWarning), at the caller's own line: the default in scripts and notebooks."""
    frame, level = sys._getframe(1), 2  # pyright: ignore[reportPrivateUsage]
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] in ("twin", "contextlib"):
        frame, level = frame.f_back, level + 1
    warnings.warn(warning, stacklevel=level)


_AT_WORK: ContextVar[str] = ContextVar("name of the tracker at work")


@contextmanager
def at_work(tracker: str) -> Iterator[None]:
    """Print what is logged in the block under this tracker's name, as the user typed it."""
    token = _AT_WORK.set(tracker)
    try:
        yield
    finally:
        _AT_WORK.reset(token)


class TrackerLog(logging.Handler):
    """Handler of what trackers, and the twin, log while they work: printed on stderr as a warning of the command line.

    A warning of a tracker begins with the one at work (`at_work`), else with the package that logs.
    """

    printed: ClassVar[set[str]] = set()

    @classmethod
    def install(cls) -> None:
        """Print what is logged from now on, each once however often a process calls the command line."""
        for package in map(logging.getLogger, ("trackers", "twin")):
            for handler in package.handlers[:]:
                if isinstance(handler, cls):
                    package.removeHandler(handler)
            package.addHandler(cls(logging.WARNING))
        cls.printed.clear()

    def emit(self, record: logging.LogRecord) -> None:
        """Print the message."""
        package, system, *inside = record.name.split(".")
        name = f"{_AT_WORK.get(system.replace('_', '-'))}: " if inside and package == "trackers" else ""
        self.printed.add(sentence(f"{name}{record.getMessage()}"))
        sys.stderr.write(f"twin: warning: {sentence(f'{name}{record.getMessage()}')}\n")


_UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Control characters but tab and newline, marks of writing direction, and bytes of names that are no UTF-8."""


_LONGEST_LINE, _LONGEST_END = 2000, 600


def sentence(text: str) -> str:
    """Return a text as printable, with the middle of each overlong line left out: input may name thousands of things."""
    return "\n".join(
        line if len(line) <= _LONGEST_LINE else f"{line[: _LONGEST_LINE - _LONGEST_END]} … {line[-_LONGEST_END:]}"
        for line in printable(text).split("\n")
    )


def counted(count: int, one: str, many: str = "") -> str:
    """Format a number of things; `many`: the plural, where it is not `one` with an s."""
    return f"{count} {one if count == 1 else many or one + 's'}"


def short_path(path: str | Path) -> str:
    """Format a path from the working folder where it is below that, else as it is."""
    path = Path(path)
    is_below = path.is_absolute() and path.is_relative_to(Path.cwd())
    return str(path.relative_to(Path.cwd()) if is_below else path)


def printable_name(name: str) -> str:
    """Return a file's name as texts of UTF-8 and one line hold it: '_' for all that is not printable."""
    return "".join(each if each.isprintable() else "_" for each in name)


def printable(text: str) -> str:
    """Escape control characters as Python does, so that no name of a file or field moves the cursor."""
    return _UNPRINTABLE.sub(lambda found: found[0].encode("unicode_escape").decode(), text)
