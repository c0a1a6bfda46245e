"""Values that a scenario may give by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

NoiseName = Literal["off", "default", "worse"]


def by_name(presets: dict[str, Any], otherwise: str) -> Callable[[Any], Any]:
    """Make a validator that replaces a preset's name by the preset."""

    def resolve(value: Any) -> Any:
        if value is False:
            value = "off"  # YAML reads an unquoted off as false
        if not isinstance(value, str):
            return value
        if value not in presets:
            raise ValueError(f"no preset of this name; valid are {', '.join(presets)} or {otherwise}")
        return presets[value]

    return resolve
