"""Former names and values of options, accepted for one release with a warning naming the current ones."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from trackers.plain_data import deep_merge

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
