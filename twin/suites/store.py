"""Results in one SQLite file, written case by case: finished cases survive the death of a run.

Tables: `cases` (case_id, status, attempts, seconds, error), `results` (case_id, scenario, seed, overrides, tracker, metric,
value), `definitions` (each case's inputs, in order), `recordings` (digests of each case's recording and of its people's
motion), `scanners` (noise of their ranges there), `moments` (times in a case to look at), `facts` (about the run).
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, ConfigDict, Field, FiniteFloat, Json, TypeAdapter, ValidationError

from trackers.configuration import Typed
from trackers.errors import InputError
from trackers.user_input.plain_data import parse_json
from twin.suites.cache_keys import Provenance
from twin.suites.expansion import Case
from twin.suites.metrics import Bound, Tolerance, check_ranges
from twin.suites.worker import Incident

WAITING, RUNNING, DONE, FAILED = "waiting", "running", "done", "failed"

EXPECTED = "a file of results as `twin suite run` wrote it"

_MOST_SHOWN = 80

_Content = TypeVar("_Content")

_TEXTS = TypeAdapter(Json[list[str]])


def _list_of_texts(text: str) -> str:
    _TEXTS.validate_python(text)
    return text


OverridesText = Annotated[str, AfterValidator(_list_of_texts)]
"""Overrides as JSON: a list of texts."""


@dataclass(frozen=True)
class StoredCase:
    """A case as the file holds it."""

    id: str
    scenario: str
    variant: str
    overrides: OverridesText
    seed: int
    tracker: str
    status: Literal["waiting", "running", "done", "failed"]
    attempts: int
    seconds: FiniteFloat | None
    error: str | None
    room: str = ""  # digest of the room; "": unknown


@dataclass(frozen=True)
class RecordingInfo:
    """Digests of a case's recording and of its people's motion ("": unknown), and its scanners' range noise."""

    digest: str = ""
    people: str = ""
    scatter_m: Mapping[str, FiniteFloat] = field(default_factory=dict)  # of each scanner's ranges, by its position


@dataclass(frozen=True)
class Requirement:
    """Bound of a metric that a tracker has to reach in a scenario, as a mean over its seeds."""

    scenario: str
    overrides: OverridesText
    tracker: str
    metric: str
    bound: Bound


class Facts(Typed):
    """Facts about a run as a whole."""

    model_config = ConfigDict(frozen=True)

    suite: str
    description: str
    code: str
    versions: dict[str, str | None]
    changes: list[str]
    tolerances: dict[str, Tolerance]
    requirements: list[Requirement] = Field(default_factory=list)
    reports: bool = True  # as the run began
    seconds: FiniteFloat
    renderers: list[str]
    tracker_warnings: dict[str, int] = Field(default_factory=dict)
    scenario_warnings: dict[str, int] = Field(default_factory=dict)
    warned_cases: dict[str, list[str]] = Field(default_factory=dict)  # by warning
    recipes: dict[str, str] = Field(default_factory=dict)  # inputs of each case's recording
    filmstrips: dict[str, FiniteFloat] = Field(default_factory=dict)
    baseline: str | None = None
    reference: str | None = None


FORMER_FACTS = {
    "promises": "requirements",
    "doubts": "tracker_warnings",
    "strips": "filmstrips",
    "beside": "reference",
}
"""Names of facts in files of version 0.1."""


FACTS = TypeAdapter(Facts)

CASES = TypeAdapter(list[StoredCase])

RECORDINGS = TypeAdapter(dict[str, RecordingInfo])

METRICS = TypeAdapter(dict[str, dict[str, FiniteFloat | None]])

INCIDENTS = TypeAdapter(list[Incident])


def checked(kind: TypeAdapter[_Content], content: Any, source: str) -> _Content:
    """Validate content as this kind. Raises InputError naming the source, the place, the value and what is expected."""
    try:
        return kind.validate_python(content)
    except ValidationError as error:
        fault = error.errors()[0]
        place = ".".join(str(part) for part in fault["loc"])
        value = repr(fault["input"])
        shown = value if len(value) <= _MOST_SHOWN else value[:_MOST_SHOWN] + "…"
        raise InputError(f"{source}: {place}: {fault['msg']} (got {shown}); {EXPECTED} is expected") from error


_SCHEMA = """
CREATE TABLE facts (name TEXT PRIMARY KEY, value TEXT);
CREATE TABLE definitions (case_id TEXT PRIMARY KEY, place INTEGER UNIQUE, scenario TEXT, variant TEXT, overrides TEXT,
    seed INTEGER, tracker TEXT, made_from TEXT);
CREATE TABLE cases (case_id TEXT PRIMARY KEY REFERENCES definitions, status TEXT, attempts INTEGER, seconds REAL,
    error TEXT);
CREATE TABLE results (case_id TEXT REFERENCES definitions, scenario TEXT, seed INTEGER, overrides TEXT, tracker TEXT,
    metric TEXT, value REAL, PRIMARY KEY (case_id, metric));
CREATE TABLE recordings (case_id TEXT PRIMARY KEY REFERENCES definitions, digest TEXT, people TEXT);
CREATE TABLE scanners (case_id TEXT REFERENCES definitions, scanner TEXT, scatter_m REAL, PRIMARY KEY (case_id, scanner));
CREATE TABLE moments (case_id TEXT REFERENCES definitions, t_s REAL, kind TEXT, what TEXT, severity REAL);
CREATE INDEX moments_of_case ON moments (case_id);
"""

_FAULT_OF_FILE = {
    sqlite3.SQLITE_BUSY: "another process holds it; wait for that to end",
    sqlite3.SQLITE_LOCKED: "another process holds it; wait for that to end",
    sqlite3.SQLITE_READONLY: "is read-only; a file and a folder that can be written are expected",
    sqlite3.SQLITE_PERM: "may not be opened; a file that this user may read and write is expected",
    sqlite3.SQLITE_CANTOPEN: "cannot be opened; a file and a folder that this user may read and write are expected",
    sqlite3.SQLITE_FULL: "cannot be written; a disk with free space is expected",
    sqlite3.SQLITE_IOERR: "cannot be read or written; a sound disk with free space is expected",
}
"""Causes by sqlite's primary error code, for files that may well be results."""


def fault_of_file(error: sqlite3.OperationalError) -> str | None:
    """Describe a fault of a results file's location; None where the file itself, or the query, is at fault."""
    fault = _FAULT_OF_FILE.get(error.sqlite_errorcode & 0xFF)
    return f"{fault} ({error})" if fault else None


class ResultStore:
    """Results of one run of a suite; `open_store` opens them for writing, `read_store` for reading."""

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        self._connection = connection
        self.path = path

    def create(self, cases: Sequence[Case]) -> None:
        """Create the tables of a new file, with all cases waiting."""
        self._connection.executescript(f"BEGIN IMMEDIATE;{_SCHEMA}COMMIT;")
        with self._writing():
            self._connection.executemany(
                "INSERT INTO definitions VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                [
                    (
                        case.id,
                        place,
                        case.scenario,
                        case.variant,
                        json.dumps(case.overrides, ensure_ascii=False),
                        case.seed,
                        case.tracker,
                        case.provenance.write(),
                    )
                    for place, case in enumerate(cases)
                ],
            )
            self._connection.executemany(
                "INSERT INTO cases VALUES (?, ?, 0, NULL, NULL)", [(case.id, WAITING) for case in cases]
            )

    def resume(self, cases: Sequence[Case], damaged: Collection[str] = ()) -> dict[str, list[str]]:
        """Reset cases that were running when the run was killed, that failed, or whose inputs or files changed.

        Returns the changed inputs (fields of `Provenance`, or the files, of those `damaged`) of finished cases, by case_id.
        """
        held = dict(self._connection.execute("SELECT case_id, made_from FROM definitions"))
        done = {
            case_id for (case_id,) in self._connection.execute("SELECT case_id FROM cases WHERE status = ?", (DONE,))
        }
        changed = {case.id: case.provenance.changed(Provenance.read(held[case.id])) for case in cases}
        changed |= {case_id: [*changed[case_id], "its files in cases/"] for case_id in damaged}
        ids = [(case_id,) for case_id, parts in changed.items() if parts]
        with self._writing():
            for table in ("results", "moments", "recordings", "scanners"):
                self._connection.executemany(f"DELETE FROM {table} WHERE case_id = ?", ids)
            self._connection.executemany(
                "UPDATE cases SET status = ? WHERE case_id = ?", [(WAITING, case_id) for (case_id,) in ids]
            )
            self._connection.executemany(
                "UPDATE definitions SET made_from = ? WHERE case_id = ?",
                [(case.provenance.write(), case.id) for case in cases],
            )
            self._connection.execute(
                "UPDATE cases SET status = ?, attempts = 0, seconds = NULL, error = NULL WHERE status != ?",
                (WAITING, DONE),
            )
        return {case_id: parts for case_id, parts in changed.items() if parts and case_id in done}

    def started(self, case_id: str, attempt: int) -> None:
        """Record the start of a case."""
        with self._writing():
            self._connection.execute(
                "UPDATE cases SET status = ?, attempts = ? WHERE case_id = ?", (RUNNING, attempt, case_id)
            )

    def finished(
        self,
        case: Case,
        attempts: int,
        seconds: float,
        metrics: Mapping[str, float | None],
        incidents: Sequence[Incident],
        recorded: RecordingInfo | None = None,
    ) -> None:
        """Write a case's metrics and the digests of its recording, in one transaction."""
        recorded = recorded or RecordingInfo()
        overrides = json.dumps(case.overrides, ensure_ascii=False)
        with self._writing():
            self._connection.executemany(
                "INSERT INTO results VALUES (?, ?, ?, ?, ?, ?, ?)",
                [
                    (case.id, case.scenario, case.seed, overrides, case.tracker, metric, value)
                    for metric, value in metrics.items()
                ],
            )
            self._connection.executemany(
                "INSERT INTO moments VALUES (?, ?, ?, ?, ?)",
                [(case.id, each.t_s, each.kind, each.what, each.severity) for each in incidents],
            )
            self._connection.execute(
                "INSERT OR REPLACE INTO recordings VALUES (?, ?, ?)", (case.id, recorded.digest, recorded.people)
            )
            self._connection.executemany(
                "INSERT OR REPLACE INTO scanners VALUES (?, ?, ?)",
                [(case.id, scanner, scatter) for scanner, scatter in recorded.scatter_m.items()],
            )
            self._connection.execute(
                "UPDATE cases SET status = ?, attempts = ?, seconds = ?, error = NULL WHERE case_id = ?",
                (DONE, attempts, seconds, case.id),
            )

    def failed(self, case_id: str, attempts: int, seconds: float, error: str) -> None:
        """Record the final failure of a case."""
        with self._writing():
            self._connection.execute(
                "UPDATE cases SET status = ?, attempts = ?, seconds = ?, error = ? WHERE case_id = ?",
                (FAILED, attempts, seconds, error, case_id),
            )

    def note(self, **facts: Any) -> None:
        """Write facts about the run, by name; values are anything that JSON can hold."""
        with self._writing():
            self._connection.executemany(
                "INSERT OR REPLACE INTO facts VALUES (?, ?)",
                [(name, json.dumps(value, ensure_ascii=False)) for name, value in facts.items()],
            )

    def facts(self) -> dict[str, Any]:
        """Read the facts about the run; former names are replaced by the current ones."""
        rows = self._connection.execute("SELECT name, value FROM facts").fetchall()
        stored = {name: parse_json(str(value), f"{self.path}: facts.{name}", EXPECTED) for name, value in rows}
        former = {name: stored.pop(old) for old, name in FORMER_FACTS.items() if old in stored}
        facts = former | stored
        checked(FACTS, facts, f"{self.path}: facts")
        return facts

    def cases(self) -> list[StoredCase]:
        """Read every case, in the suite's order."""
        rows = self._connection.execute(
            "SELECT case_id, scenario, variant, overrides, seed, tracker, status, attempts, seconds, error, "
            "CASE WHEN json_valid(made_from) THEN COALESCE(json_extract(made_from, '$.room'), '') ELSE '' END "
            "FROM definitions JOIN cases USING (case_id) ORDER BY place"
        )
        names = [each.name for each in fields(StoredCase)]
        return checked(CASES, [dict(zip(names, row, strict=True)) for row in rows], f"{self.path}: cases")

    def metrics(self) -> dict[str, dict[str, float | None]]:
        """Read the metrics of each finished case, by case id."""
        found: dict[str, dict[str, float | None]] = {}
        for case_id, metric, value in self._connection.execute("SELECT case_id, metric, value FROM results"):
            found.setdefault(case_id, {})[metric] = value
        for case_id, figures in checked(METRICS, found, f"{self.path}: results").items():
            check_ranges(figures, f"{self.path}: results: {case_id}")
        return found

    def recorded(self) -> dict[str, RecordingInfo]:
        """Read the digests of each finished case's recording, by case id; files of older versions lack some."""
        columns = {row[1] for row in self._connection.execute("PRAGMA table_info(recordings)")}
        people = "people" if "people" in columns else "''"
        scatter: dict[str, dict[str, float]] = {}
        if people == "people":
            for case_id, scanner, value in self._connection.execute("SELECT case_id, scanner, scatter_m FROM scanners"):
                scatter.setdefault(case_id, {})[scanner] = value
        rows = self._connection.execute(f"SELECT case_id, digest, {people} FROM recordings") if columns else ()
        found = {
            case_id: {"digest": digest, "people": ways, "scatter_m": scatter.get(case_id, {})}
            for case_id, digest, ways in rows
        }
        return checked(RECORDINGS, found, f"{self.path}: recordings")

    def incidents(self, case_id: str) -> list[Incident]:
        """Read the incidents of a case, the worst second first, then in order of time."""
        rows = self._connection.execute(
            "SELECT t_s, kind, what, severity FROM moments WHERE case_id = ? ORDER BY kind != 'worst', t_s", (case_id,)
        )
        names = [each.name for each in fields(Incident)]
        return checked(INCIDENTS, [dict(zip(names, row, strict=True)) for row in rows], f"{self.path}: moments")

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            with self._connection:
                yield
        except sqlite3.OperationalError as error:
            if fault := fault_of_file(error):
                raise InputError(f"{self.path}: {fault}; --resume then does the rest") from error
            raise
