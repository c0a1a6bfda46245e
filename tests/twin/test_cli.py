"""The command line as a user types it: exit codes, one sentence on stderr, nothing half-written."""

from __future__ import annotations

import csv
import errno
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import get_args, get_type_hints

import pytest
from command_line import twin

from trackers.errors import InputError
from trackers.user_input.former_options import members_of
from twin import cli
from twin.command_options import WrongNumber
from twin.commands.memory import describe_lack
from twin.recording.bags import bag_files
from twin.recording.tables import read_truth
from twin.scenario import load_scenario

pytestmark = pytest.mark.slow

TWIN = [sys.executable, "-m", "twin"]
QUICK = ["--duration", "0.5", "--no-images", "--no-video"]
HEEDING = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
"""A job in the background is started with interrupts ignored, and would pass that on to what it starts."""


def refused(done: subprocess.CompletedProcess[str], *said: str) -> None:
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
    for words in said:  # typer's versions write names of arguments in capitals or not
        assert words.lower() in done.stderr.lower()


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "out"
    done = twin("run", "lab-five-people", *QUICK, "--tracker", "laser-imm", "--out", folder)
    assert done.returncode == 0, done.stderr
    return folder


def test_help_of_every_command_has_an_example() -> None:
    commands = ("run", "render", "track", "evaluate", "list", "schema", "check", "view", "reproduce")
    overview = twin("--help")
    assert overview.returncode == 0
    for command in commands:
        assert command in overview.stdout
        text = twin(command, "--help").stdout
        assert "Example: twin" in text
        assert not text.rstrip().endswith(f"; twin {command}")  # reads as cut off


def test_list_names_what_there_is() -> None:
    text = twin("list").stdout
    for name in ("lab-five-people", "lab", "laser-fisheye-imm", "laser-kalman", "fisheye"):
        assert name in text


def test_schema_is_json_schema() -> None:
    schema = json.loads(twin("schema").stdout)
    assert {"room", "people", "sensors", "duration_s"} <= set(schema["properties"])
    assert "sensors" in json.loads(twin("schema", "rig").stdout)["properties"]
    suite = json.loads(twin("schema", "suite").stdout)
    assert {"scenarios", "seeds", "trackers", "tolerances"} <= set(suite["properties"])
    either = suite["$defs"]["SuiteScenario"]["properties"]["seeds"][
        "anyOf"
    ]  # `seeds: 3`, a list, a range, or the suite's
    assert [each.get("type", each.get("$ref")) for each in either] == ["integer", "array", "#/$defs/SeedRange", "null"]
    refused(twin("schema", "robot"), "'robot'", "scenario, suite, study, rig")


def test_check_names_the_renderer() -> None:
    done = twin("check")
    assert done.returncode == 0
    for words in ("renderer", "mujoco", "frame time"):
        assert words in done.stdout


def test_run_leaves_what_the_contract_says(run_folder: Path) -> None:
    files = [path for path in run_folder.rglob("*") if path.is_file() and not path.name.startswith(".")]
    names = {path.relative_to(run_folder).as_posix() for path in files}
    assert names == {
        "recording.mcap", "truth.csv", "truth_people.csv", "truth_feet.csv", "truth_boxes.csv", "truth_rays.csv",
        "truth_situations.csv",
        "tracks/laser-imm.csv", "metrics.json", "report.html", "scenario.yaml",
    }  # fmt: skip
    metrics = json.loads((run_folder / "metrics.json").read_text())
    assert set(metrics) == {
        "scenario", "seed", "duration_s", "versions", "realtime_factor", "sensors", "losses", "start_stamp_ns",
        "trackers",
    }  # fmt: skip
    assert set(metrics["trackers"]["laser-imm"]) == {
        "mota", "motp_m", "idf1", "hota", "hota_cap", "deta", "assa", "gospa_m", "ospa_m", "id_switches", "false_positives",
        "misses", "misidentifications", "lost_tracks",
        "errors", "accuracy", "failures", "disposal", "head_error_m", "head_yaw_error_rad",
        "head_yaw_median_rad", "body_height_error_m", "right_at_end", "within_radius", "gate_m", "at_1m", "judged",
        "ms_per_frame",
    }  # fmt: skip


def test_the_ids_of_the_truth_have_names(run_folder: Path) -> None:
    with (run_folder / "truth_people.csv").open(encoding="utf-8", newline="") as stream:
        names = {int(row["id"]): row["name"] for row in csv.DictReader(stream)}
    assert list(names.values()) == list(load_scenario(run_folder / "scenario.yaml").people)
    assert set(read_truth(run_folder / "truth.csv").id.tolist()) <= set(names)


def test_the_resolved_scenario_runs_again_to_the_same_bits(run_folder: Path, tmp_path: Path) -> None:
    done = twin(
        "run", run_folder / "scenario.yaml", "--no-images", "--no-video", "--tracker", "laser-imm", "--out", tmp_path
    )
    assert done.returncode == 0, done.stderr
    for name in ("truth.csv", "tracks/laser-imm.csv"):
        assert (tmp_path / name).read_bytes() == (run_folder / name).read_bytes()


def test_track_on_the_recording_gives_the_same_tracks_to_the_bit(run_folder: Path, tmp_path: Path) -> None:
    done = twin("track", run_folder / "recording.mcap", "--tracker", "laser-imm", "--out", tmp_path, "--no-video")
    assert done.returncode == 0, done.stderr
    tracks = "tracks/laser-imm.csv"
    assert (tmp_path / tracks).read_bytes() == (run_folder / tracks).read_bytes()
    again = json.loads((tmp_path / "metrics.json").read_text())["trackers"]["laser-imm"]
    first = json.loads((run_folder / "metrics.json").read_text())["trackers"]["laser-imm"]
    del again["ms_per_frame"], first["ms_per_frame"]
    assert again == first


def test_evaluate_prints_the_same_figures(run_folder: Path) -> None:
    situations = ["--situations", run_folder / "truth_situations.csv"]
    done = twin("evaluate", run_folder / "truth.csv", run_folder / "tracks/laser-imm.csv", *situations)
    figures = json.loads(done.stdout)
    stored = json.loads((run_folder / "metrics.json").read_text())["trackers"]["laser-imm"]
    assert figures == {name: value for name, value in stored.items() if name != "ms_per_frame"}


def test_tracker_options_can_be_set(run_folder: Path, tmp_path: Path) -> None:
    recording = run_folder / "recording.mcap"
    arguments = ["--tracker", "laser-imm", "--no-video", "--out", tmp_path]
    done = twin("track", recording, *arguments, "--set", "trackers.laser-imm.filter=kalman")
    assert done.returncode == 0, done.stderr
    refused(twin("track", recording, *arguments, "--set", "trackers.laser-imm.filtre=kalman"), "filtre", "filter")


def test_a_second_run_leaves_nothing_of_the_first(tmp_path: Path) -> None:
    for tracker in ("laser-imm", "laser-kalman"):
        assert twin("run", "lab-five-people", *QUICK, "--tracker", tracker, "--out", tmp_path).returncode == 0
    assert [path.name for path in (tmp_path / "tracks").iterdir()] == ["laser-kalman.csv"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "nowhere"], ["no scenario 'nowhere'", "lab-five-people"]),
        (["run", "lab-five-people", "--set", "room=labb"], ["'labb'", "lab"]),
        (["run", "lab-five-people", "--tracker", "laser-im", *QUICK], ["'laser-im'", "laser-imm"]),
        (["run", "lab-five-people", "--tracker", "no.such:Thing", *QUICK], ["no.such"]),
        (["run", "lab-five-people", "--set", "sensors.waist.kind=sonar"], ["sensors.waist", "sonar", "laser"]),
        (["run", "lab-five-people", "--set", "sensors.waist.rate_hz=-10"], ["sensors.waist.rate_hz", "-10"]),
        (["run", "lab-five-people", "--set", "people.white.start=[9, 9]"], ["people.white.start", "outside"]),
        (["run", "lab-five-people", "--set", "sensors.knee.mount.xyz=[0, 4.5, 1]"], ["sensors.knee", "inside"]),
        (["run", "lab-five-people", "--duration", "-1"], ["duration_s"]),
        (["run", "lab-five-people", "--sed", "1"], ["--sed", "`twin run --help` lists the valid ones"]),
        (["run", "lab-five-people", "--seed", "one"], ["--seed", "whole number"]),
        (["run"], ["scenario"]),
        (["rum"], ["rum"]),
        (["view", "lab-five-people", "--at", "99"], ["--at 99", "26.2"]),
        (["track", "missing.bag"], ["missing.bag", "does not exist"]),
        (["evaluate", "missing.csv", "missing.csv"], ["missing.csv"]),
    ],
    ids=lambda value: " ".join(map(str, value))[-40:] if isinstance(value, list) else "",
)
def test_bad_input_is_one_sentence_and_exit_code_2(arguments: list[str], said: list[str], tmp_path: Path) -> None:
    refused(twin(*arguments, cwd=tmp_path), *said)
    assert not list(tmp_path.rglob("*"))


def test_bad_tables_and_bags(run_folder: Path, tmp_path: Path) -> None:
    truth = (run_folder / "truth.csv").read_text().splitlines()
    doubled = tmp_path / "doubled.csv"
    other = truth[2].split(",")
    other[2] = "1.25"  # the same person elsewhere at once; a row that only stands there twice counts once
    doubled.write_text("\n".join([*truth[:3], ",".join(other)]) + "\n")
    refused(twin("evaluate", doubled, run_folder / "tracks/laser-imm.csv"), "doubled.csv", "line 4")
    cells = truth[1].split(",")
    cells[2] = "nan"
    broken = tmp_path / "broken.csv"
    broken.write_text("\n".join([truth[0], ",".join(cells)]) + "\n")
    refused(twin("evaluate", broken, run_folder / "tracks/laser-imm.csv"), "broken.csv", "nan")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes((run_folder / "recording.mcap").read_bytes()[:-2000])
    refused(twin("track", cut), "cut.mcap", "mcap recover")


def test_an_out_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    refused(twin("run", "lab-five-people", *QUICK, "--out", tmp_path / "file" / "below"), "cannot be written")
    refused(twin("run", "lab-five-people", *QUICK, "--out", "/proc/none"), "/proc/none")


@pytest.mark.sample(2)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_a_run_that_is_stopped_leaves_no_half_written_file(number: signal.Signals, tmp_path: Path) -> None:
    arguments = ["run", "lab-five-people", "--duration", "600", "--no-images", "--out", str(tmp_path / "out")]
    process = subprocess.Popen(
        [*TWIN, *arguments], stderr=subprocess.PIPE, text=True, env=os.environ | {"COLUMNS": "80"}, preexec_fn=HEEDING
    )
    deadline = time.monotonic() + 60
    while not list(tmp_path.rglob("*.partial")) and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(0.5)
    process.send_signal(number)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode != 0
    assert "Traceback" not in stderr
    visible = [path for path in tmp_path.rglob("*") if path.is_file() and "/." not in path.as_posix()]
    assert visible == []
    if number != signal.SIGKILL:
        assert process.returncode == 130
        assert not list(tmp_path.rglob("*.partial"))


@pytest.mark.sample(2)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("where", ["import module_with_a_stop", "exec(stop)"])
def test_a_stop_within_an_import_or_an_exec_ends_the_command_with_its_exit_code(
    number: signal.Signals, where: str, tmp_path: Path
) -> None:
    stop = f"import os, time\nos.kill(os.getpid(), {number:d})\ntime.sleep(0.01)\n"
    (tmp_path / "module_with_a_stop.py").write_text(f"{stop}print('imported to its end', flush=True)\n")
    code = (
        f"import time, twin.commands.info\nstop = {stop!r}\n"
        f"def check_machine():\n    {where}\n    time.sleep(30)\n"
        "twin.commands.info.check_machine = check_machine\nfrom twin.cli import main\nmain()"
    )
    (tmp_path / "as_a_module.py").write_text(code)  # where `-m` runs it, Python looks at what passed through an `exec`
    done = subprocess.run(
        [sys.executable, "-m", "as_a_module", "check"],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        preexec_fn=HEEDING,
    )
    assert done.returncode == 130 and done.stderr.strip().startswith("twin: interrupted;")
    assert done.stdout == ("imported to its end\n" if "import" in where else "")


_BEFORE_THE_COMMAND = """
import os, signal, sys
class Stop:
    def find_spec(self, name, *_):
        if name == "twin.cli":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Stop())
from twin.__main__ import main
main()
"""


def test_an_interrupt_before_the_command_is_there_ends_without_a_traceback() -> None:
    command = [sys.executable, "-c", _BEFORE_THE_COMMAND, "list"]
    heeding = partial(signal.signal, signal.SIGINT, signal.default_int_handler)
    done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=heeding, timeout=25)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, "", "")


_PASSED_OVER = """\
import os, signal, time, twin.commands.info
from twin.commands.memory import Interrupted
def check_machine():
    try:
        for number in range(3):  # a compiled module passes over what Python raises in it, twice
            try:
                if not number:
                    os.kill(os.getpid(), signal.SIGINT)
                time.sleep(30)
            except Interrupted:
                if number == 2:
                    raise
    finally:
        time.sleep(0.3)
        print("cleaned up", flush=True)
        raise ValueError("of another sort")
twin.commands.info.check_machine = check_machine
from twin.cli import main
main()
"""


def test_a_stop_that_a_library_passes_over_or_turns_into_another_error_ends_the_command() -> None:
    command = [sys.executable, "-c", _PASSED_OVER, "check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=HEEDING, timeout=25)
    assert (done.returncode, done.stdout) == (130, "cleaned up\n")
    assert done.stderr == "twin: interrupted; no file was left half-written under its final name\n"


@pytest.mark.parametrize("failing", ["write", "close"])
def test_a_full_disk_is_said_in_one_sentence(failing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every write fails here as on a full disk, or the last, when the tables beside the bag are whole."""

    def fail(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(bag_files.Writer, failing, fail)
    done = twin("run", "lab-five-people", *QUICK, "--out", tmp_path / "out")
    refused(done, "No space left", "free space")
    assert not [path for path in tmp_path.rglob("*") if path.is_file() and not path.name.startswith(".")]


def test_a_home_that_there_is_not_is_no_folder_of_that_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # as of a user without an entry and without HOME
    refused(twin("new", "scenario", "--out=~/mine", cwd=tmp_path), "--out=~: this user", "has no home folder")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("number", "valid"), [(errno.EACCES, "may read, or write"), (errno.ENOSPC, "with space")])
def test_what_the_system_refuses_of_a_path_is_said(number: int, valid: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        raise OSError(number, os.strerror(number), "out/.x.mcap.12.partial")

    monkeypatch.setattr("twin.commands.info.check_machine", fail)
    refused(twin("check"), f"twin: out/x.mcap: {os.strerror(number)}; ", f"{valid}", " is expected")


def test_a_path_that_may_not_be_read_is_told_as_that(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *arguments, **options: False)  # as of another user
    said = f"{tmp_path}: cannot be read (Permission denied); a path that this user may read is expected\n"
    for arguments, option in ((("suite", "show", tmp_path), ""), (("run", "pair", "--out", tmp_path), "--out ")):
        refused(twin(*arguments), f"twin: {option}{said}")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_where_nothing_can_be_said_the_exit_code_says_it() -> None:
    with open("/dev/full", "w") as full:
        assert subprocess.run([*TWIN, "list", "nonsense"], stderr=full, check=False).returncode == 2


def test_a_fault_of_ours_is_loud(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("twin.commands.info.check_machine", lambda: 1 / 0)
    done = twin("check")
    assert done.returncode == 70
    assert "ZeroDivisionError" in done.stderr
    assert "report" in done.stderr


def test_nothing_of_the_users_is_overwritten_or_removed(run_folder: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    scenario = mine / "scenario.yaml"
    scenario.write_text("extends: lab-five-people\nname: mine # a comment of mine\n")
    before = scenario.read_text()
    refused(twin("run", scenario, *QUICK, "--out", mine), "scenario.yaml", "twin did not write")
    assert scenario.read_text() == before
    # a run's folder keeps its recording when it is tracked again into itself, and what others put there
    again = tmp_path / "again"
    shutil.copytree(run_folder, again)
    (again / "tracks" / "precious.csv").write_text("mine")
    done = twin("track", again / "recording.mcap", "--tracker", "laser-kalman", "--out", again, "--no-video")
    assert done.returncode == 0, done.stderr
    names = {path.name for path in (again / "tracks").iterdir()}
    assert names == {"laser-kalman.csv", "precious.csv"}
    assert (again / "recording.mcap").read_bytes() == (run_folder / "recording.mcap").read_bytes()
    assert (again / "truth.csv").exists()


def test_a_tracker_of_the_users_own_is_found_where_they_are(tmp_path: Path) -> None:
    (tmp_path / "my_lab.py").write_text(
        "from trackers.tracks import Track\n"
        "class Mine:\n"
        "    def __init__(self, rig, background, rng): pass\n"
        "    def update(self, observation): return None\n"
        "    def tracks(self): return [Track(id=1, x=0.0, y=1.5)]\n"
        "class Half:\n"
        "    def __init__(self, rig, background, rng): pass\n"
    )
    command = ["run", "lab-five-people", *QUICK, "--out", "out", "--tracker"]
    script = Path(sys.executable).with_name("twin")  # as installed: of the current folder it knows nothing by itself
    done, half = (
        subprocess.run([script, *command, name], capture_output=True, text=True, cwd=tmp_path, check=False)
        for name in ("my_lab:Mine", "my_lab:Half")
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out/tracks/my_lab-Mine.csv").read_text().count("\n") == 6
    refused(half, "my_lab:Half", "update")


def test_a_main_sensor_that_never_reports_is_no_fault_of_ours(tmp_path: Path) -> None:
    silent = ["--set", "sensors.waist.dropout=1", "--set", "sensors.knee.dropout=1"]
    done = twin("run", "lab-five-people", *QUICK, *silent, "--tracker", "laser-imm", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    metrics = json.loads((tmp_path / "out/metrics.json").read_text())
    assert metrics["trackers"]["laser-imm"]["ms_per_frame"] == {"mean": None, "p95": None}


def test_another_gl_of_the_users_does_not_matter() -> None:
    done = subprocess.run(
        [*TWIN, "check"], capture_output=True, text=True, check=False, env=os.environ | {"MUJOCO_GL": "osmesa"}
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "lab-five-people", "--out", ""),
        ("run", "lab-five-people", "--out="),
        ("suite", "run", "smoke", "--out", ""),
        ("view", ""),
    ],
)
def test_an_empty_argument_is_one_sentence_and_nothing_is_written(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    refused(twin(*arguments, cwd=tmp_path), "an argument is empty; a name, path or value is expected")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "arguments",
    [
        ("track", "a" * 300),
        ("run", "lab-five-people", *QUICK, "--out", "a" * 300),
        ("suite", "show", "a" * 300),
        ("suite", "compare", "a" * 300, "a" * 300),
        ("evaluate", "a" * 300, "a" * 300),
        ("evaluate", "/dev/zero", "/dev/zero"),
        ("suite", "run", "smoke", "--baseline", "/dev/zero"),
    ],
)
def test_a_path_that_names_no_file_is_one_sentence(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    done = twin(*arguments, cwd=tmp_path)
    refused(done, "is expected")
    said = [line for line in done.stderr.splitlines() if line and not line.startswith("twin: planned: ")]
    assert len(said) == 1


@pytest.mark.parametrize("number", [errno.EMFILE, errno.ENFILE])
def test_a_lack_of_open_files_is_said_whatever_failed_for_it(number: int) -> None:
    error = InputError("out: cannot be written; free space is needed")
    error.__cause__ = OSError(number, "Too many open files")
    said = describe_lack(error)
    assert said is not None and re.fullmatch(r"open files: .* \d+ at once \(ulimit -n\), .*; more are expected", said)
    assert describe_lack(InputError("out: cannot be written")) is None


def test_an_error_of_the_interpreter_itself_is_lack_of_memory_under_a_limit_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    error = SystemError("error return without exception set")  # what Python 3.12 makes of it in a dataclass
    monkeypatch.setattr(resource, "getrlimit", lambda _: (resource.RLIM_INFINITY,) * 2)
    assert describe_lack(error) is None
    monkeypatch.setattr(resource, "getrlimit", lambda _: (2**30,) * 2)
    assert "1024 MiB (ulimit -v)" in str(describe_lack(error))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("run", "pair", "--duration", "ten"), "--duration ten: a number is expected\n"),
        (("run", "pair", "--seed", "-3"), "--seed -3: a whole number of 0 or more is expected\n"),
        (("run", "pair", f"--seed={2**63}"), f"--seed {2**63}: a whole number from 0 to {2**63 - 1} is expected\n"),
        (("suite", "run", "smoke", "--jobs", "x"), "--jobs x: a whole number of 1 or more is expected\n"),
        (("suite", "run", "smoke", "--jobs", "0"), "--jobs 0: a whole number of 1 or more is expected\n"),
        (
            ("study", "coverage", "pair", "--px-per-m=0.1"),
            "--px-per-m 0.1: a number of 1 or more is expected\n",
        ),
        (
            ("study", "coverage", "pair", "--samples=20000"),
            "study coverage: samples: a number less than or equal to 10000 is expected (got 20000)\n",
        ),
        (("view", "--drawn", "2_0"), "--drawn 2_0: did you mean 20? a whole number from 1 to 200 is expected\n"),
        (("view", "--drawn", "500.0"), "--drawn 500.0: a whole number from 1 to 200 is expected\n"),
        (("run", "pair", "--seed", "1e-3"), "--seed 1e-3: a whole number of 0 or more is expected\n"),
        (("run", "pair", "--seed", "1e1"), "--seed 1e1: did you mean 10? a whole number of 0 or more is expected\n"),
        (("environment", "pair", "--station", "1_0,2"), "--station 1_0,2: is no place; "),
        (("export", "x", "--format", "xyz"), "Invalid value for '--format': 'xyz' is not one of 'mot', 'kitti'"),
    ],
)
def test_a_wrong_value_of_an_option_is_told_as_that_of_a_field(arguments: tuple[str, ...], said: str) -> None:
    done = twin(*arguments)
    assert done.returncode == 2 and done.stderr.startswith(f"twin: {said}")


def test_every_number_of_the_command_line_is_one_that_a_file_takes() -> None:
    apps = [cli.app, *(group.typer_instance for group in cli.app.registered_groups)]
    numeric = []
    for command in (command for each in apps if each is not None for command in each.registered_commands):
        assert command.callback is not None
        for hint in get_type_hints(command.callback, include_extras=True).values():
            kinds = {kind for kind in (int, float) if kind in (get_args(hint) and members_of(get_args(hint)[0]))}
            numeric += [(kind, about) for kind in kinds for about in hint.__metadata__]
    assert len(numeric) > 20
    for kind, about in numeric:
        assert (about.parser("7"), type(about.parser("7"))) == (7, kind)
        odd = [
            "1_0",
            "\uff11\uff10",
            " 7",
            "7\n",
            "010",
            "0x10",
            "nan",
            "inf",
            "-Infinity",
            ".inf",
            "1e999",
            "",
            "7 s",
            "9" * 65,
        ]
        for text in odd + ["7.0", "1e1"] * (kind is int):
            with pytest.raises(WrongNumber, match=rf"(?s)^--[a-z-]+ {re.escape(text)}: .* is expected$"):
                about.parser(text)


def test_a_source_that_is_not_there_is_told_with_all_that_can_be_exported() -> None:
    done = twin("export", "nothing", "--format", "mot")
    assert done.returncode == 2
    assert "twin: nothing: is not there; the folder of a run, a bag, or a suite is expected; suites are " in done.stderr


LAB = "lab-five-people"
SEED = ("--seed 1, --set seed=2: are of one field; one of the two is expected", ("--seed", "1", "--set", "seed=2"))
ROOM = (
    "--environment e.npz, --set prior.environment=f.npz: are of one field",
    ("--environment", "e.npz", "--set", "prior.environment=f.npz"),
)
TWICE = ("--set a=1, --set a = 2: are of one field; each field once is expected", ("--set", "a=1", "--set", "a = 2"))


@pytest.mark.parametrize(
    ("said", "arguments"),
    [
        *((SEED[0], (*each.split(), *SEED[1])) for each in (f"run {LAB}", f"render {LAB}", f"environment {LAB}")),
        *((SEED[0], (*each.split(), *SEED[1])) for each in (f"view {LAB}", "view --drawn 2", f"study coverage {LAB}")),
        (SEED[0], ("new", "scenario", "--drawn", *SEED[1])),
        *((ROOM[0], (command, "x.mcap", *ROOM[1])) for command in ("track", "detections")),
        (ROOM[0], ("run", LAB, *ROOM[1])),
        *((TWICE[0], (*each.split(), *TWICE[1])) for each in (f"run {LAB}", "track x.mcap", "suite run smoke")),
        ("--duration 1.0, --set duration_s=2: are", ("run", LAB, "--duration", "1", "--set", "duration_s=2")),
        ("--follow white: is about a video", ("view", LAB, "--drawn", "2", "--follow", "white")),
        ("--from 3.0: is about a video", ("view", LAB, "--drawn", "2", "--from", "3")),
        ("--rules x: is a table of its own beside --cite", ("list", "--rules", "x", "--cite")),
        ("--resource GPU=1: is of a scheduler's workers", ("suite", "run", "smoke", "--resource", "GPU=1")),
        (
            "--px-per-m 99: has no effect",
            ("study", "coverage", LAB, "--set", "sensors.fisheye=null", "--px-per-m", "99"),
        ),
        ("--beams 9: has no effect on movements-turning", ("study", "coverage", "movements-turning", "--beams", "9")),
        ("--moments 3, --samples 4: are one option", ("study", "coverage", LAB, "--moments", "3", "--samples", "4")),
    ],
)
def test_an_option_that_another_leaves_without_effect_is_refused(
    said: str, arguments: tuple[str, ...], tmp_path: Path
) -> None:
    done = twin(*arguments, cwd=tmp_path)
    assert done.returncode == 2 and said in done.stderr and "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["run", "study coverage"])
@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ("sensors.waist.mount.xyz=[9, 0, 0.95]", "sensors.waist.mount.xyz: [9, 0, 0.95] is "),
        (
            "sensors.eye={kind: stereo, rate_hz: 5, mount: {xyz: [2.9, 2, 1.5], yaw_deg: 90}, field_of_view_deg: 60, "
            "baseline_m: 0.5}",
            "sensors.eye.mount.xyz: [3.4, 2, 1.5] is inside",  # the right eye, in the wall
        ),
        (
            "sensors.mat={kind: floor, mount: {xyz: [9, 0, 0]}, rows: 4, columns: 4, pitch_m: 0.1}",
            "sensors.mat: a grid of",
        ),
    ],
)
def test_a_sensor_outside_the_building_is_refused_by_all_that_look_from_it(
    command: str, changed: str, said: str, tmp_path: Path
) -> None:
    done = twin(*command.split(), LAB, "--set", changed, "--out", "out", cwd=tmp_path)
    assert done.returncode == 2 and said in done.stderr and "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("twin run lab-fi", "lab-five-people"),
        ("twin view library_", "library_hall"),
        ("twin track walk.bag --tracker laser-l", "laser-legs"),
        ("twin suite run smo", "smoke"),
        ("twin reproduce rgbd", "rgbd-head"),
        ("twin list sc", "scenarios"),
        ("twin list trackers --rules laser-imm", "laser-imm-paper"),
        ("twin schema sui", "suite"),
        ("twin check lab-sc", "lab-scanner-place"),
        ("twin run ./mine", ""),  # a path: the shell's own completion goes on
    ],
)
def test_a_shell_completes_names_of_what_is_shipped(line: str, expected: str) -> None:
    asked = {"_TWIN_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(line.count(" "))}
    script = [sys.executable, "-c", "import sys; from twin.__main__ import main; sys.argv[0] = 'twin'; main()"]
    told = subprocess.run(script, env={**os.environ, **asked}, capture_output=True, text=True, check=False)
    assert told.stdout.split() == expected.split()
