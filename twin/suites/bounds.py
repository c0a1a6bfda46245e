"""Bounds that a suite's file promises for figures, as texts: `>= 0.97`."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator

from twin.suites.expected import mapping_of
from twin.suites.figures import FIGURE

_COMPARISONS: Mapping[str, Callable[[float, float], bool]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
    "==": operator.eq,
}
_BOUND = re.compile(r"\s*(>=|<=|==|>|<)?\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*")
_ROUNDING = 1e-9


def _bound(value: str | float) -> str:
    """The bound as `>= 0.97`; a number alone is what the figure is to be."""
    found = _BOUND.fullmatch(str(value))
    if found is None:
        raise ValueError('a number, or a bound as in ">= 0.97", is expected')
    return f"{found[1] or '=='} {found[2]}"


def _figure(name: str) -> str:
    if name not in FIGURE:
        raise ValueError(f"there is no figure {name!r}; valid are {', '.join(FIGURE)}")
    return name


Bound = Annotated[str, BeforeValidator(_bound, json_schema_input_type=str | float)]
Figures = Annotated[
    dict[Annotated[str, AfterValidator(_figure)], Bound], mapping_of('a mapping of figures, as in {mota: ">= 0.97"},')
]
Required = Annotated[
    dict[str, Figures], mapping_of('a mapping of trackers, as in {sort: {mota: ">= 0.97", misidentifications: 0}},')
]
"""By tracker and figure, what the mean over the seeds of each scenario is to be."""


def holds(mean: float, bound: str) -> bool:
    """Whether a mean keeps within a bound."""
    sign, _, limit = bound.partition(" ")
    # means of floats: that of a hundred times 0.97 is 0.97
    rounded = float(limit) if abs(mean - float(limit)) <= _ROUNDING else mean
    return _COMPARISONS[sign](rounded, float(limit))
