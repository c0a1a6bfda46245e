"""Observations survive their messages to the bit, and what cannot be used is refused."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from decoded import decode
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from recorded import a_scan, an_image, assert_same
from rosbags.typesys.stores.ros2_humble import (
    sensor_msgs__msg__CompressedImage as CompressedImage,
    sensor_msgs__msg__Image as RawImage,
    std_msgs__msg__Header as Header,
)

from trackers.errors import InputError
from trackers.observations import MOST_BEAMS, Image, LaserScan
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import LASER_SCAN, encode, from_message, time_message

HEADER = Header(time_message(7), "camera")

finite = st.floats(-10, 10)
scans = st.builds(
    LaserScan,
    sensor=st.sampled_from(["waist", "knee"]),
    stamp_ns=st.integers(-(10**9), 2**31 * 10**9 - 1),
    ranges_m=arrays(np.float32, st.integers(2, 40), elements=st.floats(width=32)),
    angle_min_rad=finite,
    angle_increment_rad=st.floats(1e-6, 0.15) | st.floats(-0.15, -1e-6),
    range_min_m=st.floats(0, 1),
    range_max_m=st.floats(2, 100),
    sweep_time_s=st.floats(0, 1),
)


@given(scans)
def test_a_scan_is_handed_on_as_a_replay_gives_it(scan):
    encoded = encode(scan)
    assert_same(encoded.observation, decode(encoded.data, encoded.msgtype, scan.sensor))
    again = encode(encoded.observation)
    assert_same(again.observation, encoded.observation)
    assert bytes(again.data) == bytes(encoded.data)


@given(scans)
def test_a_scan_loses_float32_and_nothing_else(scan):
    got = encode(scan).observation
    assert (got.sensor, got.stamp_ns) == (scan.sensor, scan.stamp_ns)
    for name in ("angle_min_rad", "angle_increment_rad", "range_min_m", "range_max_m"):
        assert getattr(got, name) == float(np.float32(getattr(scan, name)))
    assert got.sweep_time_s == pytest.approx(scan.sweep_time_s, rel=1e-6, abs=1e-40)
    inside = (scan.ranges_m >= got.range_min_m) & (scan.ranges_m < got.range_max_m) & (scan.ranges_m > 0)
    np.testing.assert_array_equal(got.ranges_m[inside], scan.ranges_m[inside])
    assert not np.isfinite(got.ranges_m[~inside]).any()


def test_ranges_follow_rep_117():
    ranges = np.array([0.0, 0.01, 0.02, 5.5, 5.6, 9.0, -1.0, np.inf, -np.inf, np.nan], dtype=np.float32)
    scan = replace(a_scan(0), ranges_m=ranges, range_min_m=float(ranges[2]), range_max_m=float(ranges[4]))
    nan, inf = np.nan, np.inf
    expected = np.array([nan, nan, ranges[2], ranges[3], inf, inf, nan, inf, nan, nan], dtype=np.float32)
    np.testing.assert_array_equal(encode(scan).observation.ranges_m, expected)
    assert ranges[0] == 0.0, "the scan that went in is not changed"


def test_zero_is_no_range_though_range_min_is_zero():
    scan = replace(a_scan(0), ranges_m=np.zeros(3, dtype=np.float32), range_min_m=0.0)
    assert np.isnan(encode(scan).observation.ranges_m).all()


def test_the_scan_message_as_ros_reads_it():
    message = TYPESTORE.deserialize_cdr(encode(a_scan(3_000_000_005)).data, LASER_SCAN)
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (3, 5, "waist")
    assert message.angle_max == pytest.approx(np.pi / 2, abs=1e-6)
    assert message.time_increment == pytest.approx(0.025 / 30)


@pytest.mark.parametrize("size", [0, 1])
def test_scans_without_a_sweep(size):
    scan = replace(a_scan(0), ranges_m=np.ones(size, dtype=np.float32), sweep_time_s=0.0)
    encoded = encode(scan)
    assert_same(encoded.observation, decode(encoded.data, encoded.msgtype, "waist"))
    with pytest.raises(ValueError, match="to sweep"):
        encode(replace(scan, sweep_time_s=0.1))


def test_an_image_is_handed_on_as_a_replay_gives_it():
    encoded = encode(an_image(40))
    assert_same(encoded.observation, decode(encoded.data, encoded.msgtype, "camera"))
    difference = np.abs(encoded.observation.rgb.astype(int) - an_image(40).rgb)
    assert difference[:16].mean() < 2, "red, green and blue in their order"
    assert difference.max() > 0, "the JPEG's loss is in what is handed on"


def test_jpeg_quality_counts():
    assert len(encode(an_image(0), jpeg_quality=20).data) < len(encode(an_image(0), jpeg_quality=95).data)


def test_encode_refuses_what_is_no_colour_image():
    with pytest.raises(ValueError, match="uint8"):
        encode(Image("camera", 0, np.zeros((4, 4, 3))))  # type: ignore[arg-type]


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "mono8"])
def test_raw_images_with_padded_rows(encoding):
    rgb = an_image(0).rgb
    pixels = {"rgb8": rgb, "bgr8": rgb[..., ::-1], "mono8": rgb[..., :1]}[encoding]
    rows = np.pad(pixels.reshape(32, -1), ((0, 0), (0, 5)))
    message = RawImage(HEADER, 32, 48, encoding, 0, rows.shape[1], rows.ravel())
    expected = np.repeat(rgb[..., :1], 3, axis=2) if encoding == "mono8" else rgb
    got = from_message(message, "camera", offset_ns=-2)
    assert isinstance(got, Image)
    assert got.stamp_ns == 5
    np.testing.assert_array_equal(got.rgb, expected)


def test_a_lossless_png_comes_through():
    _, png = cv2.imencode(".png", cv2.cvtColor(an_image(0).rgb, cv2.COLOR_RGB2BGR))
    got = from_message(CompressedImage(HEADER, "png", png.ravel()), "camera")
    assert isinstance(got, Image)
    np.testing.assert_array_equal(got.rgb, an_image(0).rgb)


def cut_picture(ending: str, share: float) -> CompressedImage:
    data = cv2.imencode(ending, np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8))[1].ravel()
    return CompressedImage(HEADER, ending[1:], data[: round(share * data.size)])


@pytest.mark.parametrize(
    ("message", "complaint"),
    [
        (RawImage(HEADER, 2, 2, "nv24", 0, 4, np.zeros(8, np.uint8)), "'nv24'; one of rgb8, bgr8, rgba8"),
        (RawImage(HEADER, 2, 2, "rgb8", 0, 6, np.zeros(8, np.uint8)), "height x step bytes"),
        (RawImage(HEADER, 2, 2, "rgb8", 0, 4, np.zeros(8, np.uint8)), "height x step bytes"),
        (CompressedImage(HEADER, "jpeg", np.zeros(0, np.uint8)), "JPEG, PNG, WebP or BMP is expected"),
        (CompressedImage(HEADER, "jpeg", np.arange(90, dtype=np.uint8)), "JPEG, PNG, WebP or BMP is expected"),
        (cut_picture(".jpg", 0.5), "bytes of a picture that is cut or damaged; a whole one"),
        (cut_picture(".png", 0.7), "bytes of a picture that is cut or damaged; a whole one"),
        (CompressedImage(HEADER, "16UC1; compressedDepth png", np.zeros(9, np.uint8)), "compressedDepth"),
    ],
)
def test_images_that_cannot_be_used(message, complaint):
    with pytest.raises(InputError, match=complaint):
        from_message(message, "camera")


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"angle_increment": 0.0}, "angle_increment is 0 rad.*other than 0"),
        ({"angle_increment": np.nan}, "angle_increment is nan rad"),
        ({"angle_min": np.inf}, "angle_min is inf rad"),
        ({"angle_min": np.nan}, "angle_min is nan rad"),
        ({"ranges": np.zeros(2 * MOST_BEAMS, np.float32)}, "has 2e\\+06 beams; at most 1e\\+06"),
        ({"range_min": np.nan}, "range_min is nan m"),
        ({"range_max": np.nan}, "range_max nan m"),
        ({"time_increment": np.inf}, "finite time_increment"),
    ],
)
def test_a_scan_whose_beams_are_nowhere_is_refused_in_one_sentence(changes, complaint):
    message: Any = TYPESTORE.deserialize_cdr(encode(a_scan(0)).data, LASER_SCAN)
    with pytest.raises(InputError, match=complaint) as caught:
        from_message(replace(message, **changes), "waist")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("range_max", [1e6, np.inf])
def test_a_scanner_that_names_no_limit_is_read(range_max):
    message: Any = TYPESTORE.deserialize_cdr(encode(a_scan(0)).data, LASER_SCAN)
    scan = from_message(replace(message, range_max=range_max), "waist")
    assert isinstance(scan, LaserScan)
    np.testing.assert_array_equal(scan.ranges_m, a_scan(0).ranges_m)


def test_a_scan_without_a_range_of_ranges_is_refused():
    with pytest.raises(InputError, match="range_max 0 m"):
        encode(replace(a_scan(0), range_min_m=0.0, range_max_m=0.0))


@pytest.mark.parametrize("ending", [".jpg", ".png", ".bmp", ".webp"])
def test_a_picture_that_claims_more_pixels_than_a_picture_has_is_not_decoded(
    ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from twin.recording.ros.colour_images import picture_size

    data = cv2.imencode(ending, np.zeros((7, 9, 3), np.uint8))[1].ravel()
    assert picture_size(bytes(data)) == (9, 7)
    claimed = bytes(data).replace(b"\x00\x07\x00\x09", b"\x4e\x20\x4e\x20", 1)
    if ending == ".png":
        claimed = bytes(data).replace(b"\x00\x00\x00\x09\x00\x00\x00\x07", b"\x00\x00\x4e\x20\x00\x00\x4e\x20", 1)
    if ending == ".bmp":
        claimed = bytes(data).replace(struct.pack("<ii", 9, 7), struct.pack("<ii", 20000, 20000), 1)
    if ending == ".webp":  # the extended form, whose canvas has up to 2 ** 24 pixels a side
        size = (19_999).to_bytes(3, "little") * 2
        claimed = b"RIFF" + struct.pack("<I", 1000) + b"WEBPVP8X" + struct.pack("<II", 10, 0) + size + bytes(data)[12:]
    monkeypatch.setattr(cv2, "imdecode", lambda *arguments: pytest.fail("was decoded"))
    with pytest.raises(InputError, match=r"its header claims 20000 x 20000, 4e\+08 pixels; at most .*--no-limits"):
        from_message(compressed(np.frombuffer(claimed, np.uint8)), "fisheye")


@pytest.mark.parametrize(
    ("ending", "flags", "most_off"),
    [(".bmp", (), 0), (".webp", (cv2.IMWRITE_WEBP_QUALITY, 101), 0), (".webp", (cv2.IMWRITE_WEBP_QUALITY, 99), 6)],
)
def test_every_compression_that_is_read_has_its_size_in_the_header(ending, flags, most_off) -> None:
    from twin.recording.ros.colour_images import picture_size

    rgb = np.add.outer(np.arange(12), np.arange(18))[..., None].astype(np.uint8) * np.array([3, 5, 2], np.uint8)
    data = cv2.imencode(ending, rgb[..., ::-1], flags)[1].ravel()
    assert picture_size(bytes(data)) == (18, 12)
    got = from_message(compressed(data, ending[1:]), "camera")
    assert isinstance(got, Image)
    assert np.abs(got.rgb.astype(int) - rgb).max() <= most_off


def test_a_bmp_of_the_oldest_header_and_one_from_the_top_have_their_sizes() -> None:
    from twin.recording.ros.colour_images import picture_size

    oldest = b"BM" + bytes(12) + struct.pack("<IHHHH", 12, 640, 480, 1, 24) + bytes(40)
    from_top = b"BM" + bytes(12) + struct.pack("<Iii", 40, 640, -480) + bytes(40)
    assert [picture_size(each) for each in (oldest, from_top)] == [(640, 480)] * 2


def compressed(data: np.ndarray, told: str = "jpeg") -> CompressedImage:
    return CompressedImage(HEADER, told, data)


RGB = np.random.default_rng(3).integers(0, 256, (6, 8, 3), dtype=np.uint8)
ALPHA = np.full((6, 8, 1), 7, dtype=np.uint8)
EXACT = {
    "rgba8": np.concatenate([RGB, ALPHA], axis=2),
    "bgra8": np.concatenate([RGB[..., ::-1], ALPHA], axis=2),
    "8UC3": RGB[..., ::-1],
    "8UC4": np.concatenate([RGB[..., ::-1], ALPHA], axis=2),
    "rgb16": RGB.astype(np.uint16) * 256 + 11,
    "bgr16": RGB[..., ::-1].astype(np.uint16) * 256 + 11,
    "mono16": RGB[..., 0].astype(np.uint16) * 256 + 11,
    "rgba16": np.concatenate([RGB, ALPHA], axis=2).astype(np.uint16) * 256 + 11,
    "bgra16": np.concatenate([RGB[..., ::-1], ALPHA], axis=2).astype(np.uint16) * 256 + 11,
    "16UC3": RGB[..., ::-1].astype(np.uint16) * 256 + 11,
    "16UC4": np.concatenate([RGB[..., ::-1], ALPHA], axis=2).astype(np.uint16) * 256 + 11,
    "rgb8": RGB,
    "bgr8": RGB[..., ::-1],
    "mono8": RGB[..., 0],
    "8UC1": RGB[..., 0],
}


@pytest.mark.parametrize("big", [0, 1])
@pytest.mark.parametrize("encoding", EXACT)
def test_other_encodings_of_the_same_picture_are_the_same_picture(encoding, big):
    pixels = EXACT[encoding]
    raw = pixels.astype(pixels.dtype.newbyteorder(">" if big else "<"))
    rows = np.pad(np.frombuffer(raw.tobytes(), np.uint8).reshape(6, -1), ((0, 0), (0, 5)))
    expected = RGB if pixels.ndim == 3 else np.repeat(RGB[..., :1], 3, axis=2)
    message = RawImage(HEADER, 6, 8, encoding, big, rows.shape[1], rows.ravel())
    np.testing.assert_array_equal(from_message(message, "c").rgb, expected)


def smooth(rows: int, columns: int) -> np.ndarray:
    """A picture whose colours change slowly, so that what mosaics and subsampled colours leave out is nearly nothing."""
    y, x = np.mgrid[:rows, :columns]
    return np.stack([60 + 2 * x, 200 - 2 * y, 90 + x + y], axis=-1).astype(np.uint8)


def mosaic_of(rgb: np.ndarray, pattern: str) -> np.ndarray:
    mosaic = np.zeros(rgb.shape[:2], np.uint8)
    for site, letter in enumerate(pattern):
        mosaic[site // 2 :: 2, site % 2 :: 2] = rgb[site // 2 :: 2, site % 2 :: 2, "rgb".index(letter)]
    return mosaic


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("big", [0, 1])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_a_bayer_mosaic_is_the_picture_behind_it(pattern, big, bits):
    rgb = smooth(40, 48)
    mosaic = mosaic_of(rgb, pattern)
    if bits == 16:
        mosaic = (mosaic.astype(np.uint16) * 256 + 200).astype(">u2" if big else "<u2")
    raw = np.frombuffer(mosaic.tobytes(), np.uint8)
    found = from_message(RawImage(HEADER, 40, 48, f"bayer_{pattern}{bits}", big, 48 * bits // 8, raw), "c").rgb
    assert np.abs(found.astype(int) - rgb)[2:-2, 2:-2].max() <= 3


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_a_mosaic_that_was_compressed_as_a_grey_picture_is_the_picture_behind_it(pattern, bits):
    rgb = smooth(40, 48)
    mosaic = mosaic_of(rgb, pattern)
    grey = mosaic if bits == 8 else mosaic.astype(np.uint16) * 256 + 200
    message = compressed(cv2.imencode(".png", grey)[1].ravel(), f"bayer_{pattern}{bits}; png compressed ")
    assert np.abs(from_message(message, "c").rgb.astype(int) - rgb)[2:-2, 2:-2].max() <= 3
    colour = cv2.imencode(".png", rgb[..., ::-1])[1].ravel()
    for told in (f"bayer_{pattern}{bits}; png compressed bgr8", "bgr8; png compressed bgr8", "png", ""):
        np.testing.assert_array_equal(from_message(compressed(colour, told), "c").rgb, rgb)


YUV = {
    "yuv422": "uyvy",
    "uyvy": "uyvy",
    "yuv422_yuy2": "yuyv",
    "yuyv": "yuyv",
}


def video_levels(rgb: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Brightness and the two colour differences of ITU-R BT.601, brightness from 16 to 235."""
    r, g, b = np.moveaxis(rgb.astype(float), -1, 0)
    y = 16 + (65.481 * r + 128.553 * g + 24.966 * b) / 255
    u = 128 + (-37.797 * r - 74.203 * g + 112 * b) / 255
    v = 128 + (112 * r - 93.786 * g - 18.214 * b) / 255
    return tuple(np.rint(each).astype(np.uint8) for each in (y, u, v))  # pyright: ignore[reportReturnType]


@pytest.mark.parametrize("encoding", YUV)
def test_yuv_is_read_in_its_order(encoding):
    rgb = smooth(40, 48)
    y, u, v = video_levels(rgb)
    parts = {"u": u[:, ::2], "v": v[:, ::2]}
    brightness = iter([y[:, ::2], y[:, 1::2]])
    data = np.stack([parts[each] if each in parts else next(brightness) for each in YUV[encoding]], axis=-1)
    found = from_message(RawImage(HEADER, 40, 48, encoding, 0, 96, data.ravel()), "c").rgb
    assert np.abs(found.astype(int) - rgb).max() <= 5
    with pytest.raises(InputError, match="even width"):
        from_message(RawImage(HEADER, 1, 3, encoding, 0, 6, np.zeros(6, np.uint8)), "c")


@pytest.mark.parametrize("encoding", ["nv12", "nv21"])
def test_planes_of_yuv_are_read_in_their_order(encoding):
    rgb = smooth(40, 48)
    y, u, v = video_levels(rgb)
    pair = [u, v] if encoding == "nv12" else [v, u]
    colour = np.stack([each[::2, ::2] for each in pair], axis=-1).reshape(20, 48)
    data = np.pad(np.concatenate([y, colour]), ((0, 0), (0, 6)))
    found = from_message(RawImage(HEADER, 40, 48, encoding, 0, 54, data.ravel()), "c").rgb
    assert np.abs(found.astype(int) - rgb).max() <= 6
    with pytest.raises(InputError, match="even width and height"):
        from_message(RawImage(HEADER, 3, 4, encoding, 0, 4, np.zeros(18, np.uint8)), "c")


@pytest.mark.parametrize(
    "encoding",
    ["16UC1", "32FC1", "64FC1", "16SC1", "8SC1", "32SC1", "8UC2", "nv24", "bayer_rggb12", "RGB8", "", "h264", "32FC3"],
)
def test_other_encodings_are_refused_by_name(encoding):
    with pytest.raises(InputError, match=rf"image of 'c': encoding is '{encoding}'[,;] .*(depth_topic|is expected)"):
        from_message(RawImage(HEADER, 4, 6, encoding, 0, 48, np.zeros(192, np.uint8)), "c")


@pytest.mark.parametrize("told", ["16UC1; png compressed ", "32FC1; compressedDepth png", "16UC1; compressedDepth rvl"])
def test_compressed_depth_is_no_colour_picture(told):
    data = cv2.imencode(".png", np.full((4, 6), 1500, np.uint16))[1].ravel()
    with pytest.raises(InputError, match=rf"image of 'c': format is '{told}', a depth picture; .* depth_topic"):
        from_message(compressed(data, told), "c")


@pytest.mark.parametrize("told", ["h264", "gif", "rgb8; tiff compressed "])
def test_other_compressions_are_refused_by_name(told):
    with pytest.raises(
        InputError, match=f"format is '{told}': 9 bytes that are no image; a JPEG, PNG, WebP or BMP is expected"
    ):
        from_message(compressed(np.arange(9, dtype=np.uint8), told), "c")
