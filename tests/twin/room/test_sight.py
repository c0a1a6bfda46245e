"""A sensor that sees nothing of where people walk is worth a warning."""

from __future__ import annotations

import numpy as np
import pytest

from trackers.errors import InputError
from twin.scenario import load_scenario
from twin.world.simulation import Simulation


def simulation(mount: str, kind: str = "camera", **more: str) -> Simulation:
    fields = "".join(f", {name}: {value}" for name, value in more.items())
    camera = f"sensors={{view: {{kind: {kind}, rate_hz: 5, mount: {mount}, field_of_view_deg: 60{fields}}}}}"
    return Simulation(load_scenario("lab-five-people", [camera, "duration_s=1"]))


def test_a_camera_that_sees_people_is_no_news():
    with simulation("{xyz: [0, 0.2, 1.5], yaw_deg: 90}") as seeing:
        assert seeing.warnings == ()
    with Simulation(load_scenario("lab-five-people", ["duration_s=1"])) as shipped:
        assert shipped.warnings == ()


@pytest.mark.parametrize("kind", ["camera", "stereo"])
def test_a_camera_that_looks_away_is_warned_of(kind: str):
    with simulation("{xyz: [0, 2.0, 1.5], pitch_deg: -80}", kind) as blind:
        (warning,) = blind.warnings
    assert "sensors.view.mount: it sees nothing of the walkable area" in warning


@pytest.mark.parametrize(
    ("mount", "more"),
    [
        ("{xyz: [0, 3.4, 0.95], yaw_deg: 90}", {}),
        ("{xyz: [0, 0.2, 2.4], yaw_deg: 90}", {}),
        ("{xyz: [0, 0.2, 0.4], yaw_deg: 90}", {"range_max_m": "0.1"}),
    ],
)
def test_a_scanner_that_meets_nobody_is_warned_of(mount: str, more: dict[str, str]):
    with simulation(mount, "laser", **more) as blind:
        (warning,) = blind.warnings
    assert "sensors.view.mount: it sees nothing of the walkable area" in warning


@pytest.mark.parametrize("height_m", np.arange(0.05, 1.75, 0.05).round(2))
def test_a_scanner_at_any_height_of_people_is_no_news(height_m: float):
    with simulation(f"{{xyz: [0, 0.2, {height_m}], yaw_deg: 90}}", "laser") as seeing:
        assert seeing.warnings == ()


def test_a_right_eye_in_the_wall_is_refused():
    with pytest.raises(InputError, match=r"sensors\.view\.mount\.xyz: .* is inside"):
        simulation("{xyz: [2.9, 2.0, 1.5], yaw_deg: 90}", "stereo", baseline_m="0.5")
    with simulation("{xyz: [2.9, 2.0, 1.5], yaw_deg: 180}", "stereo", baseline_m="0.5") as fine:
        assert len(fine.rig.cameras()) == 1
