"""The mutation run itself: so many mutants of a kind, from their seeds, and what was badly handled.

`python -m benchmarks.fuzz.run KIND SEED` makes and judges one again, and says where it lies.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from benchmarks.figure import Figure
from benchmarks.fuzz.inputs import Inputs, make_inputs
from benchmarks.fuzz.judge import LONGEST_S, MOST_MIB, Judge, Verdict
from benchmarks.fuzz.kinds import KINDS

MUTANTS = 300
KEPT = Path("out/fuzz")
"""Folder of badly handled mutants, each in a folder of its own."""


@dataclass
class Tally:
    """Outcome for the mutants of one kind; faults: by seed."""

    faults: dict[int, Verdict] = field(default_factory=dict)
    refused: int = 0
    longest_s: float = 0.0
    most_mib: float = 0.0

    def count(self, seed: int, verdict: Verdict) -> None:
        """Add one."""
        self.refused += verdict.refused
        self.longest_s = max(self.longest_s, verdict.spent_s)
        self.most_mib = max(self.most_mib, verdict.peak_mib)
        if verdict.fault:
            self.faults[seed] = verdict


def judge_mutants(kind: str, seeds: range, inputs: Inputs, judge: Judge, kept: Path | None = None) -> Tally:
    """Make and judge the mutants of a kind with these seeds; those badly handled are left in `kept`/KIND-SEED."""
    tally = Tally()
    for seed in seeds:
        with tempfile.TemporaryDirectory(prefix="fuzz-") as made:
            folder = Path(made) / "in" / "here"
            folder.mkdir(parents=True)
            verdict = judge.judge(KINDS[kind](inputs, Random(f"{kind} {seed}"), folder))
            tally.count(seed, verdict)
            if verdict.fault and kept is not None:
                shutil.rmtree(kept / f"{kind}-{seed}", ignore_errors=True)
                shutil.copytree(folder, kept / f"{kind}-{seed}", symlinks=True)
                (kept / f"{kind}-{seed}" / "said.txt").write_text(verdict.said, encoding="utf-8")
    return tally


def measure() -> Iterator[Figure]:
    """Every kind, 300 mutants each; what was badly handled is reported on stderr and kept in out/fuzz."""
    with tempfile.TemporaryDirectory() as folder, Judge() as judge:
        inputs = make_inputs(Path(folder))
        for kind in KINDS:
            tally = judge_mutants(kind, range(MUTANTS), inputs, judge, KEPT)
            tell(kind, tally)
            yield Figure(f"{kind}: badly handled of {MUTANTS} mutants", len(tally.faults), "", "<= 0")
            yield Figure(f"{kind}: refused in a sentence", tally.refused / MUTANTS, "", "")
            yield Figure(f"{kind}: the longest", tally.longest_s, "s", f"<= {LONGEST_S:g}")
            yield Figure(f"{kind}: the most memory", tally.most_mib / 1024, "GiB", f"<= {MOST_MIB / 1024:g}")


def tell(kind: str, tally: Tally) -> None:
    """Say on stderr what was badly handled, with what the twin said last."""
    for seed, verdict in tally.faults.items():
        last = verdict.said.strip().splitlines()[-3:]
        print(f"{kind} {seed}: {verdict.fault}: {' | '.join(last)[-400:]}", file=sys.stderr, flush=True)


def main() -> int:
    """Judge the mutants of a kind from a seed to another (one: that seed alone)."""
    kind, first, *last = sys.argv[1:]
    seeds = range(int(first), int(last[0]) if last else int(first) + 1)
    with tempfile.TemporaryDirectory() as folder, Judge() as judge:
        tally = judge_mutants(kind, seeds, make_inputs(Path(folder)), judge, KEPT)
    tell(kind, tally)
    print(f"{kind}: {len(tally.faults)} of {len(seeds)} badly handled, {tally.refused} refused")
    print(f"the longest {tally.longest_s:.1f} s, the most memory {tally.most_mib:.0f} MiB")
    return 1 if tally.faults else 0


if __name__ == "__main__":
    sys.exit(main())
