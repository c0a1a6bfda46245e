"""Appearance of one person: features named by the scenario, all others drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.people.body.clothes import MOTIFS
from twin.people.body.proportions import CHILD_BELOW_M, Proportions, proportions_of
from twin.scenario.person import NONE, Choice, Extra, Garment, Person, Wardrobe, wardrobe

Rgb = tuple[float, float, float]

_DRAWN_HEIGHT_M = (1.55, 1.90)
_DRAWN_BUILD = (0.90, 1.18)
_FIRST_GARMENTS: tuple[Garment, ...] = ("shirt", "trousers", "shoes", "skin", "hair")
_MORE_GARMENTS: tuple[Garment, ...] = ("skirt", "coat", "cap", "bag_colour")
_CHOICES: tuple[Choice, ...] = ("hair_style", "shirt_pattern", "bag")
_EXTRAS: tuple[Extra, ...] = ("skirt", "coat", "cap", "glasses", "beard")
_BEARDED_STYLES = ("short", "bald", "cropped", "curly", "afro")
_LEAST_CONTRAST = 0.45
"""Least distance between the two colours of a pattern, in the unit cube of red, green, blue."""

_ADULT_BMI = 22.5
_CHILD_BMI = 16.0


@dataclass(frozen=True)
class BodyAppearance:
    """Appearance of one body: stature [m], build (breadth, 1 is the average), mass [kg], colours as red, green, blue 0 to 1
    (None: not worn).
    """

    height_m: float
    build: float
    child: bool
    mass_kg: float
    shirt: Rgb
    shirt_pattern: str
    shirt_second: Rgb
    print_motif: str
    long_sleeves: bool
    trousers: Rgb
    leggings: bool
    skirt: Rgb | None
    coat: Rgb | None
    shoes: Rgb
    skin: Rgb
    hair: Rgb
    hair_style: str
    beard: bool
    cap: Rgb | None
    glasses: bool
    bag: str
    bag_colour: Rgb

    @property
    def proportions(self) -> Proportions:
        """Segment lengths [m]."""
        return proportions_of(self.height_m, self.child)


def mass_of(height_m: float, build: float, child: bool) -> float:
    """Return the mass [kg] from stature [m] and build: the body mass index is 22.5 (child: 16) × build² (ours).

    22.5 kg/m² is near the middle of the World Health Organization's normal range for adults, 16 near the median of its
    growth reference from 2 to 9 years.
    """
    return (_CHILD_BMI if child else _ADULT_BMI) * build**2 * height_m**2


def appearance_of(person: Person, rng: np.random.Generator) -> BodyAppearance:
    """Draw every feature, then replace those that the scenario names.

    Naming one garment changes no other, unless it hides the other (see `Person`).
    """
    available = wardrobe()
    height_m = float(rng.uniform(*_DRAWN_HEIGHT_M))
    build = float(rng.uniform(*_DRAWN_BUILD))
    drawn: dict[str, str] = {garment: _any_of(available, garment, rng) for garment in _FIRST_GARMENTS}
    rng.integers(4)  # unused draw: without it the same seed would give other sleeves
    long_sleeves = bool(rng.random() < 0.5)
    drawn |= {choice: _draw_choice(available, choice, rng) for choice in _CHOICES}
    worn = {extra: bool(100 * rng.random() < available.worn[extra]) for extra in _EXTRAS}
    drawn |= {garment: _any_of(available, garment, rng) for garment in _MORE_GARMENTS}
    second_order = rng.permutation(len(available.colours["shirt_second"]))
    motif = MOTIFS[int(rng.integers(len(MOTIFS)))]

    def named(look: str) -> str:
        asked = getattr(person, look)
        return drawn[look] if asked is None else asked

    def extra_colour(garment: Garment, may_be_drawn: bool) -> Rgb | None:
        asked = getattr(person, garment)
        if asked is None:
            return available.rgb(garment, drawn[garment]) if may_be_drawn and worn[garment] else None
        return None if asked == NONE else available.rgb(garment, asked)

    colours = {garment: available.rgb(garment, named(garment)) for garment in _FIRST_GARMENTS}
    shirt_is_named = person.shirt is not None
    pattern = "plain" if shirt_is_named and person.shirt_pattern is None else named("shirt_pattern")
    second = _second_colour(available, person.shirt_second, colours["shirt"], second_order)
    skirt = extra_colour("skirt", may_be_drawn=person.trousers is None)
    style = named("hair_style")
    height_m = height_m if person.height_m is None else person.height_m
    build = build if person.build is None else person.build
    child = height_m < CHILD_BELOW_M if person.child is None else person.child
    beard = worn["beard"] and not child and skirt is None and style in _BEARDED_STYLES
    return BodyAppearance(
        height_m=height_m,
        build=build,
        child=child,
        mass_kg=mass_of(height_m, build, child) if person.mass_kg is None else person.mass_kg,
        **colours,
        shirt_pattern=pattern,
        shirt_second=second,
        print_motif=motif,
        long_sleeves=long_sleeves if person.sleeves is None else person.sleeves == "long",
        leggings=skirt is not None and person.trousers is not None,
        skirt=skirt,
        coat=extra_colour("coat", may_be_drawn=not shirt_is_named),
        hair_style=style,
        beard=beard if person.beard is None else person.beard,
        cap=extra_colour("cap", may_be_drawn=True),
        glasses=worn["glasses"] if person.glasses is None else person.glasses,
        bag=NONE if shirt_is_named and person.bag is None else named("bag"),
        bag_colour=available.rgb("bag_colour", named("bag_colour")),
    )


def _any_of(available: Wardrobe, garment: Garment, rng: np.random.Generator) -> str:
    return str(rng.choice(list(available.colours[garment])))


def _draw_choice(available: Wardrobe, choice: Choice, rng: np.random.Generator) -> str:
    shares = np.array(list(available.choices[choice].values()), dtype=float)
    return str(rng.choice(list(available.choices[choice]), p=shares / shares.sum()))


def _second_colour(available: Wardrobe, named: str | None, first: Rgb, order: np.ndarray) -> Rgb:
    """Return the named second colour, or else the first colour in `order` that differs enough from `first`."""
    if named is not None:
        return available.rgb("shirt_second", named)
    colours = [available.rgb("shirt_second", name) for name in available.colours["shirt_second"]]
    apart = [float(np.linalg.norm(np.subtract(colours[place], first))) for place in order]
    chosen = next((place for place, gap in enumerate(apart) if gap >= _LEAST_CONTRAST), int(np.argmax(apart)))
    return colours[order[chosen]]
