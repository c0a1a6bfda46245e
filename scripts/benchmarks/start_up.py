"""Start-up time of the command line."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Iterator

from benchmarks.figure import Figure


def measure() -> Iterator[Figure]:
    """`twin --help` and `twin list`, median of five [s]."""
    for arguments in (["--help"], ["list"]):
        spent = []
        for _ in range(5):
            start = time.perf_counter()
            subprocess.run([sys.executable, "-m", "twin", *arguments], check=True, capture_output=True)
            spent.append(time.perf_counter() - start)
        yield Figure(f"twin {arguments[0]}", statistics.median(spent), "s", "<= 0.5")
