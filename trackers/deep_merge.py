"""Laying one mapping over another, as presets, options and scenarios that extend others do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def deep_merge(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with `change` laid over it: mappings merge at every depth, everything else is replaced.

    A mapping whose `kind` differs from the one below is another thing, with other fields, and replaces it.
    """
    merged = dict(base)
    for key, value in change.items():
        held = merged.get(key)
        if isinstance(value, Mapping) and isinstance(held, Mapping) and value.get("kind") in (None, held.get("kind")):
            merged[key] = deep_merge(held, value)
        else:
            merged[key] = value
    return merged
