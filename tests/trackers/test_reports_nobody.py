"""A tracker that reports nobody says so, over every preset."""

from dataclasses import replace

import pytest
from test_tracker_contract import world_of

from trackers.presets import PRESETS, make_tracker
from trackers.prior import Prior
from trackers.tracks import finish_of
from twin.run import tracker_runner
from twin.run.inputs import ChosenTracker


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_that_reports_nobody_says_so(name, monkeypatch, tmp_path):
    """Whatever the cause; here its tracks are taken away. Options that a paper's preset needs are named, if not given."""
    on, room, observations = world_of(name)
    monkeypatch.setattr(tracker_runner, "_ENOUGH_FRAMES", 6)
    monkeypatch.setattr(tracker_runner, "make_tracker", lambda *given: WithoutTracks(make_tracker(*given)))
    for options in ({}, {"start": [{"place": (0.9, 0.0, 1.6), "yaw_deg": 0.0}]})[: 1 + bool(PRESETS[name].needs)]:
        runner = tracker_runner.TrackerRunner(ChosenTracker(name, name, options), on)
        runner.make(Prior.of(room), seed=1)
        with runner.writing(tmp_path / "tracks.csv"):
            for each in observations:
                runner.update(each)
            runner.finish()
        assert any("reports no track" in warning for warning in runner.warnings())
        named = [option for option in PRESETS[name].needs if any(f"`{option}`" in each for each in runner.warnings())]
        assert named == ([] if options else list(PRESETS[name].needs))


class WithoutTracks:
    """A tracker whose tracks are taken away."""

    def __init__(self, tracker):
        self.tracker = tracker

    def __getattr__(self, name):
        return getattr(self.tracker, name)

    def update(self, observation):
        return self.emptied(self.tracker.update(observation))

    def tracks(self):
        return []

    def finish(self):
        return self.emptied((finish_of(self.tracker) or list)())

    @staticmethod
    def emptied(frames):
        return [replace(frame, tracks=()) for frame in frames]
