"""A suite from its file to its results, its gate and its exit codes, with cases made up in place of recordings."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

import psutil
import pytest
from synthetic_cases import result_of
from typer.testing import CliRunner

from trackers.errors import InputError
from twin.commands.batch import suite_app as app
from twin.scenario import Scenario
from twin.suites import result_files, run as suite_run
from twin.suites.cache import RecordingCache
from twin.suites.cluster import Workers
from twin.suites.comparison import SuiteOutcome
from twin.suites.dask_runner import ProgressListener
from twin.suites.page import write_page
from twin.suites.result_files import read_store
from twin.suites.run import run_suite
from twin.suites.spec import load_suite
from twin.suites.store import FORMER_FACTS

pytestmark = pytest.mark.slow

SUITE = """
name: made-up
description: Cases that cost nothing.
seeds: 4
trackers: [laser-imm, laser-kalman]
limit_s: 20
scenarios:
  - scenario: lab-five-people
    name: plain
    set: {duration_s: 2}
  - scenario: lab-five-people
    name: shirts
    grid: {people.white.shirt: [red, blue]}
"""
N_CASE = 3 * 4 * 2


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    path = tmp_path / "made-up.yaml"
    path.write_text(SUITE)
    return path


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROOMTWIN_CACHE", str(tmp_path / "cache"))


def run_made_up(suite: Path, folder: Path, jobs: int = 1, **more: object) -> None:
    loaded, path = load_suite(suite)
    cache = RecordingCache(folder.parent / "cache", 10**6)
    run_suite(loaded, path, folder, cache, Workers(jobs=jobs), function=result_of, **more)


@pytest.fixture(scope="module")
def made_up(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the suite's file and, in `out`, its whole run; tests spoil copies of it."""
    folder = tmp_path_factory.mktemp("made-up")
    (folder / "made-up.yaml").write_text(SUITE)
    run_made_up(folder / "made-up.yaml", folder / "out")
    return folder


def rows(folder: Path, query: str) -> list[tuple]:
    with sqlite3.connect(folder / "results.sqlite") as connection:
        return connection.execute(query).fetchall()


def assert_whole(folder: Path) -> None:
    """Every case done, every figure there, none twice."""
    assert rows(folder, "SELECT status, COUNT(*) FROM cases GROUP BY status") == [("done", N_CASE)]
    per_case = rows(folder, "SELECT case_id, COUNT(*), COUNT(DISTINCT metric) FROM results GROUP BY case_id")
    assert len(per_case) == N_CASE and {(n, distinct) for _, n, distinct in per_case} == {(9, 9)}
    assert rows(folder, "SELECT COUNT(*) FROM moments") == [(N_CASE,)]
    assert len(list((folder / "cases").glob("*/report.html"))) == N_CASE


def command(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> tuple[int, str, BaseException | None]:
    """Exit code, output and error of `twin suite ...` with made-up cases, in this process."""
    monkeypatch.setattr(suite_run, "run_case", result_of)
    done = CliRunner().invoke(app, list(arguments))
    error = done.exception if not isinstance(done.exception, SystemExit) else None
    return done.exit_code, done.output, error


def test_results_are_rows_that_anybody_can_read(made_up: Path) -> None:
    assert_whole(made_up / "out")
    columns = [row[1] for row in rows(made_up / "out", "PRAGMA table_info(cases)")]
    assert columns == ["case_id", "status", "attempts", "seconds", "error"]
    columns = [row[1] for row in rows(made_up / "out", "PRAGMA table_info(results)")]
    assert columns == ["case_id", "scenario", "seed", "overrides", "tracker", "metric", "value"]
    found = rows(
        made_up / "out",
        "SELECT overrides, value FROM results WHERE scenario = 'shirts' AND seed = 2 AND tracker = 'laser-imm' "
        "AND metric = 'motp_m' ORDER BY overrides",
    )
    assert found == [('["people.white.shirt=\\"blue\\""]', 0.062), ('["people.white.shirt=\\"red\\""]', 0.062)]
    assert rows(made_up / "out", "SELECT DISTINCT value FROM results WHERE metric = 'head_error_m.x'") == [(None,)]


def test_workers_give_the_same_results_as_this_process(made_up: Path, suite: Path, tmp_path: Path) -> None:
    run_made_up(suite, tmp_path / "there", jobs=2)
    query = "SELECT * FROM results ORDER BY case_id, metric"
    assert rows(made_up / "out", query) == rows(tmp_path / "there", query)
    assert not list((tmp_path / "there" / "logs").iterdir())


def test_a_run_killed_in_the_middle_is_resumed_and_nothing_is_done_twice(suite: Path, tmp_path: Path) -> None:
    code = (
        "import sys; sys.path.insert(0, sys.argv[3])\n"
        "from pathlib import Path\n"
        "from synthetic_cases import result_of\n"
        "from twin.suites.cache import RecordingCache\n"
        "from twin.suites.spec import load_suite\n"
        "from twin.suites.cluster import Workers\n"
        "from twin.suites.run import run_suite\n"
        "if __name__ == '__main__':\n"
        "    suite, path = load_suite(sys.argv[1])\n"
        "    run_suite(suite, path, Path(sys.argv[2]), RecordingCache(Path(sys.argv[2]) / 'c', 1), Workers(jobs=2), "
        "function=result_of)\n"
    )
    script = tmp_path / "run_it.py"
    script.write_text(code)
    folder = tmp_path / "out"
    arguments = [sys.executable, str(script), str(suite), str(folder), str(Path(__file__).parent)]
    process = subprocess.Popen(arguments, env={**os.environ, "SYNTHETIC_CASE_S": "0.3"}, stderr=subprocess.DEVNULL)
    done_before = 0
    while done_before < 3:
        assert process.poll() is None
        time.sleep(0.1)
        if (folder / "logs").exists():  # made when the file of results has its tables
            with read_store(folder) as store:
                done_before = sum(case.status == "done" for case in store.cases())
    with pytest.raises(InputError, match=r"^--out .*: process \d+ on .* is writing there"):
        run_made_up(suite, folder, resume=True)
    workers = psutil.Process(process.pid).children(recursive=True)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert len(workers) >= 2 and not psutil.wait_procs(workers, timeout=60)[1]  # they do not outlive it
    killed = dict(rows(folder, "SELECT case_id, seconds FROM cases WHERE status = 'done'"))
    assert done_before <= len(killed) < N_CASE
    with pytest.raises(InputError, match=r"holds the results of an earlier run; --resume"):
        run_made_up(suite, folder)
    run_made_up(suite, folder, resume=True)
    assert_whole(folder)
    after = dict(rows(folder, "SELECT case_id, seconds FROM cases"))
    assert {case_id: after[case_id] for case_id in killed} == killed


def test_a_disk_that_is_full_ends_the_run_and_what_was_done_stays(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    connected = result_files._connected

    @contextmanager
    def small_disk(path: Path):
        with connected(path) as connection:
            pages = connection.execute("PRAGMA page_count").fetchone()[0]
            connection.execute(f"PRAGMA max_page_count = {max(pages, 16) + 4}")
            yield connection

    folder = tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr(result_files, "_connected", small_disk)
        with pytest.raises(
            InputError, match=r"results.sqlite: cannot be written; .* \(database or disk is full\); --resume"
        ):
            run_made_up(suite, folder)
    done = rows(folder, "SELECT COUNT(*) FROM cases WHERE status = 'done'")[0][0]
    assert 0 < done < N_CASE
    run_made_up(suite, folder, resume=True)
    assert_whole(folder)


def test_results_of_two_suites_or_two_states_of_the_code_never_mix(
    made_up: Path, suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "out"
    shutil.copytree(made_up / "out", folder)
    run_made_up(suite, folder, resume=True)
    with pytest.raises(InputError, match=r"was run with --set \[\]; the same"):
        run_made_up(suite, folder, resume=True, changes=["duration_s=1"])
    with monkeypatch.context() as patch:
        patch.setattr(suite_run, "whole_code", lambda: "other")
        with pytest.raises(InputError, match=r"was made by other code, and results of two versions must not mix"):
            run_made_up(suite, folder, resume=True)
    suite.write_text(SUITE.replace("seeds: 4", "seeds: 3"))
    with pytest.raises(InputError, match=r"it has plain, seed 3, laser-imm, and 5 more cases besides; the suite as"):
        run_made_up(suite, folder, resume=True)
    suite.write_text(SUITE.replace("red, blue", "red, green"))
    lacks = r"it lacks shirts \(people.white.shirt=green\), seed 0, laser-imm, and 7 more cases and has shirts \(.*=blue\), "
    with pytest.raises(InputError, match=lacks):
        run_made_up(suite, folder, resume=True)
    suite.write_text(SUITE.replace("name: made-up", "name: other"))
    with pytest.raises(InputError, match=r"holds the suite 'made-up', not 'other'; the same"):
        run_made_up(suite, folder, resume=True)


def test_what_trackers_doubt_is_told_once_and_kept(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "out"
    _, told, _ = command(monkeypatch, "run", str(suite), "--jobs", "1", "--out", str(folder))
    warned = json.loads((folder / "summary.json").read_text())["tracker_warnings"]
    assert sum(warned.values()) == N_CASE and len(warned) == 2  # whatever the time in it
    assert any(re.fullmatch(r"laser-kalman: doubts everything from \d.5 s on", each) for each in warned)
    page = (folder / "report.html").read_text()
    for doubt, n_case in warned.items():
        assert told.count(doubt) == 1 and f"{doubt} ({n_case} case" in page


def test_a_suite_with_cameras_is_refused_where_nothing_renders_and_leaves_nothing(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each case failed, with exit code 1."""

    def renderer_of(scenario: Scenario) -> str:
        raise InputError("cannot render: no OpenGL")

    monkeypatch.setattr(suite_run, "renderer_of", renderer_of)
    with pytest.raises(InputError, match="cannot render"):
        run_made_up(suite, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_finished_case_whose_files_were_cut_or_lost_is_done_again(made_up: Path, tmp_path: Path) -> None:
    shutil.copytree(made_up, tmp_path / "copy")
    folder = tmp_path / "copy/out"
    cut, lost, *_ = pages = sorted((folder / "cases").glob("*/report.html"))
    before = [page.read_bytes() for page in pages]
    os.truncate(cut, 9)
    lost.unlink()
    said: list[str] = []
    run_made_up(tmp_path / "copy/made-up.yaml", folder, resume=True, progress=ProgressListener(warned=said.append))
    (line,) = said
    assert (
        line.startswith(f"--resume: 2 of {N_CASE} results are done again (") and "its files in cases/ changed" in line
    )
    assert_whole(folder)
    assert [page.read_bytes() for page in pages] == before


def test_what_a_case_has_left_goes_when_it_is_done_again_for_an_edited_scenario(suite: Path, tmp_path: Path) -> None:
    folder, scenario = tmp_path / "out", suite.with_name("own.yaml")
    scenario.write_text("extends: lab-five-people\nname: own\nduration_s: 2\n")
    suite.write_text(
        "name: own\nseeds: 2\ntrackers: [laser-kalman]\nreports: false\nscenarios: [{scenario: own.yaml}]\n"
    )
    run_made_up(suite, folder)
    with read_store(folder) as store:
        left = folder / "cases" / store.cases()[0].id
    left.mkdir(parents=True, exist_ok=True)
    (left / "worst.jpg").write_bytes(b"of the scenario as it was")
    said: list[str] = []
    scenario.write_text(scenario.read_text().replace("duration_s: 2", "duration_s: 3"))
    run_made_up(suite, folder, resume=True, progress=ProgressListener(warned=said.append))
    assert any("2 of 2 results are done again" in each and "scenario changed since" in each for each in said)
    with read_store(folder) as store:
        assert set(store.facts()["tracker_warnings"].values()) == {2}
    assert not (left / "worst.jpg").exists()
    suite.write_text(suite.read_text().replace("reports: false", "reports: true"))
    run_made_up(suite, folder, resume=True, progress=ProgressListener(warned=said.append))
    assert said[-1].startswith("--resume: 2 finished cases of 2 have no page, as reports was false; another folder")


def test_the_gate_passes_then_fails_and_says_where_to_look(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    baseline = "baseline.json"
    common = ["run", str(suite), "--jobs", "1", "--baseline", baseline]
    code, text, _ = command(monkeypatch, *common, "--out", str(tmp_path / "a"), "--update-baseline")
    assert code == 0 and "baseline.json" in text
    content = json.loads(Path(baseline).read_text())
    assert content["versions"]["mujoco"] and content["renderers"] == []
    held = [*content["groups"], *content["sensors"]]
    assert len(content["sensors"]) == 3 and all(
        set(each[digests]) == set(each["seeds"]) for each in held for digests in ("recordings", "recipes", "people")
    )
    code, text, _ = command(monkeypatch, *common, "--out", str(tmp_path / "b"))
    assert code == 0 and "every recording and metric has the same bits: 30 compared" in text
    assert text.splitlines()[-1] == f"passed against {baseline}: 0 of 30 metrics got worse"
    monkeypatch.setenv("SYNTHETIC_WORSE_M", "0.02")
    code, text, _ = command(monkeypatch, *common, "--out", str(tmp_path / "c"))
    assert code == 1 and "8 metrics got worse" in text and "+0.020 m" in text
    assert text.splitlines()[-1] == f"FAILED against {baseline}: 8 of 30 metrics got worse"
    found = re.search(r"see (\S+report.html) at ([\d.]+) s \(blue → white\)", text)
    assert found is not None and Path(found[1]).is_file()
    summary = json.loads((tmp_path / "c" / "summary.json").read_text())
    assert {row["metric"] for row in summary["comparison"]["worse"]} == {"motp_m"}
    assert summary["cases"] == {"total": N_CASE, "done": N_CASE, "failed": 0, "unfinished": 0}
    junit = ElementTree.parse(tmp_path / "c" / "junit.xml").getroot()
    assert [(each.get("tests"), each.get("failures"), each.get("errors")) for each in junit] == [
        (str(N_CASE), "0", "0"),
        ("13", "8", "0"),  # six groups, two trackers over all scenarios, all trackers, a scanner in three and over all
    ]
    assert junit.find(".//failure") is not None and "MOTP 0.0" in (junit.find(".//failure").text or "")
    page = (tmp_path / "c" / "report.html").read_text()
    assert (
        "8 of 30 metrics got worse" in page and f"against {baseline}" in page and "<svg" in page and "nan" not in page
    )
    assert "http://" not in page and "https://" not in page
    code, text, _ = command(monkeypatch, "show", str(tmp_path / "c"))
    assert code == 0 and "8 metrics got worse" in text
    code, text, _ = command(monkeypatch, "show", str(tmp_path / "c"), "--markdown")
    verdict, _, rest = text.partition("\n")
    assert code == 0 and verdict == f"made-up: **FAILED** against {baseline}: 8 of 30 metrics got worse."
    assert rest.index("**worse**") < rest.index("| scenario | tracker | seeds |")
    page = tmp_path / "compare.html"
    code, text, _ = command(monkeypatch, "compare", baseline, str(tmp_path / "c"), "--out", str(page))
    assert code == 1
    (link, *_) = re.findall(r'href="(c/cases/[^"]+/report.html)"', page.read_text())
    assert (tmp_path / link).is_file()
    code, text, _ = command(monkeypatch, "compare", str(tmp_path / "c"), str(tmp_path / "b"))
    assert code == 0 and "metrics got better" in text


@pytest.mark.parametrize("reports", ["true", "false"])
def test_links_of_a_page_lead_to_files_whether_cases_have_reports_or_not(
    reports: str, suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    suite.write_text(re.sub(r"^reports:.*\n", "", SUITE, flags=re.MULTILINE) + f"reports: {reports}\n")
    baseline, out = str(tmp_path / "baseline.json"), tmp_path / "now"
    common = ["run", str(suite), "--jobs", "1", "--baseline", baseline, "--out"]
    first = command(monkeypatch, *common, str(tmp_path / "before"), "--update-baseline")[1]
    assert first.splitlines()[-1] == f"passed: {N_CASE} cases done, 0 failed; wrote {baseline}"
    monkeypatch.setenv("SYNTHETIC_WORSE_M", "0.02")
    monkeypatch.chdir(tmp_path)
    text = command(monkeypatch, *common, str(out))[1]
    assert text.splitlines()[-1].startswith("FAILED against baseline.json: ")
    page = (out / "report.html").read_text()
    links = re.findall(r'href="(cases/[^"]+)"', page)
    assert links and all((out / link).is_file() for link in links)
    looks = re.findall(r"^see (\S+) at", text, re.MULTILINE)
    assert looks and all(look.endswith("report.html") == (reports == "true") for look in looks)
    assert len(set(looks)) == len(looks) and not any(Path(look).is_absolute() for look in looks)
    rows = re.findall(r'<tr><td class="where">(.*?)</td><td>(.*?)</td>.*<td class="see">(.*?)</td>', page)
    groups = {row[:2] for row in rows}
    assert {row[:2] for row in rows if row[2]} == groups and ("every scenario", "laser-imm") in groups


def test_a_scanner_that_got_noisier_fails_the_gate_though_no_tracker_did_and_what_was_kept_before_is_read(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    baseline, before, now = tmp_path / "baseline.json", tmp_path / "before", tmp_path / "now"
    common = ["run", str(suite), "--jobs", "1", "--baseline", str(baseline)]
    assert command(monkeypatch, *common, "--out", str(before), "--update-baseline")[0] == 0
    monkeypatch.setenv("SYNTHETIC_NOISE", "1.4")
    noisier = ["--set", "sensors.knee.noise.sigma_m=0.01"]
    code, text, _ = command(monkeypatch, *common, *noisier, "--out", str(now))
    assert code == 1 and "1 metric got worse" in text and "show the people of the baseline on the same ways" in text
    assert "Scatter of ranges" in text and "+0.0032 m" in text
    junit = (now / "junit.xml").read_text()
    assert junit.count("<failure") == 1 and "Scatter of ranges 0.0080 m → 0.0112 m" in junit
    assert (now / "report.html").read_text().count(
        "scanner at 0, 0, 0.95"
    ) == 1  # over all scenarios: each alone has too few seeds
    assert command(monkeypatch, "compare", str(before), str(now))[0] == 1
    # a file of before people and scanners were kept
    connection = sqlite3.connect(before / "results.sqlite")
    with connection:
        connection.executescript("DROP TABLE scanners; ALTER TABLE recordings DROP COLUMN people")
    connection.close()
    content = json.loads(baseline.read_text())
    del content["sensors"]
    for group in content["groups"]:
        del group["people"]
    baseline.write_text(json.dumps(content))
    for old in (baseline, before):
        code, text, _ = command(monkeypatch, "compare", str(old), str(now))
        assert code == 0 and "does not say on which ways its people went" in text and "nothing got worse" in text


def test_requirements_are_met_or_the_run_falls_short_whatever_the_baseline_says(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    required = "require: {laser-imm: {mota: '>= 0.915', misidentifications: '== 0.5', hota: '> 0.5'}}\n"
    suite.write_text(
        required + SUITE.replace("    name: plain\n", "    name: plain\n    require: {laser-imm: {hota: '> 0'}}\n")
    )
    code, text, _ = command(monkeypatch, "run", str(suite), "--jobs", "1", "--out", str(tmp_path / "a"))
    # MOTA .915 and half a misidentification are the very means; HOTA is not among the made-up figures
    assert code == 1 and "6 of 9 requirements met" in text
    assert "requirement not met: plain, laser-imm: HOTA is not measured, required > 0\n" in text
    assert (
        "requirement not met: shirts (people.white.shirt=red), laser-imm: HOTA is not measured, required > 0.5" in text
    )
    page = (tmp_path / "a" / "report.html").read_text()
    assert "6 of 9 requirements met" in page and "Requirements not met" in page
    junit = ElementTree.parse(tmp_path / "a" / "junit.xml").getroot()
    assert [(each.get("tests"), each.get("failures")) for each in junit][1:] == [("3", "3")]
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert [row["met"] for row in summary["requirements"]].count(False) == 3
    code, text, _ = command(monkeypatch, "show", str(tmp_path / "a"))
    assert "6 of 9 requirements met" in text
    assert text.splitlines()[-1] == "FAILED without a baseline: 6 of 9 requirements met"
    connection = sqlite3.connect(tmp_path / "a" / "results.sqlite")
    with connection:  # a file of version 0.1
        for former, name in FORMER_FACTS.items():
            connection.execute("UPDATE facts SET name = ? WHERE name = ?", (former, name))
    connection.close()
    assert "6 of 9 requirements met" in command(monkeypatch, "show", str(tmp_path / "a"))[1]
    suite.write_text(SUITE + "\nrequire: {laser-imm: {mota: '== 0.915'}, laser-kalman: {motp_m: '<= 0.07'}}\n")
    code, text, _ = command(monkeypatch, "run", str(suite), "--jobs", "1", "--out", str(tmp_path / "b"))
    assert code == 0 and "6 of 6 requirements met" in text and "requirement not met" not in text


@pytest.mark.parametrize(
    ("require", "said"),
    [
        (
            "{laser-im: {mota: 1}}",
            "require: 'laser-im' is none of the trackers; did you mean 'laser-imm'? valid are laser-imm, laser-kalman",
        ),
        ("{laser-imm: {moto: 1}}", "there is no metric 'moto'; did you mean 'mota'? valid are mota"),
        ("{laser-imm: {moto: 1}, laser-kalman: {moto: 1}}", "did you mean 'mota'? valid are the names above"),
        ("{laser-imm: {mota: about 1}}", 'a whole number, or a bound as in ">= 0.97", is expected'),
        ("{laser-imm: {mota: '>= 1.5'}}", "laser-imm: mota: '>= 1.5' is outside its range; a bound within -inf to 1"),
        ("{laser-imm: {idf1: '> 1'}}", "idf1: '> 1' is outside its range; a bound within 0 to 1"),
        ("{laser-imm: {at_1m.hota: '>= 90'}}", "at_1m.hota: '>= 90' is outside its range; a bound within 0 to 1"),
        ("{laser-imm: {id_switches: '< 0'}}", "id_switches: '< 0' is outside its range; a bound within 0 to inf"),
        ("{laser-imm: {misses: -3}}", "misses: '== -3' is outside its range; a bound within 0 to inf"),
        ("{laser-imm: [mota]}", 'a mapping of metrics, as in {mota: ">= 0.97"}, is expected'),
        ("[laser-imm]", "a mapping of trackers, as in {sort:"),
    ],
)
def test_a_requirement_that_cannot_be_is_told(suite: Path, require: str, said: str) -> None:
    suite.write_text(SUITE + f"\nrequire: {require}\n")
    with pytest.raises(InputError) as told:
        load_suite(suite)
    assert said in str(told.value) and "require" in str(told.value)


def test_without_reports_the_page_leads_to_the_metrics_of_the_cases(suite: Path, tmp_path: Path) -> None:
    suite.write_text(suite.read_text() + "\nreports: false\n")
    run_made_up(suite, folder := tmp_path / "out")
    assert not list((folder / "cases").glob("*/report.html"))
    with read_store(folder) as store:
        write_page(folder / "report.html", SuiteOutcome.of(folder, store))
    links = re.findall(r'href="(cases/[^"]+)"', (folder / "report.html").read_text())
    assert len(links) == N_CASE and all((folder / link).is_file() for link in links)


def test_a_baseline_that_nothing_can_be_compared_with_does_not_pass(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    baseline = tmp_path / "baseline.json"
    suite.write_text(SUITE.replace("seeds: 4", "seeds: [0, 1]"))
    common = ["run", str(suite), "--jobs", "1", "--baseline", str(baseline)]
    assert command(monkeypatch, *common, "--out", str(tmp_path / "a"), "--update-baseline")[0] == 0
    suite.write_text(SUITE.replace("seeds: 4", "seeds: [2, 3]"))
    code, _, error = command(monkeypatch, *common, "--out", str(tmp_path / "b"))
    assert code and isinstance(error, InputError) and "nothing could be compared; the same scenarios" in str(error)
    assert not (tmp_path / "b").exists()  # before the first case
    assert command(monkeypatch, *common[:-2], "--out", str(tmp_path / "b"))[0] == 0
    for was in (baseline, tmp_path / "a"):
        code, text, error = command(
            monkeypatch, "compare", str(was), str(tmp_path / "b"), "--out", str(tmp_path / "no.html")
        )
        assert code and isinstance(error, InputError) and "nothing could be compared" in str(error)
        assert "nothing got worse" not in text and not (tmp_path / "no.html").exists()
    held = baseline.read_bytes()
    suite.write_text(SUITE.replace("name: made-up", "name: another"))
    for more in ([], ["--update-baseline"]):
        code, _, error = command(monkeypatch, *common, "--out", str(tmp_path / "c"), *more)
        assert code and isinstance(error, InputError)
        assert "is of the suite 'made-up'; one of 'another' is expected" in str(error)
    assert baseline.read_bytes() == held and not (tmp_path / "c").exists()


def test_results_go_into_a_folder(suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    code, _, error = command(monkeypatch, "run", str(suite), "--jobs", "1", "--out", str(tmp_path / "file"))
    assert code and isinstance(error, InputError) and "a folder is expected" in str(error)


def test_a_case_that_fails_is_exit_1_in_every_report_and_the_rest_is_there(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SYNTHETIC_FAULT", "raise")
    folder, baseline = tmp_path / "out", tmp_path / "baseline.json"
    arguments = ["run", str(suite), "--jobs", "1", "--out", str(folder)]
    code, text, error = command(monkeypatch, *arguments, "--baseline", str(baseline), "--update-baseline")
    assert code == 1 and error is None and not baseline.exists()
    assert rows(folder, "SELECT status, COUNT(*) FROM cases GROUP BY status") == [("done", 12), ("failed", 12)]
    for (error,) in rows(folder, "SELECT error FROM cases WHERE error IS NOT NULL"):
        assert error.startswith("RuntimeError: nothing works today\nTraceback (most recent call last):")
    assert (
        text.count(": RuntimeError: nothing works today") == 24 and "Traceback" not in text
    )  # as it comes, and at the end
    assert text.count("failed after 1 attempt: ") == 12
    junit = ElementTree.parse(folder / "junit.xml").getroot()
    assert {each.get("message") for each in junit.findall(".//error")} == {"RuntimeError: nothing works today"}
    assert junit[0].get("errors") == "12" and "nothing works today" in (junit.findall(".//error")[0].text or "")
    assert "What failed" in (folder / "report.html").read_text()
    monkeypatch.delenv("SYNTHETIC_FAULT")
    code, _, _ = command(monkeypatch, *arguments, "--resume")
    assert code == 0
    assert_whole(folder)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "no-such"], r"^there is no suite 'no-such'; .*valid are .*smoke"),
        (["run", "smoke", "--jobs", "2", "--scheduler", "tcp://x:1"], r"^--jobs 2 --scheduler tcp://x:1: "),
        (["run", "smoke", "--scheduler", "nonsense"], r"^--scheduler nonsense: is no address; .*tcp://host:8786"),
        (
            ["run", "smoke", "--scheduler", "tcp://nobody.invalid:1"],
            r"^--scheduler tcp://nobody.invalid:1: nobody answers",
        ),
        (
            ["run", "smoke", "--baseline", "/dev/null/b.json", "--update-baseline"],
            r"^/dev/null/b.json: cannot be written \(Not a directory\)",
        ),
        (["run", "smoke", "--update-baseline"], r"^--update-baseline: .*--baseline FILE is expected"),
        (["run", "smoke", "--baseline", "none.json"], r"^none.json: cannot be read \(No such file"),
        (["run", "smoke", "--set", "durations=3"], r"durations: unknown key; did you mean 'duration_s'"),
        (["show", "nowhere"], r"^nowhere: has no results.sqlite; a folder that `twin suite run` has written"),
        (["compare", "nowhere", "here"], r"^nowhere: has no results.sqlite"),
    ],
)
def test_bad_input_is_told_in_one_sentence(
    arguments: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    _, _, error = command(monkeypatch, *arguments)
    assert isinstance(error, InputError) and re.search(said, str(error)), error
    assert not (tmp_path / "out").exists()


def test_files_that_are_no_baseline_and_no_results_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bad = tmp_path / "bad.json"
    for text, said in (
        ("{", r"bad.json, line 1: is not JSON"),
        *(
            (junk, r"^\S+bad.json: is no baseline, as it has no groups; [^\n]+$")
            for junk in ("{}", "[]", "3", '{"a": 1}')
        ),
        (
            '{"suite": "a", "cases": {}, "groups": []}',
            r"^\S+bad.json: is the summary of a run, and no baseline; [^\n]+$",
        ),
        ('{"suite": 1, "groups": []}', r"bad.json: suite: .*\n.*bad.json: versions"),
        (
            '{"suite": "a", "versions": {}, "groups": [{"scenario": "b", "variant": "", "tracker": "sort", "seeds": {}, '
            '"overrides": "[x"}]}',
            r"bad.json: groups.0.overrides: .*JSON",
        ),
    ):
        bad.write_text(text)
        _, _, error = command(monkeypatch, "compare", str(bad), str(bad))
        assert isinstance(error, InputError) and re.search(said, str(error)), error
    (tmp_path / "results.sqlite").write_text("no database at all, but long enough to be looked at" * 20)
    _, _, error = command(monkeypatch, "show", str(tmp_path))
    assert isinstance(error, InputError) and "is no file of results" in str(error)


@pytest.mark.parametrize(
    ("statement", "said"),
    [
        ("DELETE FROM facts WHERE name = 'versions'", "facts: versions: Field required"),
        ("UPDATE facts SET value = '' WHERE name = 'suite'", "facts.suite, line 1: is not JSON"),
        ("UPDATE facts SET value = '[1]' WHERE name = 'tolerances'", "facts: tolerances: .*dictionary"),
        ("UPDATE cases SET status = 'well' WHERE rowid = 1", r"cases: 0.status: .* \(got 'well'\)"),
        ("UPDATE definitions SET overrides = '{' WHERE rowid = 1", "cases: 0.overrides: Invalid JSON"),
        ("UPDATE results SET value = 'much' WHERE rowid = 1", "results: .*mota: .*number"),
        ("DELETE FROM results", "results: of .*, which is done, there are none"),
        ("DROP TABLE cases", "is no file of results .no such table: cases"),
    ],
)
def test_results_that_were_spoiled_are_told_in_one_sentence(
    statement: str, said: str, made_up: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(made_up / "out", tmp_path / "out")
    rows(tmp_path / "out", statement)
    for arguments in (("show", str(tmp_path / "out")), ("compare", str(tmp_path / "out"), str(tmp_path / "out"))):
        _, _, error = command(monkeypatch, *arguments)
        assert isinstance(error, InputError) and re.search(f"results.sqlite: {said}", str(error)), error
        assert "\n" not in str(error)


@pytest.mark.parametrize("statement", ["DROP TABLE moments", "DROP TABLE cases"])
def test_a_run_is_not_taken_up_in_a_spoiled_file(statement: str, made_up: Path, tmp_path: Path) -> None:
    shutil.copytree(made_up / "out", tmp_path / "out")
    rows(tmp_path / "out", statement)
    with pytest.raises(InputError, match="is no file of results"):
        run_made_up(made_up / "made-up.yaml", tmp_path / "out", resume=True)


@pytest.mark.parametrize("table", [None, "moments", "results"])
def test_a_run_is_not_taken_up_in_a_damaged_file(table: str | None, made_up: Path, tmp_path: Path) -> None:
    """Cut, or with a page of a table overwritten."""
    shutil.copytree(made_up / "out", tmp_path / "out")
    path = tmp_path / "out" / "results.sqlite"
    content = bytearray(path.read_bytes())
    if table is None:
        del content[5000:]
    else:
        ((page, size),) = rows(
            tmp_path / "out",
            f"SELECT rootpage, page_size FROM sqlite_master, pragma_page_size WHERE name = '{table}'",
        )
        content[(page - 1) * size : page * size] = bytes([255]) * size
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"results.sqlite: is (no file of results|damaged)"):
        run_made_up(made_up / "made-up.yaml", tmp_path / "out", resume=True)


def test_the_cache_command_says_how_much_and_empties(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entry = tmp_path / "cache" / "recordings" / "0123"
    entry.mkdir(parents=True)
    (entry / "recording.mcap").write_bytes(b"x" * 5_000_000)
    code, text, _ = command(monkeypatch, "cache")
    assert code == 0 and "1 recordings, 0.01 GB of at most 20 GB" in text
    code, text, _ = command(monkeypatch, "cache", "--empty")
    assert code == 0 and "1 recordings removed" in text and not entry.exists()
    monkeypatch.setenv("ROOMTWIN_CACHE_GB", "plenty")
    _, _, error = command(monkeypatch, "cache")
    assert isinstance(error, InputError) and str(error).startswith("ROOMTWIN_CACHE_GB=plenty: is no size")
