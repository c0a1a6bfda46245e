"""Depth pictures in messages: 16-bit PNG of millimetres, and what robots send instead."""

from __future__ import annotations

import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from twin.recording.picture_size import check_picture, check_size, picture_size
from twin.recording.rvl import decode_rvl

PNG_FORMAT = "16UC1; png compressed "
"""The format that image_transport writes into a CompressedImage of depth as PNG, its space at the end included."""

_MM_PER_M = np.float32(1000)
_MOST_MM = 65_534
"""The largest that 16 bits hold: many devices write 65535 for none."""
_FARTHEST_M = 100.0
"""No depth camera sees as far: what does is in another unit."""
_HEADER_BYTES = 12
"""compressed_depth_image_transport puts its configuration before the picture: an integer, and two floats that say how metres
(32FC1) were made 16 bits: depth = first / (value - second)."""

_RAW_ENCODINGS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}


def encode_png(depth_m: NDArray[np.float32]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Depth (height, width) [m], 0 or not finite for none, as the bytes of a PNG, and as whoever decodes them gets it.

    Raises ValueError for depth below 0 or beyond what 16 bits of millimetres hold.
    """
    millimetres = np.rint(np.where(np.isfinite(depth_m), depth_m, 0) * 1000.0)
    if millimetres.size and (millimetres.min() < 0 or millimetres.max() > _MOST_MM):
        raise ValueError(
            f"depth from {millimetres.min() / 1e3:g} to {millimetres.max() / 1e3:g} m; 0 to {_MOST_MM / 1e3:g} m fits"
        )
    pixels = millimetres.astype(np.uint16)
    # The lowest level: a fifth of the time of the default, for a tenth more bytes.
    _, png = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return png.ravel(), _metres(pixels)


def decode_depth(message: Any, sensor: str) -> NDArray[np.float32]:
    """The depth (height, width) [m] in a CompressedImage (PNG; `compressedDepth` as PNG or RVL) or a raw Image; 0: none.

    Raises InputError for a message that cannot be used.
    """
    if hasattr(message, "format"):
        return _from_compressed(message, sensor)
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
    depth_m = _metres(rows.view(kind))
    seen_m = depth_m[depth_m > 0]
    if seen_m.size and (middle_m := float(np.median(seen_m))) > _FARTHEST_M:
        raise InputError(
            f"depth of {sensor!r}: half of the depths are beyond {middle_m:g}; metres are expected in {message.encoding}"
        )
    return depth_m


def _from_compressed(message: Any, sensor: str) -> NDArray[np.float32]:
    data, said = np.asarray(message.data, dtype=np.uint8), f"depth of {sensor!r}: format is {message.format!r}"
    inverse = None
    if "compressedDepth" in message.format:
        if data.size < _HEADER_BYTES:
            raise InputError(f"{said}: {data.size} bytes; a header of {_HEADER_BYTES} bytes is expected")
        if "32FC1" in message.format:
            inverse = struct.unpack("<ff", bytes(data[4:_HEADER_BYTES]))
        data = data[_HEADER_BYTES:]
    pixels = _rvl(bytes(data), said) if message.format.endswith("rvl") else _png(data, said)
    if inverse is None:
        return _metres(pixels)
    scale, offset = inverse
    with np.errstate(divide="ignore", invalid="ignore"):
        return _metres(
            np.where(pixels > 0, np.float32(scale) / (pixels.astype(np.float32) - np.float32(offset)), np.float32(0))
        )


def _png(data: NDArray[np.uint8], said: str) -> NDArray[np.uint16]:
    if picture_size(bytes(data)) is not None:
        check_picture(bytes(data), said)
    pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    if pixels is None or pixels.dtype != np.uint16 or pixels.ndim != 2:
        what = "no picture" if pixels is None else f"a picture of {pixels.dtype} {pixels.shape}"
        raise InputError(f"{said}: {data.size} bytes that are {what}; a 16-bit grey PNG is expected")
    return np.asarray(pixels, dtype=np.uint16)


def _rvl(data: bytes, said: str) -> NDArray[np.uint16]:
    if len(data) < 8:
        raise InputError(f"{said}: {len(data)} bytes; columns, rows and RVL data are expected")
    columns, rows = struct.unpack("<II", data[:8])
    check_size(columns, rows, said)
    try:
        return decode_rvl(data[8:], rows, columns)
    except InputError as error:
        raise InputError(f"{said}: {error}") from error


def _metres(pixels: NDArray[Any]) -> NDArray[np.float32]:
    """Whole millimetres as metres, 65535 being none as 0 is; metres as they are, 0 for those that are none (REP 118)."""
    if pixels.dtype.kind == "f":
        depth_m = pixels.astype(np.float32)
        return np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, np.float32(0))
    return np.where(pixels > _MOST_MM, 0, pixels).astype(np.float32) / _MM_PER_M
