"""Whole runs: faster than real time, and in memory that does not grow."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.figure import Figure

_SCENARIO = "lab-five-people"
_PEAK = (
    "import resource, sys; from twin.cli import main\n"
    "try: main()\n"
    "except SystemExit as end: code = end.code\n"
    "print('PEAK', resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, file=sys.stderr)\n"
    "sys.exit(code)"
)


def _twin(*arguments: str) -> tuple[float, float]:
    """Run the command in a process of its own: seconds, and peak resident memory [MiB]."""
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", _PEAK, *arguments], check=True, capture_output=True, text=True)
    spent_s = time.perf_counter() - start
    return spent_s, float(done.stderr.rsplit("PEAK", 1)[1]) / 1024


def real_time() -> Iterator[Figure]:
    """The whole run against the time it simulates; start-up is measured by a run of 0.2 s and taken off."""
    with tempfile.TemporaryDirectory() as folder:
        for name, target, arguments in (
            ("whole run, images, video, report", ">= 1", []),
            ("whole run without images", ">= 20", ["--no-images", "--no-video", "--tracker", "laser-imm"]),
        ):
            out = Path(folder) / "run"
            start_up_s, _ = _twin("run", _SCENARIO, "--duration", "0.2", "--out", str(out), *arguments)
            spent_s, _ = _twin("run", _SCENARIO, "--out", str(out), *arguments)
            document = json.loads((out / "metrics.json").read_text())
            yield Figure(name, (document["duration_s"] - 0.2) / (spent_s - start_up_s), "× real time", target)
            yield Figure(f"{name}: realtime_factor", document["realtime_factor"], "× real time", target)


def memory() -> Iterator[Figure]:
    """Peak memory of the run, and how much more a run of ten minutes takes."""
    with tempfile.TemporaryDirectory() as folder:
        _, short_mib = _twin("run", _SCENARIO, "--out", str(Path(folder) / "short"))
        yield Figure("peak memory of the run", short_mib, "MiB", "<= 1024")
        _, long_mib = _twin("run", _SCENARIO, "--duration", "600", "--out", str(Path(folder) / "long"))
        yield Figure("peak memory of a ten-minute run", long_mib, "MiB", "<= 1024")
        yield Figure("ten minutes over 26 s", long_mib / short_mib, "×", "<= 1.25")
