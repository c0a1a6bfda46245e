"""The look of every plot of a reproduction, and a plot as SVG."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK, QUIET, RULE, SHADE = "#1b1f27", "#606977", "#e3e5e9", "#eef0f3"


@contextmanager
def look() -> Iterator[None]:
    """The look of the reports for what is drawn and saved in the block."""
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
            "svg.hashsalt": "roomtwin",  # the same ids in every run, so that the same results make the same file
        }
    ):
        yield


def svg_of(figure: Figure) -> str:
    """The figure as an SVG document, the same for the same figure."""
    drawn = io.StringIO()
    figure.savefig(drawn, format="svg", metadata={"Date": None})
    return drawn.getvalue()
