"""Table I on the lab's five people, and what a scan costs a tracker."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.figure import Figure
from twin.evaluate import long_occlusions
from twin.recording.tables import read_truth
from twin.run import run_scenario
from twin.scenario import load_scenario

_SEEDS = range(5)
_COLUMNS = (
    "laser-fisheye-imm",
    "waist-fisheye-imm",
    "laser-imm",
    "laser-fisheye-kalman",
    "waist-fisheye-kalman",
    "laser-kalman",
)
_COAST_S = 1.5


def table_one() -> Iterator[Figure]:
    """Misidentified and lost over seeds 0–4, for both filters and three sensor sets; long occlusions excuse the first."""
    counts = {name: {"misidentifications": 0, "lost_tracks": 0} for name in _COLUMNS}
    motp_m, excused = [], 0
    with tempfile.TemporaryDirectory() as folder:
        for seed in _SEEDS:
            out = Path(folder) / str(seed)
            scenario = load_scenario("lab-five-people", [f"seed={seed}"])
            document = run_scenario(scenario, trackers=_COLUMNS, out=out, video=False).metrics or {}
            for name in _COLUMNS:
                for kind in counts[name]:
                    counts[name][kind] += document["trackers"][name][kind]
            motp_m.append(document["trackers"]["laser-fisheye-imm"]["motp_m"])
            excused += len(long_occlusions(read_truth(out / "truth.csv"), ("waist", "knee"), _COAST_S))
    yield Figure("occlusions at both heights longer than 1.5 s, seeds 0–4", excused, "occlusions", "")
    for name in _COLUMNS:
        full = name == "laser-fisheye-imm"
        yield Figure(
            f"{name}: misidentified, seeds 0–4", counts[name]["misidentifications"], "", "<= 0" if full else ""
        )
        yield Figure(f"{name}: lost, seeds 0–4", counts[name]["lost_tracks"], "", f"<= {excused}" if full else "")
    yield Figure("laser-fisheye-imm: MOTP, worst of seeds 0–4", max(motp_m), "m", "<= 0.12")
    full_sum = sum(counts["laser-fisheye-imm"].values())
    for name in ("laser-imm", "waist-fisheye-imm"):
        yield Figure(f"{name}: errors above the full set's", sum(counts[name].values()) - full_sum, "", ">= 1")


def cost() -> Iterator[Figure]:
    """What a scan of five people costs the full tracker and the laser part alone, image included [ms]."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = load_scenario("lab-five-people")
        names = ["laser-fisheye-imm", "laser-imm"]
        document = run_scenario(scenario, trackers=names, out=Path(folder) / "run", video=False).metrics or {}
    for name, target in zip(names, ("<= 10", ""), strict=True):
        yield Figure(f"{name}: a scan of five people", document["trackers"][name]["ms_per_frame"]["mean"], "ms", target)
