"""How a scenario's pictures are drawn, beyond what every picture needs."""

from __future__ import annotations

from pydantic import Field

from trackers.configuration import Strict


class Rendering(Strict):
    """Switches of the renderer, for every camera alike; all off: as fast as can be."""

    shadows: bool = Field(
        default=False,
        description="whether lamps throw shadows: those of the room that may, else the one that shines most steeply down",
    )
    samples: int = Field(
        default=0, ge=0, le=16, description="samples a pixel, which soften edges; 0: one, at its middle"
    )

    def __str__(self) -> str:
        """What is switched on, in words; empty where nothing is."""
        told = ["shadows"] if self.shadows else []
        return " and ".join([*told, *([f"{self.samples} samples a pixel"] if self.samples else [])])


PLAIN = Rendering()
