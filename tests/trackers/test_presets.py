"""Trackers by name."""

import re
import subprocess
import sys
from collections.abc import Mapping
from functools import reduce
from importlib.metadata import EntryPoint

import pytest
import synthetic_home
import synthetic_meeting
from synthetic_room import rig

import trackers.presets
from trackers.errors import InputError
from trackers.filters.motion import AGILE, KALMAN_MODELS, HeadingMotion, VelocityMotion
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.laser_fisheye_imm.tracker import LaserFisheyeImm, filter_of
from trackers.paper_rules import bibtex
from trackers.presets import PRESETS, available, make_tracker
from twin.reproduce.laser_fisheye_imm.runs import COLUMNS
from twin.reproduce.laser_vision_learning.runs import SYSTEMS


def rig_of(name):
    return synthetic_home.rig() if "floor" in name else synthetic_meeting.rig() if "rgbd" in name else rig()


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_is_its_class_with_its_options_and_tells_what_it_is_and_whose(name):
    preset, made = PRESETS[name], make_tracker(name, rig_of(name))
    module, _, kind = preset.target.partition(":")
    assert (type(made).__module__, type(made).__name__) == (module, kind)
    assert preset.description and preset.citation
    for path, value in leaves(preset.options):
        found = made.options
        for part in path:
            found = found[part] if isinstance(found, Mapping) else getattr(found, part)
        assert found == value, path


def leaves(options, above=()):
    """Options that are no mapping of options, with their paths."""
    for name, value in options.items():
        if isinstance(value, Mapping) and value:
            yield from leaves(value, (*above, name))
        else:
            yield (*above, name), value


def test_a_former_name_overrides_what_a_preset_sets_by_the_current_one():
    n_overridden = 0
    for name, preset in PRESETS.items():
        made = make_tracker(name, rig_of(name))
        for former, current in getattr(made.Options, "former_names", {}).items():
            value = preset.options
            for part in current.split("."):
                value = value.get(part) if isinstance(value, Mapping) else None
            if value is not None:
                given = reduce(lambda inner, part: {part: inner}, reversed(former.split(".")), value)
                assert make_tracker(name, rig_of(name), options=given).options == made.options, former
                n_overridden += 1
    assert n_overridden > 20


def test_no_two_presets_are_the_same_or_told_of_alike():
    made = [(preset.target, repr(preset.options)) for preset in PRESETS.values()]
    assert len(set(made)) == len(made)
    descriptions = [preset.description for preset in PRESETS.values()]
    assert len(set(descriptions)) == len(descriptions)


def test_every_paper_has_an_entry_of_bibtex_with_its_year_or_where_it_is_from():
    entries = bibtex(each.citation for each in PRESETS.values()).split("\n\n")
    assert len(entries) >= 8
    for entry in entries:
        assert re.match(r"@misc\{[a-z-]+,\n  author = \{", entry), entry  # older readers take ASCII alone as a key
        assert re.search(r"^  year = \{(19|20)\d\d\}", entry, re.M) or "University" in entry
        authors = re.search(r"author = \{(.*)\}", entry)[1].split(" and ")
        assert all(" " not in each or re.fullmatch(r"\{.*\}", each) for each in authors)  # surnames


def test_the_columns_of_the_papers_tables_have_a_preset_each():
    assert {column.tracker for column in COLUMNS} | set(SYSTEMS) <= set(PRESETS)


def test_presets_are_options_of_one_class():
    tracker = make_tracker("waist-fisheye-kalman", rig())
    assert isinstance(tracker, LaserFisheyeImm)
    assert tracker.options.filter == "kalman"
    assert tracker.options.layers == ("waist",)
    changed = make_tracker("waist-fisheye-kalman", rig(), options={"filter": "imm"})
    assert changed.options.filter == "imm"


@pytest.mark.parametrize(
    ("options", "motion", "n_mode"),
    [
        ({}, VelocityMotion, 3),
        ({"filter": "kalman"}, VelocityMotion, 1),
        ({"motion": "headings"}, HeadingMotion, 3),
        ({"motion": "headings", "filter": "kalman"}, HeadingMotion, 1),
    ],
)
def test_one_mode_or_three_over_velocities_or_as_in_the_paper_over_headings(options, motion, n_mode):
    made = filter_of(LaserFisheyeImmOptions(**options)).motion
    assert (type(made), made.n_mode) == (motion, n_mode)


def test_the_kalman_filter_has_one_agile_model_or_the_papers():
    made = filter_of(LaserFisheyeImmOptions(filter="kalman")).motion
    assert made == VelocityMotion((AGILE,))
    papers = filter_of(LaserFisheyeImmOptions(filter="kalman", motion="headings")).motion
    assert papers == HeadingMotion(KALMAN_MODELS)


def test_an_unknown_name_lists_the_valid_ones():
    with pytest.raises(
        InputError,
        match="'laser-fish' is unknown; did you mean 'laser-fisheye-imm'.* valid ones are .*laser-fisheye-imm.*module:Class",
    ):
        make_tracker("laser-fish", rig())


def test_a_wrong_option_is_told_of_under_the_name_that_was_asked_for():
    with pytest.raises(InputError, match="^tracker waist-fisheye-kalman: camra: unknown key; did you mean 'camera'"):
        make_tracker("waist-fisheye-kalman", rig(), options={"camra": False})


def test_a_class_of_ones_own_by_module_and_name(tmp_path, monkeypatch):
    (tmp_path / "my_lab_tracker.py").write_text(
        "class Mine:\n"
        "    def __init__(self, rig, background=(), rng=None, **options):\n"
        "        self.given = (rig, list(background), rng, options)\n"
        "    def update(self, observation): return []\n"
        "    def tracks(self): return []\n"
    )
    (tmp_path / "my_broken_tracker.py").write_text("import a_library_nobody_has\n")
    monkeypatch.syspath_prepend(tmp_path)
    on = rig()
    assert make_tracker("my_lab_tracker:Mine", on, (), None, {"speed": 3}).given == (on, [], None, {"speed": 3})
    with pytest.raises(InputError, match="no class 'Yours'"):
        make_tracker("my_lab_tracker:Yours", on)
    with pytest.raises(InputError, match="no module 'my_lab_treker'"):
        make_tracker("my_lab_treker:Mine", on)
    with pytest.raises(InputError, match="module:Class"):
        make_tracker(":Mine", on)
    monkeypatch.chdir(tmp_path)
    for path, instead in {
        "./lab/my.py:Mine": "lab.my:Mine is",
        "lab/my.py": "lab.my:Class is",
        "my.py": "my:Class is",
        f"{tmp_path}/my.py:Mine": "my:Mine is",
        "../my.py:Mine": "my:Mine, from its folder or with that in PYTHONPATH, is",
        ".my:Mine": "my:Mine, from its folder",
    }.items():
        with pytest.raises(InputError, match=f"is a path; {instead}"):
            make_tracker(path, on)
    with pytest.raises(ModuleNotFoundError, match="a_library_nobody_has"):  # a fault of the plug-in stays loud
        make_tracker("my_broken_tracker:Mine", on)


def test_an_option_that_a_class_does_not_take_is_bad_input(tmp_path, monkeypatch):
    (tmp_path / "my_speedy_tracker.py").write_text(
        "class Speedy:\n    def __init__(self, rig, background, rng, *, speed=1): self.speed = speed + 0\n"
        "class Plain:\n    def __init__(self, rig, background, rng): ...\n"
        "class Other:\n    def __init__(self, rig): ...\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert make_tracker("my_speedy_tracker:Speedy", rig(), options={"speed": 3}).speed == 3
    known = r"did you mean 'speed'\? valid here: speed", "valid here: none, as it takes no options"
    for name, valid in zip(("Speedy", "Plain"), known, strict=True):
        target = f"my_speedy_tracker:{name}"
        with pytest.raises(InputError, match=f"^tracker '{target}': sped: unknown key; {valid}$"):
            make_tracker(target, rig(), options={"sped": 1})
    with pytest.raises(InputError, match=r"a class made as Other\(rig, background, rng, \*\*options\) is expected"):
        make_tracker("my_speedy_tracker:Other", rig())
    with pytest.raises(TypeError, match="unsupported operand"):  # raised within the class: its own fault
        make_tracker("my_speedy_tracker:Speedy", rig(), options={"speed": None})


def test_installed_entry_points_are_found_and_do_not_replace_presets(monkeypatch):
    points = [
        EntryPoint("lab-tracker", "trackers.laser_fisheye_imm.tracker:LaserFisheyeImm", "roomtwin.trackers"),
        EntryPoint("laser-imm", "somewhere:Else", "roomtwin.trackers"),
    ]
    monkeypatch.setattr(trackers.presets, "entry_points", lambda group: points if group == "roomtwin.trackers" else [])
    assert available()["laser-imm"] is PRESETS["laser-imm"]
    assert isinstance(make_tracker("lab-tracker", rig()), LaserFisheyeImm)


def test_importing_the_presets_imports_nothing_heavy():
    heavy = ["cv2", "scipy", "numpy", "pydantic", "mujoco"]
    code = f"import sys, trackers.presets; print([name for name in {heavy} if name in sys.modules])"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"
    )
