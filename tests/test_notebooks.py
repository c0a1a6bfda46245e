"""The notebooks run from top to bottom, each cell after the other in one namespace, as Jupyter runs them."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import matplotlib
import pytest

NOTEBOOKS = sorted((Path(__file__).parents[1] / "docs" / "notebooks").glob("*.ipynb"))


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_cell_runs(path: Path) -> None:
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.close("all")  # those of other tests in this process
    names: dict[str, object] = {}
    last: object = None
    for number, cell in enumerate(json.loads(path.read_text(encoding="utf-8"))["cells"]):
        if cell["cell_type"] != "code":
            continue
        assert not cell["outputs"] and cell["execution_count"] is None, "outputs are not committed"
        tree = ast.parse("".join(cell["source"]))
        shown = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, f"{path.name}, cell {number}", "exec"), names)
        if shown is not None:
            last = eval(compile(ast.Expression(shown.value), f"{path.name}, cell {number}", "eval"), names)
    assert len(plt.get_fignums()) == 2
    plt.close("all")
    assert isinstance(last, dict) and last["mota"] > 0.9


def test_there_are_notebooks() -> None:
    assert NOTEBOOKS
