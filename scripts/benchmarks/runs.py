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

_MANY = """
import sys, tempfile
from pathlib import Path
from twin.run.live import run_scenario
from twin.run.replay import track_recording
from twin.scenario import load_scenario

with tempfile.TemporaryDirectory() as folder:
    for seed in range(int(sys.argv[1])):
        scenario = load_scenario(sys.argv[2], ["duration_s=2", f"seed={seed}"])
        run_scenario(scenario, trackers=["laser-fisheye-imm"], out=Path(folder) / "run")
        track_recording(
            Path(folder) / "run" / "recording.mcap", trackers=["sort"], out=Path(folder) / "track", video=False
        )
        print(int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20, flush=True)
"""
"""Resident memory after each run [MiB]: a worker records, then tracks what it has recorded."""


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
    yield from many_runs()


def many_runs(n_runs: int = 150) -> Iterator[Figure]:
    """Memory of a process that does many runs with images, as a worker does: at most 1 GiB, and no more at its end."""
    done = subprocess.run(
        [sys.executable, "-c", _MANY, str(n_runs), _SCENARIO], check=True, capture_output=True, text=True
    )
    resident_mib = [float(line) for line in done.stdout.split()]
    early, late = max(resident_mib[: n_runs // 10 + 1]), max(resident_mib[-(n_runs // 10 + 1) :])
    yield Figure(f"{n_runs} runs with images in one process: the most resident", max(resident_mib), "MiB", "<= 1024")
    yield Figure(
        f"{n_runs} runs with images in one process: the last tenth over the first", late / early, "×", "<= 1.1"
    )
