"""From the options a user typed to a tracker's typed configuration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from trackers.errors import InputError

Model = TypeVar("Model", bound=BaseModel)


def parse_options(model: type[Model], options: Mapping[str, Any], tracker: str) -> Model:
    """The options of `tracker` as its typed configuration.

    Raises InputError with one line a fault; an unknown option is named with the valid ones beside it.
    """
    try:
        return model.model_validate(dict(options))
    except ValidationError as error:
        lines = []
        for fault in error.errors():
            path = ".".join(str(part) for part in fault["loc"])
            if fault["type"] == "extra_forbidden":
                valid = ", ".join(_options_beside(model, fault["loc"]))
                lines.append(f"tracker {tracker}: unknown option {path!r}; valid ones are {valid}")
            else:
                message = fault["msg"].removeprefix("Value error, ")
                lines.append(f"tracker {tracker}: option {path or '(whole)'}: {message} (got {fault['input']!r})")
        raise InputError("\n".join(lines)) from error


def _options_beside(model: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """Names of the options on the level at which an unknown one was given."""
    for part in location[:-1]:
        field = model.model_fields.get(str(part))
        if field is None or not (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)):
            break
        model = field.annotation
    return list(model.model_fields)
