"""People placed so that everybody knows what must come out: in line with a scanner, side by side, one behind another."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from interactions import interactions_of

from trackers.configuration import validate
from trackers.observations import NS_PER_S
from trackers.rig import FisheyeSensor
from twin.recording.situation_table import situation_table
from twin.recording.tables import truth_table
from twin.scenario import Scenario, load_scenario
from twin.truth.truth_types import BoxFrame, RayFrame, Situation, TruthDetail, TruthFrame
from twin.truth.visibility import PersonImaging
from twin.world.simulation import Simulation

WAIST = {"kind": "laser", "rate_hz": 10, "noise": "off", "mount": {"xyz": [0, 0, 1.0]}}
AREA = [[-6, -6], [6, -6], [6, 6], [-6, 6]]


def standing(x: float, y: float, heading_deg: float = 90.0) -> dict[str, Any]:
    return {"start": [x, y], "heading_deg": heading_deg, "script": {"kind": "stand"}}


def scenario(people: dict[str, Any], sensors: dict[str, Any], duration_s: float = 0.35, **more: Any) -> Scenario:
    content = {"name": "test", "room": "plaza", "people": people, "sensors": sensors, "background": "none"}
    return validate(Scenario, content | {"area": AREA, "duration_s": duration_s} | more, "test")


def details_of(described: Scenario, *, images: bool = True) -> tuple[list[TruthDetail], list[TruthFrame]]:
    details: list[TruthDetail] = []
    truth: list[TruthFrame] = []
    with Simulation(described, images=images, on_truth=truth.append, on_detail=details.append) as simulation:
        for _ in simulation:
            pass
    return details, truth


def situations(details: list[TruthDetail], kind: str) -> list[Situation]:
    return [each for each in details if isinstance(each, Situation) and each.kind == kind]


def rays(details: list[TruthDetail]) -> list[RayFrame]:
    return [each for each in details if isinstance(each, RayFrame)]


def test_of_two_in_line_with_the_scanner_the_second_is_hidden():
    details, _ = details_of(scenario({"a": standing(2, 0), "b": standing(3, 0)}, {"waist": WAIST}))
    assert {run.id for frame in rays(details) for run in frame.runs} == {1}
    assert [frame.stamp_ns for frame in rays(details)] == [0, 100_000_000, 200_000_000, 300_000_000]
    (merged,) = situations(details, "merged")
    assert (merged.first_id, merged.second_id, merged.sensor, merged.how) == (1, 2, "waist", "hidden")
    assert (merged.start_ns, merged.end_ns, merged.complete) == (0, 350_000_000, False)
    assert merged.least_m == pytest.approx(1.0, abs=0.05)
    (interaction,) = situations(details, "interaction")
    assert interaction.least_m == pytest.approx(1.0, abs=0.05)
    assert situations(details, "correlated") == []


def test_who_is_hidden_from_afar_is_occluded_and_no_more():
    details, _ = details_of(scenario({"a": standing(2, 0), "b": standing(4, 0)}, {"waist": WAIST}))
    assert {run.id for frame in rays(details) for run in frame.runs} == {1}
    assert not [each for each in details if isinstance(each, Situation)]


def test_who_lies_out_of_the_scan_is_not_merged():
    """Nobody hides whom the beams would pass over anyway."""
    high = WAIST | {"mount": {"xyz": [0, 0, 1.9]}}
    people = {"a": standing(2, 0) | {"height_m": 2.1}, "b": standing(3, 0) | {"height_m": 1.6}}
    details, _ = details_of(scenario(people, {"high": high}))
    assert {run.id for frame in rays(details) for run in frame.runs} == {1}
    assert situations(details, "merged") == []


def test_shoulder_to_shoulder_they_are_joined_and_correlated():
    """Facing the scanner, 0.5 m apart from middle to middle."""
    people = {"a": standing(2.5, -0.25, 180), "b": standing(2.5, 0.25, 180)}
    details, _ = details_of(scenario(people, {"waist": WAIST}))
    (merged,) = situations(details, "merged")
    assert merged.how == "joined"
    (correlated,) = situations(details, "correlated")
    assert (correlated.first_id, correlated.second_id, correlated.sensor) == (1, 2, "")
    assert correlated.least_m < 0.15


def test_apart_side_by_side_they_are_correlated_and_not_merged():
    people = {"a": standing(2.5, -0.37, 180), "b": standing(2.5, 0.37, 180)}
    details, _ = details_of(scenario(people, {"waist": WAIST}))
    assert situations(details, "merged") == []
    (correlated,) = situations(details, "correlated")
    assert 0.1 < correlated.least_m < 0.3
    assert len(situations(details, "interaction")) == 1


def test_who_walks_behind_another_merges_and_splits():
    """Past somebody at 2 m, at 3 m and 1 m/s: the shadow of a body half a metre wide is 0.75 m wide there."""
    path = {"kind": "path", "points": [[0.0, 3.0, -1.5], [3.0, 3.0, 1.5]]}
    people = {"a": standing(2, 0, 180), "b": {"script": path}}
    fast = WAIST | {"rate_hz": 40, "resolution_deg": 0.25}
    details, truth = details_of(scenario(people, {"waist": fast}, 3.0))
    merged = [each for each in situations(details, "merged") if each.complete]
    assert merged
    assert {each.how for each in merged} == {"hidden"}
    assert merged[0].start_ns / NS_PER_S > 1.2
    assert merged[-1].end_ns / NS_PER_S < 1.8
    met = {frame.stamp_ns: {run.id for run in frame.runs} for frame in rays(details)}
    for frame in truth:
        inside = any(each.start_ns <= frame.stamp_ns < each.end_ns for each in merged)
        assert inside == (2 not in met[frame.stamp_ns]) or len(frame.people) < 2
    (interaction,) = situations(details, "interaction")
    assert interaction.complete
    # 1 m behind: nearer than 1.5 m while within sqrt(1.5² - 1²) m to the side
    half = np.sqrt(1.5**2 - 1)
    assert interaction.start_ns / NS_PER_S == pytest.approx(1.5 - half, abs=0.1)
    assert interaction.end_ns / NS_PER_S == pytest.approx(1.5 + half, abs=0.1)
    assert situation_table([interaction]).pair_frames(np.array([each.stamp_ns for each in truth])) > 0
    (from_table,) = interactions_of(truth_table(truth))
    assert (from_table.start_ns, from_table.end_ns) == (interaction.start_ns, interaction.end_ns)


EAST = WAIST | {"mount": {"xyz": [6, 0, 1.0], "yaw_deg": 180}}


def test_what_one_scanner_hides_the_other_sees():
    people = {"a": standing(2, 0), "b": standing(3, 0)}
    details, _ = details_of(scenario(people, {"waist": WAIST}))
    (alone,) = situations(details, "merged_rig")
    assert (alone.first_id, alone.second_id, alone.sensor, alone.how) == (1, 2, "", "hidden")
    details, _ = details_of(scenario(people, {"waist": WAIST, "east": EAST}))
    assert {each.sensor for each in situations(details, "merged")} == {"waist", "east"}
    assert situations(details, "merged_rig") == []


def test_close_together_the_whole_rig_merges_them():
    people = {"a": standing(2.5, -0.3, 180), "b": standing(2.5, 0.3, 180)}
    details, _ = details_of(scenario(people, {"waist": WAIST, "east": EAST}))
    (merged,) = situations(details, "merged_rig")
    assert (merged.start_ns, merged.end_ns, merged.complete, merged.how) == (0, 350_000_000, False, "joined")
    assert merged.least_m == pytest.approx(0.6, abs=0.05)


def test_who_lies_out_of_every_scan_is_not_merged_for_the_rig():
    high = WAIST | {"mount": {"xyz": [0, 0, 1.9]}}
    people = {"a": standing(2, 0) | {"height_m": 2.1}, "b": standing(3, 0) | {"height_m": 1.6}}
    details, _ = details_of(scenario(people, {"high": high, "higher": EAST | {"mount": {"xyz": [6, 0, 1.95]}}}))
    assert situations(details, "merged_rig") == []


def test_situations_are_told_in_the_order_of_their_ends():
    two = {"waist": WAIST | {"rate_hz": 25}, "east": EAST | {"rate_hz": 10, "phase_s": 0.03}}
    people = {name: {"script": {"kind": "wander"}} for name in "abcdefgh"}
    crowd = scenario(people, two, 7.0, area=[[-2, -1.5], [2, -1.5], [2, 1.5], [-2, 1.5]])
    details, _ = details_of(crowd)
    told = [each for each in details if isinstance(each, Situation) and each.complete]
    assert {each.kind for each in told} == {"interaction", "correlated", "merged", "merged_rig"}
    ends = [each.end_ns for each in told if each.end_ns <= 6_500_000_000]
    assert ends == sorted(ends)


def test_rays_come_in_order_of_stamps_whatever_their_delay():
    late = WAIST | {"rate_hz": 20, "delay_s": 0.1, "jitter_s": 0.3, "dropout": 0.2}
    details, _ = details_of(scenario({"a": standing(2, 0)}, {"late": late, "waist": WAIST}, 1.0))
    stamps = [frame.stamp_ns for frame in rays(details)]
    assert stamps == sorted(stamps)
    assert 20 < len(stamps) < 30


def test_faults_leave_whom_the_beams_meet_as_it_is():
    people = {"a": standing(2, 0), "b": standing(3, 1)}
    broken = {
        "stuck": {"kind": "freeze", "sensor": "waist"},
        "off": {"kind": "clock", "sensor": "waist", "offset_s": 5},
    }
    healthy, _ = details_of(scenario(people, {"waist": WAIST}))
    faulty, _ = details_of(scenario(people, {"waist": WAIST}, faults=broken))
    assert healthy == faulty


LAB = ["duration_s=1.2", "background=none"]


def test_the_same_seed_gives_the_same_details_with_and_without_images():
    described = load_scenario("lab-five-people", LAB)
    first, truth = details_of(described)
    second, again = details_of(described)
    blind, _ = details_of(described, images=False)
    assert repr(first) == repr(second)
    assert repr([each for each in first if not isinstance(each, BoxFrame)]) == repr(blind)
    assert repr(truth) == repr(again)


def test_nothing_changes_for_who_does_not_ask():
    described = load_scenario("lab-five-people", [*LAB, "duration_s=0.3"])
    with Simulation(described, images=False) as plain, Simulation(described, images=False, on_detail=repr) as told:
        for one, other in zip(plain, told, strict=True):
            np.testing.assert_array_equal(one.ranges_m, other.ranges_m)


@pytest.mark.parametrize(("boxes_hz", "stamps"), [(2, [0.0, 0.5, 1.0]), (5, [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]), (0, [])])
def test_boxes_come_a_few_times_a_second(boxes_hz: float, stamps: list[float]):
    details, _ = details_of(load_scenario("lab-five-people", [*LAB, f"truth.boxes_hz={boxes_hz}"]))
    frames = [each for each in details if isinstance(each, BoxFrame)]
    assert [frame.stamp_ns / NS_PER_S for frame in frames] == stamps


def test_boxes_hold_the_points_that_rays_reach():
    """The points on the bodies are seen where the rig projects them; people in full view have them all in their box."""
    described = load_scenario("lab-five-people", [*LAB, "truth.boxes_hz=1"])
    frames: list[BoxFrame] = []

    def keep(detail: TruthDetail) -> None:
        if isinstance(detail, BoxFrame):
            frames.append(detail)

    compared = 0
    with Simulation(described, on_detail=keep) as simulation:
        for _ in simulation:
            pass
        scene, world = simulation.world.scene, simulation.world
        camera = simulation.rig.sensors["fisheye"]
        assert isinstance(camera, FisheyeSensor)
        for frame in frames:
            t = frame.stamp_ns / NS_PER_S
            visible = {
                each.id: each.visible["fisheye"] for each in world.truth(frame.stamp_ns, simulation.views).people
            }
            data = world.snapshot(t).data
            pose, lens = camera.room_from_sensor, camera.intrinsics
            for place, name in enumerate(scene.names):
                box = next((each for each in frame.boxes if each.id == scene.ids[name]), None)
                assert (box is None) <= (visible[scene.ids[name]] == 0)
                if box is None or visible[scene.ids[name]] < 1:
                    continue
                local = (data.site_xpos[scene.bodies.point_site[place]] - pose.translation) @ pose.rotation
                across = np.hypot(local[:, 0], local[:, 1])
                radius = lens.radius_of_angle(np.arctan2(across, local[:, 2]))
                u = lens.cx + lens.fx * radius * local[:, 0] / across
                v = lens.cy + lens.fy * radius * local[:, 1] / across
                assert (u > box.left - 0.5).all() and (u < box.left + box.width - 0.5).all()
                assert (v > box.top - 0.5).all() and (v < box.top + box.height - 0.5).all()
                compared += 1
    assert compared >= 2


def test_every_camera_sees_people():
    described = load_scenario("lab-five-people", LAB)
    with Simulation(described) as simulation:
        cameras = set(simulation.rig.cameras())
        assert cameras == {name for name, each in simulation._sensors.items() if isinstance(each.ideal, PersonImaging)}
