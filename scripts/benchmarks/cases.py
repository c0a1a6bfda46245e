"""The inputs of ../shared/cases, each by the command line as a user would type it: right or wrong, and why.

A case is right where its figures are nearly those of the clean input and the loss, if there is one, is reported, or where it is
refused in a sentence with exit code 2. Nothing is measured where the folder is absent.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.figure import Figure
from trackers.observations import Image
from twin.recording.reader import Recording
from twin.recording.tables import read_truth

REPOSITORY = Path(__file__).parents[2]
CASES = REPOSITORY.parent / "shared" / "cases"
_CLEAN = {"sort": 0.940, "laser-imm": 0.910}
"""MOTA of the clean bag, the background learned."""
_NEARLY = 0.03
_ANEW = 0.1
"""Allowed loss of MOTA by a restart: about 1 s of 12, in which five people are confirmed and the background is learned."""
_SEATED_M = 0.6
"""Height of the pelvis below which somebody sits."""
_LIMIT_S = 300


@dataclass(frozen=True)
class Said:
    """Result of a command: exit code, stdout, stderr, and its output folder."""

    code: int
    out: str
    err: str
    folder: Path

    def __str__(self) -> str:
        return f"exit {self.code}: {self.err.strip()[-300:]!r}"


Check = Callable[[Path], str]
"""Tries a case in an empty folder; says what is wrong, '' for nothing."""


def python(folder: Path, *arguments: str | Path, env: dict[str, str] | None = None, limit_mib: int = 0) -> Said:
    """Call Python with the repository on its path; `limit_mib`: of its address space."""
    command = [sys.executable, *map(str, arguments)]
    if limit_mib:
        command = ["bash", "-c", f'ulimit -v {limit_mib * 1024} && exec "$@"', "bash", *command]
    # else the lines of a sentence are broken wherever the terminal ends
    around = os.environ | {"PYTHONPATH": str(REPOSITORY), "COLUMNS": "10000"} | (env or {})
    done = subprocess.run(
        command, cwd=folder, env=around, capture_output=True, text=True, errors="replace", timeout=_LIMIT_S, check=False
    )
    return Said(done.returncode, done.stdout, done.stderr, folder / "out")


def twin(folder: Path, *arguments: str | Path, env: dict[str, str] | None = None) -> Said:
    """Call `twin` with its results in the folder's out."""
    return python(folder, "-m", "twin", *arguments, "--out", folder / "out", env=env)


@cache
def truth_of_the_lab() -> Path:
    """The truth that the bags were recorded with: seed 5, 12 s, five people."""
    folder = Path(tempfile.mkdtemp(prefix="truth-"))
    said = twin(folder, "run", "lab-five-people", "--seed", "5", "--duration", "12", "--no-images", "--no-video")
    if said.code:
        raise RuntimeError(f"the truth of the cases cannot be made: {said}")
    return said.folder / "truth.csv"


def mota(folder: Path, tracks: Path) -> float:
    """MOTA of a table of tracks against the truth of the lab."""
    said = python(folder, "-m", "twin", "evaluate", truth_of_the_lab(), tracks)
    return float(json.loads(said.out)["mota"])


def tracked(
    bag: str, *reported: str, trackers: Sequence[str] = ("sort",), rig: str = "rig.yaml", least: float = -_NEARLY
) -> Check:
    """A bag that is tracked nearly as the clean one, each of the patterns `reported` on stderr."""

    def check(folder: Path) -> str:
        names = [part for name in trackers for part in ("--tracker", name)]
        source = CASES / bag
        extra = ["--rig", source.parent / rig] if rig else []
        said = twin(folder, "track", source, *extra, *names, "--no-video")
        if said.code:
            return str(said)
        if missing := [each for each in reported if not re.search(each, said.err)]:
            return f"stderr lacks {missing}: {said.err[-500:]!r}"
        for name in trackers:
            score = mota(folder, said.folder / "tracks" / f"{name}.csv") - _CLEAN[name]
            if score < least:
                return f"{name}: MOTA is {-score:.3f} below that of the clean bag; {said.err[-300:]!r}"
        return ""

    return check


def lab_at(rate_hz: float) -> Check:
    """The lab scanned at another rate."""

    def check(folder: Path) -> str:
        names = ("laser-imm", "laser-kalman", "sort")
        said = twin(
            folder,
            "run",
            "lab-five-people",
            *(part for name in names for part in ("--tracker", name)),
            *(part for name in ("waist", "knee") for part in ("--set", f"sensors.{name}.rate_hz={rate_hz:g}")),
            *("--duration", "12", "--seed", "5", "--no-images", "--no-video"),
        )
        if said.code:
            return str(said)
        metrics = json.loads((said.folder / "metrics.json").read_text())["trackers"]
        low = {name: metrics[name]["mota"] for name in names if metrics[name]["mota"] < 0.85}
        return f"MOTA {low}" if low else ""

    return check


def refused(pattern: str, *arguments: str) -> Check:
    """A command that ends with exit code 2 and a sentence."""

    def check(folder: Path) -> str:
        said = twin(folder, *(str(CASES / each) if (CASES / each).exists() else each for each in arguments))
        if said.code != 2 or "Traceback" in said.err or not re.search(pattern, said.err):
            return f"exit 2 and {pattern!r} are expected, not {said}"
        return f"{said.folder} was written" if said.folder.exists() else ""

    return check


def evaluated(which: str, least_judged: int) -> Check:
    """Two tables of which one row is far off: judged as without it, in little memory, each figure with its n."""

    def check(folder: Path) -> str:
        at = CASES / which
        said = python(folder, "-m", "twin", "evaluate", at / "truth.csv", at / "tracks.csv", limit_mib=8192)
        if said.code:
            return str(said)
        metrics = json.loads(said.out)
        judged = metrics["judged"]["frames"]
        if judged < least_judged:
            return f"{judged} frames are judged of {metrics['judged']}"
        return "" if metrics["mota"] > 0.9 else f"MOTA {metrics['mota']}"

    return check


def copied_to(name: str) -> Check:
    """A bag's folder under a name that an SQLite URI would read otherwise."""

    def check(folder: Path) -> str:
        source = CASES / "12-db3-hash-path"
        shutil.copytree(source / "db3", folder / name)
        said = twin(folder, "track", name, "--rig", source / "rig.yaml", "--tracker", "sort", "--no-video")
        if said.code:
            return str(said)
        score = mota(folder, said.folder / "tracks" / "sort.csv")
        return "" if score > _CLEAN["sort"] - _NEARLY else f"MOTA {score}"

    return check


def read_or_refused(bag: str, tool: str) -> Check:
    """A container that is read, or refused by a sentence that names what it is and the tool that mends it."""

    def check(folder: Path) -> str:
        said = twin(
            folder, "track", CASES / bag, "--rig", (CASES / bag).parent / "rig.yaml", "--tracker", "sort", "--no-video"
        )
        if said.code == 2:
            return "" if re.search(tool, said.err) and "truncated" not in said.err else str(said)
        if said.code:
            return str(said)
        score = mota(folder, said.folder / "tracks" / "sort.csv")
        return "" if score > _CLEAN["sort"] - _NEARLY else f"MOTA {score}"

    return check


def pictures(folder: Path, scenario: Path) -> np.ndarray:
    """The pictures of a scenario's camera, (n, height, width, 3)."""
    out = folder / scenario.parent.name
    out.mkdir(exist_ok=True)
    said = twin(out, "run", scenario, "--no-video", "--tracker", "sort")
    if said.code:
        raise RuntimeError(str(said))
    bag = Recording(said.folder / "recording.mcap")
    return np.array([each.rgb for each in bag.observations() if isinstance(each, Image)])


def same_pictures(first: str, second: str, share: float) -> Check:
    """Two rooms that look alike to the sensors: no more than a share of the pixels differ by 30 levels."""

    def check(folder: Path) -> str:
        one, other = (pictures(folder, CASES / each).astype(int) for each in (first, second))
        differ = float(np.mean(np.abs(one - other).max(axis=-1) > 30))
        return "" if differ <= share else f"{differ:.2%} of the pixels differ"

    return check


def eighth_lamp(folder: Path) -> str:
    """An eighth lamp shines as the seventh does, or is refused in a sentence."""
    said = twin(folder, "run", CASES / "16-eight-lamps/light7/s.yaml", "--no-video", "--tracker", "sort")
    if said.code == 2:
        return "" if re.search(r"8 <light>.*at most", said.err) else str(said)
    shutil.rmtree(said.folder)
    return same_pictures("16-eight-lamps/light6/s.yaml", "16-eight-lamps/light7/s.yaml", 0.02)(folder)


def silent_topic(folder: Path) -> str:
    """Two scanners of which one says nothing, without a rig: the other is tracked, and that is said."""
    said = twin(folder, "track", CASES / "25-silent-topic/one_topic_empty.bag", "--tracker", "sort", "--no-video")
    rows = (said.folder / "tracks/sort.csv").read_text().count("\n") if said.code == 0 else 0
    return "" if rows > 100 and re.search(r"/scan\w*.*no message", said.err) else f"{rows} rows: {said}"


def pedestrians(table: Path | str, *options: str) -> Callable[[Path], Said]:
    """Run a plaza with recorded pedestrians."""

    def call(folder: Path) -> Said:
        source = folder / "peds.csv"
        shutil.copy(table, source) if isinstance(table, Path) else source.write_text(table)
        (folder / "s.yaml").write_text(
            "name: peds\nroom: plaza\nduration_s: 3\npedestrians: {file: peds.csv"
            + "".join(options)
            + "}\npeople: {}\n"
            "sensors: {knee: {kind: laser, role: knee, rate_hz: 10, mount: {xyz: [0, 0, 0.45]}}}\n"
        )
        return twin(folder, "run", "s.yaml", "--no-images", "--no-video", "--tracker", "sort")

    return call


def dialect(file: str) -> Check:
    """A table of pedestrians that another program wrote."""

    def check(folder: Path) -> str:
        said = pedestrians(CASES / "21-csv-dialects" / file)(folder)
        if said.code:
            return str(said)
        rows = (said.folder / "truth.csv").read_text().count("\n")
        return "" if rows > 20 else f"the truth has {rows} rows"

    return check


def contradicting_header(folder: Path) -> str:
    """A header `id,t,x,y` over columns t,id,x,y is refused with what is odd, not read by the header."""
    said = pedestrians(CASES / "21-csv-dialects" / "order.csv")(folder)
    return "" if said.code == 2 and re.search(r"\bid\b", said.err) and "Traceback" not in said.err else str(said)


def slow_pedestrians(folder: Path) -> str:
    """People who walk at a tenth of their pace, as the frame rate is wrong."""
    rows = [f"{frame} {person} {0.05 * frame:.3f} 0 {person}" for frame in range(0, 200, 10) for person in (1, 2)]
    said = pedestrians("\n".join(rows) + "\n", ", frame_rate_hz: 2.5")(folder)
    return "" if "m/s" in said.err else f"no word of the speed: {said}"


def worded(pattern: str, file: str) -> Check:
    """A word of YAML 1.1 where a number belongs."""
    return refused(pattern, "run", f"22-yaml-booleans/{file}", "--no-images", "--no-video", "--tracker", "sort")


def name_of_norway(folder: Path) -> str:
    """A person called 'no' is called so, or refused in a sentence."""
    said = twin(folder, "run", CASES / "22-yaml-booleans/norway.yaml", "--no-video", "--tracker", "sort")
    if said.code == 2:
        return "" if "no" in said.err and "Traceback" not in said.err else str(said)
    people = (said.folder / "truth_people.csv").read_text() if said.code == 0 else ""
    return "" if people.splitlines()[1:] == ["1,no"] else f"{said} {people!r}"


def octal(folder: Path) -> str:
    """`duration_s: 010` is 10 or refused, never 8."""
    said = twin(folder, "run", CASES / "22-yaml-booleans/octal.yaml", "--no-images", "--no-video", "--tracker", "sort")
    if said.code == 2:
        return "" if "010" in said.err and "Traceback" not in said.err else str(said)
    text = (said.folder / "scenario.yaml").read_text() if said.code == 0 else ""
    return "" if re.search(r"duration_s: 10(\.0)?$", text, re.MULTILINE) else f"{said} {text[:200]}"


def moving_robot(folder: Path) -> str:
    """A robot that turns: said, with the topic."""
    said = twin(folder, "track", CASES / "24-moving-robot/turning.bag", "--tracker", "sort", "--no-video")
    return "" if said.code == 0 and "/odom" in said.err else str(said)


_MOVED = {
    "twin.recording.messages": "twin.recording.ros.ros_messages",
    "twin.recording.depth_picture": "twin.recording.ros.depth_images",
}
"""Modules that a case's script names as they were called when it was written, and as they are called today."""


def printed(script: str, *wanted: str, never: str = "Traceback") -> Check:
    """Check a script whose output has a line for each pattern, and none for the other."""

    def check(folder: Path) -> str:
        source = (CASES / script).read_text("utf-8")
        for before, now in _MOVED.items():
            source = source.replace(before, now)
        today = folder / Path(script).name
        today.write_text(source, "utf-8")
        said = python(folder, today)
        text = said.out + said.err
        lacks = [each for each in wanted if not re.search(each, text, re.MULTILINE)]
        return f"lacks {lacks}: {text[-1500:]}" if lacks or re.search(never, text) else ""

    return check


def stuck_script(folder: Path) -> str:
    """A seat that nobody reaches, and a way out in a wall: refused, reported, or done."""
    at = CASES / "51-stuck-script/office.yaml"
    said = twin(folder, "run", at, "--no-images", "--no-video", "--tracker", "sort")
    if said.code == 2:
        return "" if re.search(r"people\.\w+\.script", said.err) else str(said)
    if said.code:
        return str(said)
    truth = read_truth(said.folder / "truth.csv")
    anna, ben = truth.id == 1, truth.id == 2
    sat = bool((truth.z[anna] < _SEATED_M).any())
    left = truth.stamps_ns[ben].max() < truth.frame_stamps_ns.max()
    stuck = [
        name
        for name, is_done in (("anna", sat), ("ben", left))
        if not is_done and not re.search(rf"\b{name}\b has not", said.err)
    ]
    return f"nothing is reported of {stuck}: {said}" if stuck else ""


def no_utf8(folder: Path) -> str:
    """Output that can hold ASCII only."""
    said = twin(
        folder,
        *("run", "lab-five-people", "--duration", "1", "--no-images", "--no-video", "--tracker", "sort"),
        env={"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
    )
    return str(said) if said.code else ""


def room_files_elsewhere(folder: Path) -> str:
    """A room whose files lie in ../: refused with the flag that allows it, and read with it."""
    (folder / "rooms").mkdir()
    shutil.copy(CASES / "14-near-plane/base/room.xml", folder / "shared.xml")
    (folder / "rooms/room.xml").write_text('<mujoco><include file="../shared.xml"/></mujoco>')
    shutil.copy(CASES / "14-near-plane/base/s.yaml", folder / "rooms/s.yaml")
    call = ("run", "rooms/s.yaml", "--no-images", "--no-video", "--tracker", "sort")
    said = twin(folder, *call)
    if said.code != 2 or "--room-root" not in said.err:
        return str(said)
    said = twin(folder, *call, "--room-root", folder)
    return str(said) if said.code else ""


_RUN = ("--no-video", "--tracker", "sort")
CHECKS: dict[str, Check] = {
    "01 stamp_noise_1ms": tracked("01-slow-scanner/stamp_noise_1ms.bag", trackers=("laser-imm", "sort")),
    "01 rate_997": tracked("01-slow-scanner/rate_997.bag", trackers=("laser-imm", "sort")),
    "01 lab at 9 Hz": lab_at(9),
    "02 angle_jitter": tracked("02-beams-vary/angle_jitter.bag"),
    "02 beam_count_varies": tracked("02-beams-vary/beam_count_varies.bag"),
    "03 empty_first": tracked("03-empty-scans/empty_first.bag"),
    "03 empty_now_and_then": tracked("03-empty-scans/empty_now_and_then.bag", r"\w+: \d+ of \d+ messages"),
    "04 bad_increment_midway": tracked("04-one-bad-message/bad_increment_midway.bag", "angle_increment"),
    "04 inf_increment": tracked("04-one-bad-message/inf_increment.bag", "angle_increment"),
    **{
        f"05 {each}": tracked(
            f"05-clock-back/{each}.bag", "waist: .*set back", "knee: .*set back", "trackers restart", least=-_ANEW
        )
        for each in ("clock_back", "clock_back_hour")
    },
    "06 all_stamps_zero": tracked("06-stamps-zero/all_stamps_zero.bag", "waist: .*no stamp", "knee: .*no stamp"),
    "07 first_stamp_zero": tracked("07-first-stamp-zero/first_stamp_zero.bag", r"\w+: 1 of \d+ messages"),
    "07 knee_boot_clock": tracked("07-first-stamp-zero/knee_boot_clock.bag", "knee: .*time_offset_s"),
    "09 far_stamp": evaluated("09-far-stamp/far_stamp", 90),
    "09 far_stamp_truth": evaluated("09-far-stamp/far_stamp_truth", 90),
    "10 truth_2_5Hz_jitter": evaluated("10-sparse-truth/truth_2_5Hz_jitter", 90),
    "12 run #3": copied_to("run #3"),
    "12 50%20off": copied_to("50%20off"),
    "12 what?": copied_to("what?"),
    "13 ros1_profile": read_or_refused("13-ros1-profile-mcap/ros1_profile.mcap", "ROS 1|ros1"),
    "13 profile_empty": read_or_refused("13-ros1-profile-mcap/profile_empty.mcap", "profile"),
    "14 far_300": same_pictures("14-near-plane/base/s.yaml", "14-near-plane/far_300/s.yaml", 0.005),
    "14 far_500": same_pictures("14-near-plane/base/s.yaml", "14-near-plane/far_500/s.yaml", 0.005),
    "15 geom group 6": refused(r"group", "run", "15-geom-group/s.yaml", *_RUN),
    "16 eighth lamp": eighth_lamp,
    "17 flex": refused(r"flex", "run", "17-flex/s.yaml", *_RUN),
    **{f"21 {each}": dialect(f"{each}.csv") for each in ("bom", "comment", "quoted", "semi", "upper")},
    "21 order": contradicting_header,
    "22 bool_on": worded(r"rate_hz.*number", "bool_on.yaml"),
    "22 norway": name_of_norway,
    "22 octal": octal,
    "24 turning": moving_robot,
    "25 one_topic_empty": silent_topic,
    "25 waist_silent": tracked("25-silent-topic/waist_silent.bag", r"waist: no message", least=-0.3),
    "26 distortion": printed(
        "26-distortion/rigs.py",
        *(
            "^none OK",
            "^empty list OK",
            "^four OK",
            "^five ints OK",
            "^eight OK",
            r"^nan InputError",
            "^strong InputError",
        ),
        *("^eight real (OK|InputError.*rational_polynomial)", "^norway InputError", "^fisheye kb4 small OK"),
        *("^fisheye kb folding InputError.*folds", "^fisheye fov 360 OK"),
    ),
    "27 fisheye fold": printed(
        "27-fisheye-fold/rig.py", r"k=\[0,0,0,0\] accepted", "InputError.*folds back", never="^$^"
    ),
    "28 encodings": printed(
        "28-encodings/enc.py",
        *(
            rf"^{each} +OK .*\[200, 0, 0\]$"
            for each in ("rgb8", "bgr8", "rgba8", r"bgra8 \(.*\)", "8UC3", "rgb16", "padded")
        ),
        *(rf"^{each} +OK" for each in ("mono8", "8UC1", "8UC4", "bayer_rggb8", "mono16", "yuv422_yuy2", "yuv422")),
        *(rf"^{each} +OK 1.5" for each in ("16UC1", "32FC1", "mono16", "16UC1 big", "32FC1 big", "png16")),
        *(rf"^compressedDepth {each} +(OK 1.5|InputError)" for each in (r"png16", r"\(melodic name\)", "rvl")),
    ),
    "51 stuck script": stuck_script,
    "no UTF-8": no_utf8,
    "slow pedestrians": slow_pedestrians,
    "room files in ../": room_files_elsewhere,
}
"""Each case by its folder's number and its file, and those that the folder's README says in a line."""


def measure() -> Iterator[Figure]:
    """Each case, 1 for right, then how many are wrong; what is wrong goes to stderr."""
    if not CASES.is_dir():
        print(f"{CASES} is absent: no case is tried", file=sys.stderr)
        return
    wrong = 0
    for name, check in CHECKS.items():
        with tempfile.TemporaryDirectory(prefix="case-") as made:
            try:
                fault = check(Path(made))
            except (RuntimeError, subprocess.TimeoutExpired, ValueError, KeyError) as error:
                fault = f"{type(error).__name__}: {error}"
        if fault:
            wrong += 1
            print(f"{name}: WRONG: {fault}", file=sys.stderr, flush=True)
        yield Figure(f"case {name}", float(not fault), "right", ">= 1")
    yield Figure("cases that are wrong", float(wrong), f"of {len(CHECKS)}", "<= 0")
