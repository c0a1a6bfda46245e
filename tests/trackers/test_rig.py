"""What a rig says of its sensors."""

from itertools import permutations

import pytest

from trackers.cameras import FisheyeIntrinsics, PinholeIntrinsics
from trackers.errors import InputError
from trackers.rig import (
    FisheyeSensor,
    FloorSensor,
    LaserSensor,
    PinholeSensor,
    Pose,
    Rig,
    StereoSensor,
)

PINHOLE = PinholeIntrinsics(width=4, height=4, fx=3.0, fy=3.0, cx=1.5, cy=1.5)
FISHEYE = FisheyeIntrinsics(width=4, height=4, fx=1.0, fy=1.0, cx=1.5, cy=1.5, field_of_view_rad=3.0)
BY_RANK = {
    "z_waist": LaserSensor(topic="/z", role="waist"),
    "y_high": LaserSensor(topic="/y", room_from_sensor=Pose(xyz=(0, 0, 0.9))),
    "x_knee": LaserSensor(topic="/x", role="knee", room_from_sensor=Pose(xyz=(0, 0, 0.9))),
    "w_low": LaserSensor(topic="/w", room_from_sensor=Pose(xyz=(0, 0, 0.3))),
    "v_fisheye": FisheyeSensor(topic="/v", intrinsics=FISHEYE),
    "u_camera": PinholeSensor(topic="/u", intrinsics=PINHOLE),
    "t_stereo": StereoSensor(topic="/t/image/compressed", intrinsics=PINHOLE),
    "s_floor": FloorSensor(topic="/s", rows=2, columns=2, pitch_m=0.2),
}


def test_the_main_sensor_is_chosen_by_what_the_sensors_are():
    expected = ["y_high", "z_waist", "w_low", "x_knee", "v_fisheye", "u_camera", "t_stereo", "s_floor"]
    left, chosen = dict(BY_RANK), []
    while left:
        chosen.append(Rig(sensors=left).main_sensor)
        del left[chosen[-1]]
    assert chosen == expected


def test_the_order_in_the_file_does_not_choose_the_main_sensor():
    some = list(BY_RANK.items())[2:6]
    assert {Rig(sensors=dict(order)).main_sensor for order in permutations(some)} == {"w_low"}


def test_a_rig_may_state_its_main_sensor_and_says_so_when_written_out():
    rig = Rig(sensors=BY_RANK, main="s_floor")
    assert rig.main_sensor == Rig.parse(rig.dump_yaml(), "rig").main_sensor == "s_floor"
    assert "main" not in Rig(sensors=BY_RANK).dump_yaml()  # bags of rigs that do not state it stay the same


def test_a_main_sensor_that_is_none_of_the_rigs_is_refused():
    with pytest.raises(InputError, match=r"rig\.yaml: main is 'top', which is no sensor; valid are low"):
        Rig.parse("sensors: {low: {kind: laser, topic: /scan}}\nmain: top\n", "rig.yaml")


SIZE = {"width": 640, "height": 480, "fx": 600.0, "fy": 600.0, "cx": 320.0, "cy": 240.0}


@pytest.mark.parametrize("count", [0, 4, 5, 8, 12, 14])
def test_zeros_at_the_end_of_a_distortion_are_the_same_lens(count):
    given = ([0.1, -0.2, 0.001, 0.002, 0.0] + [0.0] * 9)[:count]
    lens = PinholeIntrinsics.model_validate(SIZE | {"distortion": given})
    assert lens.distortion == tuple((given + [0.0] * 5)[:5])


@pytest.mark.parametrize("count", [8, 12, 14])
def test_a_rational_lens_is_refused_by_name(count):
    with pytest.raises(ValueError, match="rational_polynomial"):
        PinholeIntrinsics.model_validate(SIZE | {"distortion": [0.0] * (count - 1) + [0.1]})


@pytest.mark.parametrize("kind", ["camera", "stereo", "fisheye"])
def test_a_lens_that_folds_inside_its_picture_is_refused(kind):
    lens = {"k": [-0.3, 0, 0, 0], "field_of_view_rad": 3.2} if kind == "fisheye" else {"distortion": [-5, 0, 0, 0, 0]}
    sensor = {"kind": kind, "topic": "/c/image/compressed", "intrinsics": SIZE | lens}
    with pytest.raises(InputError, match=r"rig.yaml: sensors\.c\.intrinsics: .*folds back"):
        Rig.parse(str({"sensors": {"c": sensor}}), "rig.yaml")


def test_a_scenario_is_not_taken_for_a_rig():
    for text in ("room: lab\npeople: {}\n", "extends: lab-five-people\n"):
        with pytest.raises(InputError, match=r"^mine.yaml: is a scenario; a rig.yaml .* is expected") as refused:
            Rig.parse(text, "mine.yaml")
        assert len(str(refused.value).splitlines()) == 1
