"""Promises: what figures trackers are to reach in a suite, whatever they were before (`require:`)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.suites.bounds import holds
from twin.suites.figures import FIGURE, written
from twin.suites.results import GroupKey, Results


@dataclass(frozen=True)
class Kept:
    """A promise and what is: the mean over the seeds of a scenario, None where the tracker has no such figure."""

    key: GroupKey
    variant: str
    metric: str
    bound: str
    mean: float | None

    @property
    def broken(self) -> bool:
        """Whether it is not kept."""
        return self.mean is None or not holds(self.mean, self.bound)

    @property
    def measured(self) -> str:
        """The mean as text."""
        return "not measured" if self.mean is None else written(self.metric, self.mean)

    def sentence(self) -> str:
        """What is and what was promised: "MOTA is 0.912, promised >= 0.97"."""
        return f"{FIGURE[self.metric].name} is {self.measured}, promised {self.bound}"


def promises_of(facts: Mapping[str, Any], results: Results) -> list[Kept]:
    """The promises of the suite that left these facts, for what has been run of it."""
    return list(_of(facts.get("promises", ()), results))


def _of(promised: Iterable[Mapping[str, str]], results: Results) -> Iterator[Kept]:
    for each in promised:
        key = GroupKey(each["scenario"], each["overrides"], each["tracker"])
        group = results.groups.get(key)
        if group is not None:
            values = group.values(each["metric"])
            mean = float(np.mean(values)) if values else None
            yield Kept(key, group.variant, each["metric"], each["bound"], mean)
