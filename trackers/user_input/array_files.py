"""Untrusted files of arrays (.npz): headers are checked before an array is decoded, against decompression bombs."""

from __future__ import annotations

import io
import math
import struct
import sys
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from trackers.arrays import AnyArray
from trackers.errors import InputError
from trackers.user_input.text_file import AnyPath, as_path, check_limit

_WORDS = {"U": "text is", "iu": "whole numbers are", "u": "bytes are", "f": "numbers are", "b": "booleans are"}
_LONGEST_HEADER = 10_000
"""Greatest length of an array's header; numpy's own limit."""
_LONGEST_TEXT = 1000
_MOST_NAMES = 20
_CHUNK_BYTES = 2**20

_DAMAGED = (
    zipfile.BadZipFile,
    zipfile.LargeZipFile,
    zlib.error,
    struct.error,
    tokenize.TokenError,
    EOFError,
    KeyError,
    LookupError,
    MemoryError,  # a header of nested brackets
    RecursionError,
    RuntimeError,  # an encrypted file, or a compression unknown to zipfile
    SyntaxError,
    TypeError,
    UserWarning,
    ValueError,
)
"""Errors of numpy and zipfile on files cut or overwritten anywhere."""


@dataclass(frozen=True)
class ArraySpec:
    """Requirements on an array of a file.

    kinds: numpy's letters of permitted types. shape: sizes; None is any number, a name one number throughout the file. low,
    high: range of its numbers. may_be_nan: NaN allowed, for unknown values. most: greatest number of values.
    """

    kinds: str
    shape: tuple[int | str | None, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    may_be_nan: bool = False
    most: float = 100_000


@dataclass(frozen=True)
class _Header:
    """Header of an array, and its `length` [bytes]."""

    shape: tuple[int, ...]
    fortran_order: bool
    dtype: np.dtype[Any]
    length: int


def read_arrays(path: AnyPath, specs: Mapping[str, ArraySpec], expected: str) -> dict[str, AnyArray]:
    """Read the arrays named in `specs` from an .npz, ignoring others.

    Types, shapes and sizes are checked in the headers, before decoding; ranges afterwards. Raises InputError naming the
    file, the array, its content and what is expected.
    """
    path = as_path(path, expected)
    try:
        with path.open("rb") as file:
            if file.read(6) == b"\x93NUMPY":
                raise InputError(f"{path}: is one array, not an .npz of several; {expected} is expected")
            with zipfile.ZipFile(file) as archive:
                members = {info.filename: info for info in archive.infolist()}
                missing = [name for name in specs if f"{name}.npy" not in members]
                if missing:
                    held = ", ".join(sorted(name.removesuffix(".npy") for name in members)[:_MOST_NAMES]) or "nothing"
                    raise InputError(f"{path}: {missing[0]} is missing; it holds {held}; {expected} is expected")
                headers = {name: _header(archive, members[f"{name}.npy"]) for name in specs}
                _check_headers(headers, specs, path)
                arrays = {name: _decoded(archive, members[f"{name}.npy"], headers[name]) for name in specs}
    except InputError:
        raise
    except OSError as error:
        reason = error.strerror or "not an .npz"
        raise InputError(f"{path}: cannot be read ({reason}); {expected} is expected") from error
    except _DAMAGED as error:
        raise InputError(f"{path}: is not an .npz, or a damaged one; {expected} is expected") from error
    for name, spec in specs.items():
        _check_range(name, arrays[name], spec, path)
    return arrays


def _header(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> _Header:
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError("numpy packs arrays by no other way")
    with archive.open(member) as stream:
        start = io.BytesIO(stream.read(_LONGEST_HEADER))
    version = np.lib.format.read_magic(start)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version} of an array's header")
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # numpy warns where it guesses
        shape, fortran_order, dtype = read(start)
    header = _Header(shape, fortran_order, dtype, start.tell())
    if any(size < 0 for size in header.shape):
        raise ValueError("a size below 0")
    return header


def _check_headers(headers: Mapping[str, _Header], specs: Mapping[str, ArraySpec], path: Path) -> None:
    """Raise InputError for an array of another type, shape or size."""
    sizes: dict[str, int] = {}
    for name, spec in specs.items():
        header = headers[name]
        if header.dtype.kind not in spec.kinds or not header.dtype.isnative:
            raise InputError(f"{path}: {name} holds {header.dtype}; {_WORDS[spec.kinds]} expected")
        wanted = [sizes.get(size, size) if isinstance(size, str) else size for size in spec.shape]
        fits = len(header.shape) == len(wanted) and all(
            want == have for want, have in zip(wanted, header.shape, strict=True) if isinstance(want, int)
        )
        if not fits:
            written = ", ".join("n" if size is None else str(size) for size in wanted)
            raise InputError(f"{path}: {name} has shape {header.shape}; ({written}) is expected")
        sizes |= {size: have for size, have in zip(spec.shape, header.shape, strict=True) if isinstance(size, str)}
        n_value = math.prod(header.shape)
        check_limit(n_value, spec.most, f"{path}: {name} has", "values")
        if header.dtype.kind == "U" and header.dtype.itemsize > 4 * _LONGEST_TEXT:
            raise InputError(
                f"{path}: {name} is a text of {header.dtype.itemsize // 4} characters; at most {_LONGEST_TEXT} are expected"
            )


def _decoded(archive: zipfile.ZipFile, member: zipfile.ZipInfo, header: _Header) -> AnyArray:
    """Read the array. Raises ValueError for a member of another length than its header says."""
    shape = header.shape[::-1] if header.fortran_order else header.shape
    n_byte = math.prod(shape) * header.dtype.itemsize
    if member.file_size != header.length + n_byte:
        raise ValueError(f"{member.file_size - header.length} bytes in place of {n_byte}")
    content = bytearray(n_byte)
    view, at = memoryview(content), 0
    with archive.open(member) as stream:
        stream.read(header.length)
        while part := stream.read(_CHUNK_BYTES):  # to the end, where its checksum is verified
            view[at : at + len(part)] = part
            at += len(part)
    if at != n_byte:
        raise EOFError
    array = np.frombuffer(content, header.dtype).reshape(shape)
    return array.T if header.fortran_order else array


def _check_range(name: str, array: AnyArray, spec: ArraySpec, path: Path) -> None:
    """Raise InputError for invalid text, and for a number that is not finite or out of range."""
    if array.dtype.kind == "U":
        code = np.frombuffer(array.tobytes(), np.uint32)
        if ((code > sys.maxunicode) | ((code >= 0xD800) & (code <= 0xDFFF))).any():  # the latter: half a surrogate pair
            raise InputError(f"{path}: {name} is no text; one is expected")
        return
    if array.dtype.kind == "b":
        array = array.view(np.uint8)
        spec = replace(spec, low=0, high=1)
    bad = (array < spec.low) | (array > spec.high)
    if array.dtype.kind == "f":
        bad |= np.isinf(array) if spec.may_be_nan else ~np.isfinite(array)
    if bad.any():
        bounds = "" if math.isinf(spec.high) else f" from {spec.low:g} to {spec.high:g}"
        raise InputError(f"{path}: {name} holds {array[bad].flat[0]}; finite numbers{bounds} are expected")
