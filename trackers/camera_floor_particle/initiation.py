"""Initiation (section 3.1): unassigned clusters over which the cameras see a person.

The paper does not give the initial head and pan. Here (ours) the silhouettes of all cameras carve a small hull over the
cluster, whose top is the head's. Since one camera may contradict a hull, it reaches beyond the head; the points at its top
that most cameras show give the head's place. The initial pan is the direction in which the head shows the most skin,
corrected by the first steps (`trackers.camera_floor_particle.pan`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackers.arrays import Array, Bool, Float, Mask
from trackers.camera_floor_particle import body_filter
from trackers.camera_floor_particle.body_filter import PAN_BINS, BodyTracks
from trackers.camera_floor_particle.options import CameraFloorParticleOptions
from trackers.camera_floor_particle.pan import GRID, around, unit
from trackers.cameras.placed import through_people
from trackers.filters.gating import distances
from trackers.filters.particle import Cloud
from trackers.filters.rows import Rows
from trackers.likelihood.floor import Loads
from trackers.tracking.roster import Roster
from trackers.tracking.track_manager import TrackManager
from trackers.vision.views import BINS, Views, WindowOptions

_ACROSS_M = np.arange(-0.28, 0.29, 0.07)
_LAYER_M = 0.04
_UP_M = np.arange(0.3, 2.2, _LAYER_M)
_HULL = np.stack(np.meshgrid(_ACROSS_M, _ACROSS_M, _UP_M, indexing="ij"), axis=-1).reshape(-1, 3)
_LEAST_HULL = 120
"""Least number of points of a person's hull."""
_LEAST_AT_TOP = 3
"""Least number of points of a layer of the hull that is still a head."""
_BODY_M = 0.25
"""Radius of a person in a line of sight."""
_HEAD_M = 0.25
"""Height of a head with its neck, at the top of a hull."""
_PELVIS = 0.54
"""Height of the pelvis as a share of the stature."""
_UNKNOWN_HEIGHT_M = 1.7
"""Stature of a person that no camera sees."""
_FIRST_LOOKS = 5.0
"""Weight of the first observations in learned references."""
_LEAST_SKIN = 0.3
"""Least share of skin in a window, all cameras together, that shows the face's direction."""
_SKIN_SHOWS = 2.0
"""Concentration of the pan about the direction of most skin."""
_SLID_S = 0.5
"""Time for which hardly a camera shows a head where it is before it is initiated anew [s]."""


@dataclass(frozen=True, eq=False)
class Places(Rows):
    """Middles of clusters [m]: the state of tentative tracks."""

    position: Float[Array, "n 2"]


class Initiation:
    """Tentative tracks of clusters, and the initial state of a track."""

    def __init__(self, options: CameraFloorParticleOptions, manager: TrackManager, n_camera: int) -> None:
        self._options, self._limits, self._manager = options, options.track_management, manager
        self._n_camera = n_camera
        self._tentative = Roster.started(Places(np.empty((0, 2))), 0)
        self._last_ns: int | None = None  # of the frame before

    def unexplained(self, people: BodyTracks | None, loads: Loads) -> Bool[Mask, "k"]:
        """Return a mask of the unassigned clusters: far from all tracks, and heavier than they explain."""
        limits, load_n = self._limits, loads.clusters.load_n
        new = load_n >= limits.least_load_n
        if people is not None and len(people):
            near = loads.cluster_near(people.place[:, :2], limits.start_apart_m)
            known_n = people.weight_n[near.any(axis=1)].sum()
            new &= ~near.any(axis=0) & (load_n.sum() - known_n >= limits.unexplained * load_n)
        return new & _heaviest_apart(loads.clusters.centroid, np.where(new, load_n, 0.0), limits.start_apart_m)

    def due(self, places: Float[Array, "k 2"], ns: int) -> Bool[Mask, "k"]:
        """Update the tentative tracks with clusters at places [m]; return a mask of those to initiate.

        A cluster continues the oldest tentative track within `start_apart_m`.
        """
        before_ns, self._last_ns = ns if self._last_ns is None else self._last_ns, ns
        old = self._tentative
        near = distances(places, old.state.position) < self._limits.start_apart_m
        now = Roster.started(Places(places), ns).changed(
            born_ns=np.where(near, old.born_ns, ns).min(axis=1, initial=ns),
            n_measured=1 + np.where(near, old.n_measured, 0).max(axis=1, initial=0),
        )
        due = self._manager.to_confirm(now, ns, ns - before_ns)
        left = old.select(~near.any(axis=0) & self._manager.lasting(old, ns))
        self._tentative = left.joined(now.select(~due))
        return due

    def person(
        self,
        place: Float[Array, "2"],
        load_n: float,
        hull: Float[Array, "k 3"],
        views: Views,
        ns: int,
        rng: np.random.Generator,
    ) -> BodyTracks:
        """Initiate a track over a cluster, by floor and hull."""
        options = self._options
        if len(hull):
            skull = _skull(hull, views)
            top_m = float(skull[2]) + body_filter.CROWN_M
            middle = np.append((place + skull[:2]) / 2, _PELVIS * top_m)
        else:
            top_m = _UNKNOWN_HEIGHT_M
            middle, skull = np.append(place, _PELVIS * top_m), np.append(place, top_m - body_filter.CROWN_M)
        clothes = self._clothes(middle[:, None], views)
        pan, skin, hair = self._face(skull[:, None], views)
        return BodyTracks(
            roster=Roster.started(body_filter.started(middle[None], options.body.particles, rng), ns),
            head=self._heads(np.append(skull, pan), rng),
            place=middle[None],
            velocity=np.zeros((1, 3)),
            head_place=skull[None],
            head_velocity=np.zeros((1, 3)),
            pan=np.array([pan]),
            clothes=clothes[None],
            facing=_facing(pan, skin)[None],
            hair=hair[None],
            course=np.zeros((1, 2)),
            skin_true=np.ones(1),
            pan_known=np.array([skin > _LEAST_SKIN]),
            weight_n=np.array([load_n]),
            height_m=np.array([top_m]),
            lost=np.zeros(1, np.bool_),
            slid_s=np.zeros(1),
        )

    def with_heads_on_top(self, people: BodyTracks, views: Views, rng: np.random.Generator) -> BodyTracks:
        """Return the tracks with heads that have slid off initiated anew, at the tops of their people's hulls.

        A person initiated while sitting or getting up may have had the head outside the hull over the feet.
        """
        for row in np.flatnonzero(people.slid_s > _SLID_S):
            others = people.select(np.arange(len(people)) != row)
            hull, _ = hull_over(people.place[row, :2], views, others)
            one = people.select(np.array([row])).changed(slid_s=np.zeros(1))
            if len(hull) and np.linalg.norm((skull := _skull(hull, views)) - one.head_place[0]) > body_filter.CROWN_M:
                pan, skin, hair = self._face(skull[:, None], views)
                one = one.changed(
                    head=self._heads(np.append(skull, pan), rng),
                    head_place=skull[None],
                    head_velocity=np.zeros((1, 3)),
                    pan=np.array([pan]),
                    facing=_facing(pan, skin)[None],
                    hair=hair[None],
                    pan_known=np.array([skin > _LEAST_SKIN]),
                    height_m=np.maximum(one.height_m, skull[2] + body_filter.CROWN_M),
                )
            people = people.replaced(np.array([row]), one)
        return people

    def _heads(self, place: Float[Array, "4"], rng: np.random.Generator) -> Cloud:
        """Draw the particles of a head about its place [m] and pan [rad]."""
        return Cloud.normal(place[None], np.diag([0.04, 0.04, 0.04, 0.5])[None] ** 2, self._options.head.particles, rng)

    def _clothes(self, middle: Float[Array, "3 1"], views: Views) -> Float[Array, "cameras bins"]:
        """Return the colours about the middle of a body as roots; a camera that does not see it gets the others' mean."""
        clothes = np.zeros((self._n_camera, BINS.size))
        whole: WindowOptions = self._options.body.window.model_copy(update={"pixels": "foreground", "stride": 1})
        look = views.look(middle)
        if (seen := look.seen).any():
            by = np.array([view.number for view in views])[seen[:, 0]]
            clothes[by] = unit(np.sqrt(views.colours(middle, look.pixels, seen, whole)))
        seen_by = clothes.any(axis=1)
        if seen_by.any():
            clothes[~seen_by] = unit(clothes[seen_by].mean(axis=0))
        return clothes

    def _face(self, skull: Float[Array, "3 1"], views: Views) -> tuple[float, float, Float[Array, "pans colours"]]:
        """Return the pan [rad] and its share of skin, and references of the head from all sides."""
        options = self._options.head
        n_colour = BINS.size * options.parts[0] * options.parts[1]
        skin, faces, from_east = 0j, np.empty((0, n_colour)), np.empty(0)
        whole: WindowOptions = options.window.model_copy(update={"stride": 1})
        look = views.look(skull)
        if (seen := look.seen).any():
            faces = unit(np.sqrt(views.colours(skull, look.pixels, seen, whole, options.parts)))
            from_east = views.bearings(skull)[seen]
            skin = np.sum(views.skin(skull, look.pixels, seen, whole) * np.exp(1j * from_east))
            faces, from_east = faces[faces.any(axis=1)], from_east[faces.any(axis=1)]
        pan = float(np.angle(skin))
        hair = np.zeros((PAN_BINS, n_colour))
        if len(faces):
            hair = _FIRST_LOOKS * around(faces, from_east - pan, mixed=options.references == "mixed")
        return pan, float(abs(skin)), hair


def _skull(hull: Float[Array, "k 3"], views: Views) -> Float[Array, "3"]:
    """Return the middle of the head at the top of a hull [m], where most cameras show it."""
    heights, n_point = np.unique(hull[:, 2], return_counts=True)
    top_m = float(heights[n_point >= _LEAST_AT_TOP].max(initial=heights[0])) + 0.5 * _LAYER_M
    crown = hull[hull[:, 2] > top_m - _HEAD_M]
    n_shown = views.look(crown.T).on_foreground.sum(axis=0)
    return np.append(crown[n_shown == n_shown.max(), :2].mean(axis=0), top_m - body_filter.CROWN_M)


def _facing(pan: float, skin: float) -> Float[Array, "steps"]:
    """Return the probability of each pan of the grid, about the direction of most skin [rad], if there is any."""
    facing = np.exp(_SKIN_SHOWS * np.cos(GRID - pan)) if skin else np.ones(len(GRID))
    return facing / facing.sum()


def hull_over(
    place: Float[Array, "2"], views: Views, people: BodyTracks | None = None
) -> tuple[Float[Array, "k 3"], bool]:
    """Carve the points above a place that all cameras see as foreground, except one of three or more [m]; empty: no person.

    A camera that looks at a point through one of the tracked people, or has one of them behind it, tells nothing of it. And
    return whether somebody may be there for all that the cameras show, tracked people or not.
    """
    points = _HULL + np.append(place, 0.0)
    look = views.look(points.T)
    maybe = _carved(look.seen, look.on_foreground)
    of_person = maybe
    if people is not None and len(people):
        meets, _ = through_people(
            views.eyes_m, points, people.place[:, :2], _BODY_M, people.head_place[:, 2] + body_filter.CROWN_M
        )
        of_person = _carved(look.seen & ~meets.any(axis=-1), look.on_foreground)
    hull = points[of_person]
    return hull if len(hull) >= _LEAST_HULL else hull[:0], bool(maybe.sum() >= _LEAST_HULL)


def _carved(tells: Bool[Mask, "cameras k"], on_foreground: Bool[Mask, "cameras k"]) -> Bool[Mask, "k"]:
    """Return a mask of the points that the cameras which tell of them see as foreground."""
    n_seen, n_shown = tells.sum(axis=0), (tells & on_foreground).sum(axis=0)
    return (n_seen > 0) & (n_seen - n_shown <= (n_seen > 2))


def _heaviest_apart(places: Float[Array, "k 2"], load_n: Float[Array, "k"], apart_m: float) -> Bool[Mask, "k"]:
    """Return a mask of loads with no heavier one within `apart_m`: two feet are one person."""
    taken = np.zeros(len(places), np.bool_)
    near = distances(places, places) < apart_m
    for k in np.argsort(-load_n, kind="stable"):
        taken[k] = load_n[k] > 0 and not near[k, taken].any()
    return taken
