"""Expectations for any mutant, and the child process that is tested.

A mutant is handled well if the twin ends within 10 s with exit code 0, 1 or 2, prints no traceback, takes no more than 2 GiB
and writes nothing outside the folder it was given. The 10 s are of the process's own time, so that a busy machine makes no
hang; one that sleeps is given 40 s by the clock.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

LONGEST_S = 10.0
MOST_MIB = 2048.0
_BY_THE_CLOCK_S = 40.0
_GRACE_S = 5.0
_MUTANTS_A_CHILD = 150
_SCRIPTS = str(Path(__file__).parents[2])
_ENVIRONMENT = {"PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "200"}
_EXIT_CODES = (0, 1, 2)


@dataclass(frozen=True)
class Mutant:
    """Task of the child: a command, its folder, its environment, and the folders it may write to."""

    command: list[str]
    folder: Path
    may_write: tuple[Path, ...]
    environment: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Verdict:
    """Outcome for a mutant; `fault` is '' where the twin did as it should."""

    fault: str
    exit_code: int | None
    spent_s: float
    peak_mib: float
    said: str

    @property
    def refused(self) -> bool:
        """True where the twin called the input bad."""
        return self.exit_code == 2


class Judge:
    """Runs mutants one after the other in a child process, a new one now and then and after every fault."""

    def __init__(self, longest_s: float = LONGEST_S, most_mib: float = MOST_MIB) -> None:
        self._longest_s, self._most_mib = longest_s, most_mib
        self._home = tempfile.TemporaryDirectory(prefix="fuzz-home-")
        self._child: subprocess.Popen[str] | None = None
        self._judged = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()
        self._home.cleanup()

    def judge(self, mutant: Mutant) -> Verdict:
        """Run the task and return its outcome."""
        child = self._started()
        assert child.stdin is not None
        assert child.stdout is not None
        request = {
            "command": mutant.command,
            "folder": str(mutant.folder),
            "may_write": [str(path) for path in (*mutant.may_write, Path(self._home.name))],
            "environment": mutant.environment,
            "log": str(Path(self._home.name) / "said.txt"),
            "limit_s": self._longest_s,
            "clock_limit_s": _BY_THE_CLOCK_S,
            "limit_mib": self._most_mib,
        }
        child.stdin.write(json.dumps(request) + "\n")
        child.stdin.flush()
        answered, _, _ = select.select([child.stdout], [], [], _BY_THE_CLOCK_S + _GRACE_S)
        line = child.stdout.readline() if answered else ""
        verdict = _verdict(json.loads(line), self._most_mib) if line else self._silent(hangs=not answered)
        if verdict.fault:
            self._end()
        return verdict

    def _silent(self, hangs: bool) -> Verdict:
        assert self._child is not None
        log = Path(self._home.name) / "said.txt"
        said = log.read_text(encoding="utf-8", errors="replace")[-3000:] if log.exists() else ""
        if hangs:
            waited_s = _BY_THE_CLOCK_S + _GRACE_S
            return Verdict(f"hangs: no answer for {waited_s:g} s", None, waited_s, 0.0, said)
        return Verdict(f"the process died with {self._child.wait(10)}", self._child.returncode, 0.0, 0.0, said)

    def _started(self) -> subprocess.Popen[str]:
        if self._judged >= _MUTANTS_A_CHILD:
            self._end()
        if self._child is None:
            home = {name: self._home.name for name in ("HOME", "TMPDIR", "XDG_CACHE_HOME", "MPLCONFIGDIR")}
            found = os.pathsep.join([_SCRIPTS, *filter(None, [os.environ.get("PYTHONPATH")])])
            self._child = subprocess.Popen(
                [sys.executable, "-m", "benchmarks.fuzz.child"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                env=os.environ | home | _ENVIRONMENT | {"PYTHONPATH": found},
            )
            self._judged = 0
        self._judged += 1
        return self._child

    def _end(self) -> None:
        if self._child is not None:
            self._child.kill()
            self._child.communicate()
            self._child = None


def _verdict(answer: dict[str, Any], most_mib: float) -> Verdict:
    faults = []
    code, said = answer["exit_code"], answer["said"]
    if answer["timed_out"]:
        faults.append(f"hangs: stopped after {answer['spent_s']:.1f} s of its own")
    elif code not in _EXIT_CODES:
        faults.append(f"exit code {code}")
    elif "Traceback (most recent call last)" in said:
        faults.append("prints a traceback")
    if answer["peak_mib"] > most_mib:
        faults.append(f"takes {answer['peak_mib']:.0f} MiB")
    if answer["written"]:
        faults.append(f"touches {', '.join(answer['written'][:3])}")
    return Verdict("; ".join(faults), code, answer["spent_s"], answer["peak_mib"], said)
