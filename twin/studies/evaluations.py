"""Every evaluation of a study in one file, line by line: what was finished is there, whatever kills the run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from trackers.errors import InputError
from twin.run.out_folder import locked_folder
from twin.studies.scoring import Score, score
from twin.suites.fingerprint import whole_code
from twin.suites.run import Place, RunTasks, Watcher, open_place
from twin.suites.tasks import Ended, Listener, State, Task

FILE = "evaluations.jsonl"
_LIMIT_S = 1800.0


@dataclass(frozen=True)
class Job:
    """One placement under one key, in one scenario of the study with one seed."""

    key: str
    scenario: str
    seed: int
    work: Score

    @property
    def id(self) -> str:
        """What it is called in the file."""
        return f"{self.key} {self.scenario} {self.seed}"


@dataclass(frozen=True)
class Outcome:
    """The figures of each tracker, or why there are none."""

    figures: Mapping[str, Mapping[str, float | None]] = field(default_factory=dict)
    error: str = ""


class Evaluations:
    """What has been evaluated so far, and the means to evaluate more."""

    def __init__(self, folder: Path, run_tasks: RunTasks, progress: Callable[[int, State], object]) -> None:
        self._folder = folder
        self._path = folder / FILE
        self._run_tasks = run_tasks
        self._progress = progress
        self._held: dict[str, Outcome] = {}
        self.evaluated = 0
        """So many were evaluated in this run, none of them held before."""

    def hold(self, job: Job, outcome: Outcome) -> None:
        """Write down an outcome."""
        self._held[job.id] = outcome
        line = json.dumps({"id": job.id, "figures": outcome.figures, "error": outcome.error}, allow_nan=False)
        with self._path.open("a", encoding="utf-8") as stream:
            stream.write(line + "\n")

    def read(self) -> None:
        """Take what an earlier run has written; a last line that was cut off is left out."""
        whole = []
        for line in self._path.read_text(encoding="utf-8").splitlines()[1:]:
            try:
                row = json.loads(line)
                self._held[row["id"]] = Outcome(row["figures"], row["error"])
            except (ValueError, KeyError, TypeError):
                break
            whole.append(line)
        head = self._path.read_text(encoding="utf-8").splitlines()[:1]
        self._path.write_text("\n".join([*head, *whole]) + "\n", encoding="utf-8")

    def outcomes(self, jobs: Sequence[Job]) -> list[Outcome]:
        """The outcome of each job, evaluated where it is not known, on all workers."""
        new = {job.id: job for job in jobs if job.id not in self._held}
        by_id = {f"evaluation-{number}": job for number, job in enumerate(new.values())}

        def ended(end: Ended) -> None:
            done = Outcome(end.value) if end.status == "done" else Outcome(error=end.error.splitlines()[0])
            self.hold(by_id[end.task.id], done)

        def state(now: State) -> None:
            self._progress(len(new), now)

        if new:
            tasks = [Task(name, job.work, _LIMIT_S) for name, job in by_id.items()]
            self._run_tasks(tasks, score, Listener(ended=ended, state=state), None)
            self.evaluated += len(new)
        return [self._held[job.id] for job in jobs]


@contextmanager
def open_evaluations(
    folder: Path,
    study: Mapping[str, Any],
    place: Place,
    resume: bool,
    watcher: Watcher,
    progress: Callable[[int, State], object],
) -> Iterator[Evaluations]:
    """The evaluations in a study's folder, held against other processes, and workers for more.

    study: the study resolved, whatever its results depend on included. Raises InputError for a folder with results of an
    earlier run without `resume`, and of another study or code with it.
    """
    path, head = folder / FILE, {"study": study, "code": whole_code()}
    with ExitStack() as stack:
        stack.enter_context(locked_folder(folder))
        before = _head(path)
        if before is not None and not resume:
            raise InputError(
                f"--out {folder}: holds the results of an earlier run; --resume, or another folder, is expected"
            )
        if before is None and resume:
            raise InputError(
                f"--resume: {folder}: there is nothing to resume; a folder of an interrupted run is expected"
            )
        if before is not None and before.get("code") != head["code"]:
            raise InputError(
                f"--resume: {path}: was made by other code, and results of two versions must not mix; another folder is expected"
            )
        if before is not None and before.get("study") != json.loads(json.dumps(study)):
            changed = [key for key in study if before["study"].get(key) != json.loads(json.dumps(study[key]))]
            raise InputError(
                f"--resume: {path}: was made of another study ({', '.join(changed) or 'some fields are gone'} changed); the same "
                "study, or another folder, is expected"
            )
        evaluations = Evaluations(folder, open_place(place, stack, watcher), progress)
        if before is None:
            path.write_text(json.dumps(head) + "\n", encoding="utf-8")
        else:
            evaluations.read()
        yield evaluations


def _head(path: Path) -> dict[str, Any] | None:
    """The first line of a file of evaluations; None where there is no file, or one that was cut off in it."""
    if not path.exists():
        return None
    try:
        with path.open(encoding="utf-8") as stream:
            head = json.loads(stream.readline())
        return head if isinstance(head, dict) and isinstance(head.get("study"), dict) else None
    except ValueError:
        return None
