"""No option without effect: an absurd value of any option of any preset gives other tracks, or is refused."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import zip_longest
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, get_args, get_origin
from zlib import crc32

import numpy as np
import pytest
import synthetic_home
import synthetic_meeting
import synthetic_view
import two_scanners
from box_room import box_room_cloud
from driving_room import WALKER, drive, driven, rig_on_base
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from synthetic_room import PERIOD_S, Walk, empty_room, observe, rig, scan, straight_walk, wandering

from trackers.environment import build_environment
from trackers.errors import InputError
from trackers.feeding import track_frames
from trackers.laser_fisheye_imm.rules import PAPER
from trackers.observations import NS_PER_S, FloorFrame, Image, Observation
from trackers.presets import PRESETS, make_tracker
from trackers.prior import Prior
from trackers.rig import Pose, Rig
from trackers.user_input.plain_data import deep_merge

MOST = 60
"""Options of one system."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A short recording, and what trackers say of it as they are, as far as it was asked for yet."""

    rig: Rig
    prior: Prior
    observations: list[Observation]
    usual: dict[str, tuple[list[str], Iterator[str]]] = field(default_factory=dict)

    def said(self, preset: str, options: Mapping[str, Any]) -> Iterator[str]:
        """Yield everything that a tracker says, frame by frame."""
        tracker = make_tracker(preset, self.rig, self.prior, np.random.default_rng(0), options)
        decisions = getattr(tracker, "decisions", list)  # who is who after a split, and how sure that is
        for frame in track_frames(tracker, self.rig, self.observations):
            yield repr((frame, decisions()))

    def usually_said(self, preset: str, with_others: Mapping[str, Any]) -> Iterator[str]:
        """Yield the same without the option, each frame worked out once."""
        key = f"{preset} {with_others}"
        known, coming = self.usual.setdefault(key, ([], self.said(preset, with_others)))
        yield from known
        for frame in coming:
            known.append(frame)
            yield frame

    def differs(self, preset: str, options: Mapping[str, Any], others: Mapping[str, Any]) -> bool:
        """Compare the tracks, up to the first frame that is another. Raises InputError for a value that is refused."""
        said = self.said(preset, deep_merge(others, options))
        return any(one != other for one, other in zip_longest(said, self.usually_said(preset, others)))


def leaves(options: BaseModel, at: str = "") -> Iterator[tuple[str, FieldInfo, Any]]:
    """Yield every option that is no group of options, with its path and value."""
    for name, info in type(options).model_fields.items():
        value = getattr(options, name)
        if isinstance(value, BaseModel):
            yield from leaves(value, f"{at}{name}.")
        else:
            yield f"{at}{name}", info, value


def absurd(info: FieldInfo, value: Any) -> list[Any]:
    """Return values that no user would choose, the likeliest to show first; some will be refused."""
    if isinstance(value, bool):
        return [not value]
    if get_origin(info.annotation) is Literal:
        return [each for each in get_args(info.annotation) if each != value]
    if isinstance(value, str):
        return ["no such thing"]
    if isinstance(value, tuple) and not value:
        return [("stereo_2",), ({"place": [0, 0, 1.5], "yaw_deg": 0},)]
    if isinstance(value, tuple):
        return [
            value[:1],
            tuple(2 * each for each in value),
            tuple(1 if isinstance(each, int) else each / 2 for each in value if not isinstance(each, str)),
        ]
    if value is None:
        tried = [1e-3, 1e3, 1, {}, 0.0]
    elif isinstance(value, int):
        tried = [value // 100, 2 * value, value + 10_000, 1, 0]
    else:
        tried = [value / 100, 100 * value + 10, 3 * value + 0.3, 0.8 * value, 0.0, 0.999, value / 1000, value + 10_000]
    for bound in info.metadata:
        for name, sign in (("ge", 1), ("gt", 1), ("le", -1), ("lt", -1)):
            edge = getattr(bound, name, None)
            if edge is not None:
                tried += [edge + sign] if value is None else [type(value)(edge), type(value)(edge + sign * 1e-3)]
    return [each for each in tried if each != value]


@dataclass(frozen=True)
class Trial:
    """A preset, options set with the one that is tried, recordings, and the groups of options tried (None: all)."""

    preset: str
    recordings: tuple[Recording, ...]
    groups: Collection[str] | None = None
    others: Mapping[str, Any] = field(default_factory=dict)
    idle: Collection[str] = ()  # of these `others` make nothing

    def options(self) -> Iterator[tuple[str, FieldInfo, Any]]:
        """Yield the options that are tried."""
        first = self.recordings[0]
        made = make_tracker(self.preset, first.rig, first.prior, options=self.others)
        for path, info, value in leaves(made.options):  # pyright: ignore[reportAttributeAccessIssue]
            if path not in self.idle and (self.groups is None or path.split(".")[0] in self.groups):
                yield path, info, value

    def all_options(self) -> set[str]:
        """Return the paths of all options of the preset."""
        return {path for path, _, _ in replace(self, groups=None, idle=()).options()}

    def verdict(self, path: str, info: FieldInfo, value: Any) -> Literal["effect", "refused", "idle"]:
        """Say if an absurd value changes any recording's tracks, or every one is refused."""
        others, refused = deep_merge(self.others, TOGETHER.get(path, {})), True
        for strange in absurd(info, value):
            change: Any = strange
            for part in reversed(path.split(".")):
                change = {part: change}
            for recording in self.recordings:
                try:
                    if recording.differs(self.preset, change, others):
                        return "effect"
                except InputError:
                    break  # the next value
                refused = False
        return "refused" if refused else "idle"


@cache
def _room(pictures: bool) -> tuple[Recording, ...]:
    """People who hide one another, with scans of the empty room and without; two scanners that face each other."""
    crowd = wandering(5, 26, np.random.default_rng(3))
    crossing = straight_walk([(-1.2, 1.2), (0.9, 1.9), (-0.3, 2.7)], [(1.0, 0.0), (-0.9, 0.0), (0.9, 0.0)], 24)
    on, empty = rig(camera=pictures), Prior.of(empty_room(np.random.default_rng(1)))
    facing = Recording(two_scanners.RIG, Prior.of(two_scanners.EMPTY), list(two_scanners.observed(crossing)))
    out_of_sight = Recording(on, empty, observe(_out_of_sight(), 4, images=pictures))
    seldom = [each for each in observe(crowd, 4, images=pictures) if round(each.t / PERIOD_S) % 3 == 0]
    return (
        Recording(on, empty, observe(crowd, 4, images=pictures)),
        *([] if pictures else [facing]),
        Recording(on, empty, observe(crossing, 5, images=pictures)),
        Recording(on, Prior(), observe(crowd, 4, images=pictures)),
        *([] if pictures else [out_of_sight, _open(_AWAY), Recording(_within(on), empty, seldom)]),
    )


def _out_of_sight() -> Walk:
    """Three people; one walks behind another, stays there for four scans, and comes up half a metre further on."""
    n, hidden, up = 28, 9, 13
    walk = straight_walk([(0.0, 1.0), (0.0, 2.3), (-1.5, 1.2)], [(0.0, 0.0), (0.001, 0.0), (0.0, 0.3)], n)
    way = np.concatenate([np.linspace(-0.9, -0.05, hidden), np.zeros(up - hidden), 0.75 + 0.05 * np.arange(n - up)])
    walk.position[:, 1, 0], walk.phase[:, 1] = way, 0.4 * np.arange(n)
    return walk


_AWAY = ((2, 3), range(11, 16), (2,))
"""Scans without each of three people: none is there in every scan, and one comes up elsewhere."""


def _open(away: Sequence[Collection[int]]) -> Recording:
    """Three people where nothing is behind them, each `away` in some scans."""
    walk = straight_walk([(-1.2, 1.2), (0.9, 1.9), (-0.3, 2.7)], [(1.0, 0.0), (-0.1, 0.0), (0.9, 0.0)], 26)
    walk.position[14:, 1] += (0.0, 0.35)
    rng, seen = np.random.default_rng(6), []
    for k in range(len(walk)):
        there = walk.permuted([person for person in range(3) if k not in away[person]])
        for height in ("waist", "knee"):
            ns = round(k * PERIOD_S * NS_PER_S)
            walls_m, of_people = scan(None, k, height, ns, rng).ranges_m, scan(there, k, height, ns, rng)
            ranges_m = np.where(of_people.ranges_m > walls_m - 0.1, np.float32(np.inf), of_people.ranges_m)
            seen.append(replace(of_people, ranges_m=ranges_m))
    return Recording(rig(camera=False), Prior(), seen)


@cache
def _passing() -> Recording:
    """Two people who pass each other between two scanners, hide one another from both, and part; a camera sees them."""
    walk = straight_walk([(-1.2, 1.5), (1.2, 1.75)], [(0.8, 0.0), (-0.8, 0.0)], 32)
    camera = rig(waist=False, knee=False).sensors["camera"]
    on = two_scanners.RIG.model_copy(update={"sensors": {**two_scanners.RIG.sensors, "camera": camera}})
    pictures = [each for each in observe(walk, 4) if each.sensor == "camera"]
    seen = sorted([*two_scanners.observed(walk), *pictures], key=lambda each: each.stamp_ns)
    return Recording(on, Prior.of(two_scanners.EMPTY), seen)


@cache
def _aside(step_m: float) -> Recording:
    """One person stands behind another before a camera, and steps aside; a scanner 0.8 m beside the camera sees both."""
    walk = straight_walk([(0.0, 1.2), (0.05, 2.0)], [(0.0, 0.0), (0.0, 0.001)], 12)
    walk.position[8:, 1, 0] += step_m
    of_scanner = Walk(walk.position - (0.8, 0.0), walk.heading, walk.phase)
    there = Pose(xyz=(0.8, 0, 0.95), rpy=(0, 0, np.pi / 2))
    on = rig(knee=False)
    waist = on.sensors["waist"].model_copy(update={"room_from_sensor": there})
    on = on.model_copy(update={"sensors": {**on.sensors, "waist": waist}})
    rng, seen = np.random.default_rng(3), []
    for k, each in enumerate(each for each in observe(walk, 4) if each.sensor == "camera"):
        seen += [scan(of_scanner, k, "waist", each.stamp_ns, rng), each]
    return Recording(on, Prior.of([scan(None, k, "waist", k, rng) for k in range(6)]), seen)


@cache
def _waists() -> Recording:
    """Two people who pass each other between two scanners at the height of their waists."""
    on = Rig(sensors={name: two_scanners.laser(name == "back", "waist") for name in ("front", "back")})
    walk, sides = straight_walk([(-1.2, 1.5), (1.2, 1.75)], [(0.8, 0.0), (-0.8, 0.0)], 24), (False, True)
    empty = [two_scanners.one_scan(None, k, 0.1 * k, back, 7, "waist") for k in range(6) for back in sides]
    seen = [two_scanners.one_scan(walk, k, 1 + 0.1 * k, back, 3, "waist") for k in range(len(walk)) for back in sides]
    return Recording(on, Prior.of(empty), seen)


@cache
def _drive() -> Recording:
    """One person before a scanner on a robot whose wheels slip."""
    return Recording(rig_on_base(), Prior(), driven(drive(24), [WALKER], slip=1.1)[0])


@cache
def _behind() -> Recording:
    """Three people before one low scanner and a camera that looks down on them; for a while one hides behind another."""
    walk, lasers = _out_of_sight(), rig(waist=False, camera=False)
    on = lasers.model_copy(update={"sensors": {**lasers.sensors, **synthetic_view.rig().sensors}})
    empty_view = [synthetic_view.picture(on, 1000.0 + k, np.empty((0, 2))) for k in range(3)]
    seen = []
    for each in observe(walk, 4, images=False):
        if each.sensor == "knee":
            k = len(seen) // 2
            seen += [each, synthetic_view.picture(on, each.t, walk.position[k])]
    knee = [each for each in empty_room(np.random.default_rng(1)) if each.sensor == "knee"]
    return Recording(on, Prior.of([*knee, *empty_view]), seen)


@cache
def _view() -> tuple[Recording, Recording]:
    """Two people who pass each other before a camera and leave its area, one who stands, a shadow; the same without an area."""

    def seen(k: int) -> Image:
        t = 0.1 * k
        places = np.array([(-1.5 + 1.5 * t, 0.4), (1.5 - 1.5 * t, 0.6), (-1.0, -1.5)])
        return _shaded(synthetic_view.picture(on, t, places))

    area = ((-1.2, -2.0), (1.2, -2.0), (1.2, 1.0), (-1.2, 1.0))
    on = synthetic_view.rig().model_copy(update={"area": area})
    empty = Prior.of([synthetic_view.picture(on, 1000.0 + k, np.empty((0, 2))) for k in range(5)])
    everywhere = on.model_copy(update={"area": None})
    return Recording(on, empty, [*map(seen, range(24))]), Recording(everywhere, empty, [*map(seen, range(6))])


@cache
def _taken_place() -> Recording:
    """A person steps aside and another, whose shirt looks like the floor, stands there; two pictures a second."""
    on, shirts = synthetic_view.rig(), (synthetic_view.COLOURS[0], (120, 120, 120))
    places = [np.zeros((1, 2))] * 5 + [np.array([(0.55, 0.0), (0.0, 0.1)])] * 2
    seen = [synthetic_view.picture(on, 0.5 * k, each, shirts) for k, each in enumerate(places)]
    return Recording(on, _view()[0].prior, seen)


@cache
def _flickers() -> Recording:
    """Two people before a camera, one of whom is not there in two of the first pictures."""
    on = synthetic_view.rig()
    seen = [
        synthetic_view.picture(
            on, 0.1 * k, np.array([(-1 + 0.05 * k, 0), (1 - 0.05 * k, 0.5)])[: 1 if 2 <= k < 4 else 2]
        )
        for k in range(12)
    ]
    return Recording(on, _view()[0].prior, seen)


def _shaded(image: Image) -> Image:
    rgb = image.rgb.copy()
    rgb[150:200, 60:110] = 0.75 * rgb[150:200, 60:110]
    return replace(image, rgb=rgb)


@cache
def _home(past_each_other: bool) -> Recording:
    """Cameras and a floor: three people, one of whom leaves and comes back; less light at last."""
    on, walk = synthetic_home.rig(), synthetic_home.walks(3, 40)
    if past_each_other:
        walk[..., 1] *= 0.3
    seen = _with_one_gone(synthetic_home, on, walk, synthetic_home.PERIOD_S)
    if past_each_other:  # and nothing is felt for a frame
        ends_ns = synthetic_home.PERIOD_S * 2.5 * NS_PER_S
        seen = [
            replace(each, values=0 * each.values)
            if isinstance(each, FloorFrame) and 0 < each.stamp_ns < ends_ns
            else each
            for each in seen
        ]
    return Recording(_within(on), Prior(synthetic_home.empty_room(on)), _lit(seen))


@cache
def _meeting() -> Recording:
    """Stereo cameras and a model of the room: the same three, out of view of some cameras, over a table."""
    on, walk = synthetic_meeting.rig(), synthetic_meeting.walks(3, 40)
    walk[..., 0] += 0.9
    seen = _with_one_gone(synthetic_meeting, on, walk, synthetic_meeting.PERIOD_S)
    # the second camera looks a little later
    seen = [replace(each, stamp_ns=each.stamp_ns + (each.sensor == "stereo_2") * NS_PER_S // 20) for each in seen]
    prior = Prior(synthetic_meeting.empty_room(on), build_environment(box_room_cloud()))
    return Recording(_within(on), prior, _lit(seen))


def _within(on: Rig) -> Rig:
    """Return the rig with an area that people leave."""
    return on.model_copy(update={"area": ((-0.7, -0.7), (0.7, -0.7), (0.7, 0.7), (-0.7, 0.7))})


def _with_one_gone(room: ModuleType, on: Rig, walk: np.ndarray, period_s: float) -> list[Observation]:
    first, last = round(1.2 / period_s), round(2.4 / period_s)
    later_ns = round(first * period_s * NS_PER_S)
    without = {}
    for each in room.observe(on, walk[first:last, :2]):
        without[each.sensor, each.stamp_ns + later_ns] = replace(each, stamp_ns=each.stamp_ns + later_ns)
    return [without.get((each.sensor, each.stamp_ns), each) for each in room.observe(on, walk)]


def _lit(seen: list[Any]) -> list[Observation]:
    """Give heads the colour of skin, throw a shadow over a part of the pictures, and turn the light down at last."""

    def lit(rgb: np.ndarray, t_s: float) -> np.ndarray:
        changed = rgb.astype(float)
        changed[np.abs(changed - (90, 60, 40)).max(axis=-1) < 12] = (190, 140, 110)
        changed[2 * len(rgb) // 3 :, 20:90] *= 0.75
        changed[20:40, 80:100] *= 0.75
        return (changed * (0.8 if t_s > 2.8 else 1.0)).astype(np.uint8)

    return [each if isinstance(each, FloorFrame) else replace(each, rgb=lit(each.rgb, each.t)) for each in seen]


TOGETHER: dict[str, dict[str, Any]] = {
    "environment.odd_height": {"environment": {"high_m": 1.5}},
    "recognition.correlated": {"recognition": {"drawn": "all"}},
}
"""Options set with one that has an effect with them alone."""

EXEMPT = {
    "laser-fisheye-imm": {
        "camera": "tests/trackers/test_presets.py: a choice of sensors",
        "appearance.same_below": "test_laser_fisheye_association.py: a person who was out of sight",
    },
    "laser-vision-learning": {
        "camera": "tests/trackers/test_presets.py: a choice of sensors",
        **dict.fromkeys(
            ("recognition.remember_s", "identities.jointly"),
            "test_recognition.py: people who are exchanged in a merge, a person who comes back",
        ),
    },
    "laser-vision-learning-vision": {
        "camera": "test_vision_only.py: refused unless it names a camera of the rig",
    },
    "camera-floor-particle": {
        "track_management.reid_distance": "test_camera_floor_particle.py: a person who comes back",
        "track_management.stuck_s": "test_camera_floor_particle.py: an element that is stuck",
        "track_management.tentative_coast_s": "test_camera_floor_particle.py: a person felt in every other frame",
    },
    "fusion": {"identity.learns_s": "test_fusion_identity.py: two tracks that have changed people"},
    "camera-floor-particle-paper": {"front_end.shadow_region": "of a removal of shadows that the paper is without"},
    "camera-floor-particle-no-exclusion": {"exclusion.likelier_stays": "of an exclusion that this preset is without"},
    "rgbd-head": {
        "scheduler": "changes no track, by its purpose: test_rgbd_head_scheduled.py",
        "leave_out": "test_rgbd_head.py: a camera that hangs otherwise",
    },
}
"""Options whose effect takes people or sensors that the short recordings lack, and the test that sees it, or the reason."""


def trials(system: str) -> Iterator[Trial]:
    """Yield what is tried of a system: every option of one preset, then of the others the groups that they set themselves.

    Presets of a system differ in values: an option is idle in one of them where another of its group is switched off.
    """
    if system == "sort":
        yield Trial(system, (*_room(False), _drive()))
    if system == "fusion":
        parts, room, home = {"camera", "floor", "head", "identity"}, _room(False), _home(past_each_other=False)
        yield Trial(system, (home,), parts)
        yield Trial(system, (_meeting(),), {"stereo"})
        yield Trial(system, (*room[-3:], room[0], home), _groups(system, home) - parts - {"stereo"})
    if system == "laser-legs":
        flickers = _open(((1, 3), (), ()))  # before it is confirmed
        yield Trial(system, (*_room(False)[-3:], flickers), {"track_management"})
    if system == "laser-fisheye-imm":
        yield Trial("laser-imm", (*_room(False), _waists(), _drive()))
        paper = {group: values for group, values in PAPER.items() if group != "appearance"}  # a camera's
        idle = (  # the paper updates by pairs of legs alone, and here none of them begins beside another
            *("legs.single_leg_variance_m2", "legs.single_leg_s", "legs.shanks_lean", "legs.start_apart_m"),
            # their persons coast, so that one who comes up elsewhere is another; and all are upright
            *("track_management.reid_m", "track_management.confirm_moved_m", "posture.seated_m"),
        )
        yield Trial("laser-imm", (*_room(False), _waists()), set(paper), paper, idle)
        yield Trial(system, (*map(_aside, (0.38, 0.4, 0.42)), *_room(True)), ("appearance",))
    if system == "laser-vision-learning":
        yield Trial("laser-vision-learning-laser", _room(False))
        yield Trial(system, (_passing(),), ("recognition", "identities"))
        yield Trial(system, (_behind(),), ("pictures",))
        yield Trial(system, (_passing(),), ("looks",), {"looks": {"by": "classifier"}, "recognition": {"drawn": "all"}})
    if system == "laser-vision-learning-vision":
        yield Trial(system, (*_view(), _flickers(), _taken_place()))
    if system in ("floor-colour-kalman", "camera-floor-particle", "rgbd-head"):
        recording = _meeting() if system == "rgbd-head" else _home(past_each_other="kalman" in system)
        others = {"heads": 96} if system == "rgbd-head" else {}
        yield Trial(system, (recording,), others=others)
        for preset in PRESETS:
            if system != "rgbd-head" and preset != system and PRESETS[preset].target == PRESETS[system].target:
                yield Trial(preset, (recording,), set(PRESETS[preset].options) or None, others)


def _groups(preset: str, recording: Recording) -> set[str]:
    return {path.partition(".")[0] for path in Trial(preset, (recording,)).all_options()}


SYSTEMS = (
    "sort",
    "fusion",
    "laser-legs",
    "laser-fisheye-imm",
    "laser-vision-learning",
    "laser-vision-learning-vision",
    "camera-floor-particle",
    "floor-colour-kalman",
    "rgbd-head",
)


N_PART = 12


@pytest.mark.slow
@pytest.mark.sample(len(SYSTEMS))  # a part of every system
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of values that no user would choose
@pytest.mark.parametrize("part", range(N_PART))
@pytest.mark.parametrize("system", SYSTEMS)
def test_every_option_has_an_effect_or_is_refused(system: str, part: int) -> None:
    shown, silent, idle = set(), set(), []
    for trial in trials(system):
        exempt = EXEMPT.get(system, {}) | EXEMPT.get(trial.preset, {})
        for path, info, value in trial.options():
            if path in exempt or crc32(path.encode()) % N_PART != part:
                continue
            said = trial.verdict(path, info, value)
            (shown if said == "effect" else silent).add(path)
            if said == "idle":
                idle.append(f"{trial.preset}: {path}")
    assert idle == []
    assert silent <= shown, "refused in every preset"


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("system", SYSTEMS)
def test_only_options_that_show_nowhere_are_exempt(system: str) -> None:
    idle, shown = set(), set()
    for trial in trials(system):
        exempt = EXEMPT.get(system, {}) | EXEMPT.get(trial.preset, {})
        for path, info, value in trial.options():
            if path in exempt:
                (shown if trial.verdict(path, info, value) == "effect" else idle).add(path)
    assert shown <= idle


def test_an_exemption_names_a_test_that_sets_the_option_or_a_preset_that_is_without_it() -> None:
    tests = {path.name: path.read_text(encoding="utf-8") for path in Path(__file__).parent.rglob("test_*.py")}
    for preset, options in EXEMPT.items():
        for path, reason in options.items():
            named = re.search(r"test_\w+\.py", reason)
            assert (path.rpartition(".")[2] in tests[named[0]]) if named else "is without" in reason, (preset, path)


TRIED_ELSEWHERE = {"laser-legs": "tests/trackers/laser_legs/test_laser_legs.py: on a scanner that drives"}
"""Systems some of whose options take other recordings, and the test that tries each of these."""


def test_every_preset_belongs_to_a_system_that_is_tried() -> None:
    tried = {PRESETS[system].target for system in SYSTEMS}
    assert tried == {preset.target for preset in PRESETS.values()}


@pytest.mark.parametrize("system", SYSTEMS)
def test_systems_have_few_options_and_all_are_tried(system: str) -> None:
    every = list(trials(system))
    assert len(of_system := every[0].all_options()) <= MOST
    if system not in TRIED_ELSEWHERE:
        assert of_system <= {path for trial in every for path, _, _ in trial.options()}
