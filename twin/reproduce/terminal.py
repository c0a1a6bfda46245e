"""The results of a reproduction as a person at a terminal sees them."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from twin.console import PlainConsole
from twin.reproduce.page import text_of
from twin.reproduce.results import Result


def print_results(title: str, results: Sequence[Result]) -> None:
    """A table on stdout, the paper's figures beside ours."""
    table = Table(title=title)
    for heading in ("where", "row", "figure"):
        table.add_column(heading)
    for heading in ("paper", "ours", "95 %"):
        table.add_column(heading, justify="right", no_wrap=True)
    for result in results:
        table.add_row(result.where, result.row, result.column, *text_of(result))
    PlainConsole(width_of_file=150).print(table)
