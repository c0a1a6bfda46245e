"""Limits on what a room's files ask MuJoCo to make, counted from their headers before it makes any of it.

A line of MJCF can ask for a billion copies, a picture of a kilobyte for a gigabyte of pixels.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from math import prod
from pathlib import Path
from xml.etree import ElementTree

from trackers.errors import InputError
from trackers.limits import check_limit

MOST_DEEP = 100
"""Elements within elements: MuJoCo takes fewer than 500, and walks them by recursion."""
MOST_COPIES = 2000
"""That one `<replicate>` makes with all that are in it: MuJoCo's time grows with their square."""
MOST_THINGS = 20_000
"""Elements of a room, copies and attached models included."""
MOST_BYTES = 1_000_000_000
"""Memory that the room's pictures and meshes take once they are compiled."""
MOST_NUMBERS = 10_000
"""Of one `<numeric>`."""
MOST_TEXT_BYTES = 20_000_000
"""Of the room's MJCF files."""

_PIXEL_BYTES = 12
_FACE_BYTES = 1600
"""Measured on one pixel and one face, with the copies that compiling makes."""
_PNG = b"\x89PNG\r\n\x1a\n"
_CUBE = 6


def check_depth(root: ElementTree.Element, where: str) -> None:
    """Raise InputError, opening with `where`, for elements nested deeper than `MOST_DEEP`, whatever the limits."""
    level, depth = [root], 1
    while level := [child for element in level for child in element]:
        depth += 1
        if depth > MOST_DEEP:
            raise InputError(f"{where}: <{level[0].tag}> is nested {depth} deep; at most {MOST_DEEP} is expected")


def check_counts(roots: Mapping[Path, ElementTree.Element], models: Mapping[Path, list[Path]], room: Path) -> None:
    """Raise InputError, naming the room, where its elements and copies are more than a room needs.

    `roots`: of each MJCF file; `models`: of each, the files that it includes or attaches, which do not come back to it.
    """
    for root in roots.values():
        for numeric in root.iter("numeric"):
            check_limit(_number(numeric.get("size", "")), MOST_NUMBERS, f"{room}: <numeric> holds", "numbers")
        for element in root.iter("replicate"):
            check_limit(_copies(element), MOST_COPIES, f"{room}: <replicate> makes", "copies")
    made: dict[Path, float] = {}

    def things(path: Path) -> float:
        if path not in made:
            inner = max((things(each) for each in models.get(path, [])), default=0.0)
            made[path] = _things(roots[path], inner)
        return made[path]

    check_limit(things(room), MOST_THINGS, f"{room}: is made of", "elements")


def check_bytes(asked: list[float], room: Path) -> None:
    """Raise InputError, naming the room, where its pictures and meshes take more memory than a room needs [bytes]."""
    check_limit(sum(asked) / 1e6, MOST_BYTES / 1e6, f"{room}: its meshes and textures take about", "MB of memory")


def bytes_asked(element: ElementTree.Element, defaults: list[ElementTree.Element], contents: list[bytes]) -> float:
    """Estimate the memory that an asset takes once it is compiled [bytes].

    `defaults`: the elements of its tag under `<default>`; `contents`: of its files.
    """
    said: dict[str, str] = {}
    for each in defaults:  # of what several classes say the most, whichever it has
        for name, value in each.attrib.items():
            said[name] = max(said.get(name, ""), value, key=lambda text: prod(_numbers(text)))
    said |= element.attrib
    match element.tag:
        case "texture":
            width, height = _number(said.get("width", "")), _number(said.get("height", ""))
            drawn = width * max(height, _CUBE * width) if said.get("builtin", "none") != "none" else 0.0
            return _PIXEL_BYTES * (drawn + sum(map(_pixels, contents)))
        case "mesh":
            written = sum(len(said.get(name, "").split()) for name in ("vertex", "face")) / 3
            return _FACE_BYTES * (written + _builtin_faces(said) + sum(map(_faces, contents)))
        case _:
            return 0.0


def _builtin_faces(said: Mapping[str, str]) -> float:
    """Count the faces of a mesh that MuJoCo makes by itself, or more."""
    first, second, third = (*_numbers(said.get("params", "")), 1.0, 1.0, 1.0)[:3]
    match said.get("builtin", "none"):
        case "none":
            return 0.0
        case "sphere":
            return 20 * 4 ** min(first, 20)
        case "hemisphere" | "cone" | "supersphere" | "supertorus":
            return 4 * (first + 2) ** 2
        case "wedge" | "plate":
            return 2 * first * second
        case _:
            return 12 * first * second * third


def _pixels(content: bytes) -> float:
    """Count the pixels of a picture, by the header of a PNG; of other formats as many as it has bytes."""
    if content.startswith(_PNG) and len(content) >= 24:
        width, height = struct.unpack(">II", content[16:24])
        return float(width) * height
    return float(len(content))


def _faces(content: bytes) -> float:
    """Count faces, or vertices where they are more, of a mesh: OBJ by its lines, STL and MSH by their headers."""
    head = content[:4096]
    if b"\0" not in head:
        corners = sum(max(len(line.split()) - 3, 1) for line in re.findall(rb"^\s*f\s[^\n]*", content, re.MULTILINE))
        return float(max(corners, len(re.findall(rb"^\s*v\s", content, re.MULTILINE))))
    stl = struct.unpack("<I", content[80:84])[0] if len(content) >= 84 else 0
    if len(content) == 84 + 50 * stl:
        return float(stl)
    return len(content) / 12  # no format packs a vertex or a face closer


def _copies(replicate: ElementTree.Element) -> float:
    """Count the things that a `<replicate>` makes, one within another multiplied."""
    inner = sum(_copies(each) for child in replicate for each in _outermost(child))
    return _number(replicate.get("count", "")) * max(inner, 1.0, len(replicate))


def _outermost(element: ElementTree.Element) -> Iterator[ElementTree.Element]:
    """Return the replicates in an element, itself included, that are in no other of them."""
    if element.tag == "replicate":
        yield element
    else:
        for child in element:
            yield from _outermost(child)


def _things(element: ElementTree.Element, attached: float) -> float:
    """Count the elements that an element makes, itself included; `attached`: those of a model or file that it brings in."""
    inside = sum(_things(child, attached) for child in element)
    match element.tag:
        case "replicate":
            return _number(element.get("count", "")) * inside
        case "attach" | "include":
            return 1 + attached
        case _:
            return 1 + inside


def _numbers(text: str) -> list[float]:
    return [max(1.0, _number(cell)) for cell in text.split()]


def _number(text: str) -> float:
    """Return a number of an attribute as it stands; 0 for what is none, which MuJoCo tells of."""
    try:
        return float(text)
    except ValueError:
        return 0.0
