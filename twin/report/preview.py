"""Preview video: the cameras' images with tracks, beside the room from above; an H.264 file, named when complete."""

from __future__ import annotations

import contextlib
import errno
import os
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from math import ceil, sqrt
from pathlib import Path
from types import TracebackType
from typing import Self

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.observations import NS_PER_S
from trackers.tracks import Track
from twin.recording.atomic_file import partial_path, unwritable
from twin.report.birdseye import SHIFT, Site, fixed_point, plan_width_px
from twin.report.camera_panel import MOST_CAMERAS, CameraGrid, widest_aspect
from twin.report.floor_panel import BACKDROP, INK, PRESSED, QUIET, FloorPanel, PreviewFrame
from twin.report.palette import BOLD, IdentityColours, encode_jpeg, text_width, write
from twin.report.time_axis import format_time, time_origin_ns

TIME_BASE = Fraction(1, 90_000)
"""Unit of a picture's time in the file [s]."""


class VideoFile:
    """H.264 (yuv420p) in MP4, ready to stream; a context manager.

    The file takes its name when the block ends normally; an exception or a kill leaves nothing under that name. Raises
    InputError where it cannot be written, and later where the disk is full.
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
            raise unwritable(path, error) from error
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

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None and self._pictures:
            self._close()
        else:
            self._discard()

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
            raise unwritable(self._path, error) from error

    def _close(self) -> None:
        """Finish the file and give it its name."""
        try:
            self._mux(None)
            try:
                self._container.close()
                os.replace(self._partial, self._path)
            except OSError as error:
                raise unwritable(self._path, error) from error
        except BaseException:
            self._discard()
            raise

    def _discard(self) -> None:
        """Delete the unfinished file."""
        # A full disk prevents the trailer too; the file is deleted anyway.
        with contextlib.suppress(OSError):
            self._container.close()
        self._partial.unlink(missing_ok=True)


_HEADER_PX = 44
_FOOTER_PX = 28
_LEGEND_PX = 460
"""Least width of the plan, for what is written below it."""
TAIL_S = 2
"""Length of the tail behind each track."""
_MARK_PX, _GAP_PX = 16, 20
"""Of the legend: from a mark to its name, and from a name to the next mark."""


def fitting_size(site: Site, height_px: int) -> tuple[tuple[int, int], int]:
    """Return the size of a picture of this height without empty borders, and the width of the cameras' part [px]."""
    cameras = dict(list(site.rig.cameras().items())[:MOST_CAMERAS])
    left = 0
    if cameras:
        across = ceil(sqrt(len(cameras)))
        tile = (height_px - _HEADER_PX) / ceil(len(cameras) / across)
        left = round(across * tile * widest_aspect(cameras))
    right = max(plan_width_px(site.rig, site.outline, height_px - _HEADER_PX - _FOOTER_PX, site.shown), _LEGEND_PX)
    return (left + right + (left + right) % 2, height_px), left


class PreviewWriter:
    """Writer of `preview.mp4` (one picture per call of `frame`) in constant memory; a context manager as `VideoFile`.

    Each picture is shown at its stamp, so the video plays in real time also where frames are missing; `fps`: usual frame
    rate. Up to nine cameras are shown; without one the bird's-eye view fills the picture. `camera_width_px`: of the cameras'
    part (default: as wide as high).

    Raises InputError where the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        site: Site,
        *,
        fps: float,
        tracker: str = "",
        title: str = "",
        size: tuple[int, int] = (1280, 640),
        camera_width_px: int | None = None,
    ) -> None:
        if size[0] % 2 or size[1] % 2:
            raise ValueError(f"size {size}: H.264 needs an even width and height")
        cameras = site.rig.cameras()
        self._rig = site.rig
        self._colours = IdentityColours()
        self._canvas = np.full((size[1], size[0], 3), BACKDROP, dtype=np.uint8)
        self._camera = None
        left = 0
        if cameras:
            high = size[1] - _HEADER_PX
            left = camera_width_px if camera_width_px is not None else high
            self._camera = CameraGrid(cameras, (left, high))
        high = size[1] - _HEADER_PX - _FOOTER_PX
        self._floor = FloorPanel(site, size[0] - left, high)
        self._tails: dict[int, deque[tuple[int, float, float]]] = {}
        self._tail_ns = TAIL_S * NS_PER_S
        self._first_ns: int | None = None
        self._pts = -1
        self.n_frames = 0
        """Number of pictures written."""
        self._encoder = VideoFile(path, size, fps)
        write(self._canvas, tracker, 16, 29, INK, 20, BOLD)
        write(self._canvas, title, 16 + (text_width(tracker, 20, BOLD) + 14 if tracker else 0), 29, QUIET, 16)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._encoder.__exit__(kind, error, trace)

    def frame(self, stamp_ns: int, frame: PreviewFrame) -> None:
        """Draw and encode one frame; stamps must rise.

        A camera without an image keeps the one before. Maps are drawn over the images, hypotheses over the floor too. Raises
        InputError where the disk is full.
        """
        if self._first_ns is None:
            self._first_ns = stamp_ns
            self._write_legend(with_truth=frame.truth is not None)
        pts = round((stamp_ns - self._first_ns) / NS_PER_S / TIME_BASE)
        if pts <= self._pts:
            raise ValueError(f"frame at {stamp_ns} ns is not later than the one before")
        self._pts = pts
        tracks = sorted(frame.tracks, key=lambda track: track.id)
        ids = [track.id for track in tracks]
        self._colours.add(ids)
        frame = replace(frame, tracks=tracks, maps=[each for each in frame.maps if each.id in ids])
        self._extend_tails(stamp_ns, tracks)
        height, width = self._canvas.shape[:2]
        left = 0
        if self._camera is not None:
            left = self._camera.width_px
            panel = self._canvas[_HEADER_PX:, :left]
            self._camera.draw(panel, frame, self._colours)
        panel = self._canvas[_HEADER_PX : height - _FOOTER_PX, left:]
        self._floor.draw(panel, frame, self._colours, self._tails)
        clock = self._canvas[6 : _HEADER_PX - 6, width - 130 :]
        clock[:] = BACKDROP
        write(
            clock,
            format_time((stamp_ns - time_origin_ns(self._first_ns)) / NS_PER_S, decimals=1),
            114,
            24,
            INK,
            20,
            BOLD,
            "right",
        )
        self._encoder.encode(self._canvas, pts)
        self.n_frames += 1

    def still(self, quality: int = 88) -> bytes:
        """Encode the last picture as a JPEG, for the report; raises ValueError before the first."""
        if self.n_frames == 0:
            raise ValueError("no frame has been drawn yet")
        return encode_jpeg(self._canvas, quality)

    def _extend_tails(self, stamp_ns: int, tracks: Sequence[Track]) -> None:
        alive = {track.id for track in tracks}
        for ended in [track_id for track_id in self._tails if track_id not in alive]:
            del self._tails[ended]
        for track in tracks:
            tail = self._tails.setdefault(track.id, deque())
            tail.append((stamp_ns, track.x, track.y))
            while tail[0][0] < stamp_ns - self._tail_ns:
                tail.popleft()

    def _write_legend(self, with_truth: bool) -> None:
        height, width = self._canvas.shape[:2]
        x, y = width - self._floor.width_px + 14.0, height - 10
        layers = self._floor.layers.items()
        sensors = [("dot", colour, name if "scan" in name else f"{name} scan") for name, colour in layers]
        sensors += [("square", PRESSED, name) for name in self._rig.floors()]
        marks = [("disc", INK, "track"), *([("ring", INK, "truth")] if with_truth else [])]
        entries = [*sensors, *marks]
        while (
            sensors and sum(_MARK_PX + text_width(label, 14) + _GAP_PX for *_, label in entries) - _GAP_PX > width - x
        ):
            sensors.pop()  # too many for the width: dots say that there are more
            entries = [*sensors, ("", QUIET, "…"), *marks]
        for kind, colour, label in entries:
            centre = fixed_point(np.array([x + 5, y - 5.0])).tolist()
            radius = (3 if kind == "dot" else 6) << SHIFT
            if kind == "square":
                cv2.rectangle(self._canvas, (round(x) - 1, y - 11), (round(x) + 11, y + 1), colour, -1)
            elif kind:
                cv2.circle(self._canvas, centre, radius, colour, 1 if kind == "ring" else -1, cv2.LINE_AA, SHIFT)
            write(self._canvas, label, x + _MARK_PX, y, QUIET, 14)
            x += _MARK_PX + text_width(label, 14) + _GAP_PX
