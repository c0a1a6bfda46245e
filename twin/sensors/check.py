"""Checks of a user's sensor by the contract, for its author, and of rendering on this machine."""

from __future__ import annotations

import pickle
import time
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trackers.check import raised
from trackers.errors import PLUG_IN_ERRORS
from trackers.observations import NS_PER_S, DepthImage, FloorFrame, Image, LaserScan, Odometry
from trackers.rig import (
    CameraSensor,
    FisheyeSensor,
    FloorSensor,
    LaserSensor,
    OdometrySensor,
    PinholeSensor,
    StereoSensor,
)
from twin.instant.snapshot import Snapshot, SnapshotSource
from twin.sensors.sensor import Reading, Sensor

_STAMPS_NS = (0, 100_000_000, 200_000_000)
_SEED = 20_240_601
_PARTS = ("name", "instants_s", "observe", "rig_sensor")
_SAME_LOAD_N = 1e-6
_SIDE_PX = 400
_FRAMES = 5
"""Number of frames timed, of which the median is printed."""


def check_sensor(sensor: Sensor, world: SnapshotSource) -> list[str]:
    """List the violations of the contract of `twin.sensors.sensor.Sensor`, one sentence each; empty: none.

    The world must give snapshots from 0 s to 0.2 s and the longest sweep after it, more than once. What the sensor raises is
    a violation too.
    """
    missing = [each for each in _PARTS if not hasattr(sensor, each)]
    if missing:
        return [f"{type(sensor).__name__} has no {', '.join(missing)}; a sensor has {', '.join(_PARTS)}"]
    try:
        return _declaration_faults(sensor) or _faults(sensor, world)
    except PLUG_IN_ERRORS as error:  # whatever a plug-in raises is what its author wants to read
        return [raised(error)]


def _faults(sensor: Sensor, world: SnapshotSource) -> list[str]:
    faults: list[str]
    before = _global_stream()
    first, copies, faults = _watch(sensor, world)
    second, _, _ = _watch(sensor, world)
    if _global_stream() != before:
        faults.append("draws from numpy's global random stream; only the generator handed in may be used")
    for reading, copy, again in zip(first, copies, second, strict=True):
        stamp_ns = reading.observation.stamp_ns
        if not _same(_arrays(reading), copy):
            faults.append(
                f"the reading stamped {stamp_ns} changed when a later one was taken; give each its own arrays"
            )
        if not _same(copy, _arrays(again)):
            faults.append(f"the reading at {stamp_ns} differs from one with the same generator, state and world")
        faults += _reading_faults(sensor, reading)
    return list(dict.fromkeys(faults))


def _global_stream() -> bytes:
    """Return numpy's global random state, which no sensor may touch."""
    return pickle.dumps(np.random.get_state())  # noqa: NPY002


def _declaration_faults(sensor: Sensor) -> list[str]:
    faults = []
    if not isinstance(sensor.name, str) or not sensor.name:
        faults.append(f"name is {sensor.name!r}; a non-empty string is expected")
    instants = np.asarray(sensor.instants_s, dtype=float)
    if instants.ndim != 1 or not instants.size or not np.isfinite(instants).all() or instants[0] < 0:
        faults.append(f"instants_s is {sensor.instants_s!r}; at least one finite offset from 0 s on is expected")
    elif np.any(np.diff(instants) < 0):
        faults.append(f"instants_s is {sensor.instants_s!r}; ascending offsets are expected")
    if not isinstance(sensor.rig_sensor(), LaserSensor | CameraSensor | FloorSensor | OdometrySensor):
        faults.append(f"rig_sensor() is {type(sensor.rig_sensor()).__name__}; a trackers.rig.RigSensor is expected")
    elif sensor.rig_sensor() != sensor.rig_sensor():
        faults.append("rig_sensor() differs from call to call; a sensor on the rig does not change")
    return faults


def _watch(sensor: Sensor, world: SnapshotSource) -> tuple[list[Reading], list[dict[str, NDArray]], list[str]]:
    """Take readings at a few stamps from a fresh state; return them, copies made before the next was taken, and faults."""
    rng = np.random.default_rng(_SEED)
    state, readings, copies, faults = None, [], [], []
    for stamp_ns in _STAMPS_NS:
        looks: list[tuple[Snapshot, dict[str, NDArray]]] = []  # each snapshot, and a copy of its initial state
        given: object = sensor.observe(stamp_ns, _hand_out(sensor, world, stamp_ns, looks, faults), state, rng)
        if not (isinstance(given, tuple) and len(given) == 2 and isinstance(given[0], Reading)):
            faults.append(f"observe() gave {_kind(given)}; a Reading and the state for the next call are expected")
            break
        reading, state = given
        if looks:
            faults += _meddling_faults(*looks[-1])
        if len(looks) != len(sensor.instants_s):
            faults.append(f"took {len(looks)} of the {len(sensor.instants_s)} instants it declares")
        if reading.observation.stamp_ns != stamp_ns or not isinstance(reading.observation.stamp_ns, int):
            faults.append(f"stamped its reading {reading.observation.stamp_ns!r}, not {stamp_ns} as asked")
        if reading.observation.sensor != sensor.name:
            faults.append(f"signed its reading {reading.observation.sensor!r}, not {sensor.name!r}")
        readings.append(reading)
        copies.append({key: value.copy() for key, value in _arrays(reading).items()})
    return readings, copies, faults


def _kind(value: object) -> str:
    inside = f" of {', '.join(type(each).__name__ for each in value)}" if isinstance(value, tuple) else ""
    return f"{type(value).__name__}{inside}"


def _hand_out(
    sensor: Sensor,
    world: SnapshotSource,
    stamp_ns: int,
    looks: list[tuple[Snapshot, dict[str, NDArray]]],
    faults: list[str],
) -> Iterator[Snapshot]:
    """Yield the snapshots a sensor asks for, noted in `looks`, and check each when the next is asked for."""
    for offset in sensor.instants_s:
        snapshot = world.snapshot(stamp_ns / NS_PER_S + offset)
        looks.append((snapshot, _world_state(snapshot)))
        yield snapshot
        faults.extend(_meddling_faults(*looks[-1]))


def _meddling_faults(snapshot: Snapshot, before: dict[str, NDArray]) -> list[str]:
    if _same(before, _world_state(snapshot)):
        return []
    return [f"changes the world it looks at (at {snapshot.t:g} s); snapshots are read-only"]


def _world_state(snapshot: Snapshot) -> dict[str, NDArray]:
    data, model = snapshot.data, snapshot.model
    arrays = {
        "qpos": data.qpos,
        "geom_xpos": data.geom_xpos,
        "geom_rgba": model.geom_rgba,
        "geom_size": model.geom_size,
    }
    return {name: array.copy() for name, array in arrays.items()} | {"person_of_geom": snapshot.person_of_geom.copy()}


def _arrays(reading: Reading) -> dict[str, NDArray]:
    """Return the arrays of a reading by name, those of its observation and of its truth."""
    observed = {each.name: getattr(reading.observation, each.name) for each in fields(reading.observation)}
    truth = {f"truth {name}": array for name, array in reading.truth.items()}
    return {name: array for name, array in observed.items() if isinstance(array, np.ndarray)} | truth


def _same(one: dict[str, NDArray], other: dict[str, NDArray]) -> bool:
    """Return True where two sets of arrays agree to the bit."""
    return one.keys() == other.keys() and all(
        one[name].dtype == other[name].dtype
        and one[name].shape == other[name].shape
        and one[name].tobytes() == other[name].tobytes()
        for name in one
    )


def _reading_faults(sensor: Sensor, reading: Reading) -> list[str]:
    match reading.observation, sensor.rig_sensor():
        case LaserScan() as scan, LaserSensor():
            return _scan_faults(scan, reading.truth)
        case Image() as image, (FisheyeSensor() | PinholeSensor()) as rig:
            return _picture_faults(image.rgb, rig)
        case DepthImage() as image, StereoSensor() as rig:
            return _picture_faults(image.rgb, rig) + _depth_faults(image.depth_m)
        case FloorFrame() as frame, FloorSensor() as rig:
            return _floor_faults(frame, reading.truth, rig)
        case Odometry(), OdometrySensor():
            return _odometry_faults(reading.truth)
        case observation, rig:
            return [f"reports {type(observation).__name__}, which does not go with {type(rig).__name__} on the rig"]


def _picture_faults(rgb: NDArray, rig: CameraSensor) -> list[str]:
    shape = (rig.intrinsics.height, rig.intrinsics.width, 3)
    if rgb.dtype != np.uint8 or rgb.shape != shape:
        return [f"image is {rgb.dtype} {rgb.shape}; uint8 {shape} is expected of its intrinsics"]
    return []


def _depth_faults(depth_m: NDArray) -> list[str]:
    faults = []
    if depth_m.dtype != np.float32:
        faults.append(f"depth is {depth_m.dtype}; float32 is expected")
    if not (np.isfinite(depth_m) & (depth_m >= 0)).all():
        faults.append("depth holds values that are no distance; metres from 0 on, 0 where there is none, are expected")
    return faults


def _scan_faults(scan: LaserScan, truth: dict[str, NDArray]) -> list[str]:
    faults = []
    ranges = scan.ranges_m
    if ranges.dtype != np.float32:
        faults.append(f"ranges are {ranges.dtype}; float32, as in the message, is expected")
    finite = ranges[np.isfinite(ranges)]
    if np.isneginf(ranges).any() or (finite < scan.range_min_m).any() or (finite > scan.range_max_m).any():
        faults.append(
            f"ranges leave [{scan.range_min_m:g}, {scan.range_max_m:g}] m; "
            "+inf (no return) or NaN (invalid) is expected there"
        )
    person = truth.get("person_of_ray")
    if person is None:
        faults.append("truth holds no person_of_ray; the id of the person that each ray meets is expected")
    elif person.dtype != np.int16 or person.shape != ranges.shape or (person < 0).any():
        faults.append(
            f"person_of_ray is {person.dtype} {person.shape}; int16 {ranges.shape} of ids, 0 for no person, is expected"
        )
    return faults


def _odometry_faults(truth: dict[str, NDArray]) -> list[str]:
    true = truth.get("frame_from_base")  # the observation has checked its own pose
    if true is None or true.dtype != np.float64 or true.shape != (4, 4) or not np.isfinite(true).all():
        return [f"truth frame_from_base is {true!r}; a transform, finite float64 (4, 4), is expected"]
    return []


def _floor_faults(frame: FloorFrame, truth: dict[str, NDArray], rig: FloorSensor) -> list[str]:
    shape = (rig.rows, rig.columns)
    faults = []
    if frame.values.dtype != np.uint8 or frame.values.shape != shape:
        faults.append(f"values are {frame.values.dtype} {frame.values.shape}; uint8 {shape} is expected of its grid")
    missing = [name for name in ("load_n", "person", "foot", "cell", "newton") if name not in truth]
    if missing:
        return [*faults, f"truth holds no {', '.join(missing)}; every floor knows who loads which element"]
    load_n, cell, newton = truth["load_n"], truth["cell"], truth["newton"]
    if load_n.dtype != np.float64 or load_n.shape != shape or not (np.isfinite(load_n) & (load_n >= 0)).all():
        return [*faults, f"load_n is {load_n.dtype} {load_n.shape}; float64 {shape} of newtons from 0 on is expected"]
    lengths = {truth[name].shape for name in ("person", "foot", "cell", "newton")}
    if len(lengths) > 1 or len(next(iter(lengths))) != 1:
        return [*faults, "person, foot, cell and newton differ in shape; one row of the same length is expected"]
    if cell.size and not (cell.min() >= 0 and cell.max() < load_n.size):
        return [*faults, f"cell holds {cell.min()} to {cell.max()}; 0 to {load_n.size - 1} is expected of the grid"]
    by_cell = np.bincount(cell, weights=newton, minlength=load_n.size).reshape(shape)
    if np.abs(by_cell - load_n).max() > _SAME_LOAD_N:
        faults.append("load_n is not the sum of the newtons that people put on each cell")
    return faults


def check_rendering(room: Path) -> Iterator[str]:
    """Yield renderer, version of OpenGL and time of a frame of a room; raise InputError, with a remedy, where none renders."""
    import mujoco

    from twin.sensors.render import OffscreenRenderer
    from twin.sensors.render_scene import RenderView

    model = mujoco.MjModel.from_xml_path(str(room))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    with OffscreenRenderer(model) as renderer:
        info = renderer.gl_info()
        yield f"renderer    {info.renderer}"
        yield f"OpenGL      {info.version}"
        pixels = np.zeros((_SIDE_PX, _SIDE_PX, 4), dtype=np.uint8)
        ahead = RenderView((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), -1.0, 1.0, -1.0, 1.0, (0, 0, _SIDE_PX, _SIDE_PX))
        spent_ms = []
        for _ in range(_FRAMES):
            start = time.perf_counter()
            renderer.render(data, np.array([0.0, 0.0, 1.05]), [ahead], pixels)
            spent_ms.append(1e3 * (time.perf_counter() - start))
    yield f"frame time  {np.median(spent_ms):.1f} ms for {_SIDE_PX} × {_SIDE_PX} of the {room.stem}"
