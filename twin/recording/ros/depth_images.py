"""Depth images in messages: 16-bit PNG of millimetres, what robots send instead, and their pairing with colour images.

RVL, as compressed_depth_image_transport writes it, is decoded here. Source: Wilson, Fast Lossless Depth Image Compression, ISS
2017. The image is a row of runs: the number of pixels that are 0, the number that are not, and for each of these the difference
to the one before. Numbers are cut into groups of three bits, the lowest first; a group and a bit that says that more follow
make four bits. Eight of these fill a word of 32 bits, the first highest.
"""

from __future__ import annotations

import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Index, Nanoseconds, Singles
from trackers.errors import InputError
from trackers.observations import NS_PER_S, DepthImage, Image
from twin.recording.ros.colour_images import check_picture, check_size, picture_size

PNG_FORMAT = "16UC1; png compressed "
"""Format that image_transport writes into a CompressedImage of depth as PNG, with its trailing space."""

_MM_PER_M = np.float32(1000)
_MOST_MM = 65_534
"""Greatest value in 16 bits: many devices write 65535 for no depth."""
_RANGE_M = (0.03, 100.0)
"""Depths of any camera; half of a picture beyond them says another unit."""
_HEADER_BYTES = 12
"""compressed_depth_image_transport puts its configuration before the picture: an integer, and two floats that say how metres
(32FC1) were made 16 bits: depth = first / (value - second)."""

_RAW_ENCODINGS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}


def encode_png(depth_m: NDArray[np.float32]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Encode depth (height, width) [m], 0 or not finite for none, as PNG bytes; return them and the depth they decode to.

    Raises ValueError for depth below 0 or beyond what 16 bits of millimetres hold.
    """
    millimetres = np.rint(np.where(np.isfinite(depth_m), depth_m, 0) * 1000.0)
    if millimetres.size and (millimetres.min() < 0 or millimetres.max() > _MOST_MM):
        raise ValueError(
            f"depth from {millimetres.min() / 1e3:g} to {millimetres.max() / 1e3:g} m; 0 to {_MOST_MM / 1e3:g} m fits"
        )
    pixels = millimetres.astype(np.uint16)
    # The lowest level: a fifth of the default's time, for a tenth more bytes.
    _, png = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return png.ravel(), _metres(pixels)


def decode_depth(message: Any, sensor: str) -> NDArray[np.float32]:
    """Decode depth (height, width) [m], 0 for none, of a CompressedImage (PNG, RVL) or a raw Image.

    Raises InputError for a message that cannot be used.
    """
    depth_m = _from_compressed(message, sensor) if hasattr(message, "format") else _from_raw(message, sensor)
    seen_m = depth_m[depth_m > 0]
    if seen_m.size and not _RANGE_M[0] <= (middle_m := float(np.median(seen_m))) <= _RANGE_M[1]:
        raise InputError(
            f"depth of {sensor!r}: the median depth is {middle_m:g} m; metres (32FC1) or millimetres (16 bits) are expected"
        )
    return depth_m


def _from_raw(message: Any, sensor: str) -> NDArray[np.float32]:
    if not hasattr(message, "encoding"):
        raise InputError(f"depth of {sensor!r}: type is {message.__msgtype__}; CompressedImage or Image is expected")
    if message.encoding not in _RAW_ENCODINGS:
        raise InputError(
            f"depth of {sensor!r}: encoding is {message.encoding!r}; one of {', '.join(_RAW_ENCODINGS)} is expected"
        )
    kind = np.dtype(_RAW_ENCODINGS[message.encoding]).newbyteorder(">" if message.is_bigendian else "<")
    row_bytes = message.width * kind.itemsize
    data = np.asarray(message.data, dtype=np.uint8)
    if message.step < row_bytes or data.size != message.height * message.step:
        raise InputError(
            f"depth of {sensor!r}: {data.size} bytes, step {message.step} for {message.width} x {message.height} "
            f"{message.encoding}; height x step bytes are expected"
        )
    rows = np.ascontiguousarray(data.reshape(message.height, message.step)[:, :row_bytes])
    return _metres(rows.view(kind))


def _from_compressed(message: Any, sensor: str) -> NDArray[np.float32]:
    data, subject = np.asarray(message.data, dtype=np.uint8), f"depth of {sensor!r}: format is {message.format!r}"
    inverse = None
    if "compressedDepth" in message.format:
        if data.size < _HEADER_BYTES:
            raise InputError(f"{subject}: {data.size} bytes; a header of {_HEADER_BYTES} bytes is expected")
        if "32FC1" in message.format:
            inverse = struct.unpack("<ff", bytes(data[4:_HEADER_BYTES]))
        data = data[_HEADER_BYTES:]
    pixels = _rvl(bytes(data), subject) if message.format.endswith("rvl") else _png(data, subject)
    if inverse is None:
        return _metres(pixels)
    scale, offset = inverse
    with np.errstate(divide="ignore", invalid="ignore"):
        return _metres(
            np.where(pixels > 0, np.float32(scale) / (pixels.astype(np.float32) - np.float32(offset)), np.float32(0))
        )


def _png(data: NDArray[np.uint8], subject: str) -> NDArray[np.uint16]:
    pixels = None
    if picture_size(bytes(data)) is not None:
        check_picture(bytes(data), subject)
        pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.dtype != np.uint16 or pixels.ndim != 2:
        what = "no picture" if pixels is None else f"a picture of {pixels.dtype} {pixels.shape}"
        raise InputError(f"{subject}: {data.size} bytes that are {what}; a 16-bit grey PNG is expected")
    return np.asarray(pixels, dtype=np.uint16)


def _rvl(data: bytes, subject: str) -> NDArray[np.uint16]:
    if len(data) < 8:
        raise InputError(f"{subject}: {len(data)} bytes; columns, rows and RVL data are expected")
    columns, rows = struct.unpack("<II", data[:8])
    check_size(columns, rows, subject)
    try:
        return decode_rvl(data[8:], rows, columns)
    except InputError as error:
        raise InputError(f"{subject}: {error}") from error


def _metres(pixels: NDArray[Any]) -> NDArray[np.float32]:
    """Convert whole millimetres (0 and 65535: none) or metres to metres, 0 for none (REP 118)."""
    if pixels.dtype.kind == "f":
        depth_m = pixels.astype(np.float32)
        return np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, np.float32(0))
    return np.where(pixels > _MOST_MM, 0, pixels).astype(np.float32) / _MM_PER_M


_MOST_GROUPS = 11
"""Greatest number of groups of a 32-bit number."""


def decode_rvl(data: bytes, rows: int, columns: int) -> NDArray[np.uint16]:
    """Return the picture (rows, columns) in RVL data; raises InputError for another number of pixels."""
    numbers = _numbers(data)
    zero, values = 0, np.zeros(rows * columns, dtype=np.int64)
    place = 0  # in the picture
    differences, held = [np.empty(0, np.int64)], [np.empty(0, np.intp)]
    while place < values.size:
        if zero + 1 >= numbers.size:
            raise InputError(f"RVL data end after {place} of {values.size} pixels")
        n_empty, n_held = int(numbers[zero]), int(numbers[zero + 1])
        first = place + n_empty
        place = first + n_held
        if place > values.size or zero + 2 + n_held > numbers.size or n_empty + n_held == 0:
            raise InputError(f"RVL data are damaged at pixel {min(first, values.size)} of {values.size}")
        held.append(np.arange(first, place))
        differences.append(numbers[zero + 2 : zero + 2 + n_held])
        zero += 2 + n_held
    zigzag = np.concatenate(differences)
    values[np.concatenate(held)] = np.cumsum((zigzag >> 1) ^ -(zigzag & 1))
    return values.astype(np.uint16).reshape(rows, columns)


def _numbers(data: bytes) -> NDArray[np.int64]:
    """Return all numbers in the data; those of the padding at the end are 0."""
    words = np.frombuffer(data[: len(data) // 4 * 4], dtype="<u4").astype(">u4").view(np.uint8)
    halves = np.stack([words >> 4, words & 15], axis=-1).ravel()
    last = np.flatnonzero(halves < 8)  # groups without a continuation
    halves = halves[: last[-1] + 1] if last.size else halves[:0]
    starts = np.concatenate([[0], last[:-1] + 1]) if last.size else np.empty(0, np.intp)
    place = np.arange(halves.size) - np.repeat(starts, np.diff(np.append(starts, halves.size)))
    if place.size and place.max() >= _MOST_GROUPS:
        raise InputError("RVL data are damaged: a number of more than 32 bits")
    groups = (halves & 7).astype(np.int64) << (3 * place)
    return np.add.reduceat(groups, starts) if starts.size else np.empty(0, np.int64)


_UNKNOWN_GAP_NS = round(NS_PER_S / 30)
"""For single pictures: the period of most devices."""
_HELD = 30


def tolerance_ns(colour_ns: Nanoseconds, depth_ns: Nanoseconds) -> int:
    """Return the largest gap between the stamps of a pair [ns]: half a period of the slower stream."""
    gaps = [np.diff(np.unique(each)) for each in (colour_ns, depth_ns)]
    usual = [float(np.median(each)) for each in gaps if each.size]
    return round((max(usual) if usual else _UNKNOWN_GAP_NS) / 2)


def match_images(colour_ns: Nanoseconds, depth_ns: Nanoseconds) -> Index:
    """Match each colour image with a depth image, by their stamps in any order; -1 for none.

    A pair is mutually nearest and within `tolerance_ns`. Many devices stamp the two differently.
    """
    found = np.full(colour_ns.size, -1, np.intp)
    if not colour_ns.size or not depth_ns.size:
        return found
    depth_of, colour_of = _nearest(colour_ns, depth_ns), _nearest(depth_ns, colour_ns)
    colours = np.arange(colour_ns.size)
    mutual = colour_of[depth_of] == colours
    near = np.abs(depth_ns[depth_of] - colour_ns) <= tolerance_ns(colour_ns, depth_ns)
    found[mutual & near] = depth_of[mutual & near]
    return found


def _nearest(of_ns: Nanoseconds, among_ns: Nanoseconds) -> Index:
    """Return the index of the nearest among the others for each stamp, the earlier of two as near."""
    order = np.argsort(among_ns, kind="stable")
    ordered = among_ns[order]
    right = (
        np.searchsorted(ordered, of_ns).clip(1, max(ordered.size - 1, 1))
        if ordered.size > 1
        else np.zeros(of_ns.size, np.intp)
    )
    left = np.maximum(right - 1, 0)
    right = np.minimum(right, ordered.size - 1)
    return order[np.where(of_ns - ordered[left] <= ordered[right] - of_ns, left, right)]


class DepthPairs:
    """Matcher of one sensor's colour and depth pictures in any order; the pair has its colour's stamp.

    A picture is dropped if its partner is not among the next 30 waiting ones.
    """

    def __init__(self, depth_of: Index) -> None:
        self._depth_of = depth_of
        self._colour_of = {int(depth): colour for colour, depth in enumerate(depth_of) if depth >= 0}
        self._colour: dict[int, Image] = {}
        self._depth: dict[int, Singles] = {}
        self.paired = 0

    def colour(self, number: int, image: Image) -> DepthImage | None:
        """Add the colour picture of this number; return the pair if its depth has arrived."""
        depth = int(self._depth_of[number])
        if depth < 0:
            return None
        if depth in self._depth:
            return self._pair(image, self._depth.pop(depth))
        self._colour[number] = image
        _hold_few(self._colour)
        return None

    def depth(self, number: int, depth_m: Singles) -> DepthImage | None:
        """Add the depth picture of this number, (height, width) [m]; return the pair if its colour has arrived."""
        colour = self._colour_of.get(number)
        if colour is None:
            return None
        if colour in self._colour:
            return self._pair(self._colour.pop(colour), depth_m)
        self._depth[number] = depth_m
        _hold_few(self._depth)
        return None

    def _pair(self, image: Image, depth_m: Singles) -> DepthImage:
        pair = DepthImage(image.sensor, image.stamp_ns, image.rgb, depth_m)
        self.paired += 1
        return pair


def _hold_few(held: dict[int, Any]) -> None:
    while len(held) > _HELD:
        del held[next(iter(held))]
