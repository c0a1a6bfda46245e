"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from trackers.errors import InputError
from twin.recording.atomic_file import NO_SPACE, check_writable, open_atomic


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


def test_what_could_not_be_written_is_told_before_the_work_and_nothing_is_left(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("here")
    check_writable(tmp_path / "new" / "folder" / "file.json")
    check_writable(tmp_path / "plain")
    for path in (tmp_path, tmp_path / "plain" / "file.json"):
        with pytest.raises(InputError, match=rf"{re.escape(str(path))}: cannot be written"):
            check_writable(path)
    assert [each.name for each in tmp_path.iterdir()] == ["plain"] and (tmp_path / "plain").read_text() == "here"
