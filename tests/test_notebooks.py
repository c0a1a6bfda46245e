"""The notebooks run from top to bottom, each cell after the other, and their pages show what they print and plot."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import pytest
from documentation import notebook


@pytest.mark.slow
@pytest.mark.parametrize("path", notebook.NOTEBOOKS, ids=lambda path: path.stem)
def test_every_cell_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notebook, "FOLDER", tmp_path / "notebooks")
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        assert cell["cell_type"] == "markdown" or (not cell["outputs"] and cell["execution_count"] is None)
    before = notebook.notebook_page(path)
    notebook.run_notebook(path)
    outputs = list(notebook.outputs_of(path).values())
    pictures = [tmp_path / "notebooks" / each["picture"] for each in outputs if "picture" in each]
    assert len(pictures) == 2 and all(each.stat().st_size > 5000 for each in pictures)
    assert ast.literal_eval(outputs[-1]["text"])["mota"] > 0.9
    page = notebook.notebook_page(path)
    assert page.count("![") == before.count("![") + 2 and outputs[-1]["text"] in page


def test_there_are_notebooks() -> None:
    assert notebook.NOTEBOOKS
