"""What a person at a terminal sees of a finished study."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from trackers.errors import InputError
from trackers.plain_data import parse_json
from trackers.text_file import read_text
from twin.console import PlainConsole

_EXPECTED = "a folder that `twin study run` has finished"


def print_summary(folder: Path) -> None:
    """Print the answers of a study; raises InputError for a folder without them."""
    path = folder / "summary.json"
    content = parse_json(read_text(path, _EXPECTED), str(path), _EXPECTED)
    console = PlainConsole()
    try:
        _print(console, content)
    except (KeyError, TypeError) as error:
        raise InputError(f"{path}: lacks {error}; {_EXPECTED} is expected") from error


def _print(console: Console, found: dict[str, Any]) -> None:
    objective = found["objective"]
    table = Table(
        title=f"{found['study']}: {found['candidates'] - 1} candidates beside the scenario's own", title_justify="left"
    )
    covers = objective == "coverage"
    for heading in ("placement", objective, *(() if covers else ("coverage",)), "price", "seeds"):
        table.add_column(heading, justify="left" if heading == "placement" else "right")
    shown = {each["candidate"]: each for each in (found["own"], found["best"], *found["pareto"])}
    for each in shown.values():
        mark = "recommended: " if each["candidate"] == found["best"]["candidate"] else ""
        table.add_row(
            mark + each["places"],
            _text(each.get(objective)),
            *(() if covers else (_text(each["coverage"]),)),
            f"{each['price']:g}",
            str(each["seeds"]),
        )
    console.print(table)
    for row in found["held_out"]:
        console.print(f"held out, {row['what']}: {_text(row['other'])} -> {_text(row['ours'])}, {_interval(row)}")
    for row in found["proven"]:
        devices = ", ".join(f"{count} {name}" for name, count in row["devices"].items())
        exact = (
            f", exact {_text(row['exact'])} ({row['exact_is']}), greedy over exact {_text(row['greedy_over_exact'])}"
            if "exact" in row
            else ""
        )
        console.print(
            f"coverage, {devices}: greedy {_text(row['greedy'])}, none above {_text(row['greedy_bound'])}{exact}"
        )
    for row in found["misplaced"]:
        console.print(f"off by {row['what']}: {_interval(row)}")
    console.print(f"cannot be told from the best: {len(found['alike'])}")


def _text(value: float | None) -> str:
    return "–" if value is None else f"{value:.4f}"


def _interval(row: dict[str, Any]) -> str:
    found = row["difference"]
    if found is None:
        return "no difference could be worked out"
    interval = "" if found["low"] is None else f" [{found['low']:+.4f}, {found['high']:+.4f}]"
    return f"{found['mean']:+.4f}{interval} over {found['n']} seeds"
