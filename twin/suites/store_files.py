"""Open the results file of a run: a new one, an earlier one to resume, or any for reading."""

from __future__ import annotations

import os
import re
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from trackers.errors import InputError
from twin.messages import counted
from twin.run.out_folder import check_others, locked_folder
from twin.suites.cache import fault_of
from twin.suites.expansion import Case, with_variant
from twin.suites.store import EXPECTED, ResultStore, StoredCase, fault_of_file

RESULTS_FILE = "results.sqlite"
_WRITTEN = ("summary.json", "report.html", "junit.xml", "cases", "logs")

_WITH_NUMBER = re.compile(r"[\w-]*\d[\w.-]*")
"""A number, or a name that holds one, as those of drawn people."""

_OF_SUITE = ("description", "reference", "tolerances", "requirements")
"""Facts by which results are judged: those of the present suite hold."""


def kind_of_warning(text: str) -> str:
    """Return a warning without the numbers in it, by which cases that differ in a seed are warned of once."""
    return _WITH_NUMBER.sub("#", text)


@contextmanager
def open_store(
    folder: Path,
    cases: Sequence[Case],
    facts: Mapping[str, Any],
    resume: bool,
    warn: Callable[[str], object] = lambda warning: None,
) -> Iterator[ResultStore]:
    """Open the results in `folder` for writing, locked during the block.

    A new file holds the cases and `facts`; `resume` continues an earlier one. Cases whose inputs changed (scenario, room,
    tracker, prior files), or whose files did, are run again, with a warning to `warn`. Raises InputError where another process
    writes, where results exist without `resume`, and where they are of other cases, or of another suite, other changes or
    other code.
    """
    path = folder / RESULTS_FILE
    with locked_folder(folder):
        exists = path.exists()
        if exists and not resume:
            raise InputError(
                f"--out {folder}: holds the results of an earlier run; --resume to do the rest of it, or another folder, "
                "is expected"
            )
        check_others(folder, _WRITTEN, RESULTS_FILE)
        with _connected(path) as connection:
            store = ResultStore(connection, path)
            if exists and _is_defined(connection, path):
                with _sound(path):
                    _check_whole(connection, path)
                    _check_same(store, cases, facts)
                    damaged = {each.id for each in cases if fault_of(folder / "cases" / each.id)}
                    changed = store.resume(cases, damaged)
                store.note(**{name: facts[name] for name in _OF_SUITE if name in facts})
                if changed:
                    warn(rerun_warning(changed, len(cases)))
            else:
                with _sound(path):
                    store.create(cases)
                store.note(**facts)
            yield store


@contextmanager
def read_store(folder: Path) -> Iterator[ResultStore]:
    """Open the results in `folder` for reading, also during a run. Raises InputError where there are none."""
    path = folder / RESULTS_FILE
    if not path.is_file():
        raise InputError(f"{folder}: has no {RESULTS_FILE}; a folder that `twin suite run` has written is expected")
    is_ours = os.access(path, os.W_OK) and os.access(folder, os.W_OK)
    with _sound(path), (_connected if is_ours else _read_alone)(path) as connection:
        yield ResultStore(connection, path)


@contextmanager
def _read_alone(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a file in a read-only folder, where sqlite could not read otherwise; no process writes it meanwhile."""
    if (waiting := path.with_name(f"{RESULTS_FILE}-wal")).exists() and waiting.stat().st_size:
        raise InputError(
            f"{path}: is read-only, and holds what a run has not finished writing; a file and a folder that this user may "
            "write are expected"
        )
    connection = sqlite3.connect(f"{path.absolute().as_uri()}?immutable=1", uri=True)
    try:
        yield connection
    finally:
        connection.close()


def rerun_warning(changed: Mapping[str, Sequence[str]], n_all: int) -> str:
    """Format the warning that cases are run again because of changed inputs."""
    what = " and ".join(dict.fromkeys(part for parts in changed.values() for part in parts))
    first, *more = changed
    on = f" ({first} and {len(more)} more)" if more else f" ({first})"
    return f"--resume: {len(changed)} of {n_all} results are done again{on}: {what} changed since"


def _is_defined(connection: sqlite3.Connection, path: Path) -> bool:
    """Return whether the file has all tables; a run killed at its start leaves one without."""
    with _sound(path):
        query = "SELECT 1 FROM sqlite_master WHERE name = 'moments_of_case'"
        return connection.execute(query).fetchone() is not None


def _check_whole(connection: sqlite3.Connection, path: Path) -> None:
    """Raise InputError where any page of the file is damaged, also one read only at the end of the run."""
    found = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
    if found != "ok":
        raise InputError(f"{path}: is damaged ({' '.join(found.split())}); {EXPECTED}, or another folder, is expected")


@contextmanager
def _sound(path: Path) -> Iterator[None]:
    try:
        yield
    except sqlite3.OperationalError as error:
        if fault := fault_of_file(error):
            raise InputError(f"{path}: {fault}") from error
        raise InputError(f"{path}: is no file of results ({error}); {EXPECTED} is expected") from error
    except sqlite3.DatabaseError as error:
        raise InputError(f"{path}: is no file of results ({error}); {EXPECTED} is expected") from error


def _check_same(store: ResultStore, cases: Sequence[Case], facts: Mapping[str, Any]) -> None:
    held = store.facts()
    where = f"--resume: {store.path}"
    if held.get("suite") != facts.get("suite"):
        raise InputError(
            f"{where}: holds the suite {held.get('suite')!r}, not {facts.get('suite')!r}; the same suite, or another folder, is "
            "expected"
        )
    there, asked = {each.id: each for each in store.cases()}, {each.id: each for each in cases}
    missing = [each for name, each in asked.items() if name not in there]
    left_out = [each for name, each in there.items() if name not in asked]
    if missing or left_out:
        lacks = [f"lacks {_named(missing)}"] if missing else []
        lacks += [f"has {_named(left_out)} besides"] if left_out else []
        raise InputError(
            f"{where}: was made of other cases of the suite {held.get('suite')!r}: it {' and '.join(lacks)}; the suite as it "
            "was, or another folder, is expected"
        )
    if held.get("changes") != facts.get("changes"):
        raise InputError(f"{where}: was run with --set {held.get('changes')}; the same, or another folder, is expected")
    if held.get("code") != facts.get("code"):
        raise InputError(
            f"{where}: was made by other code, and results of two versions must not mix; another folder is expected "
            "(recordings that are still good are not made again)"
        )


def _named(cases: Sequence[Case | StoredCase]) -> str:
    """Name the first of some cases, by what a suite's file says of it, and count the others."""
    first, *more = cases
    one = ", ".join((with_variant(first.scenario, first.variant), f"seed {first.seed}", first.tracker))
    return f"{one}, and {counted(len(more), 'more case')}" if more else one


@contextmanager
def _connected(path: Path) -> Iterator[sqlite3.Connection]:
    connection = sqlite3.connect(path, timeout=30)
    try:
        with _sound(path):
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = NORMAL")
        yield connection
    finally:
        connection.close()
