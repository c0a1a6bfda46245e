"""One table of who is where when, said in many layouts: the same values, for paths of people, truth and tracks."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from typer.testing import CliRunner

from trackers.errors import InputError
from twin.cli import app, main
from twin.evaluate import evaluate_with_details
from twin.recording.tables import read_tracks, read_truth
from twin.scenario.pedestrians import Pedestrians, people_from
from twin.tables.contents import check_plausibility
from twin.tables.person_rows import read_person_rows

RATE_HZ = 10
CASES = Path(__file__).parents[4] / "shared" / "cases" / "21-csv-dialects"


def walk(speed_m_s: float = 1.3, n_row: int = 30, step: int = 4) -> list[tuple[int, int, float, float]]:
    """Rows of frame, id, x, y [m] by frame: four people who cross a square."""
    rng = np.random.default_rng(11)
    start, angle = rng.uniform(-9, 9, (4, 2)), rng.uniform(0, 2 * np.pi, 4)
    rows = []
    for k in range(n_row):
        for who in range(4):
            way = speed_m_s * k * step / RATE_HZ
            x, y = start[who] + way * np.array([np.cos(angle[who]), np.sin(angle[who])])
            rows.append((k * step, who + 3, round(float(x), 3), round(float(y), 3)))
    return rows


ROWS = walk()


def table(separator: str, names: str, cells, rows=ROWS, end: str = "\n") -> str:
    lines = [separator.join(names.split(" "))] if names else []
    return end.join(lines + [separator.join(cells(*row)) for row in rows]) + end


def plain(f, i, x, y):
    return f"{f / RATE_HZ:.1f}", str(i), f"{x:.3f}", f"{y:.3f}"


def dated(f: int, between: str, zone: str) -> str:
    return f"1970-01-01{between}{f // 36000:02d}:{f // 600 % 60:02d}:{f // 10 % 60:02d}.{f % 10}{zone}"


def frames(f, i, x, y):
    return str(f), str(i), f"{x:.3f}", f"{y:.3f}"


def comma(cell: str) -> str:
    return cell.replace(".", ",")


BASE = table(",", "t id x y", plain)
SECONDS = {
    "as the twin": BASE,
    "byte order mark": "\ufeff" + BASE,
    "quotes": table(",", "t id x y", lambda *r: [f'"{c}"' for c in plain(*r)]).replace("t,id,x,y", '"t","id","x","y"'),
    "other order": table(",", "y id t x", lambda *r: [plain(*r)[k] for k in (3, 1, 0, 2)]),
    "capitals": table(",", "T ID X Y", plain),
    "mixed case": table(",", "Time Track_ID Pos_X Pos-Y", plain),
    "semicolons": table(";", "t id x y", plain),
    "decimal commas": table(";", "t id x y", lambda *r: map(comma, plain(*r))),
    "tabs": table("\t", "t id x y", plain),
    "blanks": table("   ", "t id x y", plain),
    "blanks after commas": table(", ", "t id x y", plain),
    "comments": "# by hand\n% twice\n// thrice\n" + BASE.replace("\n0.4", "\n# later\n0.4", 1),
    "header in a comment": "# made here\n# " + BASE,
    "row of units": BASE.replace("t,id,x,y\n", "t,id,x,y\ns,-,m,m\n"),
    "row of units in brackets": BASE.replace("t,id,x,y\n", "t,id,x,y\n[s],[],[m],[m]\n"),
    "centimetres": table(
        ",", "t id x/cm y/cm", lambda f, i, x, y: (*plain(f, i, x, y)[:2], f"{x * 100:.1f}", f"{y * 100:.1f}")
    ),
    "millimetres below": "t,id,x,y\ns,,mm,mm\n"
    + table(",", "", lambda f, i, x, y: (*plain(f, i, x, y)[:2], f"{x * 1000:.0f}", f"{y * 1000:.0f}")),
    "milliseconds": table(",", "t[ms] id x[m] y[m]", lambda f, i, x, y: (str(f * 100), *plain(f, i, x, y)[1:])),
    "Windows": BASE.replace("\n", "\r\n"),
    "rows in another order": "t,id,x,y\n" + "".join(sorted(BASE.splitlines(keepends=True)[1:])[::-1]),
    "ids as floats": table(
        ",", "t id x y", lambda f, i, x, y: (plain(f, i, x, y)[0], f"{i}.0", *plain(f, i, x, y)[2:])
    ),
    "separator at the end": table(",", "t id x y", lambda *r: (*plain(*r), "")),
    "foreign columns": table(",", "note t id x y", lambda *r: ("a", *plain(*r))),
    "a spreadsheet's first line": "sep=;\n" + table(";", "t id x y", plain),
    "seconds without header": table(" ", "", plain),
    "UTF-16": BASE,
    "quoted decimal commas": table(",", "t id x y", lambda *r: [f'"{comma(c)}"' for c in plain(*r)]),
    "blanks and decimal commas": table(" ", "t id x y", lambda *r: map(comma, plain(*r))),
    "bars": table("|", "t id x y", plain),
    "seconds and nanoseconds": table(
        ",", "sec nanosec id x y", lambda f, *r: (str(f // 10), str(f % 10 * 10**8), *plain(f, *r)[1:])
    ),
    "units of everything": table(",", "t|[s] id|[-] x|[m] y|[m] vx|[m/s]", lambda *r: (*plain(*r), "0")).replace(
        "|", " "
    ),
    "pixels beside metres": table(
        ",", "t id x|[px] y|[px] x|[m] y|[m]", lambda *r: (*plain(*r)[:2], "9", "9", *plain(*r)[2:])
    ).replace("|", " "),
    "a frame beside the time": table(
        ",", "Frame Time|(Seconds) name X Y", lambda f, *r: (str(f), *plain(f, *r))
    ).replace("|", " "),
    "messages of ROS in columns": table(
        ",",
        "header.stamp.sec header.stamp.nanosec field.id pose.pose.position.x pose.pose.position.y pose.pose.orientation.w",
        lambda f, *r: (str(f // 10), str(f % 10 * 10**8), *plain(f, *r)[1:], "1"),
    ),
    "nanoseconds alone": table(",", "stamp_nanosec id x y", lambda f, *r: (str(f * 10**8), *plain(f, *r)[1:])),
    "dates": table(",", "timestamp id x y", lambda f, *r: (dated(f, "T", "Z"), *plain(f, *r)[1:])),
    "dates with an offset": table(",", "t id x y", lambda f, *r: (dated(f + 72000, " ", "+0200"), *plain(f, *r)[1:])),
    "dates without a zone": table(",", "datetime id x y", lambda f, *r: (dated(f, " ", ""), *plain(f, *r)[1:])),
    "ids beyond 64 bits": table(
        ",", "t id x y", lambda f, i, x, y: (plain(f, i, x, y)[0], str(i + 2**70), *plain(f, i, x, y)[2:])
    ),
}
FRAMES = {
    "TrajNet": table("\t", "", lambda f, i, x, y: (f"{f}.0", f"{i}.0", f"{x:.3f}", f"{y:.3f}")),
    "TrajNet by person": table(" ", "", frames, sorted(ROWS, key=lambda row: (row[1], row[0]))),
    "id before frame": table(" ", "", lambda f, i, x, y: (str(i), str(f), f"{x:.3f}", f"{y:.3f}")),
    "obsmat": table("  ", "", lambda f, i, x, y: (f"{f:e}", f"{i:e}", f"{x:.9e}", "0.0", f"{y:.9e}", "0", "0", "0")),
    "heights last": table(" ", "", lambda f, i, x, y: (*frames(f, i, x, y), f"{1.7 + 0.01 * (f % 3):.2f}")),
    "frame in a header": table(",", "Frame ID X Y", frames),
}
PETRACK = {
    "PeTrack": "# description: a hall\n# framerate: 10.00 fps\n# id frame x/m y/m z/m\n"
    + table(" ", "", lambda f, i, x, y: (str(i), str(f), f"{x:.3f}", f"{y:.3f}", "1.72")),
    "PeTrack in cm": "# framerate: 10\n# id frame x/cm y/cm z/cm\n"
    + table(" ", "", lambda f, i, x, y: (str(i), str(f), f"{x * 100:.1f}", f"{y * 100:.1f}", "172")),
    "PeTrack, unit in a comment": "# framerate: 10 fps\n# x, y in cm\n# PersID\tFrame\tX\tY\tZ\n"
    + table("\t", "", lambda f, i, x, y: (str(i), str(f), f"{x * 100:.1f}", f"{y * 100:.1f}", "172")),
}
LAYOUTS = {
    **{name: (text, None) for name, text in {**SECONDS, **PETRACK}.items()},
    **{name: (text, RATE_HZ) for name, text in FRAMES.items()},
}


def values(text: str, folder: Path, rate_hz: float | None = None, is_utf16: bool = False):
    path = folder / "table.csv"
    path.write_bytes(text.encode("utf-16" if is_utf16 else "utf-8"))
    people, warnings = people_from(Pedestrians(file=str(path), frame_rate_hz=rate_hz), 100.0, "s.yaml")
    points = {name: np.array(person["script"][0]["points"]) for name, person in people.items()}
    return points, read_truth(path, None, rate_hz), read_tracks(path, None, rate_hz), warnings


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_same_table_said_otherwise_gives_the_same_values(layout: str, tmp_path: Path) -> None:
    expected = values(BASE, tmp_path)
    text, rate_hz = LAYOUTS[layout]
    found = values(text, tmp_path, rate_hz, layout == "UTF-16")
    assert list(expected[0]) == ["walker-3", "walker-4", "walker-5", "walker-6"]
    if layout != "ids beyond 64 bits":
        assert list(found[0]) == list(expected[0])
    for points, other in zip(found[0].values(), expected[0].values(), strict=True):
        np.testing.assert_allclose(points, other, rtol=0, atol=1e-12)
    for own, other in zip(found[1:3], expected[1:3], strict=True):
        for column in ("frame_stamps_ns", "stamps_ns", "id"):
            shift = 2 if column == "id" and layout == "ids beyond 64 bits" else 0  # such ids are names, counted from 1
            np.testing.assert_array_equal(getattr(own, column) + shift, getattr(other, column))
        for column in ("x", "y"):
            np.testing.assert_allclose(getattr(own, column), getattr(other, column), rtol=0, atol=1e-12)
    guessed = any("has no header; its columns are read as" in note for note in found[3])
    assert guessed == ((layout in FRAMES and layout != "frame in a header") or layout == "seconds without header")
    assert set(found[1].notes) == {note.removeprefix("pedestrians: ") for note in found[3]}


@pytest.mark.parametrize(
    "names",
    [
        {3: "ann", 4: "ben", 5: "cem", 6: "dee"},
        {3: "0", 4: "1", 5: "2", 6: "x-9"},
        {3: "1_4", 4: "_", 5: "b_c", 6: "ped_3"},
    ],
)
def test_ids_may_be_names(names: dict[int, str], tmp_path: Path) -> None:
    text = table(",", "t id x y", lambda f, i, x, y: (plain(f, i, x, y)[0], names[i], *plain(f, i, x, y)[2:]))
    points, truth, tracks, _ = values(text, tmp_path)
    assert list(points) == [f"walker-{name}" for name in names.values()]
    np.testing.assert_array_equal(truth.id, read_truth_of(BASE, tmp_path).id - 2)
    np.testing.assert_array_equal(tracks.id, truth.id)
    path = tmp_path / "table.csv"
    path.write_text(text)
    one, _ = people_from(Pedestrians(file=str(path), ids=(names[6],)), 100.0, "s.yaml")
    assert list(one) == [f"walker-{names[6]}"]


def read_truth_of(text: str, folder: Path):
    (folder / "base.csv").write_text(text)
    return read_truth(folder / "base.csv")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (BASE.encode("utf-16-le"), "line 1: holds NUL characters"),
        (BASE.encode() + b"1," * 60_000, f"line {len(ROWS) + 2}: has 120000 characters; at most 100000"),
        ("# Größe\nt,id,x,y\n".encode("latin-1"), "is not a text file in UTF-8 (line 1)"),
        (b"\x1f\x8b\x08 and more", "is packed (gzip); a"),
        (b"PK\x03\x04 and more", "is packed (zip, or a spreadsheet)"),
        (BASE.encode() + bytes(99), f"line {len(ROWS) + 2}: holds NUL characters"),
        (
            b"t,id,x,y\n1713883987987,1,2,3\n",
            "line 2: t is '1713883987987'; a time in seconds, or a header with the unit, as t_ms, is expected",
        ),
        (
            b"t,id,x,y\n1e999999999,1,2,3\n",
            "line 2: t is '1e999999999'; a time in seconds is expected",
        ),
        (
            b"t,id,x,y\n2024-13-01T12:00:00Z,1,2,3\n",
            "a time in seconds, or a date and time as 2024-03-01T12:00:00.5Z, is",
        ),
        (b"t,id,x,y\n0,1,1e300,3\n", "line 2: x is '1e300'; a number of at most 1e+12 is"),
        (b"", "is empty"),
        (b"# nothing\n", "is empty"),
        (b"t,id,x\n0,1,2\n", "line 1: column 'y' is missing among t,id,x"),
        (b"t,id,x,y\n0,1,2\n", "line 2: has 3 cells; 4 as in the header are expected"),
        (b"# c\nt;id;x;y\n0;1;1,5;2.5\n", "line 3: x is '1,5'; a finite number is expected"),
        (b"t,id,x,y\n0,1,1e,2\n", "line 2: x is '1e'; a finite number is expected"),
        (b"t,id,x,X,y\n", "columns 'x' and 'X' both say x"),
        (b"t,id,x,pos_x,y\n", "columns 'x' and 'pos_x' both say x"),
        (b"t,id,x/cm,y/m\n", "x and y have different units"),
        (b"t,id,x/s,y\n", "column 'x/s': 's' is no unit of it"),
        (
            b"t,id,x [ft],y [ft]\n",
            "column 'x' is missing among t,id,x [ft],y [ft] ('x [ft]': no such unit); "
            "columns t (or frame), id, x, y are expected, with units of m, ",
        ),
        (b"t (min),id,x,y\n", "column 't' is missing among t (min),id,x,y ('t (min)': no such unit); columns"),
        (b"1,2,3,4,5,6,1,-1,-1,-1\n", "has no header and 10 columns"),
        (b"frame,id,x,y\n0,1,2,3\n", "frame_rate_hz: is missing"),
        (b"# framerate: 5\n# framerate: 6\nframe,id,x,y\n0,1,2,3\n", "says 5 (line 1) and 6 (line 2) frames a second"),
        (b"t,id,x,y\n0,-1,2,3\n", "line 2: id is '-1'; a whole number from 0 on, or a name, is expected"),
    ],
)
@pytest.mark.parametrize(
    "read", [read_truth, read_tracks, lambda path: people_from(Pedestrians(file=str(path)), 9, "s")]
)
def test_a_table_that_says_nothing_sure_is_refused_in_a_sentence(read, text: bytes, said: str, tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_bytes(text)
    with pytest.raises(InputError, match=re.escape(said)) as refused:
        read(path)
    assert "\n" not in str(refused.value) and str(path) in str(refused.value)


@pytest.mark.parametrize("factor", [0.1, 0.3, 1.0, 1.5, 3.0, 30.0, 100.0, 1000.0])
@pytest.mark.parametrize("layout", ["t", "frame", "frame t"])
def test_a_speed_at_which_no_person_walks_is_noted_or_refused(factor: float, layout: str, tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    cells = {"t": plain, "frame": frames, "frame t": lambda f, *r: (str(f), *plain(f, *r))}[layout]
    path.write_text(table(",", f"{layout} id x y", cells, walk(1.3 * factor)))
    rate_hz = RATE_HZ if layout == "frame" else None
    if 1.3 * factor > 12:
        for read in (
            lambda: read_truth(path, None, rate_hz),
            lambda: check_plausibility(read_person_rows(path, "a table", None, rate_hz)),
        ):
            with pytest.raises(InputError, match=r"people walk at .* m/s in the median.* expected"):
                read()
        return
    (*notes,) = check_plausibility(read_person_rows(path, "a table", None, rate_hz, "rate"))
    assert bool(notes) == (not 0.5 <= 1.3 * factor <= 2.5)
    assert all("m/s in the median" in note for note in notes)
    if notes and layout == "frame":
        fits = float(re.findall(r"frame rate of about ([\d.e+]+) Hz would fit", notes[0])[0])
        assert check_plausibility(read_person_rows(path, "a table", None, fits, "rate")) == ()


@pytest.mark.parametrize(
    ("said", "text"),
    [
        ("1 of 121 rows, the first on line 122, have neither x nor y", BASE + "0.2,3,nan,NA\n"),
        ("1 rows, as that on line 122, stand there twice", BASE + BASE.splitlines()[-1]),
        ("1 of them, the first line 122, look like rows", BASE + "#7,0.2,1,2\n"),
    ],
)
def test_rows_that_are_not_read_are_noted(said: str, text: str, tmp_path: Path) -> None:
    own, base = values(text, tmp_path), values(BASE, tmp_path)
    np.testing.assert_array_equal(own[1].x, base[1].x)
    for notes in (own[1].notes, own[2].notes, own[3]):
        assert any(said in note for note in notes)


def test_tracks_that_share_no_stamps_are_noted(tmp_path: Path) -> None:
    truth = read_truth_of(BASE, tmp_path)
    path = tmp_path / "table.csv"
    path.write_text(
        table(",", "t id x y", lambda f, i, x, y: (f"{f / RATE_HZ + i * 1e-6:.6f}", *plain(f, i, x, y)[1:]))
    )
    assert any("no two tracks share a stamp" in note for note in evaluate_with_details(truth, read_tracks(path)).notes)
    assert evaluate_with_details(read_truth(path), read_tracks(tmp_path / "base.csv")).metrics["mota"] == 1.0


@pytest.mark.parametrize("height", [0.0, 1.7])
def test_a_column_that_looks_like_a_height_is_said(height: float, tmp_path: Path) -> None:
    rows = [(f, i, x, height + 0.02 * ((f + i) % 3)) for f, i, x, _ in ROWS]
    path = tmp_path / "table.csv"
    path.write_text(table(",", "t id x y", plain, rows))
    assert any("y looks like a height" in note for note in read_truth(path).notes)
    across = [(*plain(*row), f"{other[3]:.3f}") for row, other in zip(rows, ROWS, strict=True)]
    path.write_text("t,id,x,y,z\n" + "\n".join(map(",".join, across)))
    with pytest.raises(InputError, match="y looks like a height.* calls the two coordinates of the floor x and y"):
        read_truth(path)


def test_a_rate_with_seconds_or_against_the_files_own_is_noted(tmp_path: Path) -> None:
    assert any("holds seconds (t)" in note for note in values(BASE, tmp_path, RATE_HZ)[3])
    notes = values(PETRACK["PeTrack"].replace("10.00", "12"), tmp_path, RATE_HZ)[3]
    assert any("line 2 says 12 frames a second" in note and "10 is used" in note for note in notes)


@pytest.mark.skipif(not CASES.is_dir(), reason="the cases are not here")
@pytest.mark.parametrize("name", ["bom", "comment", "quoted", "semi", "upper"])
def test_the_tables_that_failed_are_read(name: str) -> None:
    assert len(people_from(Pedestrians(file=str(CASES / f"{name}.csv")), 100.0, "s.yaml")[0]) == 3


def test_twin_evaluate_takes_both_tables_in_any_layout(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "truth.txt").write_text(FRAMES["TrajNet"])
    (tmp_path / "tracks.csv").write_text(SECONDS["decimal commas"])
    tables = str(tmp_path / "truth.txt"), str(tmp_path / "tracks.csv")
    monkeypatch.setattr(sys, "argv", ["twin", "evaluate", *tables, "--frame-rate", str(RATE_HZ)])
    with pytest.raises(SystemExit) as done:
        main()
    noted = capfd.readouterr()
    assert done.value.code in (0, None)
    metrics = json.loads(noted.out)
    assert (metrics["mota"], metrics["judged"]["frames"]) == (1.0, 30)
    assert "has no header; its columns are read as frame, id, x, y" in noted.err


ORDERS = {
    "frame id x y": "fixy",
    "id frame x y": "ifxy",
    "frame id x z y": "fixzy",
    "id frame x z y": "ifxzy",
    "frame id x y z": "fixyz",
    "id frame x y z": "ifxyz",
}


@given(
    speeds_m_s=st.lists(st.floats(0.02, 4.0), min_size=1, max_size=4),
    apart_m=st.floats(0.4, 6.0),
    heading_rad=st.floats(-np.pi, np.pi),
    step=st.sampled_from([1, 4, 10]),
    n_row=st.integers(5, 40),
    height_m=st.sampled_from([0.0, 0.9, 1.7]),
    in_cm=st.booleans(),
    by_person=st.booleans(),
    seed=st.integers(0, 99),
)
@settings(deadline=None, max_examples=150)
def test_a_table_without_a_header_is_read_as_it_is_or_a_header_is_asked_for(
    speeds_m_s, apart_m, heading_rad, step, n_row, height_m, in_cm, by_person, seed, tmp_path_factory
) -> None:
    rng = np.random.default_rng(seed)
    along = np.array([np.cos(heading_rad), np.sin(heading_rad)])
    rows = []
    for who, speed_m_s in enumerate(speeds_m_s):
        start = apart_m * (who + rng.uniform(0, 0.3)) * along[::-1] * [-1, 1]
        for k in range(n_row):
            x, y = start + speed_m_s * step * k / RATE_HZ * along + rng.normal(0, 0.01, 2)
            rows.append(dict(zip("fixyz", (k * step, who + 1, x, y, height_m + 0.02 * (who % 3)), strict=True)))
    rows.sort(key=(lambda row: (row["i"], row["f"])) if by_person else (lambda row: (row["f"], row["i"])))
    unit = 100 if in_cm else 1
    path = tmp_path_factory.mktemp("orders") / "table.txt"
    for columns in ORDERS.values():
        cells = [[str(row[c]) if c in "fi" else f"{row[c] * unit:.4f}" for c in columns] for row in rows]
        path.write_text("# x, y in cm\n" * in_cm + "".join(" ".join(each) + "\n" for each in cells))
        try:
            found = read_person_rows(path, "a table", None, RATE_HZ)
        except InputError as error:
            if "a header with the columns" not in str(error):
                raise
            continue
        places = (found.rows.numbers(c, may_be_empty=False) for c in "xy")
        read = zip(found.stamps_ns, found.labels, *places, strict=True)
        expected = sorted((round(row["f"] / RATE_HZ * 1e9), str(row["i"]), row["x"], row["y"]) for row in rows)
        for own, other in zip(sorted(read), expected, strict=True):
            assert own[:2] == other[:2] and own[2:] == pytest.approx(other[2:], abs=1e-3), found.notes


@pytest.mark.parametrize("columns", ORDERS.values(), ids=ORDERS)
@pytest.mark.parametrize("speed_m_s", [0.08, 0.125, 1.3, 3.0])
@pytest.mark.parametrize(("n_people", "is_line"), [(2, False), (3, False), (3, True), (4, True), (6, False)])
def test_people_side_by_side_are_read_in_any_order_of_columns(
    speed_m_s: float, n_people: int, is_line: bool, columns: str, tmp_path: Path
) -> None:
    """Also such as sway together, in a line straighter than their paths."""
    path = tmp_path / "table.txt"
    rows = [
        (f, i, speed_m_s * f / RATE_HZ, 1.1 * i + (0.05 * np.sin(f) if is_line else 0.2 * (i % 3)), 0)
        for f in range(0, 200, 4)
        for i in range(1, n_people + 1)
    ]
    named = [dict(zip("fixyz", row, strict=True)) for row in rows]
    path.write_text("".join(" ".join(str(row[c]) for c in columns) + "\n" for row in named))
    try:
        found = read_person_rows(path, "a table", None, RATE_HZ)
    except InputError as error:  # where their steps are as long as their distances, or as their sway
        if not is_line or speed_m_s == 1.3 or "a header with the columns" not in str(error):
            raise
        return
    np.testing.assert_allclose(found.rows.numbers("y", may_be_empty=False), [row[3] for row in rows])
    assert found.labels == [str(row[1]) for row in rows]
    assert bool(check_plausibility(found)) == (speed_m_s != 1.3)


def test_mot_text_gives_the_metrics_of_the_tables_it_was_made_from(tmp_path: Path) -> None:
    """MOT text has no row for a frame without people; seqinfo.ini says how many frames there are, and their rate."""
    folder = tmp_path / "sequence/gt"
    folder.mkdir(parents=True)
    (folder / "gt.txt").write_text("1,1,-1,-1,-1,-1,1,0,0,0\n2,1,-1,-1,-1,-1,1,0.1,0,0\n2,2,-1,-1,-1,-1,0,5,5,0\n")
    (folder.parent / "seqinfo.ini").write_text("[Sequence]\nname=sequence\nframeRate=10\nseqLength=4\n")
    (tmp_path / "tracks.txt").write_text("1,7,-1,-1,-1,-1,1,0,0.1,0\n4,7,-1,-1,-1,-1,1,3,3,0\n")
    (tmp_path / "truth.csv").write_text(
        "y,t,x,id,in_area\n0,0,0,ann,1\n0,0.1,0.1,ann,1\n5,0.1,5,bob,0\n,0.2,,,\n,0.3,,,\n"
    )
    (tmp_path / "tracks.csv").write_text("id,x,y,t\nu,0,0.1,0\n,,,0.1\n,,,0.2\nu,3,3,0.3\n")

    def evaluated(*arguments: str) -> tuple[dict, str]:
        result = CliRunner().invoke(app, ["evaluate", *arguments])
        assert result.exit_code == 0, result.output
        return json.loads(result.stdout), result.stderr

    of_text, told = evaluated(str(folder / "gt.txt"), str(tmp_path / "tracks.txt"), "--format", "mot")
    of_tables, _ = evaluated(str(tmp_path / "truth.csv"), str(tmp_path / "tracks.csv"))
    assert of_text == of_tables
    assert (of_text["misses"], of_text["false_positives"]) == (1, 1)
    assert "4 frames judged, 0 to 0.3 s" in told and "seqinfo.ini: 10 frames a second, 4 frames\n" in told

    text, info = (folder / "gt.txt").read_text(), (folder.parent / "seqinfo.ini").read_text()
    for number, (place, of_info) in enumerate(
        [
            ("det/det.txt", "seqinfo.ini"),
            ("sequence.txt", "seqinfo.ini"),
            ("trackers/all/sort/data/walk.txt", "gt/all/walk/seqinfo.ini"),
        ]
    ):
        alone = {"truth": tmp_path / "alone.txt", "tracks": tmp_path / "tracks.txt"}
        alone["truth"].write_text(text)
        beside = tmp_path / f"{number}" / of_info
        for kind, content in (("tracks", alone["tracks"].read_text()), ("truth", text)):
            of_sequence = tmp_path / f"{number}" / place
            for each, held in ((of_sequence, content), (beside, info)):
                each.parent.mkdir(parents=True, exist_ok=True)
                each.write_text(held)
            found, told = evaluated(*map(str, {**alone, kind: of_sequence}.values()), "--format", "mot")
            assert found == of_text and f"{beside}: 10 frames a second, 4 frames\n" in told
        _, told = evaluated(str(of_sequence), str(alone["tracks"]), "--format", "mot", "--frame-rate", "9")
        assert "10 frames a second, 4 frames; --frame-rate 9 is used" in told
    refused = CliRunner().invoke(app, ["evaluate", *[str(tmp_path / "tracks.txt")] * 2, "--format", "mot"])
    assert "the seqinfo.ini of a MOT sequence" in str(refused.exception)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1,1,3,4,5,6,1,1,0.5\n", "9 columns"),
        ("1,1,3,4,5,6,1,-1,-1,-1\n", "boxes in pictures alone"),
        ("t,id\n", "header"),
    ],
)
def test_mot_text_without_places_on_the_ground_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "gt.txt"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        read_truth(path, frame_rate_hz=10, mot=True)
