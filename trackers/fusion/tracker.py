"""`fusion`: one tracker on any subset of any rig.

Each observation is worked at its own stamp, but scans that follow within half a period are one look: one scanner shows the leg,
or the side of a trunk, that another does not. Predict every person to it; let the sensor say what it measures, and what it would
have shown; associate; update bodies, heads, existence and attributes; initiate, confirm and delete. Frames carry the stamps of
the rig's main sensor, and those of the others while it is silent.

The state is a Gaussian mixture per person, not particles: measurements of several sensors are a product of Gaussians, at a
thousandth of the cost, and the one likelihood that is none, a picture's of a head, is weighed at points.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import nan
from typing import Any

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.configuration import validate
from trackers.errors import InputError
from trackers.filters.imm import Imm
from trackers.filters.negative_information import radius_containing
from trackers.filters.rows import marked, written
from trackers.fusion.agreement import Agreement
from trackers.fusion.association import Pairs, pair
from trackers.fusion.camera_sources import CameraSource, cameras_of
from trackers.fusion.floor_source import FusedFloor
from trackers.fusion.heads import HeadWeighing, own
from trackers.fusion.look import Look, Source
from trackers.fusion.options import FusionOptions
from trackers.fusion.person_state import HEAD, PersonMotion, with_legs_free
from trackers.fusion.person_tracks import People
from trackers.fusion.posture import LEGS_REST_M, Posture
from trackers.fusion.scanner_sources import scanners_of
from trackers.fusion.shown_places import Camera
from trackers.fusion.track_manager import FusionTrackManager
from trackers.observations import NS_PER_S, Observation
from trackers.prior import Prior
from trackers.rig import Rig, RigSensor
from trackers.tracking.roster import NEVER_NS
from trackers.tracking.synced_frames import SyncedFrame, SyncPolicy
from trackers.tracking.synchronized_tracker import SynchronizedTracker
from trackers.tracks import Detection, Track, TrackFrame
from trackers.vision.head_colours import SHIPPED, load_head_model

_LEAST_SHARE = 0.02
_NEAR_TURN = 0.75
"""Share of the main sensor's period after which an observation of another one may stand in for it."""
_TOGETHER_S = 0.15
"""A trunk measured no longer ago tells where the legs are from there [s]."""
_LEAN_M = 0.2
"""Standard deviation, on each axis, of what is seen of a sitting person above the legs [m]."""
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
                "room is expected, or laser-legs, laser-imm or sort, which track from scanners that move"
            )
        main = rig.main if rig.main in used else None
        prior, rig = Prior.of(background), rig.model_copy(update={"sensors": used, "main": main})
        self._main, empty_room = rig.main_sensor, list(prior)
        self._imm = Imm(PersonMotion())
        self._manager = FusionTrackManager(self.options, rig.area, self._imm)
        area = self._manager.area
        cameras = cameras_of(rig, empty_room, self.options, area, prior.environment)
        floors = [FusedFloor(name, rig.floors(), empty_room, self.options.floor) for name in rig.floors()]
        self._scanners = scanners_of(rig, empty_room, self.options, area)
        self._sources: list[Source] = [*self._scanners, *cameras, *floors]
        self._of_legs = np.array([each.of_legs for each in self._sources])
        alone = len(self._scanners)
        self._groups = [*([k] for k in range(alone)), list(range(alone, alone + len(cameras)))]
        self._groups += [[k] for k in range(alone + len(cameras), len(self._sources))]  # associated at once, in turn
        self._weighing = HeadWeighing(load_head_model(prior.learned.get("heads", SHIPPED)), self.options.head)
        scanners = tuple(name for each in self._scanners for name in each.names)
        self.background_learned_causally = any(each.learns_background for each in self._sources)
        policy = SyncPolicy(tuple(rig.sensors), main=self._main, joined=scanners, max_wait_s=self.options.max_wait_s)
        super().__init__(policy)
        self._sees_waists = bool(self._scanners) and self._scanners[0].role == "waist"
        no_track, n_colour = self._imm.start(np.empty((0, 2))), cameras[0].camera.n_colour if cameras else 1
        self._people = People.started(no_track, np.empty((0, 2)), 0, n_colour, len(self._sources))
        self._ns: int | None = None
        self._looked_ns: dict[int, int] = {}
        self._main_ns: list[int] = []
        self._reported_ns = self._first_ns = 0
        self._stand_ins = frozenset[str]()  # of the first frame of others
        self._detections: list[Detection] = []
        self._agreement = Agreement([each.names for each in self._sources])

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
        rows = np.flatnonzero(self._manager.to_report(people, ns, self._of_legs))
        rows = rows[people.roster.id[rows].argsort()]
        radius_m = radius_containing(people.state, people.positions, 0.95, people.offset_m2)
        shown = ns - people.heads.seen_ns <= _HEAD_SHOWN_S * NS_PER_S
        head = np.where(shown[:, None], np.column_stack([people.head, people.heads.direction[0]]), nan)
        fresh = self._manager.is_fresh(people, ns)[rows].tolist()
        values = np.column_stack([people.positions, people.velocity, np.full(len(people), nan), head])[rows].tolist()
        each = zip(people.roster.id[rows].tolist(), values, fresh, radius_m[rows].tolist(), strict=True)
        return [
            Track(number, *row, status="confirmed" if is_fresh else "coasting", radius95_m=radius)
            for number, row, is_fresh, radius in each
        ]

    def _work_all(self, synced_frames: list[SyncedFrame]) -> list[TrackFrame]:
        """Work all looks; frames are those of the main sensor, and of others where it is silent or skips its turn."""
        self._detections, frames = [], []
        coming_ns = [each.ns for each in synced_frames if self._main in each.observations]
        coming_ns += self._synchronizer.waiting_ns(self._main)
        for synced in synced_frames:
            self._work(synced)
            if self._is_due(synced, coming_ns):
                self._reported_ns = synced.ns
                frames.append(TrackFrame(synced.ns, tuple(self.tracks()), self._maps()))
        return frames

    def _is_due(self, synced: SyncedFrame, coming_ns: list[int]) -> bool:
        """Tell whether a frame is reported; coming_ns: stamps of the main sensor that are not worked yet."""
        main, ns = self._main, synced.ns
        if main in synced.observations or main in synced.repeated:
            self._main_ns = [*self._main_ns[-4:], ns]
            return True
        if len(self._main_ns) < 3:
            return self._stands_in(synced)
        period_ns = float(np.median(np.diff(self._main_ns)))
        is_turn = ns - max(self._main_ns[-1], self._reported_ns) >= _NEAR_TURN * period_ns
        return is_turn and not any(ns < each <= ns + (1 - _NEAR_TURN) * period_ns for each in coming_ns)

    def _stands_in(self, synced: SyncedFrame) -> bool:
        """Tell whether a frame of others is reported as the main sensor has been silent for a second from its first frames on."""
        if not self._stand_ins:
            self._stand_ins, self._first_ns = frozenset(synced.observations), synced.ns
        known_ns = [self._first_ns, *self._main_ns]
        if self._stand_ins.isdisjoint(synced.observations):  # they may be silent too
            known_ns.append(self._reported_ns)
        return synced.ns - max(known_ns) > NS_PER_S

    def _work(self, synced: SyncedFrame) -> None:
        self._predict(synced.ns)
        for group in self._groups:
            expected = self._people.expected(self._by_trunk(self._people, synced.ns), synced.ns)
            looks = {
                number: look
                for number in group
                if (look := self._sources[number].look(synced.observations, expected, synced.ns)) is not None
            }
            if looks:
                self._detections.extend(each for look in looks.values() for each in look.shown)
                self._take(looks, synced.ns)
        self._people = self._manager.kept(self._people, synced.ns)

    def _predict(self, ns: int) -> None:
        """Take everybody on to stamp ns."""
        last_ns = ns if self._ns is None else self._ns
        self._ns, elapsed_s = ns, (ns - last_ns) / NS_PER_S
        people = self._manager.after_gap(self._people, last_ns, ns)
        if elapsed_s > 0 and len(people):
            people = people.in_state(self._imm.predict_over(people.state, elapsed_s, self.options.step_s))
            people = people.with_parts_later(elapsed_s, self.options.head)
            people = people.changed(heads=people.heads.turned(elapsed_s, people.velocity))
            people = self._manager.aged(people, elapsed_s)
            people = self._manager.without_doubles(people, elapsed_s)
        self._people = people

    def _take(self, looks: dict[int, Look], ns: int) -> None:
        """Take what sources measured at once, by their numbers: associate, update, initiate."""
        people, numbers, suspect = self._people, list(looks), self._agreement.suspect
        stated, looks = looks, {k: self._agreement.of_suspect(v, k) if suspect[k] else v for k, v in looks.items()}
        elapsed_s, share = {}, {}
        for number, look in looks.items():
            since_s = (ns - self._looked_ns.get(number, ns - round(look.kind.lasts_s * NS_PER_S))) / NS_PER_S
            self._looked_ns[number], elapsed_s[number] = ns, since_s
            share[number] = min(since_s / look.kind.lasts_s, 1.0)
        missed = [self._manager.missed(people, look) for look in looks.values()]
        by_trunk = self._by_trunk(people, ns)
        paired = [pair(people, *each, by_trunk) for each in zip(looks.values(), missed, strict=True)]
        self._agreement.age(people, ns)
        for number, chance, pairs in zip(numbers, missed, paired, strict=True):
            self._compare(people, stated[number], pairs, chance, share[number], number, ns)
        self._agreement.found()
        people = self._measured(people, paired, looks, ns)
        for look, pairs in zip(looks.values(), paired, strict=True):
            people = self._manager.felt(people, look, pairs, ns)
        trusted = [each for k in numbers if isinstance(each := self._sources[k], CameraSource) and not suspect[k]]
        people = self._by_pictures(people, list(dict.fromkeys(each.camera for each in trusted)), ns)
        for (number, look), chance in zip(looks.items(), missed, strict=True):
            if not suspect[number]:
                people = self._manager.contradicted(people, number, chance ** share[number], ns)
                people = self._manager.updated_missed(people, look, share[number], elapsed_s[number], ns)
        people = self._manager.without_noise(people, looks, ns)
        people = self._manager.initiated(people, looks, [each.column for each in paired], ns)
        self._people = self._manager.confirmed(people, ns, max(elapsed_s.values()))

    def _compare(
        self, people: People, look: Look, pairs: Pairs, missed: Float[Array, "n"], share: float, number: int, ns: int
    ) -> None:
        """Compare what a source measured with what the others did."""
        sigma_m = np.sqrt(look.covariance[pairs.column].trace(axis1=1, axis2=2) / 2)
        others_ns = np.where(np.arange(people.seen_ns.shape[1]) == number, NEVER_NS, people.seen_ns).max(axis=1)
        by_others = (ns - others_ns < _TOGETHER_S * NS_PER_S) & people.confirmed & ~people.posture.rests
        shown = marked(len(people), pairs.row)
        self._agreement.take(number, sigma_m, share * by_others * (1 - missed), shown)
        if isinstance(source := self._sources[number], CameraSource):
            source.learn_shown(people.positions, share * by_others, shown)

    def _measured(self, people: People, paired: list[Pairs], looks: dict[int, Look], ns: int) -> People:
        """Update tracks by their measurements; those of one source that follow soon tell together what one tells."""
        fields, whole = ("row", "log_ratio", "evidence"), list(zip(looks.values(), paired, strict=True))
        row, ratio, evidence = (np.concatenate([getattr(each, of) for each in paired]) for of in fields)
        if not row.size:
            return people
        place, covariance, stays_m2 = (
            np.concatenate([getattr(look, of)[each.column] for look, each in whole])
            for of in ("position", "covariance", "stays_m2")
        )
        number = np.repeat(list(looks), count := [each.row.size for each in paired])
        of_legs, of_heads = (
            np.repeat([getattr(look, of) for look, _ in whole], count) for of in ("of_legs", "of_heads")
        )
        kinds = [(look.kind.lasts_s, look.kind.p_detect, look.alike_s, look.by_posture[2]) for look, _ in whole]
        lasts_s, p_detect, alike_s, of_lying = np.repeat(np.array(kinds).T, count, axis=1)
        since_s = np.minimum((ns - people.seen_ns[row, number]) / NS_PER_S, 1.0)
        share, of_posture = (np.minimum(np.maximum(since_s / each, _LEAST_SHARE), 1.0) for each in (lasts_s, alike_s))
        posture = people.posture.detected(row, of_lying, of_posture)
        off_m, rest_at = people.off_rest(row, number, place, since_s, ns)
        posture = people.risen(posture, row, off_m, of_legs, share, ns)
        upright = np.maximum(1 - posture.low[row], _LEAST_SHARE)  # a lying person is not where a standing one would be
        lean_m = np.where(posture.rests[row] & ~of_legs & ~of_heads, _LEAN_M, 0.0)
        R = (covariance / share[:, None, None] + (lean_m**2)[:, None, None] * np.eye(2)) / upright[:, None, None]
        state = people.state
        for source, (look, each) in zip(looks, whole, strict=True):
            of = number == source
            if look.of_legs:
                posture = self._by_legs(people, posture, each.row, place[of], covariance[of, 0, 0], since_s[of], ns)
                state = with_legs_free(state, each.row, each.legs_moved * LEGS_REST_M**2)
            state = self._imm.update(state, each.row, place[of], R[of], look.observes)
        each = np.flatnonzero(marked(len(people), row))
        people = people.changed(posture=posture, roster=people.roster.measured(each, ns, state))
        people = self._manager.detected(people, row, ratio, share * upright * evidence, p_detect)
        offset_m2 = np.bincount(row, stays_m2)[each] / np.bincount(row)[each]
        seen_ns, seen_at = people.seen_ns.copy(), people.seen_at.copy()
        seen_ns[row, number], seen_at[row, number] = ns, place
        seat = people.positions
        for look, pairs in whole:
            if look.of_heads:  # a pelvis is about under a sitting head
                seat = written(seat, pairs.row, people.head[pairs.row, :2])
        return people.changed(
            place=written(people.place, each, people.positions[each]),
            posture=people.settled(seat, np.bincount(row, since_s, len(people)).astype(np.float64)),
            offset_m2=written(people.offset_m2, each, 0.8 * people.offset_m2[each] + 0.2 * offset_m2),
            seen_ns=seen_ns,
            seen_at=seen_at,
            rest_at=rest_at,
        )

    def _by_trunk(self, people: People, ns: int) -> Bool[Mask, "n"]:
        """Mark the people whose trunk was measured lately: their legs are near, wherever they were before."""
        if not self._sees_waists:
            return np.zeros(len(people), np.bool_)
        return ns - people.seen_ns[:, 0] <= _TOGETHER_S * NS_PER_S

    def _by_legs(
        self,
        people: People,
        posture: Posture,
        row: Int[Index, "p"],
        place: Float[Array, "p 2"],
        variance_m2: Float[Array, "p"],
        since_s: Float[Array, "p"],
        ns: int,
    ) -> Posture:
        """Weigh postures by how far legs are from trunks measured lately, without scanners of these from places of who was shown.

        Places that legs alone have shown lately tell nothing of how far legs are from them.
        """
        by = np.arange(people.seen_ns.shape[1]) == 0 if self._sees_waists else ~self._of_legs
        tells = ns - people.seen_ns[row][:, by].max(axis=1, initial=NEVER_NS) <= _TOGETHER_S * NS_PER_S
        trunk = people.seen_at[row, 0] if self._sees_waists else people.positions[row]
        if not self._sees_waists:
            variance_m2 = variance_m2 + people.covariance[row].trace(axis1=1, axis2=2) / 2
        return posture.by_legs(row[tells], (place - trunk)[tells], variance_m2[tells], since_s[tells])

    def _by_pictures(self, people: People, cameras: list[Camera], ns: int) -> People:
        """Update heads by pictures, bodies by their heads, and colours."""
        if not cameras or not len(people):
            return people
        before, head, crowns, covariance = people.heads, people.head, people.crowns, people.head_covariance
        sigma_m = np.sqrt((covariance[:, 0, 0] + covariance[:, 1, 1]) / 2)
        asked = people.confirmed & own(head)
        in_view = np.array([each.sees(head, crowns) for each in cameras]) & asked
        views = zip(cameras, in_view, strict=True)
        alone = [each.stands_alone(head, sigma_m, crowns) if of.any() else of for each, of in views]
        outlined = np.array(alone) & in_view
        since_s = np.minimum((ns - before.seen_ns) / NS_PER_S, 1.0)
        share = np.clip(since_s / 0.05, 0.25, 1.0)
        heads, row, place, R = self._weighing.updated(before, head, covariance, cameras, in_view, outlined, share, ns)
        due = outlined.any(axis=0) & ~marked(len(people), row)
        people = people.with_heads(heads, due, ns)
        if row.size:
            state = self._imm.update(people.state, row, place, R, HEAD)
            people = people.changed(roster=people.roster.measured(row, ns, state))
            height_m, variance_m2 = people.head[row, 2], people.head_covariance[row, 2, 2]
            unsure_m2 = variance_m2 + people.stature_m2[row]
            posture = people.posture.by_head(row, height_m, unsure_m2, people.stature[row], since_s[row])
            people = people.changed(posture=posture)
            people = people.learn_stature(row, height_m, variance_m2, since_s[row], self.options.identity.grows_s)
        asked = (people.roster.measured_ns == ns) & ~people.posture.lies
        seen = [each.colours(people.crowns, people.stature, asked) for each in cameras]
        clear = np.array([each for _, each in seen])
        looked = np.flatnonzero(clear.any(axis=0))
        if looked.size:
            histograms = np.einsum("cn,cnb->nb", clear / np.maximum(clear.sum(axis=0), 1), [each for each, _ in seen])
            people = self._manager.identities.looked(people, looked, histograms[looked], ns)
        return people


def _is_fixed(sensor: RigSensor) -> bool:
    """Tell whether a sensor stays in the room, and observes people."""
    return sensor.kind != "odometry" and getattr(sensor, "mounted_on", None) is None
