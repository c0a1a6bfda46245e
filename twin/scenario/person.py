"""A person in a scenario: appearance, arrival, and script."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, FiniteFloat, model_validator

from trackers.configuration import Strict
from trackers.errors import valid_names
from trackers.rig import Point2
from twin.models import load_yaml
from twin.scenario.action import RecordedPath, Seconds
from twin.scenario.behaviour import Action, Sit, Wander, endless

Garment = Literal["shirt", "trousers", "shoes", "skin", "hair", "skirt", "coat", "cap", "bag_colour", "shirt_second"]
Choice = Literal["hair_style", "shirt_pattern", "bag"]
Extra = Literal["skirt", "coat", "cap", "glasses", "beard"]

NONE = "none"
"""Value for a skirt, coat, cap or bag that is not worn."""

_CHOICES: tuple[Choice, ...] = ("hair_style", "shirt_pattern", "bag")
_HEX = re.compile(r"#[0-9a-fA-F]{6}")


@dataclass(frozen=True)
class Wardrobe:
    """Named colours ('#rrggbb', sRGB) of each garment; styles and kinds, and extras, with their shares of people [%]."""

    colours: dict[str, dict[str, str]]
    choices: dict[str, dict[str, float]]
    worn: dict[str, float]

    def check(self, garment: Garment, colour: str, *, may_be_none: bool = False) -> str:
        """Return the colour if it is a name of this garment's or '#rrggbb'. Raises ValueError naming valid ones.

        `may_be_none`: 'none' is valid too.
        """
        names = self.colours[garment]
        if colour in names or _HEX.fullmatch(colour) or (may_be_none and colour == NONE):
            return colour
        other = f"'#rrggbb' or '{NONE}'" if may_be_none else "'#rrggbb'"
        what = garment.replace("_", " ").removesuffix(" colour")
        raise ValueError(f"no {what} colour {colour!r}; {valid_names(colour, names, f' or {other}')}")

    def check_choice(self, choice: Choice, name: str) -> str:
        """Return the name if valid for this kind. Raises ValueError naming valid ones."""
        names = self.choices[choice]
        if name in names:
            return name
        raise ValueError(f"no {choice.replace('_', ' ')} {name!r}; {valid_names(name, names)}")

    def rgb(self, garment: Garment, colour: str) -> tuple[float, float, float]:
        """Return the colour as red, green, blue, 0 to 1. Raises ValueError naming valid ones."""
        code = self.colours[garment].get(self.check(garment, colour), colour)
        red, green, blue = (int(code[place : place + 2], 16) / 255 for place in (1, 3, 5))
        return red, green, blue


@cache
def wardrobe() -> Wardrobe:
    """Load the shipped wardrobe (`models/people/wardrobe.yaml`)."""
    content = load_yaml("people/wardrobe.yaml")
    choices = {choice: content.pop(choice) for choice in _CHOICES}
    worn = content.pop("worn")
    return Wardrobe(content, choices, worn)


def _colour_of(garment: Garment) -> AfterValidator:
    return AfterValidator(lambda colour: wardrobe().check(garment, colour))


def _colour_or_none_of(garment: Garment) -> AfterValidator:
    return AfterValidator(lambda colour: wardrobe().check(garment, colour, may_be_none=True))


def _one_of(choice: Choice) -> AfterValidator:
    return AfterValidator(lambda name: wardrobe().check_choice(choice, name))


def _as_list(script: Any) -> Any:
    """Put a single action without brackets into a list."""
    return script if isinstance(script, list | tuple) else (script,)


Script = Annotated[tuple[Action, ...], BeforeValidator(_as_list, json_schema_input_type=Action | tuple[Action, ...])]


class Person(Strict):
    """A person in the room; omitted features are drawn from the person's own seed.

    Colours are names of the wardrobe or '#rrggbb'; a skirt, coat, cap or bag may be 'none'. A named shirt is visible: plain
    unless a pattern is named, without a drawn coat or bag over it. With a skirt the legs are bare, or in leggings of the
    named trousers' colour.
    """

    height_m: float | None = Field(default=None, ge=0.9, le=2.1, description="stature, shoes on [m]")
    build: float | None = Field(default=None, ge=0.8, le=1.35, description="breadth of the body, 1 is the average")
    child: bool | None = Field(default=None, description="proportions of a child; by default below 1.40 m")
    mass_kg: float | None = Field(default=None, ge=8, le=250, description="mass; by default from height and build [kg]")
    shirt: Annotated[str, _colour_of("shirt")] | None = Field(
        default=None, description="colour of the shirt: a name of the wardrobe or '#rrggbb'"
    )
    shirt_pattern: Annotated[str, _one_of("shirt_pattern")] | None = Field(
        default=None, description="pattern of the shirt: plain, striped, checked or printed"
    )
    shirt_second: Annotated[str, _colour_of("shirt_second")] | None = Field(
        default=None, description="the other colour of a pattern"
    )
    sleeves: Literal["short", "long"] | None = Field(default=None, description="length of the sleeves")
    trousers: Annotated[str, _colour_of("trousers")] | None = Field(
        default=None,
        description="colour of the trousers, or of the leggings under a skirt: a name of the wardrobe or '#rrggbb'",
    )
    skirt: Annotated[str, _colour_or_none_of("skirt")] | None = Field(
        default=None, description="colour of the skirt: a name of the wardrobe or '#rrggbb'; 'none': no skirt"
    )
    coat: Annotated[str, _colour_or_none_of("coat")] | None = Field(
        default=None, description="colour of the coat: a name of the wardrobe or '#rrggbb'; 'none': no coat"
    )
    shoes: Annotated[str, _colour_of("shoes")] | None = Field(
        default=None, description="colour of the shoes: a name of the wardrobe or '#rrggbb'"
    )
    skin: Annotated[str, _colour_of("skin")] | None = Field(
        default=None, description="colour of the skin: a name of the wardrobe or '#rrggbb'"
    )
    hair: Annotated[str, _colour_of("hair")] | None = Field(
        default=None, description="colour of the hair: a name of the wardrobe or '#rrggbb'"
    )
    hair_style: Annotated[str, _one_of("hair_style")] | None = Field(
        default=None, description="style of the hair: short, long, bun, bald, ponytail, bob, afro, curly or cropped"
    )
    beard: bool | None = Field(default=None, description="whether the person wears a beard")
    cap: Annotated[str, _colour_or_none_of("cap")] | None = Field(
        default=None, description="colour of the cap: a name of the wardrobe or '#rrggbb'; 'none': no cap"
    )
    glasses: bool | None = Field(default=None, description="whether the person wears glasses")
    bag: Annotated[str, _one_of("bag")] | None = Field(
        default=None, description="what the person carries: none, backpack, shoulder or handbag"
    )
    bag_colour: Annotated[str, _colour_of("bag_colour")] | None = Field(
        default=None, description="colour of the bag: a name of the wardrobe or '#rrggbb'"
    )
    start: Point2 | None = Field(
        default=None,
        description="ground point at t = 0, or at `arrive_s`, room frame [m]; in or just before a door: comes in there",
    )
    heading_deg: FiniteFloat | None = Field(
        default=None, description="where the person faces at t = 0, counter-clockwise from x [deg]"
    )
    arrive_s: Seconds = Field(
        default=0.0,
        description="when the person comes into being at `start` [s]; later where somebody stands there, or left within a second",
    )
    script: Script = Field(
        default=(Wander(),), description="what the person does: one action, or a list of them, done one after another"
    )

    @model_validator(mode="after")
    def _can_be_done(self) -> Person:
        for place, action in enumerate(self.script[:-1]):
            if endless(action):
                raise ValueError(
                    f"script.{place}: {action.kind} never ends, so {self.script[place + 1].kind} after it would never be "
                    "done; for_s, or the last place in the list, is expected"
                )
        seated = [place for place, action in enumerate(self.script) if isinstance(action, Sit) and action.seated]
        if any(seated) or (seated and (self.start is not None or self.heading_deg is not None)):
            raise ValueError(
                f"script.{seated[-1]}.seated: who is seated from the start is so by the first action, and where the seat is; no "
                "other action before it, no start and no heading_deg are expected"
            )
        if any(isinstance(action, RecordedPath) for action in self.script) and (
            self.start is not None or self.heading_deg is not None or self.arrive_s > 0 or len(self.script) > 1
        ):
            raise ValueError(
                "script: a path says where and when the person is; no start, heading_deg, arrive_s or other action is "
                "expected beside it"
            )
        return self


class Randomize(Strict):
    """Uniform ranges of each person's start, times and speed about their script, drawn by the scenario's seed."""

    start_m: float = Field(default=0.0, ge=0, le=2, description="most that x and y of a start, or of a path, move [m]")
    onset_s: float = Field(
        default=0.0, ge=0, le=10, description="most that a person's `at_s`, or path, come earlier or later [s]"
    )
    speed: float = Field(default=0.0, ge=0, le=0.5, description="most that a person walks slower or faster, as a share")


STEADY = Randomize()
