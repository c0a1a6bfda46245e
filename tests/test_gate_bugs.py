"""The bugs that the gate is tested by: each can still be made, and all parts of the code have some."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from benchmarks.bugs import BUGS, Bug

ROOT = Path(__file__).parents[1]
EVERYWHERE = (
    *(
        f"trackers/{room}/"
        for room in ("filters", "tracking", "laser", "learning", "vision", "cameras", "floor", "environment")
    ),
    *(
        f"trackers/{system}"
        for system in (
            "laser_fisheye_imm/",
            "laser_vision_learning/",
            "camera_floor_particle/",
            "rgbd_head/",
            "sort.py",
        )
    ),
    *(f"twin/{room}/" for room in ("sensors", "truth", "recording", "evaluate")),
)


@pytest.mark.parametrize("bug", BUGS, ids=lambda bug: f"{bug.file}: {bug.name}")
def test_a_bug_can_be_made_and_still_compiles(bug: Bug, tmp_path: Path) -> None:
    (tmp_path / bug.file).parent.mkdir(parents=True)
    before = shutil.copy(ROOT / bug.file, tmp_path / bug.file).read_text(encoding="utf-8")
    bug.write(tmp_path)
    after = (tmp_path / bug.file).read_text(encoding="utf-8")
    assert after != before
    compile(after, bug.file, "exec")


def test_bugs_are_many_and_everywhere() -> None:
    assert len({(bug.file, bug.name) for bug in BUGS}) == len(BUGS) >= 44
    assert not [room for room in EVERYWHERE if not any(bug.file.startswith(room) for bug in BUGS)]
