"""Suites and studies killed at random times, edited or damaged, and resumed: the bits of an uninterrupted run, or a refusal.

A seed draws the command, its number of workers, the time, the signal, the process that gets it, and what happens before
`--resume`: nothing, an edit of one of the files that the results depend on, or a file of the results cut at a random byte.
Resumed results must equal, to the bit, those of a run of the edited files that nobody killed; otherwise one sentence must
refuse to resume and name what differs.

`python -m benchmarks.kills FIRST LAST` prints what becomes of these seeds.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random

from benchmarks.figure import Figure

RUNS = 60
_LONGEST_S = 240.0

_FILES = {
    "own.yaml": """\
name: own
room: room/own.xml
duration_s: 2
area: [[-1.8, -1.3], [1.8, -1.3], [1.8, 1.3], [-1.8, 1.3]]
prior: {environment: room.npz}
people:
  ann: {start: [-1.5, 0.5], script: {kind: walk, waypoints: [[1.5, 0.2], [-1.5, 0.5]], repeat: true}}
  bob: {start: [1.2, -0.8], script: {kind: walk, waypoints: [[-1.2, -0.2], [1.2, -0.8]], repeat: true}}
sensors:
  waist: {kind: laser, role: waist, rate_hz: 10, mount: {xyz: [0, -1.4, 0.95], yaw_deg: 90}, noise: default}
trackers: {mine: {preset: "plug:Mine"}}
""",
    "room/own.xml": """\
<mujoco model="own">
  <visual><headlight active="0"/></visual>
  <custom><numeric name="walkable_area" data="-1.8 -1.3  1.8 -1.3  1.8 1.3  -1.8 1.3"/></custom>
  <asset><mesh name="post" file="post.obj"/></asset>
  <worldbody>
    <light name="lamp" pos="0 0 2.4" dir="0 0 -1"/>
    <geom name="floor" type="plane" size="2 1.5 0.1"/>
    <geom name="post" type="mesh" mesh="post" pos="1.9 1.4 0.5"/>
    <include file="walls.xml"/>
  </worldbody>
</mujoco>
""",
    "room/walls.xml": """\
<mujocoinclude>
  <geom name="north" type="box" size="2 0.05 1.2" pos="0 1.5 1.2"/>
  <geom name="south" type="box" size="2 0.05 1.2" pos="0 -1.6 1.2"/>
  <geom name="east" type="box" size="0.05 1.5 1.2" pos="2.1 0 1.2"/>
  <geom name="west" type="box" size="0.05 1.5 1.2" pos="-2.1 0 1.2"/>
</mujocoinclude>
""",
    "room/post.obj": "".join(f"v {x} {y} {z}\n" for x in (-0.04, 0.04) for y in (-0.04, 0.04) for z in (-0.5, 0.5))
    + "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n",
    "plug.py": """\
from dataclasses import replace

from trackers.sort import Sort


class Mine:
    def __init__(self, rig, background, rng):
        self.inner = Sort(rig, background, rng)

    def update(self, observation):
        self.inner.update(observation)

    def tracks(self):
        from gain import SHIFT_M

        return [replace(each, x=each.x + SHIFT_M) for each in self.inner.tracks()]
""",
    "gain.py": "SHIFT_M = 0.01\n",
    "suite.yaml": """\
name: killed
limit_s: 120
seeds: [5985, 5986]
trackers: [sort, mine]
scenarios: [{scenario: own.yaml, grid: {sensors.waist.rate_hz: [10, 8]}}]
""",
    "study.yaml": """\
name: killed
scenarios: [{scenario: own.yaml, set: {duration_s: 1.5}}]
trackers: [sort, mine]
seeds: [5987, 5988]
held_out: {seeds: [5989, 5990]}
devices:
  waist:
    sensors: [waist]
    walls: {height_m: [0.9, 1.0], height_every_m: 0.1, off_m: 0.2, every_m: 1.5}
    aim: area
    price: 1500
objectives: [{kind: metric, metric: hota, tracker: mine}]
coverage: {samples: 4, seeds: [5991]}
search: {method: optuna, candidates: 4, generation: 2, replicates: [1, 2]}
""",
}

EDITS: dict[str, tuple[str, str, str]] = {
    "scenario": ("own.yaml", "rate_hz: 10, mount: {xyz: [0, -1.4, 0.95]", "rate_hz: 10, mount: {xyz: [0, -1.4, 0.90]"),
    "room": ("room/own.xml", 'pos="1.9 1.4 0.5"', 'pos="1.7 1.3 0.5"'),
    "included file": ("room/walls.xml", 'pos="0 1.5 1.2"', 'pos="0 1.45 1.2"'),
    "mesh": ("room/post.obj", "v 0.04 0.04 0.5", "v 0.08 0.09 0.5"),
    "tracker": ("plug.py", "each.x + SHIFT_M", "each.x - SHIFT_M"),
    "tracker's import": ("gain.py", "0.01", "0.02"),
    "suite": ("suite.yaml", "seeds: [5985, 5986]", "seeds: [5985, 5992]"),
    "study": ("study.yaml", "seeds: [5987, 5988]", "seeds: [5987, 5993]"),
}
"""File, text and its replacement, by name of the edit."""

_RUN = {"suite": ["suite", "run", "suite.yaml"], "study": ["study", "run", "study.yaml"]}
_STUDY_FILES = ("candidates.csv", "pareto.csv", "recommended.yaml", "summary.json")
_OF_THE_RUN = ("evaluated_in_this_run", "seconds_of_this_run")
"""Fields of a study's summary that describe the process, not its results."""


@dataclass(frozen=True)
class Outcome:
    """Description of a try, its fault ("" for none), and the last line on stderr."""

    what: str
    fault: str
    said: str


def write_project(folder: Path) -> None:
    """Write the scenario, its room, its tracker, a suite and a study of it."""
    for name, text in _FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    _twin(folder, "environment", "own.yaml", "--set", "prior.environment=null", "--out", "room.npz").check()


def edit(folder: Path, name: str) -> None:
    """Apply an edit of `EDITS`."""
    file, before, after = EDITS[name]
    text = (folder / file).read_text(encoding="utf-8")
    assert before in text, f"{file} has no {before!r}"
    (folder / file).write_text(text.replace(before, after), encoding="utf-8")


@dataclass
class _Process:
    """A command at work; its output goes to files, so that none of its children holds a pipe."""

    popen: subprocess.Popen
    log: Path

    def wait(self) -> int:
        return self.popen.wait(_LONGEST_S)

    def check(self) -> None:
        if self.wait():
            raise RuntimeError(self.log.read_text(encoding="utf-8", errors="replace"))

    def said(self) -> list[str]:
        return self.log.read_text(encoding="utf-8", errors="replace").strip().splitlines()

    def family(self) -> list[int]:
        """List the process and its descendants."""
        parent = {}
        for entry in Path("/proc").glob("[0-9]*/stat"):
            try:
                parent[int(entry.parent.name)] = int(entry.read_text().rpartition(")")[2].split()[1])
            except (OSError, ValueError):
                continue
        found = [self.popen.pid]
        for each in found:
            found += [child for child, its in parent.items() if its == each]
        return found

    def workers(self) -> list[int]:
        """List its workers: descendants that Python has spawned, without its own helper for semaphores."""
        return [pid for pid in self.family()[1:] if b"spawn_main" in _read(Path(f"/proc/{pid}/cmdline"))]


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:  # it has ended
        return b""


def _twin(folder: Path, *arguments: str) -> _Process:
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]),
        "ROOMTWIN_CACHE": str(folder / "cache"),
        "TMPDIR": str(folder / "tmp"),
    }
    (folder / "tmp").mkdir(exist_ok=True)
    log = folder / "said.txt"
    with log.open("wb") as stream:
        popen = subprocess.Popen(
            [sys.executable, "-m", "twin", *arguments], cwd=folder, env=environment, stdin=subprocess.DEVNULL,
            stdout=stream, stderr=stream, start_new_session=True,
        )  # fmt: skip
    return _Process(popen, log)


def run(folder: Path, kind: str, jobs: int, *options: str) -> _Process:
    """Start a suite or a study in `folder`/out."""
    return _twin(folder, *_RUN[kind], "--out", "out", "--jobs", str(jobs), "--allow-plugins", *options)


def results(folder: Path, kind: str) -> dict[str, object]:
    """Read everything that a run results in, without its cost in time."""
    out = folder / "out"
    if kind == "study":
        found: dict[str, object] = {name: (out / name).read_text(encoding="utf-8") for name in _STUDY_FILES}
        summary = json.loads(str(found["summary.json"]))
        found["summary.json"] = {key: value for key, value in summary.items() if key not in _OF_THE_RUN}
        return found
    connection = sqlite3.connect(out / "results.sqlite")
    try:
        rows = connection.execute(
            "SELECT case_id, metric, value FROM results WHERE metric NOT LIKE 'ms_per_frame%' ORDER BY case_id, metric"
        ).fetchall()
        digests = connection.execute("SELECT case_id, digest, people FROM recordings ORDER BY case_id").fetchall()
        status = connection.execute("SELECT case_id, status FROM cases ORDER BY case_id").fetchall()
        incidents = connection.execute("SELECT * FROM moments ORDER BY case_id, t_s, kind, what").fetchall()
    finally:
        connection.close()
    tables = {path.relative_to(out).as_posix(): path.read_text() for path in sorted(out.glob("cases/*/tracks/*.csv"))}
    return {"metrics": rows, "recordings": digests, "status": status, "moments": incidents, **tables}


class Drill:
    """Runs that are killed, beside uninterrupted ones of each edit; all in one folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._whole: dict[tuple[str, str], tuple[dict[str, object], float]] = {}
        (folder / "plain").mkdir()
        write_project(folder / "plain")

    def project(self) -> Path:
        """Copy the project into the folder of all runs: recordings hold the path of their room."""
        folder = self._folder / "work"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(self._folder / "plain", folder, ignore=shutil.ignore_patterns("tmp"))
        return folder

    def whole(self, kind: str, edited: str) -> tuple[dict[str, object], float]:
        """Return the results of an uninterrupted run of the edited files, and its duration [s]."""
        if (kind, edited) not in self._whole:
            folder = self.project()
            if edited:
                edit(folder, edited)
            start = time.monotonic()
            run(folder, kind, 1).check()
            self._whole[kind, edited] = results(folder, kind), time.monotonic() - start
        return self._whole[kind, edited]

    def judge(self, seed: int) -> Outcome:
        """Kill, damage and resume as this seed draws."""
        rng = Random(f"kills {seed}")
        kind, jobs = rng.choice(["suite", "suite", "study"]), rng.choice([1, 2])
        number = rng.choice([signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
        target = rng.choice(["parent", "worker"]) if jobs == 2 else "parent"
        damage = rng.choice(["nothing", "cut", *(each for each in EDITS if each not in _RUN or each == kind)])
        after_s = rng.uniform(0.3, 1.1) * self.whole(kind, "")[1]
        expected, _ = self.whole(kind, damage if damage in EDITS else "")
        what = f"{kind} --jobs {jobs}, {number.name} to {target} after {after_s:.1f} s, {damage}"
        folder = self.project()
        try:
            fault, said = _try(folder, kind, jobs, number, target, after_s, damage, expected, rng)
        except subprocess.TimeoutExpired:
            fault, said = f"did not end within {_LONGEST_S:g} s", []
        if fault:
            shutil.rmtree(self._folder / f"seed {seed}", ignore_errors=True)
            folder.rename(self._folder / f"seed {seed}")
        return Outcome(what, fault, said[-1] if said else "")


def _try(
    folder: Path,
    kind: str,
    jobs: int,
    number: signal.Signals,
    target: str,
    after_s: float,
    damage: str,
    expected: dict[str, object],
    rng: Random,
) -> tuple[str, list[str]]:
    process = run(folder, kind, jobs)
    time.sleep(after_s)
    family = process.family()
    alive = process.popen.poll() is None
    workers = process.workers()
    if not workers:  # none has started: the parent is hit
        target = "parent"
    for pid in rng.sample(workers, 1) if target == "worker" and workers else family[:1]:
        try:
            os.kill(pid, number)
        except ProcessLookupError:
            alive = False
    code = process.wait()
    said = process.said()
    if any("Traceback" in line for line in said):
        return "traceback of the killed run", said
    # By the signal itself: before the command has started, or after it has done everything.
    if target == "parent" and alive and number != signal.SIGKILL and code not in (0, 130, -number):
        return f"exit {code} of the killed run", said
    if target == "worker" and alive and code not in (0, 2, 130):
        return f"exit {code} after the death of a worker", said
    left = [pid for pid in family if not _has_ended(pid)]
    if left:
        return f"{len(left)} processes outlive the run", said
    if damage == "cut":
        cut = _cut(folder, rng)
        said.append(f"cut {cut}")
    elif damage != "nothing":
        edit(folder, damage)
    there = (folder / "out" / ("results.sqlite" if kind == "suite" else "evaluations.jsonl")).exists()
    process = run(folder, kind, jobs, *(["--resume"] if there else []))
    code, again = process.wait(), process.said()
    said += again
    if any("Traceback" in line for line in again) or code not in (0, 2):
        return f"exit {code} of the resumed run", said
    if code == 2:
        named = damage in ("cut", "suite", "study") or "nothing to resume" in again[-1]
        return ("" if named and len(again[-1]) > 20 else "the resumed run refuses"), said
    if results(folder, kind) != expected:
        return "results differ from those of an uninterrupted run", said
    return "", said


def _has_ended(pid: int) -> bool:
    """Wait up to 20 s for the end of a process."""
    until = time.monotonic() + 20
    while time.monotonic() < until:
        try:
            if Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except OSError:
            return True
        time.sleep(0.1)
    return False


def _cut(folder: Path, rng: Random) -> str:
    """Cut a file of the results or of the cache at a random byte; return its name."""
    files = [
        path
        for part in ("out", "cache")
        for path in sorted((folder / part).rglob("*"))
        if path.is_file() and path.suffix != ".lock" and path.stat().st_size
    ]
    if not files:
        return "nothing"
    path = rng.choice(files)
    keep = rng.randrange(path.stat().st_size)
    os.truncate(path, keep)
    return f"{path.relative_to(folder)} at byte {keep}"


def measure() -> Iterator[Figure]:
    """Sixty killed runs; each that is badly handled is reported on stderr."""
    bad = 0
    with tempfile.TemporaryDirectory(prefix="kills-") as made:
        drill = Drill(Path(made))
        for seed in range(RUNS):
            outcome = drill.judge(seed)
            if outcome.fault:
                bad += 1
                print(f"kills {seed}: {outcome.what}: {outcome.fault} {outcome.said}", file=sys.stderr, flush=True)
    yield Figure(f"killed runs: badly handled of {RUNS}", bad, "", "<= 0")


def main() -> int:
    """Judge these seeds; folders of those badly handled are kept."""
    folder = Path(tempfile.mkdtemp(prefix="kills-"))
    drill, bad = Drill(folder), 0
    for seed in range(int(sys.argv[1]), int(sys.argv[2])):
        outcome = drill.judge(seed)
        bad += bool(outcome.fault)
        print(seed, outcome.what, outcome.fault or "well", outcome.said, sep=" | ", flush=True)
    print(f"{bad} badly handled" + (f"; see {folder}" if bad else ""))
    if not bad:
        shutil.rmtree(folder)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
