"""Cameras in one, two, four and eight processes at once: frames a second of each, on whatever draws here; nothing hangs.

Each process is started afresh (a fork after drawing hangs), has a GL context of its own, and is killed when its time is
over: several renderers at once have been reported to hang on some GPU machines (MuJoCo issue 3444). They draw at the same
time. One that is killed or fails is counted, and the table tells of it.
"""

from __future__ import annotations

import json
import os
import selectors
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.drawing import CAMERAS
from benchmarks.figure import Figure

COUNTS, SECONDS = "BENCH_PROCESSES", "BENCH_DRAW_S"
"""Environment variables: how many processes at once, as in '1 2 4 8', and for how long each draws [s]."""

_START_LIMIT_S = 120.0
_SLOW = 5.0
"""A process may take so many times its drawing time, and as many seconds more, before it is killed."""
_DIES_WITHIN_S = 5.0
_SOFTWARE = ("llvmpipe", "softpipe", "swrast")


@dataclass(frozen=True)
class _Outcome:
    """Result of one process: frames per second, or the reason for none."""

    renderer: str
    fps: float
    failure: str


def measure() -> Iterator[Figure]:
    """Every camera in every number of processes; in software fewer of them and for a shorter time, unless asked."""
    table = Table("camera", "processes", "frames/s in all", "of each process", "killed or failed")
    renderers: list[str] = []
    lost = 0
    for name in CAMERAS:
        counts = _counts("1")
        while counts:
            n_process, *rest = counts
            outcomes = together(name, n_process, float(os.environ.get(SECONDS, "2")))
            renderers += [each.renderer for each in outcomes if each.renderer and each.renderer not in renderers]
            if n_process == 1:
                in_software = any(part in renderer for renderer in renderers for part in _SOFTWARE)
                rest = _counts("1 2 4" if in_software else "1 2 4 8")[1:]
            counts = rest
            drawn = [each.fps for each in outcomes if not each.failure]
            failures = [each.failure for each in outcomes if each.failure]
            lost += len(failures)
            each_fps = " ".join(f"{fps:.1f}" for fps in drawn)
            table.add_row(name, str(n_process), f"{sum(drawn):.1f}", each_fps, "; ".join(failures) or "none")
            yield Figure(f"{name}, {n_process} at once: in all", sum(drawn), "frames/s", "")
            if drawn:
                yield Figure(f"{name}, {n_process} at once: the slowest", min(drawn), "frames/s", "")
    table.title = f"drawn by {', '.join(renderers) or 'nothing'}"
    Console(stderr=True, width=150).print(table)
    yield Figure("processes that were killed at their time limit or failed", lost, "", "<= 0")


def together(name: str, n_process: int, seconds: float) -> list[_Outcome]:
    """Run n processes that draw one camera at the same time; each has ended, or was killed, when this returns."""
    command = [sys.executable, "-m", "benchmarks.drawing", name, str(seconds)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])}
    processes = [
        subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        for _ in range(n_process)
    ]
    try:
        ready = _answers(processes, time.monotonic() + _START_LIMIT_S)
        for process, answer in zip(processes, ready, strict=True):
            if answer is not None and process.stdin is not None:
                with suppress(BrokenPipeError):  # it has ended since: it will not answer
                    process.stdin.write(b"\n")
                    process.stdin.flush()
        started = [process for process, answer in zip(processes, ready, strict=True) if answer is not None]
        drawn = iter(_answers(started, time.monotonic() + _SLOW * (seconds + 1)))
        done = [None if answer is None else next(drawn) for answer in ready]
    finally:
        outlived = [_end(process) for process in processes]
    return [_outcome(*each) for each in zip(processes, ready, done, outlived, strict=True)]


def _answers(processes: Sequence[subprocess.Popen], until: float) -> list[dict[str, Any] | None]:
    """The next line of each process, as JSON; None for one that ends or says nothing until then (`time.monotonic`)."""
    answers: list[dict[str, Any] | None] = [None] * len(processes)
    with selectors.DefaultSelector() as selector:
        for place, process in enumerate(processes):
            assert process.stdout is not None
            selector.register(process.stdout, selectors.EVENT_READ, (place, process.stdout))
        while selector.get_map() and (left_s := until - time.monotonic()) > 0:
            for key, _ in selector.select(left_s):
                place, stream = key.data
                line = stream.readline()
                answers[place] = json.loads(line) if line else None
                selector.unregister(stream)
    return answers


def _end(process: subprocess.Popen) -> bool:
    """Return True where the process had to be killed. One stuck in a driver is left behind."""
    try:
        process.wait(timeout=1.0 if process.poll() is None else 0)
        killed = False
    except subprocess.TimeoutExpired:
        process.kill()
        killed = True
        try:
            process.wait(timeout=_DIES_WITHIN_S)
        except subprocess.TimeoutExpired:
            print(f"process {process.pid} does not die; it is left behind", file=sys.stderr)
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with suppress(BrokenPipeError):
                stream.close()
    return killed


def _outcome(
    process: subprocess.Popen, ready: dict[str, Any] | None, done: dict[str, Any] | None, killed: bool
) -> _Outcome:
    renderer = ready["renderer"] if ready else ""
    if done is not None:
        return _Outcome(renderer, done["frames"] / done["spent_s"], "")
    when = "drawing" if ready else "starting"
    return _Outcome(renderer, 0.0, f"killed {when}" if killed else f"code {process.returncode} {when}")


def _counts(otherwise: str) -> list[int]:
    return [int(each) for each in os.environ.get(COUNTS, otherwise).split()]
