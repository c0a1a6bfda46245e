"""A person as a scenario describes them: looks, where and when they come in, and the script they follow."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, FiniteFloat, model_validator

from trackers.configuration import Strict
from trackers.rig import Point2
from twin.scenario.behaviour import Action, Path, Seconds, Wander, endless
from twin.scenario.wardrobe import Choice, Garment, wardrobe


def _colour_of(garment: Garment) -> AfterValidator:
    return AfterValidator(lambda colour: wardrobe().check(garment, colour))


def _colour_or_none_of(garment: Garment) -> AfterValidator:
    return AfterValidator(lambda colour: wardrobe().check(garment, colour, may_be_none=True))


def _one_of(choice: Choice) -> AfterValidator:
    return AfterValidator(lambda name: wardrobe().check_choice(choice, name))


def _as_list(script: Any) -> Any:
    """A script of one action may be given without brackets."""
    return script if isinstance(script, list | tuple) else (script,)


Script = Annotated[tuple[Action, ...], BeforeValidator(_as_list, json_schema_input_type=Action | tuple[Action, ...])]


class Person(Strict):
    """Who walks in the room; what is left out is drawn from the person's own seed.

    Colours are names of the wardrobe or '#rrggbb'; a skirt, coat, cap or bag may be 'none'. A shirt that is named is
    seen: it is plain unless a pattern is named, and neither coat nor bag is drawn over it. Who wears a skirt has bare
    legs, or leggings in the colour of the trousers that are named.
    """

    height_m: float | None = Field(default=None, ge=0.9, le=2.1, description="stature, shoes on [m]")
    build: float | None = Field(default=None, ge=0.8, le=1.35, description="breadth of the body, 1 is the average")
    child: bool | None = Field(default=None, description="proportions of a child; by default below 1.40 m")
    mass_kg: float | None = Field(default=None, ge=8, le=250, description="mass; by default from height and build [kg]")
    shirt: Annotated[str, _colour_of("shirt")] | None = None
    shirt_pattern: Annotated[str, _one_of("shirt_pattern")] | None = None
    shirt_second: Annotated[str, _colour_of("shirt_second")] | None = Field(
        default=None, description="the other colour of a pattern"
    )
    sleeves: Literal["short", "long"] | None = None
    trousers: Annotated[str, _colour_of("trousers")] | None = None
    skirt: Annotated[str, _colour_or_none_of("skirt")] | None = None
    coat: Annotated[str, _colour_or_none_of("coat")] | None = None
    shoes: Annotated[str, _colour_of("shoes")] | None = None
    skin: Annotated[str, _colour_of("skin")] | None = None
    hair: Annotated[str, _colour_of("hair")] | None = None
    hair_style: Annotated[str, _one_of("hair_style")] | None = None
    beard: bool | None = None
    cap: Annotated[str, _colour_or_none_of("cap")] | None = None
    glasses: bool | None = None
    bag: Annotated[str, _one_of("bag")] | None = None
    bag_colour: Annotated[str, _colour_of("bag_colour")] | None = None
    start: Point2 | None = Field(default=None, description="ground point at t = 0, room frame [m]")
    heading_deg: FiniteFloat | None = Field(
        default=None, description="where the person faces at t = 0, counter-clockwise from x [deg]"
    )
    arrive_s: Seconds = Field(default=0.0, description="when the person comes into being at `start` [s]")
    script: Script = (Wander(),)

    @model_validator(mode="after")
    def _can_be_done(self) -> Person:
        for place, action in enumerate(self.script[:-1]):
            if endless(action):
                raise ValueError(
                    f"script.{place}: {action.kind} never ends, so {self.script[place + 1].kind} after it would never be "
                    "done; for_s, or the last place in the list, is expected"
                )
        if any(isinstance(action, Path) for action in self.script) and (
            self.start is not None or self.heading_deg is not None or self.arrive_s > 0 or len(self.script) > 1
        ):
            raise ValueError(
                "script: a path says where and when the person is; no start, heading_deg, arrive_s or other action is "
                "expected beside it"
            )
        return self
