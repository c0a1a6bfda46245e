"""Studies as files: what is wrong with one is told in one sentence, all of it at once, and nothing is written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from small_study import changed, written

from trackers.errors import InputError
from twin import models
from twin.scenario import load_scenario
from twin.studies.apply_placement import write_scenario
from twin.studies.preflight import prepare
from twin.studies.results import print_summary
from twin.studies.run import run_study
from twin.studies.spec import Study, load_study
from twin.studies.trials import Trial
from twin.studies.validation import nearly_as_good
from twin.suites.cluster import Workers

PLACE = {"xyz": [0, 3.6, 0.95], "yaw_deg": -90}
AMID = {"xyz": [0, 1.5, 0.95]}
OUTSIDE = {"xyz": [40, 40, 0.95]}
FAR = [[0, 1], [30, 1], [30, 2], [0, 2]]


@pytest.mark.slow
@pytest.mark.parametrize("name", models.names("studies"))
def test_shipped_studies_are_ready_to_run(name: str) -> None:
    prepared = prepare(name)
    assert prepared.study.name == name and prepared.study.description
    assert all(prepared.candidate_set.by_device.values())
    assert not prepared.warnings


IDLE = [
    ({"objectives": [{"kind": "coverage"}], "held_out": None}, "trackers: no objective uses laser-imm; it is run for"),
    ({"trackers": ["laser-imm", "sort"], "objectives.0.tracker": "sort"}, "trackers: no objective uses laser-imm; it"),
    ({"devices.rig.price": 0, "cheapest_within": 0.1}, "cheapest_within: decides nothing, as every placement costs"),
    ({"devices.rig.price": 0, "constraints.budget": 10}, "constraints.budget: decides nothing, as every placement"),
    (
        {"devices.rig.price": 0, "objectives": [{"kind": "metric", "metric": "hota"}, {"kind": "price"}]},
        "objectives.1: decides nothing, as every placement costs nothing; a price of a device is expected",
    ),
    ({"search.method": "exhaustive"}, "search.candidates: has no effect without search.method optuna"),
    ({"search.limit_s": 5}, "search.limit_s: has no effect without search.method exact"),
    ({"coverage.cell_m": 0.2}, "coverage.cell_m: has no effect without coverage.of floor"),
    ({"coverage.target": "head"}, "coverage.target: has no effect without cameras"),
    ({"objectives.0.quantile": 0.2}, "objectives.0.quantile: has no effect without over quantile"),
    ({"objectives.0.form": "worst"}, "objectives.0.form: has no effect without kind coverage"),
    ({"devices.rig.yaw_every_deg": 5}, "devices.rig.yaw_every_deg: has no effect without yaw_deg"),
]


@pytest.mark.parametrize(("changes", "said"), IDLE, ids=[said[:30] for _, said in IDLE])
def test_what_has_no_effect_is_told(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    path = written(tmp_path, **{field.replace(".", "__"): value for field, value in changes.items()})
    assert [each for each in prepare(path, seed_offset=3).warnings if each.startswith(f"{path}: {said}")]
    assert not prepare(written(tmp_path), seed_offset=3).warnings


def test_the_schema_describes_every_field() -> None:
    schema = Study.model_json_schema()
    definitions = [schema, *schema["$defs"].values()]
    assert not [
        field
        for each in definitions
        if each.get("title")
        in ("Study", "Device", "Coverage", "Search", "Objective", "Constraints", "Cable", "KeepFreeZone")
        for field, content in each["properties"].items()
        if "description" not in content
    ]
    json.dumps(schema)


def test_every_fault_is_named_at_once(tmp_path: Path) -> None:
    path = written(tmp_path, search__method="magic", devices__rig__walls__height_m=[2, 1], seeds=[-1], colour="red")
    with pytest.raises(InputError) as raised:
        load_study(path)
    lines = str(raised.value).splitlines()
    assert len(lines) == 4 and all(line.startswith(str(path)) for line in lines)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"devices__rig__walls__height_m": [2, 1]}, "height_m: 2 to 1 is upside down; the lower end first is expected, as in"),
        ({"devices__rig__count": [3, 1]}, "count: 3 to 1 is upside down"),
        ({"devices__rig__count": [1, 2, 3]}, "count: the first and the last alone, as [1, 3], are expected (got [1, 2, 3])"),
        ({"devices__rig__walls__height_m": [0.9, 2, 1]}, "height_m: the first and the last alone, as [0.9, 2], are"),
        ({"held_out__seeds": [1000]}, "held_out.seeds: 1000 is a search seed too; others than 1000, 1001 are expected"),
        ({"objectives": [{"kind": "coverage"}]}, "held_out: validates trackers' metrics, and no objective is one"),
        ({"devices__rig__walls": None, "devices__rig__aim": None, "devices__rig__ceiling": {"every_m": 50}},
         "devices.rig: no place on the grid is under a ceiling; a geom of the room above 2 m, a finer every_m"),
        ({"search__replicates": [2, 16]}, "search.replicates: 16 seeds are asked for and seeds has 2"),
        ({"search__method": "exact"}, "search.method: 'exact' goes by coverage as a share, and objectives.0 is laser-imm: hota"),
        ({"objectives": [{"kind": "metric", "metric": "hot"}]}, "unknown metric 'hot'; did you mean 'hota'? valid are "),
        ({"objectives": [{"kind": "metric", "metric": "ms_per_frame.mean"}]}, "unknown metric 'ms_per_frame.mean'"),
        ({"objectives__0__tracker": "sort"}, "objectives.0.tracker: 'sort' is none of the trackers; valid are laser-imm"),
        ({"trackers": ["laser-omm"]}, "trackers.0: there is no tracker 'laser-omm'; did you mean 'laser-imm'? valid are "),
        ({"devices__rig__together": ["waste"]},
         "devices.rig.together: lab-five-people has no sensor 'waste'; did you mean 'waist'? valid are waist, knee"),
        ({"scenarios__0__set__area": FAR}, "scenarios.0.set.area: the edge from [0, 1] to [30, 1] is outside the room's"),
        ({"held_out__scenarios": [{"scenario": "lab-five-people", "set": {"sensors.fisheye.mount.xyz": [0, 9, 1]}}]},
         "held_out.scenarios.0.set.sensors.fisheye.mount.xyz: [0, 9, 1] is inside 'wall_far' of the room"),
        ({"devices__rig__walls": None}, "no place is given; places, walls, ceiling or box is expected"),
        ({"devices__rig__together": None}, "one of sensors, together and housing is expected"),
        ({"scenarios__0__scenario": "lab"}, "scenarios.0.scenario: there is no scenario 'lab'"),
        ({"constraints__budget": 100}, "constraints.budget: 100 is below the cheapest set, which costs 1500; at least that"),
        (
            {"devices__rig__walls": None, "devices__rig__places": [AMID]},
            "devices.rig: of its 1 poses none is left: 1 where people walk below 2.2 m; other poses or weaker constraints",
        ),
        (
            {"devices__rig__walls": None, "devices__rig__places": [OUTSIDE]},
            "devices.rig: of its 1 poses none is left: 1 outside the building",
        ),
        (
            {"devices__rig__walls": None, "devices__rig__places": [{"xyz": [0, -0.3, 0.95]}]},
            "none is left: 1 inside a wall or a thing",
        ),
        (
            {"devices__rig__count": [2, 2], "constraints__apart_m": 50},
            "constraints.apart_m and devices.rig.count: 2 devices 50 m apart do not fit in",
        ),
        (
            {"constraints__cable": {"from": [0, 0, 0], "most": 1}},
            "constraints.cable.most: unknown key; did you mean 'most_m'? valid here: along, from, most_m, price_per_m",
        ),
        (
            {"constraints__cable": {"from": [0, 0, 0], "most_m": 0.1}},
            "with more than 0.1 m of cable; other poses",
        ),
        (
            {"constraints__keep_free": {"doors_m": 1}},
            "keep_free: a list of mappings with doors_m, from_m, name, polygon, to_m is expected (got {'doors_m': 1})",
        ),
        (
            {"constraints__keep_free": ["door"]},
            "keep_free.0: a mapping with doors_m, from_m, name, polygon, to_m is expected (got 'door')",
        ),
        ({"constraints__keep_free": [{"name": "door"}]}, "keep_free.0: one of polygon and doors_m is expected, as in {"),
        (
            {"constraints__keep_free": [{"name": "all", "polygon": [[-9, -9], [9, -9], [9, 9], [-9, 9]]}]},
            "in the zone 'all'",
        ),
        ({"trackers": ["waist-fisheye-imm"], "objectives__0__tracker": "waist-fisheye-imm"},
         "trackers.0: 'waist-fisheye-imm' makes no use of knee, which the study moves"),
        ({"search__method": "exhaustive", "devices__rig__count": [4, 4], "devices__rig__walls__every_m": 0.8},
         "'exhaustive' would try "),
        (
            {"objectives": [{"kind": "metric", "metric": "head_error_m.x"}]},
            "objectives.0.metric: laser-imm gives no head_error_m.x on lab-five-people; valid are mota, motp_m",
        ),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence_and_nothing_is_written(
    changes: dict[str, Any], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROOMTWIN_CACHE", str(tmp_path / "cache"))
    path = written(tmp_path, **changes)
    with pytest.raises(InputError) as raised, run_study(path, tmp_path / "out", Workers(jobs=1)):
        pass
    (line,) = str(raised.value).splitlines()
    assert sentence in line and line.startswith(str(path))
    assert not (tmp_path / "out").exists()


def test_a_tracker_that_ignores_what_is_moved_is_refused(tmp_path: Path) -> None:
    devices = {"camera": {"sensors": ["fisheye"], "places": [PLACE]}}
    path = written(tmp_path, devices=devices, scenarios=[{"scenario": "lab-five-people"}])
    with pytest.raises(InputError, match=r"trackers.0: 'laser-imm' makes no use of camera, which the study moves"):
        prepare(path)


def test_a_cell_larger_than_the_tracked_area_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, coverage={"of": "floor", "samples": 0, "cell_m": 50})
    with pytest.raises(InputError, match=r"coverage.cell_m: a cell of 50 m has no place in the tracked area of 4 m x"):
        prepare(path)


def test_a_scanner_is_not_tilted_further_than_its_role_allows(tmp_path: Path) -> None:
    rig = {"sensors": ["waist"], "places": [{"xyz": [0, 3.6, 2.3], "yaw_deg": -90}], "tilt_deg": [0, 60]}
    candidate_set = prepare(written(tmp_path, devices={"rig": rig})).candidate_set
    assert candidate_set.rejected["rig"] == {"tilted too far for a waist scanner": 1}
    assert max(pose.mounts[0].pitch_deg for pose in candidate_set.poses) == 45
    free = rig | {"kinds": [{"name": "free", "set": {"role": None}}]}
    assert not prepare(written(tmp_path, devices={"rig": free})).candidate_set.rejected["rig"]


def test_a_floor_lies_on_the_floor(tmp_path: Path) -> None:
    devices = {"floor": {"sensors": ["floor"], "walls": {"height_m": [1, 1]}}}
    path = written(tmp_path, devices=devices, scenarios=[{"scenario": "home-three-people"}], trackers=["floor-kalman"])
    with pytest.raises(
        InputError, match=r"devices.floor: 'floor' is a pressure floor, which lies on the floor; places or a box"
    ):
        prepare(path)
    devices = {"floor": {"sensors": ["floor"], "places": [{"xyz": [0.9, 0, 0]}, {"xyz": [-1.8, -1.4, 0.5]}]}}
    path = written(tmp_path, devices=devices, scenarios=[{"scenario": "home-three-people"}], trackers=["floor-kalman"])
    with pytest.raises(InputError, match=r"of its 2 poses none is left: 2 not on the floor of the room"):
        prepare(path)


def test_an_unknown_study_is_named_with_those_there_are() -> None:
    with pytest.raises(InputError, match=r"there is no study 'lab-scaner-place'; did you mean 'lab-scanner-place'\?"):
        load_study("lab-scaner-place")


def test_a_tracker_that_judges_nothing_may_ignore_what_is_moved(tmp_path: Path) -> None:
    devices = {"camera": {"sensors": ["fisheye"], "places": [PLACE]}}
    objectives = [{"kind": "coverage"}, {"kind": "price"}]
    path = written(
        tmp_path, devices=devices, scenarios=[{"scenario": "lab-five-people"}], objectives=objectives, held_out=None
    )
    assert [each.target for each in prepare(path).trackers] == ["laser-imm"]


@pytest.mark.parametrize("height", [[0.9], 0.9, [0.9, 0.9]])
def test_one_value_is_a_range(height: Any, tmp_path: Path) -> None:
    path = written(tmp_path, devices__rig__count=2, devices__rig__walls__height_m=height)
    rig = load_study(str(path))[0].devices["rig"]
    assert rig.counts == (2, 2) and rig.walls is not None and rig.walls.height_m == (0.9, 0.9)


def test_a_class_that_a_study_names_is_refused_by_the_flag_that_exists(tmp_path: Path) -> None:
    path = written(tmp_path, trackers=["evil:X"])
    with pytest.raises(InputError, match=r"'evil:X' is a class, .* here, or --allow-plugins for"):
        prepare(path)


def test_what_is_recommended_moves_with_its_room(tmp_path: Path) -> None:
    home = tmp_path / "here"
    (home / "out").mkdir(parents=True)
    (home / "room.xml").write_bytes((models.MODELS / "rooms" / "lab.xml").read_bytes())
    (home / "own.yaml").write_text("extends: lab-five-people\nname: own\nroom: room.xml\n")
    own = load_scenario(home / "own.yaml")
    write_scenario(home / "out" / "recommended.yaml", own, own, home / "own.yaml", "found", "found")
    home.rename(tmp_path / "there")
    found = load_scenario(tmp_path / "there" / "out" / "recommended.yaml")
    assert found.room == str(tmp_path / "there" / "room.xml") and found.sensors == own.sensors


def test_former_names_are_read_with_a_warning_that_names_the_new_ones(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    current, _ = load_study(written(tmp_path))
    content = yaml.safe_load((tmp_path / "small.yaml").read_text())
    content["move"] = content.pop("devices")
    content["coverage"]["moments"] = content["coverage"].pop("samples")
    path = tmp_path / "former.yaml"
    path.write_text(yaml.safe_dump(content))
    assert load_study(path)[0] == current
    warnings = [record.message for record in caplog.records]
    assert len(warnings) == 2
    for former, now in (("move", "devices"), ("coverage.moments", "samples")):
        assert any(text.startswith(f"{path}: {former}: is now called {now!r}") for text in warnings)


def test_the_summary_of_a_former_version_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    row = {"candidate": "own", "places": "the scenario's own", "price": 1, "seeds": 0, "coverage": 0.5}
    common = {
        "study": "s",
        "objective": "coverage",
        "best": row,
        "pareto": [],
        "held_out": [],
        "proven": [],
        "candidates": 1,
    }
    former = {"own": row, "alike": [], "misplaced": [], "moved_by": [], "refused": {}}
    current = {"baseline": row, "indistinguishable": [], "displaced": [], "rank_correlations": [], "rejected": {}}
    shown = []
    for changes in (former, current):
        (tmp_path / "summary.json").write_text(json.dumps(common | changes))
        print_summary(tmp_path)
        shown.append(capsys.readouterr().out)
    assert shown[0] == shown[1] and "0.5000" in shown[0]


@pytest.mark.parametrize(
    ("found", "nearly", "said"),
    [
        ([(0.938, 3098), (0.935, 1984.27), (0.92, 1500)], 1, "1984.27 gives 93.5 %, 0.3 % less"),
        ([(0.938, 3098), (0.938, 3000)], 1, "3000 gives 93.8 %, as much"),
        ([(0.938, 3098), (0.937, 3098), (0.92, 10)], None, ""),
    ],
)
def test_a_cheaper_placement_that_is_nearly_as_good_is_named(found: list, nearly: int | None, said: str) -> None:
    """At most 1 % worse; and with the `cheapest_within` that it names the study recommends it."""
    study = Study.model_validate(changed({"objectives": [{"kind": "coverage"}], "held_out": None, "trackers": []}))
    best, *others = (Trial((number,), price, coverage=value) for number, (value, price) in enumerate(found))
    cheaper = nearly_as_good(study, best, others)
    if nearly is None:
        assert cheaper is None
        return
    assert cheaper is not None and cheaper.trial is others[nearly - 1]
    assert cheaper.sentence(study.objectives[0], found[nearly][0]) == said
    within = [price for value, price in found if value >= best.coverage - cheaper.within]
    assert min(within) == cheaper.trial.price
    asked = study.model_copy(update={"cheapest_within": 0.1})
    assert nearly_as_good(asked, best, others) is None  # it recommends the cheapest itself
