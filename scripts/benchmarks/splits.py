"""Who is who at a split, by classifiers alone: the figure on seeds that nothing was chosen by, and the choice itself."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.figure import Figure
from trackers.laser_vision_learning.looks import LooksOptions
from twin.reproduce.laser_vision_learning.choice import VARIANTS
from twin.reproduce.laser_vision_learning.splits import Decision, decide, near_identical_clothes
from twin.run.live import run_scenario
from twin.scenario import load_scenario

_DURATION_S = 100
_FRESH, _DEVELOPMENT = (2100, 2101), (1003,)
_TARGETS = {"mixed": ">= 0.99", "near-identical": ">= 0.95"}


def figure() -> Iterator[Figure]:
    """Two runs of each kind of clothes: about 200 splits."""
    for clothes, target in _TARGETS.items():
        decisions = _decided(clothes, _FRESH, {"": LooksOptions()})[""]
        yield Figure(f"splits, {clothes} clothes: seen", len(decisions), "splits", "")
        right = float(np.mean([each.right for each in decisions]))
        yield Figure(f"splits, {clothes} clothes: identities right, classifiers alone", right, "", target)


def choice() -> Iterator[Figure]:
    """What each other choice makes of near-identical clothes; the margin is what tells choices apart that are all right."""
    for name, decisions in _decided("near-identical", _DEVELOPMENT, VARIANTS).items():
        margin = np.array([each.margin for each in decisions])
        yield Figure(f"choice: {name}, identities right of {len(margin)}", float((margin > 0).mean()), "", "")
        yield Figure(f"choice: {name}, mean margin over its deviation", float(margin.mean() / margin.std()), "", "")


def _decided(clothes: str, seeds: Sequence[int], variants: Mapping[str, LooksOptions]) -> dict[str, list[Decision]]:
    found: dict[str, list[Decision]] = {name: [] for name in variants}
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            changes = [f"seed={seed}", f"duration_s={_DURATION_S}", "background=none"]
            scenario = load_scenario("library-hall-busy", changes)
            if clothes == "near-identical":
                changes += near_identical_clothes(scenario.people)
                scenario = load_scenario("library-hall-busy", changes)
            out = Path(folder) / str(seed)
            run_scenario(scenario, trackers=(), out=out, video=False)
            for name, decisions in decide(out / "recording.mcap", variants, "merged_rig").items():
                found[name] += decisions
    return found
