"""What is ours in `laser-fisheye-imm`, and the preset and the suite that switch it off."""

from __future__ import annotations

import pytest
from pydantic import BaseModel

from trackers.camera_floor_particle.rules import PAPER_RULES as FLOOR_RULES
from trackers.configuration import validate
from trackers.errors import InputError
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.laser_fisheye_imm.rules import PAPER, PAPER_RULES, RULES
from trackers.laser_vision_learning.rules import PAPER_RULES as LEARNING_RULES
from trackers.paper_rules import KINDS, at_paths, option_paths, options_of, rules_markdown
from trackers.rgbd_head.rules import PAPER_RULES as HEAD_RULES
from trackers.user_input.plain_data import deep_merge
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


DEFAULTS = LaserFisheyeImmOptions().model_dump()


def differing(options, defaults):
    return {path for path in option_paths(options) if at_paths(options, [path]) != at_paths(defaults, [path])}


def without(rule):
    """The options that replace a rule of ours by the paper's."""
    return at_paths(PAPER, RULES[rule])


@pytest.mark.parametrize("rule", RULES)
def test_every_rule_of_ours_differs_from_the_paper(rule):
    assert differing(without(rule), DEFAULTS) == set(RULES[rule])
    LaserFisheyeImmOptions.model_validate(deep_merge(DEFAULTS, without(rule)))


def test_ours_differs_from_the_paper_by_its_rules_alone():
    assert differing(PAPER, DEFAULTS) == {path for paths in RULES.values() for path in paths}


@pytest.mark.parametrize(
    "rules",
    [PAPER_RULES, FLOOR_RULES, LEARNING_RULES, HEAD_RULES],
    ids=["laser-fisheye-imm", "camera-floor-particle", "laser-vision-learning", "rgbd-head"],
)
def test_every_rule_of_a_paper_says_of_which_kind_it_is_and_where(rules):
    assert all(rule.kind in KINDS and rule.where and rule.text for rule in rules)
    assert len({rule.name for rule in rules}) == len(rules)
    with pytest.raises(ValueError, match="both set"):
        options_of([*rules, rules[0]])
    text = rules_markdown("made up", rules)
    assert all(f"| {rule.name} | {rule.where} |" in text for rule in rules)
    assert all(f"`{path}`" in text for rule in rules for path in option_paths(rule.options))


def test_the_ablations_add_each_rule_to_the_paper_and_take_each_from_the_full_system():
    suite, _ = load_suite("ablation")
    rows = {name.removeprefix("trackers."): options for name, options in suite.set.items()}
    paper = "laser-fisheye-imm-paper"
    assert rows == {f"with-{rule}": {"preset": paper, **at_paths(DEFAULTS, paths)} for rule, paths in RULES.items()}
    assert suite.trackers == (paper, *rows, "laser-fisheye-imm", "sort")
    one_out, _ = load_suite("leave-one-out")
    assert {name.removeprefix("trackers."): options for name, options in one_out.set.items()} == {
        f"without-{rule}": {"preset": "laser-fisheye-imm", **without(rule)} for rule in RULES
    }
    assert one_out.trackers == ("laser-fisheye-imm", *(f"without-{rule}" for rule in RULES))
    assert one_out.scenarios == suite.scenarios
    baseline, _ = load_suite("baseline")
    shared = [each.model_dump() | {"seeds": None, "trackers": None} for each in baseline.scenarios]
    assert all(each.model_dump() | {"seeds": None, "trackers": None} in shared for each in suite.scenarios)  # one cache


def test_the_step_of_the_noise_is_read_under_its_former_name_with_the_value_it_always_has(caplog):
    named = validate(LaserFisheyeImmOptions, {"period_s": 0.1}, "tracker laser-imm")
    assert named == LaserFisheyeImmOptions()
    assert "'step_s'" in caplog.text
    with pytest.raises(InputError, match="step_s: is no option any more, and always 0.1"):
        validate(LaserFisheyeImmOptions, {"period_s": 0.05}, "tracker laser-imm")
