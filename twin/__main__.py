"""Run the command `twin`, by its script and by `python -m twin`.

Refused where another distribution's package `trackers` lies in the place of ours: an installer overwrites it without a word.
"""

import os
import sys
from pathlib import Path

_DISTRIBUTION = "roomtwin"


def other_trackers() -> str | None:
    """Return a sentence on a package `trackers` that is not ours; None where it is."""
    try:
        import trackers
    except ImportError as error:  # what it needs itself may be missing
        where = f"cannot be imported ({error})"
    else:
        if getattr(trackers, "DISTRIBUTION", None) == _DISTRIBUTION:
            return None
        where = f"in {trackers.__file__ or 'this environment'} is another one"
    return (
        f"the package 'trackers' {where}; that of {_DISTRIBUTION} is expected: in an environment of its own, "
        f"pip install --force-reinstall {_DISTRIBUTION}"
    )


def main() -> None:
    """Run the command line."""
    if (fault := other_trackers()) is not None:
        sys.exit(f"twin: {fault}")
    from twin.cli import main as run

    run()


if __name__ == "__main__":
    # `-m` lets Python import from the current folder first, which the script does not: what lies there is no part of twin.
    if not sys.flags.safe_path and sys.path[0] == os.getcwd() != str(Path(__file__).parents[1]):
        del sys.path[0]
    main()
