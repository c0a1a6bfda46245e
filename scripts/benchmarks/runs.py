"""Whole runs: faster than real time, in memory that does not grow, at a cost that grows with people, beams, sensors, time."""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.figure import Figure
from twin.instant.snapshot import RAY_GROUPS
from twin.scenario import Scenario, load_scenario
from twin.world.simulation import Simulation

_SCENARIO = "lab-five-people"
_PEAK = (
    "import sys; from pathlib import Path; from twin.cli import main\n"
    "try: main()\n"
    "except SystemExit as end: code = end.code\n"
    "print('PEAK', Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0], file=sys.stderr)\n"
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


_ROUNDS = 5
_SHORT_S, _LONG_S = 2.0, 60.0
_LASER = ("--no-images", "--no-video", "--tracker", "laser-imm")
_RUNS = (
    ("lab without images, laser-imm, all truth", _SCENARIO, _LASER, ">= 20"),
    ("lab without images, laser-imm, positions", _SCENARIO, (*_LASER, "--truth", "positions"), ">= 30"),
    ("lab with images and video, laser-fisheye-imm", _SCENARIO, (), ">= 3.5"),
    ("hall with images, no video, no tracker", "library-hall", ("--no-video",), ">= 2.2"),
)
"""Name, scenario, arguments, and simulated time over CPU time to reach."""

_STARTS = """
import sys, time
from pathlib import Path
sys.argv[1:] = {arguments}
from twin.cli import main
try: main()
except SystemExit: pass
peak_kib = Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]  # ru_maxrss has the parent's too
print("COST", time.process_time(), peak_kib, file=sys.stderr)
"""
_SECOND_CASE = """
import sys, time
from twin.scenario import load_scenario
from twin.world.simulation import Simulation
for seed in (0, 1):
    start = time.process_time()
    scenario = load_scenario(sys.argv[1], ["background=none", f"seed={seed}"])
    with Simulation(scenario, images=False) as simulation:
        next(simulation.deliveries())
    spent = time.process_time() - start
print(spent)
"""


def cpu(rounds: int = _ROUNDS) -> Iterator[Figure]:
    """Simulated time over CPU time, 60 s less a short run of the same, which is start-up: medians; and what starting costs."""
    with tempfile.TemporaryDirectory() as folder:
        for name, scenario, arguments, target in _RUNS:
            command = "run" if "--tracker" in arguments or scenario == _SCENARIO else "render"
            spend = partial(_cpu_s, command, scenario, *arguments, "--out", str(Path(folder) / "run"))
            speeds = []
            for _ in range(rounds):
                short_s, long_s = (spend("--duration", str(each)) for each in (_SHORT_S, _LONG_S))
                speeds.append((_LONG_S - _SHORT_S) / (long_s - short_s))
            yield Figure(f"{name}, by CPU time", statistics.median(speeds), "× real time", target)
        ratios = [_simulation_over_rays() for _ in range(rounds)]
        yield Figure("whole simulation with truth, over its bare rays", statistics.median(ratios), "×", "<= 1.8")
        run = ["run", _SCENARIO, "--duration", "0.1", *_LASER, "--out", str(Path(folder) / "run")]
        for name, arguments, cpu_s, mib in (("twin run --no-images", run, 0.65, 140), ("twin list", ["list"], 0.12, 0)):
            _start_cost(arguments, folder)  # compiles the bytecode
            costs = [_start_cost(arguments, folder) for _ in range(rounds)]
            yield Figure(f"start of {name}, CPU time", statistics.median(c[0] for c in costs), "s", f"<= {cpu_s}")
            if mib:
                yield Figure(f"start of {name}, memory", statistics.median(c[1] for c in costs), "MiB", f"<= {mib}")
    for name, scenario in (("lab", _SCENARIO), ("hall", "library-hall")):
        call = [sys.executable, "-c", _SECOND_CASE, scenario]
        spent = [float(subprocess.run(call, check=True, capture_output=True).stdout) for _ in range(rounds)]
        yield Figure(f"second case of the {name}, before its first scan", statistics.median(spent), "s", "<= 0.1")


def _cpu_s(*arguments: str) -> float:
    """Run the command in a process of its own; return its CPU time [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "twin", *arguments], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _start_cost(arguments: list[str], folder: str) -> tuple[float, float]:
    """Return CPU time [s] and peak memory [MiB] of a command whose bytecode is kept in `folder`, as an installed one's is."""
    call = [sys.executable, "-c", _STARTS.replace("{arguments}", repr(arguments))]
    warm = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    warm["PYTHONPYCACHEPREFIX"] = folder
    done = subprocess.run(call, check=True, capture_output=True, text=True, env=warm)
    said = done.stderr.rsplit("COST", 1)[1].split()
    return float(said[0]), float(said[1]) / 1024


def _simulation_over_rays(seconds: float = 10.0) -> float:
    """CPU time of a simulation of the lab's scanners with all its truth, over that of `mj_multiRay` for as many scans."""
    scenario = load_scenario(_SCENARIO, [f"duration_s={seconds}", "background=none"])
    with Simulation(scenario, images=False, on_truth=lambda _: None, on_detail=lambda _: None) as simulation:
        start = time.process_time()
        scans = sum(1 for _ in simulation)
        spent_s = time.process_time() - start
        snapshot = simulation.snapshot(seconds)
        beams = 361
        angles = np.linspace(0, np.pi, beams)
        directions = np.ascontiguousarray(np.stack([np.cos(angles), np.sin(angles), np.zeros(beams)], axis=-1)).ravel()
        geom, distance, eye_m = np.empty(beams, dtype=np.int32), np.empty(beams), np.array([0.0, 0.0, 0.95])
        start = time.process_time()
        for _ in range(scans):
            mujoco.mj_multiRay(
                snapshot.model, snapshot.data, eye_m, directions, RAY_GROUPS, True, -1, geom, distance, None, beams, 8.0
            )
        return spent_s / (time.process_time() - start)


_PEOPLE, _BEAMS, _DURATIONS_S = (2, 5, 10, 20, 40), (181, 361, 721, 1441), (20.0, 60.0, 120.0)


def growth(rounds: int = 3) -> Iterator[Figure]:
    """CPU time of a simulated second with truth against people, beams, sensors, and peak memory against time.

    Slopes are those of log cost over log size between the two largest sizes: at most 1 is no worse than linear.
    """
    people = [f"people.extra_{k}={{script: {{kind: wander}}}}" for k in range(max(_PEOPLE))]
    area = "area=[[-9, -6], [9, -6], [9, 6], [-9, 6]]"
    none = [f"people.{name}=null" for name in load_scenario("library-hall").people]
    laser = json.dumps(load_scenario("library-hall").sensors["west"].model_dump(mode="json", exclude_none=True))
    sweeps = {
        "people": (_PEOPLE, lambda n: [*none, *people[:n], area, "sensors.camera=null"], "library-hall"),
        "beams": (
            _BEAMS,
            lambda n: [f"sensors.{s}.resolution_deg={180 / (n - 1)}" for s in ("waist", "knee")],
            _SCENARIO,
        ),
        "scanners": ((2, 4, 8), lambda n: [f"sensors.more_{k}={laser}" for k in range(n - 2)], "library-hall"),
    }
    for name, (sizes, changes, scenario) in sweeps.items():
        costs = []
        for size in sizes:
            loaded = load_scenario(scenario, [*changes(size), "duration_s=4", "background=none"])
            costs.append(statistics.median(_second_s(loaded) for _ in range(rounds)))
            yield Figure(f"a simulated second with {size} {name}, CPU time", 1e3 * costs[-1], "ms", "")
        slope = np.diff(np.log(costs[-2:]))[0] / np.diff(np.log(sizes[-2:]))[0]
        yield Figure(f"growth with {name}: slope of log cost over log size", float(slope), "", "<= 1.1")
    with tempfile.TemporaryDirectory() as folder:
        peaks = []
        for seconds in _DURATIONS_S:
            out = ("--out", str(Path(folder) / str(seconds)))
            peaks.append(_twin("run", _SCENARIO, "--duration", str(seconds), *_LASER, *out)[1])
            yield Figure(f"peak memory of {seconds:g} s of the lab without images", peaks[-1], "MiB", "<= 400")
        yield Figure("peak memory, longest over shortest", peaks[-1] / peaks[0], "×", "<= 1.25")


def _second_s(scenario: Scenario) -> float:
    """CPU time of a simulated second, truth included, after the first one [s]."""
    with Simulation(scenario, images=False, on_truth=lambda _: None, on_detail=lambda _: None) as simulation:
        start = None
        for observation in simulation:
            if start is None and observation.stamp_ns >= 1e9:
                start = time.process_time()
        assert start is not None
        return (time.process_time() - start) / (scenario.duration_s - 1)


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
