"""Bags as cases of a suite: with the truth in the bag, in a table, and without; requirements, baseline, changed files."""

from __future__ import annotations

import json
import shutil
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from trackers.errors import InputError
from trackers.rig import Rig
from twin.cli import app
from twin.recording.bags.bag import open_bag
from twin.recording.bags.bag_files import McapFile
from twin.recording.reader import Recording
from twin.run.inputs import TrustedClasses
from twin.run.live import run_scenario
from twin.scenario import load_scenario
from twin.suites.cache_keys import Provenance, bags_of
from twin.suites.expansion import Case, expand
from twin.suites.run import _idle_of_command, idle_settings
from twin.suites.spec import load_suite


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a short bag of the lab's scanners, its truth as a table, and the same bag without truth and rig."""
    folder = tmp_path_factory.mktemp("bags")
    scenario = load_scenario("lab-five-people", ["duration_s=3"])
    run_scenario(scenario, trackers=[], out=folder / "lab", video=False, images=False)
    shutil.copy(folder / "lab/truth.csv", folder / "truth.csv")
    (folder / "rig.yaml").write_text(Recording(folder / "lab/recording.mcap").rig.dump_yaml())
    with open_bag(folder / "lab/recording.mcap") as original, McapFile(folder / "bare.mcap") as bag:
        kept = [each for each in original.connections if each.topic in ("/waist/scan", "/knee/scan")]
        copies = {each.id: bag.connect_as(each) for each in kept}
        for connection, log_time_ns, data in original.raw_messages(kept):
            bag.write_on(copies[connection.id], log_time_ns, data)
    return folder


def _suite(folder: Path, *entries: str, more: str = "") -> Path:
    path = folder / "gate.yaml"
    lines = "".join(f"  - {{{entry}}}\n" for entry in entries)
    path.write_text(f"name: gate\ntrackers: [sort]\nreports: false\n{more}recordings:\n{lines}")
    return path


def _run(suite: Path, out: Path, *options: str):
    return CliRunner().invoke(app, ["suite", "run", str(suite), "--out", str(out), "--jobs", "1", *options])


def test_warnings_name_no_folder_of_a_case_that_is_gone(bags: Path, tmp_path: Path) -> None:
    head, *rows = (bags / "truth.csv").read_text().splitlines()
    apart = [f"{t},{id_},{float(x) + 9},{rest}" for t, id_, x, rest in (row.split(",", 3) for row in rows)]
    (tmp_path / "moved.csv").write_text("\n".join([head, *apart]))
    told = _run(_suite(bags, f"recording: lab/recording.mcap, truth: {tmp_path}/moved.csv"), tmp_path / "out").output
    assert "tracks/sort.csv: " in told and "roomtwin-case" not in told
    assert "roomtwin-case" not in (tmp_path / "out/summary.json").read_text()


def test_truth_of_the_bag_and_of_a_table_give_the_same_and_none_gives_counts(bags: Path, tmp_path: Path) -> None:
    topics = set(Recording(bags / "lab/recording.mcap").topics)
    assert {"/waist/scan", "/room/markers"} <= topics
    for name in ("bare", "again"):
        shutil.copy(bags / "bare.mcap", tmp_path / f"{name}.mcap")
    suite = _suite(
        bags,
        "recording: lab/recording.mcap",
        "recording: lab/recording.mcap, name: table, truth: truth.csv",
        f'recording: "{tmp_path}/*.mcap", '
        'rig: rig.yaml, require: {sort: {track_count: "<= 9", tracks_per_frame: ">= 1"}}',
    )
    done = _run(suite, tmp_path / "out", "--baseline", str(tmp_path / "base.json"), "--update-baseline")
    assert done.exit_code == 0, done.output
    assert " people" not in done.output  # which a bag does not tell
    rows = {
        row["scenario"]: row["metrics"] for row in json.loads((tmp_path / "out/summary.json").read_text())["groups"]
    }
    assert set(rows) == {"lab", "table", "bare", "again"} and "planned: 4 cases\n" in done.output
    assert rows["lab"]["mota"]["mean"] > 0.5
    assert rows["lab"]["mota"] == rows["table"]["mota"]
    assert rows["bare"].get("mota", {"mean": None})["mean"] is None
    assert "4 of 4 requirements met" in done.output and "Tracks" in done.output
    page = (tmp_path / "out/report.html").read_text()
    assert page.count(">Tracks per frame</b>") == 2 and page.count(">MOTA</b>") == 2  # each bag shows what it has
    again = _run(suite, tmp_path / "again", "--baseline", str(tmp_path / "base.json"))
    assert again.exit_code == 0, again.output


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("*/walk.mcap", ["b-walk", "walk[1]-walk"]),
        ("**/*.mcap", ["b-walk", "other", "walk[1]", "walk[1]-walk"]),
        ("walk[[]1].mcap", ["walk[1]"]),
        ("walk[1].mcap", ["walk[1]"]),
        ("day.0*", ["day.01", "day.02"]),
        ("*/recording.mcap", ["one", "two"]),
    ],
)
@pytest.mark.parametrize("is_absolute", [False, True])
def test_a_pattern_names_each_bag(tmp_path: Path, pattern: str, names: list[str], is_absolute: bool) -> None:
    folder = tmp_path / "a"
    bags = ["b/walk.mcap", "walk[1]/walk.mcap", "walk[1].mcap", "c/other.mcap"] if "recording" not in pattern else []
    for bag in [*bags, "one/recording.mcap", "two/recording.mcap"][: len(bags) or 2]:
        (folder / bag).parent.mkdir(parents=True, exist_ok=True)
        (folder / bag).touch()
    for bag in ("day.01", "day.02"):
        (folder / bag).mkdir()
    assert sorted(bags_of(folder, str(folder / pattern) if is_absolute else pattern).values()) == names


def test_requirement_that_is_not_met_fails(bags: Path, tmp_path: Path) -> None:
    suite = _suite(bags, 'recording: bare.mcap, rig: rig.yaml, require: {sort: {track_count: "<= 0"}}')
    done = _run(suite, tmp_path / "out")
    assert done.exit_code == 1
    assert "0 of 1 requirements met" in done.output


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("recording: nothing*.mcap", "no bag is"),
        ("recording: lab/recording.mcap, truth: gone.csv", "gone.csv"),
        ("recording: rig.yaml", "rig.yaml"),
        ("recording: bare.mcap, rig: rig.yaml, trackers: [sorts]", "there is no tracker 'sorts'"),
        ("recording: lab/recording.mcap, trackers: [rgbd-head]", "cannot work on lab"),
        ("recording: lab/recording.mcap, set: {trackers.sort.foo: 5}", "0.set.trackers.sort.foo: unknown key"),
        ("recording: lab/recording.mcap, set: {trackers: {sort: {gate: far}}}", "0.set.trackers.sort.gate"),
        (
            "recording: lab/recording.mcap, set: {trackers.sorts.gate: 5}",
            "set.trackers.sorts.gate: there is no tracker",
        ),
        (
            'recording: bare.mcap, rig: rig.yaml, require: {sort: {track_count: 1, mota: "> 0"}}',
            "0: require.sort.mota: is not measured without truth, which bare.mcap has not",
        ),
        ("recording: lab/recording.mcap, set: {duration_s: 5}", "set.duration_s: changes nothing of a recording"),
        ("recording: lab/recording.mcap, set: {prior.learned.a: gone.npz}", "gone.npz"),
        (
            "recording: lab/recording.mcap, trackers: [own], set: {trackers.own.preset: 'os:system'}",
            "0.set.trackers.own.preset: 'os:system' is a class, and a file names no code",
        ),
        (
            "recording: lab/recording.mcap, set: {trackers.sort.scheduler: 'tcp://there:1'}",
            "0.set.trackers.sort.scheduler: 'tcp://there:1' is a Dask scheduler",
        ),
    ],
)
def test_what_cannot_be_tracked_is_refused_before_anything_runs(bags: Path, entry: str, said: str) -> None:
    suite, path = load_suite(_suite(bags, entry))
    with pytest.raises(InputError) as refused:
        expand(suite, path)
    assert said in str(refused.value)
    assert "recordings.0" in str(refused.value)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("set: {trackers.sort.foo: 5}\n", "set.trackers.sort.foo: unknown key"),
        ("set: {people.a: null}\n", "set.people.a: changes nothing of a recording"),
        ("seeds: 3\n", "seeds: changes nothing, as every case is a recording"),
    ],
)
def test_a_key_of_the_suite_has_an_effect_on_its_recordings_or_is_refused(bags: Path, more: str, said: str) -> None:
    done = CliRunner().invoke(app, ["check", str(_suite(bags, "recording: lab/recording.mcap", more=more))])
    assert done.exit_code == 2 or isinstance(done.exception, InputError)
    assert said in str(done.exception)


def test_settings_of_trackers_stand_in_the_suite_and_make_other_cases(bags: Path, tmp_path: Path) -> None:
    """Settings have the effect of `--set`, are part of what a case is made from, and are known by a baseline."""
    entry, base = f"recording: {bags / 'lab/recording.mcap'}", str(tmp_path / "base.json")
    changed = "trackers.sort: {radius_m: 0.01}"

    def cases_of(*entries: str, more: str = "", changes: tuple[str, ...] = ()) -> list[Case]:
        suite, path = load_suite(_suite(tmp_path, *entries, more=more))
        return expand(suite, path, changes)

    (plain,) = cases_of(entry)
    (by_suite,) = cases_of(entry, more=f"set: {{{changed}}}\n")
    (by_entry,) = cases_of(f"{entry}, set: {{{changed}}}", more="set: {trackers.sort.radius_m: 2}\n")
    (typed,) = cases_of(entry, changes=(f"trackers.sort={changed.partition(': ')[2]}",))
    (named,) = cases_of(f"{entry}, trackers: [late], set: {{trackers.late: {{preset: sort, radius_m: 0.01}}}}")
    assert plain.overrides == () and by_suite.overrides == ('trackers.sort={"radius_m": 0.01}',)
    assert by_suite.provenance.changed(plain.provenance) == ["tracker"]
    assert by_suite.provenance == typed.provenance == by_entry.provenance == named.provenance
    assert len({each.id for each in (plain, by_suite, by_entry, named)}) == 4 and typed.id == plain.id

    made = _run(_suite(tmp_path, entry), tmp_path / "a", "--baseline", base, "--update-baseline")
    assert made.exit_code == 0, made.output
    other = _run(_suite(tmp_path, f"{entry}, set: {{{changed}}}"), tmp_path / "b")
    assert other.exit_code == 0, other.output
    rows = [json.loads((tmp_path / f"{out}/summary.json").read_text())["groups"][0] for out in "ab"]
    assert rows[1]["metrics"]["misses"]["mean"] > rows[0]["metrics"]["misses"]["mean"]
    again = _run(_suite(tmp_path, entry, more=f"set: {{{changed}}}\n"), tmp_path / "c", "--baseline", base)
    assert "nothing could be compared" in str(again.exception)


def test_a_number_added_to_each_seed_is_added_to_those_of_recordings(bags: Path) -> None:
    suite, _ = load_suite(_suite(bags, "recording: lab/recording.mcap, seeds: [3, 5]"))
    assert suite.with_seed_offset(1000).recordings[0].seeds == (1003, 1005)


def test_a_setting_of_the_suite_that_nothing_follows_is_told(bags: Path) -> None:
    more = "set: {duration_s: 3, trackers.laser-imm.coast_s: 1}\nscenarios: [{scenario: lab-five-people}]\n"
    suite, _ = load_suite(_suite(bags, "recording: bare.mcap, set: {trackers.laser-legs: {}}", more=more))
    assert idle_settings(suite) == [
        "set.trackers.laser-imm: changes nothing, as laser-imm is not run, but sort",
        "recordings.0.set.trackers.laser-legs: changes nothing, as laser-legs is not run, but sort",
        "set.duration_s: changes the scenarios alone; recordings are tracked as they are",
    ]


def test_case_is_another_one_once_its_bag_has_changed(bags: Path, tmp_path: Path) -> None:
    shutil.copy(bags / "bare.mcap", tmp_path / "own.mcap")
    suite, path = load_suite(_suite(tmp_path, "recording: own.mcap, rig: " + str(bags / "rig.yaml")))
    (before,) = expand(suite, path)
    before.check_files()
    shutil.copy(bags / "lab/recording.mcap", tmp_path / "own.mcap")
    (after,) = expand(suite, path)
    assert after.id == before.id
    assert after.provenance.changed(before.provenance) == ["scenario"]
    with pytest.raises(InputError, match="changed after the suite was started"):
        before.check_files()


def test_case_of_a_bag_is_another_one_once_its_tracker_or_its_prior_files_have_changed(
    bags: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Results of a resumed run must belong to the class and the files as they are now."""
    own, learned = tmp_path / "own_sort.py", tmp_path / "learned.npz"
    text = "from trackers.sort import Sort\n\n\nclass Mine(Sort):\n    pass\n"
    own.write_text(text)
    learned.write_bytes(b"one")
    monkeypatch.syspath_prepend(tmp_path)
    suite, path = load_suite(_suite(tmp_path, f"recording: {bags / 'lab/recording.mcap'}, trackers: ['own_sort:Mine']"))

    def made_from() -> Provenance:
        (case,) = expand(suite, path, [f"prior.learned.mine={learned}"], trusted=TrustedClasses(every=True))
        case.check_files()
        return case.provenance

    before = made_from()
    own.write_text(text + "    # edited\n")
    assert made_from().changed(before) == ["tracker"]
    learned.write_bytes(b"two")
    assert made_from().changed(before) == ["tracker", "prior"]


def test_suite_of_nothing_is_refused(tmp_path: Path) -> None:
    (tmp_path / "none.yaml").write_text("name: none\ntrackers: [sort]\n")
    with pytest.raises(InputError, match="a list of scenarios, or recordings, is expected"):
        load_suite(tmp_path / "none.yaml")


def test_what_a_bag_has_lost_is_told_once_and_what_a_tracker_leaves_out_not_at_all(bags: Path, tmp_path: Path) -> None:
    rig = Rig.load(bags / "rig.yaml")
    low_alone = rig.model_copy(update={"sensors": {"knee": rig.sensors["knee"]}})
    (tmp_path / "rig.yaml").write_text(low_alone.dump_yaml())
    entry = f"recording: {bags / 'bare.mcap'}, rig: {tmp_path / 'rig.yaml'}, trackers: [sort, laser-imm]"
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")
        done = _run(_suite(tmp_path, entry), tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert not [each for each in shown if each.category is UserWarning]
    assert done.stderr.count("does not use /waist/scan") == 1


@pytest.mark.parametrize(("bag", "n"), [(True, 2), (False, 1)])
def test_a_set_that_no_case_follows_is_told(bag: bool, n: int) -> None:
    cases: Any = [SimpleNamespace(tracker="sort", bag=bag or None)]
    said = _idle_of_command(["duration_s=1", "prior.environment=room.npz", "trackers.laser-imm.coast_s=1"], cases)
    assert len(said) == n and "laser-imm is not run, but sort" in said[0]
    assert said[1:] == ["--set duration_s=1: changes nothing, as every case is a recording"] * (n - 1)
