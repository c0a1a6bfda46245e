"""Former names and values of options, accepted for one release with a warning naming the current ones.

They are found by walking a model and the content of a file side by side.
"""

from __future__ import annotations

import logging
import types
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel

from trackers.errors import InputError
from trackers.user_input.plain_data import deep_merge

logger = logging.getLogger(__name__)

_NOTHING = object()


def moved(content: dict[Any, Any], paths: Mapping[str, str], source: str, at: tuple[str, ...]) -> dict[Any, Any]:
    """Return nested mappings with the values at former paths (dotted) moved to current ones.

    source, at: the file, and the path in it of the content, for the warning. Raises ValueError where both are given.
    """
    for former, current in paths.items():
        value, rest = _taken_out(content, former.split("."))
        if value is _NOTHING:
            continue
        path = ".".join((*at, former))
        there = _taken_out(rest, current.split("."))[0]
        groups = isinstance(value, dict) and isinstance(there, dict)
        if there is not _NOTHING and not (groups and value.keys().isdisjoint(there)):
            raise ValueError(f"{path}: is the former name of {current!r}, which is given too; give one of them")
        warn_of_former_name(source, path, current)
        for name in reversed(current.split(".")):
            value = {name: value}
        content = deep_merge(rest, value)
    return content


def without_fixed(
    content: dict[Any, Any], fixed: Mapping[str, Any], source: str, at: tuple[str, ...]
) -> dict[Any, Any]:
    """Return nested mappings without former options that have their fixed value.

    fixed: that value by the option's path (dotted). Raises ValueError for an option of another value.
    """
    for former, always in fixed.items():
        value, rest = _taken_out(content, former.split("."))
        if value is _NOTHING:
            continue
        path = ".".join((*at, former))
        if _as_tuples(value) != always:
            raise ValueError(f"{path}: is no option any more, and always {always!r} (got {value!r}); leave it out")
        _warn_of_fixed_value(source, path, always)
        content = rest
    return content


def _as_tuples(value: Any) -> Any:
    return tuple(_as_tuples(each) for each in value) if isinstance(value, list | tuple) else value


@cache
def warn_of_former_name(source: str, path: str, name: str) -> None:
    """Warn, once, that the field or option at this path of a source is now called `name`."""
    where = ": ".join(part for part in (source, path) if part)
    logger.warning("%s: is now called %r; the former name is accepted in this release only", where, name)


@cache
def _warn_of_fixed_value(source: str, path: str, always: Any) -> None:
    where = ": ".join(part for part in (source, path) if part)
    logger.warning("%s: is no option any more, and always %r; leave it out", where, always)


def _taken_out(content: Any, path: Sequence[str]) -> tuple[Any, Any]:
    """Return the value at a path in nested mappings, `_NOTHING` if missing, and the content without it."""
    if not isinstance(content, dict) or path[0] not in content:
        return _NOTHING, content
    rest = {key: each for key, each in content.items() if key != path[0]}
    if len(path) == 1:
        return content[path[0]], rest
    value, inner = _taken_out(content[path[0]], path[1:])
    if value is _NOTHING:
        return value, content
    return value, rest | {path[0]: inner} if inner else rest


def with_current_names(model: type[BaseModel], content: Any, source: str = "") -> Any:
    """Return the content of a file with former names of the model's fields, at every depth, replaced by current ones.

    Warn once per former name, with its path after `source` and the current name. Call it before contents are merged: only
    one of them may use the former name. Raises ValueError where a mapping has both names of a field.
    """
    return _current([model], content, source, ())


def checked_current_names(model: type[BaseModel], content: Any, source: str) -> Any:
    """Return `with_current_names`; raises InputError, with the prefix `source`, where a mapping has both names of a field."""
    try:
        return with_current_names(model, content, source)
    except ValueError as error:
        raise InputError(f"{source}: {error}") from error


def current_path(model: type[BaseModel], path: Sequence[str], source: str = "") -> list[str]:
    """Return the path of a field with current names; warn as `with_current_names`."""
    nested: Any = None
    for name in reversed(path):
        nested = {name: nested}
    current, names = with_current_names(model, nested, source), []
    while isinstance(current, dict):
        ((name, current),) = current.items()
        names.append(name)
    return names


def _current(kinds: Sequence[Any], content: Any, source: str, at: tuple[str, ...]) -> Any:
    """Replace former names in content of one of these kinds, the members of a union; `at`: its path in the file."""
    if isinstance(content, list | tuple) and kinds:
        inner = [member for kind in kinds for member in _inner(kind, 0)]
        items = [_current(inner, item, source, (*at, str(place))) for place, item in enumerate(content)]
        return items if isinstance(content, list) else tuple(items)
    if not isinstance(content, dict) or not kinds:
        return content
    former: dict[Any, str] = {}
    for kind in of_kind(kinds, content.get("kind")):
        former |= getattr(kind, "former_names", {})
        content = without_fixed(content, _fixed(kind), source, at)
    if any("." in each for pair in former.items() for each in pair):
        content, former = moved(content, former, source, at), {}
    result = {}
    for key, value in content.items():
        name = former[key] if key in former else key  # noqa: SIM401 – .get loses the type
        if name != key:
            if name in content:
                raise ValueError(
                    f"{'.'.join((*at, str(key)))}: is the former name of {name!r}, which is given too; give one of them"
                )
            warn_of_former_name(source, ".".join((*at, str(key))), name)
        inner = [member for kind in kinds for member in _inner(kind, name)]
        renames = isinstance(value, dict | list | tuple) and any(map(_renames, inner))
        result[name] = _current(inner, value, source, (*at, str(key))) if renames else value
    return result


def _renames(kind: Any) -> bool:
    """Return whether a type is a model with former names or fixed values, or holds one."""
    return _model_renames(kind) if is_model(kind) else any(map(_renames, get_args(kind)))


@lru_cache(maxsize=4096)
def _model_renames(model: type[BaseModel]) -> bool:
    known, kinds = set[Any](), list[Any]([model])
    while kinds:
        kind = kinds.pop()
        if not is_model(kind):
            kinds += get_args(kind)
        elif kind not in known:
            known.add(kind)
            if getattr(kind, "former_names", {}) or _fixed(kind):
                return True
            kinds += [info.annotation for info in kind.model_fields.values()]
    return False


def _fixed(model: type[BaseModel]) -> dict[str, Any]:
    """Return the fixed values of former options of a model: its constants, and its `fixed_values`."""
    constants = model.__class_vars__ - {"model_config", "former_names", "fixed_values"}
    values = {name: getattr(model, name) for name in constants if hasattr(model, name)}
    return values | dict(getattr(model, "fixed_values", {}))


def models_at(model: type[BaseModel], path: tuple[int | str, ...]) -> list[Any]:
    """Return the models that the content at a path below a model may be."""
    models: list[Any] = [model]
    for part in path:
        models = [inner for each in models for inner in _inner(each, part)]
    return [each for each in models if is_model(each)]


def of_kind(kinds: Sequence[Any], kind: Any) -> list[Any]:
    """Select the models of a union whose tag `kind` is this one, else all."""
    models = [each for each in kinds if is_model(each)]
    tagged = [each for each in models if kind in get_args(getattr(each.model_fields.get("kind"), "annotation", None))]
    return tagged or models


def is_model(kind: Any) -> bool:
    """Tell whether a type is a pydantic model."""
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _inner(kind: Any, part: int | str) -> list[Any]:
    """Return the models one step down a pydantic error location: a field, a mapping's value or a union's tag."""
    if is_model(kind):
        return list(_within_model(kind, part))
    if get_origin(kind) in (dict, list, tuple):
        return members_of(get_args(kind)[-1] if get_origin(kind) is dict else get_args(kind)[0])
    return []


@lru_cache(maxsize=4096)
def _within_model(kind: type[BaseModel], part: int | str) -> tuple[Any, ...]:
    if part in kind.model_fields:
        return tuple(members_of(kind.model_fields[str(part)].annotation))
    literal = kind.model_fields.get("kind")
    return (kind,) if literal is not None and part in get_args(literal.annotation) else ()


def members_of(kind: Any) -> list[Any]:
    """Return the members of Annotated and union types."""
    if get_origin(kind) is Annotated:
        return members_of(get_args(kind)[0])
    if get_origin(kind) in (Union, types.UnionType):
        return [inner for member in get_args(kind) for inner in members_of(member)]
    return [kind]
