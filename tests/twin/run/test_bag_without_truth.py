"""`twin track` of what a robot would have recorded: observations and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin.recording.tables import read_tracks
from twin.recording.writer import BagWriter
from twin.run.replay import track_recording
from twin.scenario import load_scenario
from twin.world.simulation import Simulation

PRESETS = ("laser-vision-learning", "laser-vision-learning-laser", "laser-vision-learning-vision")
SMALL = ("duration_s=2", "sensors.camera.size=[320, 240]", "people={p01: {}, p02: {}, p03: {}}")


@pytest.mark.slow
def test_the_three_systems_track_a_bag_without_truth(tmp_path: Path) -> None:
    bag = tmp_path / "hall.mcap"
    described = load_scenario("library-hall-busy", SMALL)
    with Simulation(described) as simulation, BagWriter(bag, simulation.rig) as writer:
        for encoded in simulation.background_messages():
            writer.background(encoded)
        for delivered in simulation.deliveries():
            writer.observation(delivered.encoded, delivered.arrival_ns)
    result = track_recording(bag, trackers=PRESETS, out=tmp_path / "out")
    assert result.metrics is None or not result.metrics
    for name in PRESETS:
        assert len(set(read_tracks(tmp_path / "out" / "tracks" / f"{name}.csv").id.tolist())) >= 3
    assert (tmp_path / "out" / "preview.mp4").stat().st_size > 10_000
