"""The scripts set up what they need and hand on what they are given."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

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
    for name in (script, "setup.sh"):
        shutil.copy(SCRIPTS / name, tmp_path / "scripts" / name)
    (tmp_path / "pyproject.toml").write_text("")
    (tmp_path / ".venv/bin").mkdir(parents=True)
    for program in ("python", "twin"):
        path = tmp_path / ".venv/bin" / program
        path.write_text(f'#!/bin/sh\necho {program} "$@" >> "{tmp_path}/called"\n')
        path.chmod(0o755)
    done = subprocess.run([tmp_path / "scripts" / script, "--seed", "3"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    called = (tmp_path / "called").read_text().splitlines()
    assert "python -m pip install --quiet --editable ." in called
    assert called[-1] == ends_with
