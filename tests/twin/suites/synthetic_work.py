"""Work of a worker, good and bad, without what a case needs: a process that begins anew for it is soon there."""

from __future__ import annotations

import errno
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

from trackers.errors import InputError


def work_of(kind: str, **more: Any) -> dict[str, Any]:
    return {"kind": kind, **more}


def do(work: dict[str, Any]) -> Any:
    """Do what the work says."""
    kind = work["kind"]
    if kind == "square":
        return work["n"] ** 2
    if kind == "sleep":
        time.sleep(work["s"])
        return work.get("n", 0)
    if kind == "raise":
        print("about to raise")
        raise RuntimeError("nothing works today")
    if kind == "bad input":
        raise InputError("sensors.waist: is no good; a better one is expected")
    if kind == "full":
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "/full/disk")
    if kind == "die":
        print("about to die", file=sys.stderr)
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "die once":
        mark = Path(work["mark"])
        if not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return work["n"] ** 2
    if kind == "leave":
        sys.exit(0)
    if kind == "hang":
        while True:
            time.sleep(0.05)
    if kind == "stop":  # as in the middle of a driver: no thread of the process runs
        os.kill(os.getpid(), signal.SIGSTOP)
    if kind == "where":
        return os.getpid(), os.environ.get("LP_NUM_THREADS")
    raise AssertionError(kind)
