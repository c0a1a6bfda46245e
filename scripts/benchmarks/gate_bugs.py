"""The gate is tested by bugs: each is made in a copy of the code, and the first stage that notices it is reported on stderr.

Stages are the unit tests that are not marked slow and name the changed module or its package, the golden run, the suite `smoke`
against its baseline, all other unit tests and, as `gate-bugs-regression`, the suite `regression`. All hours of it at once, or
in parts:

    python -m benchmarks.gate_bugs [--stages unit,golden] [--part 1/4] [WORD ...]

runs the bugs whose target or name holds one of the words; with `--control` the code as it is, which no stage may call a bug.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.bugs import BUGS
from benchmarks.figure import Figure
from benchmarks.mutation import Bug, NoTargetError

ROOT = Path(__file__).parents[2]
STAGES = ("unit", "golden", "smoke", "other", "regression")
MISSING = "target missing"
"""Said of a bug for which there is nothing left to make it in."""
_GOLDEN = "tests/twin/test_golden.py"
_LONGEST_S = 3600
"""A stage that takes longer has noticed nothing."""
_CONTROL = Bug("none", "twin/__init__.py", "", "")


def measure() -> Iterator[Figure]:
    """Bugs noticed by unit tests, golden run and smoke."""
    return _figures(STAGES[:-1], ">= 0.9")


def with_regression() -> Iterator[Figure]:
    """Bugs noticed by those and the suite `regression`."""
    return _figures(STAGES, ">= 0.97")


def _figures(stages: Sequence[str], target: str) -> Iterator[Figure]:
    alarm = caught(_CONTROL, stages)
    yield Figure("stages that call the code as it is a bug", int(alarm is not None), "", "<= 0")
    count = Counter(caught(bug, stages) for bug in BUGS)
    made = len(BUGS) - count[MISSING]
    yield Figure("bugs whose target is missing", count[MISSING], "", "<= 0")
    yield Figure(f"share of {made} bugs caught by {', '.join(stages)}", 1 - count[None] / made, "", target)
    for stage in stages:
        yield Figure(f"of these first by {stage}", count[stage] / made, "", "")


def caught(bug: Bug, stages: Sequence[str]) -> str | None:
    """The first of the stages that notices the bug in a copy of the code, MISSING, or none; reported on stderr as well."""
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="gate-bugs-") as folder:
        tree = Path(folder) / "tree"
        _copy(tree)
        if bug is not _CONTROL:
            try:
                bug.write(tree)
            except NoTargetError as missing:
                print(f"{bug.target}: {bug.name}: MISSING ({missing})", file=sys.stderr, flush=True)
                return MISSING
        environment = os.environ | {"PYTHONPATH": str(tree)}
        if bug.file.startswith("twin/"):  # what it records is of no use to anybody else
            environment["ROOMTWIN_CACHE"] = str(Path(folder) / "cache")
        found = next((stage for stage in stages if _notices(stage, bug.file, tree, environment)), None)
    print(
        f"{bug.target}: {bug.name}: {found or 'MISSED'} ({time.monotonic() - start:.0f} s)", file=sys.stderr, flush=True
    )
    return found


def _copy(tree: Path) -> None:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, listed.split("\0")):
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, tree / name)


def _notices(stage: str, file: str, tree: Path, environment: dict[str, str]) -> bool:
    """Return True where one of a stage's commands fails."""
    for command in _commands(stage, file, tree):
        try:
            done = subprocess.run(
                [sys.executable, "-m", *command],
                cwd=tree,
                env=environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                timeout=_LONGEST_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            continue
        if done.returncode not in (0, 5):  # 5: pytest found no test that is not slow
            print("    " + "\n    ".join(done.stdout.strip().splitlines()[-4:]), file=sys.stderr)
            return True
    return False


def _commands(stage: str, file: str, tree: Path) -> Iterator[list[str]]:
    pytest = ["pytest", "-x", "-q", "-m", "not slow", "-p", "no:cacheprovider", "--tb=line"]
    near, package, other = _unit_tests(file, tree)
    if stage in ("unit", "other"):
        # pytest imports all files that it is given before the first test
        for files in filter(None, (near, package) if stage == "unit" else (other,)):
            yield [*pytest, *files]
    elif stage == "golden":
        yield [*pytest, _GOLDEN]
    else:
        baseline = f"models/suites/baselines/{stage}.json"
        yield ["twin", "suite", "run", stage, "--baseline", baseline, "--jobs", "1", "--out", str(tree.parent / stage)]


def _unit_tests(file: str, tree: Path) -> list[list[str]]:
    """Test files in three lots: what names the module, its package, neither; in each what is about least else first."""
    module = file.removesuffix(".py").replace("/", ".")
    package = module.rpartition(".")[0]
    lots: tuple[list[tuple[int, str]], ...] = ([], [], [])
    for path in sorted((tree / "tests").rglob("test_*.py")):
        name, text = path.relative_to(tree).as_posix(), path.read_text(encoding="utf-8")
        if name not in (_GOLDEN, "tests/test_gate_bugs.py"):  # the latter misses what the bug replaced
            named = set(re.findall(r"\b(?:trackers|twin)\.[\w.]+", text))
            inside = "." in package and any(each.startswith(package) for each in named)
            lot = 0 if {module, package} & named else 1 if inside else 2
            lots[lot].append((len(named), name))
    return [[name for _, name in sorted(files)] for files in lots]


def main() -> int:
    """Run some bugs through some stages; the exit code is 1 where one is missed or its target is missing."""
    parser = argparse.ArgumentParser(description="Run some bugs through some stages.")
    parser.add_argument("words", nargs="*", help="bugs whose file or name holds one of these (none: all)")
    parser.add_argument("--stages", default=",".join(STAGES[:-1]), help="in this order, separated by commas")
    parser.add_argument("--part", default="1/1", help="K/N: the K-th of N parts")
    parser.add_argument("--control", action="store_true", help="the code as it is instead")
    arguments = parser.parse_args()
    stages = arguments.stages.split(",")
    if unknown := set(stages) - set(STAGES):
        parser.error(f"--stages: there is no {', '.join(sorted(unknown))}; valid are {', '.join(STAGES)}")
    if arguments.control:
        return int(caught(_CONTROL, stages) is not None)
    number, count = map(int, arguments.part.split("/"))
    words = arguments.words or [""]
    chosen = [bug for bug in BUGS if any(word in f"{bug.target}: {bug.name}" for word in words)][number - 1 :: count]
    count = Counter(caught(bug, stages) for bug in chosen)
    made = len(chosen) - count[MISSING]
    print(f"{made - count[None]} of {made} caught" + (f", {count[MISSING]} without a target" if count[MISSING] else ""))
    return int(bool(count[None] or count[MISSING]))


if __name__ == "__main__":
    sys.exit(main())
