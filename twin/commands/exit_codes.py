"""Exits of `twin`: exit codes (see docs/concepts/results.md), failed plug-ins, Ctrl-C and kill."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Sequence
from types import FrameType

import typer

from twin.messages import printable

_AGAIN_S = 0.05
_LONGEST_IMPORT_S = 10.0
EXIT_DONE, EXIT_FELL_SHORT, EXIT_BAD_INPUT, EXIT_OUR_FAULT, EXIT_INTERRUPTED, EXIT_CLOSED_PIPE = 0, 1, 2, 70, 130, 141


def exit_with_failures(failures: Sequence[str]) -> None:
    """Print the failures of plug-ins; with any, exit as a failed check does."""
    for failure in failures:
        sys.stderr.write(f"twin: {printable(failure)}\n")
    if failures:
        raise typer.Exit(EXIT_FELL_SHORT)


class Interrupted(KeyboardInterrupt):
    """Request to end, by Ctrl-C or a kill.

    No plain KeyboardInterrupt: after one has passed through an `exec`, as in the making of a dataclass, Python ends by the
    signal instead of the exit code.
    """


def raise_on_signals() -> None:
    """Make SIGTERM, and SIGINT unless ignored, raise Interrupted in the main thread.

    Not during an import: compiled modules may crash there, and a partly made class turns it into another error. The signal
    is repeated after `_AGAIN_S`, for up to 10 s, so that an endless module of the user's can be stopped too.
    """
    first_s: list[float] = []

    def stop(number: int, frame: FrameType | None) -> None:
        first_s.append(time.monotonic())
        if _importing(frame) and first_s[-1] - first_s[0] < _LONGEST_IMPORT_S:
            threading.Timer(_AGAIN_S, os.kill, [os.getpid(), number]).start()
            return
        raise Interrupted

    signal.signal(signal.SIGTERM, stop)
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, stop)


def _importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            return True
        frame = frame.f_back
    return False
