"""Errors for the user to correct: wrong input, or a plug-in tracker that failed."""

from __future__ import annotations

import os
from collections.abc import Iterable
from difflib import get_close_matches


class InputError(ValueError):
    """Wrong input: one sentence naming the file, the field, the value and what would be valid.

    The command line prints it without a traceback and exits with code 2; every other exception except a plug-in's is a bug
    of ours.
    """


_MOST_DIGITS = 17
"""Digits that hold any float."""


class LimitError(InputError):
    """Input larger than a limit that stands against mistakes and attacks, and can be lifted (see `text_file`)."""


PLUG_IN_ERRORS = (Exception, SystemExit, GeneratorExit)
"""All that a plug-in may raise without ending what calls it: all but the user's Ctrl-C."""


class PlugInError(Exception):
    """Exception of a plug-in tracker: one sentence naming class, method, observation and line.

    The command line prints it without a traceback and exits with code 1: the input was valid.
    """


def text_near_bound(value: float, bound: float, spec: str = ".2f") -> str:
    """Format a value by `spec`, with as many digits more as show on which side of a bound it is, itself written with `:g`."""
    written, kind = float(f"{bound:g}"), spec[-1]
    for digits in range(int(spec[1:-1]), _MOST_DIGITS):
        text = f"{value:.{digits}{kind}}"
        if (float(text) > written) == (value > bound) and (float(text) < written) == (value < bound):
            return text
    return repr(float(value))


def raise_faults(faults: Iterable[str]) -> None:
    """Raise InputError with a line per fault, each once; nothing without any."""
    if lines := distinct_lines(faults):
        raise InputError("\n".join(lines))


_LONG_LIST = 200
"""Length of a list of names from which on it stands once in an error."""


def distinct_lines(faults: Iterable[str]) -> list[str]:
    """Return a line per fault, each once; a long list of valid names stands in the first alone that has it."""
    first: dict[str, str] = {}
    lines = []
    for line in dict.fromkeys(faults):
        start, mark, names = line.rpartition("valid are ")
        is_again = len(names) > _LONG_LIST and first.setdefault(names, line) != line
        lines.append(f"{start}{mark}the names above" if is_again else line)
    return lines


def valid_names(
    given: object, names: Iterable[str], also: str = "", *, start: str = "valid are", none: str = "none"
) -> str:
    """Format what is valid instead of a name: the nearest of `names`, if any is near, and all of them in their order.

    also: what else is valid, as it follows the names; start: of the list; none: the list without names and anything else.
    """
    folded = {name.casefold(): name for name in names}
    near = get_close_matches(str(given).casefold(), folded, n=1)
    hint = f"did you mean {folded[near[0]]!r}? " if near else ""
    return f"{hint}{start} {', '.join(folded.values()) + also or none}"


def check_no_path(name: str, source: str) -> None:
    """Raise InputError, naming `source`, for a path in the place of module:Class, with what to write instead."""
    module, _, own = name.partition(":")
    if "/" not in module and not module.endswith((".py", ".")) and not module.startswith("."):
        return
    way = os.path.relpath(module.removesuffix(".py") or ".")
    named = f"{way.replace('/', '.')}:{own or 'Class'}"
    if way.startswith("."):
        named = f"{os.path.basename(way).strip('.') or 'module'}:{own or 'Class'}, from its folder or with that in PYTHONPATH,"
    raise InputError(f"{source}: is a path; {named} is expected")
