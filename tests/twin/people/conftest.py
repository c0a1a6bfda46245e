"""Fixtures: five people as a scenario without details would have them."""

from __future__ import annotations

import pytest
from people_cast import FIVE

from twin.scenario.person import Person


@pytest.fixture(scope="session")
def wanderers() -> dict[str, Person]:
    return {name: Person() for name in FIVE}
