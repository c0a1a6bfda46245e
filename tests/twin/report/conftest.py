"""The staged run that most of the report's tests look at."""

from __future__ import annotations

import pytest
from staged_run import Staged, stage


@pytest.fixture(scope="session")
def staged() -> Staged:
    return stage(6.0)
