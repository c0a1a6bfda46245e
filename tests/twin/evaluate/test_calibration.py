"""Calibration of stated radii: a tracker that knows its error is found calibrated, one that does not is found out."""

from typing import Any

import numpy as np
import pytest

from trackers.filters.imm import Imm, ImmState
from trackers.filters.motion import AGILE, VelocityMotion
from trackers.filters.negative_information import probability_within, radius_containing
from trackers.tracks import Track, TrackFrame
from twin.evaluate import evaluate_tracks
from twin.evaluate.accuracy import calibration_curve
from twin.recording.tables import read_tracks, track_table, track_writer, truth_table
from twin.report.page import calibration_chart
from twin.truth.truth_types import PersonTruth, TruthFrame

SIGMA_M = 0.08


def run(claim=1.0, n=1500, lost=False):
    """Tracks with a normal error of `SIGMA_M` on each axis, whose radii are `claim` times what they should be."""
    rng = np.random.default_rng(5)
    truth, tracks = [], []
    for k in range(n):
        x, y = rng.uniform(0, 5, 2)
        person: dict[str, Any] = dict(
            z=0.9, yaw=0, head_x=x, head_y=y, head_z=1.6, head_yaw=0, vx=0, vy=0, in_area=True
        )
        truth.append(TruthFrame(k * 10**8, (PersonTruth(id=1, x=x, y=y, **person),)))
        error = rng.normal(0, SIGMA_M, 2)
        radius = claim * SIGMA_M * np.sqrt(-2 * np.log(0.05))
        far = 3.0 if lost and k % 4 == 0 else 0.0
        tracks.append(TrackFrame(k * 10**8, (Track(1, x + error[0] + far, y + error[1], radius95_m=radius),)))
    return truth_table(truth), tracks


def test_true_claims_lie_on_the_diagonal():
    truth, tracks = run()
    metrics = evaluate_tracks(truth, track_table(tracks))
    assert metrics["within_radius"]["n"] == 1500
    for claimed, found in calibration_curve(metrics):
        assert found == pytest.approx(claimed, abs=0.04)


@pytest.mark.parametrize(("claim", "low", "high"), [(0.5, 0.4, 0.6), (2.0, 0.999, 1.0)])
def test_radii_too_small_or_too_large_are_found_out(claim, low, high):
    truth, tracks = run(claim)
    assert low <= evaluate_tracks(truth, track_table(tracks))["within_radius"]["95"] <= high


def test_a_track_far_from_everybody_is_not_within():
    truth, tracks = run(lost=True)
    assert evaluate_tracks(truth, track_table(tracks))["within_radius"]["95"] == pytest.approx(0.75 * 0.95, abs=0.03)


def test_none_where_no_radius_is_stated():
    truth, tracks = run(n=3)
    silent = [TrackFrame(f.stamp_ns, tuple(Track(t.id, t.x, t.y) for t in f.tracks)) for f in tracks]
    metrics = evaluate_tracks(truth, track_table(silent))
    assert metrics["within_radius"] is None and calibration_curve(metrics) == []


def test_radii_survive_the_table_and_older_tables_have_none(tmp_path):
    _, tracks = run(n=3)
    with track_writer(tmp_path / "tracks.csv") as write:
        for frame in tracks:
            write(frame)
    assert read_tracks(tmp_path / "tracks.csv").radius95_m.tolist() == track_table(tracks).radius95_m.tolist()
    (tmp_path / "old.csv").write_text("t,id,x,y\n0.1,1,2,3\n")
    assert np.isnan(read_tracks(tmp_path / "old.csv").radius95_m).all()


def test_the_radius_of_a_mixture_holds_the_share():
    rng = np.random.default_rng(3)
    imm, n = Imm(), 6
    state = imm.start(rng.normal(0, 2, (n, 2)), rng.normal(0, 1, (n, 2)))
    for _ in range(8):
        state = imm.predict(state, 0.1)
    state = ImmState(state.mean, state.covariance, rng.dirichlet(np.ones(imm.n_mode), n).T)
    centre, along = (state.mean[:2] * state.probability).sum(axis=1).T, imm.velocity(state)
    for share in (0.5, 0.95):
        radius_m = radius_containing(state, centre, share)
        found = [probability_within(state, centre, each, along)[k] for k, each in enumerate(radius_m.tolist())]
        assert found == pytest.approx(np.full(n, share), abs=0.02)


def test_an_error_that_all_measurements_share_widens_the_radius():
    state = Imm(VelocityMotion((AGILE,))).start(np.zeros((2, 2)), None, 0.02)
    radius_m = radius_containing(state, np.zeros((2, 2)), 0.95, np.array([0.0, 0.01]))
    assert radius_m == pytest.approx(np.sqrt(-2 * np.log(0.05) * np.array([0.02, 0.03])))


def test_chart_escapes_names():
    assert "<b>" not in calibration_chart([("<b>", 0, [(0.5, 0.4), (0.95, 0.9)])])
