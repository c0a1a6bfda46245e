"""Heads in 3-D, place and direction, from stereo RGB-D cameras and a model of the room.

After T. Suzuki, S. Iwasaki, Y. Kobayashi, Y. Sato and A. Sugimoto: "Incorporating environment models for improving
vision-based tracking of people" (Systems and Computers in Japan 38(2), 2007). A particle filter a head; every picture weighs
every hypothesis by colours and by distances (eq. 4 to 7), the room weighs it once a moment (eq. 8), the product counts (eq. 9)
and the expectation is the estimate. What is ours and not the paper's is an option each, "(ours)" in `options`.

A track's x and y are the ground under the head, not under the pelvis; its z is not estimated.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import nan
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from trackers.area import Area
from trackers.arrays import Array, Mask
from trackers.configuration import validate
from trackers.errors import InputError
from trackers.filters.gating import distances
from trackers.filters.particle import ParticleFilter
from trackers.knowledge import Knowledge
from trackers.observations import NS_PER_S, DepthImage, Observation
from trackers.rgbd_head.calibration import TURN_DEG, is_turned
from trackers.rgbd_head.colours import HeadColours
from trackers.rgbd_head.learned import SHIPPED, load_learned
from trackers.rgbd_head.newcomers import newcomers
from trackers.rgbd_head.options import RgbdHeadOptions
from trackers.rgbd_head.people import People, around
from trackers.rgbd_head.picture import Picture, Watcher, Weights
from trackers.rig import Rig, StereoSensor
from trackers.tracking.lifecycle import coasting_within, measured_often
from trackers.tracking.moment_tracker import MomentTracker
from trackers.tracking.moments import Moment, MomentRules
from trackers.tracks import Hypotheses, Track

FILTER = ParticleFilter(threshold=0.7)
LEARNED = "heads"
"""Name under which `background.learned` may hold another file than the shipped one (`scripts/learn-heads` makes one)."""
_USUAL = 0.2
"""Share of a new picture in what a person's heads usually weigh."""
_SURE = 0.6
"""How sure a direction has to be for colours to be learned at it."""
_LONGEST_S = 0.5
"""However long nothing came, heads move for no longer at once."""
_OTHERS = 4.0
"""What the logarithm of a hypothesis's weight loses in another person's head."""
_SHOWN = 64
"""About so many hypotheses of each person are handed out for the preview."""
_BESIDE_M = 0.4
"""So far beside the tracked area there is floor that shadows fall on."""
_FAR_M_S = 1.5
"""Who is not shown is looked for within the way at this speed."""


class Inside(NamedTuple):
    """What the tracker knew at the moment worked last: everybody's hypotheses, and what each picture made of them."""

    people: People
    weighed: dict[str, Weights]


class RgbdHead(MomentTracker):
    """Stereo cameras open a moment; every head is weighed by all of its pictures, each at its own stamp.

    Raises InputError for a rig without a stereo camera, for wrong options, and for pictures of another size than the rig says.
    """

    def __init__(
        self, rig: Rig, background: Iterable[Observation] = (), rng: np.random.Generator | None = None, **options: Any
    ) -> None:
        self.options = validate(RgbdHeadOptions, options, "tracker rgbd-head")
        sensors = _stereo_cameras(rig, self.options.cameras)
        self.unused_sensors = [name for name in rig.sensors if name not in sensors]
        known = Knowledge.of(background)
        self._environment = known.environment if self.options.environment.used else None
        area = Area(rig.area, _BESIDE_M) if rig.area else None
        self._learned = load_learned(known.learned.get(LEARNED, SHIPPED))
        self._watchers = {
            name: Watcher(
                sensor, [each for each in known if each.sensor == name], self._learned, self.options.weights, area
            )
            for name, sensor in sensors.items()
        }
        self.warnings = self._warnings(known)
        self.background_learned_causally = any(each.foreground.learns_background for each in self._watchers.values())
        main = rig.main_sensor if rig.main_sensor in sensors else None
        super().__init__(MomentRules(tuple(sensors), main=main, period_s=0.25))
        self._rng = np.random.default_rng(0) if rng is None else rng
        cloud = around(np.empty((0, 3)), None, 1.0, self.options.heads, self._rng)
        self._people = People.started(cloud, 0, len(sensors))
        self._pending = sorted(self.options.start, key=lambda start: start.at_s)
        self._ns, self._last_id, self._turn = 0, 0, 0
        self._weights: dict[str, Weights] = {}

    def _warnings(self, known: Knowledge) -> list[str]:
        """That the room is not known, or which cameras do not hang as the rig says."""
        if not self.options.environment.used:
            return []
        if known.environment is None:
            return ["goes without the room's environment (`twin environment` makes one)"]
        room = known.environment
        turned = [
            name
            for name, each in self._watchers.items()
            if each.empty_depth_m.size > 1 and is_turned(each.camera, each.empty_depth_m, room)
        ]
        says = f"fits the environment better when turned by {TURN_DEG:g}° than as the rig has it"
        return [f"what {name} sees of the empty room {says}" for name in turned]

    def tracks(self) -> list[Track]:
        """Everybody confirmed, as of the moment worked last; x and y are the ground under the head."""
        people = self._people
        place, (yaw, _), shown = people.place, people.direction(), people.roster.measured_ns == self._ns
        rows = np.column_stack([place[:, :2], people.velocity[:, :2], np.full(len(place), nan), place, yaw]).tolist()
        return [
            Track(int(people.roster.id[k]), *rows[k], status="confirmed" if shown[k] else "coasting")
            for k in np.flatnonzero(people.roster.confirmed)
        ]

    def inside(self) -> Inside:
        """What was known at the moment worked last, for drawings."""
        return Inside(self._people, self._weights)

    def _maps(self) -> tuple[Hypotheses, ...]:
        """Some hypotheses of everybody confirmed."""
        roster = self._people.roster
        return tuple(
            Hypotheses(int(roster.id[k]), roster.state.state[:3, k, :: max(1, self.options.heads // _SHOWN)].T)
            for k in np.flatnonzero(roster.confirmed)
        )

    def _work(self, moment: Moment) -> None:
        dt = min((moment.ns - self._ns) / NS_PER_S, _LONGEST_S) if self._ns else 0.0
        self._ns = moment.ns
        pictures = self._pictures(moment)
        if len(self._people):
            self._follow(dt, pictures)
        self._begin_known()
        if not self.options.start and pictures:
            self._find(pictures)

    def _pictures(self, moment: Moment) -> dict[str, tuple[Picture, float]]:
        """The pictures that show anything, and how much later than the moment each was taken [s]."""
        found = {}
        for name, watcher in self._watchers.items():  # in this order whatever came first: sums depend on it
            image = moment.observations.get(name)
            picture = watcher.ready(image) if isinstance(image, DepthImage) else None
            if image is not None and picture is not None:
                later = (image.stamp_ns - moment.ns) / NS_PER_S if self.options.own_stamps else 0.0
                found[name] = (picture, later)
        return found

    def _follow(self, dt: float, pictures: dict[str, tuple[Picture, float]]) -> None:
        """Everybody `dt` later, by what the pictures show."""
        options, people = self.options, self._people
        motion, before = options.motion, people.place
        speed = np.linalg.norm(people.velocity[:, :2], axis=1)
        level = motion.still_m + motion.per_speed_m * speed
        up, turn = np.full_like(level, motion.up_m), np.full_like(level, np.radians(motion.turn_deg))
        sigma = np.sqrt(dt) * np.stack([level, level, up, turn])[..., None]
        shift = np.zeros((4, len(people), 1))
        shift[:3, :, 0] = dt * people.velocity.T
        weighed: dict[str, Weights] = {}

        anywhere = round(motion.turned * self.options.heads)

        def move(state: Array, rng: np.random.Generator) -> Array:
            moved = state + shift + sigma * rng.standard_normal(state.shape)
            if anywhere:
                who = rng.permutation(state.shape[2])[:anywhere]
                moved[3][:, who] = rng.uniform(-np.pi, np.pi, (len(people), anywhere))
            return moved

        def log_likelihood(state: Array) -> Array:
            weighed.update(self._weighed(state, pictures))
            return self._total(state, weighed)

        cloud = FILTER.step(people.roster.state, move, log_likelihood, self._rng)
        people = people.changed(roster=people.roster.changed(state=cloud))
        velocity = people.velocity
        if motion.velocity_s and dt:
            kept = np.exp(-dt / motion.velocity_s)
            velocity = kept * velocity + (1 - kept) * (people.place - before) / dt
        self._people = people.changed(velocity=velocity, usual=self._usual(people, weighed))
        self._weights = weighed
        self._look(pictures, weighed)

    def _weighed(self, state: Float[Array, "4 n p"], pictures: dict[str, tuple[Picture, float]]) -> dict[str, Weights]:
        """What each picture makes of hypotheses, moved to its own stamp."""
        people, colour = self._people, self.options.weights.colour
        tables = people.colours.tables(self._learned.common, colour) if colour.used and colour.by_person else None
        weights = {}
        for name, (picture, later) in pictures.items():
            heads = state.astype(np.float32)
            heads[:3] += np.float32(later) * people.velocity.T[..., None].astype(np.float32)
            weights[name] = self._watchers[name].weights(picture, heads, tables)
        return weights

    def _total(self, state: Float[Array, "4 n p"], weighed: dict[str, Weights]) -> Float[Array, "n p"]:
        """The logarithm of the product of all weights (eq. 9)."""
        people, options = self._people, self.options
        n, p = state.shape[1:]
        total = np.zeros((n, p))
        for name, weights in weighed.items():
            usual = np.nan_to_num(people.usual[:, self._number(name), None]) - options.life.unseen
            seen = weights.seen.reshape(n, p)
            total += np.where(seen, (weights.colour + weights.depth).reshape(n, p), usual)
        total += self._room(state[:3].reshape(3, n * p).T).reshape(n, p)
        if options.motion.walking:
            heading = np.arctan2(people.velocity[:, 1], people.velocity[:, 0])
            speed = np.minimum(np.linalg.norm(people.velocity[:, :2], axis=1), 1.0)
            total += options.motion.walking * speed[:, None] * np.cos(state[3] - heading[:, None])
        if n > 1:
            away = np.sqrt(((state[:3, :, :, None] - people.place.T[:, None, None]) ** 2).sum(axis=0))
            away[np.arange(n), :, np.arange(n)] = np.inf
            total -= _OTHERS * (away.min(axis=2) < options.life.same_head_m)
        return total

    def _room(self, places: Float[Array, "k 3"]) -> Float[Array, "k"]:
        """The logarithm of the environment's weight e (eq. 8), once a moment."""
        if self._environment is None:
            return np.zeros(len(places))
        options = self.options.environment
        weight = self._environment.head_weight(
            places,
            above_furniture=options.above_furniture,
            odd_height=options.odd_height,
            low_m=options.low_m,
            high_m=options.high_m,
        )
        if options.radius_m:
            weight = weight * ~(self._environment.distance_to_surface(places) < options.radius_m)
        with np.errstate(divide="ignore"):
            return np.log(weight)

    def _usual(self, people: People, weighed: dict[str, Weights]) -> Float[Array, "n cameras"]:
        """What a person's heads usually weigh in each camera's pictures, after these."""
        usual, cloud = people.usual.copy(), people.roster.state
        for name, weights in weighed.items():
            number, share = self._number(name), cloud.weights.normalised * weights.seen.reshape(cloud.weights.log.shape)
            total = share.sum(axis=1)
            mean = (share * (weights.colour + weights.depth).reshape(share.shape)).sum(axis=1) / np.maximum(total, 1e-9)
            old = np.where(np.isnan(usual[:, number]), mean, usual[:, number])
            usual[:, number] = np.where(total > 0.5, old + _USUAL * (mean - old), usual[:, number])
        return usual

    def _look(self, pictures: dict[str, tuple[Picture, float]], weighed: dict[str, Weights]) -> None:
        """Who is shown; their colours are learned; who is not shown for long is gone."""
        people, options = self._people, self.options
        share, n_seen, shown = people.roster.state.weights.normalised, np.zeros(len(people)), np.zeros(len(people))
        for weights in weighed.values():
            n_seen += np.einsum("np,np->n", share, weights.seen.reshape(share.shape))
            shown += np.einsum("np,np->n", share, weights.shown.reshape(share.shape))
        is_shown = (n_seen > 0.5) & (shown >= options.life.least_shown * n_seen)
        if pictures and options.weights.colour.by_person:
            people = people.changed(colours=self._learned_colours(people, is_shown, pictures))
        roster = people.roster.measured(np.flatnonzero(is_shown), self._ns, people.roster.state)
        new = measured_often(roster, self._ns, options.life.confirm)
        roster = roster.confirm(np.flatnonzero(new), self._last_id + 1)
        self._last_id += int(new.sum())
        people = people.changed(roster=roster)
        self._people = people.select(self._staying(people))

    def _learned_colours(
        self, people: People, is_shown: Bool[Mask, "n"], pictures: dict[str, tuple[Picture, float]]
    ) -> HeadColours:
        """After a look at who is shown and faces surely somewhere, by one camera after another."""
        self._turn += 1
        name = list(pictures)[self._turn % len(pictures)]
        picture, later = pictures[name]
        yaw, sure = people.direction()
        pixels = self._watchers[name].look(picture, np.vstack([(people.place + later * people.velocity).T, yaw]))
        person, step, colour = pixels[:, (is_shown & (sure > _SURE))[pixels[0]]]
        return people.colours.learned(person, step, colour, self._learned.common, self.options.weights.colour)

    def _staying(self, people: People) -> Bool[Mask, "n"]:
        """Who goes on: shown lately, and not in the head of somebody older."""
        life, place = self.options.life, people.place
        if self.options.start:  # the paper's: who is known to be there stays, coasting at worst
            return np.ones(len(people), np.bool_)
        stays = coasting_within(people.roster, self._ns, life.gone_s, life.tentative_s)
        if len(people) > 1:
            near = np.tril(distances(place[:, :2], place[:, :2]) < life.same_head_m, -1)
            younger = near.any(axis=1) & ~(people.roster.confirmed & (people.roster.measured_ns == self._ns))
            stays &= ~younger
        return stays

    def _begin_known(self) -> None:
        """Heads whose start is known begin at their time."""
        due = [start for start in self._pending if start.at_s * NS_PER_S <= self._ns]
        self._pending = self._pending[len(due) :]
        if due:
            place, yaw = np.array([start.place for start in due]), np.radians([start.yaw_deg for start in due])
            started = self._started(place, yaw, self.options.life.spread_m)
            roster = started.roster.confirm(np.arange(len(due)), self._last_id + 1)
            self._last_id += len(due)
            self._people = self._people.joined(started.changed(roster=roster))

    def _find(self, pictures: dict[str, tuple[Picture, float]]) -> None:
        """Begin heads where the foreground shows somebody whom nobody follows; who was lost is found again."""
        people, life = self._people, self.options.life
        points = np.concatenate(
            [self._watchers[name].strangers(picture) for name, (picture, _) in pictures.items()], axis=1
        )
        points = points[:, (points[2] > 0.4) & (points[2] < 2.2)]
        shown = people.roster.measured_ns == self._ns
        found = newcomers(points, people.place[shown, :2], life)
        found = found[np.isfinite(self._room(found))] if len(found) else found
        if not len(found):
            return
        lost = np.flatnonzero(~shown)
        if lost.size:
            away = distances(found[:, :2], people.place[lost, :2])
            within = life.apart_m + _FAR_M_S * (self._ns - people.roster.measured_ns[lost]) / NS_PER_S
            away[away > within] = np.inf
            again = np.isfinite(away.min(axis=1))
            for k in np.flatnonzero(again):  # at most a few a moment
                row = lost[[away[k].argmin()]]
                cloud = around(found[[k]], None, life.spread_m, self.options.heads, self._rng)
                state = self._people.roster.state.replaced(row, cloud)
                self._people = self._people.changed(roster=self._people.roster.changed(state=state))
            found = found[~again]
        if len(found):
            self._people = self._people.joined(self._started(found, None, life.spread_m))

    def _started(self, place: Float[Array, "n 3"], yaw: Float[Array, "n"] | None, spread_m: float) -> People:
        cloud = around(place, yaw, spread_m, self.options.heads, self._rng)
        return People.started(cloud, self._ns, len(self._watchers))

    def _number(self, camera: str) -> int:
        return list(self._watchers).index(camera)


def _stereo_cameras(rig: Rig, chosen: Sequence[str]) -> dict[str, StereoSensor]:
    """The rig's stereo cameras, or those chosen; raises InputError where there is none of that name, or none at all."""
    found = {name: each for name, each in rig.sensors.items() if isinstance(each, StereoSensor)}
    if not found:
        raise InputError(
            f"tracker rgbd-head: none of the rig's sensors ({', '.join(rig.sensors)}) is a stereo camera; one of kind "
            "stereo, with colour and depth, is needed"
        )
    for name in chosen:
        if name not in found:
            raise InputError(
                f"tracker rgbd-head: cameras: there is no stereo camera {name!r}; valid are {', '.join(found)}"
            )
    return {name: each for name, each in found.items() if not chosen or name in chosen}
