"""Who has a body when: the bodies of those who have left make way for those who come."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

from twin.people.posture.memory import HISTORY_S, TICK_S
from twin.scenario.behaviour import Path
from twin.scenario.people import Person

_LEAST = 32
"""So many who come and go are in every cast that can have them: a new cast costs what its bodies cost."""
_SPARE_S = 2 * TICK_S
"""A body is there a little before and after its path: people come and go by the ticks of their clock [s]."""


@dataclass(frozen=True)
class Cast:
    """The people who have bodies from `from_s` until before `until_s` [s], sorted: all who are in the room then.

    And all who are there in the last `HISTORY_S` before, since sensors look back.
    """

    names: tuple[str, ...]
    from_s: float
    until_s: float

    def serves(self, t: float) -> bool:
        """Whether everybody who is in the room at time t [s] has a body."""
        return self.from_s - HISTORY_S <= t < self.until_s


def casts_of(people: Mapping[str, Person]) -> tuple[Cast, ...]:
    """The casts of a scenario in order of time, the first from -inf and the last to inf.

    Of those who keep recorded paths it is known when they come and go: a cast holds who is there at its beginning and as
    many more, in the order in which they come, and lasts until the next one comes. So there are never more than about
    twice as many bodies as people at once, and each is made a few times at most. When all others leave their scripts
    and the crowd decide: they are in every cast.
    """
    stays = {name: _stay(person.script[0]) for name, person in people.items() if _keeps_a_path(person)}
    always = [name for name in people if name not in stays]
    to_come = sorted(stays, key=lambda name: (stays[name], name))
    casts, from_s, known = [], -inf, list[str]()
    while True:
        begins_s = max(from_s, 0.0)
        there = [name for name in known if stays[name][1] >= from_s - HISTORY_S]
        while to_come and stays[to_come[0]][0] <= begins_s:
            there.append(to_come.pop(0))
        more = max(_LEAST - len(there), len(there))
        there, to_come = there + to_come[:more], to_come[more:]
        until_s = stays[to_come[0]][0] if to_come else inf
        casts.append(Cast(tuple(sorted([*always, *there])), from_s, until_s))
        if not to_come:
            return tuple(casts)
        from_s, known = until_s, there


def _keeps_a_path(person: Person) -> bool:
    return bool(person.script) and isinstance(person.script[0], Path)


def _stay(path: object) -> tuple[float, float]:
    """When somebody who keeps a path is in the room, at most: from and to [s]."""
    assert isinstance(path, Path)
    return path.points[0][0] - _SPARE_S, path.points[-1][0] + _SPARE_S
