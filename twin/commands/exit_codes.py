"""How `twin` ends: each way out has its exit code (see the README)."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import typer

from twin.shown import shown

EXIT_DONE, EXIT_FELL_SHORT, EXIT_BAD_INPUT, EXIT_OUR_FAULT, EXIT_INTERRUPTED, EXIT_CLOSED_PIPE = 0, 1, 2, 70, 130, 141


def tell_failures(failures: Sequence[str]) -> None:
    """What plug-ins did wrong beside trackers that have results: the exit code is that of a check that fell short."""
    for failure in failures:
        sys.stderr.write(f"twin: {shown(failure)}\n")
    if failures:
        raise typer.Exit(EXIT_FELL_SHORT)
