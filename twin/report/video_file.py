"""H.264 video files that take their name when complete."""

from __future__ import annotations

import contextlib
import errno
import os
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError

TIME_BASE = Fraction(1, 90_000)
"""Unit of a picture's time in the file [s]."""


class VideoFile:
    """H.264 (yuv420p) in MP4, ready to stream; under a hidden name beside the target until `close`.

    Raises InputError where the file cannot be written, and later where the disk is full.
    """

    def __init__(self, path: Path, size: tuple[int, int], fps: float) -> None:
        self._path = path
        self._partial = partial_path(path)
        self._pictures = 0
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            self._container = av.open(str(self._partial), "w", format="mp4", options={"movflags": "+faststart"})
        except OSError as error:
            raise _unwritable(path, error) from error
        rate = Fraction(fps).limit_denominator(1000)
        self._stream = self._container.add_stream("libx264", rate=rate)
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = "yuv420p"
        # A third of veryfast's time for twice its file size: the video is made during the simulation.
        self._stream.options = {"preset": "ultrafast", "crf": "24"}
        codec = self._stream.codec_context
        codec.time_base = TIME_BASE
        codec.gop_size = max(1, round(2 * fps))
        codec.thread_count = 1  # the other core simulates
        codec.colorspace = 6  # BT.601, what cv2.COLOR_RGB2YUV computes
        codec.color_range = 1  # 16–235

    def encode(self, rgb: NDArray[np.uint8], pts: int) -> None:
        """Add a picture (height, width, 3), RGB, shown at `pts` in units of `TIME_BASE`."""
        planes = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2YUV_I420), dtype=np.uint8)
        picture = av.VideoFrame.from_ndarray(planes, format="yuv420p")
        picture.pts = pts
        picture.time_base = TIME_BASE
        self._mux(picture)
        self._pictures += 1

    def _mux(self, picture: av.VideoFrame | None) -> None:
        packets = self._stream.encode(picture)
        try:
            self._container.mux(packets)
        except OSError as error:
            raise _unwritable(self._path, error) from error

    def close(self) -> None:
        """Finish the file and give it its name; without a picture there is no file."""
        if self._pictures == 0:
            self.discard()
            return
        try:
            self._mux(None)
            try:
                self._container.close()
                os.replace(self._partial, self._path)
            except OSError as error:
                raise _unwritable(self._path, error) from error
        except BaseException:
            self.discard()
            raise

    def discard(self) -> None:
        """Delete the unfinished file."""
        # A full disk prevents the trailer too; the file is deleted anyway.
        with contextlib.suppress(OSError):
            self._container.close()
        self._partial.unlink(missing_ok=True)


def partial_path(path: Path) -> Path:
    """Return the hidden path beside a file for writing it until complete."""
    return path.with_name(f".{path.name}.{os.getpid()}.partial")


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(f"{path}: cannot be written ({error.strerror}); a writable place with free space is needed")
