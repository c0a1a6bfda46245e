"""Content of a results file, validated on reading: it may be truncated or edited by hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, ConfigDict, Field, FiniteFloat, Json, TypeAdapter, ValidationError

from trackers.configuration import Typed
from trackers.errors import InputError
from twin.suites.spec import Bound, Tolerance
from twin.suites.worker import Incident

WAITING, RUNNING, DONE, FAILED = "waiting", "running", "done", "failed"

EXPECTED = "a file of results as `twin suite run` wrote it"

_MOST_SHOWN = 80

_Content = TypeVar("_Content")

_TEXTS = TypeAdapter(Json[list[str]])


def _list_of_texts(text: str) -> str:
    _TEXTS.validate_python(text)
    return text


OverridesText = Annotated[str, AfterValidator(_list_of_texts)]
"""Overrides as JSON: a list of texts."""


@dataclass(frozen=True)
class StoredCase:
    """A case as the file holds it."""

    id: str
    scenario: str
    variant: str
    overrides: OverridesText
    seed: int
    tracker: str
    status: Literal["waiting", "running", "done", "failed"]
    attempts: int
    seconds: FiniteFloat | None
    error: str | None


@dataclass(frozen=True)
class RecordingInfo:
    """Digests of a case's recording and of its people's motion ("": unknown), and its scanners' range noise.

    scatter_m: of each scanner's ranges, by its position.
    """

    digest: str = ""
    people: str = ""
    scatter_m: Mapping[str, FiniteFloat] = field(default_factory=dict)


@dataclass(frozen=True)
class Requirement:
    """Bound of a metric that a tracker has to reach in a scenario, as a mean over its seeds."""

    scenario: str
    overrides: OverridesText
    tracker: str
    metric: str
    bound: Bound


class Facts(Typed):
    """Facts about a run as a whole."""

    model_config = ConfigDict(frozen=True)

    suite: str
    description: str
    code: str
    versions: dict[str, str | None]
    changes: list[str]
    tolerances: dict[str, Tolerance]
    requirements: list[Requirement] = Field(default_factory=list)
    seconds: FiniteFloat
    renderers: list[str]
    tracker_warnings: dict[str, int] = Field(default_factory=dict)
    recipes: dict[str, str] = Field(default_factory=dict)  # inputs of each case's recording
    filmstrips: dict[str, FiniteFloat] = Field(default_factory=dict)
    baseline: str | None = None
    reference: str | None = None


FORMER_FACTS = {
    "promises": "requirements",
    "doubts": "tracker_warnings",
    "strips": "filmstrips",
    "beside": "reference",
}
"""Names of facts in files of version 0.1."""


FACTS = TypeAdapter(Facts)

CASES = TypeAdapter(list[StoredCase])

RECORDINGS = TypeAdapter(dict[str, RecordingInfo])

METRICS = TypeAdapter(dict[str, dict[str, FiniteFloat | None]])

INCIDENTS = TypeAdapter(list[Incident])


def checked(kind: TypeAdapter[_Content], content: Any, source: str) -> _Content:
    """Validate content as this kind. Raises InputError naming the source, the place, the value and what is expected."""
    try:
        return kind.validate_python(content)
    except ValidationError as error:
        fault = error.errors()[0]
        place = ".".join(str(part) for part in fault["loc"])
        value = repr(fault["input"])
        shown = value if len(value) <= _MOST_SHOWN else value[:_MOST_SHOWN] + "…"
        raise InputError(f"{source}: {place}: {fault['msg']} (got {shown}); {EXPECTED} is expected") from error
