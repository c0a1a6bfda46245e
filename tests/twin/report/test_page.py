"""The report is one page that needs nothing else and hides nothing."""

from __future__ import annotations

import re
import shutil
import subprocess
import zlib
from collections.abc import Iterator
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
from synthetic_run import SyntheticRun, stage

import twin.report
from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.rig import LaserSensor, OdometrySensor, Pose, Rig
from trackers.tracks import Track, TrackFrame
from twin.evaluate.continuity import track_counts
from twin.evaluate.summary import evaluate_with_details
from twin.recording.tables import track_table
from twin.report import page
from twin.report.birdseye import Site
from twin.report.metrics_table import METRICS
from twin.report.page import RunFacts, TrackerResult, cause_rows, write_report
from twin.report.path_map import Drive, ScanDensity
from twin.report.sensor_stills import RunPictures, SensorStills, Still
from twin.report.timeline import false_positive_tracks

NAMES = {1: "white", 2: "black", 3: "pink", 4: "blue", 5: "purple"}
VOID = {"meta", "img", "br", "link", "input", "hr"}
JPEG = b"\xff\xd8\xff\xe0 not decoded here"


def facts(**changes: object) -> RunFacts:
    return replace(RunFacts("lab-five-people", 6.0, seed=0, command="twin run lab-five-people"), **changes)  # pyright: ignore


def result(synthetic: SyntheticRun, name: str = "laser-fisheye-imm") -> TrackerResult:
    evaluation = evaluate_with_details(synthetic.truth, synthetic.tracks)
    return TrackerResult(name, synthetic.tracks, evaluation, {"mean": 4.25, "p95": 7.5})


class Checker(HTMLParser):
    """Collects what a page fetches, and insists on tags that close."""

    def __init__(self) -> None:
        super().__init__()
        self.fetched: list[str] = []
        self.ids: list[str] = []
        self.open: list[str] = []
        self.texts: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.fetched += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "data", "poster")]
        self.ids += [value or "" for name, value in attrs if name == "id"]
        if tag == "img":
            assert dict(attrs).get("alt")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.fetched += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data.strip())


def checked(path: Path) -> Checker:
    checker = Checker()
    checker.feed(path.read_text(encoding="utf-8"))
    assert checker.open == []
    return checker


def test_page_fetches_nothing(tmp_path: Path, synthetic: SyntheticRun) -> None:
    path = tmp_path / "report.html"
    density = ScanDensity(synthetic.rig)
    for scan in synthetic.scans(3).values():
        density.add(scan)
    write_report(
        path,
        facts(),
        [result(synthetic), result(synthetic, "laser-imm")],
        Site(synthetic.rig),
        truth=synthetic.truth,
        scans=density,
        pictures=RunPictures(2 * NS_PER_S, [Still(JPEG, "waist, laser")], JPEG),
    )
    checker = checked(path)
    text = path.read_text(encoding="utf-8")
    assert "url(" not in text
    assert "@import" not in text
    assert not re.search(r"https?:", text)
    assert any(address.startswith("data:image/png") for address in checker.fetched)
    assert any(address.startswith("data:image/jpeg") for address in checker.fetched)
    for address in checker.fetched:
        assert address.startswith(("data:", "#"))
        if address.startswith("#"):
            assert address[1:] in checker.ids


def test_every_tracker_figure_and_event_is_on_the_page(tmp_path: Path, synthetic: SyntheticRun) -> None:
    path = tmp_path / "report.html"
    mine = result(synthetic)
    worse_frames = [TrackFrame(frame.stamp_ns, frame.tracks[:2]) for frame in synthetic.track_frames]
    worse_table = track_table(worse_frames)
    worse = TrackerResult("laser-kalman", worse_table, evaluate_with_details(synthetic.truth, worse_table))
    write_report(
        path,
        facts(),
        [mine, worse],
        Site(synthetic.rig, synthetic.outline, NAMES),
        truth=synthetic.truth,
    )
    text = unescape(path.read_text(encoding="utf-8"))
    texts = checked(path).texts
    assert mine.evaluation is not None
    assert worse.evaluation is not None
    for tracker in (mine, worse):
        assert tracker.name in texts
        assert tracker.evaluation is not None
        for key in ("mota", "motp_m", "idf1", "hota"):
            assert f"{tracker.evaluation.metrics[key]:.3f}".replace("-", "−") in texts
    kinds = [event.kind for event in mine.evaluation.events]
    assert kinds.count("switch") == 3
    assert kinds.count("misidentification") == 2
    assert kinds.count("lost") == 1
    marks = re.findall(r'<g class="event"', text)
    assert len(marks) == len(mine.evaluation.events) + len(worse.evaluation.events)
    for event in mine.evaluation.events:
        if event.kind == "switch":
            person = NAMES[event.person_id]
            assert f"{person} goes on as #{event.track_id}, was #{event.previous_track_id}" in texts
    assert "#2 goes on with white, was black" in texts
    assert "#3 ends while pink stays" in texts
    assert "Tracks without a person" in texts
    assert re.search(r"<title>#9 \(false positive\)", text)
    assert "4.25" in texts


def test_misses_are_gaps(tmp_path: Path, synthetic: SyntheticRun) -> None:
    """Track 2 is lost at 3.6 s and taken up again 2 s later: pink's row is shaded there and nowhere else after 0.5 s."""
    write_report(
        tmp_path / "report.html", facts(), [result(synthetic)], Site(synthetic.rig, (), NAMES), truth=synthetic.truth
    )
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    boxes = re.findall(r'<path class="missed" d="([^"]+)"', text)
    assert len(boxes) == 5
    spans = [[tuple(map(float, span)) for span in re.findall(r"M([\d.]+) \d+H([\d.]+)", box)] for box in boxes]
    assert [len(each) for each in spans] == [1, 1, 2, 1, 1]
    start, end = ((x - 104) / (1000 - 104 - 14) * 5.9 for x in spans[2][1])
    assert start == pytest.approx(3.55, abs=0.01)
    assert end == pytest.approx(5.55, abs=0.01)


def test_false_tracks_leave_out_who_follows_people_outside(synthetic: SyntheticRun) -> None:
    frames = []
    for frame in synthetic.truth_frames:
        outside = tuple(replace(person, in_area=person.id != 4) for person in frame.people)
        frames.append(replace(frame, people=outside))
    changed = replace(synthetic, truth_frames=frames)
    evaluation = evaluate_with_details(changed.truth, changed.tracks)
    stamps, ids = false_positive_tracks(changed.truth, changed.tracks, evaluation)
    assert set(ids.tolist()) == {9}
    counted = dict(zip(evaluation.stamps_ns.tolist(), evaluation.false_positives.tolist(), strict=True))
    assert {stamp: 1 for stamp in stamps.tolist()} == {stamp: n for stamp, n in counted.items() if n}


def test_without_truth(tmp_path: Path, synthetic: SyntheticRun) -> None:
    rig = Rig(sensors={"scan": LaserSensor(topic="/scan")})
    density = ScanDensity(rig)
    for index in range(20):
        scan = synthetic.scans(index)["waist"]
        density.add(replace(scan, sensor="scan"))
    tracker = TrackerResult("laser-imm", synthetic.tracks)
    write_report(tmp_path / "report.html", facts(seed=None), [tracker], Site(rig), scans=density)
    checker = checked(tmp_path / "report.html")
    assert "Tracks" in checker.texts
    assert "Errors over time" not in checker.texts
    assert {"#1", "#2", "#3", "#4", "#5", "#9", "#11"} <= set(checker.texts)

    write_report(tmp_path / "two.html", facts(), [tracker, replace(tracker, name="sort")], Site(rig))
    text = (tmp_path / "two.html").read_text()
    metrics = text[text.index('<h2 id="metrics">') : text.index('<h2 id="tracker-1')]
    counts = track_counts(synthetic.tracks)
    assert metrics.count(f">{counts['track_count']}<") == 2 == metrics.count(f">{counts['tracks_per_frame']:.2f}<")


def test_sensors_on_a_base_are_drawn_by_its_way_and_not_at_their_mounts(
    tmp_path: Path, synthetic: SyntheticRun
) -> None:
    """The pose of such a sensor in the rig is that on the base; distances to it are those at the time of an error."""
    pose = Pose(xyz=(9.0, 9.0, 0.3))
    scanner = LaserSensor(topic="/scan", room_from_sensor=pose, mounted_on="base")
    rig = Rig(sensors={"scan": scanner, "base": OdometrySensor(topic="/odom"), "wall": LaserSensor(topic="/wall")})
    stamps = np.array([0, 10 * NS_PER_S])
    drives = Drive.of(rig, {"base": (stamps, np.array([[-1.0, 0.5, 0.0], [1.0, 0.5, 0.0]]))})
    tracker = replace(result(synthetic), note="takes scan to stand")
    write_report(tmp_path / "r.html", facts(), [tracker], Site(rig), truth=synthetic.truth, drives=drives)
    text = (tmp_path / "r.html").read_text()
    drawn = text[text.index('<svg class="map') :]
    drawn = drawn[: drawn.index("</svg>")]
    assert drawn.count('class="drive"') == 1 and "scan, base" in drawn
    assert drawn.count('class="sensor"') == 2 and ">wall</title>" in drawn and ">scan</title>" not in drawn
    assert "Dashed: the way of base with scan by its odometry" in text and "takes scan to stand" in text
    write_report(tmp_path / "u.html", facts(), [tracker], Site(rig), truth=synthetic.truth)
    assert "Not drawn: scan, on a base whose poses nothing tells" in (tmp_path / "u.html").read_text()
    assert drives[0].at(np.array([5 * NS_PER_S, 99 * NS_PER_S])).tolist() == [[0.0, 0.5], [1.0, 0.5]]
    still = replace(drives[0], xy=np.full((2, 2), 100.0))
    assert tracker.evaluation is not None
    alone = rig.model_copy(update={"sensors": {name: each for name, each in rig.sensors.items() if name != "wall"}})
    assert all(row.by_distance[:2] == (0, 0) for row in cause_rows(tracker.evaluation.errors, alone, [still]))


def test_without_any_track(tmp_path: Path, synthetic: SyntheticRun) -> None:
    empty = track_table([TrackFrame(frame.stamp_ns, ()) for frame in synthetic.truth_frames])
    evaluation = evaluate_with_details(synthetic.truth, empty)
    write_report(
        tmp_path / "a.html",
        facts(),
        [TrackerResult("silent", empty, evaluation)],
        Site(synthetic.rig),
        truth=synthetic.truth,
    )
    checker = checked(tmp_path / "a.html")
    assert "–" in checker.texts  # MOTP does not apply
    assert checker.texts.count("never matched") == 5
    write_report(tmp_path / "b.html", facts(), [TrackerResult("silent", empty)], Site(synthetic.rig))
    assert "No track was confirmed." in checked(tmp_path / "b.html").texts


def test_names_are_text_not_markup(tmp_path: Path, synthetic: SyntheticRun) -> None:
    nasty = '<b onload="x">'
    write_report(
        tmp_path / "report.html",
        facts(title=nasty, notes=[nasty], command=nasty),
        [result(synthetic, nasty)],
        Site(synthetic.rig, (), {1: nasty}),
        truth=synthetic.truth,
        pictures=RunPictures(0, [Still(JPEG, nasty)]),
    )
    checked(tmp_path / "report.html")
    assert "<b " not in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_failure_leaves_the_old_page(tmp_path: Path, synthetic: SyntheticRun, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "report.html"
    path.write_text("older")
    with pytest.raises(ValueError, match="no truth was handed in"):
        write_report(path, facts(), [result(synthetic)], Site(synthetic.rig))

    def broken(*_: object) -> str:
        raise RuntimeError("broken")

    monkeypatch.setattr(page, "identity_timeline", broken)
    with pytest.raises(RuntimeError, match="broken"):
        write_report(path, facts(), [result(synthetic)], Site(synthetic.rig), truth=synthetic.truth)
    assert path.read_text() == "older"
    assert list(tmp_path.iterdir()) == [path]


def test_unwritable_place_is_named(tmp_path: Path, synthetic: SyntheticRun) -> None:
    (tmp_path / "report.html").mkdir()
    with pytest.raises(InputError, match=r"report\.html: cannot be written"):
        write_report(tmp_path / "report.html", facts(), [result(synthetic)], Site(synthetic.rig), truth=synthetic.truth)


def test_a_long_run_stays_small(tmp_path: Path) -> None:
    synthetic = stage(120.0, n_people=4)
    write_report(tmp_path / "long.html", facts(), [result(synthetic)], Site(synthetic.rig), truth=synthetic.truth)
    checked(tmp_path / "long.html")
    assert (tmp_path / "long.html").stat().st_size < 600_000


def test_scan_density_counts_cells() -> None:
    rig = Rig(sensors={"scan": LaserSensor(topic="/scan")})
    density = ScanDensity(rig, cell_m=0.1)
    scan = replace(stage(0.1).scans(0)["waist"], sensor="scan")
    ranges = np.full(361, np.nan, dtype=np.float32)
    ranges[180], ranges[360] = 2.05, np.inf
    for _ in range(3):
        density.add(replace(scan, ranges_m=ranges))
    cells, counts = density.cells()
    assert counts.tolist() == [3]
    np.testing.assert_allclose(
        cells, [[2.05, 0.05]], atol=1e-9
    )  # the beam straight ahead: y is 0, in the cell above it


def test_one_row_per_track_even_for_one_frame(tmp_path: Path) -> None:
    table = track_table([TrackFrame(0, (Track(7, 1.0, 1.0),))])
    write_report(
        tmp_path / "r.html",
        facts(),
        [TrackerResult("x", table)],
        Site(Rig(sensors={"scan": LaserSensor(topic="/scan")})),
    )
    assert "#7" in checked(tmp_path / "r.html").texts


def test_the_picture_comes_first_then_six_metrics_then_charts(tmp_path: Path, synthetic: SyntheticRun) -> None:
    """The long table is folded, and causes of misses that occurred nowhere have no row in it."""
    mine = result(synthetic)
    write_report(
        tmp_path / "report.html",
        facts(),
        [mine, result(synthetic, "sort")],
        Site(synthetic.rig),
        truth=synthetic.truth,
        pictures=RunPictures(2 * NS_PER_S, [Still(JPEG, "waist, laser")], JPEG),
        links={"preview": "preview.mp4", "recording": "recording.mcap"},
    )
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    places = [
        text.index(part)
        for part in ("<video", "waist, laser", 'href="recording.mcap"', "metrics headline", "<details", "Paths over")
    ]
    assert places == sorted(places)
    assert "0.0 to 5.9 s" in text[: text.index("<video")]
    table = text[text.index("<details") : text.index("</details>")]
    assert mine.evaluation is not None
    for cause, count in mine.evaluation.metrics["errors"]["missed"].items():
        name = METRICS[f"errors.missed.{cause}"].name
        assert (f">{name} <" in table) == (count > 0)


BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
"""Path of a browser that prints a page; None: none is on this machine."""


def lowest_text(pdf: bytes) -> list[float]:
    """Return the place of the lowest text of each sheet, as a share of its height from its top on."""
    found, objects = [], {int(each[1]): each[2] for each in re.finditer(rb"\n(\d+) 0 obj\s*(.*?)\nendobj", pdf, re.S)}
    for sheet in (each for each in objects.values() if re.search(rb"/Type\s*/Page\b", each)):
        content = objects[int(re.findall(rb"/Contents (\d+) 0 R", sheet)[0])]
        drawn = zlib.decompress(content[content.index(b"stream") + 6 :].lstrip(b"\r\n"))
        height = float(re.findall(rb"/MediaBox\s*\[[\d. ]*?([\d.]+)\]", sheet)[0])
        now, kept, lowest = np.eye(3), [], 1.0
        for numbers, kind, stacked in re.findall(rb"([-\d. ]+) (cm|Tm)\b|\b([qQ])\b", drawn):
            if stacked:
                now = kept.pop() if stacked == b"Q" else (kept.append(now), now)[1]
                continue
            own = np.vstack([np.array(numbers.split()[-6:], float).reshape(3, 2).T, [0, 0, 1]])
            if kind == b"cm":
                now = now @ own
            else:
                lowest = min(lowest, (now @ own)[1, 2] / height)
        found.append(1 - lowest)
    return found


@pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome is on this machine")
@pytest.mark.parametrize("n_note", [0, 44])
def test_no_printed_sheet_is_nearly_empty(n_note: int, tmp_path: Path, synthetic: SyntheticRun) -> None:
    """With these numbers of notes, the last one held the table of sensors alone."""
    notes = [
        f"Note {number} of this run, as long as notes of runs often are, and so over two lines of the sheet."
        for number in range(n_note)
    ]
    told = facts(notes=notes, sensors={name: {"frames": 60, "ms_mean": 2.0} for name in synthetic.rig.sensors})
    path = tmp_path / "report.html"
    write_report(path, told, [result(synthetic)], Site(synthetic.rig), truth=synthetic.truth)
    command = [str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer"]
    command += [f"--user-data-dir={tmp_path / 'browser'}", f"--print-to-pdf={path.with_suffix('.pdf')}", path.as_uri()]
    subprocess.run(command, capture_output=True, check=True, timeout=120)
    assert min(lowest_text(path.with_suffix(".pdf").read_bytes())) > 0.25


def test_stills_show_every_sensor_in_the_frame_with_the_most_tracks(synthetic: SyntheticRun) -> None:
    stills = SensorStills(Site(synthetic.rig, synthetic.outline))
    assert stills.draw() is None
    counts = [len(frame.tracks) for frame in synthetic.track_frames]
    for index, frame in enumerate(synthetic.track_frames):
        stills.keep_best(frame, synthetic.scans(index), None)
    pictures = stills.draw()
    assert pictures is not None
    assert pictures.stamp_ns == synthetic.track_frames[counts.index(max(counts))].stamp_ns
    assert [still.caption for still in pictures.stills] == [f"{name}, laser" for name in synthetic.rig.lasers()]
    for still in pictures.stills:
        picture = cv2.imdecode(np.frombuffer(still.jpeg, np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        assert picture.shape[1] / picture.shape[0] == pytest.approx(still.aspect)


PAGES = sorted(Path(twin.report.__file__).parents[1].glob("*/*.html.j2"))


def schemes(page: str) -> Iterator[dict[str, str]]:
    """Yield the colours of a page by name, light and dark."""
    light, dark = re.findall(r":root \{(.*?)\}", page, re.DOTALL)[:2]
    colours = dict(re.findall(r"--([\w-]+): (#\w{6})\b", light))
    yield colours
    yield colours | dict(re.findall(r"--([\w-]+): (#\w{6})\b", dark))


def luminance(colour: str) -> float:
    values = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [each / 12.92 if each <= 0.03928 else ((each + 0.055) / 1.055) ** 2.4 for each in values]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_text_of_every_page_has_the_contrast_of_wcag_aa_in_light_and_dark() -> None:
    pages = {each: text for each in PAGES if ":root {" in (text := each.read_text("utf-8"))}
    assert len(pages) >= 3
    for path, text in pages.items():
        names = set(re.findall(r"(?<![-\w])color: var\(--([\w-]+)\)", text))
        names |= set(re.findall(r"\btext[^{}]*\{[^}]*?(?<![-\w])fill: var\(--([\w-]+)\)", text))
        for colours in schemes(text):
            for name in names:
                for ground in ("paper", "card"):
                    light, dark = sorted((luminance(colours[name]), luminance(colours[ground])), reverse=True)
                    assert (light + 0.05) / (dark + 0.05) >= 4.5, f"{path.name}: {name} on {ground}"
