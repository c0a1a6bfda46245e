"""Monitor of cameras' poses: errors of estimates count for no camera, a displaced camera is told among others."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trackers.area import Pose
from trackers.cameras.intrinsics import PinholeIntrinsics
from trackers.cameras.placed import PlacedCamera
from trackers.vision.front_end import CalibrationMonitor, projection_jacobian, residual_offsets

CORNERS = np.array([[0.0, 0.0, 2.6], [4.0, 0.0, 2.6], [4.0, 4.0, 2.6], [0.0, 4.0, 2.6]])
LENS = PinholeIntrinsics(width=640, height=480, fx=400.0, fy=400.0, cx=320.0, cy=240.0)


def camera(corner, turn_deg=0.0, moved_m=(0.0, 0.0, 0.0)) -> PlacedCamera:
    """A camera in a corner that looks at the middle of the room, turned about the vertical and moved."""
    ahead = np.array([2.0, 2.0, 1.2]) - corner
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.column_stack([right, np.cross(ahead, right), ahead])
    turn = Rotation.from_euler("z", turn_deg, degrees=True).as_matrix()
    return PlacedCamera(LENS, Pose.from_matrix(turn @ rotation, tuple((corner + moved_m).tolist())))


def measured(true, believed, crowns, estimates, rng):
    """Offsets [m] of tops 1 cm about the crowns from estimates, as the believed cameras project them; a third not found."""
    shape = len(true), len(crowns)
    off, jacobian = np.full((*shape, 2), np.nan), np.zeros((*shape, 2, 3))
    for number, (here, told) in enumerate(zip(true, believed, strict=True)):
        m_per_px = (np.linalg.norm(estimates - told.eye_m, axis=1) / LENS.fx)[:, None]
        off[number] = (here.project(crowns)[0] - told.project(estimates)[0]) * m_per_px + rng.normal(
            0, 0.01, (len(crowns), 2)
        )
        jacobian[number] = projection_jacobian(told, estimates) * m_per_px[..., None]
    off[rng.random(shape) < 1 / 3] = np.nan
    return off, jacobian


@pytest.mark.parametrize("seed", range(1000, 1010))
@pytest.mark.parametrize(
    ("turn_deg", "moved_m"),
    [(0.0, (0.0, 0.0, 0.0)), (5.0, (0.0, 0.0, 0.0)), (0.0, (0.14, -0.14, 0.0))],
    ids=["right", "5°", "20 cm"],
)
def test_errors_of_estimates_count_for_no_camera_and_a_displaced_one_is_told(turn_deg, moved_m, seed):
    rng = np.random.default_rng(seed)
    wrong = int(rng.integers(4))
    believed = [camera(each) for each in CORNERS]
    true = [camera(each, *((turn_deg, moved_m) if k == wrong else ())) for k, each in enumerate(CORNERS)]
    monitor = CalibrationMonitor(4, 0.04)
    bias = rng.normal(0, 0.08, 3)  # the estimates are off in the same way all the time
    for _ in range(60):
        crowns = rng.uniform([1.0, 1.0, 1.4], [3.0, 3.0, 1.9], (3, 3))
        monitor.take_heads(*measured(true, believed, crowns, crowns + bias, rng))
    assert monitor.suspect == ([wrong] if turn_deg or any(moved_m) else [])


def test_two_cameras_and_exact_estimates_say_nothing():
    rng = np.random.default_rng(1000)
    cameras = [camera(each) for each in CORNERS]
    crowns = rng.uniform([1.0, 1.0, 1.4], [3.0, 3.0, 1.9], (5, 3))
    off, jacobian = measured(cameras, cameras, crowns, crowns, rng)
    off[2:] = np.nan
    residual, explained = residual_offsets(off, jacobian)
    assert np.isnan(residual).all() and np.isnan(explained).all()
    residual, explained = residual_offsets(np.zeros_like(off), jacobian)
    assert not residual.any() and not explained.any()
