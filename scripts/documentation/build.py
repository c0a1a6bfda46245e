"""Build the documentation: assemble the pages in out/site, fill in figures and references, and hand them to zensical.

scripts/docs [--no-gallery] [--serve]
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
from pathlib import Path

from documentation import gallery, reference
from documentation.notebook import notebook_page
from documentation.tables import MissingFigureError, fill

ROOT = Path(__file__).parents[2]
SITE = ROOT / "out" / "site"
BUILT = ROOT / "out" / "docs"
SETTINGS = Path(__file__).with_name("site.yml")


def assembled() -> dict[str, str]:
    """Return the Markdown of every page by its path. Raises SystemExit for a figure that is not there."""
    docs = ROOT / "docs"
    pages = {path.relative_to(docs).as_posix(): path.read_text(encoding="utf-8") for path in sorted(docs.rglob("*.md"))}
    pages |= {
        **dict(reference.schema_pages()),
        "reference/trackers.md": reference.options_page(),
        "reference/command-line.md": reference.command_page(),
        "tutorials/notebook.md": notebook_page(docs / "notebooks" / "observations.ipynb"),
        **gallery.pages(),
    }
    filled = {}
    for path, text in pages.items():
        try:
            filled[path] = reference.fill(fill(text))
        except (MissingFigureError, ValueError) as error:
            sys.exit(f"docs/{path}: {error}")
    return filled


def assemble() -> None:
    """Write every page, picture and asset into out/site; what has not changed stays, so that the next build is fast."""
    pages = SITE / "pages"
    wanted = {pages / path: text.encode() for path, text in assembled().items()}
    wanted |= {pages / path: picture.read_bytes() for path, picture in gallery.pictures().items()}
    wanted |= {pages / "assets" / path.name: path.read_bytes() for path in (ROOT / "docs" / "assets").iterdir()}
    wanted |= {pages / "assets" / path.name: path.read_bytes() for path in (ROOT / "scripts" / "readme").glob("*.webp")}
    wanted[SITE / "mkdocs.yml"] = SETTINGS.read_bytes()
    for path in [
        each for each in SITE.rglob("*") if each.is_file() and each not in wanted and ".cache" not in each.parts
    ]:
        path.unlink()
    for path, content in wanted.items():
        if not path.is_file() or path.read_bytes() != content:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)


def check_built() -> None:
    """Raise SystemExit for a built page that loads something from the network, and for a page that the menu leaves out."""
    faults = []
    for page in sorted(BUILT.rglob("*.html")):
        text = page.read_text(encoding="utf-8")
        for tag in re.findall(r"<(?:script|link|img|iframe)\b[^>]*>", text):
            if re.search(r"(?:src|href)=[\"']?(?:https?:)?//", tag) and "canonical" not in tag:
                faults.append(f"{page.relative_to(BUILT)}: loads from the network: {tag}")
    menu = SETTINGS.read_text(encoding="utf-8")
    faults += [f"site.yml: nav has no {path}" for path in assembled() if not re.search(rf"\s{re.escape(path)}\s", menu)]
    if faults:
        sys.exit("\n".join(faults))


def main() -> None:
    """Assemble, build, check."""
    parser = argparse.ArgumentParser(prog="scripts/docs", description="Build the documentation into out/docs.")
    parser.add_argument(
        "--gallery",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="draw the missing pictures of the gallery first: minutes the first time",
    )
    parser.add_argument("--serve", action="store_true", help="show the pages at localhost while they are written")
    arguments = parser.parse_args()
    if arguments.gallery:
        from documentation.draw import draw_all

        draw_all()
    assemble()
    zensical = [str(Path(sys.executable).with_name("zensical"))]
    if arguments.serve:
        subprocess.run([*zensical, "serve"], cwd=SITE, check=False)
        return
    shutil.rmtree(SITE / "html", ignore_errors=True)
    if subprocess.run([*zensical, "build", "--strict"], cwd=SITE, check=False).returncode:
        sys.exit(1)
    shutil.rmtree(BUILT, ignore_errors=True)
    (SITE / "html").rename(BUILT)
    check_built()
    print(BUILT.relative_to(ROOT) / "index.html")


if __name__ == "__main__":
    main()
