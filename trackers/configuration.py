"""Typed, frozen configuration, with errors that state what would be valid."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeVar, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, ValidationError, model_validator
from pydantic_core import CoreSchema, PydanticCustomError, core_schema, to_json

from trackers.errors import InputError, distinct_lines, valid_names
from trackers.user_input.former_options import (
    checked_current_names,
    members_of,
    models_at,
    of_kind,
    with_current_names,
)

Model = TypeVar("Model", bound=BaseModel)

_SHAPES = {"tuple_type": "a list", "list_type": "a list"} | dict.fromkeys(
    ("model_type", "model_attributes_type", "dict_type"), "a mapping"
)
_SHAPES |= {"bool_type": "true or false", "bool_parsing": "true or false", "string_type": "a text"}
_SHAPES |= dict.fromkeys(("int_type", "int_parsing", "float_type", "float_parsing", "number_type"), "a number")
_SHAPES |= {"finite_number": "a finite number", "int_parsing_size": f"a whole number of no more than {2**63 - 1}"}
_SHAPES |= {r"^[A-Za-z][A-Za-z0-9_-]*$": "a name of letters a to z, digits, '-' and '_', a letter first,"}
"""Words for the expected content, where pydantic names the Python type or a pattern."""

_MOST_LINES = 50
"""Number of faults of a file beyond which the rest is counted."""
_MOST_FIELDS = 12
"""Number of fields up to which an error names those of the mapping that it expects."""
_MOST_SHOWN = 200
"""Number of characters of a value in an error."""
_LARGEST_NUMBER = 1_000_000_000
"""Bound of numbers without their own: no length, time, angle, count or weight is larger, in any unit."""


_UNIT = re.compile(r" ?\[([^\[\],;]{1,12})\]")
"""Unit in a field's description."""


def _without_conversions(schema: Any, number: Callable[[Any], Any] | None = None) -> Any:
    """Make `int`, `float` and `bool` of a pydantic schema strict and bounded.

    number: the validator before a number; keys of a mapping have their own.
    """
    number = number or _number
    if isinstance(schema, list | tuple):
        return type(schema)(_without_conversions(part, number) for part in schema)
    if not isinstance(schema, dict):
        return schema
    kind = schema.get("type")
    if kind == "function-before" and schema["function"]["function"] in (_number, _number_of_key, _flag):
        return schema  # a nested model
    if kind in ("int", "float"):
        return core_schema.no_info_before_validator_function(number, _bounded(schema))  # pyright: ignore[reportArgumentType]
    if kind == "bool":
        flag = schema | {"strict": True}
        return core_schema.no_info_before_validator_function(_flag, flag)  # pyright: ignore[reportArgumentType]
    values = ("default", "metadata", "serialization") if isinstance(kind, str) else ()  # else the fields by name
    return {
        key: part if key in values else _without_conversions(part, _number_of_key if key == "keys_schema" else number)
        for key, part in schema.items()
    }


def _bounded(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a finite number with two bounds: its own, else `_LARGEST_NUMBER`."""
    if not {"gt", "ge"} & schema.keys():
        schema = schema | {"ge": -_LARGEST_NUMBER}
    if not {"lt", "le"} & schema.keys():
        schema = schema | {"le": _LARGEST_NUMBER}
    return schema | {"allow_inf_nan": False} if schema["type"] == "float" else schema


def _number(value: Any) -> Any:
    if isinstance(value, bool | np.bool_ | str | bytes):
        raise PydanticCustomError("number_type", "a number is expected")
    return value


def _flag(value: Any) -> Any:
    return bool(value) if isinstance(value, np.bool_) else value


def _number_of_key(value: Any) -> Any:
    """Convert a mapping's key to a number: JSON stores it as text."""
    return int(value) if isinstance(value, str) and re.fullmatch(r"-?(0|[1-9][0-9]{0,18})", value) else _number(value)


class Typed(BaseModel):
    """Model whose numbers are finite numbers and whose booleans are booleans, without conversions between them or from text."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return the schema of the fields, with strict numbers and booleans."""
        return _without_conversions(handler(source))


class Strict(Typed):
    """Frozen, typed configuration that rejects unknown keys.

    If a field's default is a model, a given mapping is merged into that default, so that a nested value can be changed
    alone. A field with its own validator, such as a preset's name, takes the mapping as given.

    former_names: the current name of each renamed field, by its former name; with dots the path of one moved between nested
    models. Former names are accepted for one release, with a warning; see `with_current_names`. fixed_values: the constant
    value of a former option, by its path, accepted with that value for one release.
    """

    former_names: ClassVar[Mapping[str, str]] = {}
    fixed_values: ClassVar[Mapping[str, Any]] = {}

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _over_the_owners_defaults(cls, content: Any) -> Any:
        if not isinstance(content, dict):
            return content
        current = with_current_names(cls, content)
        return current | _nested(cls, current, {})


def _nested(model: type[BaseModel], given: dict[Any, Any], owner: Mapping[str, Any]) -> dict[str, Any]:
    """Merge the mappings among `given` for nested models over the owner's values, else over the defaults."""
    whole = {}
    for name, info in model.model_fields.items():
        change, default = given.get(name), owner.get(name, info.default)
        of_one_model = [each for each in members_of(info.annotation) if each is not type(None)] == [type(default)]
        if isinstance(change, dict) and isinstance(default, BaseModel) and of_one_model and not info.metadata:
            held = dict(default)
            whole[name] = held | change | _nested(type(default), change, held)
    return whole


def leaves_of(options: BaseModel, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield path (dotted) and value of every option below a model that is no model itself."""
    for name in type(options).model_fields:
        value = getattr(options, name)
        if isinstance(value, BaseModel):
            yield from leaves_of(value, f"{path}{name}.")
        else:
            yield f"{path}{name}", value


@dataclass(frozen=True)
class OptionRow:
    """An option: its path, default as YAML, unit ("": none), meaning, and the words that it can be."""

    path: str
    default: str
    unit: str
    meaning: str
    choices: tuple[str, ...]


def option_rows(model: type[BaseModel], given: Mapping[str, Any], above: str = "") -> Iterator[OptionRow]:
    """Yield every option below a model that is no model itself, with the values of a preset, `given`, over the defaults."""
    for name, info in model.model_fields.items():
        default = None if info.is_required() else info.get_default(call_default_factory=True)
        value = given.get(name, default)
        kinds = members_of(info.annotation)
        nested = [each for each in kinds if isinstance(each, type) and issubclass(each, BaseModel)]
        meaning, words = (
            info.description or "",
            [word for each in kinds if get_origin(each) is Literal for word in get_args(each)],
        )
        if not nested or value is None:
            shown = "required" if info.is_required() and name not in given else to_json(value).decode()
            unit = _UNIT.search(meaning)
            yield OptionRow(f"{above}{name}", shown, unit[1] if unit else "", meaning, tuple(map(str, words)))
        held = dict(default) if isinstance(default, BaseModel) else {}
        for each in nested:
            yield from option_rows(each, held | dict(value or {}), f"{above}{name}.")


def options_markdown(model: type[BaseModel], given: Mapping[str, Any]) -> str:
    """Return a table of a tracker's options as Markdown: default, unit, meaning."""
    lines = ["| option | default | unit | meaning |", "|---|---|---|---|"]
    for row in option_rows(model, given):
        meaning = _UNIT.sub("", row.meaning, count=1).replace("|", "\\|").replace("<", "&lt;")
        one_of = f" (one of {', '.join(f'`{each}`' for each in row.choices)})" if row.choices else ""
        lines.append(f"| `{row.path}` | `{row.default}` | {row.unit} | {meaning}{one_of} |")
    return "\n".join(lines) + "\n"


def described(model: type[BaseModel], field: str) -> str:
    """Return the description of a model's field, for a subclass with a default of its own."""
    return model.model_fields[field].description or ""


def validate(model: type[Model], content: Any, source: str) -> Model:
    """Validate the content as this model. Raises InputError with one line per fault: source, path, fault, value."""
    content = checked_current_names(model, content, source)
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise InputError("\n".join(_lines(error, model, content, source))) from error


def _lines(error: ValidationError, model: type[BaseModel], content: Any, source: str) -> list[str]:
    lines, faults = [], error.errors()
    within = Counter(fault["loc"][:depth] for fault in faults for depth in range(len(fault["loc"]) + 1))
    for fault in faults:
        if fault["type"] == "too_short" and within[fault["loc"]] > 1:
            continue  # only the faults of the items themselves
        path = ".".join(_path(fault["loc"], content))
        message = fault["msg"].removeprefix("Value error, ")
        if fault["type"] == "extra_forbidden":
            keys = sorted(keys_of(model, fault["loc"][:-1]) or ())
            message = "unknown key" + (f"; {valid_names(fault['loc'][-1], keys, start='valid here:')}" if keys else "")
        elif fault["type"] == "union_tag_invalid":
            about = fault.get("ctx", {})
            valid = valid_names(about["tag"], about["expected_tags"].replace("'", "").split(", "))
            path, message = f"{path}.kind", f"{_shown(about['tag'])} is not known; {valid}"
        elif fault["type"] == "union_tag_not_found":
            beside, kinds = _of_a_kind(fault["loc"], content), models_at(model, fault["loc"])
            tags = [tag for each in kinds for tag in get_args(each.model_fields["kind"].annotation)]
            path, message = f"{path}.kind", f"is missing; one of {', '.join(tags)} is expected"
            message += f"; {valid_names(fault['loc'][-1], beside, start='there are')}" if beside else ""
        elif fault["type"] == "missing":
            fields = [each.model_fields.get(fault["loc"][-1]) for each in models_at(model, fault["loc"][:-1])]
            about = next((each.description for each in fields if each is not None and each.description), None)
            message = "is missing" + (f" ({about})" if about else "")
        elif (kind := fault.get("ctx", {}).get("pattern", fault["type"])) in _SHAPES:
            fields = _fields_text(model, fault["loc"], _SHAPES[kind])
            message = f"{_SHAPES[kind]}{fields} is expected (got {_shown(fault['input'])})"
            if fault["type"] == "string_type" and isinstance(fault["input"], bool | int | float):
                message += "; in quotes it is one"
        else:
            message = _expected(fault["type"], message, fault.get("ctx", {}))
            if not isinstance(fault["input"], dict | BaseModel):
                message += f" (got {_shown(fault['input'])})"
        if fault["loc"][-1:] == ("[key]",):  # of a mapping: pydantic's path goes through it as if it were a field
            path = ".".join(_path(fault["loc"][:-2], content))
            message = message.replace(f" (got {_shown(fault['input'])})", "")
            message = f"the name {_shown(fault['input'])}: {message}"
        lines.append(": ".join(part for part in (source, path, message) if part))
    distinct = distinct_lines(lines)
    more = [f"{source}: and {len(distinct) - _MOST_LINES} faults more"] if len(distinct) > _MOST_LINES else []
    return distinct[:_MOST_LINES] + more


def _fields_text(model: type[BaseModel], path: tuple[int | str, ...], shape: str) -> str:
    """Return the words that name the fields of the mapping, or list of mappings, expected at a path; "" for others."""
    of = {"a mapping": "", "a list": " of mappings"}.get(shape)
    keys = keys_of(model, path if shape == "a mapping" else (*path, 0)) if of is not None else None
    if not keys or len(keys) > _MOST_FIELDS:
        return ""
    return f"{of} with {', '.join(sorted(keys))}"


def _expected(kind: str, message: str, limits: Mapping[str, Any]) -> str:
    """Return what is expected where pydantic checks a limit, a length or a choice; its message for other faults."""
    match kind:
        case "greater_than" | "greater_than_equal" | "less_than" | "less_than_equal":
            return f"a number {message.removeprefix('Input should be ')} is expected"
        case "literal_error":
            return f"{limits['expected']} is expected"
        case "too_short":
            return f"a length of {limits['min_length']} or more is expected"
        case "too_long":
            return f"a length of {limits['max_length']} or less is expected"
        case "string_too_short":
            return "a text that is not empty is expected"
        case _:
            return message


def _of_a_kind(location: tuple[int | str, ...], content: Any) -> list[str]:
    """Return the names of the mappings with a kind beside the one at this location."""
    for part in location[:-1]:
        content = content.get(part) if isinstance(content, Mapping) else None
    beside = content.items() if isinstance(content, Mapping) else ()
    return [name for name, each in beside if isinstance(each, Mapping) and "kind" in each]


def _shown(value: Any) -> str:
    """Format a value for an error message, truncated if long."""
    text = repr(value)
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}..."


def _path(location: tuple[int | str, ...], content: Any) -> list[str]:
    """Return the path as in the file, without the names of union members that pydantic inserts."""
    path = []
    for place, part in enumerate(location):
        last = place == len(location) - 1
        if isinstance(content, dict):
            if part in content:
                content = content[part]
            elif not last or part == content.get("kind"):
                continue  # the tag of a model, not a key
        elif isinstance(content, list | tuple) and isinstance(part, int):
            content = content[part] if part < len(content) else None
        elif content is not None:
            continue  # the name of a type
        path.append(str(part))
    return path


def keys_of(model: type[BaseModel], path: tuple[int | str, ...], kind: Any = None) -> frozenset[str] | None:
    """Return the valid keys of the mapping at a path below a model; None if any key is valid (names of people, for example).

    kind: the mapping's own `kind`, which selects one of several models.
    """
    models = of_kind(models_at(model, path), kind)
    return (
        frozenset(field.alias or name for each in models for name, field in each.model_fields.items())
        if models
        else None
    )
