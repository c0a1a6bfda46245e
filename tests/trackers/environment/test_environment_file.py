"""An environment's file: what goes in comes out, and what is no such file, or of another room, is refused."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
from box_room import box_room_cloud

from trackers.environment import build_environment, load_environment, save_environment
from trackers.errors import InputError
from trackers.rig import LaserSensor, Rig

AREA = ((-1.8, -1.3), (1.8, -1.3), (1.8, 1.3), (-1.8, 1.3))
ARRAYS = ("area_m", "stations_m", "state", "surface_m", "top_m", "walls_m")


@pytest.fixture(scope="module")
def environment():
    return build_environment(box_room_cloud(step_deg=1.0), room="boxes", area=AREA)


@pytest.fixture
def path(environment, tmp_path):
    save_environment(environment, tmp_path / "boxes.npz")
    return tmp_path / "boxes.npz"


def rig(area=AREA, room=None):
    return Rig(sensors={"low": LaserSensor(topic="/low/scan")}, area=area, room=room)


def rewritten(path, **changes):
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    arrays |= changes
    np.savez_compressed(path, **{name: value for name, value in arrays.items() if value is not None})
    return path


def test_round_trip(environment, path):
    loaded = load_environment(path)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(loaded, name), getattr(environment, name))
    np.testing.assert_array_equal(loaded.grid.origin_m, environment.grid.origin_m)
    assert (loaded.grid.voxel_m, loaded.grid.shape) == (environment.grid.voxel_m, environment.grid.shape)
    assert (loaded.room, loaded.floor_m, loaded.ceiling_m) == ("boxes", environment.floor_m, environment.ceiling_m)
    points = np.random.default_rng(0).uniform(-3, 3, (500, 3))
    np.testing.assert_array_equal(loaded.head_weight(points), environment.head_weight(points))
    np.testing.assert_array_equal(loaded.distance_to_surface(points), environment.distance_to_surface(points))


def test_the_same_environment_gives_the_same_bytes(environment, path, tmp_path):
    save_environment(environment, tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == path.read_bytes()


def test_the_room_of_the_rig_is_accepted(path):
    assert load_environment(path, rig(room="boxes")).room == "boxes"
    assert load_environment(path, rig()).room == "boxes", "a rig need not name its room"
    assert load_environment(path, rig(area=None)).room == "boxes"


def test_another_room_is_refused_by_name(path):
    with pytest.raises(InputError, match=r"boxes.npz: is of the room 'boxes'; one of 'lab' is expected"):
        load_environment(path, rig(room="lab"))


def test_another_room_is_refused_by_its_bounds(path):
    far = ((-1.0, 0.0), (5.0, 0.0), (5.0, 2.0))
    with pytest.raises(InputError, match=r"and not to the corner \[5, 0\] of the rig's area; .* is expected"):
        load_environment(path, rig(area=far))


def test_an_area_that_was_not_seen_is_refused(environment, tmp_path):
    # A neighbour: the same bounds, but most of the floor lies behind a wall and was never seen.
    blind = np.where(np.arange(environment.grid.shape[0])[:, None] > 30, np.nan, environment.top_m).astype(np.float32)
    save_environment(replace(environment, top_m=blind), tmp_path / "blind.npz")
    with pytest.raises(InputError, match=r"the scanner saw \d+% of the rig's area; 80% or more"):
        load_environment(tmp_path / "blind.npz", rig())


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match=r"none.npz: cannot be read \(No such file"):
        load_environment(tmp_path / "none.npz")


@pytest.mark.parametrize("content", [b"", b"no archive at all", b"PK\x03\x04 and then nonsense"])
def test_no_npz(tmp_path, content):
    (tmp_path / "room.npz").write_bytes(content)
    with pytest.raises(InputError, match=r"room.npz: .* `twin environment` .* is expected"):
        load_environment(tmp_path / "room.npz")


def test_a_single_array_is_no_environment(tmp_path):
    np.save(tmp_path / "one.npy", np.zeros(3))
    with pytest.raises(InputError, match=r"one.npy: is one array, not an .npz of several"):
        load_environment(tmp_path / "one.npy")


def test_another_npz(tmp_path):
    np.savez(tmp_path / "other.npz", heights=np.zeros(3))
    with pytest.raises(InputError, match=r"other.npz: format is missing; it holds heights; a file that"):
        load_environment(tmp_path / "other.npz")


def test_a_cut_file(path):
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(InputError, match="is not an .npz, or a damaged one"):
        load_environment(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": np.array(7)}, "version: 7 is not known here; 1 is expected: scan the room again"),
        ({"version": None}, "version is missing; it holds "),
        ({"top_m": None}, "top_m is missing; it holds .*; a file that `twin environment`"),
        ({"surface_m": np.zeros((4, 2))}, r"surface_m has shape \(4, 2\); \(n, 3\) is expected"),
        ({"floor_m": np.array(0.4)}, "fingerprint: the contents are not those that were written"),
    ],
)
def test_a_file_that_was_tampered_with(path, changes, message):
    with pytest.raises(InputError, match=message):
        load_environment(rewritten(path, **changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"surface_m": np.zeros((4, 3), np.float32)}, r"surface_m has 4 points and state \d+ occupied voxels"),
        ({"top_m": np.zeros((2, 2), np.float32)}, r"top_m has shape \(2, 2\); \(\d+, \d+\) is expected"),
        ({"floor_m": np.nan}, "floor_m holds nan; finite numbers from .* are expected"),
        ({"ceiling_m": np.inf}, "ceiling_m holds inf"),
        ({"walls_m": np.full((1, 2, 2), "x")}, "walls_m holds <U1; numbers are expected"),
        (
            {"state": np.full((3, 3, 3), 9, np.uint8), "top_m": np.zeros((3, 3), np.float32)},
            "state holds 9; .* from 0 to 2",
        ),
    ],
)
def test_arrays_that_do_not_fit_together_are_refused_though_the_fingerprint_is_theirs(
    environment, path, changes, message
):
    unfit = copy.copy(environment)  # not made anew: the test run refuses what does not fit together
    vars(unfit).update(changes)
    save_environment(unfit, path)
    with pytest.raises(InputError, match=message):
        load_environment(path)


def test_no_pickles_are_read(tmp_path):
    np.savez(tmp_path / "room.npz", format=np.array([{"a": 1}], dtype=object), version=np.array(1))
    with pytest.raises(InputError, match="format holds object; text is expected"):
        load_environment(tmp_path / "room.npz")
