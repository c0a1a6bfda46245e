"""The scenario that a bag carries is compared with the limits before anything is made of it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from trackers.errors import InputError
from trackers.user_input.text_file import NO_LIMITS
from twin.run.inputs import scenario_of
from twin.scenario import load_scenario


def carried(changes: dict) -> Any:
    """A recording with a scenario of these fields in it."""
    content = load_scenario("lab-five-people").model_dump(mode="json", exclude_none=True)
    return SimpleNamespace(path="walk.mcap", scenario_yaml=yaml.safe_dump(content | changes, sort_keys=False))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"people": {f"p{k}": {"script": {"kind": "wander"}} for k in range(3000)}}, "people: 3000 are there"),
        ({"duration_s": 86_400.0, "background": "none"}, "duration_s: the recording would be"),
        ({"background_frames": 1000}, "background_frames: 1000 pictures"),
    ],
)
def test_a_scenario_in_a_bag_is_no_larger_than_one_that_runs(monkeypatch, changes, said):
    recording = carried(changes)
    with pytest.raises(InputError) as caught:
        scenario_of(recording)
    assert str(caught.value).startswith(f"walk.mcap, topic /scenario: {said}") and "--no-limits" in str(caught.value)
    monkeypatch.setenv(NO_LIMITS, "1")
    assert scenario_of(recording) is not None
