"""Files of arrays that are damaged, bombs or of something else are refused in a sentence, each file that we read alike."""

from __future__ import annotations

import io
import random
import tracemalloc
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from box_room import box_room_cloud

from trackers.environment import (
    EnvironmentOptions,
    build as environment_file,
    build_environment,
    load_environment,
    save_environment,
)
from trackers.errors import InputError
from trackers.user_input.text_file import NO_LIMITS
from trackers.vision.head_colours import SHIPPED as HEADS, load_head_model
from trackers.vision.person_detector import SHIPPED as PEOPLE, PersonModel

LOADERS: dict[str, Callable[[Path], Any]] = {
    "environment": load_environment,
    "heads": load_head_model.__wrapped__,
    "people": PersonModel.load,
}


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("environment") / "boxes.npz"
    save_environment(
        build_environment(box_room_cloud(step_deg=3.0), room="boxes", options=EnvironmentOptions(voxel_m=0.2)), path
    )
    return path


@pytest.fixture(params=LOADERS)
def kind(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def whole(kind: str, environment: Path) -> Path:
    return {"environment": environment, "heads": HEADS, "people": PEOPLE}[kind]


def held_by(path: Path) -> dict[str, np.ndarray]:
    with np.load(path) as archive:
        return {name: archive[name] for name in archive.files}


def plain(value: Any) -> Any:
    """All that a loaded value holds, to be compared to the bit."""
    if is_dataclass(value):
        return [plain(getattr(value, each.name)) for each in fields(value)]
    return (value.dtype.str, value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value


def refused(kind: str, path: Path) -> str:
    with pytest.raises(InputError) as caught:
        LOADERS[kind](path)
    said = str(caught.value)
    assert said.startswith(f"{path}: ") and "expected" in said and "\n" not in said
    return said


def written(
    path: Path,
    members: Mapping[str, bytes | np.ndarray],
    how: int = zipfile.ZIP_DEFLATED,
    arrays_how: int | None = None,
) -> Path:
    """An .npz of arrays, or of bytes in their place; `arrays_how`: that arrays are packed otherwise than bytes."""
    with zipfile.ZipFile(path, "w", how, compresslevel=1) as archive:
        for name, content in members.items():
            stream = io.BytesIO()
            if isinstance(content, bytes):
                stream.write(content)
            else:
                np.lib.format.write_array(stream, content, allow_pickle=True)
            compress_type = how if arrays_how is None or isinstance(content, bytes) else arrays_how
            archive.writestr(f"{name}.npy", stream.getvalue(), compress_type)
    return path


def header(dtype: str, shape: tuple[int, ...]) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": dtype, "fortran_order": False, "shape": shape})
    return stream.getvalue()


def test_a_file_that_is_changed_anywhere_is_refused_or_holds_the_same(kind: str, whole: Path, tmp_path: Path) -> None:
    content, same, path = whole.read_bytes(), plain(LOADERS[kind](whole)), tmp_path / "spoiled.npz"
    rng, said = random.Random(1), []
    places = [*range(0, 120, 3), *range(len(content) - 600, len(content), 7), *rng.choices(range(len(content)), k=60)]
    for at in places:
        path.write_bytes(content[:at] + bytes([content[at] ^ (1 << rng.randrange(8))]) + content[at + 1 :])
        try:
            assert plain(LOADERS[kind](path)) == same, at
        except InputError as error:
            said.append(str(error))
    assert all(each.startswith(f"{path}: ") and "expected" in each for each in said)
    assert len(said) > len(places) / 3, "the arrays have checksums"


def test_a_file_that_is_cut_anywhere_is_refused(kind: str, whole: Path, tmp_path: Path) -> None:
    content, path = whole.read_bytes(), tmp_path / "cut.npz"
    for at in [0, 1, 6, *random.Random(2).choices(range(len(content)), k=40), len(content) - 1]:
        path.write_bytes(content[:at])
        assert "is not an .npz, or a damaged one" in refused(kind, path)


@pytest.mark.parametrize("how", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_a_file_packed_again_holds_the_same(kind: str, whole: Path, tmp_path: Path, how: int) -> None:
    arrays = held_by(whole)
    again = written(tmp_path / "again.npz", {name: array.copy(order="F") for name, array in arrays.items()}, how)
    assert plain(LOADERS[kind](again)) == plain(LOADERS[kind](whole))


def test_a_bomb_in_any_array_is_refused_before_it_is_decoded(kind: str, whole: Path, tmp_path: Path) -> None:
    arrays = held_by(whole)
    for name, array in arrays.items():
        is_first = name == next(iter(arrays))  # the longest headers, which take long to refuse, in one array alone
        nested = b"(" * (9000 if is_first else 300)
        shape = (*array.shape[:-1], 10**12) if array.ndim else ()
        text = f"<U{10**8}" if array.dtype.kind == "U" else array.dtype.str
        for bomb in (
            header(text, shape) + bytes(200_000),
            header(array.dtype.str, (10**6,) * max(array.ndim, 1)) + bytes(200_000),
            b"\x93NUMPY\x02\x00" + (2**31).to_bytes(4, "little") + b" " * (8_000_000 if is_first else 20_000),
            b"\x93NUMPY\x01\x00" + (9000).to_bytes(2, "little") + nested.ljust(9000),
        ):
            path = written(tmp_path / "bomb.npz", arrays | {name: bomb}, arrays_how=zipfile.ZIP_STORED)
            tracemalloc.start()
            said = refused(kind, path)
            _, peak = tracemalloc.get_traced_memory()
            tracemalloc.stop()
            assert peak < 5_000_000, (name, said)
            assert "damaged" in said or f": {name} " in said, said


def other_arrays(array: np.ndarray) -> dict[str, np.ndarray]:
    """The same in another type or shape, or with numbers that stand for nothing."""
    other = {
        "objects": np.full(array.shape, None),
        "complex": np.zeros(array.shape, complex),
        "a list more": array[None],
        "bytes": np.full(array.shape, b"x"),
        "dates": np.zeros(array.shape, "M8[s]"),
        "records": np.zeros(array.shape, [("a", "f8"), ("b", "i4")]),
    }
    if array.dtype.kind == "f":
        infinite, huge = np.full_like(array, np.inf), np.full_like(array, 3e38)
        other |= {"infinite": infinite, "huge": huge, "below": -huge, "text": array.astype(str)}
        other["swapped"] = array.astype(array.dtype.newbyteorder(">"))
    return other


def test_another_array_in_place_of_any_is_refused_by_its_name(kind: str, whole: Path, tmp_path: Path) -> None:
    arrays = held_by(whole)
    for name, array in arrays.items():
        without = {other: each for other, each in arrays.items() if other != name}
        assert f": {name} is missing" in refused(kind, written(tmp_path / "s.npz", without))
        for what, other in other_arrays(array).items():
            if other.size:
                said = refused(kind, written(tmp_path / "s.npz", arrays | {name: other}))
                assert f": {name} " in said, (what, said)


def test_nan_is_refused_where_it_stands_for_nothing(kind: str, whole: Path, tmp_path: Path) -> None:
    arrays = held_by(whole)
    for name, array in arrays.items():
        if array.dtype.kind == "f" and array.size and name not in ("top_m", "ceiling_m"):
            spoiled = array.copy()
            spoiled.flat[-1] = np.nan
            assert f": {name} holds nan; finite numbers" in refused(
                kind, written(tmp_path / "s.npz", arrays | {name: spoiled})
            )


@pytest.mark.parametrize("how", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_ways_of_packing_that_know_no_bounds_are_refused(kind: str, whole: Path, tmp_path: Path, how: int) -> None:
    assert "damaged" in refused(kind, written(tmp_path / "s.npz", held_by(whole), how))


def test_what_lies_beside_the_arrays_is_left_alone(kind: str, whole: Path, tmp_path: Path) -> None:
    beside = {"../../victim": b"x", "more": np.full(3, None), "bomb": header("<f8", (10**12,)) + bytes(1000)}
    path = written(tmp_path / "s.npz", held_by(whole) | beside)
    assert plain(LOADERS[kind](path)) == plain(LOADERS[kind](whole))


def test_rows_of_colours_that_are_no_shares_are_refused(tmp_path: Path) -> None:
    arrays = held_by(HEADS)
    path = written(tmp_path / "s.npz", arrays | {"common": arrays["common"] / 2})
    assert "common has rows that sum to" in refused("heads", path)
    path = written(tmp_path / "s.npz", arrays | {"skin": header("|b1", arrays["skin"].shape) + b"\x07" * 46080})
    assert "skin holds 7; finite numbers from 0 to 1" in refused("heads", path)


def test_a_text_that_is_none_is_refused(environment: Path, tmp_path: Path) -> None:
    for code in (0x110000, 0xD800, 2**32 - 1):
        room = header("<U1", ()) + code.to_bytes(4, "little")
        path = written(tmp_path / "s.npz", held_by(environment) | {"room": room})
        assert "room is no text" in refused("environment", path)


def test_a_grid_of_too_many_voxels_is_refused_unless_the_limits_are_lifted(
    environment: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(environment_file._ARRAYS, "state", replace(environment_file._ARRAYS["state"], most=1000))
    with pytest.raises(InputError, match=r"state has \d+ values; at most 1000, or --no-limits, is expected"):
        load_environment(environment)
    monkeypatch.setenv(NO_LIMITS, "1")
    assert load_environment(environment).room == "boxes"
