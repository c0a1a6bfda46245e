"""Figures 6 and 8, views with the estimate's ellipse; figure 10, hypotheses by each of the two weights. As JPEG."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from trackers.cameras import Ellipsoids
from trackers.observations import DepthImage, Observation
from trackers.rgbd_head.options import WeightOptions
from trackers.rgbd_head.tracker import Inside
from trackers.rig import Rig, placed_camera

_TIMES = 2
"""Views are drawn so many times as large."""
_QUALITY = 86
_GAZE_M = 0.3
_WHITE = (255, 255, 255)
Picture = NDArray[np.uint8]


def views(observations: Sequence[Observation], rig: Rig, t_s: float, head: Array) -> bytes:
    """Every camera's picture of a moment with the ellipse of a head (x, y, z, yaw), the brighter the more it faces the camera."""
    drawn = []
    for name in rig.cameras():
        picture = _picture(observations, name, t_s)
        camera = placed_camera(rig.cameras()[name])
        place, yaw = head[:3], head[3]
        towards = camera.eye_m[:2] - place[:2]
        facing = np.cos(np.arctan2(towards[1], towards[0]) - yaw)
        level = int(110 + 72 * (1 + facing))
        ellipses, shown = camera.ellipses(Ellipsoids.upright(place[None], WeightOptions().semi_axes_m, yaw))
        if shown[0]:
            outline = np.rint(_TIMES * ellipses.outline()[0]).astype(np.int32)
            cv2.polylines(picture, [outline], True, (level, level, 0), 2, cv2.LINE_AA)
            ends, _ = camera.project(place + np.outer([0.0, _GAZE_M], [np.cos(yaw), np.sin(yaw), 0.0]))
            if np.isfinite(ends).all():
                start, end = np.rint(_TIMES * ends).astype(int).tolist()
                cv2.arrowedLine(picture, start, end, (level, level, 0), 2, cv2.LINE_AA, tipLength=0.3)
        drawn.append(picture)
    return _jpeg(_two_by_two(drawn))


def weighed(observations: Sequence[Observation], rig: Rig, t_s: float, inside: Inside, camera_name: str) -> bytes:
    """Figure 10: hypotheses in one camera's picture, from blue (least) to red by colour weight, beside it by depth weight."""
    weights = inside.weighed[camera_name]
    camera = placed_camera(rig.cameras()[camera_name])
    places = inside.people.roster.state.state[:3].reshape(3, -1)
    pixels, seen = camera.project(places.T)
    panels = []
    for what, log in (("colour", weights.colour), ("depth", weights.depth)):
        picture = _picture(observations, camera_name, t_s)
        weight = np.exp(log - log[seen].max(initial=-np.inf)) if seen.any() else log
        rank = (255 * weight.argsort().argsort() / max(len(weight) - 1, 1)).astype(np.uint8)
        colours = np.asarray(cv2.applyColorMap(rank[:, None], cv2.COLORMAP_JET))[:, 0, ::-1]
        for k in np.flatnonzero(seen):
            at = np.rint(_TIMES * pixels[k]).astype(int).tolist()
            cv2.circle(picture, at, 2, colours[k].tolist(), -1, cv2.LINE_AA)
        cv2.putText(picture, f"{what} weight", (10, 26), cv2.FONT_HERSHEY_SIMPLEX, 0.8, _WHITE, 2, cv2.LINE_AA)
        panels.append(picture)
    return _jpeg(np.hstack(panels))


def _picture(observations: Sequence[Observation], camera: str, t_s: float) -> Picture:
    """The camera's picture that is nearest to a time, enlarged."""
    taken = [each for each in observations if isinstance(each, DepthImage) and each.sensor == camera]
    nearest = min(taken, key=lambda each: abs(each.t - t_s))
    return np.asarray(
        cv2.resize(nearest.rgb, None, fx=_TIMES, fy=_TIMES, interpolation=cv2.INTER_LINEAR), np.uint8
    ).copy()


def _two_by_two(pictures: Sequence[Picture]) -> Picture:
    padded = [*pictures, *([np.full_like(pictures[0], 255)] * (-len(pictures) % 2))]
    return np.vstack([np.hstack(padded[k : k + 2]) for k in range(0, len(padded), 2)])


def _jpeg(picture: Picture) -> bytes:
    done, jpeg = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not done:
        raise RuntimeError("OpenCV could not encode a JPEG")
    return jpeg.tobytes()
