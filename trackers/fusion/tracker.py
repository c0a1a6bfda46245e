"""`fusion`: one tracker on any subset of any rig.

Each observation is worked at its own stamp: predict every person to it; let the sensor say what it measures, and what it would
have shown; associate; update bodies, heads, existence and attributes; initiate, confirm and delete. Frames carry the stamps of
the rig's main sensor, and those of the others while it is silent.

The state is a Gaussian mixture per person, not particles: measurements of several sensors are a product of Gaussians, at a
thousandth of the cost, and the one likelihood that is none, a picture's of a head, is weighed at points.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from math import nan
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from trackers.arrays import Array, Index
from trackers.configuration import validate
from trackers.errors import InputError
from trackers.filters.imm import Imm
from trackers.filters.motion import VelocityMotion
from trackers.filters.negative_information import radius_containing
from trackers.filters.rows import written
from trackers.fusion.agreement import Agreement
from trackers.fusion.association import explained, pairs
from trackers.fusion.cameras import Camera, cameras_of, clearest_first
from trackers.fusion.floors import FusedFloor
from trackers.fusion.heads import HeadWeighing, gained
from trackers.fusion.lasers import scanners_of
from trackers.fusion.look import Look, Source
from trackers.fusion.options import FusionOptions
from trackers.fusion.people import People
from trackers.fusion.posture import OFF_BODY
from trackers.fusion.track_manager import FusionTrackManager
from trackers.observations import NS_PER_S, Observation
from trackers.prior import Prior
from trackers.rig import Rig, RigSensor
from trackers.tracking.roster import NEVER_NS
from trackers.tracking.synced_frames import SyncedFrame, SyncPolicy
from trackers.tracking.synced_tracker import SynchronizedTracker
from trackers.tracks import Detection, Track, TrackFrame
from trackers.vision.head_colours import SHIPPED, load_head_model

logger = logging.getLogger(__name__)

_START_SPEED_M_S = 1.0
_LEAST_SHARE = 0.02
_LEAN_M, _FEET_M = 0.2, 0.35
"""Standard deviation, on each axis, of what is seen of a sitting person, and stood on, from the pelvis [m]."""
_TOGETHER_S = 0.15
"""A trunk measured no longer ago tells where the legs are from there [s]."""
_OVER_M, _LEAST_OVER = 0.2, 0.2
"""Standard deviation of a head from over the body [m], and share of that which one picture tells."""
_STATURE_M = 0.2
"""Standard deviation of statures [m]."""
_HEAD_SHOWN_S = 1.0
"""A head that no picture has shown for longer is not reported [s]."""


class Fusion(SynchronizedTracker):
    """Tracker of people by whatever a rig has (see module). Options are those of `FusionOptions`.

    background: observations of the empty room, and what else is known of it; sensors without any learn it as they go. Nothing
    here is random: `rng` is not used. Raises InputError for an unknown or wrong option.
    """

    Options = FusionOptions

    def __init__(
        self, rig: Rig, background: Iterable[Observation] = (), rng: np.random.Generator | None = None, **options: Any
    ) -> None:
        self.options = validate(FusionOptions, options, "tracker fusion")
        self.unused_sensors = [name for name, each in rig.sensors.items() if not _is_fixed(each)]
        used = {name: each for name, each in rig.sensors.items() if _is_fixed(each)}
        if not used:
            raise InputError(
                f"tracker fusion: all sensors of the rig ({', '.join(rig.sensors)}) are on a moving base; one that stays in the "
                "room is expected"
            )
        main = rig.main if rig.main in used else None
        prior, rig = Prior.of(background), rig.model_copy(update={"sensors": used, "main": main})
        self._main = rig.main_sensor
        # what one source shows is known to the next: in an order that neither the file's nor the names' changes
        placed = dict(sorted(used.items(), key=lambda each: each[1].room_from_sensor.matrix.ravel().tolist()))
        rig = rig.model_copy(update={"sensors": placed, "main": self._main})
        empty_room = list(prior)
        self._imm = Imm(VelocityMotion())
        self._manager = FusionTrackManager(self.options, rig.area, self._imm)
        area = self._manager.area
        cameras = cameras_of(rig, empty_room, self.options, area, prior.environment)
        floors = [FusedFloor(name, each, empty_room, self.options.floor) for name, each in rig.floors().items()]
        self._scanners = scanners_of(rig, empty_room, self.options, area)
        self._sources: list[Source] = [*self._scanners, *cameras, *floors]
        self._weighings: dict[str, HeadWeighing] = {}
        if cameras:
            model = load_head_model(prior.learned.get("heads", SHIPPED))
            self._weighings = {
                each.names[0]: HeadWeighing(each.camera, model, self.options.head, area) for each in cameras
            }
        self.background_learned_causally = any(each.learns_background for each in self._sources)
        super().__init__(
            SyncPolicy(tuple(rig.sensors), main=self._main, within_s=0.0, max_wait_s=self.options.max_wait_s)
        )
        self._sees_waists = bool(self._scanners) and self._scanners[0].role == "waist"
        self._n_colour = cameras[0].n_colour if cameras else 1
        self._next_serial = 1
        self._people = self._started(np.empty((0, 2)), 0)
        self._ns: int | None = None
        self._looked_ns: dict[int, int] = {}
        self._main_ns: list[int] = []
        self._reported_ns: int | None = None
        self._detections: list[Detection] = []
        self._agreement = Agreement([each.names for each in self._sources])
        self._doubted = self._agreement.doubted

    @property
    def warnings(self) -> list[str]:
        """Findings: sensors that have contradicted the others, each when it first did."""
        return list(self._agreement.findings.values())

    def detections(self) -> list[Detection]:
        """Return the measurements of the frames of the last `update` or `finish`, oldest first."""
        return self._detections

    def tracks(self) -> list[Track]:
        """Return everybody confirmed, as of the last frame, by id."""
        people, ns = self._people, self._ns
        if ns is None or not len(people):
            return []
        rows = np.flatnonzero(self._manager.to_report(people, ns))
        people = people.select(rows[people.roster.id[rows].argsort()])
        position, velocity, heads = people.positions, people.velocity, people.heads
        radius_m = radius_containing(people.state, position, 0.95, people.offset_m2)
        shown = ns - heads.seen_ns <= _HEAD_SHOWN_S * NS_PER_S
        head = np.where(shown[:, None], heads.mean[:, :3], nan)
        yaw = np.where(shown, heads.direction[0], nan)
        fresh = self._manager.is_fresh(people, ns)
        values = np.column_stack([position, velocity, np.full(len(people), nan), head, yaw]).tolist()
        return [
            Track(number, *row, status="confirmed" if is_fresh else "coasting", radius95_m=radius)
            for number, row, is_fresh, radius in zip(
                people.roster.id.tolist(), values, fresh.tolist(), radius_m.tolist(), strict=True
            )
        ]

    def _work_all(self, synced_frames: list[SyncedFrame]) -> list[TrackFrame]:
        """Work all looks; frames are those of the main sensor, and of others while that is silent."""
        self._detections, frames = [], []
        for synced in synced_frames:
            self._work(synced)
            if self._is_due(synced):
                self._reported_ns = synced.ns
                frames.append(TrackFrame(synced.ns, tuple(self.tracks()), self._maps()))
        return frames

    def _is_due(self, synced: SyncedFrame) -> bool:
        main = self._main
        if main in synced.observations or main in synced.repeated:
            self._main_ns = [*self._main_ns[-4:], synced.ns]
            return True
        if len(self._main_ns) < 3 or self._reported_ns is None:
            return not self._main_ns and self._silent_from_the_start(synced.ns)
        return synced.ns - self._reported_ns > 1.6 * float(np.median(np.diff(self._main_ns)))

    def _silent_from_the_start(self, ns: int) -> bool:
        """Tell whether the main sensor has not reported for a second from the first observation on."""
        self._reported_ns = ns if self._reported_ns is None else self._reported_ns
        return ns - self._reported_ns > NS_PER_S

    def _work(self, synced: SyncedFrame) -> None:
        self._predict(synced.ns)
        people = self._people
        for number in clearest_first(self._sources, people.positions[people.confirmed]):
            source = self._sources[number]
            look = source.look(synced.observations, self._people.expected(), synced.ns)
            if look is not None:
                self._detections.extend(look.shown)
                self._take(look, number, synced.ns)
        self._people = self._manager.kept(self._people, synced.ns)

    def _predict(self, ns: int) -> None:
        """Take everybody on to stamp ns."""
        last_ns = ns if self._ns is None else self._ns
        self._ns, elapsed_s = ns, (ns - last_ns) / NS_PER_S
        people = self._manager.after_gap(self._people, last_ns, ns)
        if elapsed_s > 0 and len(people):
            people = people.in_state(self._imm.predict_over(people.state, elapsed_s, self.options.step_s))
            heads = people.heads.predicted(elapsed_s, people.velocity, self.options.head)
            people = self._manager.aged(people.changed(heads=heads), elapsed_s)
            people = self._manager.without_doubles(people, elapsed_s)
        self._people = people

    def _take(self, look: Look, number: int, ns: int) -> None:
        """Take what one source measured: associate, update, initiate. number: of the source."""
        elapsed_s = (ns - self._looked_ns.get(number, ns - round(look.kind.lasts_s * NS_PER_S))) / NS_PER_S
        self._looked_ns[number] = ns
        share = min(elapsed_s / look.kind.lasts_s, 1.0)
        people, doubted = self._people, bool(self._doubted[number])
        if doubted:
            people = people if look.feet is None else people.upright()
            look = self._agreement.of_doubted(look, number)
        missed = self._manager.missed(people, look)
        row, column, ratio = pairs(people, look, missed)
        self._compare(people, look, row, column, missed, share, number, ns)
        people = self._measured(people, row, column, ratio, look, number, ns)
        source = self._sources[number]
        if isinstance(source, Camera) and source.picture is not None:
            people = self._by_picture(people, source, number, ns)
        if not doubted:
            people = self._manager.updated_missed(people, look, share, elapsed_s, ns, number)
        people = self._manager.confirmed(people, ns, elapsed_s)
        taken = np.zeros(len(look.position), np.bool_)
        taken[column] = True
        start = look.starts & ~taken & ~explained(people, look) & self._manager.clear_of_seats(people, look.position)
        start &= self._manager.may_start(look.position, np.concatenate([people.positions, look.position[taken]]))
        if start.any():
            people = people.joined(self._started(look.position[start], ns, number))
        self._people = people

    def _compare(
        self,
        people: People,
        look: Look,
        row: Int[Index, "p"],
        column: Int[Index, "p"],
        missed: Float[Array, "n"],
        share: float,
        number: int,
        ns: int,
    ) -> None:
        """Compare what a source measured with what the others did, and say once what contradicts them."""
        agreement = self._agreement
        agreement.age(ns)
        sigma_m = np.sqrt(look.covariance[column].trace(axis1=1, axis2=2) / 2)
        agreement.take(number, people, row, look.position[column], sigma_m, ns)
        others_ns = np.delete(people.seen_ns, number, axis=1).max(axis=1, initial=NEVER_NS)
        by_others = (ns - others_ns < _TOGETHER_S * NS_PER_S) & people.confirmed & ~people.posture.rests
        shown = np.zeros(len(people), np.bool_)
        shown[row] = True
        agreement.take_shown(number, share * by_others * (1 - missed), shown)
        self._doubted = agreement.doubted
        for sentence in agreement.found():
            logger.warning(sentence)

    def _measured(
        self,
        people: People,
        row: Int[Index, "p"],
        column: Int[Index, "p"],
        ratio: Float[Array, "p"],
        look: Look,
        number: int,
        ns: int,
    ) -> People:
        """Update the tracks at `row` by the measurements at `column`; those that follow soon tell together what one tells."""
        if not row.size:
            return people
        kind = look.kind
        since_s = np.minimum((ns - people.seen_ns[row, number]) / NS_PER_S, 1.0)
        share = np.clip(since_s / kind.lasts_s, _LEAST_SHARE, 1.0)
        R = look.covariance[column] / share[:, None, None]
        posture = people.posture.detected(row, look.by_posture, share)
        posture = posture.by_place(row, look.position[column], np.hypot(*people.velocity[row].T), share)
        if look.feet is not None and self._sees_waists:
            known = np.flatnonzero(ns - people.seen_ns[row, 0] <= _TOGETHER_S * NS_PER_S)
            known = known[look.feet[column[known]] | posture.rests[row[known]]]
            legs = look.position[column[known]] + posture.seated_knees[row[known]] - people.seen_at[row[known], 0]
            posture = posture.by_legs(row[known], legs, since_s[known])
        rests = posture.rests[row, None, None]
        upright = np.maximum(1 - posture.low[row], _LEAST_SHARE)  # a lying person is not where a standing one would be
        R = (R + (_LEAN_M if look.load_n is None else _FEET_M) ** 2 * np.eye(2) * rests) / upright[:, None, None]
        people = people.changed(posture=posture)
        state = self._imm.update(people.state, row, look.position[column], R)
        people = people.changed(roster=people.roster.measured(row, ns, state))
        people = self._manager.detected(people, row, ratio, share * upright, look)
        offset = 0.8 * people.offset_m2[row] + 0.2 * kind.offset_m**2
        seen_ns, seen_at = people.seen_ns.copy(), people.seen_at.copy()
        seen_ns[row, number], seen_at[row, number] = ns, look.position[column]
        people = people.changed(
            place=written(people.place, row, people.positions[row]),
            posture=people.posture.settled(people.positions),
            offset_m2=written(people.offset_m2, row, offset),
            seen_ns=seen_ns,
            seen_at=seen_at,
        )
        if look.load_n is not None:
            old = people.load_n[row]
            load_n = np.where(np.isnan(old), look.load_n[column], 0.95 * old + 0.05 * look.load_n[column])
            people = people.changed(load_n=written(people.load_n, row, load_n))
        if look.head is not None:
            variance = np.full((row.size, 3), kind.sigma_m**2) / share[:, None]
            people = people.changed(heads=people.heads.measured(row, look.head[column], variance))
        return people

    def _by_picture(self, people: People, camera: Camera, number: int, ns: int) -> People:
        """Update heads by a picture, bodies by their heads, and colours."""
        picture, kind = camera.picture, self.options.camera
        assert picture is not None
        unsure_m2 = np.where(np.isnan(people.stature_m), _STATURE_M**2, 0.0)
        height_m, spread_m2 = people.posture.head_height(people.stature)
        over = np.column_stack([people.positions, height_m])  # heads are over bodies, more or less
        flat_m2 = np.full(len(people), _OVER_M**2)
        variance = np.column_stack([flat_m2, flat_m2, spread_m2 + unsure_m2]) / _LEAST_OVER
        heads = people.heads.measured(np.arange(len(people)), over, variance)
        heads = heads.again_over(people.positions)
        in_view = np.flatnonzero(people.confirmed & heads.own & camera.sees(heads.mean[:, :3], people.positions))
        since_s = np.minimum((ns - heads.seen_ns[in_view]) / NS_PER_S, 1.0)
        share = np.clip(since_s / 0.05, 0.25, 1.0)
        before = heads
        heads, shown = self._weighings[camera.names[0]].updated(heads, in_view, picture.packed, share, ns)
        people, row = people.changed(heads=heads), in_view[shown]
        if row.size:
            variance = heads.covariance[row, 2, 2] + unsure_m2[row]
            posture = people.posture.by_head(row, heads.mean[row, 2], variance, people.stature[row], since_s[shown])
            people = self._manager.head_shown(people.changed(posture=posture), row, kind, share[shown], ns)
            people = people.learn_stature(row, self.options.identity.memory)
            variance = self.options.head.over_body_m**2 * people.posture.shown(OFF_BODY)[row]
            share = np.clip(since_s[shown] / kind.lasts_s, _LEAST_SHARE, 1.0)
            place, covariance = gained(before.select(row), heads.select(row))
            R = covariance + (variance / share)[:, None, None] * np.eye(2)
            state = self._imm.update(people.state, row, place, R)
            people = people.changed(roster=people.roster.measured(row, ns, state))
        histograms, clear = camera.colours(people.positions, people.stature)
        looked = np.flatnonzero(clear & (people.roster.measured_ns == ns) & ~people.posture.lies)
        if looked.size:
            memory = self.options.identity.memory
            clothes = people.clothes.learned(looked, histograms[looked], np.zeros(looked.size, np.bool_), 0, memory)
            people = people.changed(clothes=clothes)
        return people

    def _started(self, place: Float[Array, "n 2"], ns: int, number: int | None = None) -> People:
        """Make tentative tracks that a source has measured first."""
        state = self._imm.start(place, None, self.options.trunk.sigma_m**2, _START_SPEED_M_S**2)
        self._next_serial += len(place)
        first = self._next_serial - len(place)
        people = People.started(state, place, ns, self._n_colour, len(self._sources), first)
        if number is None:
            return people
        people.seen_ns[:, number], people.seen_at[:, number] = ns, place
        return people


def _is_fixed(sensor: RigSensor) -> bool:
    """Tell whether a sensor stays in the room, and observes people."""
    return sensor.kind != "odometry" and getattr(sensor, "mounted_on", None) is None
