"""No option of the trackers by cameras is without effect: an absurd value gives other tracks, or is refused."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any, Literal, get_args, get_origin

import numpy as np
import pytest
import synthetic_home
import synthetic_meeting
from box_room import box_room_cloud
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from trackers.camera_floor_particle.baseline import ClusterKalmanOptions
from trackers.camera_floor_particle.options import CameraFloorParticleOptions
from trackers.environment import build_environment
from trackers.errors import InputError
from trackers.feeding import track_frames
from trackers.observations import NS_PER_S, FloorFrame, Observation
from trackers.plain_data import deep_merge
from trackers.presets import PRESETS, make_tracker
from trackers.prior import Prior
from trackers.rgbd_head.options import RgbdHeadOptions
from trackers.rig import Rig

OPTIONS: dict[str, type[BaseModel]] = {
    "camera-floor-particle": CameraFloorParticleOptions,
    "rgbd-head": RgbdHeadOptions,
    "floor-colour-kalman": ClusterKalmanOptions,
}
_TRACKS: dict[tuple[str, str], str] = {}
TOGETHER: dict[str, dict[str, Any]] = {
    "environment.odd_height": {"environment": {"high_m": 1.5}},
}
"""Options set with one that has an effect with them alone."""
SEEN_ELSEWHERE = {
    "scheduler": "its whole promise is that it changes no track: test_rgbd_head_scheduled.py",
    "track_management.reid_distance": "a person who comes back: test_camera_floor_particle.py",
    "track_management.stuck_s": "an element that is stuck: test_camera_floor_particle.py",
    "track_management.tentative_coast_s": "a person felt in every other frame: test_camera_floor_particle.py",
}
"""Options whose effect takes what the short recording lacks, and the test that sees it."""
MOST = 60
"""Options of one system."""


def leaves(options: BaseModel, at: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], FieldInfo, Any]]:
    """Every option that is no group of options, with its path and value."""
    for name, field in type(options).model_fields.items():
        value = getattr(options, name)
        if isinstance(value, BaseModel):
            yield from leaves(value, (*at, name))
        else:
            yield (*at, name), field, value


def absurd(field: FieldInfo, value: Any) -> list[Any]:
    """Values that no user would choose, those farthest from the default first."""
    if isinstance(value, bool):
        return [not value]
    if get_origin(field.annotation) is Literal:
        return [each for each in get_args(field.annotation) if each != value]
    if isinstance(value, tuple) and not value:
        return [("stereo_2",), ({"place": [0, 0, 1.5], "yaw_deg": 0},)]
    if isinstance(value, tuple):
        return [tuple(2 * each for each in value), tuple(type(each)(each / 2) or 1 for each in value)]
    if value is None:
        return [{}, 0.0]
    kind = type(value) if isinstance(value, int) else float
    tried = [
        kind(100 * value),
        kind(value + 10),
        kind(value / 100),
        kind(2 * value),
        kind(0.8 * value),
        kind(value + 10_000),
    ]
    for bound in field.metadata:
        for name, sign in (("ge", 1), ("gt", 1), ("le", -1), ("lt", -1)):
            edge = getattr(bound, name, None)
            tried += [] if edge is None else [kind(edge), kind(edge + sign * 1e-3)]
    return [each for each in tried if each != value]


@cache
def recorded(name: str) -> tuple[Rig, Prior, list[Observation]]:
    """Three people who walk, with skin and shadows, one of whom leaves and comes back; then there is less light."""
    room, period_s = (synthetic_meeting, 0.2) if name == "rgbd-head" else (synthetic_home, synthetic_home.PERIOD_S)
    rig, walk = room.rig(), room.walks(3, 40)
    if name == "rgbd-head":
        walk[..., 0] += 0.9  # out of view of some cameras, over a table
    if name == "floor-colour-kalman":
        walk[..., 1] *= 0.3  # past each other
    first, last = round(1.2 / period_s), round(2.4 / period_s)
    later_ns = round(first * period_s * NS_PER_S)
    gone = {}
    for each in room.observe(rig, walk[first:last, :2]):
        gone[each.sensor, each.stamp_ns + later_ns] = replace(each, stamp_ns=each.stamp_ns + later_ns)
    seen = [gone.get((each.sensor, each.stamp_ns), each) for each in room.observe(rig, walk)]
    if name == "rgbd-head":  # the second camera looks a little later
        seen = [replace(each, stamp_ns=each.stamp_ns + (each.sensor == "stereo_2") * NS_PER_S // 20) for each in seen]
    if name == "floor-colour-kalman":  # feels nothing for a frame
        empty = synthetic_home.PERIOD_S * 2.5 * NS_PER_S
        seen = [
            replace(each, values=0 * each.values)
            if isinstance(each, FloorFrame) and 0 < each.stamp_ns < empty
            else each
            for each in seen
        ]
    lit = [each if isinstance(each, FloorFrame) else replace(each, rgb=_lit(each.rgb, each.t)) for each in seen]
    near = rig.model_copy(update={"area": ((-0.7, -0.7), (0.7, -0.7), (0.7, 0.7), (-0.7, 0.7))})
    environment = build_environment(box_room_cloud()) if name == "rgbd-head" else None
    return near, Prior(room.empty_room(rig), environment), lit


def _lit(rgb: np.ndarray, t_s: float) -> np.ndarray:
    """Give heads the colour of skin, throw a shadow over a part of the picture, and turn the light down at last."""
    changed = rgb.astype(float)
    changed[np.abs(changed - (90, 60, 40)).max(axis=-1) < 12] = (190, 140, 110)
    changed[2 * len(rgb) // 3 :, 20:90] *= 0.75
    changed[20:40, 80:100] *= 0.75
    return (changed * (0.8 if t_s > 2.8 else 1.0)).astype(np.uint8)


def tracks_of(name: str, change: dict[str, Any]) -> str:
    key = name, repr(change)
    if key not in _TRACKS:
        _TRACKS[key] = _tracks(name, change)
    return _TRACKS[key]


def _tracks(name: str, change: dict[str, Any]) -> str:
    rig, room, seen = recorded(name)
    tracker = make_tracker(name, rig, room, np.random.default_rng(0), change)
    frames = list(track_frames(tracker, rig, seen))
    return repr([(frame.stamp_ns, frame.tracks) for frame in frames])


def cases() -> list[Any]:
    """All options but those of `SEEN_ELSEWHERE`."""
    found = []
    for name, kind in OPTIONS.items():
        for path, field, value in leaves(kind(**PRESETS[name].options)):
            if ".".join(path) in SEEN_ELSEWHERE:
                continue
            found.append(pytest.param(name, path, field, value, id=f"{name}: {'.'.join(path)}"))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("name", "path", "field", "value"), cases())
def test_an_absurd_value_of_an_option_gives_other_tracks_or_is_refused(name, path, field, value):
    for strange in absurd(field, value):
        change: Any = strange
        for part in reversed(path):
            change = {part: change}
        others = TOGETHER.get(".".join(path), {})
        try:
            if tracks_of(name, deep_merge(others, change)) != tracks_of(name, others):
                return
        except InputError:
            continue
    pytest.fail(f"{'.'.join(path)} changes nothing")


@pytest.mark.parametrize("name", OPTIONS)
def test_systems_have_few_options(name):
    assert sum(1 for _ in leaves(OPTIONS[name]())) <= MOST
