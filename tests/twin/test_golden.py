"""A short scenario against truth, tracks and figures that were looked at and found right.

The tracks are those of `sort`, the plain baseline, which has few reasons to change: they hold the way from the people to the
metrics. Better trackers rewrite nothing: what they reach is held by bounds (`run/test_trackers_on_the_lab.py`).
`python tests/twin/test_golden.py` writes them anew, with the versions they hold for; look at the change before it is kept.
"""

from __future__ import annotations

import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from twin.recording.tables import read_tracks, read_truth
from twin.run.live import run_scenario
from twin.scenario import load_scenario

FOLDER = Path(__file__).parent / "golden"
TRACKER = "sort"
COMPARED = ("mota", "motp_m", "idf1", "hota", "gospa_m", "ospa_m", "id_switches", "misses", "false_positives")


def run(out: Path) -> dict:
    scenario = load_scenario("lab-five-people", ["duration_s=4", "seed=7"])
    return run_scenario(scenario, trackers=[TRACKER], out=out, video=False, images=False).metrics or {}


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    out = tmp_path_factory.mktemp("golden")
    return out, run(out)


@pytest.fixture(scope="module")
def noted() -> dict:
    return json.loads((FOLDER / "metrics.json").read_text())


def test_truth(fresh: tuple[Path, dict]) -> None:
    ours, golden = read_truth(fresh[0] / "truth.csv"), read_truth(FOLDER / "truth.csv")
    assert np.array_equal(ours.stamps_ns, golden.stamps_ns)
    for name in ("x", "y", "z", "yaw", "head_x", "head_y", "head_z"):
        np.testing.assert_allclose(getattr(ours, name), getattr(golden, name), rtol=0, atol=1e-6)


def test_tracks_and_figures(fresh: tuple[Path, dict], noted: dict) -> None:
    folder, metrics = fresh
    if metrics["versions"]["mujoco"] != noted["versions"]["mujoco"]:
        pytest.skip(
            f"mujoco is {metrics['versions']['mujoco']}; the golden tracks are for {noted['versions']['mujoco']}"
        )
    ours, golden = read_tracks(folder / "tracks" / f"{TRACKER}.csv"), read_tracks(FOLDER / f"{TRACKER}.csv")
    assert np.array_equal(ours.stamps_ns, golden.stamps_ns)
    assert np.array_equal(ours.id, golden.id)
    np.testing.assert_allclose(np.stack([ours.x, ours.y]), np.stack([golden.x, golden.y]), rtol=0, atol=1e-6)
    for name in COMPARED:
        assert metrics["trackers"][TRACKER][name] == pytest.approx(noted["trackers"][TRACKER][name], abs=1e-6)


def write() -> None:
    FOLDER.mkdir(exist_ok=True)
    with TemporaryDirectory() as folder:
        out = Path(folder)
        metrics = run(out)
        (FOLDER / "truth.csv").write_bytes((out / "truth.csv").read_bytes())
        (FOLDER / f"{TRACKER}.csv").write_bytes((out / "tracks" / f"{TRACKER}.csv").read_bytes())
    kept = {name: {key: figures[key] for key in COMPARED} for name, figures in metrics["trackers"].items()}
    text = json.dumps({"versions": metrics["versions"], "trackers": kept}, indent=2)
    (FOLDER / "metrics.json").write_text(text + "\n")


if __name__ == "__main__":
    write()
