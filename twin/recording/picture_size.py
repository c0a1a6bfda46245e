"""How many pixels an encoded picture claims, read from its header before anything of that size is made."""

from __future__ import annotations

import struct

from trackers.errors import InputError
from twin.limits import check_limit

MOST_PIXELS = 2**24
"""Of one picture, as `twin.scenario.size` has it of a sensor's."""

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
"""JPEG's markers of a frame's header (ITU-T T.81, table B.1)."""
_ALONE = {0x01, *range(0xD0, 0xD8)}
"""Markers without a length."""


def check_picture(data: bytes, said: str) -> None:
    """Raise InputError, opening with `said`, for no JPEG or PNG, and for more pixels than a picture has."""
    size = picture_size(data)
    if size is None:
        raise InputError(f"{said}: {len(data)} bytes that are no image; a JPEG or PNG is expected")
    check_size(*size, said)


def check_size(width: int, height: int, said: str) -> None:
    """Raise InputError, opening with `said`, for a picture without pixels, or with more than a picture has."""
    if not width or not height:
        raise InputError(f"{said}: its header claims {width} x {height} pixels; at least one is expected")
    check_limit(float(width) * height, MOST_PIXELS, f"{said}: its header claims {width} x {height},", "pixels")


def picture_size(data: bytes) -> tuple[int, int] | None:
    """Width and height that the header of a JPEG or PNG claims [px], the largest of several; None where there is none."""
    if data.startswith(_PNG) and len(data) >= 24:
        return struct.unpack(">II", data[16:24])
    if not data.startswith(_JPEG):
        return None
    found: list[tuple[int, int]] = []
    place = 2
    while (place := data.find(b"\xff", place)) >= 0 and place + 1 < len(data):
        marker = data[place + 1]
        if marker in _FRAMES and place + 9 <= len(data):
            height, width = struct.unpack(">HH", data[place + 5 : place + 9])
            found.append((width, height))
        if marker in (0x00, 0xFF, 0xD8, 0xD9) or marker in _ALONE or place + 4 > len(data):
            place += 1 if marker == 0xFF else 2
            continue
        place += 2 + struct.unpack(">H", data[place + 2 : place + 4])[0]
        if marker == 0xDA and found:  # pixels follow
            break
    return max(found, key=lambda each: each[0] * each[1], default=None)
