"""`null` in a scenario removes an entry of the one that it starts from: there must be one, or a field of that name."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from trackers.configuration import keys_of
from trackers.errors import InputError


def check_removals(
    model: type[BaseModel],
    base: Mapping[Any, Any],
    change: Mapping[Any, Any],
    source: str,
    at: tuple[str, ...] = (),
) -> None:
    """Raise InputError where a null in `change` removes nothing from `base` and is no field that may be left out either.

    at: the path of both in the model; source: opens the sentence. A tracker's options are the tracker's to read.
    """
    if at[:1] == ("trackers",) and len(at) > 1:
        return
    for key, value in change.items():
        held = base.get(key)
        if isinstance(value, Mapping):
            check_removals(model, held if isinstance(held, Mapping) else {}, value, source, (*at, str(key)))
        elif value is None and key not in base:
            fields = keys_of(model, at, change.get("kind", base.get("kind")))
            if fields is None or key not in fields:
                raise InputError(f"{source}: {'.'.join((*at, str(key)))}: {_nothing(str(key), base, fields)}")


def _nothing(key: str, base: Mapping[Any, Any], fields: frozenset[str] | None) -> str:
    there = sorted(map(str, base if fields is None else fields))
    what = "there is none of this name to remove" if fields is None else "unknown key"
    close = difflib.get_close_matches(key, there, n=1)
    hint = f"; did you mean {close[0]!r}?" if close else ";"
    return f"{what}{hint} valid here: {', '.join(there) or 'none, as nothing is there'}"
