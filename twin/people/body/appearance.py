"""Appearance of one person: features named by the scenario, all others drawn; bags and patterns of cloth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackers.arrays import Array
from trackers.errors import valid_names
from twin.people.body.proportions import CHILD_BELOW_M, Proportions, proportions_of
from twin.people.body.surfaces import Surface, cord, loft, rings
from twin.scenario.person import NONE, Choice, Extra, Garment, Person, Wardrobe, wardrobe


def backpack(trunk: float, depth: float, k: float) -> Surface:
    """Make a backpack in the trunk's frame: `trunk` from waist to shoulder, `depth` from its middle to the back [m]."""
    rows = [
        (-depth - 0.055 * k, 0, 0.10 * trunk, 0.045 * k, 0.105 * k),
        (-depth - 0.070 * k, 0, 0.13 * trunk, 0.075 * k, 0.130 * k),
        (-depth - 0.072 * k, 0, 0.50 * trunk, 0.080 * k, 0.135 * k),
        (-depth - 0.058 * k, 0, 0.86 * trunk, 0.065 * k, 0.125 * k),
        (-depth - 0.045 * k, 0, 0.97 * trunk, 0.038 * k, 0.085 * k),
    ]
    pocket = [
        (-depth - 0.140 * k, 0, 0.17 * trunk, 0.020 * k, 0.085 * k),
        (-depth - 0.145 * k, 0, 0.22 * trunk, 0.030 * k, 0.095 * k),
        (-depth - 0.145 * k, 0, 0.45 * trunk, 0.030 * k, 0.095 * k),
        (-depth - 0.140 * k, 0, 0.50 * trunk, 0.020 * k, 0.085 * k),
    ]
    return loft(rings(rows, 14, square=3.5)) + loft(rings(pocket, 12, square=3.5))


def shoulder_bag(k: float) -> Surface:
    """Make a bag worn behind the hip, flat against the body, about its middle."""
    rows = [
        (0, 0, -0.105 * k, 0.030 * k, 0.115 * k),
        (0, 0, -0.095 * k, 0.042 * k, 0.135 * k),
        (0, 0, 0.060 * k, 0.036 * k, 0.130 * k),
        (0, 0, 0.095 * k, 0.022 * k, 0.115 * k),
    ]
    return loft(rings(rows, 14, square=4.0))


def handbag(k: float) -> Surface:
    """Make a bag with two handles that hangs from the fist, which is the origin."""
    rows = [
        (0, 0, -0.300 * k, 0.130 * k, 0.045 * k),
        (0, 0, -0.285 * k, 0.145 * k, 0.055 * k),
        (0, 0, -0.190 * k, 0.130 * k, 0.045 * k),
        (0, 0, -0.115 * k, 0.105 * k, 0.020 * k),
    ]
    bag = loft(rings(rows, 14, square=4.0))
    turn = np.linspace(0, np.pi, 9)
    handle = np.column_stack([0.065 * k * np.cos(turn), 0 * turn, -0.125 * k + 0.120 * k * np.sin(turn)])
    apart = np.array([0, 0.010 * k, 0])
    return bag + cord(handle + apart, 0.006 * k) + cord(handle - apart, 0.006 * k)


Picture = NDArray[np.uint8]

TILE_M = 0.09
"""Breadth and height of the cloth in one repeat of `tile` [m]."""

MOTIFS = ("disc", "star", "bars", "heart", "number")
"""Motifs of a print."""

_TILE_PX = 32
_FRONT_PX = (128, 160)  # rows, columns of a trunk's picture


def tile(pattern: str, colour: ArrayLike, second: ArrayLike) -> Picture:
    """Paint one repeat (32, 32, 3) of 'striped' or 'checked' cloth."""
    place = (np.arange(_TILE_PX) + 0.5) / _TILE_PX
    across, down = np.meshgrid(place, place)
    if pattern == "striped":
        share = (down < 0.42).astype(float)
    elif pattern == "checked":
        # crossing threads colour the cloth fully, a single thread by half
        share = 0.5 * (across < 0.45) + 0.5 * (down < 0.45)
    else:
        raise ValueError(f"no tile for {pattern!r}; 'striped' or 'checked' are expected")
    return _blend(colour, second, share)


def printed(motif: str, colour: ArrayLike, second: ArrayLike) -> Picture:
    """Paint a trunk's texture with a print on the chest; u = 0.5 is the front, rows from the top."""
    rows, columns = _FRONT_PX
    across = ((np.arange(columns) + 0.5) / columns - 0.5) / 0.072
    up = (1 - (np.arange(rows) + 0.5) / rows - 0.58) / 0.13
    x, y = np.meshgrid(across, up)
    return _blend(colour, second, _motif(motif, x, y))


def _motif(motif: str, x: Array, y: Array) -> Array:
    """Return the ink, 0 or 1; x from the wearer's right to the left and y up, both about -1 to 1 over the print."""
    radius, angle = np.hypot(x, y), np.arctan2(x, y)
    match motif:
        case "disc":
            ink = (radius < 1.0) & ~((np.abs(y) < 0.16) & (radius < 0.8))
        case "star":
            ink = radius < 0.44 / np.cos((np.abs(angle) + np.pi / 5) % (2 * np.pi / 5) - np.pi / 5) * (
                1 + 0.9 * (1 - np.abs((angle * 5 / np.pi + 10.0) % 2.0 - 1.0)) * -0.35 + 0.6
            )
        case "bars":
            ink = (np.abs(x) < 1.15) & (np.abs(y) < 0.85) & ((y * 1.8 + 10.3) % 1.0 < 0.55)
        case "heart":
            ink = (x**2 + (y - 0.75 * np.abs(x) ** 0.7 + 0.1) ** 2) < 0.75
        case "number":
            stem = (np.abs(x + 0.55) < 0.17) & (np.abs(y) < 0.9)
            zero = np.abs(np.hypot((x - 0.4) / 0.55, y / 0.9) - 0.82) < 0.2
            ink = stem | zero
        case _:
            raise ValueError(f"no motif {motif!r}; {valid_names(motif, MOTIFS)}")
    return ink.astype(float)


def coat_front(coat: ArrayLike, shirt: ArrayLike) -> Picture:
    """Paint a trunk's texture: a coat closed by a row of buttons, the shirt in its neck; rows from the top."""
    rows, columns = _FRONT_PX
    coat = np.asarray(coat, dtype=float)
    u, v = np.meshgrid((np.arange(columns) + 0.5) / columns - 0.5, 1 - (np.arange(rows) + 0.5) / rows)
    out = np.broadcast_to(coat, (rows, columns, 3)).copy()
    dark = 0.62 * coat
    lapel = np.abs(u) < 0.33 * (v - 0.56)
    neck = np.abs(u) < 0.19 * (v - 0.60)
    out[lapel] = 0.86 * coat
    out[neck] = shirt
    out[(np.abs(u) < 0.006) & (v < 0.60)] = dark
    for height in (0.08, 0.22, 0.36, 0.50):
        out[(((u - 0.025) / 0.011) ** 2 + ((v - height) / 0.014) ** 2) < 1] = 0.45 * coat
    return (255 * np.clip(out, 0, 1) + 0.5).astype(np.uint8)


def _blend(colour: ArrayLike, second: ArrayLike, share: Array) -> Picture:
    colour, second = np.asarray(colour, dtype=float), np.asarray(second, dtype=float)
    return (255 * (colour + share[..., None] * (second - colour)) + 0.5).astype(np.uint8)


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
    def carries(self) -> tuple[bool, bool]:
        """Return whether the left and the right hand carry a bag."""
        return False, self.bag == "handbag"

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
