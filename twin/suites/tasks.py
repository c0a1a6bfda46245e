"""Tasks to run, in order, and how each ended; one after the other here, or on a cluster (see `engine`)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from trackers.errors import InputError
from twin.suites.attempt import Attempt, attempt, log_tail

MOST_ATTEMPTS = 3
"""A task whose worker died or hung is tried again twice."""


@dataclass(frozen=True)
class Task:
    """Work for one call. limit_s: how long it may take [s].

    shares: what it makes for other tasks to use (a recording, say): while one task with this word runs for the first
    time, no other one with it is started.
    """

    id: str
    work: Any
    limit_s: float
    shares: str | None = None


@dataclass(frozen=True)
class Ended:
    """How a task ended: the value where it is done, else the error, several lines where there is a log."""

    task: Task
    status: Literal["done", "failed"]
    attempts: int
    seconds: float
    value: Any = None
    error: str = ""


@dataclass(frozen=True)
class State:
    """How far a run of tasks is; `workers`: how many there are now."""

    waiting: int
    running: int
    done: int
    failed: int
    workers: int


class OutOfSpaceError(InputError):
    """A disk is full, so that no further task can end well either."""


@dataclass
class Listener:
    """Whom to tell, in the caller's thread: of each start (task, attempt), each end, and how far it is."""

    started: Callable[[Task, int], object] = lambda task, number: None
    ended: Callable[[Ended], object] = lambda ended: None
    state: Callable[[State], object] = lambda state: None


class TaskQueue:
    """The tasks to do, in order, and what has become of the others."""

    def __init__(self, tasks: Iterable[Task], listener: Listener) -> None:
        self._waiting = deque(tasks)
        self._making: dict[str, str] = {}  # shares: the id of the first task, until it has ended
        self._made: set[str] = set()
        self._attempts: dict[str, int] = {}
        self._listener = listener
        self.done = 0
        self.failed = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def take(self) -> tuple[Task, int] | None:
        """The next task that may start now, and which attempt it is; None where none may.

        Those that make something for others go first: they take longest, and the others then fill the gaps.
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
        """The worker is gone: try again, or give up."""
        if self._attempts[task.id] < MOST_ATTEMPTS:
            self._waiting.appendleft(task)
        else:
            self._end(task, "failed", seconds, error=error)

    def ended(self, task: Task, result: Attempt, log: Path | None) -> None:
        """The attempt came to its end. What it raised it would raise again: no second attempt."""
        if result.way == "no space":
            raise OutOfSpaceError(
                f"{result.message}; a disk with free space is needed, and --resume then does the rest"
            )
        if result.way == "done":
            self._end(task, "done", result.seconds, value=result.value)
        else:
            tail = log_tail(log) if result.way == "raised" else ""
            self._end(task, "failed", result.seconds, error="\n".join(part for part in (result.message, tail) if part))

    def _end(
        self, task: Task, status: Literal["done", "failed"], seconds: float, value: Any = None, error: str = ""
    ) -> None:
        if task.shares is not None:
            self._making.pop(task.shares, None)
            self._made.add(task.shares)
        self.done += status == "done"
        self.failed += status == "failed"
        self._listener.ended(Ended(task, status, self._attempts.pop(task.id), seconds, value, error))

    def tell(self, running: int, workers: int) -> None:
        """Tell how far it is."""
        self._listener.state(State(len(self._waiting), running, self.done, self.failed, workers))


def run_here(tasks: Iterable[Task], function: Callable[[Any], Any], listener: Listener) -> None:
    """Run the tasks one after the other in this process, for debugging: no time limit holds, and a crash ends it all.

    Raises OutOfSpaceError where a disk is full; what the listener raises comes through.
    """
    todo = TaskQueue(tasks, listener)
    while (next_one := todo.take()) is not None:
        task, _ = next_one
        todo.tell(1, 1)
        todo.ended(task, attempt(function, task.work, task.limit_s, None, killed=False), None)
    todo.tell(0, 1)
