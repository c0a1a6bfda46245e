"""Run the command `twin` by `python -m twin`."""

import os
import sys
from pathlib import Path

# `-m` lets Python import from the current folder first, which the script does not: what lies there is no part of twin.
if not sys.flags.safe_path and sys.path[0] == os.getcwd() != str(Path(__file__).parents[1]):
    del sys.path[0]

from twin.cli import main

main()
