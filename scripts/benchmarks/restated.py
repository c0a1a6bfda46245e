"""The same recording said otherwise: other axes, clock, names, beams; and how far the tracks then differ.

Every restatement is a function of a `Scene` alone. It hands back another scene, and how a track of that scene reads in the
first one (`Restated.back`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from statistics import median

import numpy as np
from scipy.optimize import linear_sum_assignment

from trackers.area import Pose
from trackers.feeding import track_frames
from trackers.observations import NS_PER_S, DepthImage, FloorFrame, Image, LaserScan, Observation
from trackers.presets import make_tracker
from trackers.rig import FloorSensor, LaserSensor, Rig, RigSensor
from trackers.tracks import Track, TrackFrame


@dataclass(frozen=True)
class Scene:
    """A rig, observations of the empty room, and a recording in order of arrival."""

    rig: Rig
    background: Sequence[Observation]
    observations: Sequence[Observation]

    def frames(self, tracker: str, seed: int = 0) -> list[TrackFrame]:
        """Track the recording with a preset."""
        made = make_tracker(tracker, self.rig, list(self.background), np.random.default_rng(seed))
        return list(track_frames(made, self.rig, self.observations))

    def mapped(self, change: Callable[[Observation], Observation]) -> Scene:
        """The scene with every observation changed, those of the empty room too."""
        return replace(
            self, background=[change(each) for each in self.background], observations=[*map(change, self.observations)]
        )


Place = np.ndarray
"""(x, y) [m]."""


@dataclass(frozen=True)
class Restated:
    """A scene said otherwise; `back` takes a place to the first scene's axes, `later_ns` is how much later its stamps are."""

    scene: Scene
    back: Callable[[Place], Place] = lambda place: place
    later_ns: int = 0


def placed(scene: Scene, pose: Callable[[RigSensor], Pose], area: Callable[[Place], Place]) -> Scene:
    """The scene with every sensor's pose and the area's corners changed."""
    sensors = {
        name: each.model_copy(update={"room_from_sensor": pose(each)}) for name, each in scene.rig.sensors.items()
    }
    corners = scene.rig.area and tuple(tuple(map(float, area(np.array(corner)))) for corner in scene.rig.area)
    return replace(scene, rig=scene.rig.model_copy(update={"sensors": sensors, "area": corners}))


def moved(scene: Scene) -> Restated:
    """The room's origin a kilometre away."""
    return turned(scene, angle_rad=0.0)


def turned(
    scene: Scene, angle_rad: float = np.deg2rad(37.0), moved_m: tuple[float, float] = (800.0, -600.0)
) -> Restated:
    """The room's axes turned, and their origin a kilometre away."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    R, shift = np.array([[cos, -sin], [sin, cos]]), np.array(moved_m)

    def pose(sensor: RigSensor) -> Pose:
        old, rotation = sensor.room_from_sensor, np.eye(3)
        rotation[:2, :2] = R
        x, y = R @ old.translation[:2] + shift
        return Pose.from_matrix(rotation @ old.rotation, (float(x), float(y), old.xyz[2]))

    return Restated(placed(scene, pose, lambda place: R @ place + shift), lambda place: (place - shift) @ R)


def mirrored(scene: Scene) -> Restated:
    """Left for right: the room seen in a mirror."""
    mirror = np.diag([-1.0, 1.0, 1.0])

    def pose(sensor: RigSensor) -> Pose:
        old = sensor.room_from_sensor
        origin = old.translation
        if isinstance(sensor, FloorSensor):  # its first corner is the one at the other end of the row
            origin = origin + old.rotation @ [sensor.columns * sensor.pitch_m, 0, 0]
        own = np.diag([1.0, -1.0, 1.0] if isinstance(sensor, LaserSensor) else [-1.0, 1.0, 1.0])
        x, y, z = mirror @ origin
        return Pose.from_matrix(mirror @ old.rotation @ own, (float(x), float(y), float(z)))

    scene = placed(_flipped(scene, columns=True, rows=False), pose, lambda place: place * [-1, 1])
    return Restated(scene.mapped(lambda each: _other_hand(each)), lambda place: place * [-1, 1])


def upside_down(scene: Scene) -> Restated:
    """Scanners and cameras hung upside down, at the same places; a floor stays where it is."""

    def pose(sensor: RigSensor) -> Pose:
        old = sensor.room_from_sensor
        if isinstance(sensor, FloorSensor):
            return old
        own = np.diag([1.0, -1.0, -1.0] if isinstance(sensor, LaserSensor) else [-1.0, -1.0, 1.0])
        return Pose.from_matrix(old.rotation @ own, old.xyz)

    floors = set(scene.rig.floors())
    restated = placed(_flipped(scene, columns=True, rows=True, without=floors), pose, lambda place: place)
    return Restated(restated.mapped(lambda each: _other_hand(each)))


def _flipped(scene: Scene, *, columns: bool, rows: bool, without: set[str] | None = None) -> Scene:
    """Pictures, floors and the lenses' principal points with columns or rows the other way around."""
    across, down = (-1 if columns else 1), (-1 if rows else 1)

    def change(each: Observation) -> Observation:
        if each.sensor in (without or ()):
            return each
        match each:
            case Image():
                return replace(each, rgb=each.rgb[::down, ::across].copy())
            case DepthImage():
                return replace(
                    each, rgb=each.rgb[::down, ::across].copy(), depth_m=each.depth_m[::down, ::across].copy()
                )
            case FloorFrame():
                return replace(each, values=each.values[::down, ::across].copy())
        return each

    sensors = dict(scene.rig.sensors)
    for name, camera in scene.rig.cameras().items():
        lens = camera.intrinsics
        cx = lens.width - 1 - lens.cx if columns else lens.cx
        cy = lens.height - 1 - lens.cy if rows else lens.cy
        sensors[name] = camera.model_copy(update={"intrinsics": lens.model_copy(update={"cx": cx, "cy": cy})})
    return replace(scene, rig=scene.rig.model_copy(update={"sensors": sensors})).mapped(change)


def _other_hand(each: Observation) -> Observation:
    """A scan whose bearings are of the other sign, still counter-clockwise."""
    if not isinstance(each, LaserScan):
        return each
    last_rad = each.angle_min_rad + (each.ranges_m.size - 1) * each.angle_increment_rad
    return replace(each, ranges_m=each.ranges_m[::-1].copy(), angle_min_rad=-last_rad)


def clockwise(scene: Scene) -> Restated:
    """Scanners that turn the other way: the same beams, the last one first."""

    def change(each: Observation) -> Observation:
        if not isinstance(each, LaserScan):
            return each
        turned = _other_hand(each)
        return replace(turned, angle_min_rad=-turned.angle_min_rad, angle_increment_rad=-each.angle_increment_rad)

    return Restated(scene.mapped(change))


def every_other_beam(scene: Scene) -> Restated:
    """Half of the beams: of each scan those of even number, of the next those of odd number."""
    counts: dict[str, int] = {}

    def change(each: Observation) -> Observation:
        if not isinstance(each, LaserScan):
            return each
        first = counts[each.sensor] = 1 - counts.get(each.sensor, 1)
        return replace(
            each,
            ranges_m=each.ranges_m[first::2].copy(),
            angle_min_rad=each.angle_min_rad + first * each.angle_increment_rad,
            angle_increment_rad=2 * each.angle_increment_rad,
        )

    return Restated(scene.mapped(change))


def stamped(epoch_s: float) -> Callable[[Scene], Restated]:
    """The clock started elsewhere: the first stamp of the recording is `epoch_s`."""

    def restate(scene: Scene) -> Restated:
        later_ns = round(epoch_s * NS_PER_S) - min(each.stamp_ns for each in scene.observations)
        return Restated(scene.mapped(lambda each: replace(each, stamp_ns=each.stamp_ns + later_ns)), later_ns=later_ns)

    return restate


def renamed(scene: Scene) -> Restated:
    """Other names, which sort the other way around; the main sensor stays what it was."""
    ordered = sorted(scene.rig.sensors, reverse=True)
    names = {name: f"sensor_{number}" for number, name in enumerate(ordered)}
    sensors = {names[name]: each for name, each in scene.rig.sensors.items()}
    rig = scene.rig.model_copy(update={"sensors": sensors, "main": names[scene.rig.main_sensor]})
    return Restated(replace(scene, rig=rig).mapped(lambda each: replace(each, sensor=names[each.sensor])))


def reordered(scene: Scene) -> Restated:
    """The rig's sensors in another order, and observations of one stamp likewise."""
    sensors = dict(reversed(scene.rig.sensors.items()))
    rig = scene.rig.model_copy(update={"sensors": sensors})
    later_first = sorted(reversed(scene.observations), key=lambda each: each.stamp_ns)
    return Restated(replace(scene, rig=rig, observations=later_first))


def doubled_scanners(scene: Scene) -> Restated:
    """A second scanner at each scanner's place, which sees the same."""
    lasers = scene.rig.lasers()
    second = {f"{name}_2": each.model_copy(update={"topic": f"{each.topic}_2"}) for name, each in lasers.items()}
    rig = scene.rig.model_copy(update={"sensors": {**scene.rig.sensors, **second}})

    def both(seen: Sequence[Observation]) -> list[Observation]:
        return [
            twin
            for each in seen
            for twin in ([each, replace(each, sensor=f"{each.sensor}_2")] if each.sensor in lasers else [each])
        ]

    return Restated(Scene(rig, both(scene.background), both(scene.observations)))


def with_silent_sensors(scene: Scene) -> Restated:
    """One more sensor of each kind that never reports; it comes first, by its place in the rig and by its name."""
    silent = {
        f"a_{each.kind}": each.model_copy(update={"topic": f"/a_{each.kind}"}) for each in scene.rig.sensors.values()
    }
    sensors, main = {**silent, **scene.rig.sensors}, scene.rig.main_sensor
    return Restated(replace(scene, rig=scene.rig.model_copy(update={"sensors": sensors, "main": main})))


def second_half(scene: Scene) -> Restated:
    """The run cut in two: the second half alone."""
    stamps = sorted({each.stamp_ns for each in scene.observations})
    middle_ns = stamps[len(stamps) // 2]
    return Restated(replace(scene, observations=[each for each in scene.observations if each.stamp_ns >= middle_ns]))


def going_on(scene: Scene) -> Restated:
    """Twice as long: the recording once more, after it."""
    stamps = sorted({each.stamp_ns for each in scene.observations if each.sensor == scene.rig.main_sensor})
    length_ns = (stamps[-1] - stamps[0]) * len(stamps) // (len(stamps) - 1)
    again = [replace(each, stamp_ns=each.stamp_ns + length_ns) for each in scene.observations]
    return Restated(replace(scene, observations=[*scene.observations, *again]))


EXACT: Mapping[str, Callable[[Scene], Restated]] = {
    "moved by 1 km": moved,
    "turned by 37°, moved by 1 km": turned,
    "mirrored": mirrored,
    "sensors upside down": upside_down,
    "clockwise scanners": clockwise,
    "clock from 0": stamped(0.0),
    "clock from 1970 on, an hour": stamped(3600.0),
    "clock that runs up to 0": stamped(-1000.0),
    "clock of 2026": stamped(1_790_000_000.0),
    "clock of 2200": stamped(7_258_118_400.0),
    "other names": renamed,
    "other order": reordered,
    "silent sensors": with_silent_sensors,
    "twice as long": going_on,
}
"""Restatements that leave every reading as it was: the tracks differ by rounding alone."""

REDRAWN = ("moved by 1 km", "turned by 37°, moved by 1 km", "mirrored", "sensors upside down")
"""Of these, those after which a random number means another direction, or goes to another person."""

ROUNDING_M = 1e-6
"""A micrometre: floats tell 1e-13 m apart at 1 km; filters and assignments repeat such errors, but do not let them grow."""
UNLIKE = 0.05
"""Share of tracks that may differ where the readings do, or beyond what other seeds make of a sampling tracker."""
OTHER_SEEDS = (1, 2, 3)

CLOSE: Mapping[str, Callable[[Scene], Restated]] = {
    "every other beam": every_other_beam,
    "a second scanner at each": doubled_scanners,
    "cut in two": second_half,
}
"""Restatements with fewer or more readings of the same: tracks are as good, not the same."""


def deviation_m(first: Sequence[TrackFrame], restated: Restated, frames: Sequence[TrackFrame]) -> float:
    """Largest distance [m] of a track of `first` from the same one of the restated scene, by one pairing of ids throughout.

    inf where at some stamp of `first` there are more or fewer tracks, or an id stands for two.
    """
    other = {frame.stamp_ns - restated.later_ns: frame.tracks for frame in frames}
    known: dict[int, int] = {}
    farthest = 0.0
    for frame in first:
        tracks = other.get(frame.stamp_ns)
        if tracks is None or len(tracks) != len(frame.tracks):
            return inf
        if not tracks:
            continue
        apart = np.hypot(*np.moveaxis(_places(frame.tracks)[:, None] - restated.back(_places(tracks)), -1, 0))
        for row, column in zip(*linear_sum_assignment(apart), strict=True):
            if known.setdefault(frame.tracks[row].id, tracks[column].id) != tracks[column].id:
                return inf
            farthest = max(farthest, float(apart[row, column]))
    return farthest if len(set(known.values())) == len(known) else inf


def _places(tracks: Sequence[Track]) -> Place:
    return np.array([(track.x, track.y) for track in tracks])


def disagreement(
    first: Sequence[TrackFrame], restated: Restated, frames: Sequence[TrackFrame], gate_m: float = 0.3
) -> float:
    """Share of the tracks of either, at the stamps of `first`, without one of the other within `gate_m`."""
    other = {frame.stamp_ns - restated.later_ns: frame.tracks for frame in frames}
    total = alone = 0
    for frame in first:
        tracks = other.get(frame.stamp_ns, ())
        total += len(frame.tracks) + len(tracks)
        alone += len(frame.tracks) + len(tracks)
        if frame.tracks and tracks:
            apart = np.hypot(*np.moveaxis(_places(frame.tracks)[:, None] - restated.back(_places(tracks)), -1, 0))
            rows, columns = linear_sum_assignment(np.minimum(apart, 2 * gate_m))
            alone -= 2 * int((apart[rows, columns] < gate_m).sum())
    return alone / total if total else 0.0


def redrawn_disagreement(first: Sequence[TrackFrame], restated: Restated, tracker: str, most: float) -> float:
    """Median over seeds of the disagreement of a tracker that draws at random: one seed says little, as another may not.

    Five seeds; fifteen where those disagree by more than `most`: a merge that one seed in four gets wrong is no difference.
    """

    def unlike(seeds: range) -> list[float]:
        return [disagreement(first, restated, restated.scene.frames(tracker, seed)) for seed in seeds]

    found = unlike(range(5))
    return median(found if median(found) <= most else found + unlike(range(5, 15)))
