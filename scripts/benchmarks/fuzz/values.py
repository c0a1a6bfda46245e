"""Corrupting what is real: trees of values (YAML, JSON), text, tables, XML and bytes; all drawn from a generator handed in."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from random import Random
from typing import Any
from xml.etree import ElementTree

ANY_NUMBER = (
    *(0, -1, 1, 2, 1e-300, 1e-9, 1.5e-5, 0.24, 1000, 1e5, 1e6, 1e9, 1e18, 1e200, -1e308, 2**31, 2**63, 2**64, 10**400),
    *(math.nan, math.inf, -math.inf, -0.0),
)
FLOATS = tuple(float(each) for each in ANY_NUMBER if not isinstance(each, int) or abs(each) < 2**64)
NAMES = (
    "../../victim.txt",
    "/etc/passwd",
    "/dev/zero",
    "~",
    ".",
    "evil:Mine",
    "a/b",
    "n" * 300,
    "\0",
    "a\0b",
    "p\n",
    "",
)
TEXTS = (*NAMES, "nan", "1e999999999", "9" * 5000, "0x1", "x" * 70_000, "🧍", "\ud7ff", " ", "no", "2001-99-99")


def _nested(depth: int) -> list[Any]:
    nest: list[Any] = []
    for _ in range(depth):
        nest = [nest]
    return nest


def hostile(rng: Random) -> Any:
    """A value that hardly any field expects."""
    number, text = rng.choice(ANY_NUMBER), rng.choice(TEXTS)
    others = (None, True, [], {}, [[]], {"": None}, {text: text}, [number] * rng.choice((1, 2, 3, 3000)), _nested(80))
    return rng.choice((number, number, text, rng.choice(others)))


def corrupted_tree(tree: Any, rng: Random, draw: Callable[[Random], Any] = hostile) -> Any:
    """A copy of a tree of mappings, lists and scalars with one to three places corrupted."""
    tree = copy.deepcopy(tree)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        places = list(_places(tree))
        if places:
            _corrupt(*rng.choice(places), rng, draw, places)
    return tree


def _places(tree: Any):
    if isinstance(tree, dict | list):
        for key in list(tree) if isinstance(tree, dict) else range(len(tree)):
            yield tree, key
            yield from _places(tree[key])


def _corrupt(parent: Any, key: Any, rng: Random, draw: Callable[[Random], Any], places: list) -> None:
    value = parent[key]
    how = rng.choice(("value", "value", "value", "scaled", "drop", "double", "swap", "key", "wrap"))
    if how == "scaled" and isinstance(value, int | float) and not isinstance(value, bool):
        parent[key] = value * rng.choice((-1, 1e3, 1e-3, 1e9, 1e-9))
    elif how == "drop":
        del parent[key]
    elif how == "double" and isinstance(parent, list):
        parent.insert(key, copy.deepcopy(value))
    elif how == "swap":
        other, place = rng.choice(places)
        parent[key] = copy.deepcopy(other[place]) if place in range(len(other)) or isinstance(other, dict) else None
    elif how == "key" and isinstance(parent, dict):
        parent[rng.choice((f"{key}x", "kind", rng.choice(TEXTS)))] = parent.pop(key)
    elif how == "wrap":
        parent[key] = rng.choice(([value], {"a": value}, [value, value], str(value)))
    else:
        parent[key] = draw(rng)


YAML_TRAPS = (
    "&a [*a]",
    "&a {b: *a}",
    "!!int ''",
    "!!float ''",
    "!!bool x",
    "!!timestamp 2001-13-45",
    "2001-13-45",
    "2001-01-01 25:61:61",
    "!!binary x",
    "!!set {a, b}",
    "!!python/object/apply:os.system ['true']",
    "!!str",
    "[" * 3000,
    "{" * 3000,
    "- " * 3000,
    "9" * 5000,
    "-" + "9" * 5000,
    "{? [1, 2] : 3}",
    "{{}: 1}",
    "{1: 2}",
    "{null: 2}",
    "{<<: 3}",
    "*nobody",
    "1:60:60",
    "0o8",
    "1e999999999",
    "|\n  a\n b",
    "'",
    '"\\x00"',
    '"\\ud800"',
    "%YAML 9.9",
    "---",
    "...",
    "\t",
    "\0",
    "\ufeff",
    "@",
    "`",
    "{a: &x [1, 1], b: &y [*x, *x], c: [*y, *y]}",
    "[&a [x,x,x,x,x,x,x,x], &b [*a,*a,*a,*a,*a,*a,*a,*a], &c [*b,*b,*b,*b,*b,*b,*b,*b], &d [*c,*c,*c,*c,*c,*c,*c,*c], "
    "&e [*d,*d,*d,*d,*d,*d,*d,*d], &f [*e,*e,*e,*e,*e,*e,*e,*e], &g [*f,*f,*f,*f,*f,*f,*f,*f], [*g,*g,*g,*g,*g,*g,*g]]",
)
"""Values that YAML alone has: anchors, tags, keys of any type, traps of its scalars."""


def corrupted_text(text: str, rng: Random, traps: Sequence[str] = YAML_TRAPS) -> bytes:
    """The text with a value exchanged for a trap, a line dropped or doubled, or its bytes corrupted."""
    lines = text.splitlines(keepends=True)
    number = rng.randrange(len(lines)) if lines else 0
    how = rng.choice(("trap", "trap", "trap", "whole", "drop", "double", "indent", "bytes", "bytes"))
    if how == "bytes" or not lines:
        return corrupted_bytes(text.encode(), rng)
    if how == "whole":
        return rng.choice(traps).encode("utf-8", "surrogatepass")
    line = lines[number]
    if how == "trap":
        head, colon, _ = line.partition(": ")
        lines[number] = f"{head}{colon}{rng.choice(traps)}\n" if colon else f"{rng.choice(traps)}\n"
    elif how == "drop":
        del lines[number]
    elif how == "double":
        lines.insert(number, line)
    else:
        lines[number] = " " * rng.randrange(5) + line.lstrip()
    return "".join(lines).encode("utf-8", "surrogatepass")


def corrupted_bytes(data: bytes, rng: Random) -> bytes:
    """The bytes with some flipped, cut, doubled, zeroed, put in or taken out."""
    content = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        at = rng.randrange(len(content) + 1)
        upto = min(len(content), at + rng.choice((1, 4, 8, 64, 1000)))
        how = rng.choice(("flip", "flip", "flip", "cut", "zero", "ones", "double", "out", "in"))
        if how == "flip" and at < len(content):
            content[at] ^= 1 << rng.randrange(8)
        elif how == "cut":
            del content[at:]
        elif how in ("zero", "ones"):
            content[at:upto] = bytes([0 if how == "zero" else 255]) * (upto - at)
        elif how == "double":
            content[at:at] = content[at:upto]
        elif how == "out":
            del content[at:upto]
        else:
            content[at:at] = rng.randbytes(rng.choice((1, 4, 100)))
    return bytes(content)


def corrupted_table(text: str, rng: Random, separator: str = ",") -> bytes:
    """A table with cells, rows or columns corrupted; `separator` is what parts its cells."""
    rows = [line.split(separator) for line in text.splitlines()]
    for _ in range(rng.choice((1, 1, 2, 5))):
        if not rows:
            break
        row = rng.choice((0, rng.randrange(len(rows))))
        column = rng.randrange(len(rows[row])) if rows[row] else 0
        how = rng.choice(("cell", "cell", "cell", "cell", "row", "double", "column", "short", "header", "bytes"))
        if how == "row":
            del rows[row]
        elif how == "double":
            rows.insert(rng.randrange(len(rows)), list(rows[row]))
        elif how == "column":
            rows = [[cell for place, cell in enumerate(each) if place != column] for each in rows]
        elif how == "short":
            del rows[row][column:]
        elif how == "bytes":
            return corrupted_bytes("\n".join(separator.join(each) for each in rows).encode(), rng)
        elif rows[row]:
            rows[row][column] = str(
                rng.choice((rng.choice(ANY_NUMBER), rng.choice(TEXTS), rows[-1][column % len(rows[-1])]))
            )
    return "\n".join(separator.join(each) for each in rows).encode("utf-8", "surrogatepass")


MJCF_TRAPS = (
    '<include file="../../../etc/passwd"/>',
    '<include file="room.xml"/>',
    '<asset><mesh name="m" file="/dev/zero"/></asset>',
    '<asset><mesh name="m" vertex="0 0 0"/></asset>',
    '<asset><mesh name="m" vertex="nan 0 0 1 0 0 0 1 0 0 0 1"/></asset>',
    '<asset><texture name="t9" type="2d" builtin="flat" width="100000" height="100000"/></asset>',
    '<asset><hfield name="h" nrow="30000" ncol="30000" size="1 1 1 1"/></asset>',
    '<size memory="900G"/>',
    '<size memory="-3"/>',
    '<option timestep="nan"/>',
    '<option timestep="0"/>',
    '<compiler meshdir="/" autolimits="maybe"/>',
    '<custom><numeric name="walkable_area" data="nan 0 1 1 2 2"/></custom>',
    '<custom><numeric name="walkable_area" size="2000000000" data="0"/></custom>',
    '<custom><text name="t" data="x"/></custom>',
    '<worldbody><replicate count="1000000000" offset="1 0 0"><geom size=".1"/></replicate></worldbody>',
    '<worldbody><replicate count="30000" offset=".1 0 0"><geom size=".1"/></replicate></worldbody>',
    "<worldbody><body><freejoint/></body></worldbody>",
    '<worldbody><body pos="0 0 1"><freejoint/><geom size=".1"/></body></worldbody>',
    '<worldbody><geom type="sphere" size="1e300"/></worldbody>',
    '<worldbody><geom type="plane" size="0 0 1" pos="0 0 nan"/></worldbody>',
    '<worldbody><geom type="box" size="1 1 1" quat="0 0 0 0"/></worldbody>',
    '<worldbody><site name="seat_x" pos="1e9 0 0"/></worldbody>',
    '<worldbody><site name="seat_x" pos="nan 0 0" quat="0 0 0 0"/></worldbody>',
    '<worldbody><camera name="c" fovy="0" resolution="0 0"/></worldbody>',
    '<worldbody><light name="ceiling_light" dir="0 0 0"/></worldbody>',
    '<worldbody><flexcomp name="f" type="grid" count="2000 2000 2000" spacing=".1 .1 .1"/></worldbody>',
    '<worldbody><body name="person_1"><geom size=".1"/></body></worldbody>',
    '<default class="x"/>',
    '<sensor><rangefinder site="nobody"/></sensor>',
    '<extension><plugin plugin="nobody.at.home"/></extension>',
    '<keyframe><key qpos="1 2 3"/></keyframe>',
    '<asset><model name="m" file="room.xml"/></asset>',
    '<worldbody><attach model="m" body="b" prefix="p"/></worldbody>',
)
"""Elements that ask much of the program that compiles them, or lead elsewhere."""


def corrupted_mjcf(text: str, rng: Random) -> bytes:
    """An MJCF file with elements or attributes corrupted, or its bytes."""
    if rng.random() < 0.15:
        return corrupted_bytes(text.encode(), rng)
    root = ElementTree.fromstring(text)
    for _ in range(rng.choice((1, 1, 2, 3))):
        parent = rng.choice([each for each in root.iter() if len(each)] or [root])
        child = rng.choice(list(parent)) if len(parent) else root
        how = rng.choice(
            ("value", "value", "value", "number", "number", "drop", "double", "tag", "attribute", "trap", "trap")
        )
        if how == "drop" and child is not root:
            parent.remove(child)
        elif how == "double":
            parent.append(copy.deepcopy(child))
        elif how == "tag":
            child.tag = rng.choice(("geom", "body", "include", "frame", "joint", "replicate", "x"))
        elif how == "trap":
            root.append(ElementTree.fromstring(rng.choice(MJCF_TRAPS)))
        elif child.attrib:
            name = rng.choice(list(child.attrib))
            cells = child.attrib[name].split() or [""]
            if how == "attribute":
                child.attrib[rng.choice(("pos", "size", "type", "file", "name", "class", "mass"))] = child.attrib.pop(
                    name
                )
            elif how == "number":
                cells[rng.randrange(len(cells))] = str(rng.choice(ANY_NUMBER))
                child.attrib[name] = " ".join(cells)
            else:
                child.attrib[name] = _xml_text(rng.choice((*TEXTS, " ".join(cells * 2), cells[0])))
    return ElementTree.tostring(root)


def _xml_text(text: str) -> str:
    """Text as XML can hold it."""
    return "".join(letter for letter in text if letter >= " ")
