"""What a tracker may know of a room before anybody enters it: one value, the same live, from a recording and in a suite."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Self

from pydantic import Field

from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.observations import Observation
from trackers.rig import Rig

if TYPE_CHECKING:
    from trackers.environment import Environment


class KnowledgeFiles(Strict):
    """The files of what trackers may know, as a scenario or a `rig.yaml` names them: relative to the file that does."""

    environment: str | None = Field(
        default=None,
        description="file of the empty room's walls and furniture, as `twin environment` writes; none: unknown",
    )
    learned: dict[str, str] = Field(
        default={}, description="files that trackers have learned beforehand, by the name they ask for them"
    )

    def within(self, folder: Path) -> Self:
        """The same files, absolute, of one who named them in `folder`."""
        environment = None if self.environment is None else str((folder / self.environment).absolute())
        learned = {name: str((folder / each).absolute()) for name, each in self.learned.items()}
        return self.model_copy(update={"environment": environment, "learned": learned})


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Observations of the empty room, its environment, and what was learned beforehand.

    It is handed to a tracker as its `background`, and iterates over the observations of the empty room.
    """

    background: tuple[Observation, ...] = ()
    environment: Environment | None = None
    learned: Mapping[str, Path] = field(default_factory=dict)

    def __iter__(self) -> Iterator[Observation]:
        return iter(self.background)

    @classmethod
    def of(cls, background: Iterable[Observation]) -> Knowledge:
        """What is handed over where knowledge may be meant: itself, or the observations of an empty room alone."""
        return background if isinstance(background, Knowledge) else cls(tuple(background))

    @classmethod
    def read(cls, background: Iterable[Observation], files: KnowledgeFiles, rig: Rig, source: str) -> Knowledge:
        """The knowledge in `files`, whose paths are absolute, for a rig.

        Raises InputError, naming `source`, for a file that is not there, and for an environment that is damaged or of
        another room than the rig's.
        """
        learned = {name: Path(each) for name, each in files.learned.items()}
        for name, path in learned.items():
            if not path.is_file():
                raise InputError(f"{source}: knowledge.learned.{name}: there is no file {path}; a file is expected")
        if files.environment is None:
            return cls(tuple(background), None, learned)
        from trackers.environment import load_environment

        path = Path(files.environment)
        if not path.is_file():
            raise InputError(
                f"{source}: knowledge.environment: there is no file {path}; one that `twin environment` wrote is expected"
            )
        return cls(tuple(background), load_environment(path, rig), learned)
