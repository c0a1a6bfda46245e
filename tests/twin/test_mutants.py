"""A part of the mutation run (`scripts/bench --only fuzz`): bad input of every kind is one sentence, soon, and does no harm."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from benchmarks.fuzz.inputs import SMALL, Inputs, make_inputs
from benchmarks.fuzz.judge import Judge, Mutant
from benchmarks.fuzz.kinds import KINDS
from benchmarks.fuzz.run import judge_mutants

pytestmark = pytest.mark.slow

_SLOW = ("scenarios", "rooms", "pedestrians", "suites", "bags", "rigs", "stores", "baselines")
MUTANTS = dict.fromkeys(KINDS, 12) | dict.fromkeys(_SLOW, 6)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory) -> Inputs:
    return make_inputs(tmp_path_factory.mktemp("inputs"))


@pytest.fixture(scope="module")
def judge() -> Iterator[Judge]:
    with Judge() as judge:
        yield judge


@pytest.mark.sample(6)
@pytest.mark.parametrize("kind", MUTANTS)
def test_bad_input_is_refused_in_a_sentence_and_does_no_harm(kind, inputs, judge, tmp_path):
    tally = judge_mutants(kind, range(MUTANTS[kind]), inputs, judge, tmp_path)
    assert not tally.faults, "\n".join(
        f"{kind} {seed}: {verdict.fault}: {verdict.said[-2000:]}" for seed, verdict in tally.faults.items()
    )


BAD = """
import os, pathlib

class Bad:
    def __init__(self, rig, background, rng, **options): self.act()

class Touches(Bad):
    def act(self):
        pathlib.Path("elsewhere.txt").write_text("x")
        os.remove("scenario.yaml")

class Takes(Bad):
    def act(self): self.memory = bytearray(b"x") * (350 << 20)

class Dies(Bad):
    def act(self): os.abort()

class Hangs(Bad):
    def act(self):
        while True: pass
"""


@pytest.mark.parametrize(
    ("tracker", "fault"),
    [
        ("Touches", "touches open .*elsewhere.txt, os.remove .*scenario.yaml"),
        ("Takes", r"takes \d+ MiB"),
        ("Dies", "the process died with -6"),
        ("Hangs", "hangs: stopped after 1"),
    ],
)
def test_the_judge_sees_what_must_not_happen(tracker, fault, tmp_path):
    (tmp_path / "bad.py").write_text(BAD, encoding="utf-8")
    (tmp_path / "scenario.yaml").write_text(SMALL, encoding="utf-8")
    command = ["twin", "run", "scenario.yaml", "--no-images", "--tracker", f"bad:{tracker}", "--out", "out"]
    with Judge(longest_s=1.5 if tracker == "Hangs" else 30, most_mib=400) as judge:
        verdict = judge.judge(Mutant(command, tmp_path, (tmp_path / "out",)))
    assert re.match(fault, verdict.fault)
