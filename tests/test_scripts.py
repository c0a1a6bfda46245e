"""The scripts set up what they need and hand on what they are given."""

from __future__ import annotations

import os
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
from matrix.__main__ import lowest, pins
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

SCRIPTS = Path(__file__).parents[1] / "scripts"


@pytest.mark.parametrize(
    ("script", "ends_with"),
    [
        ("demo", "twin run lab-five-people --tracker laser-fisheye-imm --seed 3"),
        ("pictures", "python -m readme --seed 3"),
    ],
)
def test_a_script_s_arguments_are_its_own_and_not_its_set_up_s(script: str, ends_with: str, tmp_path: Path) -> None:
    (tmp_path / "scripts").mkdir()
    for name in (script, "setup.sh", "tested-versions.txt"):
        shutil.copy(SCRIPTS / name, tmp_path / "scripts" / name)
    (tmp_path / "pyproject.toml").write_text("")
    (tmp_path / ".venv/bin").mkdir(parents=True)
    for program in ("python", "twin"):
        path = tmp_path / ".venv/bin" / program
        # asked for its version, it is a supported one
        answer = f'[ "$1" = -c ] && echo 3.11 || echo {program} "$@" >> "{tmp_path}/called"'
        path.write_text(f"#!/bin/sh\n{answer}\n")
        path.chmod(0o755)
    own = {name: value for name, value in os.environ.items() if not name.startswith("ROOMTWIN_")}
    command = [tmp_path / "scripts" / script, "--seed", "3"]
    done = subprocess.run(command, env=own, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    called = (tmp_path / "called").read_text().splitlines()
    assert "python -m pip install --quiet --constraint scripts/tested-versions.txt --editable ." in called
    assert called[-1] == ends_with


def test_every_lower_bound_is_a_constraint_that_pip_understands() -> None:
    constraints = lowest(SCRIPTS.parent / "pyproject.toml")
    requirements = [Requirement(line) for line in constraints]
    assert {"numpy", "mujoco", "pytest"} <= {each.name for each in requirements}
    assert all([clause.operator for clause in each.specifier] == ["=="] for each in requirements)


def test_a_dependency_without_a_lower_bound_is_named(tmp_path: Path) -> None:
    path = tmp_path / "pyproject.toml"
    path.write_text('[project]\ndependencies = ["numpy"]\noptional-dependencies = {dev = []}\n')
    with pytest.raises(ValueError, match="'numpy' has no lower bound"):
        lowest(path)


def test_each_interpreter_gets_the_versions_that_it_was_tested_with() -> None:
    installed = {
        "3.11": {"numpy": "2.4.6", "rich": "14.0", "av": "19.0", "only-old": "1.0"},
        "3.12": {"numpy": "2.5.5", "rich": "14.0", "av": "18.0"},
        "3.13": {"numpy": "2.5.5", "rich": "14.0", "av": "19.0", "only-new": "2.0"},
    }
    for python, expected in {**installed, "3.14": installed["3.13"]}.items():
        lines = [Requirement(line) for line in pins(installed).splitlines() if not line.startswith("#")]
        held = [each for each in lines if each.marker is None or each.marker.evaluate({"python_version": python})]
        assert {each.name: str(each.specifier).removeprefix("==") for each in held} == expected


def test_the_tested_versions_are_within_the_bounds() -> None:
    project = tomllib.loads((SCRIPTS.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    tested: dict[str, list[str]] = {}
    for line in (SCRIPTS / "tested-versions.txt").read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            each = Requirement(line)
            tested.setdefault(canonicalize_name(each.name), []).append(str(each.specifier).removeprefix("=="))
    for requirement in map(Requirement, (*project["dependencies"], *project["optional-dependencies"]["dev"])):
        versions = tested[canonicalize_name(requirement.name)]
        assert all(requirement.specifier.contains(version) for version in versions), requirement.name
