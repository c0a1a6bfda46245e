"""Registry of reproductions: name, options, and module; their page, one self-contained HTML file, and the style of plots."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin.messages import OnProgress
from twin.recording.atomic_file import open_atomic

if TYPE_CHECKING:
    from jinja2 import Template
    from matplotlib.figure import Figure

    from twin.reproduce.results import ResultRow

Outputs = tuple[list["ResultRow"], dict[str, Path]]
"""All results, and the files written, by name."""


@dataclass(frozen=True)
class Request:
    """Arguments of a reproduction: runs with seeds from `seed` on, and options that only some accept (None: default)."""

    name: str
    seed: int
    n_seed: int
    runs: int | None = None
    suite: str | None = None
    jobs: int | None = None
    resume: bool = False
    data: Path | None = None

    @property
    def seed_range(self) -> range:
        """Seeds of the runs."""
        return range(self.seed, self.seed + self.n_seed)

    @property
    def command(self) -> str:
        """Command that repeats it, without options of a single reproduction."""
        return f"twin reproduce {self.name} --seeds {self.n_seed}" + (f" --seed {self.seed}" if self.seed else "")


@dataclass(frozen=True)
class Reproduction:
    """Reproduction; options: its own; n_seed: default number of seeds.

    module: has `reproduce(folder, request, on_progress) -> Outputs`, which writes into the folder and raises InputError for
    invalid input. beyond: prefix of `where` of results that are on the page but not on the terminal.
    """

    summary: str
    module: str
    n_seed: int
    options: frozenset[str] = frozenset()
    beyond: str | None = None

    def run(self, folder: Path, request: Request, on_progress: OnProgress | None = None) -> Outputs:
        """Run the reproduction."""
        return import_module(self.module).reproduce(folder, request, on_progress)


SUITE_OPTIONS = frozenset({"--suite", "--jobs", "--resume"})
"""Options of every reproduction that simulates."""

REPRODUCTIONS: Mapping[str, Reproduction] = {
    "laser-fisheye-imm": Reproduction(
        "the paper's figures 7 and 9 and table I, and beyond",
        "twin.reproduce.laser_fisheye_imm.reproduction",
        n_seed=10,
        options=SUITE_OPTIONS | {"--runs"},
        beyond="beyond the paper",
    ),
    "laser-vision-learning": Reproduction(
        "the paper's tables I and II and figures 10 and 11, and beyond",
        "twin.reproduce.laser_vision_learning.reproduction",
        n_seed=4,
        options=SUITE_OPTIONS,
        beyond="beyond the paper",
    ),
    "camera-floor-particle": Reproduction(
        "the paper's experiments and figures 2 and 4 to 6, and beyond",
        "twin.reproduce.camera_floor_particle.reproduction",
        n_seed=2,
        options=SUITE_OPTIONS,
        beyond="beyond the paper",
    ),
    "rgbd-head": Reproduction(
        "the paper's tables 1 to 3 and figures 5 to 12, and beyond",
        "twin.reproduce.rgbd_head.reproduction",
        n_seed=2,
        options=SUITE_OPTIONS | {"--runs"},
        beyond="beyond the paper",
    ),
    "gait": Reproduction(
        "how people load the floor", "twin.reproduce.gait.reproduction", n_seed=100, options=frozenset({"--data"})
    ),
}


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
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("twin.reproduce", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


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
