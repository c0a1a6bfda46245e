"""A notebook as a page of Markdown, with what its cells print and plot once `scripts/docs` has run it."""

from __future__ import annotations

import ast
import hashlib
import io
import json
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from twin.recording.atomic_file import write_atomic

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
FOLDER = ROOT / "out" / "gallery" / "notebooks"


def output_path(path: Path) -> Path:
    """Return where the outputs of a notebook are kept, as JSON by the number of the cell; its name holds a digest."""
    return FOLDER / f"{path.stem}-{hashlib.sha256(path.read_bytes()).hexdigest()[:10]}.json"


def outputs_of(path: Path) -> dict[str, dict[str, str]]:
    """Return what each cell printed (`text`) and plotted (`picture`, a name in `FOLDER`); nothing before it has run."""
    kept = output_path(path)
    return json.loads(kept.read_text(encoding="utf-8")) if kept.is_file() else {}


def run_notebook(path: Path) -> None:
    """Run the cells in one namespace, as Jupyter does, and keep what they print and plot."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.close("all")
    names: dict[str, Any] = {}
    found: dict[str, dict[str, str]] = {}
    FOLDER.mkdir(parents=True, exist_ok=True)
    for number, cell in enumerate(json.loads(path.read_text(encoding="utf-8"))["cells"]):
        if cell["cell_type"] != "code":
            continue
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        with redirect_stdout(io.StringIO()) as printed:
            exec(compile(tree, f"{path.name}, cell {number}", "exec"), names)
            value = (
                None
                if last is None
                else eval(compile(ast.Expression(last.value), f"{path.name}, cell {number}", "eval"), names)
            )
        own = found.setdefault(str(number), {})
        if plt.get_fignums():
            own["picture"] = f"{output_path(path).stem}-{number}.png"
            plt.gcf().savefig(FOLDER / own["picture"], dpi=100, bbox_inches="tight")
            plt.close("all")
            value = None
        if text := printed.getvalue() + ("" if value is None else repr(value)):
            own["text"] = text.rstrip()
    write_atomic(output_path(path), json.dumps(found, indent=2))


def notebook_page(path: Path) -> str:
    """Format a notebook's cells as Markdown, in their order, with a line that says where the file is."""
    lines, outputs = [], outputs_of(path)
    for number, cell in enumerate(json.loads(path.read_text(encoding="utf-8"))["cells"]):
        text, own = "".join(cell["source"]), outputs.get(str(number), {})
        lines += [text, ""] if cell["cell_type"] == "markdown" else ["```python", text, "```", ""]
        if "text" in own:
            lines += ["```text", own["text"], "```", ""]
        if "picture" in own:
            lines += [f"![What the cell plots](../gallery/pictures/{FOLDER.name}/{own['picture']})", ""]
    lines.insert(1, f"\nThe notebook is `docs/notebooks/{path.name}`; the tests run every cell of it.\n")
    return "\n".join(lines)
