"""Camera half of the preview: the cameras' images with torso windows, score maps, heads and ids of tracks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil, isnan

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.cameras import Ellipsoids
from trackers.observations import DepthImage, Image
from trackers.rig import CameraSensor, placed_camera
from trackers.tracks import Hypotheses, ScoreMap, Track
from twin.report.birdseye import SHIFT, fixed_point
from twin.report.floor_panel import (
    BACKDROP,
    DARK_INK,
    INK,
    QUIET,
    SILENT_FILL,
    PreviewFrame,
    dashed_loop,
    track_tag,
)
from twin.report.palette import IdentityColours, Tag, write, write_tags

TORSO_LOW_M, TORSO_HIGH_M, TORSO_WIDTH_M = 1.0, 1.4, 0.45
"""Torso window drawn around a track, for a person of 1.7 m: heights above the floor, width."""

HEAD_M = (0.10, 0.08, 0.125)
"""Semi-axes of the ellipsoid drawn about a head: ahead, to the side, up."""
_GAZE_M = 0.3

_MAP_FILL = 0.75
"""Opacity of a score map at its maximum."""
_MAPS_ACROSS = 6
"""Tiles at the lower edge, two per score map."""
_SILENT_LIGHT = 0.35
"""Brightness of the last image of a silent camera."""

MOST_CAMERAS = 9
"""More would be too small."""


class CameraGrid:
    """Images of up to nine cameras in tiles of one size, as large as `size_px` (width, height) lets them be."""

    def __init__(self, cameras: Mapping[str, CameraSensor], size_px: tuple[int, int]) -> None:
        shown = dict(list(cameras.items())[:MOST_CAMERAS])
        width, height = size_px
        aspect = widest_aspect(shown)
        layouts = [(across, ceil(len(shown) / across)) for across in range(1, len(shown) + 1)]
        self._across, rows = max(layouts, key=lambda each: min(width / each[0] / aspect, height / each[1]))
        self.width_px = width
        self._tile_px = width // self._across, height // rows
        self._empty = np.full((height, width, 3), BACKDROP, dtype=np.uint8)  # copied ten times as fast as filled
        self._panels = [
            CameraPanel(camera, self._tile_px, name, labelled=len(shown) > 1) for name, camera in shown.items()
        ]

    def draw(self, panel: NDArray[np.uint8], frame: PreviewFrame, colours: IdentityColours) -> None:
        """Draw each camera's newest image (none: the one before; dimmed if silent), score maps and tracks on it."""
        panel[:] = self._empty
        for place, each in enumerate(self._panels):
            row, column = divmod(place, self._across)
            width, height = self._tile_px
            tile = panel[row * height : (row + 1) * height, column * width : (column + 1) * width]
            each.draw(tile, frame, colours)


def widest_aspect(cameras: Mapping[str, CameraSensor]) -> float:
    """Return the greatest width over height of the cameras' pictures."""
    return max(each.intrinsics.width / each.intrinsics.height for each in cameras.values())


class CameraPanel:
    """One camera's image in a tile of `size_px` (width, height), with a torso window and an id on each track."""

    def __init__(self, sensor: CameraSensor, size_px: tuple[int, int], name: str, *, labelled: bool) -> None:
        intrinsics = sensor.intrinsics
        self._tile_px = size_px
        self._sensor_name, self._labelled = name, labelled
        self._scale = min(size_px[0] / intrinsics.width, size_px[1] / intrinsics.height)
        self._size = (round(intrinsics.width * self._scale), round(intrinsics.height * self._scale))
        self._offset = np.array([(size_px[0] - self._size[0]) // 2, (size_px[1] - self._size[1]) // 2])
        self._camera = placed_camera(sensor)
        self._last_px = np.array([intrinsics.width, intrinsics.height]) - 0.5
        self._shown: Image | DepthImage | None = None
        self._view = np.full((size_px[1], size_px[0], 3), BACKDROP, dtype=np.uint8)
        write(self._view, "no image yet", size_px[0] / 2, size_px[1] / 2, QUIET, 16, align="centre")

    def draw(self, panel: NDArray[np.uint8], frame: PreviewFrame, colours: IdentityColours) -> None:
        """Draw the newest image (none: the one before; dimmed if silent), score maps and the tracks on it."""
        image, tracks = frame.newest.get(self._sensor_name), frame.tracks
        x, y = self._offset
        width, height = self._size
        if isinstance(image, Image | DepthImage) and image is not self._shown:
            self._shown = image
            self._view[y : y + height, x : x + width] = cv2.resize(
                image.rgb, self._size, interpolation=cv2.INTER_LINEAR
            )
            if self._labelled:
                write(self._view, self._sensor_name, x + 6, max(int(y) - 8, 16), QUIET, 13)
        panel[:] = self._view
        tags = []
        if self._sensor_name in frame.silent:
            panel[:] = (_SILENT_LIGHT * panel).astype(np.uint8)
            tags.append(Tag(f"{self._sensor_name} silent", self._tile_px[0] / 2, y + height - 14.0, SILENT_FILL, INK))
        score_maps = [found for found in frame.maps if isinstance(found, ScoreMap)]
        self._draw_maps(panel, [found for found in score_maps if found.sensor == self._sensor_name], colours)
        clouds = [found for found in frame.maps if isinstance(found, Hypotheses)]
        for found in clouds:
            self._draw_places(panel, found, colours)
        tags += self._draw_heads(panel, tracks, colours)
        tags += self._draw_windows(panel, tracks, clouds, colours)
        with_window = {found.id for found in clouds if found.window}
        for track, window in self._torso_windows([track for track in tracks if track.id not in with_window]):
            colour = colours[track.id]
            if track.status == "confirmed":
                # A dark edge keeps the window readable on a shirt of its own colour.
                corners = [fixed_point(window)]
                cv2.polylines(panel, corners, True, DARK_INK, 4, cv2.LINE_AA, SHIFT)
                cv2.polylines(panel, corners, True, colour, 2, cv2.LINE_AA, SHIFT)
            else:
                dashed_loop(panel, window, colour)
            tags.append(track_tag(track, float(window[:, 0].mean()), float(window[:, 1].min()) - 11, colour))
        write_tags(panel, tags)

    def _draw_maps(self, panel: NDArray[np.uint8], maps: Sequence[ScoreMap], colours: IdentityColours) -> None:
        """Draw up to three score maps at the panel's lower edge, each beside its crop of the image.

        Left: the crop, with a dot at each patch. Right: the same under the map in its person's colour, more opaque for
        higher scores.
        """
        side, shown = min(self._tile_px) // _MAPS_ACROSS, self._shown
        for place, found in enumerate(maps[: _MAPS_ACROSS // 2] if shown is not None else ()):
            assert shown is not None
            height, width = found.score.shape
            to_tile = np.array([[1.0, 0.0, -found.corner[0]], [0.0, 1.0, -found.corner[1]]]) * (
                side / max(height, width)
            )
            cut = cv2.warpAffine(shown.rgb, to_tile, (side, side), flags=cv2.INTER_LINEAR)
            score = cv2.resize(found.score.astype(np.float32), None, fx=to_tile[0, 0], fy=to_tile[0, 0])[:side, :side]
            share = np.zeros((side, side, 1))
            share[: score.shape[0], : score.shape[1], 0] = _MAP_FILL * score / max(float(score.max()), 1e-9)
            colour = colours[found.id]
            under = (cut * (1 - share) + np.array(colour) * share).astype(np.uint8)
            for u, v in np.rint(found.patches @ to_tile[:, :2].T + to_tile[:, 2]).astype(int).tolist():
                cv2.circle(cut, (u, v), 1, INK, -1)
            left = 2 * place * side
            panel[-side:, left : left + 2 * side] = np.concatenate([cut, under], axis=1)
            cv2.rectangle(panel, (left, len(panel) - side), (left + 2 * side - 1, len(panel) - 1), colour, 2)

    def _draw_places(self, panel: NDArray[np.uint8], found: Hypotheses, colours: IdentityColours) -> None:
        """Draw a dot in the person's colour at each hypothesis of a body or head."""
        pixels, seen = self._camera.project(np.asarray(found.places, float))
        for u, v in np.rint(pixels[seen] * self._scale + self._offset).astype(int).tolist():
            cv2.circle(panel, (u, v), 1, colours[found.id], -1)

    def _draw_windows(
        self,
        panel: NDArray[np.uint8],
        tracks: Sequence[Track],
        clouds: Sequence[Hypotheses],
        colours: IdentityColours,
    ) -> list[Tag]:
        """Draw the windows that a tracker used in this image; return a tag over the topmost of each track."""
        tags = []
        for track in tracks:
            boxes = [found.window(self._camera) for found in clouds if found.id == track.id and found.window]
            boxes = np.array([box for box in boxes if box is not None]).reshape(-1, 2, 2)
            first = boxes[:, 0] * self._scale + self._offset
            last = first + boxes[:, 1] * self._scale
            for near, far in zip(fixed_point(first).tolist(), fixed_point(last).tolist(), strict=True):
                cv2.rectangle(panel, near, far, DARK_INK, 2, cv2.LINE_AA, SHIFT)
                cv2.rectangle(panel, near, far, colours[track.id], 1, cv2.LINE_AA, SHIFT)
            if len(boxes):
                top = first[first[:, 1].argmin()]
                middle = float(top[0] + last[first[:, 1].argmin()][0]) / 2
                tags.append(track_tag(track, middle, float(top[1]) - 11, colours[track.id]))
        return tags

    def _draw_heads(self, panel: NDArray[np.uint8], tracks: Sequence[Track], colours: IdentityColours) -> list[Tag]:
        """Draw an ellipse about each head in view and an arrow in its direction; return the tags of those without a torso
        window.
        """
        heads = [track for track in tracks if not isnan(track.head_x)]
        place = np.array([(track.head_x, track.head_y, track.head_z) for track in heads]).reshape(-1, 3)
        yaw = np.array([track.head_yaw for track in heads])
        ahead = np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=-1).reshape(-1, 3)
        ellipses, shown = self._camera.ellipses(Ellipsoids.upright(place, HEAD_M, np.nan_to_num(yaw)))
        ends, _ = self._camera.project(np.stack([place, place + _GAZE_M * ahead], axis=1))
        tags = []
        for track, outline, gaze in [
            (heads[k], ellipses.outline()[k] * self._scale + self._offset, ends[k] * self._scale + self._offset)
            for k in np.flatnonzero(shown)
        ]:
            colour = colours[track.id]
            if track.status == "confirmed":
                cv2.polylines(panel, [fixed_point(outline)], True, DARK_INK, 3, cv2.LINE_AA, SHIFT)
                cv2.polylines(panel, [fixed_point(outline)], True, colour, 1, cv2.LINE_AA, SHIFT)
            else:
                dashed_loop(panel, outline, colour)
            if np.isfinite(gaze).all():
                start, end = np.clip(fixed_point(gaze), -(1 << 14), 1 << 14).tolist()
                cv2.arrowedLine(panel, start, end, DARK_INK, 4, cv2.LINE_AA, SHIFT, 0.3)
                cv2.arrowedLine(panel, start, end, colour, 2, cv2.LINE_AA, SHIFT, 0.3)
            if isnan(track.z):
                tags.append(track_tag(track, float(outline[:, 0].mean()), float(outline[:, 1].min()) - 11, colour))
        return tags

    def _torso_windows(self, tracks: Sequence[Track]) -> list[tuple[Track, NDArray[np.float64]]]:
        """Project upright windows that face the camera, of the tracks in view, farthest first: outlines (24, 2) [px].

        None for tracks of heads alone.
        """
        tracks = [track for track in tracks if isnan(track.head_x) or not isnan(track.z)]
        at = np.array([(track.x, track.y) for track in tracks]).reshape(-1, 2)
        away = at - self._camera.eye_m[:2]
        distance = np.hypot(away[:, 0], away[:, 1])
        across = (
            np.stack([-away[:, 1], away[:, 0]], axis=-1) * (TORSO_WIDTH_M / 2 / np.maximum(distance, 1e-6))[:, None]
        )
        floor = at[:, None] + _WINDOW_ACROSS[:, None] * across[:, None]  # (n, 24, 2)
        height = np.broadcast_to(_WINDOW_HEIGHT_M[:, None], (*floor.shape[:2], 1))
        room = np.concatenate([floor, height], axis=-1)
        pixels, visible = self._camera.project(room)
        # A window cut by the image's edge is drawn as far as possible.
        drawn = np.any(visible, axis=1) & np.all(np.isfinite(pixels), axis=(1, 2))
        pixels = np.clip(pixels, -0.5, self._last_px) * self._scale + self._offset
        return [(tracks[i], pixels[i]) for i in np.argsort(-distance, kind="stable") if drawn[i]]


# Six points per side, because a straight edge is curved in a fisheye image.
_EDGE = np.linspace(-1, 1, 6)
_WINDOW_ACROSS = np.concatenate([_EDGE, np.ones(6), -_EDGE, -np.ones(6)])
_WINDOW_UP = np.concatenate([-np.ones(6), _EDGE, np.ones(6), -_EDGE])
_WINDOW_HEIGHT_M = TORSO_LOW_M + (_WINDOW_UP + 1) / 2 * (TORSO_HIGH_M - TORSO_LOW_M)
