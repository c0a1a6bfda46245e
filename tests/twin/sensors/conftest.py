"""The capsule room and its renderer."""

from collections.abc import Iterator

import pytest
from capsule_room import CapsuleWorld, capsule_model

from twin.sensors.render import RendererOnDemand


@pytest.fixture
def world() -> CapsuleWorld:
    return CapsuleWorld(capsule_model())


@pytest.fixture
def renderer(world: CapsuleWorld) -> Iterator[RendererOnDemand]:
    with RendererOnDemand(world.model) as renderer:
        yield renderer
