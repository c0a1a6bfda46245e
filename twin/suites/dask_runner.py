"""Run many tasks to their end, whatever happens to their workers, and report their progress.

Every task is put on a chosen worker, one at a time, so that it is known what each does and since when. A worker that dies
takes its task's attempt with it. One that hangs is ended, first by the watchdog in its own process, else by its nanny.
Either way the task is retried elsewhere, and the rest goes on.
"""

from __future__ import annotations

import queue
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.progress import BarColumn, Progress, TextColumn

from trackers.errors import InputError
from twin.console import PlainConsole
from twin.messages import counted
from twin.suites.cluster import Cluster, Workers, open_cluster
from twin.suites.tasks import MAX_RETRIES, State, Task, TaskListener, TaskQueue, call_task, log_tail, run_serial

if TYPE_CHECKING:
    from distributed import Future


@dataclass(frozen=True)
class ProgressListener:
    """Callbacks for the progress of a run.

    Before it starts: the plan and the address of the Dask dashboard, if any; then state, failed cases and warnings.
    """

    dashboard: Callable[[str], object] = lambda address: None
    failed: Callable[[str, str], object] = lambda case_id, error: None
    warned: Callable[[str], object] = lambda warning: None
    state: Callable[[State], object] = lambda state: None
    planned: Callable[[str], object] = lambda what: None


_LINE_EVERY_S = 15.0


@contextmanager
def suite_progress() -> Iterator[ProgressListener]:
    """Show cases done, running, failed and the time left on stderr: a bar in a terminal, else a line every 15 s.

    After an interrupt it says how to go on.
    """
    console = PlainConsole(stderr=True)
    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.fields[text]}", markup=False),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
    clock = _Clock()
    last_line_s = 0.0

    def state(now: State) -> None:
        nonlocal last_line_s
        total = now.waiting + now.running + now.done + now.failed
        text = f"{now.done} done, {now.running} running, {now.failed} failed, {clock.left(now)}"
        bar.update(task, total=total, completed=now.done + now.failed, text=text)
        if not console.is_terminal and time.monotonic() - last_line_s > _LINE_EVERY_S:
            last_line_s = time.monotonic()
            print(f"of {counted(total, 'case')} {text}", file=sys.stderr, flush=True)

    def failed(case_id: str, error: str) -> None:
        console.print(f"failed: {case_id}: {error.splitlines()[0] if error else ''}", soft_wrap=True)

    with _resume_hint(), bar:
        task = bar.add_task("cases", text="")
        yield ProgressListener(
            dashboard=lambda address: console.print(f"Dask dashboard: {address}", soft_wrap=True),
            failed=failed,
            warned=lambda warning: console.print(f"twin: warning: {warning}", soft_wrap=True),
            state=state,
            planned=lambda what: print(f"twin: planned: {what}", file=sys.stderr, flush=True),
        )


@contextmanager
def _resume_hint() -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        print("the cases that are done are kept; --resume does the rest", file=sys.stderr)
        raise


class _Clock:
    """Estimate of the remaining time, from the cases that ended after the first one, which starts its worker and imports."""

    def __init__(self) -> None:
        self._ended_at_start: int | None = None
        self._first_s: float | None = None  # when the first case ended
        self._ended_first = 0

    def left(self, now: State) -> str:
        ended = now.done + now.failed
        if self._ended_at_start is None:
            self._ended_at_start = ended  # an earlier run's
        elif self._first_s is None and ended > self._ended_at_start:
            self._first_s, self._ended_first = time.monotonic(), ended
        rest = now.waiting + now.running
        if rest == 0:
            return "all ended"
        if now.workers == 0:
            return "no worker yet"
        if self._first_s is None or ended - self._ended_first < now.workers:  # as many end together
            return "time left not known yet"
        left_s = (time.monotonic() - self._first_s) / (ended - self._ended_first) * rest
        return f"about {left_s:.0f} s left" if left_s < 100 else f"about {left_s / 60:.0f} min left"


_GRACE_S = 10.0
"""Delay of this watchdog after that of the worker's own process."""

_RESTART_S = 60.0

_POLL_S = 0.5

_SETTLED_S = 1.0
"""Time after its start during which a worker gets no task: should it die before its nanny has noted it, none replaces it."""

_MISSED_S = 60.0
"""Time after which we replace a missing worker."""

_WORKERS_AWAITED_S = 300.0

_FETCH_S = 60.0


@dataclass(eq=False)
class _Running:
    task: Task
    number: int
    future: Future
    since_s: float
    log: Path | None
    ended_by_us: bool = False

    def spent_s(self) -> float:
        return time.monotonic() - self.since_s


def run_on(
    cluster: Cluster,
    tasks: Iterable[Task],
    function: Callable[[Any], Any],
    listener: TaskListener,
    logs: Path | None = None,
) -> None:
    """Run the tasks on the cluster's workers; `function` must be importable there.

    logs: folder for one log per attempt, visible to the workers too (None: no logs). Raises OutOfSpaceError where a disk is
    full, InputError without workers or scheduler; exceptions of the listener pass through. Running tasks are then cancelled.
    """
    _TaskLoop(cluster, TaskQueue(tasks, listener), function, logs).to_the_end()


class _TaskLoop:
    def __init__(self, cluster: Cluster, todo: TaskQueue, function: Callable[[Any], Any], logs: Path | None) -> None:
        self._cluster = cluster
        self._todo = todo
        self._function = function
        self._logs = logs
        self._running: dict[str, _Running] = {}  # by the worker's address
        self._finished: queue.SimpleQueue[Future] = queue.SimpleQueue()
        self._workers = dict.fromkeys(cluster.workers() or {}, True)  # by address, whether it accepts work
        self._known_since_s = dict.fromkeys(self._workers, float("-inf"))
        self._all_there_s = time.monotonic()
        self._excluded: set[str] = set()
        self._restarts: list[threading.Thread] = []
        self._polled_s = -_POLL_S
        self._worker_seen_s = time.monotonic()

    def to_the_end(self) -> None:
        """Start, collect and watch until nothing is left."""
        try:
            while len(self._todo) or self._running:
                self._look_at_workers()
                self._start_what_may()
                self._todo.report(len(self._running), len(self._workers))
                self._collect()
                self._end_what_hangs()
            self._todo.report(0, len(self._workers))
        finally:
            left = [each.future for each in self._running.values()]
            if left:
                self._cluster.client.cancel(left, force=True)
            for restart in self._restarts:
                restart.join(_RESTART_S)

    def _look_at_workers(self) -> None:
        now_s = time.monotonic()
        if now_s - self._polled_s < _POLL_S:
            return
        self._polled_s = now_s
        there = self._cluster.workers()
        if there is None:
            return
        self._known_since_s = {address: self._known_since_s.get(address, now_s) for address in there}
        self._workers = {
            address: ready and now_s - self._known_since_s[address] >= _SETTLED_S for address, ready in there.items()
        }
        if len(there) >= self._cluster.n_worker:
            self._all_there_s = now_s
        elif now_s - self._all_there_s > _MISSED_S:
            self._cluster.replace_missing(len(there))
            self._all_there_s = now_s
        if self._workers:
            self._worker_seen_s = now_s
        elif now_s - self._worker_seen_s > _WORKERS_AWAITED_S:
            raise InputError(
                f"no worker has been there for {_WORKERS_AWAITED_S:g} s; a cluster with workers is expected, "
                "and --resume then does the rest"
            )
        for address in set(self._running) - set(self._workers):
            self._lost(address)
        self._excluded &= set(self._workers)

    def _start_what_may(self) -> None:
        for address, ready in self._workers.items():
            if len(self._running) >= (self._cluster.n_worker or float("inf")):
                return
            if not ready or address in self._running or address in self._excluded:
                continue
            next_one = self._todo.take()
            if next_one is None:
                return
            task, number = next_one
            log = self._logs / f"{task.id}.{number}.log" if self._logs is not None else None
            future = self._cluster.client.submit(
                call_task,
                self._function,
                task.work,
                task.limit_s,
                log,
                killed=True,
                key=f"{task.id}.{number}.{id(self):x}",
                workers=[address],
                resources=dict(self._cluster.resources) or None,
                pure=False,
            )
            self._running[address] = _Running(task, number, future, time.monotonic(), log)
            future.add_done_callback(self._finished.put)

    def _collect(self) -> None:
        """Wait a short time for tasks to finish, then collect all that have."""
        try:
            future = self._finished.get(timeout=_POLL_S)
        except queue.Empty:
            return
        while True:
            self._take(future)
            try:
                future = self._finished.get_nowait()
            except queue.Empty:
                return

    def _take(self, future: Future) -> None:
        address = next((key for key, each in self._running.items() if each.future is future), None)
        if address is None:  # given up before
            return
        if future.status != "finished":
            self._lost(address)
            return
        one = self._running[address]
        try:
            result = future.result(timeout=_FETCH_S)
        except Exception as error:  # the worker died with the result, or the result cannot be sent
            self._lost(address, f"gave no result that could be fetched ({type(error).__name__}: {error})")
            return
        del self._running[address]
        future.release()
        self._todo.ended(one.task, result, one.log)

    def _lost(self, address: str, message: str = "") -> None:
        """Return the task of a dead worker to the queue, or fail it after the last retry."""
        one = self._running.pop(address)
        spent_s = one.spent_s()
        self._polled_s = -_POLL_S
        self._workers.pop(address, None)
        if one.ended_by_us or spent_s >= one.task.limit_s:
            message = f"did not end within its time limit of {one.task.limit_s:g} s"
        else:
            message = message or _reason(one.future) or f"its worker died after {spent_s:.1f} s"
        tail = log_tail(one.log)
        self._cluster.client.cancel([one.future], force=True)
        attempts = f"{message}, after {one.number - 1} of {MAX_RETRIES} retries"
        self._todo.interrupted(one.task, spent_s, "\n".join(part for part in (attempts, tail) if part))

    def _end_what_hangs(self) -> None:
        for address, one in self._running.items():
            if not one.ended_by_us and one.spent_s() > one.task.limit_s + _GRACE_S:
                one.ended_by_us = True
                self._excluded.add(address)
                self._restarts.append(threading.Thread(target=self._restart, args=[address], daemon=True))
                self._restarts[-1].start()

    def _restart(self, address: str) -> None:
        """Have the nanny replace the worker; without one, the scheduler excludes it."""
        with suppress(OSError, TimeoutError):  # then it stays set aside
            self._cluster.client.restart_workers([address], timeout=_RESTART_S, raise_for_error=False)


def _reason(future: Future) -> str:
    """Describe the reason why a worker could not run the task; "" where the worker was killed."""
    from distributed import KilledWorker

    error = future.exception(timeout=_FETCH_S) if future.status == "error" else None
    return (
        ""
        if error is None or isinstance(error, KilledWorker)
        else f"could not be run ({type(error).__name__}: {error})"
    )


RunTasks = Callable[[Sequence[Task], Callable[[Any], Any], TaskListener, Path | None], None]


def open_workers(workers: Workers, stack: ExitStack, progress: ProgressListener) -> RunTasks:
    """Open the workers until the stack is closed; return the function that runs tasks there. Raises as `open_cluster`."""
    if workers.scheduler is None and workers.jobs == 1:
        return lambda tasks, function, listener, logs: run_serial(tasks, function, listener)
    cluster = stack.enter_context(open_cluster(workers.jobs, workers.scheduler, workers.resources))
    if cluster.dashboard is not None:
        progress.dashboard(cluster.dashboard)
    return lambda tasks, function, listener, logs: run_on(cluster, tasks, function, listener, logs)
