"""The wardrobe: the named colours and hair styles that people can be given or draw."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Literal

import yaml

from twin.models import MODELS

Garment = Literal["shirt", "trousers", "shoes", "skin", "hair"]
HairStyle = Literal["short", "long", "bun", "bald"]

_HEX = re.compile(r"#[0-9a-fA-F]{6}")


@dataclass(frozen=True)
class Wardrobe:
    """Named colours ('#rrggbb', sRGB) of each garment, and the hair styles."""

    colours: dict[str, dict[str, str]]
    hair_styles: tuple[str, ...]

    def check(self, garment: Garment, colour: str) -> str:
        """The colour itself when it is a name of this garment's or '#rrggbb'; raises ValueError saying what is valid."""
        if colour in self.colours[garment] or _HEX.fullmatch(colour):
            return colour
        raise ValueError(f"no {garment} colour {colour!r}; valid are {', '.join(self.colours[garment])} or '#rrggbb'")

    def rgb(self, garment: Garment, colour: str) -> tuple[float, float, float]:
        """The colour as red, green, blue, 0 to 1; raises ValueError saying what is valid."""
        code = self.colours[garment].get(self.check(garment, colour), colour)
        red, green, blue = (int(code[place : place + 2], 16) / 255 for place in (1, 3, 5))
        return red, green, blue


@cache
def wardrobe() -> Wardrobe:
    """The shipped wardrobe (`models/people/wardrobe.yaml`)."""
    content = yaml.safe_load((MODELS / "people" / "wardrobe.yaml").read_text(encoding="utf-8"))
    styles = tuple(content.pop("hair_style"))
    return Wardrobe(content, styles)
