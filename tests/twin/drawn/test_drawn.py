"""Drawn scenes: the seed fixes everything, each part is drawn by itself, and whatever is drawn can be run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml
from command_line import twin
from hypothesis import given, settings, strategies

from trackers.area import Area
from trackers.configuration import validate
from trackers.errors import InputError
from twin.drawn.distributions import DrawnPeople, DrawnRoom
from twin.drawn.draw_building import draw_building
from twin.drawn.draw_furniture import Piece, standing_places
from twin.drawn.draw_people import draw_people
from twin.drawn.draw_scene import draw_scene
from twin.drawn.floor_plan import _partition
from twin.run.live import run_scenario
from twin.scenario import load_scenario
from twin.scenario.scenario import Scenario
from twin.suites.expansion import expand
from twin.suites.spec import load_suite
from twin.world.scene import unusable_furniture
from twin.world.world import World

MIXED = {
    "room": {"kind": "drawn", "turned_deg": [-180, 180], "rooms": [1, 5], "furniture_per_m2": [0.05, 0.2]},
    "people": {"kind": "drawn", "count": [1, 20], "in_groups": 0.6, "arriving": 0.4, "leaving": 0.4},
    "sensors": {
        "kind": "drawn", "scanners": [0, 4], "robots": [0, 2], "fisheyes": [0, 1], "cameras": [0, 2], "stereos": [1, 2],
        "floor": 0.5,
        "noise": ["off", "default", "worse"], "faults": 0.3,
    },
}  # fmt: skip


def drawn(seed: int, **changes: dict[str, Any]) -> tuple[dict[str, Any], str]:
    """A scene's content and the room's MJCF."""
    kept: list[str] = []

    def keep(name: str, mjcf: str) -> str:
        kept.append(mjcf)
        return name

    parts = {name: {"kind": "drawn"} | changes.get(name, {}) for name in ("room", "people", "sensors")}
    content = draw_scene({"name": "s", "seed": seed, "duration_s": 20, **parts}, "test", keep)
    return content, kept[0]


def test_the_seed_fixes_everything_and_each_part_is_drawn_by_itself() -> None:
    content, mjcf = drawn(1003)
    assert (content, mjcf) == drawn(1003)
    other, other_room = drawn(1004)
    assert other_room != mjcf and other["people"] != content["people"] and other["sensors"] != content["sensors"]
    crowded, same_room = drawn(1003, people={"count": [6, 6]})
    assert same_room == mjcf and crowded["sensors"] == content["sensors"] and crowded["people"] != content["people"]
    own_seed, other_room = drawn(1003, room={"seed": 1004})
    assert other_room == drawn(1004)[1] and own_seed["room"] != content["room"]


@pytest.mark.parametrize("seed", range(1500, 1508))
def test_whatever_is_drawn_is_a_scenario_that_can_begin(seed: int, tmp_path: Path) -> None:
    content, mjcf = drawn(seed, **MIXED)
    room = tmp_path / "room.xml"
    room.write_text(mjcf)
    scenario = validate(Scenario, content | {"room": str(room)}, "drawn")
    World(scenario)  # people's places and ways, seats and mounts are checked here
    assert {sensor.kind for sensor in scenario.sensors.values()} <= {"laser", "fisheye", "camera", "stereo", "floor"}


def test_robots_stand_apart_from_people_and_leave_all_else_as_it_was() -> None:
    content, _ = drawn(1003)
    with_robots, _ = drawn(1003, sensors={"robots": [3, 3]})
    robots = with_robots.pop("housings")
    assert len(robots) == 3
    scanners = {name: with_robots["sensors"].pop(f"{name}_scanner") for name in robots}
    assert with_robots == content
    assert all(each["housing"] == name for name, each in scanners.items())
    places = np.array([each["mount"]["xyz"][:2] for each in robots.values()])
    starts = np.array([each["start"] for each in content["people"].values()])
    assert np.hypot(*(places[:, None] - starts).T).min() > 0.7


def test_an_adult_can_use_every_drawn_seat_and_bed(tmp_path: Path) -> None:
    """Sofas, chairs before desks and about tables, and beds."""
    found = set[str]()
    for seed in range(1000, 1004):
        content, mjcf = drawn(seed, room={"kind": "drawn", "furniture_per_m2": [0.1, 0.2]})
        room = tmp_path / "room.xml"
        room.write_text(mjcf)
        scene = World(validate(Scenario, content | {"room": str(room)}, "drawn")).scene
        assert unusable_furniture(scene) == []
        found |= {name.split("_")[0] for name in scene.ground.furniture}
    assert found == {"sofa", "chair", "bed"}


@settings(max_examples=15, deadline=None)
@given(seed=strategies.integers(0, 2**31))
def test_doors_doorways_seats_and_starts_can_all_be_reached(seed: int) -> None:
    options = DrawnRoom(kind="drawn", rooms=(1, 6), furniture_per_m2=(0.0, 0.3), pillars=(0, 8))
    building = draw_building(options, seed, "room")
    space, plan = building.space, building.plan
    assert plan.doors
    assert len(plan.thresholds()) == len(plan.doors) + 2 * len(plan.partitions)
    assert space.is_reached(plan.thresholds()).all()
    seats = [standing_places(piece) for piece in building.pieces]
    assert all(space.is_reached(places).all() for places in seats)
    assert plan.is_within(space.draw(50, np.random.default_rng(seed))).all()
    walls = sum(wall.length_m for wall in plan.walls)
    edges = np.hypot(*(np.roll(plan.outline, -1, axis=0) - plan.outline).T).sum()
    assert walls == pytest.approx(edges)
    model = mujoco.MjSpec.from_string(building.mjcf).compile()
    assert len(building.spots("seat")) + len(building.spots("bed")) == sum(
        model.site(site).name.startswith(("seat_", "bed_")) for site in range(model.nsite)
    )


def test_a_partition_as_long_as_its_doorway_needs_is_drawn() -> None:
    options = DrawnRoom(kind="drawn", doorway_m=(1.1, 1.1))
    for length_m in np.arange(1.8, 1.9, 0.01):
        partition = _partition((0.0, 0.0), (0.0, float(length_m)), options, np.random.default_rng(0))
        first_m, last_m = partition.gap_m
        assert 0 < first_m < last_m < length_m
        assert last_m - first_m == pytest.approx(1.1, abs=0.01)


def test_no_piece_stands_in_another_or_in_a_pillar_or_where_elbows_go() -> None:
    shares = np.stack(np.meshgrid(np.linspace(0.01, 0.99, 15), np.linspace(0.01, 0.99, 15)), axis=-1).reshape(-1, 2)
    options = DrawnRoom(kind="drawn", pillars=(2, 3), furniture_per_m2=(0.15, 0.2))
    n_pair, n_seat = 0, 0
    for seed in range(1000, 1015):
        building = draw_building(options, seed, "test")
        footprints = [each.footprint() for each in building.pieces]
        elbows = [_elbows(piece) for piece in building.pieces]
        n_seat += sum(map(len, elbows)) // 2
        assert building.plan.is_within(np.concatenate(elbows)).all(), seed
        places = np.array(
            [one[0] + shares[:, :1] * (one[1] - one[0]) + shares[:, 1:] * (one[3] - one[0]) for one in footprints]
        )
        for k, other in enumerate(footprints):
            others = np.delete(places, k, axis=0)
            n_pair += len(others)
            assert not Area(other).contains(others.reshape(-1, 2)).any(), seed
            beside = np.concatenate([each for n, each in enumerate(elbows) if n != k])
            assert not Area(other).contains(beside).any(), seed
    assert n_pair > 500 and n_seat > 20


def _elbows(piece: Piece) -> np.ndarray:
    """Return the places (n, 2) of the arms of broad people on a piece's seats [m]."""
    middles = [spot.place[:2] for spot in piece.spots if spot.kind == "seat"]
    local = np.array(middles).reshape(-1, 1, 2) + np.array([[-0.38, 0.0], [0.38, 0.0]])
    return piece.placed(local.reshape(-1, 2))


def test_a_turned_building_is_the_same_building() -> None:
    straight = draw_building(DrawnRoom(kind="drawn"), 1010, "room")
    turned = draw_building(DrawnRoom(kind="drawn", turned_deg=(90, 90)), 1010, "room")
    assert np.allclose(straight.plan.outline, turned.plan.outline)
    places = straight.space.draw(5, np.random.default_rng(0))
    before, after = np.array(straight.to_room(places)), np.array(turned.to_room(places))
    assert np.allclose(after, np.column_stack([-before[:, 1], before[:, 0]]), atol=2e-3)
    geoms = [mujoco.MjSpec.from_string(each.mjcf).compile() for each in (straight, turned)]
    assert geoms[0].ngeom == geoms[1].ngeom


def test_people_come_in_groups_as_often_as_asked() -> None:
    building = draw_building(DrawnRoom(kind="drawn", length_m=(14, 14), width_m=(10, 10)), 1001, "room")
    followers = 0
    for seed in range(1000, 1020):
        people = draw_people(DrawnPeople(kind="drawn", count=(12, 12), in_groups=0.7), building, 20.0, seed)
        assert len(people) == 12
        followers += sum(person["script"][0]["kind"] == "follow" for person in people.values() if person.get("script"))
    # of groups of two to four, one member leads: 0.7 × 12 people are about 3.5 groups with 5 followers
    assert 4 <= followers / 20 <= 6.5


def test_larger_groups_walk_more_slowly() -> None:
    building = draw_building(DrawnRoom(kind="drawn", length_m=(14, 14), width_m=(10, 10)), 3, "room")

    def leads(slowdown_m_s: float) -> dict[str, tuple[int, float]]:
        options = DrawnPeople(kind="drawn", count=(12, 12), in_groups=1.0, group_slowdown_m_s=slowdown_m_s)
        people = draw_people(options, building, 20.0, 5)
        leaders = [
            each["person"] for person in people.values() for each in person["script"] if each["kind"] == "follow"
        ]
        return {name: (1 + leaders.count(name), people[name]["script"][0]["speed_m_s"]) for name in leaders}

    plain, slowed = leads(0.0), leads(0.04)
    assert plain.keys() == slowed.keys() and len(plain) > 2
    for name, (size, speed) in plain.items():
        assert slowed[name] == (size, pytest.approx(max(0.6, speed - 0.04 * (size - 1)), abs=0.011))


@pytest.mark.parametrize(("share", "near_m", "far_m"), [(0.0, 0.65, 0.8), (1.0, 0.5, 0.6)])
def test_groups_walk_as_near_to_each_other_as_asked(share: float, near_m: float, far_m: float) -> None:
    building = draw_building(DrawnRoom(kind="drawn", length_m=(14, 14), width_m=(10, 10)), 3, "room")
    options = DrawnPeople(kind="drawn", count=(12, 12), in_groups=1.0, abreast=1.0, shoulder_to_shoulder=share)
    people = draw_people(options, building, 20.0, 5)
    beside = [action for person in people.values() for action in person["script"] if "beside" in action]
    assert len(beside) > 3 and all(near_m <= action["distance_m"] <= far_m for action in beside)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"room": "lab"}, "people: can be drawn into a drawn room only"),
        ({"room": {"kind": "drawn", "length_m": [2, 4]}}, "length_m [2.0, 4.0] cannot be built; 3 to 60 is valid"),
        ({"room": {"kind": "drawn", "width_m": [9, 4]}}, "is not a range; the smaller number comes first"),
        (
            {"room": {"kind": "drawn", "furniture": {"tabel": 1}}},
            "'tabel' is no kind of furniture; did you mean 'table'? valid are table",
        ),
        ({"people": {"kind": "drawn", "count": [0, 3]}}, "1 to 60 people are valid"),
        ({"people": {"kind": "drawn", "activities": {"dance": 1}}}, "'dance' is not drawn; valid are wander"),
        ({"sensors": {"kind": "drawn", "scanners": [0, 0]}}, "at least one sensor is expected"),
        ({"sensors": {"kind": "drawn", "lasers": [0, 0]}}, "lasers: unknown key"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_a_sentence(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    parts: dict[str, Any] = {name: {"kind": "drawn"} for name in ("room", "people", "sensors")}
    path = tmp_path / "own.yaml"
    path.write_text(yaml.safe_dump({"name": "own", "duration_s": 5, **parts, **changes}))
    with pytest.raises(InputError) as refused:
        load_scenario(path)
    assert said in str(refused.value) and str(path) in str(refused.value)


@pytest.mark.slow
def test_plain_files_of_a_drawn_scene_run_to_the_same_bits(tmp_path: Path) -> None:
    command = ["new", "scenario", "--drawn", "--seed", "1042", "--out", tmp_path / "n"]
    done = twin(*command)
    assert done.returncode == 0, done.stderr
    again = twin(*command)
    assert again.returncode == 2 and "is there already" in again.stderr
    truth = []
    for name, scenario in (("plain", str(tmp_path / "n/scenario.yaml")), ("drawn", "drawn")):
        loaded = load_scenario(scenario, ["seed=1042"])
        short = loaded.model_copy(update={"duration_s": 1.5})
        run = run_scenario(short, trackers=["sort"], out=tmp_path / name, video=False, images=False)
        truth.append((run.files["truth"].read_bytes(), run.files["tracks sort"].read_bytes()))
    assert truth[0] == truth[1]


def test_a_sheet_of_drawn_rooms_needs_no_scenario_and_a_view_does(tmp_path: Path) -> None:
    sheets = []
    for name, named in (("named.png", ["drawn"]), ("unnamed.png", [])):
        done = twin("view", *named, "--drawn", "1", "--seed", "1042", "--out", tmp_path / name)
        assert done.returncode == 0, done.stderr
        sheets.append((tmp_path / name).read_bytes())
    assert sheets[0] == sheets[1]
    done = twin("view")
    assert done.returncode == 2 and done.stderr.startswith("twin: scenario: is missing")


def test_a_rig_has_what_is_asked_for() -> None:
    content, _ = drawn(1007, sensors={"scanners": [3, 3], "waist": 1, "scanner_hz": [12, 12], "fisheyes": [1, 1]})
    kinds = [sensor["kind"] for sensor in content["sensors"].values()]
    assert kinds.count("laser") == 3 and kinds.count("fisheye") == 1
    assert {sensor.get("role") for sensor in content["sensors"].values()} == {"waist", None}


def test_ranges_of_dark_surfaces_are_drawn_without_another_change() -> None:
    options = {"scanners": [2, 2], "robots": [1, 1], "fisheyes": [1, 1], "faults": 1.0}
    plain, _ = drawn(1003, sensors=options)
    content, _ = drawn(1003, sensors=options | {"range_10_percent_m": [3, 20]})
    ranges_m = [each.pop("range_10_percent_m") for each in content["sensors"].values() if each["kind"] == "laser"]
    assert content == plain
    assert len(ranges_m) == 3 and all(3 <= each <= 20 for each in ranges_m)
    with pytest.raises(InputError, match="range_10_percent_m"):
        drawn(1003, sensors={"range_10_percent_m": [0, 20]})


def test_a_suite_draws_another_scene_for_each_seed(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(
        "name: own\nseeds: {from: 1000, count: 3}\ntrackers: [sort, laser-imm]\nscenarios: [{scenario: drawn}]\n"
    )
    cases = expand(*load_suite(path))
    rooms = {case.seed: yaml.safe_load(case.resolved)["room"] for case in cases}
    assert sorted(rooms) == [1000, 1001, 1002] and len(set(rooms.values())) == 3
    assert rooms[1001] == load_scenario("drawn", ["seed=1001"]).room


def test_a_rig_of_which_nothing_is_drawn_gets_a_scanner() -> None:
    kinds = set()
    for seed in range(1000, 1012):
        content, _ = drawn(
            seed, people={"count": [1, 1]}, sensors={"scanners": [0, 1], "cameras": [0, 0], "floor": 1.0}
        )
        kinds.add(tuple(sensor["kind"] for sensor in content["sensors"].values()))
    assert kinds == {("floor",), ("laser", "floor")}
    with pytest.raises(InputError, match="at least one sensor is expected"):
        drawn(1000, sensors={"scanners": [0, 1]})
