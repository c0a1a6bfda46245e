"""A tilting scanner in the shipped rooms: the environment that comes of it beside the rooms' own geometry."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from trackers.configuration import validate
from trackers.environment import build_environment
from trackers.errors import InputError
from trackers.observations import LaserScan
from twin.environment.run import scan_scenario
from twin.environment.scan import TiltingScanner, chosen_stations, given_stations, scan_room
from twin.scenario import Scenario
from twin.sensors.laser_noise import LASER_NOISE
from twin.sensors.rays import trace_rays
from twin.world.world import World

pytestmark = pytest.mark.slow

ROOMS = ("lab", "sensing_room", "meeting_room")
FURNISHED = "sensing_room"
"""The room that stands for the others where not every case is run: the one with most tops of furniture."""
COARSE = TiltingScanner(beams=46, tilt_step_deg=4.0)
# What has a level top below the scanner and is large enough to stand on.
TOPS = {
    "lab": ("desk_top",),
    "sensing_room": ("table_top", "dresser_top", "bed_blanket", "night_stand", "chair_left_seat", "chair_near_seat"),
    "meeting_room": ("table_left_top", "table_right_top", "window_sill"),
}
SHELF_OF_BOARDS = 0.1  # boxes thinner than this have no inside


def scenario(room, **more):
    people = more.pop("people", {})
    sensors = {"low": {"kind": "laser", "rate_hz": 10, "mount": {"xyz": [0, 0, 0.4]}}}
    content = {"name": "scanned", "room": room, "duration_s": 1, "people": people, "sensors": sensors} | more
    return validate(Scenario, content, "test")


@pytest.fixture(
    scope="module", params=[pytest.param(room, marks=[pytest.mark.nightly] * (room != FURNISHED)) for room in ROOMS]
)
def scanned(request):
    cloud, world = scan_scenario(scenario(request.param))
    return request.param, cloud, build_environment(cloud, room=request.param), world.empty_snapshot(0.0)


def box_geoms(model, data):
    """Middle, half sizes and rotation of each box of the room."""
    for geom in range(model.ngeom):
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX and model.geom_group[geom] == 0:
            yield data.geom_xpos[geom], model.geom_size[geom], data.geom_xmat[geom].reshape(3, 3)


def test_every_wall_is_found_and_nothing_else_is_called_one(scanned):
    room, _, environment, snapshot = scanned
    model, data = snapshot.model, snapshot.data
    walls = [geom for geom in range(model.ngeom) if model.geom(geom).name.startswith("wall_")]
    assert len(walls) == 4
    met = np.zeros(len(environment.walls_m), dtype=bool)
    for geom in walls:
        place, normal = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)[:, 2]
        half = model.geom_size[geom, 0]
        off = np.abs((environment.walls_m - place[:2]) @ normal[:2])  # (w, 2) ends
        own = (off < 0.02).all(axis=1)
        assert own.sum() == 1, f"{model.geom(geom).name} of {room}: {off}"
        met |= own
        length = np.linalg.norm(np.diff(environment.walls_m[own][0], axis=0))
        assert length == pytest.approx(2 * half, abs=0.05)
    assert met.all()


def test_the_floor_is_found(scanned):
    _, _, environment, _ = scanned
    assert environment.floor_m == pytest.approx(0.0, abs=0.005)
    assert environment.ceiling_m == pytest.approx({"meeting_room": 2.7}.get(environment.room, 2.6), abs=0.01)


def test_tops_of_furniture_are_where_they_are(scanned):
    room, _, environment, snapshot = scanned
    model, data = snapshot.model, snapshot.data
    for name in TOPS[room]:
        geom = model.geom(name).id
        half = model.geom_size[geom]
        x, y = np.meshgrid(*(np.linspace(-size + 0.03, size - 0.03, 15) for size in half[:2]))
        above = np.stack([x.ravel(), y.ravel(), np.full(x.size, half[2])], axis=-1)
        places = data.geom_xpos[geom] + above @ data.geom_xmat[geom].reshape(3, 3).T
        bare = np.array([is_bare(snapshot, place) for place in places])
        assert bare.sum() > 30
        error = np.abs(environment.height_under(places[bare]) - places[bare, 2])
        assert (error < 0.03).mean() > 0.85, f"{name}: {np.sort(error)}"
        assert np.median(error) < 0.01


def is_bare(snapshot, place):
    """Whether nothing stands on a top at a place, and within a voxel and a half of it."""
    aside = 0.07 * np.array([(x, y, 0) for x in (-1, 0, 1) for y in (-1, 0, 1)])
    geom, distance = np.empty(1, dtype=np.int32), np.empty(1)
    for start in place + np.array([0.0, 0.0, 1.0]) + aside:
        trace_rays(snapshot, start, np.array([[0.0, 0.0, -1.0]]), geom, distance)
        if distance[0] < 1.0 - 0.01:
            return False
    return True


def test_no_inside_of_furniture_is_free(scanned):
    _, _, environment, snapshot = scanned
    rng = np.random.default_rng(0)
    tried = 0
    for middle, half, rotation in box_geoms(snapshot.model, snapshot.data):
        if half.min() < SHELF_OF_BOARDS / 2 + 0.03:
            continue
        # a voxel's diagonal inside, so that no voxel that reaches out of the box counts
        deep = half - 0.05 * np.sqrt(3) / 2
        if (deep <= 0).any():
            continue
        points = middle + rng.uniform(-deep, deep, (200, 3)) @ rotation.T
        tried += 1
        assert not environment.is_free(points).any()
        assert (environment.head_weight(points) < 1).all()
    assert tried >= 2


def test_the_points_lie_on_the_room(scanned):
    """Each is near where its own ray meets the room; what is not is a beam on an edge."""
    _, cloud, _, snapshot = scanned
    some = np.arange(0, len(cloud.points_m), 97)
    gaps = []
    for station, origin in enumerate(cloud.origins_m):
        mine = some[cloud.station[some] == station]
        way = cloud.points_m[mine] - origin
        reach = np.linalg.norm(way, axis=1)
        geom, distance = np.empty(len(mine), dtype=np.int32), np.empty(len(mine))
        trace_rays(snapshot, origin, np.ascontiguousarray(way / reach[:, None]), geom, distance)
        gaps.append(np.abs(reach - distance))
    gaps = np.concatenate(gaps)
    assert np.median(gaps) < 0.008
    assert (gaps < 0.05).mean() > 0.95


def test_people_are_left_out():
    people = {"anna": {"start": [0.0, 0.6], "script": {"kind": "stand"}}}
    with_her, _ = scan_scenario(scenario("sensing_room", people=people), [(-1.0, 0.0)], scanner=COARSE)
    without, _ = scan_scenario(scenario("sensing_room"), [(-1.0, 0.0)], scanner=COARSE)
    np.testing.assert_array_equal(with_her.points_m, without.points_m)


def test_the_same_seed_gives_the_same_points_and_another_does_not():
    first, again, other = (
        scan_scenario(scenario("lab", seed=seed), [(0.0, 1.5)], scanner=COARSE)[0].points_m for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(first, again)
    assert first.shape != other.shape or (first != other).any()


def test_another_station_changes_nothing_about_the_first():
    one, _ = scan_scenario(scenario("lab"), [(0.0, 1.5)], scanner=COARSE)
    two, _ = scan_scenario(scenario("lab"), [(0.0, 1.5), (1.0, 2.0)], scanner=COARSE)
    np.testing.assert_array_equal(one.points_m, two.points_m[two.station == 0])
    assert (two.station == 1).any()


def test_without_noise_every_point_is_exact():
    snapshot = World(scenario("lab")).empty_snapshot(0.0)
    exact = COARSE.model_copy(update={"tilt_sigma_deg": 0.0})
    cloud = scan_room(snapshot, np.array([[0.0, 1.5, 1.2]]), LASER_NOISE["off"], 0, exact)
    points = cloud.points_m
    way = points - cloud.origins_m[0]
    reach = np.linalg.norm(way, axis=1)
    geom, distance = np.empty(len(way), dtype=np.int32), np.empty(len(way))
    trace_rays(snapshot, cloud.origins_m[0], np.ascontiguousarray(way / reach[:, None]), geom, distance)
    # but for rays along an edge, which rounding takes past it
    assert (np.abs(reach - distance) < 1e-5).mean() > 0.999
    floor = np.abs(points[:, 2]) < 1e-4
    assert floor.sum() > 100
    assert points[:, 0].max() <= 3.0 + 1e-5 and points[:, 0].min() >= -3.0 - 1e-5


def test_the_legs_of_the_tripod_are_in_the_way():
    snapshot = World(scenario("lab")).empty_snapshot(0.0)
    cloud = scan_room(snapshot, np.array([[0.0, 1.5, 1.2]]), LASER_NOISE["off"], 0, COARSE)
    way = cloud.points_m - cloud.origins_m[0]
    steepness = np.rad2deg(np.arcsin(-way[:, 2] / np.linalg.norm(way, axis=1)))
    assert 70 < steepness.max() < 75.5


def test_chosen_stations_are_free_and_see_the_room():
    world = World(scenario("meeting_room"))
    snapshot = world.empty_snapshot(0.0)
    stations = chosen_stations(world.scene, snapshot)
    assert 2 <= len(stations) <= 8
    np.testing.assert_allclose(stations[:, 2], 1.2)
    np.testing.assert_array_equal(given_stations(stations.tolist(), world.scene, snapshot, "--station"), stations)
    np.testing.assert_array_equal(chosen_stations(world.scene, snapshot), stations)


@pytest.mark.parametrize(
    ("place", "message"),
    [
        (
            (9.0, 0.0),
            r"--station 9,0,1.2: is not over the room's floor; a place within x -2.5 to 2.5 m, y -2.1 to 2.1 m",
        ),
        ((float("nan"), 0.0), r"--station nan,0,1.2: is not over the room's floor"),
        ((1.1, -1.88, 0.4), r"--station 1.1,-1.88,0.4: \[1.1, -1.88, 0.4\] is inside 'dresser' of the room"),
        ((0.0, 0.0, -0.5), r"--station 0,0,-0.5: is not above the floor; a height above 0 m is expected"),
        ((0.0, 0.0, 2.7), r"--station 0,0,2.7: .* is expected"),
    ],
)
def test_a_station_that_cannot_be(place, message):
    with pytest.raises(InputError, match=message):
        scan_scenario(scenario("sensing_room"), [place], scanner=COARSE)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"tilt_deg": (30, -30)}, "tilt_deg: 30 to -30 is no range of tilts; two within -90 to 90 are expected"),
        ({"range_min_m": 5, "range_max_m": 4}, "range_min_m: 5 m is not below range_max_m, 4 m"),
    ],
)
def test_a_scanner_that_cannot_be(fields, message):
    with pytest.raises(ValueError, match=message):
        TiltingScanner(**fields)


def test_an_environment_of_a_scenario_carries_its_room_and_area():
    cloud, world = scan_scenario(
        scenario("lab", area=[[-2, 0.6], [2, 0.6], [2, 2.8], [-2, 2.8]]),
        [(0.0, 1.5)],
        scanner=TiltingScanner(tilt_step_deg=1),
    )
    environment = build_environment(cloud, room="lab", area=world.scene.area)
    assert environment.room == "lab"
    np.testing.assert_allclose(environment.area_m, [[-2, 0.6], [2, 0.6], [2, 2.8], [-2, 2.8]])
    environment.check("lab.npz", room="lab", area=environment.area_m)


def test_the_background_of_a_scanner_on_the_wall_agrees_with_its_room():
    """What a tracker can do with a bag: hold the empty room's scans against the environment."""
    cloud, _ = scan_scenario(scenario("lab"), [(0.0, 1.5), (-1.5, 2.2)], scanner=TiltingScanner(tilt_step_deg=0.5))
    environment = build_environment(cloud)
    angles = np.deg2rad(np.arange(0, 180, 0.5))
    origin = np.array([0.0, 0.0, 0.8])
    directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=-1)
    agreed = {}
    for room in ("lab", "meeting_room"):
        snapshot = World(scenario(room)).empty_snapshot(0.0)
        geom, distance = np.empty(len(angles), dtype=np.int32), np.empty(len(angles))
        trace_rays(snapshot, origin, directions, geom, distance)
        agreed[room] = environment.agreement(origin + distance[:, None] * directions)
    assert agreed["lab"] > 0.9
    assert agreed["meeting_room"] < 0.5


def test_the_noise_is_that_of_the_scanner():
    """The layer of noise is the scanner's own: what it does to one fan is what it does to a scan of that fan."""
    ideal = LaserScan("any", 0, np.full(91, 3.0, dtype=np.float32), 0.0, 0.02, 0.1, 32.0)
    noisy = LASER_NOISE["default"].corrupt(ideal, None, np.random.default_rng(0))[0]
    assert np.isfinite(noisy.ranges_m).mean() > 0.9
    assert 0.002 < np.nanstd(noisy.ranges_m[np.isfinite(noisy.ranges_m)]) < 0.02
