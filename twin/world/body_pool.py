"""Bodies compiled with their room, and the pools of people who have bodies at the same time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count, groupby, takewhile
from math import inf
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.people.body.appearance import BodyAppearance
from twin.people.body.person_spec import NQ_PERSON, person_spec
from twin.people.posture.posture_rows import HISTORY_S, TICK_S
from twin.room.mjcf import compiled
from twin.scenario.action import RecordedPath
from twin.scenario.person import Person


@dataclass(frozen=True, eq=False)
class Bodies:
    """A compiled model and the maps from its elements to people.

    Arrays over people are in the order of the world, with -1 for people without a body, who are not in `names`.
    """

    names: tuple[str, ...]
    model: mujoco.MjModel
    person_of_geom: NDArray[np.int16]  # (n_geom,) id of the person a geom belongs to, 0 for the room
    qpos_address: NDArray[np.intp]  # (n_people, nq_person)
    head_site: NDArray[np.intp]  # (n_people,)
    point_site: NDArray[np.intp]  # (n_people, n_point) the fixed points on each body

    @classmethod
    def in_room(
        cls,
        room: mujoco.MjSpec,
        path: Path,
        all_names: tuple[str, ...],
        ids: Mapping[str, int],
        looks: Mapping[str, BodyAppearance],
        *,
        pictures: bool = True,
    ) -> Bodies:
        """Compile a copy of a room with the bodies of people in `looks`, in the order of `all_names`.

        `pictures`: False for a model that is never drawn. Raises InputError naming the room's file, `path`, if it does not
        compile.
        """
        spec = room.copy()
        names = tuple(name for name in all_names if name in looks)
        for together in _attached_together(names):
            first, group = together[0][0], mujoco.MjSpec()
            for name in together:
                body = person_spec(looks[name], pictures=pictures)
                group.attach(body, prefix=f"{name[1:]}/", frame=group.worldbody.add_frame())
            spec.attach(group, prefix=first, frame=spec.worldbody.add_frame())
        model = compiled(spec, path)
        places = [place for place, name in enumerate(all_names) if name in looks]

        def of_all(rows: NDArray[np.intp]) -> NDArray[np.intp]:
            numbers = np.full((len(all_names), *rows.shape[1:]), -1, dtype=np.intp)
            numbers[places] = rows
            return numbers

        heads = np.array([model.site(f"{name}/head").id for name in names], dtype=np.intp)
        return cls(
            names=names,
            model=model,
            person_of_geom=_person_of_geom(model, {name: ids[name] for name in names}),
            qpos_address=of_all(_addresses(model, names)),
            head_site=of_all(heads),
            point_site=of_all(_points(model, names)),
        )

    @property
    def there(self) -> NDArray[np.bool_]:
        """Mask (n_people,) of people with bodies."""
        return self.head_site >= 0


_MOST_TOGETHER = 20


def _attached_together(names: Sequence[str]) -> Iterator[Sequence[str]]:
    """Divide names into groups of one first letter, the prefix of the group, in their order.

    What an attachment costs grows with all that is there: in groups, 400 bodies take a fifth of the time, for the same model.
    """
    for _, alike in groupby(names, key=lambda name: name[0]):
        same = list(alike)
        yield from (same[k : k + _MOST_TOGETHER] for k in range(0, len(same), _MOST_TOGETHER))


def _person_of_geom(model: mujoco.MjModel, ids: Mapping[str, int]) -> NDArray[np.int16]:
    """Find the person of each geom by its root body, since a room's own body may share a person's name."""
    owner = np.zeros(model.nbody, dtype=np.int16)
    for name, number in ids.items():
        owner[model.jnt_bodyid[model.joint(f"{name}/root").id]] = number
    return owner[model.body_rootid[model.geom_bodyid]]


def _addresses(model: mujoco.MjModel, names: Sequence[str]) -> NDArray[np.intp]:
    """Return places of each person's coordinates in qpos: one free joint, then hinges, contiguous in the order of the
    body."""
    starts = [int(model.jnt_qposadr[model.joint(f"{name}/root").id]) for name in names]
    return np.array(starts, dtype=np.intp)[:, None] + np.arange(NQ_PERSON)


def _points(model: mujoco.MjModel, names: Sequence[str]) -> NDArray[np.intp]:
    """Return the sites of each person's fixed points, equal in number, (n_names, n_point)."""
    rows = []
    for name in names:
        numbers = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"{name}/point_{each:02d}") for each in count())
        rows.append(list(takewhile(lambda site: site >= 0, numbers)))
    return np.array(rows, dtype=np.intp).reshape(len(rows), -1 if rows else 0)


_LEAST = 32
"""Least number of temporary people in a pool, if there are so many: a new pool costs as much as its bodies."""
_SPARE_S = 2 * TICK_S
"""Time margin of bodies around their paths, as people come and go by the ticks of their clock [s]."""


@dataclass(frozen=True)
class BodyPool:
    """Pool of bodies: people with bodies from `from_s` until before `until_s` [s], sorted.

    All people in the room then or in the last `HISTORY_S` before, for sensors that look back.
    """

    names: tuple[str, ...]
    from_s: float
    until_s: float

    def covers(self, t: float) -> bool:
        """Return whether all people in the room at time t [s] have a body."""
        return self.from_s - HISTORY_S <= t < self.until_s


def body_pools(people: Mapping[str, Person]) -> tuple[BodyPool, ...]:
    """Plan the body pools of a scenario in order of time, the first from -inf and the last to inf.

    The times of recorded paths are known: a pool holds the people present at its start and as many later ones, in order of
    arrival, and ends when the next one comes. So there are never more than about twice as many bodies as people at once, and
    each is made a few times at most. People with scripts may leave at any time: they are in every pool.
    """
    stays = {name: _stay(person.script[0]) for name, person in people.items() if keeps_path(person)}
    always = [name for name in people if name not in stays]
    to_come = sorted(stays, key=lambda name: (stays[name], name))
    pools, from_s, known = [], -inf, list[str]()
    while True:
        starts_s = max(from_s, 0.0)
        there = [name for name in known if stays[name][1] >= from_s - HISTORY_S]
        while to_come and stays[to_come[0]][0] <= starts_s:
            there.append(to_come.pop(0))
        more = max(_LEAST - len(there), len(there))
        there, to_come = there + to_come[:more], to_come[more:]
        until_s = stays[to_come[0]][0] if to_come else inf
        pools.append(BodyPool(tuple(sorted([*always, *there])), from_s, until_s))
        if not to_come:
            return tuple(pools)
        from_s, known = until_s, there


def keeps_path(person: Person) -> bool:
    """Return whether a person keeps a recorded path."""
    return bool(person.script) and isinstance(person.script[0], RecordedPath)


def _stay(path: object) -> tuple[float, float]:
    """Return the presence of a recorded path: from and to [s], the longest possible."""
    assert isinstance(path, RecordedPath)
    return path.points[0][0] - _SPARE_S, path.points[-1][0] + _SPARE_S
