"""What a tracker may know of a room before anybody enters it: one value, the same live, from a recording and in a suite."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, overload

from trackers.knowledge_files import KnowledgeFiles
from trackers.observations import Observation
from trackers.rig import Rig

if TYPE_CHECKING:
    from trackers.environment import Environment


@dataclass(frozen=True, eq=False)
class Knowledge(Sequence[Observation]):
    """What is handed to a tracker as its `background`: the observations of the empty room, in order, and more beside.

    environment: the room's walls, furniture and free space, in the room frame (None: not known). learned: files that a
    tracker has learned beforehand, by name; whoever names one may be a stranger, so it is to be read in a format that
    runs no code (no pickle).
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
    def of(cls, background: Iterable[Observation]) -> Knowledge:
        """What is handed over where knowledge may be meant: itself, or the observations of an empty room alone."""
        return background if isinstance(background, Knowledge) else cls(tuple(background))

    @classmethod
    def read(cls, background: Iterable[Observation], files: KnowledgeFiles, rig: Rig) -> Knowledge:
        """The knowledge in `files`, whose paths are absolute and there, for a rig.

        Raises InputError for an environment that is damaged or of another room than the rig's.
        """
        environment = None
        if files.environment is not None:
            from trackers.environment import load_environment

            environment = load_environment(Path(files.environment), rig)
        return cls(tuple(background), environment, {name: Path(each) for name, each in files.learned.items()})
