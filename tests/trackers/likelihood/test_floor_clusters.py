"""Clusters of a pressure floor against a flood fill written out, and elements under places."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from trackers.area import Pose
from trackers.errors import InputError
from trackers.likelihood.floor import FloorClusterOptions, floor_clusters
from trackers.observations import FloorFrame
from trackers.rig import FloorSensor

ROWS, COLUMNS = 6, 9
FLOOR = FloorSensor(
    topic="/floor", rows=ROWS, columns=COLUMNS, pitch_m=0.2, room_from_sensor=Pose(xyz=(1, -2, 0), rpy=(0, 0, 0.5))
)
values = arrays(np.uint8, (ROWS, COLUMNS), elements=st.sampled_from([0, 0, 0, 4, 5, 60, 255]))


def frame(content: np.ndarray) -> FloorFrame:
    return FloorFrame("floor", 0, np.asarray(content, np.uint8))


def flood_filled(content: np.ndarray, least: int) -> list[set[tuple[int, int]]]:
    """The clusters as sets of elements, in the order of their first one, by walking from neighbour to neighbour."""
    left = {(int(row), int(column)) for row, column in np.argwhere(content >= least)}
    clusters = []
    while left:
        cluster, open_ends = set(), [min(left)]
        while open_ends:
            row, column = open_ends.pop()
            if (row, column) in left:
                left.remove((row, column))
                cluster.add((row, column))
                open_ends += [(row + down, column + across) for down in (-1, 0, 1) for across in (-1, 0, 1)]
        clusters.append(cluster)
    return clusters


@settings(max_examples=80, deadline=None)
@given(values, st.integers(1, 61), st.integers(1, 4), st.floats(0, 400))
def test_clusters_are_those_of_a_flood_fill(content: np.ndarray, least: int, cells: int, load: float):
    options = FloorClusterOptions(least_value=least, least_cells=cells, least_load_n=load)
    found = floor_clusters(frame(content), FLOOR, options)
    load_n, centres = FLOOR.load_n(content), FLOOR.centres
    place = 0
    for cluster in flood_filled(content, least):
        index = tuple(np.array(sorted(cluster)).T)
        total_n = load_n[index].sum()
        if abs(total_n - load) < 1e-6:
            return  # rounding decides
        if len(cluster) < cells or total_n < load:
            assert (found.cluster_of_cell[index] == -1).all()
            continue
        assert (found.cluster_of_cell[index] == place).all()
        assert (found.cluster_of_cell == place).sum() == len(cluster)
        assert found.load_n[place] == pytest.approx(total_n)
        np.testing.assert_allclose(
            found.centroid[place], (load_n[index][:, None] * centres[index]).sum(axis=0) / total_n, atol=1e-9
        )
        place += 1
    assert len(found) == place
    assert found.cluster_of_cell.max(initial=-1) == place - 1


@settings(max_examples=40, deadline=None)
@given(values)
def test_shares_of_each_cluster_sum_to_one(content: np.ndarray):
    found = floor_clusters(frame(content), FLOOR)
    share = found.share_of_cell()
    assert (share[found.cluster_of_cell < 0] == 0).all()
    for place in range(len(found)):
        assert share[found.cluster_of_cell == place].sum() == pytest.approx(1)


def test_a_corner_joins_and_flicker_does_not():
    content = np.zeros((ROWS, COLUMNS))
    content[0, 0], content[1, 1], content[0, 2], content[4, 4] = 100, 100, 4, 90
    found = floor_clusters(frame(content), FLOOR)
    assert np.bincount(found.cluster_of_cell[found.cluster_of_cell >= 0]).tolist() == [2, 1]
    assert found.cluster_of_cell[[0, 1, 0, 4], [0, 1, 2, 4]].tolist() == [0, 0, -1, 1]


def test_an_empty_floor_has_no_clusters():
    found = floor_clusters(frame(np.zeros((ROWS, COLUMNS))), FLOOR)
    assert len(found) == 0
    assert found.centroid.shape == (0, 2)
    assert not found.share_of_cell().any()


def test_a_frame_of_another_size_is_refused():
    with pytest.raises(InputError, match="frame of 'floor' has 2 x 3 elements; the rig says 6 x 9"):
        floor_clusters(frame(np.zeros((2, 3))), FLOOR)
