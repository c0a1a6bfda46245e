"""Which files hold what trackers may know, as a scenario, a suite or a `rig.yaml` names them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Self

from pydantic import Field

from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.text_file import AnyPath, is_file


class KnowledgeFiles(Strict):
    """The files of what trackers may know of a room; relative to the file that names them, absolute once that is loaded."""

    environment: str | None = Field(
        default=None,
        description="file of the empty room's walls and furniture, as `twin environment` writes; none: unknown",
    )
    learned: dict[str, str] = Field(
        default={}, description="files that trackers have learned beforehand, by the name that they ask for"
    )

    def within(self, folder: AnyPath) -> Self:
        """The same files, absolute, of one who named them in `folder`."""
        return type(self).model_validate(files_within(self.model_dump(), folder))

    def paths(self) -> dict[str, Path]:
        """The files by their field: 'environment', 'learned.NAME'."""
        environment = {} if self.environment is None else {"environment": Path(self.environment)}
        return environment | {f"learned.{name}": Path(each) for name, each in self.learned.items()}

    def missing(self) -> dict[str, Path]:
        """Those of the files, by their field, that are not there."""
        return {field: path for field, path in self.paths().items() if not is_file(path)}

    def without(self, fields: Iterable[str]) -> Self:
        """The files but for those of these fields."""
        left_out = set(fields)
        learned = {name: each for name, each in self.learned.items() if f"learned.{name}" not in left_out}
        environment = None if "environment" in left_out else self.environment
        return self.model_copy(update={"environment": environment, "learned": learned})

    def check(self, source: str) -> None:
        """Raise InputError, a line a file that is not there, naming `source` and the field."""
        faults = [f"{source}: {no_file(f'knowledge.{field}', path)}" for field, path in self.missing().items()]
        if faults:
            raise InputError("\n".join(faults))

    def digest(self) -> str:
        """What tells the contents of the files apart, 16 digits; '' where there are none. They have to be there."""
        whole = hashlib.sha256()
        for field, path in sorted(self.paths().items()):
            with path.open("rb") as stream:
                whole.update(f"{field} {hashlib.file_digest(stream, 'sha256').hexdigest()}\n".encode())
        return whole.hexdigest()[:16] if self.paths() else ""


NO_FILES = KnowledgeFiles()


def files_within(content: Any, folder: AnyPath) -> Any:
    """`knowledge`, or a part of it, as plain data with every path in it absolute: they are relative to `folder`."""
    if isinstance(content, dict):
        return {key: files_within(value, folder) for key, value in content.items()}
    return str((Path(folder) / content).absolute()) if isinstance(content, str) else content


def no_file(field: str, path: AnyPath) -> str:
    """What is wrong with a field whose file is not there."""
    expected = "one that `twin environment` wrote" if field.endswith("environment") else "what a tracker has learned"
    return f"{field}: there is no file {path}; {expected} is expected"
