"""Identities after a split by classifiers alone: the result on held-out seeds, and the choice itself."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.figure import Figure
from trackers.laser_vision_learning.looks import LooksOptions
from twin.reproduce.laser_vision_learning.splits import VARIANTS, SplitDecision, decide, near_identical_clothes
from twin.run.live import run_scenario
from twin.scenario import load_scenario
from twin.truth.truth_types import SituationKind

_SCENARIO, _DURATION_S = "library-hall-busy", 100
_FRESH, _DEVELOPMENT = (2100, 2101), (1003,)
_KINDS: tuple[SituationKind, ...] = ("correlated", "merged_rig")
_TARGETS = {"mixed": ">= 0.99", "near-identical": ">= 0.95"}


def figure() -> Iterator[Figure]:
    """Two runs of each kind of clothes: some 300 correlated pairs that part, and the splits of merges among them."""
    for clothes, target in _TARGETS.items():
        for kind, decisions in _decided(clothes, _FRESH, {"": LooksOptions()}, _KINDS).items():
            right = float(np.mean([each.right for each in decisions[""]]))
            name = f"identities right, classifiers alone, {clothes} clothes, {len(decisions[''])} that were {kind}"
            yield Figure(name, right, "", target)


def choice() -> Iterator[Figure]:
    """Evaluate each other choice on near-identical clothes; the margin separates choices that are all right."""
    for name, decisions in _decided("near-identical", _DEVELOPMENT, VARIANTS, _KINDS[:1])[_KINDS[0]].items():
        margin = np.array([each.margin for each in decisions])
        yield Figure(f"choice: {name}, identities right of {len(margin)}", float((margin > 0).mean()), "", "")
        yield Figure(f"choice: {name}, mean margin over its deviation", float(margin.mean() / margin.std()), "", "")


def _decided(
    clothes: str, seeds: Sequence[int], variants: Mapping[str, LooksOptions], kinds: Sequence[SituationKind]
) -> dict[SituationKind, dict[str, list[SplitDecision]]]:
    """Decisions of every variant over the runs of these seeds, by the kind of situation that ended."""
    found: dict[SituationKind, dict[str, list[SplitDecision]]] = {
        kind: {name: [] for name in variants} for kind in kinds
    }
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            changes = [f"seed={seed}", f"duration_s={_DURATION_S}", "background=none"]
            scenario = load_scenario(_SCENARIO, changes)
            if clothes == "near-identical":
                scenario = load_scenario(_SCENARIO, changes + near_identical_clothes(scenario.people))
            out = Path(folder) / str(seed)
            run_scenario(scenario, trackers=(), out=out, video=False)
            for kind in kinds:
                for name, decisions in decide(out / "recording.mcap", variants, kind).items():
                    found[kind][name] += decisions
    return found
