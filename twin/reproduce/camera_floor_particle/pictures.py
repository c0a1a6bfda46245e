"""Figures 2, 4 and 5 at a moment: four views with masks, windows and particles, and the floor with its loads."""

from __future__ import annotations

import cv2
import numpy as np

from trackers.arrays import Array
from trackers.camera_floor_particle.options import CameraFloorParticleOptions
from trackers.camera_floor_particle.tracker import Inside
from trackers.rig import Rig
from twin.report.palette import IDENTITY_COLOURS

_TIMES = 2
"""Views are drawn so many times as large."""
_PX_M = 210
_MARGIN_M = 0.7
_PAPER, _INK, _GRID = (251, 251, 250), (27, 31, 39), (222, 224, 228)
_QUALITY = 86


def draw_inside(inside: Inside, options: CameraFloorParticleOptions, rig: Rig, truth: Array) -> bytes:
    """The views two by two, the floor from above beside them, as a JPEG. truth: (n, 4), x, y of bodies and heads [m]."""
    views = [_view(number, inside, options) for number in range(min(len(inside.views), 4))]
    if not views:
        raise ValueError("no camera shows anything at that moment")
    views += [np.full_like(views[0], 255)] * (-len(views) % 2)
    rows = [np.hstack(views[k : k + 2]) for k in range(0, len(views), 2)]
    left = np.vstack(rows)
    floor = _floor(inside, rig, truth)
    scale = left.shape[0] / floor.shape[0]
    floor = cv2.resize(floor, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    done, jpeg = cv2.imencode(".jpg", np.hstack([left, floor])[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not done:
        raise RuntimeError("OpenCV could not encode a JPEG")
    return jpeg.tobytes()


def _view(number_of_view: int, inside: Inside, options: CameraFloorParticleOptions) -> np.ndarray:
    """A picture with the outline of its foreground in white, particles as dots, and the windows of both estimates."""
    view = inside.views[number_of_view]
    picture = cv2.resize(view.rgb, None, fx=_TIMES, fy=_TIMES, interpolation=cv2.INTER_NEAREST)
    mask = cv2.resize(view.mask.astype(np.uint8), None, fx=_TIMES, fy=_TIMES, interpolation=cv2.INTER_NEAREST)
    outlines, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, outlines, -1, (255, 255, 255), 1)
    if inside.people is None:
        return picture
    for row, number in enumerate(inside.ids.tolist()):
        colour = _colour(number)
        for cloud, place, window in (
            (inside.people.body, inside.people.place[row], options.body.window),
            (inside.people.head, inside.people.head_place[row], options.head.window),
        ):
            pixels, seen, _ = (each[number_of_view] for each in inside.views.look(cloud.state[:3, row]))
            for x, y in _TIMES * pixels[seen]:
                cv2.circle(picture, (round(x), round(y)), 1, colour, -1)
            middle, here, _ = (each[number_of_view] for each in inside.views.look(place[:, None]))
            if here[0]:
                half = _TIMES * window.size_px(view.camera, place[:, None])[0] / 2
                corners = np.rint(_TIMES * middle[0] + np.array([-half, half])).astype(int).tolist()
                cv2.rectangle(picture, corners[0], corners[1], colour, 2)
    return picture


def _floor(inside: Inside, rig: Rig, truth: Array) -> np.ndarray:
    """The floor from above: elements the darker the more they bear, particles, estimates (discs), pans, truth (crosses)."""
    sensor = next(iter(rig.floors().values()))
    corners = sensor.corners
    low, high = corners.min(axis=0) - _MARGIN_M, corners.max(axis=0) + _MARGIN_M

    def px(places: Array) -> np.ndarray:
        return np.rint((np.atleast_2d(places)[:, :2] - low) * [1, -1] * _PX_M + [0, (high - low)[1] * _PX_M]).astype(
            int
        )

    width, height = np.ceil((high - low) * _PX_M).astype(int).tolist()
    panel = np.full((height, width, 3), _PAPER, np.uint8)
    load = np.zeros((sensor.rows, sensor.columns)) if inside.loads is None else inside.loads.clusters.cell_load_n
    shade = np.sqrt(load / max(load.max(), 1.0))
    half = sensor.pitch_m / 2
    for centre, dark in zip(sensor.centres.reshape(-1, 2), shade.ravel().tolist(), strict=True):
        first, last = px(centre - half)[0].tolist(), px(centre + half)[0].tolist()
        cv2.rectangle(panel, first, last, tuple(int(c * (1 - 0.55 * dark)) for c in _PAPER), -1)
        cv2.rectangle(panel, first, last, _GRID, 1)
    if inside.people is not None:
        for row, number in enumerate(inside.ids.tolist()):
            colour = _colour(number)
            for cloud, size in ((inside.people.body, 3), (inside.people.head, 2)):
                for at in px(cloud.state[:2, row].T).tolist():
                    cv2.circle(panel, at, size, colour, -1)
            head, pan = inside.people.head_place[row], inside.people.pan[row]
            tip = head[:2] + 0.3 * np.array([np.cos(pan), np.sin(pan)])
            start, end = px(head)[0].tolist(), px(tip)[0].tolist()
            cv2.arrowedLine(panel, start, end, _INK, 3, cv2.LINE_AA, tipLength=0.3)
            place = px(inside.people.place[row])[0].tolist()
            cv2.circle(panel, place, 11, colour, -1, cv2.LINE_AA)
            cv2.putText(panel, f"#{number}", (place[0] + 14, place[1] + 8), cv2.FONT_HERSHEY_SIMPLEX, 0.9, _INK, 2)
    for places, size in ((truth[:, :2], 22), (truth[:, 2:], 12)):
        for at in px(places[~np.isnan(places).any(axis=1)]).tolist():
            cv2.drawMarker(panel, at, _INK, cv2.MARKER_TILTED_CROSS, size, 2, cv2.LINE_AA)
    return panel


def _colour(number: int) -> tuple[int, int, int]:
    return IDENTITY_COLOURS[(number - 1) % len(IDENTITY_COLOURS)]
