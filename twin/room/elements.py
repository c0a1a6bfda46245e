"""The elements of MJCF that a room may hold: `docs/mjcf.md` says of each what the twin makes of it.

What is neither modelled nor without effect is refused in a sentence, before MuJoCo makes it. The rule behind the table: what
a camera sees, a scanner's ray meets and people walk around.
"""

from __future__ import annotations

from xml.etree import ElementTree

from trackers.errors import InputError

_DEFORMABLE = (
    'is deformable, which rays and people do not meet; a <mesh> of its shape in a <geom type="mesh"> is expected'
)
REFUSED = {
    "flexcomp": _DEFORMABLE,
    "flex": _DEFORMABLE,
    "flexstrain": _DEFORMABLE,
    "skin": 'is seen by cameras alone; a <geom type="mesh"> of its shape is expected',
    "hfield": 'is a height field, on which nobody can walk; boxes, planes, round shapes or a <geom type="mesh"> are expected',
    "extension": "asks for plug-ins of MuJoCo, which are code; a room without them is expected",
    "plugin": "is a plug-in of MuJoCo, which is code; an element without it is expected",
}
"""By element: what is wrong with it, and what is expected in its place."""


def check_elements(root: ElementTree.Element, where: str, *, is_model: bool) -> None:
    """Raise InputError, opening with `where`, for an element of an MJCF file that the twin does not model.

    `is_model`: whether the file is a whole model, not one that is included.
    """
    if is_model and root.tag != "mujoco":
        raise InputError(f"{where}: its root is <{root.tag}>; an MJCF file, whose root is <mujoco>, is expected")
    for element in root.iter():
        if element.tag in REFUSED and len(element) + len(element.attrib):
            name = f" name={element.get('name')!r}" if element.get("name") else ""
            raise InputError(f"{where}: <{element.tag}{name}> {REFUSED[element.tag]}")
