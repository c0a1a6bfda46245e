"""Typed, frozen configuration read from YAML, and errors that say what would have been valid."""

from __future__ import annotations

import difflib
import types
from collections.abc import Mapping
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from trackers.errors import InputError

Model = TypeVar("Model", bound=BaseModel)


_SHAPES = {"tuple_type": "a list", "list_type": "a list"} | dict.fromkeys(
    ("model_type", "model_attributes_type", "dict_type"), "a mapping"
)
"""What the file must hold, where pydantic names the Python type."""


class Strict(BaseModel):
    """Frozen, typed configuration that refuses unknown keys.

    Where the default of a field is a model, a mapping given for it is laid over that very default, so that changing one
    nested value leaves its siblings as the owner has them. A field with a validator of its own, a preset's name say, takes
    the mapping as it stands.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _over_the_owners_defaults(cls, content: Any) -> Any:
        return content if not isinstance(content, dict) else content | _nested(cls, content, {})


def _nested(model: type[BaseModel], given: dict[Any, Any], owner: Mapping[str, Any]) -> dict[str, Any]:
    """The mappings among `given` that stand for nested models, laid over the owner's values for them, else the defaults."""
    whole = {}
    for name, info in model.model_fields.items():
        change, default = given.get(name), owner.get(name, info.default)
        of_one_model = [each for each in _unwrap(info.annotation) if each is not type(None)] == [type(default)]
        if isinstance(change, dict) and isinstance(default, BaseModel) and of_one_model and not info.metadata:
            held = dict(default)
            whole[name] = held | change | _nested(type(default), change, held)
    return whole


class _UniqueKeyLoader(yaml.SafeLoader):
    """Safe YAML that refuses a key given twice, which plain YAML would silently overwrite."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key!r} stands twice in one mapping", key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep)


def parse_yaml(text: str, source: str, expected: str) -> dict[str, Any]:
    """The mapping in a YAML text; raises InputError naming the source, the line and what is expected."""
    try:
        content = yaml.load(text, _UniqueKeyLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{source}, line {mark.line + 1}" if mark is not None else source
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise InputError(f"{where}: not valid YAML ({problem}); {expected} is expected") from error
    if not isinstance(content, dict):
        raise InputError(f"{source}: holds {type(content).__name__}, not a mapping; {expected} is expected")
    return content


def read_text(source: Any, expected: str) -> str:
    """The text of a file; raises InputError naming the file and what is expected of it."""
    try:
        return source.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{source}: is not a text file; {expected} is expected") from error
    except OSError as error:
        raise InputError(f"{source}: cannot be read ({error.strerror}); {expected} is expected") from error


def validate(model: type[Model], content: Any, source: str) -> Model:
    """The content as this model; raises InputError with one line for every fault: source, path, fault, value."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise InputError("\n".join(_lines(error, model, content, source))) from error


def _lines(error: ValidationError, model: type[BaseModel], content: Any, source: str) -> list[str]:
    lines, faults = [], error.errors()
    for fault in faults:
        within = [other for other in faults if other["loc"][: len(fault["loc"])] == fault["loc"]]
        if fault["type"] == "too_short" and len(within) > 1:
            continue  # short only of the items that are at fault themselves
        path = ".".join(_path(fault["loc"], content))
        message = fault["msg"].removeprefix("Value error, ")
        if fault["type"] == "extra_forbidden":
            message = "unknown key" + _valid_keys(model, fault["loc"])
        elif fault["type"] == "union_tag_invalid":
            about = fault.get("ctx", {})
            tag, valid = about["tag"], about["expected_tags"].replace("'", "")
            path, message = f"{path}.kind", f"{tag!r} is not known; valid are {valid}"
        elif fault["type"] in _SHAPES:
            message = f"{_SHAPES[fault['type']]} is expected (got {fault['input']!r})"
        elif fault["type"] != "missing" and not isinstance(fault["input"], dict | BaseModel):
            message += f" (got {fault['input']!r})"
        lines.append(": ".join(part for part in (source, path, message) if part))
    return list(dict.fromkeys(lines))


def _path(location: tuple[int | str, ...], content: Any) -> list[str]:
    """The path as the file has it: without the steps to one of several models, which pydantic names between the keys."""
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


def _valid_keys(model: type[BaseModel], location: tuple[int | str, ...]) -> str:
    """'; did you mean X; valid here: ...' for an unknown key at this location."""
    models: list[Any] = [model]
    for part in location[:-1]:
        models = [inner for each in models for inner in _inner(each, part)]
    keys = sorted({name for each in models if _is_model(each) for name in each.model_fields})
    if not keys:
        return ""
    close = difflib.get_close_matches(str(location[-1]), keys, n=1)
    return (f"; did you mean {close[0]!r}?" if close else ";") + f" valid here: {', '.join(keys)}"


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _inner(kind: Any, part: int | str) -> list[Any]:
    """The models one step down a pydantic error location: a field, a mapping's value or a union's tag."""
    if _is_model(kind):
        if part in kind.model_fields:
            return _unwrap(kind.model_fields[part].annotation)
        literal = kind.model_fields.get("kind")
        is_tag = literal is not None and part in get_args(literal.annotation)
        return [kind] if is_tag else []
    if get_origin(kind) in (dict, list, tuple):
        return _unwrap(get_args(kind)[-1] if get_origin(kind) is dict else get_args(kind)[0])
    return []


def _unwrap(kind: Any) -> list[Any]:
    """The members of Annotated and union types."""
    if get_origin(kind) is Annotated:
        return _unwrap(get_args(kind)[0])
    if get_origin(kind) in (Union, types.UnionType):
        return [inner for member in get_args(kind) for inner in _unwrap(member)]
    return [kind]
