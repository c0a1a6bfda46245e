"""Registry of reproductions: name, options, and module."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from twin.messages import OnProgress, no_progress

if TYPE_CHECKING:
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
        """Command that repeats it."""
        words = ["twin", "reproduce", self.name, "--seeds", self.n_seed]
        own = {"--seed": self.seed, "--runs": self.runs, "--suite": self.suite, "--data": self.data}
        return shlex.join(map(str, words + [word for option in own.items() if option[1] for word in option]))


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

    def run(self, folder: Path, request: Request, on_progress: OnProgress = no_progress) -> Outputs:
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
    "fusion": Reproduction(
        "the tracker of all sensors beside the published systems, rig by rig, and with sensors taken away",
        "twin.reproduce.fusion.reproduction",
        n_seed=2,
        options=SUITE_OPTIONS | {"--runs"},
        beyond="subsets of sensors",
    ),
    "gait": Reproduction(
        "how people load the floor", "twin.reproduce.gait.reproduction", n_seed=100, options=frozenset({"--data"})
    ),
}
