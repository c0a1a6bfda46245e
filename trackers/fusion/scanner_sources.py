"""Sources of people by laser scanners: trunks at waist height, legs at knee height, shared out two to each expected person."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trackers.area import Area
from trackers.arrays import Array, Bool, Float, Mask
from trackers.fusion.look import APART_M, NEW, Expected, Look, most_nats, round_covariance
from trackers.fusion.options import FusionOptions, KindOptions
from trackers.fusion.person_state import LEGS, PLACE
from trackers.fusion.posture import LEGS_SHOWN, TRUNK_SHOWN
from trackers.laser.group import ScannerGroup, scanners_by_role
from trackers.laser.layer import KneeOptions, LayerOptions, WaistOptions
from trackers.likelihood.legs import LegOptions, legs_ahead_m, may_be_new, pair_legs
from trackers.observations import LaserScan, Observation
from trackers.rig import Rig, Role

_SURE_SAMPLES = 4
"""Samples of a cluster from which it is neither noise nor an edge, where the empty room is known."""
_START_NATS = 1.0
"""Log-likelihood ratio of a leg from which a cluster starts a track, where the background is learned [nat]."""


class Scanners:
    """All scanners of one height. waists: the rig's others at waist height: where they would show a trunk, a leg is no person."""

    def __init__(
        self,
        group: ScannerGroup,
        role: Role,
        height_m: float,
        kind: KindOptions,
        area: Area | None,
        waists: Scanners | None = None,
    ) -> None:
        self.role: Role = role
        self._height_m = height_m
        self._group, self._kind, self._area = group, kind, area
        self._waists, self._scans = waists, dict[str, LaserScan]()
        self._legs = LegOptions(variance_m2=kind.sigma_m**2)

    @property
    def names(self) -> tuple[str, ...]:
        """The scanners."""
        return self._group.names

    @property
    def of_legs(self) -> bool:
        """True at knee height."""
        return self.role == "knee"

    @property
    def learns_background(self) -> bool:
        """True where a scanner came without scans of the empty room."""
        return self._group.learns_background

    def would_show(self, points: Float[Array, "k 2"]) -> Bool[Mask, "k"]:
        """Mark the points [m] at which the last scans would rather show a person than not."""
        return self._group.missed(self._scans, points.T) < 0.5

    def look(self, observations: Mapping[str, Observation], expected: Expected, ns: int) -> Look | None:
        """Return the trunks, or people by their legs, in the scans of one stamp."""
        scans = {name: each for name in self.names if isinstance(each := observations.get(name), LaserScan)}
        if not scans:
            return None
        self._scans |= scans
        found = self._group.detect(scans, weak=True)
        if self._area is not None and len(found):
            found = found.select(self._area.contains(found.position))
        position, variance = found.position, self._kind.sigma_m**2 + found.variance_m2
        starts, n_sample = self._group.sufficient(found), found.n_sample
        owner, evidence, likeness = np.full(len(position), -1), np.ones(len(position)), None
        if self.role == "knee":
            gate_m = self._legs.gate_m if self._waists else self._legs.gate_alone_m
            no_trunk = np.empty((0, 2))
            # shanks lean forward: knees are before the feet
            ahead_m = legs_ahead_m(expected.speed_m_s, self._height_m, self._legs)
            knees = expected.legs + expected.facing * ahead_m[:, None]
            # where trunks tell where the middle of the legs is, what a leg hides did not earn
            lines = None if self._waists else found.sight_lines(self._group.origins)
            at, shown = expected.place, expected.by_trunk
            walkers = pair_legs(found, starts, no_trunk, at, knees, APART_M, gate_m, self._legs, lines, shown)
            position, known = walkers.position, walkers.of_known
            position[known] += expected.legs[walkers.owner[known]]
            variance = walkers.likelihood(self._legs, gate_m).variance_m2
            n_sample = walkers.n_sample
            starts = walkers.n_leg > 1
            starts |= ~self._waists.would_show(position) if self._waists else True
            bodies = np.concatenate([expected.place, expected.place + expected.legs, position[known]])
            single = walkers.n_leg == 1
            starts = may_be_new(position, single, starts & ~known, bodies, self._legs.start_apart_m)
            # split beams at an edge look like a leg, but not twice: a hidden person is not moved to one; and a leg, up to half a
            # stride from the body, tells by its place alone less of whose it is than all legs together
            owner = np.where(single & starts, NEW, np.where(single, walkers.owner, -1))
            # with scanners at waist height, one leg alone is half of what shows a person: they miss the trunk, or are hidden
            evidence = np.where(single & (self._waists is not None), 0.5, 1.0)
            if self._group.is_learning:
                may_be_leg, likeness = self._like_legs(scans, position)
                starts &= may_be_leg
        sure = n_sample >= _SURE_SAMPLES
        if self._group.is_learning:
            sure &= self._group.seen_behind(position)
        return Look(
            tuple(scans),
            self._kind,
            position,
            round_covariance(variance),
            np.where(starts, np.where(sure, 2, 1), 0),
            owner,
            lambda points: self._group.missed(scans, points),
            TRUNK_SHOWN if self.role == "waist" else LEGS_SHOWN,
            is_sharp=True,
            observes=LEGS if self.role == "knee" else PLACE,
            shown=tuple(self._group.to_detections(found, self.role, ns)),
            evidence=evidence,
            likeness=likeness,
        )

    def _like_legs(
        self, scans: Mapping[str, Observation], position: Float[Array, "k 2"]
    ) -> tuple[Bool[Mask, "k"], Float[Array, "k"]]:
        """Mark measurements that may start tracks though the background is still learned; return the likeness of each.

        Before the open a dark surface is met now and then: there what is new counts by its likeness to legs alone.
        """
        nats = self._group.leg_evidence(scans, position)
        likeness = np.clip(nats / most_nats(self._kind.p_detect), -1.0, 1.0)
        return nats > _START_NATS, np.where(self._group.seen_behind(position), 1.0, likeness)


def scanners_of(
    rig: Rig, empty_room: Sequence[Observation], options: FusionOptions, area: Area | None
) -> list[Scanners]:
    """Make the scanners of a rig, waists first; none where it has none."""
    if not rig.lasers():
        return []
    lasers, names = rig.lasers(), scanners_by_role(rig, ("waist", "knee"))
    layers: dict[Role, tuple[LayerOptions, KindOptions]] = {
        "waist": (WaistOptions(outlines=True, weak_samples=1), options.trunk),
        "knee": (KneeOptions(), options.legs),
    }
    found: dict[Role, Scanners] = {}
    for role, of_role in names.items():
        layer, kind = layers[role]
        seen = layer.free_space.model_copy(update={"detected": kind.p_detect})
        layer = layer.model_copy(update={"free_space": seen})
        group = ScannerGroup({name: lasers[name] for name in of_role}, empty_room, layer)
        height_m = float(np.mean([lasers[name].room_from_sensor.translation[2] for name in of_role]))
        found[role] = Scanners(group, role, height_m, kind, area, found.get("waist"))
    return list(found.values())
