"""The README is short, its example is ten lines, and its pictures show what they should."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
from readme.__main__ import SHOWN_CHANGES, SHOWN_SCENARIO

from twin.models import SENSOR_KINDS
from twin.scenario import load_scenario

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_readme_is_read_in_four_minutes() -> None:
    assert len(README.split()) <= 900


def test_the_python_example_has_at_most_ten_lines() -> None:
    (example,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len([line for line in example.splitlines() if line.strip()]) <= 10


def test_the_pictures_at_the_top_are_there_and_small() -> None:
    shown = [ROOT / path for path in re.findall(r"^!\[[^]]+\]\(([^)]+)\)$", README, re.MULTILINE)]
    assert [path.name for path in shown] == ["moment.webp", "walk.webp"]
    assert sum(path.stat().st_size for path in shown) <= 2_000_000
    done, walk = cv2.imdecodeanimation(np.fromfile(shown[1], dtype=np.uint8))
    assert done and 4000 <= int(np.sum(walk.durations)) <= 6000


def test_the_first_picture_is_drawn_of_every_kind_of_sensor() -> None:
    scenario = load_scenario(SHOWN_SCENARIO, list(SHOWN_CHANGES))
    assert {each.kind for each in scenario.sensors.values()} == set(SENSOR_KINDS)
    assert {each.role for each in scenario.sensors.values() if each.kind == "laser"} == {"waist", "knee"}
