"""What a person at a terminal sees."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin.console import print_paths


def test_paths_stand_in_one_column(capsys: pytest.CaptureFixture[str]) -> None:
    print_paths({"truth": Path("out/truth.csv"), "truth_situations": Path("out/truth_situations.csv")})
    lines = capsys.readouterr().out.splitlines()
    assert [line.index("out/") for line in lines] == [len("truth_situations") + 2] * 2
