"""Store of a study's evaluations: one file, one line each, so that a killed run loses no finished one."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, FiniteFloat, TypeAdapter, ValidationError

from trackers.configuration import Typed
from trackers.errors import InputError
from twin.recording.atomic_file import write_atomic
from twin.run.out_folder import check_others, locked_folder
from twin.studies.worker import EvaluationTask, Outcome, evaluate_task
from twin.suites.cache_keys import Provenance, digest_of, whole_code
from twin.suites.cluster import Workers
from twin.suites.dask_runner import ProgressListener, RunTasks, open_workers
from twin.suites.metrics import check_ranges
from twin.suites.result_files import kind_of_warning, rerun_warning
from twin.suites.tasks import State, Task, TaskListener, TaskResult

FILE = "evaluations.jsonl"
WRITTEN = ("candidates.csv", "pareto.csv", "recommended.yaml", "study.yaml", "summary.json", "report.html")
"""Files of a finished study."""
_LIMIT_S = 1800.0


@dataclass(frozen=True)
class Job:
    """One placement in one scenario of the study with one seed, and digests of its inputs."""

    key: str
    scenario: str
    seed: int
    work: EvaluationTask
    made_from: Provenance

    @property
    def id(self) -> str:
        """The key in the file."""
        return f"{self.key} {self.scenario} {self.seed}"


class _Line(Typed):
    """A line of the file without its checksum."""

    model_config = ConfigDict(extra="forbid")

    id: str
    made_from: dict[str, str]
    figures: dict[str, dict[str, FiniteFloat | None]]
    error: str
    warnings: tuple[str, ...] = ()


_LINE = TypeAdapter(_Line)


class EvaluationStore:
    """Evaluations so far; evaluates more on request."""

    def __init__(
        self,
        folder: Path,
        run_tasks: RunTasks,
        progress: Callable[[int, State], object],
        warn: Callable[[str], object] = lambda warning: None,
    ) -> None:
        self._path = folder / FILE
        self._run_tasks = run_tasks
        self._progress = progress
        self._warn = warn
        self._recorded: dict[str, tuple[Provenance | None, Outcome]] = {}
        self.n_evaluated = 0
        """Number of evaluations by this run."""

    def record(self, job: Job, outcome: Outcome) -> None:
        """Append an outcome. Raises InputError where the file cannot be written."""
        self._recorded[job.id] = job.made_from, outcome
        made_from = json.loads(job.made_from.write())
        content = {"id": job.id, "made_from": made_from, "figures": outcome.metrics, "error": outcome.error}
        line = with_checksum(content | ({"warnings": list(outcome.warnings)} if outcome.warnings else {}))
        try:
            with self._path.open("a", encoding="utf-8") as stream:
                stream.write(line + "\n")
        except OSError as error:
            raise InputError(
                f"{self._path}: cannot be written ({error.strerror}); a disk with free space is needed, and --resume then does "
                "the rest"
            ) from error

    def read(self) -> None:
        """Read the lines of an earlier run, the last of several on one evaluation.

        A damaged line is reported, left out and evaluated again; a truncated last one is left out. The file is rewritten
        with the good lines alone, under its name when complete.
        """
        text = self._path.read_text(encoding="utf-8", errors="replace")
        head, *lines = text.split("\n")
        cut_off = lines.pop() if lines else ""
        good = []
        for number, line in enumerate(lines, start=2):
            try:
                content = _checked(line)
            except InputError as error:
                self._warn(f"{self._path}: line {number}: {error}; what it held is evaluated again")
                continue
            self._recorded[content.id] = (
                Provenance.read(json.dumps(content.made_from)),
                Outcome(content.figures, content.error, content.warnings),
            )
            good.append(line)
        if cut_off or len(good) < len(lines):
            write_atomic(self._path, "\n".join([head, *good]) + "\n")

    def outcomes(self, jobs: Sequence[Job]) -> list[Outcome]:
        """Return the outcome of each job; evaluate on all workers those unknown or with changed inputs."""
        new = {
            job.id: job for job in jobs if job.id not in self._recorded or self._recorded[job.id][0] != job.made_from
        }
        changed = {
            name: job.made_from.changed(self._recorded[name][0]) for name, job in new.items() if name in self._recorded
        }
        if changed:
            self._warn(rerun_warning(changed, len(jobs)))
        by_id = {f"evaluation-{number}": job for number, job in enumerate(new.values())}

        def ended(end: TaskResult) -> None:
            outcome = end.value if end.status == "done" else Outcome(error=end.error.splitlines()[0])
            self.record(by_id[end.task.id], outcome)

        def state(now: State) -> None:
            self._progress(len(new), now)

        if new:
            tasks = [Task(name, job.work, _LIMIT_S) for name, job in by_id.items()]
            self._run_tasks(tasks, evaluate_task, TaskListener(ended=ended, state=state), None)
            self.n_evaluated += len(new)
        return [self._recorded[job.id][1] for job in jobs]

    def warnings_of(self, keys: Collection[str]) -> list[str]:
        """Return the warnings of the scenarios with these placements, by their keys; of each kind the first."""
        lines = (each for id, (_, done) in self._recorded.items() if id.split(" ")[0] in keys for each in done.warnings)
        return list({kind_of_warning(each): each for each in [*lines][::-1]}.values())[::-1]


def check_folder(folder: Path, study: Mapping[str, Any], resume: bool) -> None:
    """Raise InputError for a folder that `open_store` would refuse, and leave it as it is."""
    with locked_folder(folder):
        _is_started(folder / FILE, _head_of(study), resume)


def _head_of(study: Mapping[str, Any]) -> dict[str, Any]:
    return {"study": study, "code": whole_code()}


def _is_started(path: Path, head: Mapping[str, Any], resume: bool) -> bool:
    """Return True for a file to go on with. Raises InputError for one that is another's, or that must be there or must not."""
    folder, study = path.parent, head["study"]
    check_others(folder, WRITTEN, FILE)
    before = _head(path)
    if before is None and resume:
        raise InputError(f"--resume: {folder}: there is nothing to resume; a folder of an interrupted run is expected")
    if before is None:
        return False
    where = f"--resume: {path}" if resume else f"--out {folder}"
    if before.get("code") != head["code"]:
        raise InputError(
            f"{where}: was made by other code, and results of two versions must not mix; another folder is expected"
        )
    if before.get("study") != (asked := json.loads(json.dumps(study))):
        changed = [key for key in (*asked, *before["study"]) if before["study"].get(key) != asked.get(key)]
        raise InputError(
            f"{where}: was made of another study ({', '.join(dict.fromkeys(changed)) or 'some fields are missing'} changed); "
            "the same study, or another folder, is expected"
        )
    if not resume:
        raise InputError(
            f"--out {folder}: holds the results of an earlier run of the same study; --resume to do the rest of it, or another "
            "folder, is expected"
        )
    return True


@contextmanager
def open_store(
    folder: Path,
    study: Mapping[str, Any],
    place: Workers,
    resume: bool,
    listener: ProgressListener,
    progress: Callable[[int, State], object],
) -> Iterator[EvaluationStore]:
    """Open the evaluations in a study's folder, locked against other processes, with workers for more.

    study: content of its file. Raises InputError for a folder with earlier results without `resume`, and for those of
    another study or code with it. Evaluations whose inputs changed (scenario, room, trackers, prior files) are done again.
    """
    path, head = folder / FILE, _head_of(study)
    with ExitStack() as stack:
        stack.enter_context(locked_folder(folder))
        is_started = _is_started(path, head, resume)
        evaluations = EvaluationStore(folder, open_workers(place, stack, listener), progress, listener.warned)
        if is_started:
            evaluations.read()
        else:
            write_atomic(path, with_checksum(head) + "\n")
        yield evaluations


def with_checksum(content: Mapping[str, Any]) -> str:
    """Format a line of JSON whose last field, `sum`, is a digest of the others."""
    return json.dumps({**content, "sum": _sum(content)}, allow_nan=False)


def _sum(content: Mapping[str, Any]) -> str:
    return digest_of(json.dumps(content, sort_keys=True))


def _content(line: str) -> dict[str, Any]:
    """Return the fields of a line without its checksum; raises InputError for a damaged line."""
    try:
        content = json.loads(line)
        checksum = content.pop("sum")
    except (ValueError, AttributeError, KeyError, TypeError, RecursionError) as error:
        raise InputError("is no line of JSON with a checksum") from error
    if checksum != _sum(content):
        raise InputError("is not as it was written, by its checksum")
    return content


def _checked(line: str) -> _Line:
    """Read the line of an evaluation; raises InputError for a damaged one, or a metric out of range."""
    try:
        content = _LINE.validate_python(_content(line))
    except ValidationError as error:
        fault = error.errors()[0]
        raise InputError(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}") from error
    for tracker, figures in content.figures.items():
        check_ranges(figures, tracker)
    return content


def _head(path: Path) -> dict[str, Any] | None:
    """Read the first line of a file of evaluations; None without a file, or for an empty one.

    Raises InputError for a damaged line.
    """
    if not path.exists() or not os.path.getsize(path):
        return None
    with path.open(encoding="utf-8", errors="replace") as stream:
        line = stream.readline()
    try:
        head = _content(line)
    except InputError as error:
        raise InputError(
            f"{path}: line 1: {error}; a file that `twin study run` wrote, or another folder, is expected"
        ) from error
    if not isinstance(head.get("study"), dict):
        raise InputError(
            f"{path}: line 1: names no study; a file that `twin study run` wrote, or another folder, is expected"
        )
    return head
