"""Page of a reproduction, one self-contained HTML file; and the style of its plots."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from twin.recording.atomic_file import open_atomic


def write_page(path: Path, template_name: str, command: str, drawn: Mapping[str, str], **content: Any) -> None:
    """Write a page from a template of this package; it takes its name when complete.

    command: the command that repeats it; drawn: plots as SVG by name, `plots` in the template. Raises InputError where the
    file cannot be written.
    """
    plots = {name: data_uri(svg) for name, svg in drawn.items()}
    page = template(template_name).render(command=command, plots=plots, **content)
    with open_atomic(path) as stream:
        stream.write(page)


def write_plots(folder: Path, drawn: Mapping[str, str]) -> dict[str, Path]:
    """Write plots as SVG under their names; return their paths. Raises InputError where a file cannot be written."""
    paths = {name: folder / f"{name}.svg" for name in drawn}
    for name, svg in drawn.items():
        with open_atomic(paths[name]) as stream:
            stream.write(svg)
    return paths


def data_uri(svg: str) -> str:
    """Encode an SVG document as the source of an image within the page."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg.encode()).decode()


@cache
def template(name: str) -> Template:
    """Load a page of this package, on the shared base."""
    environment = Environment(
        loader=PackageLoader("twin.reproduce", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK, QUIET, RULE, SHADE = "#1b1f27", "#606977", "#e3e5e9", "#eef0f3"


@contextmanager
def plot_style() -> Iterator[None]:
    """Apply the style of the reports to plots drawn and saved in the block."""
    import matplotlib

    with matplotlib.rc_context(
        {
            "font.size": 10,
            "axes.titlesize": 10.5,
            "axes.titleweight": "bold",
            "text.color": INK,
            "axes.edgecolor": QUIET,
            "axes.labelcolor": QUIET,
            "xtick.color": QUIET,
            "ytick.color": QUIET,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "axes.grid.axis": "y",
            "grid.color": RULE,
            "axes.axisbelow": True,
            "svg.fonttype": "none",
            "svg.hashsalt": "roomtwin",  # constant ids, so that equal results make equal files
        }
    ):
        yield


def to_svg(figure: Figure) -> str:
    """Convert a plot to an SVG document, deterministically."""
    drawn = io.StringIO()
    figure.savefig(drawn, format="svg", metadata={"Date": None})
    return drawn.getvalue()
