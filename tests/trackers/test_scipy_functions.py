"""What stands in for SciPy's packages has their bits."""

import subprocess
import sys

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.sparse.csgraph import shortest_path
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from scipy.special import chdtri as whole_chdtri

from trackers.area import Pose, quaternion_of, rotation_of
from trackers.scipy_functions import chdtri
from twin.people.crowd.routes import _shortest_ways
from twin.people.gait.gait_table import _monotone_cubic
from twin.truth.situations import LINKAGE_M, _close_pairs

RNG = np.random.default_rng(0)


def test_rotations() -> None:
    angles = [*RNG.uniform(-2 * np.pi, 2 * np.pi, (300, 3)), *(RNG.integers(-4, 5, (300, 3)) * np.pi / 4)]
    for roll, pitch, yaw in angles:
        matrix = Pose(rpy=(roll, pitch, yaw)).rotation
        quaternion = quaternion_of(matrix)
        assert np.array_equal(matrix, Rotation.from_euler("xyz", (roll, pitch, yaw)).as_matrix())
        assert np.array_equal(quaternion, Rotation.from_matrix(matrix).as_quat())
        assert np.array_equal(rotation_of(quaternion), Rotation.from_quat(quaternion).as_matrix())
    inexact = Rotation.from_euler("xyz", (1.0, 0.2, -2.0)).as_matrix() + RNG.normal(0, 1e-3, (3, 3))
    assert np.allclose(quaternion_of(inexact), Rotation.from_matrix(inexact).as_quat(), atol=1e-12)


def test_quantiles_of_chi_squares() -> None:
    degrees = RNG.uniform(0.01, 40.0, 5000)
    assert np.array_equal(chdtri(degrees, 0.05), whole_chdtri(degrees, 0.05))


def test_shortest_ways_where_few_and_where_many_see_each_other() -> None:
    for share in (0.05, 0.15, 0.4, 0.9):
        places = RNG.uniform(-5, 5, (60, 2))
        lengths = np.linalg.norm(places[:, None] - places, axis=2) * np.triu(RNG.random((60, 60)) < share, 1)
        for ours, theirs in zip(
            _shortest_ways(lengths + lengths.T),
            shortest_path(lengths + lengths.T, directed=False, return_predecessors=True),
            strict=True,
        ):
            assert np.array_equal(ours, theirs)


def test_monotone_cubics() -> None:
    for k in range(50):
        x, y = np.sort(RNG.uniform(0, 1, 9)), RNG.normal(size=9).round(k % 3)
        at = np.linspace(x[0], x[-1], 101)
        assert np.array_equal(_monotone_cubic(x, y, at), PchipInterpolator(x, y)(at))


def test_pairs_of_close_points() -> None:
    for count in (1, 2, 50, 200):
        points = RNG.normal(0, 1, (count, 2))
        expected = KDTree(points).query_pairs(LINKAGE_M)
        assert {tuple(sorted(pair)) for pair in _close_pairs(points).tolist()} == expected


def test_the_whole_packages_load_after_them() -> None:
    code = "import twin.geometry.polygon\nimport scipy.spatial, scipy.linalg, scipy.optimize, scipy.stats"
    code += "\nscipy.spatial.ConvexHull([[0, 0], [1, 0], [0, 1]])\nfrom scipy.linalg import cython_lapack"
    subprocess.run([sys.executable, "-c", code], check=True)
