"""What will be made is said before, counted before it is made, and refused above limits that a flag lifts."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from command_line import twin

from trackers.errors import InputError
from twin.cli import app
from twin.run.live import run_scenario
from twin.scenario import load_scenario
from twin.scenario.run_size import check_size, size_of
from twin.suites.expansion import check_case_count
from twin.suites.spec import load_suite

pytestmark = pytest.mark.slow

SUITE = """
name: many
scenarios:
  - {{scenario: lab-five-people, seeds: {seeds}, grid: {grid}}}
trackers: [laser-imm]
"""


HEIGHTS = [f"1.{tenth}" for tenth in range(10)]


def test_a_run_makes_about_as_much_as_was_said(tmp_path: Path) -> None:
    scenario = load_scenario("lab-five-people", ["duration_s=1"])
    size = size_of(scenario, images=False)
    assert (size.seconds, size.people, size.observations) == (1, 5, 20)
    run_scenario(scenario, trackers=[], out=tmp_path, video=False, images=False)
    made = sum(path.stat().st_size for path in tmp_path.iterdir())
    assert made / 2 < size.n_bytes < made * 2
    assert size_of(scenario).n_bytes > 10 * size.n_bytes  # pictures are most of it


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["duration_s=86400"], r"duration_s: the recording would be 86400 s, 5 people, .* GB; at most 20 GB, or --no-limits"),
        (["sensors.fisheye.size=[8192, 8192]"], "sensors.fisheye: a picture has 67108864 pixels; at most 16777216"),
        (["background_frames=1000"], "background_frames: 1000 pictures of the empty room by every camera are 1.08 GB in memory"),
        (
            ["people={" + ", ".join(f"p{number}: {{}}" for number in range(1001)) + "}"],
            "people: 1001 are there; at most 1000, or --no-limits",
        ),
    ],
)  # fmt: skip
def test_what_nobody_can_have_meant_is_refused(overrides: list[str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        check_size(load_scenario("lab-five-people", overrides))


def test_every_shipped_scenario_is_far_from_the_limits() -> None:
    from twin import models

    for name in models.names("scenarios"):
        scenario = load_scenario(name)
        check_size(scenario)
        assert size_of(scenario).n_bytes < 1e9


def test_a_run_says_what_it_makes_and_writes_nothing_where_that_is_too_much(tmp_path: Path) -> None:
    many = "people={" + ", ".join(f"p{number}: {{arrive_s: 1000}}" for number in range(1001)) + "}"
    refused = twin("render", "lab-five-people", "--set", many, "--duration", "0.1", "--no-images", cwd=tmp_path)
    assert refused.returncode == 2 and "or --no-limits, is expected" in refused.stderr
    assert not list(tmp_path.iterdir())
    told = twin("render", "lab-five-people", "--duration", "0.1", "--no-images", "--no-video", cwd=tmp_path)
    assert told.returncode == 0 and "twin: planned: 0.1 s, 5 people, 2 observations, about " in told.stderr


def test_a_flag_lifts_the_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("twin.scenario.run_size.MOST_BYTES", 1000)
    arguments = ["render", "lab-five-people", "--duration", "0.1", "--no-images", "--no-video", "--out", str(tmp_path)]
    with pytest.raises(InputError, match="at most 1 kB, or --no-limits, is expected"):
        app(arguments, standalone_mode=False)
    app([*arguments, "--no-limits"], standalone_mode=False)
    assert (tmp_path / "recording.mcap").is_file()


@pytest.mark.parametrize(
    ("seeds", "grid", "n_case"),
    [
        (100_000, "{}", 100_000),
        (1, "{" + ", ".join(f"people.p{k}.height_m: [{', '.join(HEIGHTS)}]" for k in range(9)) + "}", 10**9),
    ],
)  # fmt: skip
def test_the_cases_of_a_suite_are_counted_before_they_are_made(
    tmp_path: Path, seeds: int, grid: str, n_case: int
) -> None:
    path = tmp_path / "many.yaml"
    path.write_text(SUITE.format(seeds=seeds, grid=grid))
    suite, _ = load_suite(path)
    assert suite.n_case == n_case
    with pytest.raises(
        InputError, match=rf"many\.yaml: has {n_case} cases .*; at most 5000, or --no-limits, is expected"
    ):
        check_case_count(suite, path)
    done = twin("suite", "run", str(path), "--out", "out", cwd=tmp_path)
    assert done.returncode == 2 and f"has {n_case} cases" in done.stderr and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("limit", "said", "made"),
    [
        (
            "twin.evaluate.summary.MOST_PAIRS",
            "its frames hold [0-9]+ pairs of a person",
            ["metrics.json", "report.html"],
        ),
        ("twin.tables.columns.MOST_LINES", "has more than 10 lines", []),
    ],
)
def test_a_run_whose_evaluation_is_above_a_limit_is_finished_without(
    limit: str, said: str, made: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What of an evaluation can be foreseen is warned of before the simulation; its files are kept, and repeated into."""
    monkeypatch.setattr(limit, 10)
    if limit.endswith("PAIRS"):
        monkeypatch.setattr("twin.run.outcome.MOST_PAIRS", 10)
    quick = ["lab-five-people", "--duration", "0.5", "--no-images", "--no-video", "--tracker", "sort"]
    for _ in range(2):
        done = twin("run", *quick, "--out", tmp_path)
        assert done.returncode == 1 and "Traceback" not in done.stderr
        assert re.search(
            rf"^twin: sort: is not evaluated; \S+: {said}.*, or --no-limits, is expected$", done.stderr, re.M
        )
        assert done.stderr.startswith("twin: warning: a tracker that finds everybody") == limit.endswith("PAIRS")
        assert all((tmp_path / each).is_file() for each in ["recording.mcap", "truth.csv", "tracks/sort.csv"])
        assert [each for each in ("metrics.json", "report.html") if (tmp_path / each).exists()] == made
