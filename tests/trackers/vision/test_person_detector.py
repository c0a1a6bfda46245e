"""People found in masks of plain figures."""

import numpy as np
import pytest
import synthetic_view as view
from scipy.optimize import linear_sum_assignment

from trackers.rig import placed_camera
from trackers.vision.person_detector import DetectorOptions, PersonDetector


def detector(on, **options) -> PersonDetector:
    return PersonDetector(placed_camera(on.cameras()["camera"]), on.area, DetectorOptions(**options))


@pytest.mark.parametrize("fisheye", [False, True])
@pytest.mark.parametrize(
    "places",
    [
        [],
        [(0.5, 1.0)],
        [(-2.0, -1.0), (1.0, 1.0), (2.5, -1.5)],
        [(0.0, 1.5), (0.9, 1.5)],  # abreast
        [(1.0, -0.5), (1.0, 1.0)],  # one behind the other
    ],
)
def test_everybody_is_found_once_and_where_they_stand(fisheye, places):
    on, truth = view.rig(fisheye), np.array(places, float).reshape(-1, 2)
    seen = detector(on).detect(view.mask(on, truth))
    assert len(seen) == len(truth)
    distance = np.linalg.norm(seen.position[:, None] - truth[None], axis=-1)
    assert (distance[linear_sum_assignment(distance)] < 0.25).all()
    assert (np.diff(seen.score) <= 0).all() and (np.linalg.eigvalsh(seen.covariance) > 0).all()


def test_a_person_cut_by_the_picture_s_border_is_found():
    on = view.rig()
    camera = placed_camera(on.cameras()["camera"])
    edge = next(x for x in np.arange(3, 6, 0.05) if not camera.project(np.array([x + 0.2, -0.5, 1.0]))[1])
    seen = detector(on).detect(view.mask(on, np.array([(edge, -0.5)])))
    assert len(seen) == 1 and np.hypot(*(seen.position[0] - (edge, -0.5))) < 0.35


def test_nobody_is_in_a_mask_that_is_full_or_full_of_specks():
    on = view.rig()
    shape = (240, 320)
    specks = np.random.default_rng(0).random(shape) < 0.02
    for mask in (np.ones(shape, np.bool_), specks):
        assert len(detector(on).detect(mask)) == 0


def test_scores_are_read_between_places():
    on = view.rig()
    looks = detector(on)
    seen = looks.detect(view.mask(on, np.array([(0.5, 1.0)])))
    scores = looks.places.read(seen.scores, np.array([(0.5, 0.5, -2.0, 99.0), (1.0, 1.6, -1.0, 0.0)]))
    assert scores[0] > 0.4 and scores[0] > scores[1] and scores[2] == scores[3] == 0
    np.testing.assert_array_equal(looks.places.shows(np.array([(0.5, 1.0), (99.0, 0.0)])), [True, False])


def test_without_an_area_people_are_found_as_far_as_it_says():
    on = view.rig().model_copy(update={"area": None})
    mask = view.mask(on, np.array([(0.0, 0.0), (1.0, 6.0)]))
    assert len(detector(on).detect(mask)) == 2
    assert len(detector(on, reach_m=9.0).detect(mask)) == 1


def test_a_camera_that_sees_no_place_of_the_area_finds_nobody():
    on = view.rig().model_copy(update={"area": ((50.0, 50), (51, 50), (51, 51))})
    looks = detector(on)
    assert len(looks.places) == 0 and len(looks.detect(np.ones((240, 320), np.bool_))) == 0


def test_a_reach_that_cuts_what_the_camera_sees_is_said() -> None:
    camera = placed_camera(view.rig().cameras()["camera"])
    (warning,) = PersonDetector(camera, None, DetectorOptions(reach_m=3.0)).warnings("camera")
    assert "farther off than 3 m" in warning
    assert PersonDetector(camera, [[-2, 1], [2, 1], [0, 3]], DetectorOptions(reach_m=3.0)).warnings("camera") == []
