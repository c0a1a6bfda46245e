"""Figures 2, 4 and 5 at a moment: four views with masks, windows and particles, and the floor with its loads."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np

from trackers.camera_floor_particle.tracker import Inside
from trackers.observations import FloorFrame, Image
from trackers.rig import Rig
from trackers.tracks import TrackFrame
from twin.report.camera_panel import CameraGrid
from twin.report.palette import IdentityColours
from twin.report.panels import FloorPanel, TruePoses

_SIDE_PX = 1280
_QUALITY = 86
_MASK = (255, 255, 255)


def draw_inside(
    inside: Inside,
    frame: TrackFrame,
    rig: Rig,
    floors: Mapping[str, FloorFrame],
    truth: TruePoses,
) -> bytes:
    """What the preview shows of a moment, larger, with the outline of each view's foreground in white; a JPEG."""
    if not len(inside.views):
        raise ValueError("no camera shows anything at that moment")
    cameras = list(rig.cameras())
    images = {
        cameras[view.number]: Image(cameras[view.number], frame.stamp_ns, _outlined(view.rgb, view.mask))
        for view in inside.views
    }
    colours = IdentityColours()
    colours.meet(sorted(track.id for track in frame.tracks))
    left = np.empty((_SIDE_PX, _SIDE_PX, 3), np.uint8)
    CameraGrid(rig.cameras(), _SIDE_PX).draw(left, images, frame.tracks, colours, maps=frame.maps)
    right = np.empty_like(left)
    tails = {track.id: [(frame.stamp_ns, track.x, track.y)] for track in frame.tracks}
    FloorPanel(rig, (), _SIDE_PX, _SIDE_PX).draw(
        right, {}, {}, frame.tracks, tails, colours, truth, {}, floors, maps=frame.maps
    )
    done, jpeg = cv2.imencode(".jpg", np.hstack([left, right])[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not done:
        raise RuntimeError("OpenCV could not encode a JPEG")
    return jpeg.tobytes()


def _outlined(rgb: np.ndarray, mask: np.ndarray) -> np.ndarray:
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    return cv2.drawContours(rgb.copy(), outlines, -1, _MASK, 1)
