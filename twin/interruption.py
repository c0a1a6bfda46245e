"""Ctrl-C and a kill: both end the command line where that is safe, what is half-written removed."""

from __future__ import annotations

import os
import signal
import threading
import time
from types import FrameType

_AGAIN_S = 0.05
_LONGEST_IMPORT_S = 10.0


class Interrupted(KeyboardInterrupt):
    """Somebody asked for the end.

    Not a plain KeyboardInterrupt: where one of those has passed through an `exec`, as in the making of a dataclass, Python
    ends by the signal itself instead of the exit code that it is given.
    """


def heed_interrupts() -> None:
    """From now on SIGTERM, and SIGINT unless it is ignored, raise Interrupted in the main thread.

    Not within an import: compiled modules may crash there, and a class half made turns it into another error. The signal
    then comes again a moment later, for up to 10 s, so that a module of the user's that never ends can be stopped too.
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
