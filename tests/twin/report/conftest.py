"""The synthetic run that most of the report's tests look at."""

from __future__ import annotations

import pytest
from synthetic_run import SyntheticRun, stage


@pytest.fixture(scope="session")
def synthetic() -> SyntheticRun:
    return stage(6.0)
