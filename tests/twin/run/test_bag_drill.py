"""A part of the drill of robots' bags (`scripts/bench --only bags`): one mutant of each fault, none lost in silence."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.bag_drill import FAULTS, Content, clean_recording, drill, silence


@pytest.mark.sample(9)
@pytest.mark.parametrize("seed", range(len(FAULTS)))
def test_a_bag_with_a_fault_is_tracked_as_well_or_told_or_refused(seed, tmp_path):
    outcome = drill(seed, tmp_path)
    assert not outcome.fault, f"{outcome.what}: {outcome.fault}: {outcome.said}"


def test_the_drill_sees_what_is_lost_in_silence(tmp_path, monkeypatch):
    seed = FAULTS.index(silence)
    assert any(": silent for" in line for line in drill(seed, tmp_path).said)
    monkeypatch.setattr("twin.run.replay.lines", lambda losses: [])
    (tmp_path / "mute").mkdir()
    assert drill(seed, tmp_path / "mute").fault == "nothing reported"


def test_the_clean_bag_is_tracked_well():
    content = Content(list(clean_recording().messages), ".mcap")
    assert clean_recording().score > 0.9
    assert np.ptp([each.log_ns for each in content.messages]) > 11 * 10**9
