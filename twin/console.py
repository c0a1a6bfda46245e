"""Output on the terminal: progress on stderr, results on stdout."""

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

from twin.messages import OnProgress, printable, sentence
from twin.report.metrics_table import METRICS, format_judged, format_value, metric_value

_SHOWN = (
    *("mota", "motp_m", "idf1", "hota", "gospa_m", "ospa_m", "id_switches", "misidentifications", "lost_tracks"),
    *("false_positives", "misses", "ms_per_frame.mean"),
)
"""Metrics of the terminal's table, by their dotted path in a tracker's entry of `metrics.json`."""


class PlainConsole(Console):
    """Console that prints texts literally: no markup, no control characters."""

    def __init__(self, *, stderr: bool = False, width_of_file: int | None = None) -> None:
        """Make a console; `width_of_file`: line width if the output is no terminal (None: 80 characters)."""
        super().__init__(stderr=stderr, markup=False, emoji=False, highlight=False)
        if width_of_file is not None and not self.is_terminal:
            self.width = width_of_file

    def render_str(self, text: str, **options: Any) -> Text:
        """Render the text with control characters escaped."""
        return super().render_str(printable(text), **options)

    def on_broken_pipe(self) -> None:
        """Raise, so that the command line handles a closed pipe."""
        raise BrokenPipeError


@contextmanager
def progress() -> Iterator[OnProgress]:
    """Show a progress bar on stderr during the block; yield the callback to report to."""
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
    """Print a table of metrics, one column per tracker."""
    trackers = metrics["trackers"]
    table = Table()
    table.add_column("")
    for name in trackers:
        table.add_column(name, justify="right")
    table.add_row("evaluated in", *(format_judged(own) for own in trackers.values()))
    for metric in (METRICS[key] for key in _SHOWN):
        name = f"{metric.name} [{metric.unit}]" if metric.unit else metric.name
        table.add_row(name, *(format_value(metric, metric_value(own, metric)) for own in trackers.values()))
    console = PlainConsole(width_of_file=100)
    console.print(f"{metrics['scenario']}, seed {metrics['seed']}, {metrics['duration_s']:g} s, gate 0.5 m")
    console.print(table)
    console.print(f"{metrics['realtime_factor']:.1f} × real time")


def print_warnings(warnings: Iterable[str]) -> None:
    """Print warnings about a result on stderr."""
    for warning in warnings:
        print_warning(warning)


def print_warning(warning: str) -> None:
    """Print one warning about a result on stderr."""
    sys.stderr.write(f"twin: warning: {sentence(warning)}\n")


def print_paths(files: Mapping[str, Path]) -> None:
    """Print the paths of the results, one per line."""
    width = max(map(len, files), default=0)
    for name, path in files.items():
        print(printable(f"{name:{width}}  {path}"))
