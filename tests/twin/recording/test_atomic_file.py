"""Files that are written whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from trackers.errors import InputError
from twin.recording.atomic_file import NO_SPACE, open_atomic


def write_without_space(path: Path, code: int) -> None:
    with open_atomic(path) as stream:
        stream.write("t,id")
        raise OSError(code, os.strerror(code))


@pytest.mark.parametrize("code", NO_SPACE)
def test_want_of_space_is_a_sentence_and_leaves_the_older_file(tmp_path: Path, code: int) -> None:
    path = tmp_path / "table.csv"
    path.write_text("older")
    with pytest.raises(InputError, match=r"table\.csv: cannot be written"):
        write_without_space(path, code)
    assert [each.name for each in tmp_path.iterdir()] == ["table.csv"] and path.read_text() == "older"
