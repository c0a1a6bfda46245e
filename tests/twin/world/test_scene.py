"""The scene: what does not fit into the room is refused in one sentence, and geoms belong to whom they belong."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import twin

from trackers.area import Area
from trackers.errors import InputError
from twin.scenario import Scenario, load_scenario
from twin.world.placement import CLEARANCE_M
from twin.world.scene import build_scene, check_scene, populate
from twin.world.simulation import Simulation
from twin.world.world import World

WALK = "{{kind: walk, waypoints: {}{}}}"
ROOM = """
<mujoco>
  {custom}
  <worldbody>
    <geom name="floor" type="plane" size="5 5 0.1"/>
    <body name="ann" pos="3 3 0.5"><geom name="statue" type="box" size="0.1 0.1 0.5"/>
      <body name="ann/arm"><geom name="arm" type="box" size="0.1 0.1 0.1"/></body>
    </body>
    <body name="ann-b" pos="4 3 0.5"><geom name="plinth" type="box" size="0.1 0.1 0.5"/></body>
  </worldbody>
</mujoco>
"""
L_SHAPED = "-2 0  2 0  2 4  1 4  1 2  -2 2"


def lab(*changes: str) -> Scenario:
    return load_scenario("lab-five-people", ["people={}", *changes])


def person(name: str, *fields: str) -> str:
    return f"people.{name}={{{', '.join(fields)}}}"


def walk(waypoints: str, more: str = "") -> str:
    return f"script: {WALK.format(waypoints, more)}"


def in_room(tmp_path: Path, walkable: str | None, *changes: str) -> Scenario:
    custom = f'<custom><numeric name="walkable_area" data="{walkable}"/></custom>' if walkable else ""
    path = tmp_path / "room.xml"
    path.write_text(ROOM.format(custom=custom))
    return lab(f"room={path}", *changes)


@pytest.mark.parametrize(
    ("ann", "bob", "field", "distance"),
    [
        (walk("[[0, 1], [1, 1]]"), walk("[[0, 1], [1, 2]]"), r"script\.waypoints\.0: \[0, 1\]", "0.00"),
        (walk("[[0, 1], [1, 1]]"), "start: [0.3, 1]", r"start: \[0\.3, 1\]", "0.30"),
        (
            "start: [0, 1], script: {kind: stand}",
            walk("[[0, 1.4], [1, 2]]"),
            r"script\.waypoints\.0: \[0, 1\.4\]",
            "0.40",
        ),
        ("start: [0, 1]", "start: [0, 1], script: {kind: stand}", r"start: \[0, 1\]", "0.00"),
    ],
)
def test_people_who_start_in_each_other_are_refused(ann: str, bob: str, field: str, distance: str) -> None:
    said = (
        rf"scenario 'lab-five-people': people\.bob\.{field} is {distance} m from 'ann', who starts at \[0, 1\]: "
        rf"their bodies overlap; at least {CLEARANCE_M} m between people is expected$"
    )
    with pytest.raises(InputError, match=said):
        build_scene(lab(person("ann", ann), person("bob", bob)))


def places(scenario: Scenario, *seconds: float) -> np.ndarray:
    """Where everybody is at these times, (n_t, n, 2) [m], in the order of their names in the scenario."""
    population, found = populate(scenario, build_scene(scenario)), []
    for t in seconds:
        population.advance(t)
        truth = population.truth(t)
        found.append(np.stack([truth.x, truth.y], axis=-1))
    return np.array(found)


def test_a_start_elsewhere_frees_the_first_waypoint() -> None:
    walkers = lab(person("ann", walk("[[0, 1], [1.8, 1]]")), person("bob", "start: [-1, 2.4]", walk("[[0, 1]]")))
    way = places(walkers, *np.arange(0.0, 8.0, 0.2))
    np.testing.assert_allclose(way[0], [[0, 1], [-1, 2.4]], atol=0.05)
    assert np.linalg.norm(way - [[1.8, 1], [0, 1]], axis=-1).min(axis=0).max() < 0.25
    (begun,) = places(lab(person("ann", "start: [0, 1]"), person("bob", f"start: [{CLEARANCE_M}, 1]")), 0.0)
    np.testing.assert_allclose(begun, [[0, 1], [CLEARANCE_M, 1]], atol=0.05)


def test_the_command_line_says_so_in_one_line(tmp_path: Path) -> None:
    people = [person("ann", walk("[[0, 1], [1, 1]]")), person("bob", walk("[[0, 1], [1, 2]]"))]
    sets = [part for change in ["people=null", *people] for part in ("--set", change)]
    done = twin("run", "lab-five-people", "--out", tmp_path / "out", *sets)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith(
        "twin: scenario 'lab-five-people': people.bob.script.waypoints.0: [0, 1] is 0.00 m from 'ann'"
    )
    assert "Traceback" not in done.stderr


AT_DOOR = r"9\.14 m beyond where people walk is more .*door, \[2\.15, 2\.95\] for instance, is expected$"
IN_LAB = r"x -2\.3 to 2\.3 m, y 0\.35 to 3\.1 m is expected$"


@pytest.mark.parametrize(
    ("ann", "said"),
    [
        (walk("[[10, 10]]"), rf"script\.waypoints\.0: \[10, 10\] is outside the room's walkable area; {IN_LAB}"),
        (walk("[[0, 1], [0, 5]]"), rf"script\.waypoints\.1: \[0, 5\] is outside the room's walkable area; {IN_LAB}"),
        ("start: [9, 9], " + walk("[[0, 1]]"), rf"start: \[9, 9\] is outside the room's walkable area; {AT_DOOR}"),
        ("start: [9, 9], script: {kind: stand}", rf"start: \[9, 9\] is outside the room's walkable area; {AT_DOOR}"),
    ],
)
def test_people_outside_the_room_are_refused(ann: str, said: str) -> None:
    with pytest.raises(InputError, match=rf"^scenario 'lab-five-people': people\.ann\.{said}"):
        build_scene(lab(person("ann", ann)))


@pytest.mark.parametrize(
    "waypoints",
    [
        [[-2.3, 0.8], [2.3, 0.8], [2.3, 2.6]],
        *([corner, [0, 2]] for corner in ([-2.3, 0.35], [-2.3, 3.1], [2.3, 0.35], [2.3, 3.1])),
    ],
    ids=["border", "corner", "upper", "right", "upper right"],
)
def test_walks_may_leave_the_tracked_area_and_touch_the_border_of_the_walkable_one(waypoints: list) -> None:
    described = lab(person("ann", "start: [2.2, 0.4]", walk(str(waypoints), ", repeat: true")))
    scene = build_scene(described)
    way = places(described, *np.arange(0.0, 16.0, 0.2))[:, 0]
    assert scene.walkable is not None
    assert Area(scene.walkable, 0.01).contains(way).all()
    assert not Area(scene.area).contains(way).all()
    for place in waypoints:
        assert np.hypot(*(way - place).T).min() < 0.25, place


@pytest.mark.parametrize("apex_m", [0.6, 1.2, 2.4])
@pytest.mark.parametrize("halt", [True, False])
def test_a_corner_of_any_angle_is_reached_or_told(tmp_path: Path, apex_m: float, halt: bool) -> None:
    waypoints, more = ("[[2, 0]]", "") if halt else ("[[2, 0], [-1.5, 0.2]]", ", repeat: true")
    wedge = f"2 0  -2 {apex_m}  -2 -{apex_m}"
    world = World(in_room(tmp_path, wedge, "area=null", person("ann", "start: [-1.5, 0]", walk(waypoints, more))))
    way = []
    for t in np.arange(0.0, 20.0, 0.1):
        world.population.advance(t)
        way.append(world.population.truth(t))
    x = np.array([truth.x[0] for truth in way])
    assert x.max() > 0.5
    came_back = x[x.argmax() :].min() < 0.0
    assert world.population.late() or (halt and x[-1] > 1.8) or (not halt and came_back)


@pytest.mark.parametrize(
    "ann",
    [
        walk("[[-1, 1], [1.5, 3.5]]"),
        "start: [1.5, 3.5], " + walk("[[-1, 1]]"),
        walk("[[-1, 1], [1.5, 1], [1.5, 3.5]]", ", repeat: true"),
    ],
)
def test_ways_that_a_wall_is_in_lead_around_its_corner(tmp_path: Path, ann: str) -> None:
    world = World(in_room(tmp_path, L_SHAPED, "area=null", person("ann", ann)))
    walkable, way = world.scene.walkable, []
    assert walkable is not None
    for t in np.arange(0.0, 10.0, 0.1):
        world.population.advance(t)
        truth = world.population.truth(t)
        way.append((truth.x[0], truth.y[0]))
    assert Area(walkable).contains(np.array(way)).all()
    assert np.ptp(np.array(way), axis=0).min() > 2.0


def test_the_same_corners_without_a_wall_between_are_walked(tmp_path: Path) -> None:
    """Straight from one to the next: nobody is farther from the lines between them than a corner is rounded."""
    described = in_room(tmp_path, L_SHAPED, "area=null", person("ann", walk("[[-1, 1], [1.5, 1], [1.5, 3.5]]")))
    way = places(described, *np.arange(0.0, 12.0, 0.2))[:, 0]
    np.testing.assert_allclose(way[[0, -1]], [[-1, 1], [1.5, 3.5]], atol=0.3)
    off_m = np.minimum(np.abs(way[:, 1] - 1), np.abs(way[:, 0] - 1.5))
    assert off_m.max() < 0.25


@pytest.mark.parametrize(
    ("area", "said"),
    [
        (
            "[[20, 20], [24, 20], [24, 24], [20, 24]]",
            rf"area: the edge from \[20, 20\] to \[24, 20\] is outside .*{IN_LAB}",
        ),
        (
            "[[-2, 0.6], [2.4, 0.6], [2, 2.8]]",
            rf"area: the edge from \[-2, 0\.6\] to \[2\.4, 0\.6\] is outside .*{IN_LAB}",
        ),
    ],
)
def test_areas_that_cannot_be_are_refused(area: str, said: str) -> None:
    with pytest.raises(InputError, match=f"^scenario 'lab-five-people': {said}"):
        build_scene(lab(f"area={area}"))


def test_an_area_around_a_wall_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"area: the edge from \[2, 4\] to \[-2, 1\] is outside"):
        build_scene(in_room(tmp_path, L_SHAPED, "area=[[-2, 0], [2, 0], [2, 4], [-2, 1]]"))


def test_the_shipped_area_and_the_whole_walkable_one_fit() -> None:
    shipped = load_scenario("lab-five-people")
    scene = build_scene(shipped)
    np.testing.assert_array_equal(scene.area, shipped.area)
    assert Area(scene.walkable).contains(scene.area).all() and set(scene.ids) == set(shipped.people)
    whole = build_scene(lab("area=null")).area
    corners = [[float(x), float(y)] for x, y in whole]
    np.testing.assert_array_equal(build_scene(lab(f"area={corners}")).area, whole)


@pytest.mark.parametrize("data", ["0 0 1 0 1", "0 0 1 0"])
def test_a_walkable_area_that_is_no_polygon_is_refused(tmp_path: Path, data: str) -> None:
    with pytest.raises(InputError, match=rf"room\.xml: walkable_area: {len(data.split())} numbers are not a polygon"):
        build_scene(in_room(tmp_path, data))


@pytest.mark.parametrize("name", ["walkable-area", "WalkableArea"])
def test_a_walkable_area_under_another_name_is_refused(tmp_path: Path, name: str) -> None:
    room = in_room(tmp_path, "0 0 1 0 1 1")
    (path,) = tmp_path.glob("*.xml")
    path.write_text(path.read_text().replace("walkable_area", name))
    with pytest.raises(InputError, match=rf"room\.xml: {name}: is not read; <numeric name"):
        build_scene(room)


def test_a_walkable_area_that_crosses_itself_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"room\.xml: walkable_area: .* crosses or touches itself at \[0, 1\]"):
        build_scene(in_room(tmp_path, "-1 0  1 0  -1 2  1 2", "area=null"))


def test_where_the_room_does_not_say_people_may_go_as_far_as_its_floor(tmp_path: Path) -> None:
    people = [
        person("ann", walk("[[4.5, -4.5], [-4.5, 4.5]]")),
        person("bob", "start: [-4, -4]", "script: {kind: stand}"),
    ]
    scene = build_scene(in_room(tmp_path, None, "area=null", *people))
    np.testing.assert_allclose([scene.area.min(axis=0), scene.area.max(axis=0)], [[-4.8, -4.8], [4.8, 4.8]], atol=0.03)
    with pytest.raises(InputError, match=r"script\.waypoints\.0: \[9, 9\] is outside the room's walkable area"):
        build_scene(in_room(tmp_path, None, person("ann", walk("[[9, 9], [-4, -4]]"))))


@pytest.mark.parametrize("start", ["[2.2, 1]", "[0, 3]", "[2, 1]", "[-2, 1]"])
def test_a_wanderer_locked_out_of_the_area_is_refused(start: str) -> None:
    said = r"people\.ann\.start: .* is not inside the area that a wanderer stays in; x -2 to 2 m, y 0\.6 to 2\.8 m is"
    with pytest.raises(InputError, match=said):
        build_scene(lab(person("ann", f"start: {start}")))
    (there,) = places(lab(person("ann", f"start: {start}", "script: {kind: stand}")), 5.0)
    np.testing.assert_allclose(there, [json.loads(start)], atol=0.05)


@pytest.mark.parametrize("start", [(1.999, 1.0), (-1.999, 0.601), (0.0, 2.799)])
def test_a_wanderer_at_the_very_edge_comes_in(start: tuple[float, float]) -> None:
    described = lab(person("ann", f"start: [{start[0]}, {start[1]}]"), person("bob", "script: {kind: wander}"))
    way = places(described, *np.arange(0.1, 10.0, 0.1))[:, 0]
    low, high = np.array([-2.0, 0.6]), np.array([2.0, 2.8])
    assert ((way > low) & (way < high)).all()
    assert np.minimum(way - low, high - way).min(axis=1).max() > 0.3


def test_a_full_area_is_told_with_the_scenario() -> None:
    people = [person(f"p{number}") for number in range(40)]
    described = lab(*people)
    with pytest.raises(InputError, match=r"^scenario 'lab-five-people': people\.p\d+: no place in the area is"):
        populate(described, build_scene(described))
    thin = lab("area=[[0, 1], [1, 1], [1, 1.2], [0, 1.2]]", person("ann"))
    with pytest.raises(InputError, match=r"^scenario 'lab-five-people': area: is too narrow"):
        populate(thin, build_scene(thin))


def test_a_room_too_narrow_to_walk_in_is_told_once(tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match=r"^scenario '[^']+': room: the walkable area is too narrow to walk in; more than [0-9.]+ m "
        r"between its edges is expected$",
    ):
        build_scene(in_room(tmp_path, "-1 1  1 1  1 1.02  -1 1.02", "area=null"))


def test_furniture_called_like_a_person_is_the_room(tmp_path: Path) -> None:
    scene = build_scene(in_room(tmp_path, None, person("bob"), person("ann"), person("ann-b")))
    model = scene.model
    room = {"floor", "statue", "arm", "plinth"}
    assert scene.ids == {"bob": 1, "ann": 2, "ann-b": 3}
    owned = [0, 0, 0, 0]
    for geom in range(model.ngeom):
        body = model.body(model.geom_bodyid[geom]).name
        expected = 0 if model.geom(geom).name in room else scene.ids[body.partition("/")[0]]
        assert scene.person_of_geom[geom] == expected
        owned[expected] += 1
    assert owned[0] == len(room)
    assert min(owned[1:]) > 15  # whole bodies


def test_people_have_faces_where_they_are_drawn() -> None:
    one = lab("people.ann={script: {kind: stand}}", "sensors.fisheye=null", "background=none")
    with Simulation(one) as unseen, Simulation(one, images=False, drawn=True) as drawn:
        assert unseen.world.scene.model.ntex < drawn.world.scene.model.ntex


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ("people: {ann: {start: [0, 1], script: [{kind: sit, seat: none}]}}", "people.ann.script.0.seat: "),
        ("people: {ann: {start: [30, 1]}}", "people.ann.start: "),
        ("sensors: {waist: {mount: {xyz: [30, 1, 1]}}}", "sensors.waist.mount.xyz: "),
        ("area: [[0, 0], [30, 0], [30, 1]]", "area: "),
    ],
)
def test_an_error_of_a_user_s_scenario_names_its_file(changes: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(f"extends: lab-five-people\nname: mine\n{changes}\n", "utf-8")
    scenario = load_scenario(path)
    assert scenario == scenario.of_file("other.yaml")
    for seeded in (scenario, scenario.model_copy(update={"seed": 4})):
        with pytest.raises(InputError) as raised:
            check_scene(seeded)
        assert all(line.startswith(f"{path}: {said}") for line in str(raised.value).splitlines())
