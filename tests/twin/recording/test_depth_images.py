"""Colour and depth travel as two messages of one stamp and come back as one observation, to the bit."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from decoded import decode
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from recorded import MS, a_scan, assert_same, write_ros2_bag
from rosbags.typesys.stores.ros2_humble import (
    sensor_msgs__msg__CompressedImage as CompressedImage,
    sensor_msgs__msg__Image as RawImage,
    std_msgs__msg__Header as Header,
)

from trackers.cameras import PinholeIntrinsics
from trackers.errors import InputError
from trackers.observations import DepthImage, Image, LaserScan
from trackers.rig import LaserSensor, PinholeSensor, Rig, StereoSensor
from twin.recording.bags.bag import open_bag
from twin.recording.reader import Recording
from twin.recording.ros.depth_images import DepthPairs, decode_depth, decode_rvl, match_images
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import COMPRESSED_IMAGE, RAW_IMAGE, encode, time_message
from twin.recording.writer import BagWriter

LENS = PinholeIntrinsics(width=48, height=32, fx=40, fy=41, cx=23.5, cy=15.5)
RIG = Rig(
    sensors={
        "waist": LaserSensor(topic="/waist/scan"),
        "deep": StereoSensor(topic="/deep/image/compressed", intrinsics=LENS, baseline_m=0.1, mode="matched"),
        "plain": PinholeSensor(
            topic="/plain/image/compressed",
            intrinsics=LENS.model_copy(update={"distortion": (-0.1, 0.02, 0.001, 0.002, 0.0)}),
        ),
    }
)


def a_depth_image(stamp_ns: int, sensor: str = "deep") -> DepthImage:
    rng = np.random.default_rng(abs(stamp_ns))
    depth_m = rng.uniform(0.3, 9.0, (32, 48)).astype(np.float32)
    depth_m[:4] = 0
    return DepthImage(sensor, stamp_ns, rng.integers(0, 255, (32, 48, 3), dtype=np.uint8), depth_m)


def decoded(encoded) -> DepthImage:
    (depth,), sensor = encoded.more, encoded.observation.sensor
    image = decode(encoded.data, COMPRESSED_IMAGE, sensor)
    depth_m = decode_depth(TYPESTORE.deserialize_cdr(depth.data, COMPRESSED_IMAGE), sensor)
    return DepthImage(sensor, image.stamp_ns, image.rgb, depth_m)


@given(arrays(np.float32, (4, 5), elements=st.just(0.0) | st.floats(0.03125, 65, width=32)))
def test_depth_is_handed_on_as_a_replay_gives_it(depth_m):
    image = DepthImage("deep", 5, np.zeros((4, 5, 3), dtype=np.uint8), depth_m)
    encoded = encode(image)
    assert_same(encoded.observation, decoded(encoded))
    assert isinstance(encoded.observation, DepthImage)
    assert np.abs(encoded.observation.depth_m - depth_m).max() <= 0.5e-3 + 1e-5
    again = encode(encoded.observation)
    np.testing.assert_array_equal(again.observation.depth_m, encoded.observation.depth_m)


def test_what_is_no_distance_becomes_a_hole():
    depth_m = np.array([[0.0, np.nan, np.inf, 0.0004, 1.0]], dtype=np.float32)
    encoded = encode(DepthImage("deep", 0, np.zeros((1, 5, 3), dtype=np.uint8), depth_m))
    assert encoded.observation.depth_m.tolist() == [[0, 0, 0, 0, 1]]


@pytest.mark.parametrize("depth_m", [-1.0, 66.0])
def test_depth_that_does_not_fit_is_a_fault_of_ours(depth_m):
    with pytest.raises(ValueError, match="fits"):
        encode(DepthImage("deep", 0, np.zeros((1, 1, 3), dtype=np.uint8), np.full((1, 1), depth_m, dtype=np.float32)))


def test_colour_and_depth_must_be_of_one_size():
    with pytest.raises(InputError, match="a depth for each pixel"):
        DepthImage("deep", 0, np.zeros((2, 3, 3), dtype=np.uint8), np.zeros((3, 2), dtype=np.float32))


def a_run() -> Iterator[tuple[DepthImage | LaserScan | Image, int]]:
    for stamp_ns in range(0, 1000 * MS, 100 * MS):
        yield a_scan(stamp_ns), stamp_ns
        yield a_depth_image(stamp_ns), stamp_ns
        yield Image("plain", stamp_ns, a_depth_image(stamp_ns + 1).rgb), stamp_ns + 20 * MS


@pytest.fixture(scope="module")
def twin_bag(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("depth") / "recording.mcap"
    with BagWriter(path, RIG) as writer:
        writer.background(encode(a_depth_image(3)))
        writer.background(encode(a_depth_image(4)))
        for observation, arrival_ns in a_run():
            writer.observation(encode(observation), arrival_ns)
    return path


def test_a_replay_is_the_run_to_the_bit(twin_bag):
    recording = Recording(twin_bag)
    live = [encode(observation).observation for observation, _ in a_run()]
    replayed = list(recording.observations())
    assert len(replayed) == len(live) == recording.observation_count
    for one, other in zip(live, replayed, strict=True):
        assert_same(one, other)
    for one, other in zip(recording.background, [a_depth_image(3), a_depth_image(4)], strict=True):
        assert_same(one, encode(other).observation)


def test_the_topics_and_the_lens_are_what_ros_expects(twin_bag):
    with open_bag(twin_bag) as bag:
        topics = bag.topics
        (_, _, info), *_ = bag.messages(["/plain/camera_info"])
        (_, stamp_ns, depth), *_ = bag.messages(["/deep/depth/compressed"])
    assert topics["/deep/depth/compressed"].msgtype == COMPRESSED_IMAGE
    assert topics["/deep/background/depth/compressed"].message_count == 2
    assert topics["/deep/camera_info"].message_count == 10
    assert (info.distortion_model, info.d.tolist()) == ("plumb_bob", [-0.1, 0.02, 0.001, 0.002, 0.0])
    assert info.k.reshape(3, 3)[0].tolist() == [40, 0, 23.5]
    assert (stamp_ns, depth.format) == (0, "16UC1; png compressed ")


HEADER = Header(time_message(7), "deep")


def test_what_robots_send_as_depth():
    millimetres = np.array([[65535, 1500, 65534]], dtype=np.uint16)  # the first: none, as many devices have it
    expected = np.array([[0, 1.5, 65.534]], dtype=np.float32)
    _, png = cv2.imencode(".png", millimetres)
    little = millimetres.astype("<u2").view(np.uint8).ravel()
    big = millimetres.astype(">u2").view(np.uint8).ravel()
    metres = np.array([[np.nan, 1.5, 65.534]], dtype="<f4").view(np.uint8).ravel()
    for message in (
        CompressedImage(HEADER, "16UC1; compressedDepth png", np.concatenate([np.zeros(12, np.uint8), png.ravel()])),
        CompressedImage(HEADER, "png", png.ravel()),
        RawImage(HEADER, 1, 3, "16UC1", 0, 8, np.pad(little, (0, 2))),
        RawImage(HEADER, 1, 3, "mono16", 1, 6, big),
        RawImage(HEADER, 1, 3, "32FC1", 0, 12, metres),
    ):
        got = decode_depth(message, "deep")
        assert got.dtype == np.float32
        np.testing.assert_array_equal(got, expected)


@pytest.mark.parametrize(
    ("message", "complaint"),
    [
        (RawImage(HEADER, 1, 3, "rgb8", 0, 9, np.zeros(9, np.uint8)), "'rgb8'; one of 16UC1, mono16, 32FC1"),
        (RawImage(HEADER, 2, 3, "16UC1", 0, 6, np.zeros(9, np.uint8)), "height x step bytes"),
        (CompressedImage(HEADER, "png", np.zeros(5, np.uint8)), "no picture; a 16-bit grey PNG"),
        (CompressedImage(HEADER, "png", cv2.imencode(".png", np.zeros((2, 2), np.uint8))[1].ravel()), "uint8"),
        (
            CompressedImage(HEADER, "32FC1; compressedDepth png", np.zeros(50, np.uint8)),
            "no picture; a 16-bit grey PNG",
        ),
        (
            CompressedImage(HEADER, "32FC1; compressedDepth png", np.zeros(5, np.uint8)),
            "a header of 12 bytes is expected",
        ),
        (CompressedImage(HEADER, "16UC1; compressedDepth rvl", np.zeros(15, np.uint8)), "columns, rows and RVL data"),
        (CompressedImage(HEADER, "16UC1; compressedDepth rvl", np.zeros(50, np.uint8)), "claims 0 x 0 pixels"),
        (RawImage(HEADER, 1, 2, "32FC1", 0, 8, np.array([1500, 2000], "<f4").view(np.uint8)), "metres .32FC1. or"),
        (RawImage(HEADER, 1, 2, "16UC1", 0, 4, np.array([2, 3], "<u2").view(np.uint8)), "metres .32FC1. or"),
    ],
)
def test_depth_that_cannot_be_used(message, complaint):
    with pytest.raises(InputError, match=complaint):
        decode_depth(message, "deep")


def rvl_of(pixels: np.ndarray) -> bytes:
    """Wilson's encoder, a pixel at a time: what the vectorized decoder is held against."""
    halves: list[int] = []

    def number(value: int) -> None:
        while True:
            value, group = value >> 3, value & 7
            halves.append(group | (8 if value else 0))
            if not value:
                return

    flat, place, before = pixels.ravel().astype(int).tolist(), 0, 0
    while place < len(flat):
        first = place
        while place < len(flat) and flat[place] == 0:
            place += 1
        number(place - first)
        first = place
        while place < len(flat) and flat[place] != 0:
            place += 1
        number(place - first)
        for value in flat[first:place]:
            difference, before = value - before, value
            number(2 * difference if difference >= 0 else -2 * difference - 1)
    halves += [0] * (-len(halves) % 8)
    words = [sum(half << (28 - 4 * k) for k, half in enumerate(halves[at : at + 8])) for at in range(0, len(halves), 8)]
    return struct.pack("<II", pixels.shape[1], pixels.shape[0]) + struct.pack(f"<{len(words)}I", *words)


def depth_pictures() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(8)
    noise = rng.integers(0, 65_535, (23, 31)).astype(np.uint16)
    wall = (1500 + 3 * np.arange(31) + rng.integers(-2, 3, (23, 31))).astype(np.uint16)
    return {
        "noise": noise,
        "a wall": wall,
        "a wall with holes": np.where(rng.random((23, 31)) < 0.3, 0, wall).astype(np.uint16),
        "all holes": np.zeros((23, 31), np.uint16),
        "a hole at each end": np.pad(wall, 2),
        "one pixel": np.full((1, 1), 700, np.uint16),
        "extremes": np.tile(np.array([65_534, 1, 65_534, 0], np.uint16), (3, 5)),
    }


DEPTHS = depth_pictures()


@pytest.mark.parametrize("pixels", DEPTHS.values(), ids=DEPTHS.keys())
def test_rvl_is_decoded(pixels):
    message = CompressedImage(HEADER, "16UC1; compressedDepth rvl", np.frombuffer(bytes(12) + rvl_of(pixels), np.uint8))
    np.testing.assert_array_equal(decode_depth(message, "deep"), pixels.astype(np.float32) / np.float32(1000))


def test_rvl_of_a_picture_by_hand():
    # two holes, three pixels 9, 10, 8: 2, 3, +9 -> 18 = 010 010, +1 -> 2, -2 -> 3; zeros fill the word
    np.testing.assert_array_equal(decode_rvl(struct.pack("<I", 0x23A22300), 1, 5), [[0, 0, 9, 10, 8]])


@pytest.mark.parametrize("ending", ["png", "rvl"])
def test_metres_that_were_quantized_are_metres(ending):
    depth_m = np.where(DEPTHS["a wall with holes"] > 0, DEPTHS["a wall with holes"] / 700.0, 0).astype(np.float32)
    scale, offset = 100.0 * 101.0, 1.0 - 100.0 * 101.0 / 10.0  # as image_transport: depth_max 10 m, quantization 100
    with np.errstate(divide="ignore"):
        values = np.where(depth_m > 0, np.rint(scale / depth_m + offset), 0).astype(np.uint16)
    data = rvl_of(values) if ending == "rvl" else cv2.imencode(".png", values)[1].tobytes()
    header = struct.pack("<iff", 0, scale, offset)
    message = CompressedImage(HEADER, f"32FC1; compressedDepth {ending}", np.frombuffer(header + data, np.uint8))
    np.testing.assert_allclose(decode_depth(message, "deep"), depth_m, rtol=0, atol=1e-3)


@pytest.mark.parametrize("cut", [1, 5, 100, -4])
def test_rvl_that_is_cut_is_refused(cut):
    data = rvl_of(DEPTHS["noise"])
    message = CompressedImage(
        HEADER, "16UC1; compressedDepth rvl", np.frombuffer(bytes(12) + data[: 8 + cut if cut > 0 else cut], np.uint8)
    )
    with pytest.raises(InputError, match="compressedDepth rvl': RVL data (end after|are damaged)"):
        decode_depth(message, "deep")


def test_rvl_that_is_damaged_is_refused_or_read_and_never_raises_anything_else():
    rng = np.random.default_rng(4)
    data = np.frombuffer(bytes(12) + rvl_of(DEPTHS["a wall with holes"]), np.uint8)
    refused = 0
    for _ in range(300):
        spoiled = data.copy()
        spoiled[20 + rng.integers(0, data.size - 20, 3)] = rng.integers(0, 256, 3)
        try:
            decode_depth(CompressedImage(HEADER, "16UC1; compressedDepth rvl", spoiled), "deep")
        except InputError:
            refused += 1
    assert refused > 30


def test_rvl_that_claims_too_many_pixels_is_not_decoded():
    data = np.frombuffer(bytes(12) + struct.pack("<II", 40_000, 40_000) + bytes(40), np.uint8)
    with pytest.raises(InputError, match=r"claims 40000 x 40000, 1.6e\+09 pixels; at most .*--no-limits"):
        decode_depth(CompressedImage(HEADER, "16UC1; compressedDepth rvl", data), "deep")


def test_pairs_find_each_other_late_early_and_across_gaps():
    late, early, apart = [1040 * MS], [997 * MS], [1300 * MS]
    colours = np.array([k * 100 * MS for k in range(10)] + late + [1100 * MS], np.int64)
    depths = np.array([k * 100 * MS + 20 * MS for k in range(8)] + early + apart, np.int64)
    assert match_images(colours, depths).tolist() == [*range(8), -1, -1, 8, -1]
    pairs, depth_m = DepthPairs(np.array([1, 0, -1, 2])), np.ones((32, 48), dtype=np.float32)
    picture = Image("deep", 7 * MS, a_depth_image(0).rgb)
    assert pairs.depth(0, depth_m) is None
    assert pairs.colour(0, picture) is None, "its depth is to come"
    joined = pairs.colour(1, picture)
    assert joined is not None
    assert joined.stamp_ns == 7 * MS
    assert pairs.colour(2, picture) is None, "has no depth"
    assert pairs.depth(1, depth_m) is not None
    assert pairs.paired == 2


@pytest.mark.parametrize("gap_ms", [20, 33, 100, 200, 1000])
@pytest.mark.parametrize("apart", [-0.4, 0.1, 0.45])
def test_pictures_stamped_apart_find_each_other_at_any_rate(gap_ms, apart):
    colours = np.arange(0, 40 * gap_ms, gap_ms) * MS
    depths = colours + round(apart * gap_ms * MS)
    lost = np.array([3, 4, 17])
    kept = np.delete(np.arange(40), lost)
    np.testing.assert_array_equal(match_images(colours, depths[kept])[kept], np.arange(37))
    assert (match_images(colours, depths[kept])[lost] == -1).all()


def test_a_robots_bag_of_raw_colour_and_depth(tmp_path):
    rgb = np.arange(32 * 48 * 3, dtype=np.uint32).astype(np.uint8)
    millimetres = np.full((32, 48), 2000, dtype="<u2").view(np.uint8).ravel()
    messages = []
    for k in range(3):
        stamp_ns = 1_700_000_000 * 10**9 + k * 100 * MS
        colour_header, depth_header = (Header(time_message(stamp_ns + late), "c") for late in (0, 4 * MS))
        depth = RawImage(depth_header, 32, 48, "16UC1", 0, 96, millimetres)
        messages.append(("/cam/depth", RAW_IMAGE, stamp_ns + 5 * MS, depth))
        messages.append(
            ("/cam/rgb", RAW_IMAGE, stamp_ns + 9 * MS, RawImage(colour_header, 32, 48, "rgb8", 0, 144, rgb))
        )
    write_ros2_bag(tmp_path / "bag", messages)
    rig = Rig(sensors={"cam": StereoSensor(topic="/cam/rgb", depth_topic="/cam/depth", intrinsics=LENS)})
    images = list(Recording(tmp_path / "bag", rig).observations())
    assert [image.stamp_ns for image in images] == [0, 100 * MS, 200 * MS]
    for image in images:
        assert isinstance(image, DepthImage)
        np.testing.assert_array_equal(image.depth_m, np.full((32, 48), 2.0, dtype=np.float32))


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"depth_topic": "/elsewhere"}, "depth_topic is '/elsewhere', which .* does not have"),
        ({"depth_topic": "/waist/scan"}, "depth_topic is '/waist/scan', which is sensor_msgs/msg/LaserScan"),
        ({"intrinsics": LENS.model_copy(update={"width": 50})}, "image is 48 x 32; sensors.deep.intrinsics"),
    ],
)
def test_a_rig_that_does_not_fit_the_bag(twin_bag, change, complaint):
    deep = RIG.sensors["deep"].model_copy(update=change)
    rig = Rig(sensors={"deep": deep})
    with pytest.raises(InputError, match=complaint):
        list(Recording(twin_bag, rig).observations())


def test_an_observation_keeps_its_arrays_when_another_is_stamped():
    image = encode(a_depth_image(0)).observation
    later = replace(image, stamp_ns=5)
    assert later.t == 5e-9
