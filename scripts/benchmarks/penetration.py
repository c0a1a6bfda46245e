"""Penetration of bodies into each other and into the room over a run, by `twin.people.posture.body_measures`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from twin.instant.snapshot import Snapshot, SnapshotSource
from twin.people.posture.body_measures import TOLERANCE_M, Allowed, Penetration, PenetrationCheck
from twin.room.furniture import Bed, Seat
from twin.world.world import World


def penetrations(snapshot: Snapshot, allowed: Allowed | None = None, least_m: float = TOLERANCE_M) -> list[Penetration]:
    """Find overlaps of people with each other and with the room in one snapshot, deeper than `least_m` [m]."""
    return PenetrationCheck(snapshot.model, snapshot.person_of_geom).at(snapshot, allowed, least_m)


@dataclass
class PenetrationCount:
    """Overlaps of a run: number of times, of those with an overlap, and the deepest overlap of each pair."""

    samples: int = 0
    with_overlap: int = 0
    deepest: dict[tuple[int, int, str], Penetration] = field(default_factory=dict)

    @property
    def depth_m(self) -> float:
        """The deepest overlap of the run [m], 0 without any."""
        return max((each.depth_m for each in self.deepest.values()), default=0.0)

    def add(self, found: Iterable[Penetration]) -> None:
        """Count one time and its overlaps."""
        self.samples += 1
        any_found = False
        for each in found:
            any_found = True
            key = (each.person, each.other, "" if each.other else each.other_geom)
            if key not in self.deepest or each.depth_m > self.deepest[key].depth_m:
                self.deepest[key] = each
        self.with_overlap += any_found

    def __str__(self) -> str:
        """One line a pair, deepest first."""
        worst = sorted(self.deepest.values(), key=lambda each: -each.depth_m)
        lines = [
            f"t = {each.t:.2f} s: {each.geom} {100 * each.depth_m:.1f} cm inside {each.other_geom}" for each in worst
        ]
        return "\n".join([f"{self.with_overlap} of {self.samples} samples hold overlaps", *lines])


def count_penetrations(
    world: SnapshotSource,
    times: Iterable[float],
    allowed: Callable[[float], Allowed] | None = None,
    least_m: float = TOLERANCE_M,
) -> PenetrationCount:
    """Count overlaps over a simulation at rising `times` [s]; `allowed(t)`: exceptions at that time."""
    count = PenetrationCount()
    check: PenetrationCheck | None = None
    for t in times:
        snapshot = world.snapshot(t)
        if check is None or check.model is not snapshot.model:
            check = PenetrationCheck(snapshot.model, snapshot.person_of_geom)
        count.add(check.at(snapshot, allowed(t) if allowed is not None else None, least_m))
    return count


def furniture_in_use(world: World) -> Allowed:
    """Return the geoms that people press into who sit or lie, or are about to."""
    ids, names = world.scene.ids, world.population.names
    in_use: dict[int, list[int]] = {}
    for name, number in world.population._context.taken.items():
        furniture = world.scene.ground.furniture[name]
        assert isinstance(furniture, Seat | Bed)
        in_use[ids[names[number]]] = sorted(furniture.geoms)
    return in_use
