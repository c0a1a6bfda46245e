"""A notebook as a page of Markdown."""

from __future__ import annotations

import json
from pathlib import Path


def notebook_page(path: Path) -> str:
    """Format a notebook's cells as Markdown, in their order, with a line that says where the file is."""
    lines = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        lines += [text, ""] if cell["cell_type"] == "markdown" else ["```python", text, "```", ""]
    lines.insert(1, f"\nThe notebook is `docs/notebooks/{path.name}`; the tests run every cell of it.\n")
    return "\n".join(lines)
