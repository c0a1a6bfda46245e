"""What a person at a terminal sees: progress on stderr, results on stdout."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from twin.progress import OnProgress
from twin.report.figures_table import judged_text
from twin.shown import shown

_ROWS = (
    ("MOTA", "mota", "{:.3f}"),
    ("MOTP [m]", "motp_m", "{:.3f}"),
    ("IDF1", "idf1", "{:.3f}"),
    ("HOTA", "hota", "{:.3f}"),
    ("GOSPA [m]", "gospa_m", "{:.3f}"),
    ("OSPA [m]", "ospa_m", "{:.3f}"),
    ("identity switches", "id_switches", "{:d}"),
    ("misidentifications", "misidentifications", "{:d}"),
    ("lost tracks", "lost_tracks", "{:d}"),
    ("false positives", "false_positives", "{:d}"),
    ("misses", "misses", "{:d}"),
)


class PlainConsole(Console):
    """Prints texts as they are: what users and strangers have written is no markup, and moves no cursor."""

    def __init__(self, *, stderr: bool = False, width_of_file: int | None = None) -> None:
        """`width_of_file`: how wide a line is where the output is no terminal; None: 80 characters."""
        super().__init__(stderr=stderr, markup=False, emoji=False, highlight=False)
        if width_of_file is not None and not self.is_terminal:
            self.width = width_of_file

    def render_str(self, text: str, **options: Any) -> Text:
        """The text with control characters escaped."""
        return super().render_str(shown(text), **options)

    def on_broken_pipe(self) -> None:
        """Leave it to the command line what a closed pipe means."""
        raise BrokenPipeError


@contextmanager
def progress() -> Iterator[OnProgress]:
    """A progress bar on stderr for as long as the block runs; gives the function to report to."""
    bar = Progress(
        TextColumn("{task.description:<28}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
        console=PlainConsole(stderr=True),
        transient=True,
    )
    tasks: dict[str, Any] = {}

    def report(what: str, done: float, total: float) -> None:
        if what not in tasks:
            tasks[what] = bar.add_task(what, total=total)
        bar.update(tasks[what], completed=done, total=total)

    with bar:
        yield report


def print_metrics(metrics: Mapping[str, Any]) -> None:
    """The table of metrics, a column a tracker."""
    trackers = metrics["trackers"]
    table = Table()
    table.add_column("")
    for name in trackers:
        table.add_column(name, justify="right")
    table.add_row("evaluated in", *(judged_text(figures) for figures in trackers.values()))
    for label, key, form in _ROWS:
        values = [figures[key] for figures in trackers.values()]
        table.add_row(label, *("–" if value is None else form.format(value) for value in values))
    costs = [figures["ms_per_frame"]["mean"] for figures in trackers.values()]
    table.add_row("ms per frame", *("–" if cost is None else f"{cost:.2f}" for cost in costs))
    console = PlainConsole(width_of_file=100)
    console.print(f"{metrics['scenario']}, seed {metrics['seed']}, {metrics['duration_s']:g} s, gate 0.5 m")
    console.print(table)
    console.print(f"{metrics['realtime_factor']:.1f} × real time")


def print_warnings(warnings: Iterable[str]) -> None:
    """What a user should know before they trust a result, on stderr."""
    for warning in warnings:
        print_warning(warning)


def print_warning(warning: str) -> None:
    """One thing a user should know before they trust a result, on stderr."""
    sys.stderr.write(f"twin: warning: {shown(warning)}\n")


def print_paths(files: Mapping[str, Path]) -> None:
    """Where the results are, one path a line."""
    width = max(map(len, files), default=0)
    for name, path in files.items():
        print(shown(f"{name:{width}}  {path}"))
