"""The type checker of the test run (`tests/conftest.py`), and that it checks."""

from __future__ import annotations

from typing import Any, Self

from beartype import BeartypeConf, FrozenDict, beartype

checked = beartype(conf=BeartypeConf(is_pep484_tower=True, hint_overrides=FrozenDict({Self: Any})))
"""beartype that takes an int for a float, as type checkers do (PEP 484); it knows Self in whole classes only."""
