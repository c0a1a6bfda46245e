"""A person as a scenario describes them: looks, where they start, and the script they follow."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, FiniteFloat, model_validator

from trackers.configuration import Strict
from trackers.rig import Point2
from twin.scenario.wardrobe import Garment, HairStyle, wardrobe

TOP_SPEED_M_S = 2.5
"""The fastest that a person of this model walks [m/s]; beyond it people run, which the gait does not know."""


def _colour_of(garment: Garment) -> AfterValidator:
    return AfterValidator(lambda colour: wardrobe().check(garment, colour))


Speed = Annotated[float, Field(gt=0, le=TOP_SPEED_M_S)]
Share = Annotated[float, Field(ge=0, le=1)]


class Wander(Strict):
    """Walk about the tracked area at random, with sudden stops, starts and turns.

    The person walks to a random place after another, each stretch at a speed of its own. Stretches end after an
    exponentially distributed time of mean `stretch_s`, or on arrival: then the person stops suddenly with
    probability `stop_share` for a time uniform in `stop_s`, and otherwise turns at once.
    """

    kind: Literal["wander"] = "wander"
    speed_m_s: tuple[Speed, Speed] = Field(default=(0.6, 1.3), description="slowest and fastest walking speed [m/s]")
    stretch_s: float = Field(default=2.5, ge=0.2, le=60, description="mean time between two stops or turns [s]")
    stop_share: Share = Field(default=0.4, description="share of stretches that end in a stop, 0 to 1")
    stop_s: tuple[float, float] = Field(default=(0.3, 1.0), description="shortest and longest stop [s]")

    @model_validator(mode="after")
    def _ordered(self) -> Wander:
        for name, (low, high) in (("speed_m_s", self.speed_m_s), ("stop_s", self.stop_s)):
            if not 0 <= low <= high:
                raise ValueError(f"{name} [{low:g}, {high:g}] is not a range; the smaller number first, none negative")
        return self


class Stand(Strict):
    """Stand still, facing the person's `heading_deg`; the others walk around."""

    kind: Literal["stand"] = "stand"


class Walk(Strict):
    """Walk through waypoints, then stop; with `repeat`, from the last to the first again and so on."""

    kind: Literal["walk"] = "walk"
    waypoints: tuple[Point2, ...] = Field(min_length=1, description="places in the room frame [m], in order")
    speed_m_s: Speed = 1.2
    repeat: bool = False


Script = Annotated[Wander | Stand | Walk, Field(discriminator="kind")]


class Person(Strict):
    """Who walks in the room; what is left out is drawn from the person's own seed.

    Colours are names of the wardrobe or '#rrggbb'.
    """

    height_m: float | None = Field(default=None, ge=1.0, le=2.1, description="stature, shoes on [m]")
    build: float | None = Field(default=None, ge=0.8, le=1.35, description="breadth of the body, 1 is the average")
    shirt: Annotated[str, _colour_of("shirt")] | None = None
    sleeves: Literal["short", "long"] | None = None
    trousers: Annotated[str, _colour_of("trousers")] | None = None
    shoes: Annotated[str, _colour_of("shoes")] | None = None
    skin: Annotated[str, _colour_of("skin")] | None = None
    hair: Annotated[str, _colour_of("hair")] | None = None
    hair_style: HairStyle | None = None
    start: Point2 | None = Field(default=None, description="ground point at t = 0, room frame [m]")
    heading_deg: FiniteFloat | None = Field(
        default=None, description="where the person faces at t = 0, counter-clockwise from x [deg]"
    )
    script: Script = Wander()
