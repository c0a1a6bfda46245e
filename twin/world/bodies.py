"""The bodies of a scene's people, or of some of them, compiled with the room they are in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.people.body.appearance import Appearance
from twin.people.body.body import NQ_PERSON, person_spec
from twin.room.model import compiled


@dataclass(frozen=True, eq=False)
class Bodies:
    """A compiled model and the maps from its elements to people.

    Arrays over people are in the order of `everybody`; of those who have no body, who are not in `names`, they hold -1.
    """

    everybody: tuple[str, ...]
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
        everybody: tuple[str, ...],
        ids: Mapping[str, int],
        looks: Mapping[str, Appearance],
    ) -> Bodies:
        """The bodies of those who have `looks`, in the order of `everybody`, in a room, which stays as it is.

        Raises InputError naming the room's file, `path`, where the whole does not compile.
        """
        spec = room.copy()
        names = tuple(name for name in everybody if name in looks)
        for name in names:
            spec.attach(person_spec(looks[name]), prefix=f"{name}/", frame=spec.worldbody.add_frame())
        model = compiled(spec, path)
        places = [place for place, name in enumerate(everybody) if name in looks]

        def of_everybody(rows: NDArray[np.intp]) -> NDArray[np.intp]:
            numbers = np.full((len(everybody), *rows.shape[1:]), -1, dtype=np.intp)
            numbers[places] = rows
            return numbers

        heads = np.array([model.site(f"{name}/head").id for name in names], dtype=np.intp)
        return cls(
            everybody=everybody,
            names=names,
            model=model,
            person_of_geom=_person_of_geom(model, {name: ids[name] for name in names}),
            qpos_address=of_everybody(_addresses(model, names)),
            head_site=of_everybody(heads),
            point_site=of_everybody(_points(model, names)),
        )

    @property
    def there(self) -> NDArray[np.bool_]:
        """Who has a body, (n_people,)."""
        return self.head_site >= 0


def _person_of_geom(model: mujoco.MjModel, ids: Mapping[str, int]) -> NDArray[np.int16]:
    """By the body at the root of each person: a room's own body may be called like a person."""
    owner = np.zeros(model.nbody, dtype=np.int16)
    for name, number in ids.items():
        owner[model.jnt_bodyid[model.joint(f"{name}/root").id]] = number
    return owner[model.body_rootid[model.geom_bodyid]]


def _addresses(model: mujoco.MjModel, names: Sequence[str]) -> NDArray[np.intp]:
    """Places of each person's coordinates in qpos: one free joint, then hinges, contiguous in the order of the body."""
    starts = [int(model.jnt_qposadr[model.joint(f"{name}/root").id]) for name in names]
    return np.array(starts, dtype=np.intp)[:, None] + np.arange(NQ_PERSON)


def _points(model: mujoco.MjModel, names: Sequence[str]) -> NDArray[np.intp]:
    """The sites of each person's fixed points, of which everybody has as many, (n_names, n_point)."""
    rows = []
    for name in names:
        numbers = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"{name}/point_{each:02d}") for each in count())
        rows.append(list(takewhile(lambda site: site >= 0, numbers)))
    return np.array(rows, dtype=np.intp).reshape(len(rows), -1 if rows else 0)
