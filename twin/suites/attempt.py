"""One attempt at one task, where it runs: its log, its watchdog, and every way it can end as a plain value."""

from __future__ import annotations

import errno
import faulthandler
import os
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from trackers.errors import InputError, PlugInError
from twin.run.plug_in_faults import first_line

Way = Literal["done", "bad input", "no space", "raised"]

_LOG_TAIL_BYTES = 4000
_NO_SPACE = (errno.ENOSPC, errno.EDQUOT)


@dataclass(frozen=True)
class Attempt:
    """How an attempt ended: the value where it is done, else a message, with the log's tail where it raised."""

    way: Way
    value: Any
    seconds: float
    message: str = ""


def attempt(function: Callable[[Any], Any], work: Any, limit_s: float, log: Path | None, killed: bool) -> Attempt:
    """Call `function(work)`; whatever it raises comes back as a value, so that no exception has to travel.

    log: file that holds all that the process writes meanwhile, stacks of a crash included (None: none). killed: whether
    a call that outlasts `limit_s` [s] takes its process down, its stacks in the log; this works also where the call
    hangs in compiled code and lets no other thread run. For processes of our own only.
    """
    start = time.perf_counter()

    def spent_s() -> float:
        return time.perf_counter() - start

    try:
        with _logged(log, limit_s if killed else None):
            return Attempt("done", function(work), spent_s())
    except InputError as error:
        cause = error.__cause__
        full = isinstance(cause, OSError) and cause.errno in _NO_SPACE
        return Attempt("no space" if full else "bad input", None, spent_s(), str(error))
    except OSError as error:  # the log's own too: a full disk can keep it from being opened or written
        if error.errno in _NO_SPACE:
            message = f"{error.filename or log or 'a file'}: cannot be written ({error.strerror})"
            return Attempt("no space", None, spent_s(), message)
        return Attempt("raised", None, spent_s(), _told(error))
    except (Exception, SystemExit) as error:  # a plug-in that leaves the process is a failed case, no more
        return Attempt("raised", None, spent_s(), _told(error))


def _told(error: BaseException) -> str:
    """What was raised, on a line of its own, and then how it came to it."""
    what = str(error) if isinstance(error, PlugInError) else f"{type(error).__name__}: {error}"
    return f"{first_line(what)}\n{traceback.format_exc()}"


def log_tail(log: Path | None) -> str:
    """The end of a log; "" where there is none."""
    if log is None or not log.is_file():
        return ""
    with log.open("rb") as stream:
        stream.seek(max(0, log.stat().st_size - _LOG_TAIL_BYTES))
        return stream.read().decode("utf-8", errors="replace").strip()


@contextmanager
def _logged(log: Path | None, deadline_s: float | None) -> Iterator[None]:
    """What the process writes goes to the log; past the deadline [s] the stacks go there too, and the process ends."""
    if log is None or not log.parent.is_dir():  # another machine, without our folders
        with _watched(deadline_s, 2):
            yield
        return
    sys.stdout.flush()
    sys.stderr.flush()
    kept = os.dup(1), os.dup(2)
    target = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    try:
        os.dup2(target, 1)
        os.dup2(target, 2)
        with _watched(deadline_s, target):
            yield
    finally:
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            for number, copy in enumerate(kept, start=1):
                os.dup2(copy, number)
                os.close(copy)
            os.close(target)
            if log.stat().st_size == 0:
                log.unlink()


@contextmanager
def _watched(deadline_s: float | None, descriptor: int) -> Iterator[None]:
    if deadline_s is None:
        yield
        return
    faulthandler.enable(descriptor)
    faulthandler.dump_traceback_later(deadline_s, exit=True, file=descriptor)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        faulthandler.disable()
