"""The type checker of the test run (`tests/conftest.py`), and that it checks."""

from __future__ import annotations

from typing import Any, Self

from beartype import BeartypeConf, FrozenDict, beartype
from numpy.typing import ArrayLike

_UNCHECKED = FrozenDict({hint: Any for hint in (Self, ArrayLike, ArrayLike | None)})
checked = beartype(conf=BeartypeConf(is_pep484_tower=True, hint_overrides=_UNCHECKED))
"""beartype that takes an int for a float, as type checkers do (PEP 484).

It knows Self in whole classes only, and takes no list or tuple for what numpy makes an array of."""
