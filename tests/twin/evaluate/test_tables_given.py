"""`twin evaluate` of tables that do not fit each other in time, and of what is no file."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import twin

STEP_S = 0.1


def table(path: Path, first: int, last: int, blank_to: int = 0, mot: int = 0) -> Path:
    """Write two people who walk to and fro at 1 m/s in frames first to last, then frames without people to `blank_to`."""
    rows = [] if mot else ["t,id,x,y"]
    for k in range(first, last):
        x = abs(k * STEP_S % 10 - 5)
        for who in (1, 2):
            rows.append(f"{k + 1},{who},-1,-1,-1,-1,1,{x},{who},0" if mot else f"{k * STEP_S:.1f},{who},{x},{who}")
    rows += [f"{k * STEP_S:.1f},,," for k in range(last, blank_to)]
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize(
    ("tracks", "said"),
    [
        ({"first": 0, "last": 100}, ("100 of 200 frames (50%)", "0.000 to 9.900 s", "0.000 to 19.900 s")),
        ({"first": 120, "last": 200}, ("120 of 200 frames (60%)", "12.000 to 19.900 s", "0.000 to 19.900 s")),
        ({"first": 0, "last": 100, "blank_to": 200}, ("50%", "0.000 to 9.900 s", "0.000 to 19.900 s")),
        ({"first": 0, "last": 100, "mot": 1}, ("50%", "0.000 to 9.900 s", "0.000 to 19.900 s")),
        ({"first": 120, "last": 200, "mot": 1}, ("60%", "12.000 to 19.900 s", "0.000 to 19.900 s")),
        ({"first": 0, "last": 0, "blank_to": 200}, ("holds no track in any of 200 frames",)),
        ({"first": 0, "last": 190, "blank_to": 200}, ()),
        ({"first": 2, "last": 199}, ()),
        ({"first": 3, "last": 195, "mot": 1}, ()),
    ],
)
def test_tracks_that_end_before_the_truth_are_said(
    tmp_path: Path, tracks: dict[str, int], said: tuple[str, ...]
) -> None:
    is_mot = bool(tracks.get("mot"))
    options = ["--format", "mot", "--frame-rate", "10"] if is_mot else []
    truth = table(tmp_path / "truth.csv", 0, 200, mot=is_mot)
    done = twin("evaluate", truth, table(tmp_path / "tracks.csv", **tracks), *options)
    assert done.returncode == 0
    warnings = [line for line in done.stderr.splitlines() if "warning" in line]
    assert len(warnings) == bool(said), warnings
    assert all(words in warnings[0] for words in said), warnings


@pytest.mark.parametrize(
    "arguments",
    ["evaluate - tracks.csv", "evaluate truth.csv -", "track -", "new rig -", "export - --format mot", "run x --out=-"],
)
def test_a_dash_is_no_file(arguments: str) -> None:
    done = twin(*arguments.split())
    assert (done.returncode, done.stdout) == (2, "")
    assert "'-' names no file here, neither stdin nor stdout; the name of a file is expected" in done.stderr


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("frameRate=10\nseqLength=0", "seqLength is 0; the number of frames, 1 or more, is expected"),
        ("frameRate=10\nseqLength=-4", "seqLength is -4; the number of frames"),
        ("frameRate=10\nseqLength=100000000000", "seqLength is 1e+11 frames; at most 1e+07"),
        ("frameRate=0\nseqLength=40", "frameRate is 0; a number of frames per second above 0 is expected"),
        ("frameRate=nan\nseqLength=40", "frameRate is nan; a number of frames"),
    ],
)
def test_a_sequence_that_cannot_be_is_refused(tmp_path: Path, line: str, said: str) -> None:
    (tmp_path / "gt").mkdir()
    (tmp_path / "seqinfo.ini").write_text(f"[Sequence]\n{line}\n")
    truth = table(tmp_path / "gt/gt.txt", 0, 40, mot=1)
    done = twin("evaluate", truth, truth, "--format", "mot")
    assert done.returncode == 2 and f"seqinfo.ini: {said}" in done.stderr, done.stderr
    plain = twin("evaluate", truth, truth)
    assert plain.returncode == 2 and plain.stderr.endswith("; MOT text is read by `twin evaluate --format mot`\n")
