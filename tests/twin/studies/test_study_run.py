"""A study run, killed, resumed, on one worker and on two: the same candidates, the same figures, those of a run."""

from __future__ import annotations

import base64
import csv
import errno
import json
import os
import re
import shlex
import shutil
import subprocess
import warnings
from html import unescape
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from command_line import twin
from small_study import written as written_small

from trackers.errors import InputError
from twin.run.inputs import ChosenTracker
from twin.run.live import run_scenario
from twin.scenario import load_scenario
from twin.studies import run as study_run, store
from twin.studies.coverage import PoseCoverage
from twin.studies.results import print_summary
from twin.studies.run import run_study, write_results
from twin.studies.trials import TrialRunner
from twin.studies.worker import EvaluationTask, evaluate_task
from twin.suites.cache import RecordingCache
from twin.suites.cache_keys import whole_code
from twin.suites.cluster import Workers
from twin.suites.metrics import flatten_metrics

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def _own_cache(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROOMTWIN_CACHE", str(cache))


def written(folder: Path, **changes: Any) -> Path:
    """Write the small study for the cheapest tracker, with a fault after the end, and changes by dotted path."""
    late = {"late": {"sensor": "waist", "kind": "dropout", "probability": 1, "from_s": 9}}
    return written_small(folder, **{"trackers": ["sort"], "scenarios.0.set.faults": late, **changes})


def run(path: Path, out: Path, jobs: int = 1, *, page: bool = False, **options: Any) -> dict[str, Any]:
    """Run a study and return its summary; the page, a fifth of the time, is drawn where it is asked for."""
    with (
        pytest.MonkeyPatch.context() as patch,
        run_study(path, out, Workers(jobs=jobs), **options) as (results, folder),
    ):
        if not page:
            patch.setattr(study_run, "write_page", lambda file, results: None)
        write_results(folder, results)
    return json.loads((out / "summary.json").read_text())


def tables(out: Path) -> list[bytes]:
    return [(out / name).read_bytes() for name in ("candidates.csv", "pareto.csv", "recommended.yaml")]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, cache: Path) -> tuple[Path, Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("study")
    path = written(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROOMTWIN_CACHE", str(cache))
        return path, folder / "a büro", run(path, folder / "a büro", page=True)


def test_what_scenarios_warn_of_is_told_once(whole: tuple[Path, Path, dict]) -> None:
    _, out, summary = whole  # two seeds of two placements and more: none of them with an effect of the fault
    (warning,) = summary["warnings"]
    assert "faults.late.from_s: 9 s is not before the end" in warning
    assert (out / "report.html").read_text().count("faults.late.from_s: 9 s") == 1


def test_a_run_leaves_its_answers(whole: tuple[Path, Path, dict], capsys: pytest.CaptureFixture[str]) -> None:
    path, out, summary = whole
    with (out / "candidates.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert rows[0]["candidate"] == rows[0]["places"] == "baseline" and len(rows) == 7
    assert {row["replicates"] for row in rows} == {"1", "2"}
    best = max((row for row in rows if row["replicates"] == "2"), key=lambda row: float(row["sort: hota"]))
    assert summary["best"]["sort: hota"] == pytest.approx(float(best["sort: hota"]), abs=1e-6)
    assert [row["what"] for row in summary["held_out"]] == ["the study's scenarios"] and summary["held_out"][0][
        "difference"
    ]["n"] == 2
    assert next(row["what"] for row in summary["displaced"]).startswith("1 mm") and len(summary["displaced"]) == 5
    page = (out / "report.html").read_text()
    assert "1 : 50 on A4" in page and "Displaced sensors" in page
    commands = [
        shlex.split(line) for line in unescape(re.findall(r"<pre>(.*?)</pre>", page, re.DOTALL)[-1]).splitlines()
    ]
    assert commands[0] == ["twin", "study", "run", str(path), "--out", str(out)]  # as a shell reads what one copies
    assert commands[1] == ["twin", "run", str(out / "recommended.yaml")]
    drawn = re.search(r'class="plan"><img src="data:image/svg\+xml;base64,([^"]+)"', page)
    assert drawn is not None and b"<svg" in base64.b64decode(drawn[1])
    print_summary(out)
    said = capsys.readouterr().out
    assert "recommended" in said
    assert summary["indistinguishable"] and "fewer than 6" in said and "give no interval" in page  # on two seeds


def test_figures_and_tracks_are_those_of_a_run(whole: tuple[Path, Path, dict], tmp_path: Path) -> None:
    _, out, _ = whole
    rows = [json.loads(line) for line in (out / store.FILE).read_text().splitlines()[1:]]
    summary = json.loads((out / "summary.json").read_text())
    best = summary["best"]["candidate"]
    row = next(each for each in rows if each["id"].startswith(f"{best} ") and each["id"].endswith(" 1001"))
    scenario = load_scenario(out / "recommended.yaml", ["seed=1001"])
    with pytest.warns(UserWarning, match="never begins"):
        metrics = run_scenario(scenario, trackers=["sort"], out=tmp_path / "run", video=False).metrics
    assert metrics is not None
    ours, theirs = row["figures"]["sort"], flatten_metrics(metrics["trackers"]["sort"])
    differ = {key for key in theirs if ours.get(key) != theirs[key]}
    assert {key.split(".")[0] for key in differ} <= {
        "ms_per_frame",
        "disposal",
        "errors",
    }  # what it costs; what needs more truth
    work = EvaluationTask(
        scenario,
        (ChosenTracker("sort", "sort"),),
        RecordingCache(tmp_path, 10**9),
        whole_code(),
        details=True,
    )
    whole_figures = evaluate_task(work).metrics["sort"]
    assert not {key for key in theirs if whole_figures.get(key) != theirs[key] and not key.startswith("ms_per_frame")}


def test_placement_that_a_tracker_drops_scans_of_is_evaluated_as_well_where_warnings_are_errors(tmp_path: Path) -> None:
    """`python -W error` rejected the placement of a scanner whose scans were dropped, and another was recommended."""
    hangs = "faults.one={sensor: waist, kind: freeze, from_s: 0.2, to_s: 1}"
    changes = ["duration_s=1", "sensors.fisheye=null", "sensors.knee=null", hangs]
    scenario = load_scenario("lab-five-people", changes)
    work = EvaluationTask(scenario, (ChosenTracker("sort", "sort"),), RecordingCache(tmp_path, 10**9), whole_code())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert evaluate_task(work).metrics["sort"]["misses"]


class KilledError(Exception):
    pass


@pytest.mark.sample(1)
@pytest.mark.parametrize("after", [2, 11])
def test_a_killed_run_is_resumed_to_the_same_bits(
    whole: tuple[Path, Path, dict], after: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, before, _ = whole
    held, count = store.EvaluationStore.record, 0

    def hold(self: Any, job: Any, outcome: Any) -> None:
        nonlocal count
        held(self, job, outcome)
        count += 1
        if count == after:
            raise KilledError

    with monkeypatch.context() as patch:
        patch.setattr(store.EvaluationStore, "record", hold)
        with pytest.raises(KilledError):
            run(path, tmp_path / "out")
    with (tmp_path / "out" / store.FILE).open("a") as stream:
        stream.write('{"id": "half a li')  # as a kill in the middle of writing leaves it
    with pytest.raises(InputError, match="holds the results of an earlier run of the same study; --resume"):
        run(path, tmp_path / "out")
    run(path, tmp_path / "out", resume=True)
    assert tables(tmp_path / "out") == tables(before)


@pytest.mark.nightly
def test_several_objectives_are_resumed_to_the_same_front(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By NSGA-II, killed in its second generation, and gone on with by two workers."""
    changes = {"objectives": [{"kind": "metric", "metric": "hota"}, {"kind": "price"}], "devices__rig__count": [1, 2]}
    changes |= {"constraints": {"cable": {"from": [0, 0, 0.3], "price_per_m": 4}, "apart_m": 0.5}}
    path = written(tmp_path, **changes)
    run(path, tmp_path / "whole")
    held, count = store.EvaluationStore.record, 0

    def hold(self: Any, job: Any, outcome: Any) -> None:
        nonlocal count
        held(self, job, outcome)
        count += 1
        if count == 9:
            raise KilledError

    with monkeypatch.context() as patch:
        patch.setattr(store.EvaluationStore, "record", hold)
        with pytest.raises(KilledError):
            run(path, tmp_path / "out")
    run(path, tmp_path / "out", jobs=2, resume=True)
    assert tables(tmp_path / "out") == tables(tmp_path / "whole")
    with (tmp_path / "out" / "pareto.csv").open() as stream:
        assert len(list(csv.DictReader(stream))) > 0


@pytest.mark.nightly
def test_two_workers_find_what_one_does(whole: tuple[Path, Path, dict], tmp_path: Path) -> None:
    path, before, _ = whole
    run(path, tmp_path / "out", jobs=2)
    assert tables(tmp_path / "out") == tables(before)


def test_another_study_or_code_is_not_resumed(
    whole: tuple[Path, Path, dict], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And that is said before the first evaluation."""
    path, before, _ = whole
    monkeypatch.setattr(TrialRunner, "check_metrics", lambda self: pytest.fail("an evaluation was begun"))
    other = written(tmp_path, search__candidates=7)
    for resume, named in ((True, "--resume"), (False, "--out")):  # without --resume it is not advised
        with pytest.raises(
            InputError, match=rf"{named}.*: was made of another study \(search changed\); [^-]*is expected"
        ):
            run(other, before, resume=resume)
    with pytest.raises(InputError, match="there is nothing to resume"):
        run(path, tmp_path / "nothing", resume=True)
    with pytest.raises(InputError, match="--out .*: cannot be written"):
        run(path, path / "beneath a file")
    with pytest.raises(InputError, match="holds the results of an earlier run"):
        run(path, before)
    monkeypatch.setattr(store, "whole_code", lambda: "0123")
    for resume in (True, False):
        with pytest.raises(InputError, match="was made by other code"):
            run(path, before, resume=resume)


def test_a_candidate_that_fails_is_a_row_with_a_reason(tmp_path: Path) -> None:
    places = [{"xyz": [0, 3.6, 0.95], "yaw_deg": -90}, {"xyz": [0, 3.6, 0.4], "yaw_deg": -90}]
    path = written(
        tmp_path,
        devices__rig__walls=None,
        devices__rig__aim=None,
        devices__rig__places=places,
        trackers=[],
        objectives=[{"kind": "coverage"}],
        search__method="exhaustive",
        held_out=None,
    )  # the knee scanner of the second would be below the floor
    summary = run(path, tmp_path / "out")
    assert summary["rejected"]["rig"] == {"below the floor": 1}
    level = [{"name": "level", "set": {"role": "waist"}}]  # poses are rejected by the role of the scenario's own
    tilted = {"tilt_deg": [0, 60], "tilt_every_deg": 60, "kinds": level}
    path = written(
        tmp_path,
        devices={"waist": {"sensors": ["waist"], "places": places[:1], **tilted}},
        search__method="exhaustive",
        held_out=None,
    )
    run(path, tmp_path / "tilted")
    with (tmp_path / "tilted" / "candidates.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert "scans level" in rows[2]["rejected"] and rows[2]["replicates"] == "0" and not rows[1]["rejected"]


def test_coverage_alone_is_searched_exactly(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(
        tmp_path,
        trackers=[],
        objectives=[{"kind": "coverage"}, {"kind": "price"}],
        search={"method": "exact"},
        devices__rig__count=[1, 2],
        held_out=None,
        coverage={"of": "floor", "samples": 0, "cell_m": 0.2, "beams": 12},
    )
    summary = run(path, tmp_path / "out")
    assert [row["exact_is"] for row in summary["proven"]] == ["optimal", "optimal"]
    assert all(0.98 <= row["greedy_over_exact"] <= 1 for row in summary["proven"])
    assert summary["best"]["coverage"] == pytest.approx(max(row["exact"] for row in summary["proven"]))
    assert summary["best"]["coverage"] >= summary["baseline"]["coverage"]
    assert summary["searched"] == "136 placements of 16 poses, searched exactly by coverage"  # 16 alone, 120 pairs
    assert [row["price"] for row in summary["best_of_each_count"]] == [1500, 3000]
    assert "seeds" not in summary["best"] and "evaluated_in_this_run" not in summary  # it tracks nothing
    print_summary(tmp_path / "out")
    shown = " ".join(capsys.readouterr().out.split())
    assert summary["searched"] in shown and all(
        row["places"].split(";")[0] in shown for row in summary["best_of_each_count"]
    )


ONE_RIG_SEES_ALL = {
    "trackers": [],
    "objectives": [{"kind": "coverage"}, {"kind": "price"}],
    "search": {"method": "greedy"},
    "devices__rig__count": [1, 2],
    "held_out": None,
    "coverage": {"samples": 2, "seeds": [1950], "beams": 1},
}


def test_of_placements_that_cover_alike_the_cheapest_is_recommended(tmp_path: Path) -> None:
    cable = {"from": [2.9, 2.9, 0.3], "price_per_m": 10}
    path = written(tmp_path, **ONE_RIG_SEES_ALL, constraints__cable=cable)
    summary = run(path, tmp_path / "out", page=True)
    assert summary["best"]["candidate"] in [row["candidate"] for row in summary["pareto"]]
    assert summary["best"]["price"] < summary["baseline"]["price"]
    if node := shutil.which("node"):  # the page measures the cable to the farthest sensor of a rig too
        page = (tmp_path / "out" / "report.html").read_text()
        (content,) = re.findall(r'id="plan-data">(.*?)</script>', page, re.DOTALL)
        code = f"const plan = P.planOf({content}); console.log(P.priceOf(plan, plan.sensors));"
        script = Path(study_run.__file__).with_name("interactive_plan.js")
        done = subprocess.run(
            [node, "-e", f"const P = require({str(script)!r}); {code}"], capture_output=True, check=True
        )
        assert float(done.stdout) == pytest.approx(summary["best"]["price"], abs=0.1)


def test_a_number_of_devices_that_another_beats_is_shown_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One rig sees all that two do: two are dominated, and yet have been searched. What would tell them apart is said."""
    path = written(tmp_path, **ONE_RIG_SEES_ALL)
    summary = run(path, tmp_path / "out")
    assert {row["price"] for row in summary["pareto"]} == {1500}
    assert [(row["price"], row["coverage"]) for row in summary["best_of_each_count"]] == [(1500, 1.0), (3000, 1.0)]
    print_summary(tmp_path / "out")
    assert "to tell them apart try `of: floor`, or more `samples` (now 2)" in capsys.readouterr().err


def test_a_tracker_that_no_objective_uses_is_run_beside_the_search(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(
        tmp_path,
        objectives=[{"kind": "coverage"}],
        held_out=None,
        search={"method": "exact", "replicates": [1, 2]},
        coverage={"samples": 20, "seeds": [1950]},
    )
    summary = run(path, tmp_path / "out")
    assert summary["best"]["coverage"] >= summary["baseline"]["coverage"]
    assert "trackers: no objective uses sort; it is run for the table of candidates alone" in capsys.readouterr().err
    rows = list(csv.DictReader((tmp_path / "out" / "candidates.csv").open()))
    assert all(row["sort: hota"] for row in rows)


def test_coverage_that_no_placement_reaches_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(
        tmp_path,
        trackers=[],
        objectives=[{"kind": "coverage"}],
        held_out=None,
        search={"method": "greedy"},
        coverage={"samples": 4, "seeds": [1950], "at_least": 8},
    )
    summary = run(path, tmp_path / "out")
    assert summary["best"]["coverage"] == 0 and "saturation" not in summary
    told = capsys.readouterr().err
    assert "coverage: no placement shows anything as it asks: by at least 8" in told and "devices.rig" not in told


def test_a_device_that_shows_nothing_from_any_pose_is_found() -> None:
    coverage: Any = object.__new__(PoseCoverage)
    coverage._layout = SimpleNamespace(poses=[SimpleNamespace(device=device) for device in "aabbc"])
    nothing, some = np.zeros((1, 2), dtype=np.uint64), np.ones((1, 2), dtype=np.uint64)
    coverage._bits = {0: nothing, 1: some, 2: nothing, 3: nothing}
    assert coverage.blind_devices() == {"b": 2}


def test_what_coverage_finds_is_tracked_and_judged_by_every_figure(tmp_path: Path) -> None:
    metrics = [{"kind": "metric", "metric": "motp_m"}, {"kind": "metric", "metric": "idf1"}]
    path = written(
        tmp_path,
        objectives=[{"kind": "coverage"}, {"kind": "price"}, *metrics],
        search={"method": "exact", "replicates": [2]},
        devices__rig__count=[1, 2],
        constraints={"apart_m": 0.5},
    )
    summary = run(path, tmp_path / "out")
    assert [row["exact_is"] for row in summary["proven"]] == ["optimal", "optimal"]
    assert {"sort: motp_m", "sort: idf1"} <= summary["best"].keys() and summary["best"]["seeds"] == 2
    assert [row["what"] for row in summary["held_out"]] == [
        "sort: motp_m, the study's scenarios",
        "sort: idf1, the study's scenarios",
    ]
    assert len(summary["displaced"]) == 5


def damaged(line: str) -> list[str]:
    """A line of evaluations cut, emptied, changed with and without a checksum that fits, and of another kind."""
    content = json.loads(line)
    del content["sum"]
    beyond = {**content, "figures": {"sort": {**content["figures"]["sort"], "hota": 9.9}}}
    edited = {**content, "figures": {"sort": {**content["figures"]["sort"], "hota": 0.99}}}
    return [
        line[:40], "", "[]", "null", "\x00\xff", "[" * 5000, json.dumps({**edited, "sum": json.loads(line)["sum"]}),
        store.with_checksum(beyond), store.with_checksum({**content, "figures": 3}),
    ]  # fmt: skip


def test_a_bad_line_is_reported_and_evaluated_again_and_costs_no_other(
    whole: tuple[Path, Path, dict], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, before, summary = whole
    lines = (before / store.FILE).read_text().splitlines()
    bad = damaged(lines[2])
    out = tmp_path / "out"
    out.mkdir()
    spoiled = [*lines[:2], *bad, *lines[3:]]
    (out / store.FILE).write_text("\n".join(spoiled) + "\n" + lines[1][:30])
    (out / "search.journal.lock").symlink_to("search.journal")  # as an older version left it when it was killed
    result = run(path, out, resume=True)
    reported = capsys.readouterr().err
    assert tables(out) == tables(before)
    assert result["evaluated_in_this_run"] == 1  # that of the line that was replaced
    assert [reported.count(f"line {number}: ") for number in range(1, 3 + len(bad))] == [0, 0, *[1] * len(bad)]
    assert "hota is 9.9; a number from 0 to 1 is expected" in reported
    assert sorted((out / store.FILE).read_text().splitlines()) == sorted(lines)  # all good ones, and that one again
    run(path, out, resume=True)
    assert "line" not in capsys.readouterr().err


def test_a_first_line_that_is_damaged_is_refused_and_nothing_is_lost(
    whole: tuple[Path, Path, dict], tmp_path: Path
) -> None:
    path, before, _ = whole
    text = (before / store.FILE).read_text().replace('"name": "small"', '"name": "smell"', 1)
    out = tmp_path / "out"
    out.mkdir()
    (out / store.FILE).write_text(text)
    for resume in (True, False):
        with pytest.raises(InputError, match=r"line 1: is not as it was written, by its checksum; "):
            run(path, out, resume=resume)
    assert (out / store.FILE).read_text() == text


def test_a_disk_that_is_full_while_the_file_is_mended_leaves_the_old_one(
    whole: tuple[Path, Path, dict], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, before, _ = whole
    out = tmp_path / "out"
    out.mkdir()
    text = (before / store.FILE).read_text() + "half a li"
    (out / store.FILE).write_text(text)

    def full(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        with pytest.raises(InputError, match=r"evaluations\.jsonl: cannot be written \(No space"):
            run(path, out, resume=True)
    assert (out / store.FILE).read_text() == text


PLUG_INS = """
from trackers.tracks import Track
class Silent:
    def __init__(self, rig, background, rng): ...
    def update(self, observation): ...
    def tracks(self):
        return []
class Raises(Silent):
    def update(self, observation):
        raise ValueError("no such person")
"""


@pytest.mark.parametrize(
    ("name", "code", "said"),
    [
        ("Silent", 0, "displaced by"),
        (
            "Raises",
            1,
            "twin: study_plug_in:Raises: update() raised ValueError: no such person (study_plug_in.py, line 10) at",
        ),
    ],
)
def test_a_plug_in_that_reports_nobody_or_raises_ends_no_study_as_a_fault_of_ours(
    name: str, code: int, said: str, tmp_path: Path
) -> None:
    (tmp_path / "study_plug_in.py").write_text(PLUG_INS)
    places = [{"xyz": [0, 0, 0.95], "yaw_deg": 90}, {"xyz": [-2, 1, 0.95], "yaw_deg": 0}]
    file = written(
        tmp_path,
        trackers=[f"study_plug_in:{name}"],
        devices={"waist": {"sensors": ["waist"], "places": places}},
        search={"method": "exhaustive", "replicates": [1]},
        held_out=None,
    )
    done = twin("study", "run", file.name, "--jobs", "1", "--allow-plugins", "--out", "out", cwd=tmp_path)
    assert done.returncode == code, done.stderr
    assert said in done.stdout + done.stderr and "Traceback" not in done.stderr
