"""Progress of a suite's run: callbacks, and a display for terminals."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rich.progress import BarColumn, Progress, TextColumn

from twin.console import PlainConsole
from twin.suites.tasks import State


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
    """Show cases done, running, failed and the time left on stderr: a bar in a terminal, else a line every 15 s."""
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
            print(f"of {total} cases {text}", file=sys.stderr, flush=True)

    def failed(case_id: str, error: str) -> None:
        console.print(f"failed: {case_id}: {error.splitlines()[0] if error else ''}", soft_wrap=True)

    with bar:
        task = bar.add_task("cases", text="")
        yield ProgressListener(
            dashboard=lambda address: console.print(f"Dask dashboard: {address}", soft_wrap=True),
            failed=failed,
            warned=lambda warning: console.print(f"warning: {warning}", soft_wrap=True),
            state=state,
            planned=lambda what: print(f"twin: to make: {what}", file=sys.stderr, flush=True),
        )


class _Clock:
    """Estimate of the remaining time, from the cases that ended since the first call."""

    def __init__(self) -> None:
        self._start_s: float | None = None
        self._ended_before = 0

    def left(self, now: State) -> str:
        ended = now.done + now.failed
        if self._start_s is None:
            self._start_s, self._ended_before = time.monotonic(), ended
        rest = now.waiting + now.running
        if rest == 0:
            return "all ended"
        if now.workers == 0:
            return "no worker yet"
        if ended == self._ended_before:
            return "time left not known yet"
        left_s = (time.monotonic() - self._start_s) / (ended - self._ended_before) * rest
        return f"about {left_s:.0f} s left" if left_s < 100 else f"about {left_s / 60:.0f} min left"
