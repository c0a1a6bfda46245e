"""Who is new (section 3.1): clusters that no known person explains, and over which the cameras see somebody.

Where the head is at first, and which pan is forward, the paper does not say. Here (ours) the silhouettes of all cameras
carve a small hull over the cluster: its top is the head's. The pan is at first the direction in which the head shows the most
skin, and is corrected by the first steps (`trackers.camera_floor_particle.head`).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from trackers.arrays import Array, Mask
from trackers.camera_floor_particle import body
from trackers.camera_floor_particle.loads import Loads
from trackers.camera_floor_particle.options import CameraFloorParticleOptions, WindowOptions
from trackers.camera_floor_particle.pan import GRID, around, unit
from trackers.camera_floor_particle.people import PAN_BINS, People
from trackers.camera_floor_particle.views import Views
from trackers.filters.particle import Cloud
from trackers.tracking.track_manager import lasted_s

_ASIDE_M = np.arange(-0.28, 0.29, 0.07)
_LAYER_M = 0.04
_UP_M = np.arange(0.3, 2.2, _LAYER_M)
_HULL = np.stack(np.meshgrid(_ASIDE_M, _ASIDE_M, _UP_M, indexing="ij"), axis=-1).reshape(-1, 3)
_LEAST_HULL = 120
"""Points of the hull from which on there is somebody."""
_LEAST_AT_TOP = 3
"""Points of a layer of the hull that is still a head."""
_HEAD_M = 0.25
"""Height of a head with its neck: what of a hull is above belongs to it."""
_PELVIS = 0.54
"""Height of the pelvis as a share of the stature."""
_UNSEEN_HEIGHT_M = 1.7
"""Of somebody whom no camera sees."""
_FIRST_LOOKS = 5.0
"""So many looks are the first ones worth in references that learn."""
_LEAST_SKIN = 0.3
"""Share of a window that is skin, all cameras together, from which it tells where the face is."""
_SKIN_TELLS = 2.0
"""Concentration of the pan about the direction in which the head shows the most skin."""


class Newcomers:
    """Clusters that may be somebody, since when."""

    def __init__(self, options: CameraFloorParticleOptions, n_camera: int) -> None:
        self._options = options
        self._n_camera = n_camera
        self._waiting: list[tuple[Array, int]] = []  # places (2,) [m], since when [ns]
        self._last_ns: int | None = None  # of the frame before

    def unexplained(self, people: People | None, loads: Loads) -> Bool[Mask, "k"]:
        """Clusters that no known person explains: far from all, and more than all of them weigh."""
        options, load_n = self._options.detection, loads.clusters.load_n
        new = load_n >= options.least_load_n
        if people is not None and len(people):
            near = loads.cluster_near(people.place[:, :2], options.apart_m)
            known_n = people.weight_n[near.any(axis=1)].sum()
            new &= ~near.any(axis=0) & (load_n.sum() - known_n >= options.unexplained * load_n)
        return new

    def confirmed(self, places: Float[Array, "k 2"], ns: int) -> Bool[Mask, "k"]:
        """Which of these places have been waiting for long enough; the others are remembered."""
        waiting, due = [], np.zeros(len(places), np.bool_)
        before_ns, self._last_ns = ns if self._last_ns is None else self._last_ns, ns
        for number, place in enumerate(places):
            near = [
                since
                for other, since in self._waiting
                if np.linalg.norm(other - place) < self._options.detection.apart_m
            ]
            since = min(near, default=ns)
            due[number] = lasted_s(since, ns, before_ns) > self._options.detection.confirm_s
            if not due[number]:
                waiting.append((place, since))
        self._waiting = waiting
        return due

    def person(
        self,
        place: Float[Array, "2"],
        load_n: float,
        hull: Float[Array, "k 3"],
        views: Views,
        ns: int,
        rng: np.random.Generator,
    ) -> People:
        """Somebody new over a cluster, as floor and hull show them."""
        options = self._options
        if len(hull):
            heights, n_point = np.unique(hull[:, 2], return_counts=True)
            top_m = float(heights[n_point >= _LEAST_AT_TOP].max(initial=heights[0])) + 0.5 * _LAYER_M
            crown = hull[hull[:, 2] > top_m - _HEAD_M]
            skull = np.append(crown[:, :2].mean(axis=0), top_m - body.CROWN_M)
            middle = np.append((place + skull[:2]) / 2, _PELVIS * top_m)
        else:
            top_m = _UNSEEN_HEIGHT_M
            middle, skull = np.append(place, _PELVIS * top_m), np.append(place, top_m - body.CROWN_M)
        clothes = np.zeros((self._n_camera, options.histogram.size))
        n_colour = options.histogram.size * options.head.parts[0] * options.head.parts[1]
        skin, faces, from_east = 0j, np.empty((0, n_colour)), np.empty(0)
        whole: WindowOptions = options.body.window.model_copy(update={"pixels": "foreground", "stride": 1})
        pixels, seen, _ = views.look(middle[:, None])
        if seen.any():
            by = np.array([view.number for view in views])[seen[:, 0]]
            clothes[by] = unit(np.sqrt(views.colours(middle[:, None], pixels, seen, whole)))
        whole = options.head.window.model_copy(update={"pixels": "foreground", "stride": 1})
        pixels, seen, _ = views.look(skull[:, None])
        if seen.any():
            faces = unit(np.sqrt(views.colours(skull[:, None], pixels, seen, whole, options.head.parts)))
            from_east = views.bearings(skull[:, None])[seen]
            skin = np.sum(views.skin(skull[:, None], pixels, seen, whole) * np.exp(1j * from_east))
            faces, from_east = faces[faces.any(axis=1)], from_east[faces.any(axis=1)]
        seen_by = clothes.any(axis=1)
        if seen_by.any():
            clothes[~seen_by] = unit(clothes[seen_by].mean(axis=0))
        pan = float(np.angle(skin))
        hair = np.zeros((PAN_BINS, n_colour))
        if len(faces):
            hair = _FIRST_LOOKS * around(faces, from_east - pan, mixed=options.head.references == "mixed")
        facing = np.exp(_SKIN_TELLS * np.cos(GRID - pan)) if skin else np.ones(len(GRID))
        return People(
            body=body.started(middle[None], options.body.particles, rng),
            head=Cloud.normal(
                np.append(skull, pan)[None],
                np.diag([0.04, 0.04, 0.04, 0.5])[None] ** 2,
                options.head.particles,
                rng,
            ),
            place=middle[None],
            velocity=np.zeros((1, 3)),
            head_place=skull[None],
            head_velocity=np.zeros((1, 3)),
            pan=np.array([pan]),
            clothes=clothes[None],
            facing=facing[None] / facing.sum(),
            hair=hair[None],
            course=np.zeros((1, 2)),
            skin_true=np.ones(1),
            pan_known=np.array([abs(skin) > _LEAST_SKIN]),
            weight_n=np.array([load_n]),
            height_m=np.array([top_m]),
            shown_ns=np.array([ns]),
            lost=np.zeros(1, np.bool_),
        )


def hull_over(place: Float[Array, "2"], views: Views) -> Float[Array, "k 3"]:
    """Points above a place that the cameras that see them show as foreground, one of three or four apart [m]; none: nobody."""
    points = _HULL + np.append(place, 0.0)
    _, seen, on_foreground = views.look(points.T)
    n_seen, n_shown = seen.sum(axis=0), on_foreground.sum(axis=0)
    hull = points[(n_seen > 0) & (n_seen - n_shown <= (n_seen > 2))]
    return hull if len(hull) >= _LEAST_HULL else hull[:0]
