"""Files read by an MJCF room: all within permitted folders, with checked elements.

A shared scenario names a room, and a room names files, which MuJoCo would open anywhere. So all are checked before MuJoCo
sees any. A room may read its own folder, and that of `--room-root`.

`docs/mjcf.md` lists the treatment of each element: modelled, without effect, or rejected with a sentence. Modelled is all
that a camera sees, a scanner's ray meets, or people walk around.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath
from xml.etree import ElementTree

from trackers.errors import InputError
from trackers.user_input.text_file import check_limit
from twin.room.file_limits import MOST_BYTES, MOST_TEXT_BYTES, bytes_asked, check_bytes, check_counts, check_depth

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
"""Fault of each rejected element, and its replacement."""


def check_elements(root: ElementTree.Element, where: str, *, is_model: bool) -> None:
    """Raise InputError, with the prefix `where`, for an element of an MJCF file that the twin does not model, or a number in
    it that is not finite.

    `is_model`: False for an included file.
    """
    if is_model and root.tag != "mujoco":
        raise InputError(f"{where}: its root is <{root.tag}>; an MJCF file, whose root is <mujoco>, is expected")
    for element in root.iter():
        if element.tag in REFUSED and len(element) + len(element.attrib):
            name = f" name={element.get('name')!r}" if element.get("name") else ""
            raise InputError(f"{where}: <{element.tag}{name}> {REFUSED[element.tag]}")
        for attribute, value in element.attrib.items():
            if attribute not in _NAMES and _NOT_FINITE.search(value) and _are_numbers(value):
                raise InputError(
                    f"{where}: <{element.tag} {attribute}={value!r}> is not finite; finite numbers are expected"
                )


_NOT_FINITE = re.compile(r"(?<![^\s+-])(?:nan|inf|infinity)(?!\S)", re.IGNORECASE)
_NAMES = ("name", "class", "childclass", "file", "prefix", "model")


def _are_numbers(value: str) -> bool:
    """Return True for a text of numbers alone."""
    try:
        return bool([float(each) for each in value.split()])
    except ValueError:
        return False


ROOM_ROOT = "TWIN_ROOM_ROOT"
"""Environment variable with the folder of `--room-root`, for workers."""

_FOLDERS = ("meshdir", "texturedir", "assetdir")
_MJCF = ("include", "model")
"""Elements whose file is MJCF: included ones, and models to attach."""


@dataclass(frozen=True)
class _Part:
    """One MJCF file of a room, the folder of its model, and the MJCF files that it loads."""

    path: Path
    model_folder: Path
    root: ElementTree.Element
    brings: list[Path] = field(default_factory=list)


def allow_room_root(folder: Path) -> None:
    """Let the rooms of this process, and of processes started from now on, read files of a folder.

    Raises InputError for a missing folder.
    """
    if not folder.is_dir():
        raise InputError(f"--room-root {folder}: is no folder; the folder that holds the rooms' files is expected")
    os.environ[ROOM_ROOT] = str(folder.resolve())


def room_files(room: Path) -> dict[Path, bytes]:
    """Return the room's file and all that it reads, at any depth, with their contents, ordered by path.

    MuJoCo resolves a path from the folder of the model or of the included file, with or without the compiler's meshdir,
    texturedir or assetdir, without its folders under strippath: every existing candidate counts. Missing files are left out;
    MuJoCo reports them.

    Raises InputError for XML that is not plain and well-formed; for a file outside the permitted folders, be it by '..', an
    absolute path, a folder of the compiler or a symbolic link; for a cycle; for elements that are not modelled
    (`check_elements`); and beyond the limits of `twin.room.file_limits`.
    """
    found: dict[Path, bytes] = {}
    parts: dict[tuple[Path, Path], _Part] = {}
    waiting: list[tuple[Path, Path, tuple[Path, ...]]] = [(room, room.parent, ())]
    while waiting:
        path, model_folder, through = waiting.pop()
        if path.resolve() in through:
            raise InputError(
                f"{room}: {path.name} is read by itself, through {' and '.join(each.name for each in through)}, and so "
                "without end; files that do not come back to themselves are expected"
            )
        if (path, model_folder) in parts:
            continue
        _read(path, found, MOST_TEXT_BYTES, f"{room}: is, with the MJCF files that it reads, of")
        parts[path, model_folder] = part = _Part(path, model_folder, _parsed(found[path], path, room))
        for element in _MJCF:
            for _, candidate in _places(part, element, room, ()):
                part.brings.append(candidate)
                folder = model_folder if element == "include" else candidate.parent
                waiting.append((candidate, folder, (*through, path.resolve())))
    roots = {part.path: part.root for part in parts.values()}
    for path, root in roots.items():
        check_elements(root, _where(path, room), is_model=path == room)
    check_counts(roots, {part.path: part.brings for part in parts.values()}, room)
    asked: list[float] = []
    for part in parts.values():
        of_model = [each.root for each in parts.values() if each.model_folder == part.model_folder]
        files: dict[ElementTree.Element, list[Path]] = {}
        for node, place in _places(part, None, room, of_model):
            _read(place, found, MOST_BYTES, f"{room}: is, with all files that it reads, of")
            files.setdefault(node, []).append(place)
        for node in part.root.iter():
            defaults = [each for root in of_model for group in root.iter("default") for each in group.iter(node.tag)]
            asked.append(bytes_asked(node, defaults, [found[place] for place in files.get(node, [])]))
    check_bytes(asked, room)
    return {path: found[path] for path in sorted(found)}


def _read(path: Path, found: dict[Path, bytes], most: int, said: str) -> None:
    """Read a file unless already found; raise InputError where all together exceed `most` bytes."""
    if path not in found:
        check_limit(path.stat().st_size + sum(map(len, found.values())), most, said, "bytes")
        found[path] = path.read_bytes()


def _where(path: Path, room: Path) -> str:
    return f"{room}" if path == room else f"{room}: {path.name}"


def _parsed(content: bytes, path: Path, room: Path) -> ElementTree.Element:
    """Parse the root of an MJCF file as MuJoCo does: UTF-8 without a document type."""
    where = _where(path, room)
    try:
        text = content.decode("utf-8-sig")
        if "<!DOCTYPE" in text.upper():
            raise InputError(f"{where}: holds a <!DOCTYPE; MJCF without one is expected")
        root = ElementTree.fromstring(text.encode())
    except UnicodeDecodeError as error:
        raise InputError(f"{where}: byte {error.start} is not UTF-8; an MJCF file in UTF-8 is expected") from error
    except ElementTree.ParseError as error:
        raise InputError(f"{where}: is not well-formed XML ({error}); a valid MJCF file is expected") from error
    check_depth(root, where)
    return root


def _places(
    part: _Part, element: str | None, room: Path, of_model: tuple | list[ElementTree.Element]
) -> Iterator[tuple[ElementTree.Element, Path]]:
    """Yield the existing files of elements of one name (None: all that do not name MJCF), each with its element."""
    compilers = [compiler for root in of_model for compiler in root.iter("compiler")]
    folders = [""] + [compiler.get(name, "") for compiler in compilers for name in _FOLDERS]
    strips = any(compiler.get("strippath") == "true" for compiler in compilers)
    for node in part.root.iter(element):
        if element is None and node.tag in _MJCF:
            continue
        for attribute, value in node.attrib.items():
            if not attribute.startswith("file") or not value:
                continue
            names = [value, value.replace("\\", "/").rpartition("/")[2]] if strips else [value]
            candidates = [
                _joined(base, folder, name)
                for base in dict.fromkeys((part.path.parent, part.model_folder))
                for folder in dict.fromkeys(folders)
                for name in names
            ]
            said = f"<{node.tag} {attribute}={value!r}>"
            for place in _existing(candidates, room, said, part.path, folders):
                yield node, place


def _joined(base: Path, folder: str, name: str) -> Path:
    """Join paths as MuJoCo does: backslashes are slashes, absolute paths stand alone."""
    place = base
    for step in (folder, name):
        step = step.replace("\\", "/")
        place = Path(step) if PureWindowsPath(step).drive else place / step
    return place


def _existing(candidates: list[Path], room: Path, said: str, part: Path, folders: list[str]) -> Iterator[Path]:
    """Yield the existing candidates. Raises InputError if one of them, or all candidates, are outside the permitted folders."""
    homes = [room.parent.resolve()]
    if root := os.environ.get(ROOM_ROOT):
        homes.append(Path(root).resolve())
    away = [not any(place.resolve().is_relative_to(home) for home in homes) for place in candidates]
    there = [place.is_file() for place in candidates]
    if all(away) or any(is_away and is_there for is_away, is_there in zip(away, there, strict=True)):
        through = ", ".join(repr(folder) for folder in dict.fromkeys(folders) if folder)
        from_folder = f" (with the compiler's folder {through})" if through else ""
        outside = "the room's folder" if len(homes) == 1 else f"the room's folder and --room-root {homes[1]}"
        raise InputError(
            f"{_where(part, room)}: {said}{from_folder} leads outside {outside}; a relative path inside of it, or "
            "--room-root with a folder that holds both, is expected"
        )
    return (place for place, is_there in zip(candidates, there, strict=True) if is_there)
