"""Run the command `twin`, by its script and by `python -m twin`.

Refused if another distribution's package `trackers` replaces ours, as an installer may silently do.
"""

import fcntl
import gc
import io
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

from twin import other_trackers

_COLLECTED_AFTER = 10_000
"""Number of new objects after which cyclic garbage is collected; after Python's 700, it takes a fifteenth of a short run."""


class ClosedOutput(io.TextIOWrapper):
    """The null device in the place of an output that the caller closed; has_lost: something was printed."""

    has_lost = False

    def write(self, text: str, /) -> int:
        """Note that this is lost."""
        self.has_lost = self.has_lost or bool(text)
        return len(text)


def _open_closed_streams() -> None:
    """Open the null device in the place of standard streams that the caller closed, as services do, or opened to be read.

    Otherwise the next opened file takes its number, and what is printed goes into it.
    """
    if sys.stdin is None:
        sys.stdin = open(os.devnull)  # noqa: SIM115 until the process ends
    for number, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None or fcntl.fcntl(number, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY:
            setattr(sys, name, ClosedOutput(open(os.devnull, "wb"), "utf-8"))  # noqa: SIM115


def main() -> None:
    """Run the command line."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # while modules are imported: Python would print a traceback
    _open_closed_streams()
    gc.set_threshold(_COLLECTED_AFTER)
    if (fault := other_trackers()) is not None:
        sys.exit(f"twin: {fault}")
    from twin.cli import main as run

    run()


if __name__ == "__main__":
    # `-m` imports from the current folder first, unlike the script: its modules are no part of twin.
    with suppress(FileNotFoundError):  # it was removed, and there is nothing to import
        if not sys.flags.safe_path and sys.path[0] == os.getcwd() != str(Path(__file__).parents[1]):
            del sys.path[0]
    main()
