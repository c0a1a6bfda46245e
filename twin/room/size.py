"""How much a room's file asks to be made: a line of MJCF can ask for a billion copies, and MuJoCo would make them."""

from __future__ import annotations

from collections.abc import Iterable
from math import prod
from xml.etree import ElementTree

from trackers.errors import InputError

_MOST_COPIES = 2000
_MOST_POINTS = 10_000
_MOST_PIXELS = 8192 * 8192
_MOST = {
    "flexcomp": (("count",), _MOST_POINTS, "points"),
    "composite": (("count",), _MOST_POINTS, "bodies"),
    "texture": (("width", "height"), _MOST_PIXELS, "pixels"),
    "hfield": (("nrow", "ncol"), _MOST_PIXELS, "samples"),
    "numeric": (("size",), _MOST_POINTS, "numbers"),
}
"""By element: the attributes whose product says how much of what it makes, and the most that is expected."""


def check_size(roots: Iterable[ElementTree.Element], source: str) -> None:
    """Raise InputError, naming `source`, where an MJCF file of these asks for more than a room needs."""
    copies = 1.0
    for root in roots:
        copies *= max(_copies(root), 1.0)
        for tag, (attributes, most, what) in _MOST.items():
            for element in root.iter(tag):
                asked = prod(_number(cell) for name in attributes for cell in element.get(name, "").split())
                if asked > most:
                    said = " ".join(f'{name}="{element.get(name)}"' for name in attributes)
                    raise InputError(f"{source}: <{tag} {said}> makes {asked:.3g} {what}; at most {most} are expected")
    if copies > _MOST_COPIES:
        raise InputError(f"{source}: <replicate> makes {copies:.3g} copies; at most {_MOST_COPIES} are expected")


def _copies(element: ElementTree.Element) -> float:
    """How many things the replicates in an element make, one within another multiplied; 0 without any."""
    inner = sum(_copies(child) for child in element)
    return _number(element.get("count", "")) * max(inner, 1.0, len(element)) if element.tag == "replicate" else inner


def _number(text: str) -> float:
    """A number of an attribute as it stands; 0 for what is none, which MuJoCo tells of."""
    try:
        return float(text)
    except ValueError:
        return 0.0
