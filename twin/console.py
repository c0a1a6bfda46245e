"""Output on the terminal: progress on stderr, results on stdout."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from twin.messages import OnProgress, TrackerLog, printable, sentence
from twin.report.metrics_table import METRICS, format_judged, format_value, judged_note, metric_value

_SHOWN = (
    *("mota", "motp_m", "idf1", "hota", "gospa_m", "ospa_m", "id_switches", "misidentifications", "lost_tracks"),
    *("false_positives", "misses", "ms_per_frame.mean"),
)
"""Metrics of the terminal's table, by their dotted path in a tracker's entry of `metrics.json`."""


_WIDTH_OF_FILE = 140
"""Characters of a line where the output is no terminal."""
_PADDING = 3
"""Characters that a column of a table takes beside its cells."""


class PlainConsole(Console):
    """Console that prints texts literally: no markup, no control characters."""

    def __init__(self, *, stderr: bool = False) -> None:
        """Make a console as wide as the terminal; without one as the variable COLUMNS says, or 140 characters."""
        super().__init__(stderr=stderr, markup=False, emoji=False, highlight=False)
        self.is_bounded = self.is_terminal or os.environ.get("COLUMNS", "").isdigit()
        if not self.is_bounded:
            self.width = _WIDTH_OF_FILE

    def render_str(self, text: str, **options: Any) -> Text:
        """Render the text with control characters escaped."""
        return super().render_str(printable(text), **options)

    def on_broken_pipe(self) -> None:
        """Raise, so that the command line handles a closed pipe."""
        raise BrokenPipeError


@contextmanager
def progress(first: str = "") -> Iterator[OnProgress]:
    """Show a progress bar on stderr during the block; yield the callback to report to.

    first: line printed when work begins, after the input was checked.
    """
    console = PlainConsole(stderr=True)
    bar = Progress(
        TextColumn("{task.description:<28}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
    tasks: dict[str, Any] = {}

    def report(what: str, done: float, total: float) -> None:
        if first and not tasks:
            sys.stderr.write(f"{first}\n")
        if what not in tasks:
            tasks[what] = bar.add_task(what, total=total)
        bar.update(tasks[what], completed=done, total=total)

    with bar:
        yield report


def without_empty(
    heads: Sequence[str], rows: Sequence[Sequence[str] | None], names: int
) -> tuple[list[str], list[list[str] | None]]:
    """Leave out the columns of metrics, after those of names, that have no value in any row."""
    held = [row for row in rows if row is not None]
    kept = [place for place in range(len(heads)) if place < names or any(row[place] not in ("–", "") for row in held)]
    return [heads[place] for place in kept], [None if row is None else [row[place] for place in kept] for row in rows]


def print_table(heads: Sequence[str], rows: Sequence[Sequence[str] | None], *, names: int = 1, title: str = "") -> None:
    """Print a table of values on stdout, `names` columns of names first; None among the rows draws a line.

    Nothing is cut. Values stay on one line; names and headings break between words, as little as the width allows. Where a
    terminal is too narrow for that, the values follow in further tables with the same names.
    """
    console = PlainConsole()
    columns = [[head, *(row[place] for row in rows if row is not None)] for place, head in enumerate(heads)]
    least = [
        max([_longest_word(head), *map(_longest_word if place < names else len, cells)])
        for place, (head, *cells) in enumerate(columns)
    ]
    spare_of = [max(map(len, cells)) - width for cells, width in zip(columns, least, strict=True)]
    for part in _parts(least, names, console.width) if console.is_bounded else [list(range(len(heads)))]:
        spare = max(console.width - _total_width(least, part), 0)
        table = Table(title=title, title_justify="left")
        widths = list(least)
        for n_before, place in enumerate(sorted(part, key=spare_of.__getitem__)):
            more = min(spare_of[place], spare // (len(part) - n_before))
            widths[place], spare = widths[place] + more, spare - more
        for place in part:
            table.add_column(heads[place], justify="left" if place < names else "right", width=widths[place])
        for row in rows:
            if row is None:
                table.add_section()
            else:
                table.add_row(*(row[place] for place in part))
        wide = PlainConsole()
        wide.width = max(console.width, _total_width(widths, part))
        wide.print(table)
        title = ""


def _longest_word(text: str) -> int:
    return max(map(len, text.split()), default=0)


def _total_width(widths: Sequence[int], part: Sequence[int]) -> int:
    """Return the width of a table of these columns with its lines."""
    return 1 + sum(widths[place] + _PADDING for place in part)


def _parts(widths: Sequence[int], names: int, most: int) -> list[list[int]]:
    """Split columns into tables no wider than `most` where a name and a value fit, each with the columns of names."""
    parts = [list(range(names))]
    for place in range(names, len(widths)):
        if _total_width(widths, [*parts[-1], place]) > most and len(parts[-1]) > names:
            parts.append(list(range(names)))
        parts[-1].append(place)
    return parts


def print_metrics(metrics: Mapping[str, Any]) -> None:
    """Print a table of metrics, one column per tracker; none where no tracker was evaluated."""
    trackers = metrics["trackers"]
    if not trackers:
        return
    rows: list[list[str]] = []
    for metric in (METRICS[key] for key in _SHOWN):
        name = f"{metric.name} [{metric.unit}]" if metric.unit else metric.name
        rows.append([name, *(format_value(metric, metric_value(own, metric)) for own in trackers.values())])
    console = PlainConsole()
    console.print(f"{metrics['scenario']}, seed {metrics['seed']}, {metrics['duration_s']:g} s, gate 0.5 m")
    # Beside the values it would make each column too wide for a terminal.
    judged = {name: format_judged(own) for name, own in trackers.items()}
    alike = len({*judged.values()}) == 1
    said = [each if alike else f"{each} ({name})" for name, each in judged.items()]
    console.print(f"evaluated in {'; '.join(dict.fromkeys(said))}", soft_wrap=True)
    print_table(["", *trackers], rows)
    if note := judged_note(trackers):
        console.print(note, soft_wrap=True)
    console.print(f"{metrics['realtime_factor']:.1f} × real time")


def print_warnings(warnings: Iterable[str]) -> None:
    """Print warnings about a result on stderr."""
    for warning in warnings:
        print_warning(warning)


def print_warning(warning: str) -> None:
    """Print one warning about a result on stderr, unless the tracker has logged it meanwhile."""
    if sentence(warning) not in TrackerLog.printed:
        sys.stderr.write(f"twin: warning: {sentence(warning)}\n")


def print_paths(files: Mapping[str, Path | str]) -> None:
    """Print the paths of the results, one per line, and what is said with them."""
    width = max(map(len, files), default=0)
    for name, path in files.items():
        print(printable(f"{name:{width}}  {path}"))
