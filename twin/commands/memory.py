"""Ends of `twin` other than success: exit codes (see docs/concepts/results.md), failed plug-ins, signals, lack of memory."""

from __future__ import annotations

import errno
import gc
import os
import re
import resource
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

import typer

from trackers.errors import InputError
from twin.messages import sentence

_AGAIN_S = 0.05
_LONGEST_IMPORT_S = 10.0
EXIT_DONE, EXIT_FELL_SHORT, EXIT_BAD_INPUT, EXIT_OUR_FAULT, EXIT_INTERRUPTED, EXIT_CLOSED_PIPE = 0, 1, 2, 70, 130, 141


def exit_with_failures(failures: Sequence[str]) -> None:
    """Print the failures of plug-ins; with any, exit as a failed check does."""
    for failure in failures:
        sys.stderr.write(f"twin: {sentence(failure)}\n")
    if failures:
        raise typer.Exit(EXIT_FELL_SHORT)


class Interrupted(KeyboardInterrupt):
    """Request to end, by Ctrl-C or a kill.

    No plain KeyboardInterrupt: after one has passed through an `exec`, as in the making of a dataclass, Python ends by the
    signal instead of the exit code.
    """


_asked: list[float] = []
"""Times at which this process was asked to end [s]."""
_is_noticed = threading.Event()


def is_interrupted() -> bool:
    """Return True once this process was asked to end: an error afterwards comes of that. It is asked no more."""
    _is_noticed.set()
    return bool(_asked)


def raise_on_signals() -> None:
    """Make SIGTERM, and SIGINT and SIGHUP unless ignored, raise Interrupted in the main thread.

    Not during an import: compiled modules may crash there, and a partly made class turns it into another error. For up to 10 s,
    so that an endless module of the user's can be stopped too. The signal is repeated after `_AGAIN_S` until the exception is on
    its way: a compiled module that calls Python may pass over it, and go on.
    """
    is_repeated = threading.Event()

    def ask_again(number: int) -> None:
        if not _is_noticed.is_set():
            is_repeated.set()
            os.kill(os.getpid(), number)

    def stop(number: int, frame: FrameType | None) -> None:
        again = is_repeated.is_set()
        is_repeated.clear()
        _asked.append(time.monotonic())
        waits = _importing(frame) and _asked[-1] - _asked[0] < _LONGEST_IMPORT_S
        timer = threading.Timer(_AGAIN_S, ask_again, [number])
        timer.daemon = True  # none is left to be asked
        timer.start()
        if not (waits or (again and _is_on_its_way())):
            raise Interrupted

    signal.signal(signal.SIGTERM, stop)
    for number in (signal.SIGINT, signal.SIGHUP):  # Ctrl-C, and the end of the terminal
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, stop)


def _is_on_its_way() -> bool:
    """Return True while an Interrupted is being handled: files and processes are then cleaned up."""
    error = sys.exc_info()[1]
    return any(isinstance(each, Interrupted) for each in (*_chain(error), *_contexts(error)))


def _contexts(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__context__


def _importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            return True
        frame = frame.f_back
    return False


@contextmanager
def loading() -> Iterator[None]:
    """Import modules without searching for garbage meanwhile, nor later in what they made: they keep most of it.

    What there is after the first imports is left out of every later search, the one at the end of the process among them,
    which take a quarter of a short run together. Once per process: a caller that goes on keeps no garbage of its own.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            if not gc.get_freeze_count():
                gc.freeze()
            gc.enable()


_LEAST_MB = 200
"""Below this OpenBLAS ends the process by itself, before Python can report."""

_MEMORY_TEXTS = ("failed to map segment", "allocate memory", "can't start new thread", "insufficient memory")
_PARSER_TEXT = re.compile(r"field '\w+' is required for \w+")
"""Python's error when an import lacks memory for a syntax tree."""
_FOREIGN = ("av", "cv2", "mujoco", "OpenGL", "apsw", "sqlite3", "zstandard")
"""Libraries whose errors do not mention lack of memory."""
_FATAL = (signal.SIGABRT, signal.SIGSEGV, signal.SIGBUS, signal.SIGILL, signal.SIGTRAP)
"""Signals with which compiled libraries end a process."""


def run_in_child() -> int | None:
    """Continue in a child of this process where memory is limited; return its exit code, and None in the child itself.

    Image libraries end a process that lacks memory before Python can report: the parent can.
    """
    limit = _limit_mb()
    if limit is None:
        return None
    try:
        child = os.fork()
    except OSError:  # no memory even for that: the next error reports it
        return None
    if child == 0:
        return None
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal sends it to both
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, _: os.kill(child, number))
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    if -code in _FATAL:
        sys.stderr.write(f"twin: {_sentence(limit)}\n")
        return EXIT_BAD_INPUT
    return code if code >= 0 else 128 - code


def check_memory() -> None:
    """Raise InputError where the memory limit is too low to start."""
    limit = _limit_mb()
    if limit is not None and limit < _LEAST_MB:
        raise InputError(_sentence(limit))


def describe_lack(error: BaseException) -> str | None:
    """Describe an error caused by lack of open files or of memory, whatever it says; None for any other."""
    if any(isinstance(each, OSError) and each.errno in (errno.EMFILE, errno.ENFILE) for each in _chain(error)):
        most, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        return f"open files: this process may open {most} at once (ulimit -n), which is not enough; more are expected"
    return _describe_lack_of_memory(error)


def _describe_lack_of_memory(error: BaseException) -> str | None:
    limit = _limit_mb()
    is_described = isinstance(error, InputError)  # its sentence is wrong only if about memory
    for each in _chain(error):
        is_errno = isinstance(each, OSError) and each.errno == errno.ENOMEM
        may_lack = isinstance(each, ImportError | OSError | RuntimeError | ValueError) or _is_foreign(each)
        if (
            isinstance(each, MemoryError)
            or is_errno
            or (may_lack and any(word in str(each).lower() for word in _MEMORY_TEXTS))
        ):
            return _sentence(limit)
        is_of_parser = isinstance(each, ValueError) and _PARSER_TEXT.fullmatch(str(each)) is not None
        is_graphics = "gives no OpenGL context" in str(each)
        is_interpreter = isinstance(each, SystemError)  # Python 3.12 compiles a dataclass without a word of memory
        if limit is not None and (
            (_is_foreign(each) and not is_described) or is_graphics or is_of_parser or is_interpreter
        ):
            return _sentence(limit)
    return None


def _is_foreign(error: BaseException) -> bool:
    return type(error).__module__.partition(".")[0] in _FOREIGN


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _limit_mb() -> int | None:
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if soft == resource.RLIM_INFINITY else soft // 2**20


def _sentence(limit_mb: int | None) -> str:
    if limit_mb is None:
        return "memory: this machine has no more; fewer or smaller pictures, people or sensors, or more memory, is expected"
    return (
        f"memory: this process may take {limit_mb} MiB (ulimit -v), which is not enough; a higher limit, or --no-images and "
        "--no-video, is expected"
    )
