"""Tests the project on every Python interpreter found, with the newest and the lowest versions that pyproject.toml allows.

Each pair gets an environment in `.matrix/`, the demo and a subset of the tests; the newest interpreter with the newest
versions gets the whole suite. Called by `scripts/test --matrix`; `--pin` then writes `scripts/tested-versions.txt`.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / ".matrix"
PINS = ROOT / "scripts/tested-versions.txt"
VERSIONS = ("newest", "lowest")
SUBSET = (
    "tests/test_shape_checks.py",
    "tests/twin/test_golden.py",
    "tests/twin/test_cli.py",
    "tests/twin/recording",
    "tests/twin/evaluate",
    "tests/trackers/learning",
    "tests/trackers/filters/test_imm.py",
    "tests/trackers/filters/test_particle.py",
    "tests/trackers/test_sort.py",
    "tests/trackers/environment/test_environment.py",
)
"""Tests that depend most on installed versions: shapes, the golden run, files, metrics, numerics."""
_DEMO = ("-m", "twin", "run", "lab-five-people", "--tracker", "laser-fisheye-imm", "--duration", "4")


def main() -> int:
    """Run the pairs that are asked for, print a row each; the exit code is 1 where one fails."""
    parser = argparse.ArgumentParser(prog="scripts/test --matrix", description="Test every interpreter found.")
    parser.add_argument("--interpreters", nargs="+", required=True, help=argparse.SUPPRESS)
    parser.add_argument("--python", action="append", help="only this minor version, as in 3.12; may be repeated")
    parser.add_argument("--versions", choices=VERSIONS, action="append", help="only these (default: both)")
    parser.add_argument("--subset", action="store_true", help="the subset of the tests only, for every pair")
    parser.add_argument("--pin", action="store_true", help=f"write {PINS.name} from the newest versions if all passes")
    arguments = parser.parse_args()
    found = dict(each.split(" ", 1) for each in arguments.interpreters)
    if missing := set(arguments.python or ()) - set(found):
        parser.error(f"--python: no interpreter {', '.join(sorted(missing))} is found; found are {', '.join(found)}")
    chosen = {version: path for version, path in found.items() if version in (arguments.python or found)}
    if arguments.pin and (set(chosen) != set(found) or "newest" not in (arguments.versions or VERSIONS)):
        parser.error("--pin needs the newest versions of every interpreter found")
    rows = []
    for version, path in chosen.items():
        for versions in arguments.versions or VERSIONS:
            whole = not arguments.subset and versions == "newest" and version == list(found)[-1]
            rows.append((f"Python {version}", versions, *_tried(version, path, versions, whole=whole)))
    for row in rows:
        print("  ".join(f"{cell:<14}" for cell in row))
    failed = any("FAILED" in cell for row in rows for cell in row)
    if arguments.pin and not failed:
        PINS.write_text(pins({version: _installed(version) for version in found}), encoding="utf-8")
    return int(failed)


def _tried(version: str, interpreter: str, versions: str, *, whole: bool) -> tuple[str, ...]:
    """Install, run the demo and the tests; a cell for each, with its seconds."""
    environment = FOLDER / f"{version}-{versions}"
    python = environment / "bin/python"
    tests = ("tests",) if whole else SUBSET
    pytest = [
        python,
        "-m",
        "pytest",
        "-n",
        str(os.cpu_count() or 1),
        "--dist",
        "loadfile",
        "-p",
        "no:cacheprovider",
        *tests,
    ]
    cells = [_cell("install", lambda: _install(environment, interpreter, versions))]
    if "FAILED" not in cells[0]:
        out = FOLDER / f"demo-{version}-{versions}"
        cells.append(_cell("demo", lambda: _run([python, *_DEMO, "--out", out])))
        cells.append(_cell("all tests" if whole else "subset", lambda: _run(pytest)))
        shutil.rmtree(out, ignore_errors=True)
    return tuple(cells)


def _cell(what: str, act: Callable[[], bool]) -> str:
    start = time.monotonic()
    passed = act()
    return f"{what} {'passed' if passed else 'FAILED'} {time.monotonic() - start:.0f} s"


def _install(environment: Path, interpreter: str, versions: str) -> bool:
    """Make the environment anew unless it is of these dependencies; True where it stands."""
    wanted = hashlib.sha256((ROOT / "pyproject.toml").read_bytes()).hexdigest()
    stamp = environment / "installed"
    if stamp.exists() and stamp.read_text(encoding="utf-8") == wanted:
        return True
    shutil.rmtree(environment, ignore_errors=True)
    if not _run([interpreter, "-m", "venv", environment]):
        return False
    command = [environment / "bin/python", "-m", "pip", "install", "--quiet", "--editable", ".[dev,docs]"]
    if versions == "lowest":
        constraints = environment / "lowest.txt"
        constraints.write_text("\n".join(lowest(ROOT / "pyproject.toml")) + "\n", encoding="utf-8")
        command += ["--constraint", constraints]
    if not _run(command):
        return False
    stamp.write_text(wanted, encoding="utf-8")
    return True


def lowest(pyproject: Path) -> list[str]:
    """The lower bounds of a project's dependencies and of its extras `dev` and `docs`, as constraints.

    Raises ValueError where one has none.
    """
    project = tomllib.loads(pyproject.read_text(encoding="utf-8"))["project"]
    constraints, extras = [], project["optional-dependencies"]
    for requirement in (*project["dependencies"], *extras["dev"], *extras.get("docs", ())):
        bound = re.match(r"([\w.-]+)>=([\w.]+)[^;]*(;.*)?$", requirement)
        if bound is None:
            raise ValueError(f"{pyproject}: {requirement!r} has no lower bound; NAME>=VERSION is expected")
        constraints.append(f"{bound[1]}=={bound[2]}{bound[3] or ''}")
    return constraints


def _installed(version: str) -> dict[str, str]:
    """Name and version of each package in an interpreter's environment of newest versions, but for the project's own."""
    command = [FOLDER / f"{version}-newest/bin/python", "-m", "pip", "list", "--format=freeze", "--exclude-editable"]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    packages = dict(each.split("==") for each in listed)
    return {name: packages[name] for name in packages if name not in ("pip", "setuptools", "wheel")}


def pins(installed: dict[str, dict[str, str]]) -> str:
    """The versions of several interpreters (oldest first) as one file of constraints.

    The newest interpreter's versions hold for later ones too. What is alike for all has no marker.
    """
    newest = list(installed)[-1]
    lines = [
        "# Versions that every test passed with, written by `scripts/test --matrix --pin`; the scripts install them."
    ]
    for name in sorted({name for packages in installed.values() for name in packages}, key=str.lower):
        held = {python: packages.get(name) for python, packages in installed.items()}
        # the newest interpreter's version holds from the first one on after which there is no other
        n_older = max((place for place, version in enumerate(held.values(), 1) if version != held[newest]), default=0)
        older = list(held)[:n_older]
        lines += [f'{name}=={held[python]}; python_version == "{python}"' for python in older if held[python]]
        if held[newest]:
            lines.append(f"{name}=={held[newest]}" + (f'; python_version >= "{list(held)[n_older]}"' if older else ""))
    return "\n".join(lines) + "\n"


def _run(command: Sequence[str | Path]) -> bool:
    print("+", *command, file=sys.stderr, flush=True)
    return subprocess.run(command, cwd=ROOT, stdout=sys.stderr, check=False).returncode == 0


if __name__ == "__main__":
    sys.exit(main())
