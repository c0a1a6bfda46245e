"""What a recording holds: the same people are told from others, and a scanner's noise from its absence."""

from __future__ import annotations

import csv
import importlib
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from twin.scenario import load_scenario
from twin.suites.cache_keys import plug_in_code
from twin.suites.metrics import GATED_SENSOR_METRICS
from twin.suites.permutation_test import start_digest
from twin.suites.worker import RECORDING, TRUTH, people_digest, range_scatter_m, record

LASERS = ("sensors.fisheye=null", "duration_s=2", "background=none")
SCANNERS = {"scanner at 0, 0, 0.95", "scanner at 0, 0, 0.45"}


def recorded(folder: Path, *changes: str, seed: int = 1800) -> Path:
    record(load_scenario("lab-five-people", [*LASERS, *changes, f"seed={seed}"]), folder)
    return folder


def sensors(change: Callable[[dict], dict]) -> str:
    """The change that makes the lab's sensors others."""
    described = load_scenario("lab-five-people", LASERS).model_dump(mode="json", exclude_none=True)["sensors"]
    return f"sensors={json.dumps(change(described))}"


@pytest.fixture(scope="module")
def as_it_is(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("as-it-is"))


def test_people_are_the_same_whatever_sensors_look_at_them(as_it_is: Path, tmp_path: Path) -> None:
    digest = people_digest(as_it_is / TRUTH)
    assert len(digest) == 2 * 12 + 1
    third = {"kind": "laser", "rate_hz": 7, "mount": {"xyz": [2.3, 1.5, 1.2], "yaw_deg": 180}}
    for how, change in {
        "renamed": sensors(lambda lab: {f"{name}-2": each for name, each in lab.items()}),
        "in another order": sensors(lambda lab: dict(reversed(lab.items()))),
        "with a third that looks at other moments": sensors(lambda lab: {"third": third, **lab}),
        "noisier": "sensors.knee.noise.sigma_m=0.01",
    }.items():
        assert people_digest(recorded(tmp_path / how, change) / TRUTH) == digest, how
    assert people_digest(recorded(tmp_path / "others", seed=1801) / TRUTH) != digest
    taller = recorded(tmp_path / "taller", "people.pink.height_m=1.7")
    assert people_digest(taller / TRUTH) != digest
    longer = people_digest(recorded(tmp_path / "longer", "duration_s=3") / TRUTH)
    assert longer != digest and start_digest(longer) == start_digest(digest)


def changed_truth(path: Path, out: Path, change: Callable[[list[dict[str, str]]], Sequence[dict[str, str]]]) -> Path:
    rows = list(csv.DictReader(path.open()))
    with out.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(change(rows))
    return out


def test_people_are_the_same_in_another_order_and_but_for_last_bits_and_others_by_a_millimetre(
    as_it_is: Path, tmp_path: Path
) -> None:
    truth = as_it_is / TRUTH
    digest = people_digest(truth)

    def moved(by: float) -> Path:
        return changed_truth(
            truth, tmp_path / "truth.csv", lambda rows: [{**row, "x": str(float(row["x"]) + by)} for row in rows]
        )

    def renumbered(rows: list[dict[str, str]]) -> list[dict[str, str]]:
        return [{**row, "id": str(6 - int(row["id"]))} for row in rows]

    assert people_digest(changed_truth(truth, tmp_path / "truth.csv", renumbered)) == digest
    assert people_digest(moved(1e-12)) == digest
    assert people_digest(moved(1e-3)) != digest
    between = changed_truth(truth, tmp_path / "truth.csv", lambda rows: [row for row in rows if float(row["t"]) % 1])
    assert people_digest(between) == ""


@pytest.mark.parametrize("sigma_m", [0.005, 0.01])
def test_the_scatter_of_a_scanner_is_its_noise_where_nobody_walks(tmp_path: Path, sigma_m: float) -> None:
    noise = json.dumps({"sigma_m": sigma_m})
    scenario = load_scenario(
        "lab-five-people", [*LASERS, "people={}", f"sensors.waist.noise={noise}", "sensors.knee.noise=off", "seed=1800"]
    )
    record(scenario, tmp_path)
    scatter = range_scatter_m(tmp_path / RECORDING, scenario)
    assert scatter["scanner at 0, 0, 0.95"] == pytest.approx(sigma_m, rel=0.03)
    assert scatter["scanner at 0, 0, 0.45"] < 1e-6


def test_a_noise_that_doubled_shows_through_the_people_who_walk(as_it_is: Path, tmp_path: Path) -> None:
    scenario = load_scenario("lab-five-people", [*LASERS, "seed=1800"])
    before = range_scatter_m(as_it_is / RECORDING, scenario)
    renamed = sensors(lambda lab: {f"{name}-2": each for name, each in lab.items()})
    doubled = recorded(tmp_path / "doubled", "sensors.waist.noise.sigma_m=0.01", "sensors.knee.noise.sigma_m=0.01")
    other = recorded(tmp_path / "other", renamed)
    assert set(before) == SCANNERS
    of_other = range_scatter_m(other / RECORDING, load_scenario("lab-five-people", [*LASERS, renamed]))
    of_doubled = range_scatter_m(doubled / RECORDING, scenario)
    for scanner, was in before.items():
        allowed = GATED_SENSOR_METRICS["range_scatter_m"].relative * was
        assert abs(of_other[scanner] - was) < allowed
        assert of_doubled[scanner] - was > 2 * allowed


def test_scanners_without_a_scan_have_no_scatter(tmp_path: Path) -> None:
    scenario = load_scenario("lab-five-people", [*LASERS, "sensors.knee.dropout=1", "seed=1800"])
    record(scenario, tmp_path)
    assert set(range_scatter_m(tmp_path / RECORDING, scenario)) == SCANNERS - {"scanner at 0, 0, 0.45"}


@pytest.mark.parametrize("changed", ["lazy_lab/__init__.py", "lazy_lab/gain.py", "lazy_gain.py", "lazy_parts/deep.py"])
def test_the_code_of_a_tracker_is_all_that_it_may_import_at_its_first_call(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changed: str
) -> None:
    for name, text in {
        "lazy_lab/__init__.py": "from . import mine\n",
        "lazy_lab/mine.py": "def update():\n    from .gain import G\n    import lazy_gain, lazy_parts.deep\n",
        "lazy_lab/gain.py": "G = 1\n",
        "lazy_gain.py": "G = 1\n",
        "lazy_parts/deep.py": "G = 1\n",  # without __init__: a namespace
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module("lazy_lab.mine")
    before = plug_in_code("lazy_lab.mine:Mine")
    (tmp_path / changed).write_text("G = 2\n")
    assert plug_in_code("lazy_lab.mine:Mine") != before
    assert not {"lazy_gain", "lazy_parts", "lazy_lab.gain"} & set(sys.modules)
