"""What is ours in `laser-fisheye-imm`, and the preset and the suite that switch it off."""

from __future__ import annotations

import pytest
from pydantic import BaseModel

from trackers.configuration import validate
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.laser_fisheye_imm.rules import PAPER, RULES, without
from trackers.plain_data import deep_merge
from twin.suites.spec import load_suite

VAGUE = ("somebody", "believed", "whoever", "who ", "the same where", "the same for", "and how", "or if")


def leaves(model: type[BaseModel], path: str = ""):
    for name, field in model.model_fields.items():
        inner = field.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            yield from leaves(inner, f"{path}{name}.")
        yield f"{path}{name}", field


@pytest.mark.parametrize(("path", "field"), list(leaves(LaserFisheyeImmOptions)), ids=lambda each: str(each)[:40])
def test_every_option_says_what_it_means_by_itself(path, field):
    assert field.description, path
    assert not [word for word in VAGUE if word in field.description], field.description


def switched(options, path=()):
    for name, value in options.items():
        if isinstance(value, dict):
            yield from switched(value, (*path, name))
        else:
            yield (*path, name), value


@pytest.mark.parametrize("rule", RULES)
def test_every_rule_changes_an_option_from_its_default(rule):
    defaults = LaserFisheyeImmOptions()
    for path, off in switched(RULES[rule]):
        value = defaults
        for name in path:
            value = getattr(value, name)
        assert value != off, path
    LaserFisheyeImmOptions.model_validate(deep_merge(defaults.model_dump(), without(rule)))


def test_the_papers_system_is_without_any_rule():
    assert {path for rule in RULES for path, _ in switched(RULES[rule])} == {path for path, _ in switched(PAPER)}


def test_the_ablation_has_a_row_for_each_rule():
    suite, _ = load_suite("ablation")
    rows = {name.removeprefix("trackers."): options for name, options in suite.set.items()}
    assert rows == {f"without-{rule}": {"preset": "laser-fisheye-imm", **options} for rule, options in RULES.items()}
    assert suite.trackers == ("laser-fisheye-imm", "laser-fisheye-imm-paper", *rows)
    baseline, _ = load_suite("baseline")
    shared = [each.model_dump() | {"seeds": None, "trackers": None} for each in baseline.scenarios]
    assert all(each.model_dump() | {"seeds": None, "trackers": None} in shared for each in suite.scenarios)  # one cache


def test_the_step_of_the_noise_is_read_under_its_former_name(caplog):
    named = validate(LaserFisheyeImmOptions, {"period_s": 0.05}, "tracker laser-imm")
    assert named == validate(LaserFisheyeImmOptions, {"step_s": 0.05}, "tracker laser-imm")
    assert "'step_s'" in caplog.text
