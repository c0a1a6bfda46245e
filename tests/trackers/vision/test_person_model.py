"""The learned model of people, as a file."""

import numpy as np
import pytest
import threadpoolctl  # scikit-learn's

from trackers.errors import InputError
from trackers.vision.person_detector import INPUTS, SHIPPED, PersonModel


def test_the_shipped_model_is_small_and_needs_no_pickle():
    model = PersonModel.load()
    assert SHIPPED.stat().st_size < 100_000
    assert model.nearness(np.zeros((3, INPUTS), np.float32)).shape == (3, 1)
    assert model.offset(np.zeros((0, INPUTS), np.float32)).shape == (0, 2)
    assert (model.deviation_m < 0.2).all()


@pytest.mark.parametrize("count", [1, 15, 16, 17, 300])
def test_a_window_is_judged_alike_beside_any_others_and_by_any_number_of_threads(count: int):
    model, inputs = PersonModel.load().symmetrized(), np.random.default_rng(0).random((300, INPUTS), np.float32)
    for network in (model.nearness, model.offset):
        with threadpoolctl.threadpool_limits(1, "blas"):
            alone = network(inputs[:count])
        with threadpoolctl.threadpool_limits(2, "blas"):
            np.testing.assert_array_equal(network(inputs)[:count], alone)


def test_a_model_read_is_the_model_written(tmp_path):
    model = PersonModel.load()
    model.save(tmp_path / "people.npz")
    again, inputs = PersonModel.load(tmp_path / "people.npz"), np.random.default_rng(0).random((5, INPUTS), np.float32)
    np.testing.assert_array_equal(again.nearness(inputs), model.nearness(inputs))
    np.testing.assert_array_equal(again.offset(inputs), model.offset(inputs))
    np.testing.assert_array_equal(again.deviation_m, model.deviation_m)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda held: held.pop("offset_out"), "offset_out is missing"),
        (lambda held: held.update(nearness_into=held["nearness_into"][:5]), r"nearness_into has shape \(5, "),
        (
            lambda held: held.update(nearness_out=held["nearness_out"] * np.nan),
            "nearness_out holds nan; finite numbers",
        ),
        (lambda held: held.update(deviation_m=np.zeros(2)), "deviation_m holds 0.0; "),
        (lambda held: held.update(deviation_m=np.array([None, 1], object)), "deviation_m holds object; numbers"),
    ],
)
def test_a_file_that_is_no_such_model_is_refused(tmp_path, change, says):
    with np.load(SHIPPED) as file:
        held = dict(file)
    change(held)
    path = tmp_path / "people.npz"
    np.savez(path, **held)
    with pytest.raises(InputError, match=f"people.npz: .*{says}"):
        PersonModel.load(path)


def test_a_file_that_is_missing_or_cut_is_refused(tmp_path):
    (tmp_path / "cut.npz").write_bytes(SHIPPED.read_bytes()[:5000])
    for name in ("cut.npz", "none.npz"):
        with pytest.raises(
            InputError, match=f"{name}: .*; a file that scripts/train-person-detector wrote is expected"
        ):
            PersonModel.load(tmp_path / name)
