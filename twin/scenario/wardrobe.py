"""The wardrobe: the named colours, styles and kinds of clothes that people can be given or draw."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from typing import Literal

from twin.models import load_yaml

Garment = Literal["shirt", "trousers", "shoes", "skin", "hair", "skirt", "coat", "cap", "bag_colour", "shirt_second"]
Choice = Literal["hair_style", "shirt_pattern", "bag"]
Extra = Literal["skirt", "coat", "cap", "glasses", "beard"]

NONE = "none"
"""What a scenario writes for a skirt, coat, cap or bag that is not worn."""

_CHOICES: tuple[Choice, ...] = ("hair_style", "shirt_pattern", "bag")
_HEX = re.compile(r"#[0-9a-fA-F]{6}")


@dataclass(frozen=True)
class Wardrobe:
    """Named colours ('#rrggbb', sRGB) of each garment; styles and kinds, and extras, with their shares of people [%]."""

    colours: dict[str, dict[str, str]]
    choices: dict[str, dict[str, float]]
    worn: dict[str, float]

    def check(self, garment: Garment, colour: str, *, may_be_none: bool = False) -> str:
        """The colour itself when it is a name of this garment's or '#rrggbb'; raises ValueError saying what is valid.

        `may_be_none`: 'none' is valid too.
        """
        names = self.colours[garment]
        if colour in names or _HEX.fullmatch(colour) or (may_be_none and colour == NONE):
            return colour
        other = f"'#rrggbb' or '{NONE}'" if may_be_none else "'#rrggbb'"
        what = garment.replace("_", " ").removesuffix(" colour")
        raise ValueError(f"no {what} colour {colour!r}{_meant(colour, names)}; valid are {', '.join(names)} or {other}")

    def check_choice(self, choice: Choice, name: str) -> str:
        """The name itself when it is one of this kind's; raises ValueError saying what is valid."""
        names = self.choices[choice]
        if name in names:
            return name
        raise ValueError(f"no {choice.replace('_', ' ')} {name!r}{_meant(name, names)}; valid are {', '.join(names)}")

    def rgb(self, garment: Garment, colour: str) -> tuple[float, float, float]:
        """The colour as red, green, blue, 0 to 1; raises ValueError saying what is valid."""
        code = self.colours[garment].get(self.check(garment, colour), colour)
        red, green, blue = (int(code[place : place + 2], 16) / 255 for place in (1, 3, 5))
        return red, green, blue


def _meant(name: str, names: Iterable[str]) -> str:
    close = get_close_matches(name, list(names), n=1)
    return f", did you mean {close[0]!r}" if close else ""


@cache
def wardrobe() -> Wardrobe:
    """The shipped wardrobe (`models/people/wardrobe.yaml`)."""
    content = load_yaml("people/wardrobe.yaml")
    choices = {choice: content.pop(choice) for choice in _CHOICES}
    worn = content.pop("worn")
    return Wardrobe(content, choices, worn)
