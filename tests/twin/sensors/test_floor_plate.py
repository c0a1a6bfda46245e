"""The floor feels every newton, under the right foot, at the right place."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from footfalls import soles, somewhere, standing, walking
from hypothesis import given, settings, strategies as st

from twin.instant.snapshot import Feet, FootShapes
from twin.sensors.floor import FloorLoad, FloorPlate
from twin.sensors.floor_soles import sheet_cells, sole_points, soles_model

ROWS, COLUMNS, PITCH_M = 14, 18, 0.2
PLATE = FloorPlate(ROWS, COLUMNS, PITCH_M, soles(1))


def one(
    x: float, y: float, yaw: float = 0.0, weight_n: float = 700.0, left: float = 0.5, ahead_m: float = 0.04
) -> Feet:
    return standing(*(np.array(value) for value in ([[x, y]], [yaw], [weight_n], [left], [ahead_m])))


def assert_same_bits(first: FloorLoad, second: FloorLoad) -> None:
    for name, value in vars(first).items():
        assert value.tobytes() == getattr(second, name).tobytes(), name


inside_x, inside_y = st.floats(0.4, 3.2), st.floats(0.4, 2.4)


@settings(max_examples=150, deadline=None)
@given(inside_x, inside_y, st.floats(-4, 4), st.floats(50, 3000), st.floats(0.02, 0.98), st.floats(-0.06, 0.17))
def test_a_standing_person_is_felt_whole_and_where_they_press(x, y, yaw, weight_n, left, ahead_m):
    feet = one(x, y, yaw, weight_n, left, ahead_m)
    pressed = PLATE.press(feet)
    assert pressed.load_n.sum() == pytest.approx(weight_n, rel=3e-4)
    np.testing.assert_allclose(pressed.foot_n, feet.load_n, rtol=1e-3)
    centre = (pressed.centre_m * pressed.foot_n[..., None]).sum(axis=(0, 1)) / pressed.foot_n.sum()
    truth = (feet.pressure_point * feet.load_n[..., None]).sum(axis=(0, 1)) / weight_n
    assert np.linalg.norm(centre - truth) < 1e-3  # 20 mm is asked for


@pytest.mark.parametrize("pitch_m", [0.02, 0.05])
def test_a_fine_grid_itself_shows_the_centre_of_pressure(pitch_m):
    rng = np.random.default_rng(3)
    rows, columns = round(2.8 / pitch_m), round(3.6 / pitch_m)
    plate = FloorPlate(rows, columns, pitch_m, soles(1))
    for _ in range(20):
        feet = somewhere(rng, 1, (0.5, 0.5), (3.1, 2.3))
        load_n = plate.press(feet).load_n
        centre = np.array([load_n.sum(axis=0) @ np.arange(columns), load_n.sum(axis=1) @ np.arange(rows)])
        truth = (feet.pressure_point * feet.load_n[..., None]).sum(axis=(0, 1)) / feet.load_n.sum()
        assert np.linalg.norm((centre / load_n.sum() + 0.5) * pitch_m - truth) < 0.02


def contacts_inside(plate: FloorPlate, group: int = 0) -> float:
    """The normal forces of the contacts inside the grid in the group's last burst, one by one from MuJoCo."""
    model, data = plate._groups[group]._model, plate._groups[group]._data
    force, total = np.zeros(6), 0.0
    extent = np.array([plate._columns, plate._rows]) * plate._groups[group]._pitch_m
    for number in range(data.ncon):
        mujoco.mj_contactForce(model, data, number, force)
        place = data.contact[number].pos[:2]
        if (place >= 0).all() and (place <= extent).all():
            total += force[0]
    return total


@settings(max_examples=100, deadline=None)
@given(st.floats(-0.5, 4.1), st.floats(-0.5, 3.3), st.floats(-4, 4), st.floats(0.02, 0.98), st.floats(-0.06, 0.17))
def test_the_grid_sums_the_contacts_inside_it(x, y, yaw, left, ahead_m):
    """Across cells, across the grid's edges and beside it."""
    pressed = PLATE.press(one(x, y, yaw, 800.0, left, ahead_m))
    if pressed.foot_n.any():
        assert pressed.load_n.sum() == pytest.approx(contacts_inside(PLATE), abs=1e-6)
    else:
        assert not pressed.load_n.any()
    assert pressed.newton.sum() == pytest.approx(pressed.load_n.sum(), abs=1e-9)


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, np.pi, -np.pi / 2, np.pi / 4])
@pytest.mark.parametrize("pitch_m", [0.2, 0.1, 0.05, 0.025])
def test_feet_that_tread_exactly_on_seams(pitch_m, yaw):
    plate = FloorPlate(round(2.8 / pitch_m), round(3.6 / pitch_m), pitch_m, soles(1))
    for x, y in ((1.0, 1.4), (1.2, 1.0), (0.6, 0.8), (1.07, 1.3)):
        pressed = plate.press(one(x, y, yaw, ahead_m=0.0))
        assert pressed.load_n.sum() == pytest.approx(contacts_inside(plate), abs=1e-6)
        assert pressed.load_n.sum() == pytest.approx(700.0, rel=3e-4)


def test_half_a_foot_over_the_edge_counts_half():
    on_the_edge = PLATE.press(one(1.0, 0.1, yaw=0.0, ahead_m=0.04))  # the right foot's axis is the grid's edge
    assert on_the_edge.foot_n[0, 1] == pytest.approx(350, rel=3e-4)
    assert 0.2 < on_the_edge.load_n.sum() / 350 - 1 < 0.8
    beside = PLATE.press(one(1.0, -0.3))
    assert not beside.load_n.any() and beside.newton.size == 0 and not beside.foot_n.any()
    assert np.isnan(beside.centre_m).all()


def whole_grid(feet: Feet, points: np.ndarray, rows: int, columns: int, pitch_m: float) -> np.ndarray:
    """The same burst on one floor with a touch sensor for every cell: a model as plain as it gets, from MuJoCo's XML."""
    count = len(points)
    model = soles_model(points, pitch_m, 1)
    spec = ['<mujoco><option timestep="0.005" integrator="implicitfast" tolerance="1e-12" gravity="0 0 0"/>']
    spec.append('<default><geom contype="0" conaffinity="0"/></default><worldbody>')
    spec.append('<body name="floor"><geom name="floor" type="plane" size="0 0 1"/>')
    for row in range(rows):
        for column in range(columns):
            x, y = (column + 0.5) * pitch_m, (row + 0.5) * pitch_m
            half = pitch_m / 2
            spec.append(f'<site name="{row}.{column}" type="box" pos="{x} {y} 0" size="{half} {half} 0.05"/>')
    spec.append("</body>")
    for foot in range(count):
        spec.append(f'<body mocap="true"><body name="foot{foot}">')
        spec.append('<joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/><joint axis="1 0 0"/>')
        body = model.body(f"foot{foot}")
        inertial = (body.ipos, body.mass, body.inertia)
        pos, mass, inertia = (" ".join(f"{float(number)!r}" for number in np.atleast_1d(each)) for each in inertial)
        spec.append(f'<inertial pos="{pos}" mass="{mass}" diaginertia="{inertia}"/>')
        for number, (x, y) in enumerate(points[foot].tolist()):
            spec.append(f'<geom name="{foot}.{number}" size="0.01" pos="{x!r} {y!r} 0.01"/>')
        spec.append("</body></body>")
    spec.append("</worldbody><contact>")
    for foot in range(count):
        for number in range(points.shape[1]):
            pair = f'geom1="floor" geom2="{foot}.{number}" condim="1" solref="0.01 1" solimp="0.99 0.99 0.001 0.5 2"'
            spec.append(f"<pair {pair}/>")
    spec.append("</contact><sensor>")
    spec += [f'<touch site="{row}.{column}"/>' for row in range(rows) for column in range(columns)]
    spec.append("</sensor></mujoco>")
    plain = mujoco.MjModel.from_xml_string("".join(spec))
    data = mujoco.MjData(plain)
    yaw, load_n = feet.yaw.ravel(), feet.load_n.ravel()
    data.mocap_pos[:, :2] = feet.place.reshape(-1, 2)
    data.mocap_quat[:, 0], data.mocap_quat[:, 3] = np.cos(yaw / 2), np.sin(yaw / 2)
    depth = 0.01 * plain.body_invweight0[3::2, 0] * 0.01**2 / points.shape[1]
    data.qpos[::3] = np.where(load_n > 0, -depth * load_n, 0.05)
    data.qfrc_applied[::3] = -load_n
    data.qfrc_applied[1::3] = load_n * feet.pressure_ahead_m.ravel()
    mujoco.mj_step(plain, data, nstep=8)
    return data.sensordata.reshape(rows, columns).copy()


def test_sheets_under_feet_feel_what_one_grid_under_all_feet_feels():
    """Three people, feet on the same cells, over 252 touch sensors."""
    shapes = FootShapes(
        *(np.array(each) for each in ([0.07, 0.05, 0.075], [0.12, 0.1, 0.13], [0.27, 0.2, 0.3], [0.1, 0.08, 0.1]))
    )
    plate = FloorPlate(ROWS, COLUMNS, PITCH_M, shapes)
    points = sole_points(shapes).reshape(6, -1, 2)
    rng = np.random.default_rng(5)
    for _ in range(5):
        feet = somewhere(rng, 3, (0.9, 0.9), (1.7, 1.5))
        feet.load_n[rng.integers(3), rng.integers(2)] = 0.0
        expected = whole_grid(feet, points, ROWS, COLUMNS, PITCH_M)
        np.testing.assert_allclose(plate.press(feet).load_n, expected, atol=1e-6)


def test_who_loads_which_cell():
    plate = FloorPlate(ROWS, COLUMNS, PITCH_M, soles(7))
    feet = somewhere(np.random.default_rng(1), 7, (0.5, 0.5), (3.1, 2.3))
    feet.load_n[2, 1] = 0.0
    feet.present[4] = False
    feet.place[4] = np.nan
    pressed = plate.press(replace(feet, load_n=np.where(feet.present[:, None], feet.load_n, 0.0)))
    by_foot = np.zeros((7, 2))
    np.add.at(by_foot, (pressed.person, pressed.foot), pressed.newton)
    np.testing.assert_allclose(by_foot, pressed.foot_n, atol=1e-9)
    assert (by_foot > 0).sum() == 11 and not by_foot[4].any() and by_foot[2, 1] == 0
    by_cell = np.bincount(pressed.cell, weights=pressed.newton, minlength=ROWS * COLUMNS)
    np.testing.assert_allclose(by_cell.reshape(ROWS, COLUMNS), pressed.load_n, atol=1e-9)
    order = np.lexsort((pressed.cell, pressed.foot, pressed.person))
    np.testing.assert_array_equal(order, np.arange(len(order)))
    row, column = np.divmod(pressed.cell, COLUMNS)
    middle = np.stack([column + 0.5, row + 0.5], axis=-1) * PITCH_M
    reach = np.linalg.norm(middle - feet.place[pressed.person, pressed.foot], axis=-1)
    assert reach.max() < 0.2 + PITCH_M / np.sqrt(2)


def test_a_step_travels_from_heel_to_toe():
    centres = [PLATE.press(walking(t)).centre_m[0, 0, 0] for t in np.linspace(0.02, 0.6, 20)]
    assert (np.diff(centres) > 0).all()
    assert centres[-1] - centres[0] > 0.6 * soles(1).length[0]


def test_a_frame_depends_on_nothing_before_it():
    times = np.arange(0, 2, 0.1)
    plate = FloorPlate(ROWS, COLUMNS, PITCH_M, soles(1))
    first = [plate.press(walking(t)) for t in times]
    for t, before in list(zip(times, first, strict=True))[::-3]:
        assert_same_bits(before, plate.press(walking(t)))
        assert_same_bits(before, FloorPlate(ROWS, COLUMNS, PITCH_M, soles(1)).press(walking(t)))


def test_others_change_nothing_under_a_person():
    crowd = somewhere(np.random.default_rng(2), 12, (0.5, 0.5), (3.1, 2.3))
    plate = FloorPlate(ROWS, COLUMNS, PITCH_M, soles(12))
    together = plate.press(crowd)
    alone = plate.press(replace(crowd, load_n=np.where(np.arange(12)[:, None] == 8, crowd.load_n, 0.0)))
    mine = together.person == 8
    np.testing.assert_array_equal(together.cell[mine], alone.cell)
    np.testing.assert_allclose(together.newton[mine], alone.newton, rtol=1e-9)


def test_a_reading_is_not_changed_by_the_next():
    first = PLATE.press(one(1.0, 1.0))
    copies = {name: value.copy() for name, value in vars(first).items()}
    PLATE.press(one(2.0, 1.3, yaw=1.0, weight_n=300.0))
    for name, value in copies.items():
        np.testing.assert_array_equal(value, getattr(first, name))


def test_children_and_giants_stand_within_their_soles():
    for stature_m in (0.9, 2.1):
        shapes = soles(1, stature_m)
        points = sole_points(shapes)[0]
        assert points[..., 0].min() == pytest.approx(-shapes.heel[0])
        assert points[..., 0].max() == pytest.approx(shapes.length[0] - shapes.heel[0])
        assert np.abs(points[..., 1]).max() <= shapes.breadth[0] / 2
        np.testing.assert_allclose(points[0] * [1, -1], points[1])
        assert sheet_cells(points[None], 0.2) <= 4
        plate = FloorPlate(ROWS, COLUMNS, PITCH_M, shapes)
        assert plate.press(one(1.8, 1.4, ahead_m=0.02)).load_n.sum() == pytest.approx(700, rel=3e-4)


def test_nobody_at_all():
    nobody = FloorPlate(3, 4, 0.2, soles(0))
    no_feet = np.zeros((0, 2))
    pressed = nobody.press(Feet(np.zeros((0, 2, 2)), no_feet, no_feet, no_feet, no_feet, np.zeros(0, dtype=bool)))
    assert pressed.load_n.shape == (3, 4) and not pressed.load_n.any() and pressed.foot_n.shape == (0, 2)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"load_n": np.array([[np.nan, 1.0]])}, "finite ones from 0 on"),
        ({"load_n": np.array([[-5.0, 1.0]])}, "finite ones from 0 on"),
        ({"load_n": np.ones((2, 2))}, r"shape \(2, 2\); \(1, 2\) is needed"),
        ({"pressure_ahead_m": np.array([[0.0, 0.25]])}, "foot 1 of person 0 is loaded at 0.25 m ahead"),
        ({"pressure_ahead_m": np.array([[-0.09, 0.0]])}, "-0.07 to 0.196 m"),
        ({"place": np.full((1, 2, 2), np.nan)}, "finite place"),
        ({"yaw": np.full((1, 2), np.inf)}, "finite place and yaw"),
    ],
)
def test_feet_that_cannot_be(change, complaint):
    with pytest.raises(ValueError, match=complaint):
        PLATE.press(replace(one(1, 1), **change))


def test_soles_that_cannot_be():
    with pytest.raises(ValueError, match="toes' tips ahead of the ball"):
        FloorPlate(2, 2, 0.2, FootShapes(*(np.array([value]) for value in (0.07, 0.2, 0.25, 0.1))))
