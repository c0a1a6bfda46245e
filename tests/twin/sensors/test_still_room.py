"""The still part of a picture is drawn once: every pixel, depth and number stays that of the whole drawn at once."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np
import pytest
from capsule_room import ROOM, CapsuleWorld, capsule_model
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from twin.scenario import load_scenario
from twin.sensors.render import OffscreenRenderer
from twin.sensors.render_scene import Mark, RenderView
from twin.sensors.still_room import covered_rectangle
from twin.world.world import World

WIDTH, HEIGHT = 96, 72
TILT_RAD = 0.35


def views() -> tuple[RenderView, ...]:
    """Views to four sides, looking down a little, one above the other in the buffer."""
    found = []
    for place in range(4):
        turn = place * np.pi / 2
        ahead, down = np.array([np.cos(turn), np.sin(turn), 0.0]), np.array([0.0, 0.0, -1.0])
        forward = np.cos(TILT_RAD) * ahead + np.sin(TILT_RAD) * down
        up = np.sin(TILT_RAD) * ahead - np.cos(TILT_RAD) * down
        viewport = (0, place * HEIGHT, WIDTH, HEIGHT)
        found.append(RenderView(tuple(forward.tolist()), tuple(up.tolist()), -1.1, 0.9, -0.8, 0.7, viewport))
    return tuple(found)


def take(renderer: OffscreenRenderer, data: mujoco.MjData, eye_m: NDArray[np.float64]) -> list[NDArray]:
    """Colours, depth and the geoms of a picture."""
    colours, numbers = (np.zeros((4 * HEIGHT, WIDTH, 4), dtype=np.uint8) for _ in range(2))
    depth = np.zeros((4 * HEIGHT, WIDTH), dtype=np.float32)
    geoms = renderer.render(data, eye_m, views(), colours, depth=depth, numbers=numbers)
    return [colours, depth, geoms[numbers[..., 0] + 256 * numbers[..., 1].astype(int)]]


def assert_same(kept: list[NDArray], whole: list[NDArray]) -> None:
    for ours, theirs in zip(kept, whole, strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(
    ("name", "eye_m"),
    [
        ("lab-five-people", (0.0, 1.2, 1.5)),
        ("library-hall-busy", (0.0, 0.0, 2.5)),
        ("home-cameras", (0.2, 0.0, 1.8)),
        ("drawn", (0.0, 0.0, 1.9)),
    ],
)
def test_no_pixel_differs_from_the_whole(name: str, eye_m: tuple[float, float, float]):
    world, eye = World(load_scenario(name)), np.array(eye_m)
    model = world.snapshot(0.0).model
    with OffscreenRenderer(model) as keeping, OffscreenRenderer(model, keep_still=False) as drawing_all:
        for t in (0.0, 0.2, 0.4):
            snapshot = world.snapshot(t)
            assert snapshot.model is model
            assert_same(take(keeping, snapshot.data, eye), take(drawing_all, snapshot.data, eye))
        assert keeping.pictures["all"] == 6  # colours with depth, and numbers
        assert keeping.pictures["first of a camera and its light"] == 2


@pytest.fixture(scope="module")
def world() -> CapsuleWorld:
    return CapsuleWorld(capsule_model())


@pytest.fixture(scope="module")
def keeping(world: CapsuleWorld) -> Iterator[OffscreenRenderer]:
    with OffscreenRenderer(world.model) as renderer:
        yield renderer


def test_light_that_changes_is_seen(world: CapsuleWorld, keeping: OffscreenRenderer):
    eye = np.array([0.0, 0.2, 1.0])
    before = [take(keeping, world.snapshot(0.0).data, eye) for _ in range(3)]
    world.model.light_diffuse[0] *= 0.5
    try:
        after = take(keeping, world.snapshot(0.0).data, eye)
        with OffscreenRenderer(world.model, keep_still=False) as drawing_all:
            assert_same(after, take(drawing_all, world.snapshot(0.0).data, eye))
    finally:
        world.model.light_diffuse[0] *= 2
    assert before[-1][0].sum(dtype=int) > after[0].sum(dtype=int)


@pytest.mark.parametrize(
    ("room", "options", "reason"),
    [
        (ROOM.replace("0.8 0.3 0.3 1", "0.8 0.3 0.3 0.4"), {}, "transparent things in sight"),
        (ROOM.replace('shadowsize="0"', 'shadowsize="256"'), {"shadows": True}, "shadows"),
        (ROOM, {"samples": 4}, "multisampling"),
        (ROOM, {"keep_still": False}, "as asked for"),
    ],
)
def test_a_picture_that_cannot_be_laid_over_is_drawn_whole(room: str, options: dict, reason: str):
    world = CapsuleWorld(capsule_model(room=room))
    out = np.zeros((4 * HEIGHT, WIDTH, 4), dtype=np.uint8)
    with OffscreenRenderer(world.model, **options) as renderer:
        for _ in range(3):
            renderer.render(world.snapshot(0.0).data, np.array([0.0, 0.2, 1.0]), views(), out)
        assert renderer.pictures == {"all": 3, reason: 3}


def test_marks_are_seen_through_or_not(world: CapsuleWorld):
    eye, out = np.array([0.0, 0.2, 1.0]), np.zeros((4 * HEIGHT, WIDTH, 4), dtype=np.uint8)
    with OffscreenRenderer(world.model, most_marks=1) as renderer:
        for alpha in (1.0, 0.5, 1.0, 1.0):
            mark = Mark((1.0, 1.5, 0.5), (0.3, 0.3, 0.2), (1.0, 0.0, 0.0, alpha))
            renderer.render(world.snapshot(0.0).data, eye, views(), out, [mark])
            drawn = out.copy()
            renderer.keep_still = False
            renderer.render(world.snapshot(0.0).data, eye, views(), out, [mark])
            renderer.keep_still = True
            np.testing.assert_array_equal(drawn, out)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(*[st.floats(-4, 4)] * 3, st.floats(0.01, 0.6)), min_size=1, max_size=4), st.integers(0, 3))
def test_a_rectangle_holds_its_spheres(spheres: list[tuple[float, float, float, float]], place: int):
    content = np.array(spheres)
    middle, radius, view = content[:, :3], content[:, 3], views()[place]
    column, row, width, height = covered_rectangle(view, np.zeros(3), middle, radius)
    directions = np.random.default_rng(0).normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = (middle[:, None] + radius[:, None, None] * directions).reshape(-1, 3) @ view.axes.T
    points = points[points[:, 2] > 1e-6]
    at = (
        (points[:, :2] / points[:, 2:] - [view.left, view.bottom])
        / [
            view.right - view.left,
            view.top - view.bottom,
        ]
        * [WIDTH, HEIGHT]
    )
    shown = at[((at >= 0) & (at <= [WIDTH, HEIGHT])).all(axis=1)] + [0, view.viewport[1]]
    assert ((shown >= [column, row]) & (shown <= [column + width, row + height])).all()
