"""Who is who: the table `truth_people.csv`, which gives the name of each id that the other tables of the truth hold."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from twin.recording.whole_file import whole_file
from twin.tables.columns import read_csv_columns

PEOPLE_COLUMNS = ("id", "name")


def write_people(path: Path, names: Mapping[int, str]) -> None:
    """Write a row for each person of the scenario, whether they ever come or not, by id.

    Raises InputError where the file cannot be written.
    """
    with whole_file(path) as stream:
        stream.write(",".join(PEOPLE_COLUMNS) + "\n")
        for number, name in sorted(names.items()):
            stream.write(f"{number},{name}\n")


def read_people(path: Path) -> dict[int, str]:
    """The names by id; raises InputError naming file, line, column and value."""
    columns = read_csv_columns(path, PEOPLE_COLUMNS, "table of people")
    return dict(zip(columns.integers("id", minimum=1).tolist(), columns.cells["name"], strict=True))
