"""How the light in the room changes while the scenario runs."""

from __future__ import annotations

from pydantic import Field, FiniteFloat, field_validator

from trackers.configuration import Strict

EVERY_LIGHT = "all"
"""The name that speaks of all lights of the room at once."""


class Flicker(Strict):
    """Brightness that swings `hz` times a second between 1 − `depth` and 1 of what it would be, as a cosine.

    A lamp on 50 Hz mains flickers at 100 Hz: what a camera makes of it is a slow beat, as its pictures are instants.
    """

    hz: float = Field(gt=0, le=1000, description="swings of the brightness a second [Hz]")
    depth: float = Field(gt=0, le=1, description="share of the brightness that is missing where it is least, 0 to 1")


class LightChange(Strict):
    """From `at_s` on, a light's brightness goes to `brightness` times the room's own, over `over_s` (0: at once).

    `name`: a light of the room's MJCF, or 'all'. It starts from what the light has at that moment. `flicker` lasts until
    the light's next change. A lamp going off: brightness 0; a cloud: a smaller one of the daylight over some seconds,
    and back; both of what the room's lights add, emission (a lit screen, a lamp's own glow) stays as it is.
    """

    at_s: FiniteFloat = Field(description="time since the start at which the light begins to change [s]")
    name: str = Field(
        default=EVERY_LIGHT,
        min_length=1,
        description="name of a light of the room's MJCF file; 'all': every light of the room",
    )
    brightness: float = Field(
        default=1.0, ge=0, le=10, description="what the light's brightness goes to, times the room's own; 0: off"
    )
    over_s: float = Field(default=0.0, ge=0, le=86_400, description="how long the change takes [s]; 0: at once")
    flicker: Flicker | None = Field(
        default=None, description="how the light flickers from then on, until its next change; none: it does not"
    )

    @field_validator("at_s")
    @classmethod
    def _after_the_start(cls, at_s: float) -> float:
        if at_s < 0:
            raise ValueError(f"{at_s:g} s is before the start of the scenario; 0 or later is valid")
        return at_s
