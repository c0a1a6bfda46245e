"""Colour images in messages: raw in the encodings of ROS, or compressed as JPEG, PNG, WebP and BMP.

The size claimed by an encoded image is checked in its header before an array of that size is made.
"""

from __future__ import annotations

import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from trackers.user_input.text_file import check_limit

_BAYER = {
    "bayer_rggb": cv2.COLOR_BayerRGGB2RGB,
    "bayer_bggr": cv2.COLOR_BayerBGGR2RGB,
    "bayer_gbrg": cv2.COLOR_BayerGBRG2RGB,
    "bayer_grbg": cv2.COLOR_BayerGRBG2RGB,
}
_YUV = {
    **dict.fromkeys(("yuv422", "uyvy"), cv2.COLOR_YUV2RGB_UYVY),
    **dict.fromkeys(("yuv422_yuy2", "yuyv"), cv2.COLOR_YUV2RGB_YUY2),
}
_PLANES = {"nv12": cv2.COLOR_YUV2RGB_NV12, "nv21": cv2.COLOR_YUV2RGB_NV21}
"""Brightness as in mono8, followed by half as many rows of colour, of every second pixel in both directions."""
CHANNELS = {
    **{"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "rgb16": 3, "bgr16": 3, "rgba16": 4, "bgra16": 4},
    **{"mono8": 1, "mono16": 1, "8UC1": 1, "8UC3": 3, "8UC4": 4, "16UC3": 3, "16UC4": 4},
    **{f"{pattern}{bits}": 1 for pattern in _BAYER for bits in (8, 16)},
    **dict.fromkeys(_YUV, 2),
    **dict.fromkeys(_PLANES, 1),
}
"""Supported encodings of raw pictures, and their channels; 8UC3 to 16UC4 are in OpenCV's order, blue first."""
_DEPTH = ("16UC1", "32FC1", "64FC1")
_BLUE_FIRST = ("bgr", "8UC", "16UC")


def decode_raw(message: Any, subject: str) -> NDArray[np.uint8]:
    """Return the picture (height, width, 3), RGB, in a raw Image; of 16 bits the upper eight are kept.

    Raises InputError, with the prefix `subject`, for an unsupported encoding and for inconsistent sizes.
    """
    encoding = message.encoding
    if encoding not in CHANNELS:
        what = f"{subject}: encoding is {encoding!r}"
        if encoding in _DEPTH:
            raise InputError(f"{what}, a depth picture; it belongs under depth_topic of a sensor of kind stereo")
        raise InputError(f"{what}; one of {', '.join(CHANNELS)} is expected")
    if encoding in _PLANES:
        if message.width % 2 or message.height % 2:
            raise InputError(
                f"{subject}: {message.width} x {message.height} in {encoding}; an even width and height is expected"
            )
        planes = raw_pixels(message, subject, message.height * 3 // 2)
        return _array(cv2.cvtColor(np.ascontiguousarray(planes), _PLANES[encoding]))
    pixels = raw_pixels(message, subject, message.height)
    if encoding in _YUV:
        if message.width % 2:
            raise InputError(f"{subject}: width {message.width} in {encoding}; an even width is expected")
        return _array(cv2.cvtColor(np.ascontiguousarray(pixels), _YUV[encoding]))
    if encoding.startswith("bayer_"):
        return _without_mosaic(np.ascontiguousarray(pixels[:, :, 0]), encoding)
    if encoding.startswith(_BLUE_FIRST):
        pixels = pixels[:, :, 2::-1]
    return np.ascontiguousarray(np.broadcast_to(pixels[:, :, :3], (message.height, message.width, 3)))


def raw_pixels(message: Any, subject: str, n_row: int) -> NDArray[np.uint8]:
    """Return the pixels (n_row, width, channels) of an Image without the padding of its rows, of 16 bits the upper eight.

    Raises InputError for another number of bytes.
    """
    channel_bytes = 2 if "16" in message.encoding else 1
    width_bytes = message.width * CHANNELS.get(message.encoding, 1) * channel_bytes
    if message.step < width_bytes or message.data.size != n_row * message.step or not message.data.size:
        raise InputError(
            f"{subject}: {message.data.size} bytes, step {message.step} for {message.width} x {message.height} "
            f"{message.encoding}; height x step bytes are expected"
        )
    rows = np.asarray(message.data).reshape(n_row, message.step)[:, :width_bytes]
    upper = 0 if message.is_bigendian else channel_bytes - 1
    return rows.reshape(n_row, message.width, -1)[:, :, upper::channel_bytes]


def decode_compressed(message: Any, subject: str) -> NDArray[np.uint8]:
    """Return the picture (height, width, 3), RGB, in a CompressedImage; raises as `decode_raw`.

    image_transport compresses the mosaic of a Bayer sensor as a grey picture and says so in `format`.
    """
    encoding = message.format.partition(";")[0].strip()
    if "compressedDepth" in message.format or encoding in _DEPTH:
        raise InputError(
            f"{subject}: format is {message.format!r}, a depth picture; a colour picture is expected, and depth under "
            "depth_topic of a sensor of kind stereo"
        )
    if encoding.rstrip("0123456789") in _BAYER:
        grey = _decoded(message, subject, cv2.IMREAD_UNCHANGED)
        if grey.ndim == 2:
            return _without_mosaic(_array(grey if grey.dtype == np.uint8 else grey >> 8), encoding)
    return _array(_decoded(message, subject, cv2.IMREAD_COLOR_RGB))


def _decoded(message: Any, subject: str, flags: int) -> Any:
    """Return a compressed picture as OpenCV reads it with these flags; raises InputError for formats without `picture_size`."""
    check_picture(bytes(message.data), f"{subject}: format is {message.format!r}")
    # The lens is calibrated on the sensor's rows and columns: an EXIF orientation must not turn them.
    pixels = cv2.imdecode(message.data, flags if flags < 0 else flags | cv2.IMREAD_IGNORE_ORIENTATION)
    if pixels is None:
        raise InputError(
            f"{subject}: {len(message.data)} bytes of a picture that is cut or damaged; a whole one is expected"
        )
    return pixels


def _without_mosaic(mosaic: NDArray[np.uint8], encoding: str) -> NDArray[np.uint8]:
    return _array(cv2.cvtColor(mosaic, _BAYER[encoding.rstrip("0123456789")]))


def _array(pixels: Any) -> NDArray[np.uint8]:
    return np.asarray(pixels, dtype=np.uint8)


MOST_PIXELS = 2**24
"""Greatest number of pixels of one picture, as in `twin.scenario.run_size`."""

FORMATS = "JPEG, PNG, WebP or BMP"
"""Formats of compressed pictures that are read."""

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
"""JPEG's markers of a frame's header (ITU-T T.81, table B.1)."""
_ALONE = {0x01, *range(0xD0, 0xD8)}
"""Markers without a length."""


def check_picture(data: bytes, subject: str) -> None:
    """Raise InputError, with the prefix `subject`, for a format without `picture_size`, and for too many pixels."""
    size = picture_size(data)
    if size is None:
        raise InputError(f"{subject}: {len(data)} bytes that are no image; a {FORMATS} is expected")
    check_size(*size, subject)


def check_size(width: int, height: int, subject: str) -> None:
    """Raise InputError, with the prefix `subject`, for a picture without pixels, or with too many."""
    if not width or not height:
        raise InputError(f"{subject}: its header claims {width} x {height} pixels; at least one is expected")
    check_limit(float(width) * height, MOST_PIXELS, f"{subject}: its header claims {width} x {height},", "pixels")


def picture_size(data: bytes) -> tuple[int, int] | None:
    """Return width and height in the header of a JPEG, PNG, WebP or BMP [px], the largest of several; None without any."""
    if data.startswith(_PNG) and len(data) >= 24:
        return struct.unpack(">II", data[16:24])
    if data.startswith(b"BM") and len(data) >= 26:
        return _bmp_size(data)
    if data.startswith(b"RIFF") and data[8:12] == b"WEBP" and len(data) >= 30:
        return _webp_size(data)
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


def _bmp_size(data: bytes) -> tuple[int, int]:
    """Return the size in the header of a BMP, of two bytes each in the oldest; a negative height says rows from the top."""
    if struct.unpack("<I", data[14:18]) == (12,):
        return struct.unpack("<HH", data[18:22])
    width, height = struct.unpack("<ii", data[18:26])
    return abs(width), abs(height)


def _webp_size(data: bytes) -> tuple[int, int] | None:
    """Return the size in the first chunk of a WebP (RFC 9649): extended, lossless or lossy."""
    match data[12:16]:
        case b"VP8X":
            return 1 + int.from_bytes(data[24:27], "little"), 1 + int.from_bytes(data[27:30], "little")
        case b"VP8L":
            bits = int.from_bytes(data[21:25], "little")
            return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
        case b"VP8 ":
            width, height = struct.unpack("<HH", data[26:30])
            return width & 0x3FFF, height & 0x3FFF
        case _:
            return None
