"""What one person looks like, everything decided: what the scenario names, the rest drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.people.proportions import Proportions, proportions_of
from twin.scenario.people import Person
from twin.scenario.wardrobe import Garment, wardrobe

Rgb = tuple[float, float, float]

_DRAWN_HEIGHT_M = (1.55, 1.90)
_DRAWN_BUILD = (0.92, 1.12)
_GARMENTS: tuple[Garment, ...] = ("shirt", "trousers", "shoes", "skin", "hair")


@dataclass(frozen=True)
class Appearance:
    """The looks of one body: stature [m], build (breadth, 1 is the average), colours as red, green, blue 0 to 1."""

    height_m: float
    build: float
    shirt: Rgb
    trousers: Rgb
    shoes: Rgb
    skin: Rgb
    hair: Rgb
    hair_style: str
    long_sleeves: bool

    @property
    def proportions(self) -> Proportions:
        """Segment lengths [m]."""
        return proportions_of(self.height_m)


def appearance_of(person: Person, rng: np.random.Generator) -> Appearance:
    """The looks of a person; every look is drawn, then what the scenario names replaces it.

    So naming one garment changes no other.
    """
    available = wardrobe()
    height_m = float(rng.uniform(*_DRAWN_HEIGHT_M))
    build = float(rng.uniform(*_DRAWN_BUILD))
    drawn = {garment: str(rng.choice(list(available.colours[garment]))) for garment in _GARMENTS}
    style = str(rng.choice(available.hair_styles))
    long_sleeves = bool(rng.random() < 0.5)
    asked = {garment: getattr(person, garment) for garment in _GARMENTS}
    colours = {garment: available.rgb(garment, asked[garment] or drawn[garment]) for garment in _GARMENTS}
    return Appearance(
        height_m=person.height_m if person.height_m is not None else height_m,
        build=person.build if person.build is not None else build,
        **colours,
        hair_style=person.hair_style if person.hair_style is not None else style,
        long_sleeves=long_sleeves if person.sleeves is None else person.sleeves == "long",
    )
