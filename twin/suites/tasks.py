"""Tasks in order and their results; run serially here, or on a cluster (see `dask_runner`)."""

from __future__ import annotations

import faulthandler
import os
import sys
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from trackers.errors import PLUG_IN_ERRORS, InputError, PlugInError
from twin.recording.atomic_file import NO_SPACE
from twin.run.tracker_runner import first_line

CallStatus = Literal["done", "bad input", "no space", "raised"]

_LOG_TAIL_BYTES = 4000


@dataclass(frozen=True)
class CallResult:
    """Result of one call: the value, or a message, with the traceback if it raised."""

    status: CallStatus
    value: Any
    seconds: float
    message: str = ""


def call_task(function: Callable[[Any], Any], work: Any, limit_s: float, log: Path | None, killed: bool) -> CallResult:
    """Call `function(work)`; exceptions are returned as a value, so that none has to be sent.

    log: file for all output of the process meanwhile, stacks of a crash included (None: none). killed: whether a call that
    outlasts `limit_s` [s] ends its process, with the stacks in the log; this works even in compiled code that blocks all
    threads. For processes of our own only.
    """
    start = time.perf_counter()

    def spent_s() -> float:
        return time.perf_counter() - start

    try:
        with _logged(log, limit_s if killed else None):
            return CallResult("done", function(work), spent_s())
    except InputError as error:
        cause = error.__cause__
        full = isinstance(cause, OSError) and cause.errno in NO_SPACE
        return CallResult("no space" if full else "bad input", None, spent_s(), str(error))
    except OSError as error:  # also of the log: a full disk can prevent opening or writing it
        if error.errno in NO_SPACE:
            message = f"{error.filename or log or 'a file'}: cannot be written ({error.strerror})"
            return CallResult("no space", None, spent_s(), message)
        return CallResult("raised", None, spent_s(), _format_error(error))
    except PLUG_IN_ERRORS as error:  # a plug-in that exits is only a failed case
        return CallResult("raised", None, spent_s(), _format_error(error))


def _format_error(error: BaseException) -> str:
    """Format an exception: its message on a line of its own, then the traceback."""
    what = str(error) if isinstance(error, PlugInError) else f"{type(error).__name__}: {error}"
    return f"{first_line(what)}\n{traceback.format_exc()}"


def log_tail(log: Path | None) -> str:
    """Read the end of a log; "" where there is none."""
    if log is None or not log.is_file():
        return ""
    with log.open("rb") as stream:
        stream.seek(max(0, log.stat().st_size - _LOG_TAIL_BYTES))
        return stream.read().decode("utf-8", errors="replace").strip()


@contextmanager
def _logged(log: Path | None, deadline_s: float | None) -> Iterator[None]:
    """Redirect the process's output to the log; past the deadline [s] write the stacks there and exit."""
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


MAX_RETRIES = 2
"""Retries of a task whose worker died or hung."""


@dataclass(frozen=True)
class Task:
    """Work for one call within `limit_s` [s].

    shares: name of a by-product for other tasks (such as a recording): no other task with this name starts while one runs
    for the first time.
    """

    id: str
    work: Any
    limit_s: float
    shares: str | None = None


@dataclass(frozen=True)
class TaskResult:
    """Result of a task: the value, or the error, several lines with a log."""

    task: Task
    status: Literal["done", "failed"]
    attempts: int
    seconds: float
    value: Any = None
    error: str = ""


@dataclass(frozen=True)
class State:
    """State of a run of tasks; `workers`: their present number."""

    waiting: int
    running: int
    done: int
    failed: int
    workers: int


class OutOfSpaceError(InputError):
    """Full disk, so that no further task can succeed."""


@dataclass
class TaskListener:
    """Callbacks in the caller's thread: each start (task, number of the try), each end, and the state."""

    started: Callable[[Task, int], object] = lambda task, number: None
    ended: Callable[[TaskResult], object] = lambda ended: None
    state: Callable[[State], object] = lambda state: None


class TaskQueue:
    """Queue of the remaining tasks, in order, with counts of those ended."""

    def __init__(self, tasks: Iterable[Task], listener: TaskListener) -> None:
        self._waiting = deque(tasks)
        self._making: dict[str, str] = {}  # shares: id of the first task, until it has ended
        self._made: set[str] = set()
        self._attempts: dict[str, int] = {}
        self._listener = listener
        self.done = 0
        self.failed = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def take(self) -> tuple[Task, int] | None:
        """Take the next task that may start now, and the number of its try; None without one.

        Tasks that others wait for go first: they take longest, and the others then fill the gaps.
        """
        usable = None
        for place, task in enumerate(self._waiting):
            if task.shares is None or task.shares in self._made:
                usable = place if usable is None else usable
            elif self._making.get(task.shares, task.id) == task.id:
                self._making[task.shares] = task.id
                usable = place
                break
        if usable is None:
            return None
        task = self._waiting[usable]
        del self._waiting[usable]
        number = self._attempts[task.id] = self._attempts.get(task.id, 0) + 1
        self._listener.started(task, number)
        return task, number

    def interrupted(self, task: Task, seconds: float, error: str) -> None:
        """Retry a task whose worker has died, or fail it after the last retry."""
        if self._attempts[task.id] <= MAX_RETRIES:
            self._waiting.appendleft(task)
        else:
            self._end(task, "failed", seconds, error=error)

    def ended(self, task: Task, result: CallResult, log: Path | None) -> None:
        """End a task whose call returned or raised; there is no retry, since it would raise again."""
        if result.status == "no space":
            raise OutOfSpaceError(
                f"{result.message}; a disk with free space is needed, and --resume then does the rest"
            )
        if result.status == "done":
            self._end(task, "done", result.seconds, value=result.value)
        else:
            tail = log_tail(log) if result.status == "raised" else ""
            self._end(task, "failed", result.seconds, error="\n".join(part for part in (result.message, tail) if part))

    def _end(
        self, task: Task, status: Literal["done", "failed"], seconds: float, value: Any = None, error: str = ""
    ) -> None:
        if task.shares is not None:
            self._making.pop(task.shares, None)
            self._made.add(task.shares)
        self.done += status == "done"
        self.failed += status == "failed"
        self._listener.ended(TaskResult(task, status, self._attempts.pop(task.id), seconds, value, error))

    def report(self, running: int, workers: int) -> None:
        """Report the state to the listener."""
        self._listener.state(State(len(self._waiting), running, self.done, self.failed, workers))


def run_serial(tasks: Iterable[Task], function: Callable[[Any], Any], listener: TaskListener) -> None:
    """Run the tasks serially in this process, for debugging: without time limits, and a crash ends all.

    Raises OutOfSpaceError where a disk is full; exceptions of the listener pass through.
    """
    todo = TaskQueue(tasks, listener)
    while (next_one := todo.take()) is not None:
        task, _ = next_one
        todo.report(1, 1)
        todo.ended(task, call_task(function, task.work, task.limit_s, None, killed=False), None)
    todo.report(0, 1)
