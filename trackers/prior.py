"""Prior: all that a tracker may know of a room before people enter, live, from a recording and in a suite."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, overload

from trackers.observations import Observation
from trackers.rig import PriorFiles, Rig

if TYPE_CHECKING:
    from trackers.environment import Environment


@dataclass(frozen=True, eq=False)
class Prior(Sequence[Observation]):
    """Observations of the empty room, in order, and other prior knowledge; a tracker's `background`.

    environment: the room's walls, furniture and free space, in the room frame (None: unknown). learned: files that a tracker
    has learned beforehand, by name; untrusted, so read in a format that runs no code (no pickle).
    """

    background: Sequence[Observation] = ()
    environment: Environment | None = None
    learned: Mapping[str, Path] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.background)

    @overload
    def __getitem__(self, index: int) -> Observation: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Observation]: ...
    def __getitem__(self, index: int | slice) -> Observation | Sequence[Observation]:
        return self.background[index]

    @classmethod
    def of(cls, background: Iterable[Observation]) -> Prior:
        """Return a prior as it is, and observations of an empty room as a prior without files."""
        return background if isinstance(background, Prior) else cls(tuple(background))

    @classmethod
    def read(cls, background: Iterable[Observation], files: PriorFiles, rig: Rig) -> Prior:
        """Read the prior's `files`, with absolute and existing paths, for a rig.

        Raises InputError for an environment that is damaged or of another room than the rig's.
        """
        environment = None
        if files.environment is not None:
            from trackers.environment import load_environment

            environment = load_environment(Path(files.environment), rig)
        return cls(tuple(background), environment, {name: Path(each) for name, each in files.learned.items()})
