"""The files that an MJCF room reads: all of them in its own folder, and what each holds.

A scenario that somebody shares names a room, and a room names files: MuJoCo would open whatever they say. So they are
looked through before MuJoCo sees any of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from xml.etree import ElementTree

from trackers.errors import InputError
from twin.room.size import check_size

_FOLDERS = ("meshdir", "texturedir", "assetdir")
_MJCF = ("include", "model")
"""Elements whose file is MJCF in turn: what is included, and what is to be attached, a model of its own."""


@dataclass(frozen=True)
class _Part:
    """One MJCF file of a room, and the folder of the model that it is part of."""

    path: Path
    model_folder: Path
    root: ElementTree.Element


def room_files(room: Path) -> dict[Path, bytes]:
    """The room's file and all that it reads, however deep, each with its content, in the order of their paths.

    MuJoCo takes a path from the model's folder or from that of the included file, with or without the compiler's meshdir,
    texturedir or assetdir, without its folders under strippath: each place at which there is a file counts. Files that are
    missing are left out; MuJoCo tells of them.

    Raises InputError for what is not plain, well-formed XML, for a file outside the room's folder, be it by '..', an
    absolute path, a folder of the compiler or a symbolic link, for one that comes back to itself, and for more than a room
    needs (`check_size`).
    """
    found: dict[Path, bytes] = {}
    parts: dict[tuple[Path, Path], _Part] = {}
    waiting: list[tuple[Path, Path, tuple[Path, ...]]] = [(room, room.parent, ())]
    while waiting:
        part, model_folder, through = waiting.pop()
        if part.resolve() in through:
            raise InputError(
                f"{room}: {part.name} is read by itself, through {' and '.join(each.name for each in through)}, and so "
                "without end; files that do not come back to themselves are expected"
            )
        if (part, model_folder) in parts:
            continue
        found[part] = part.read_bytes()
        parts[part, model_folder] = read = _Part(part, model_folder, _parsed(found[part], part, room))
        for element in _MJCF:
            for candidate in _places(read, element, room, ()):
                folder = model_folder if element == "include" else candidate.parent
                waiting.append((candidate, folder, (*through, part.resolve())))
    check_size((part.root for part in parts.values()), str(room))
    for part in parts.values():
        of_model = [each.root for each in parts.values() if each.model_folder == part.model_folder]
        for place in _places(part, None, room, of_model):
            found.setdefault(place, place.read_bytes())
    return {path: found[path] for path in sorted(found)}


def _parsed(content: bytes, path: Path, room: Path) -> ElementTree.Element:
    """The root of an MJCF file, read as MuJoCo reads it: UTF-8 without a document type of its own."""
    where = f"{room}" if path == room else f"{room}: {path.name}"
    try:
        text = content.decode("utf-8-sig")
        if "<!DOCTYPE" in text.upper():
            raise InputError(f"{where}: holds a <!DOCTYPE; MJCF without one is expected")
        return ElementTree.fromstring(text.encode())
    except UnicodeDecodeError as error:
        raise InputError(f"{where}: byte {error.start} is not UTF-8; an MJCF file in UTF-8 is expected") from error
    except ElementTree.ParseError as error:
        raise InputError(f"{where}: is not well-formed XML ({error}); a valid MJCF file is expected") from error


def _places(
    part: _Part, element: str | None, room: Path, of_model: tuple | list[ElementTree.Element]
) -> Iterator[Path]:
    """The files there are for what the elements of one name say, None: all that do not name MJCF."""
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
            yield from _inside(candidates, room, f"<{node.tag} {attribute}={value!r}>", part.path, folders)


def _joined(base: Path, folder: str, name: str) -> Path:
    """As MuJoCo joins them: backslashes are slashes, what is absolute stands alone."""
    place = base
    for step in (folder, name):
        step = step.replace("\\", "/")
        place = Path(step) if PureWindowsPath(step).drive else place / step
    return place


def _inside(candidates: list[Path], room: Path, said: str, part: Path, folders: list[str]) -> Iterator[Path]:
    """Those of the candidates at which there is a file; raises InputError where that, or all of them, is elsewhere."""
    home = room.parent.resolve()
    away = [not place.resolve().is_relative_to(home) for place in candidates]
    there = [place.is_file() for place in candidates]
    if all(away) or any(is_away and is_there for is_away, is_there in zip(away, there, strict=True)):
        where = f"{room}" if part == room else f"{room}: {part.name}"
        through = ", ".join(repr(folder) for folder in dict.fromkeys(folders) if folder)
        from_folder = f" (with the compiler's folder {through})" if through else ""
        raise InputError(
            f"{where}: {said}{from_folder} leads outside the room's folder; a path inside of it, relative, is expected"
        )
    return (place for place, is_there in zip(candidates, there, strict=True) if is_there)
