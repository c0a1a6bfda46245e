"""Text from users: whatever is in it, plain data or one sentence comes out, at once and in little memory."""

from __future__ import annotations

import importlib.util
import json
import os
import random
import sys
import threading
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import pytest
import yaml

from trackers.errors import InputError
from trackers.rig import Rig
from trackers.user_input import plain_data
from trackers.user_input.plain_data import parse_json, parse_yaml, parse_yaml_value
from trackers.user_input.text_file import read_text

BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{after}: &{after} [{', '.join([f'*{before}'] * 9)}]\n" for before, after in pairwise("abcdefghi")
)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            BOMB,
            "line 7: not valid YAML (more than 1000000 values, those that aliases repeat included, without --no-limits)",
        ),
        ("a: &a {b: *a}", "*a stands within what it names"),
        ("a: &a [*a]", "*a stands within what it names"),
        ("one: 1\n[1]: 2", "line 2: not valid YAML (a key is a list or mapping, not a word)"),
        ("{a: b}: 2", "a key is a list or mapping, not a word"),
        ("a: " + "9" * 5000, "a number of 5000 characters; at most 64"),
        ("a: -" + "1" * 5000 + ".5", "a number of 5003 characters"),
        ("a: !!int ''", "'' is no int"),
        ("a: !!float ''", "'' is no float"),
        ("a: !!bool maybe", "'maybe' is no bool"),
        ("a: !!timestamp x", "the tag 'timestamp'"),
        ("a: !!binary xx", "the tag 'binary'"),
        ("a: !!set {x, y}", "the tag 'set'"),
        ("a: !!python/object/apply:os.system ['true']", "the tag 'python/object/apply:os.system'"),
        ("a: !!map x", "expected a mapping node"),
        ("a: &a {b: 1}\nc: {<<: *a}", "a merge '<<'"),
        ("a: " + "[" * 3000, "more than 64 lists and mappings in each other"),
        ("\n".join(" " * depth + "a:" for depth in range(1000)), "more than 64 lists and mappings in each other"),
        ("a: &a 1\nb: &a 2", "&a names two things"),
        ("a: *b", "found undefined alias 'b'"),
        ("a: {" + ", ".join(map(str, range(10_001))) + "}", "a mapping of 10001 keys; at most 10000"),
        ("a: 1\na: 2", "line 2: not valid YAML (the key 'a' stands twice in one mapping)"),
        ("a: 1\n---\nb: 1", "found another document"),
        ("a: \0", "control characters are not allowed"),
        (r'a: "\ud800"', "invalid Unicode character"),
        ("[1, 2]", "holds a list, not a mapping"),
        ("", "is empty; "),
    ],
)
def test_yaml_that_is_only_bad_is_one_sentence(text: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_yaml(text, "file.yaml", "a rig.yaml")
    assert str(caught.value).startswith("file.yaml") and said in str(caught.value)
    assert str(caught.value).endswith("; a rig.yaml is expected") and "\n" not in str(caught.value)


def test_yaml_holds_texts_numbers_lists_and_mappings_as_it_always_did() -> None:
    text = "a: [1, 1.5, .inf, true, null, x]\nb: {'1': x, 2: y}\nc: &c {d: [~]}\ne: *c\n"
    assert parse_yaml(text, "", "") == yaml.safe_load(text)
    assert parse_yaml("day: 2024-99-99", "", "") == {"day": "2024-99-99"}  # a date is the text that it is


def test_an_alias_may_repeat_what_is_small() -> None:
    assert parse_yaml("a: &a {b: [1, 2]}\nc: [*a, *a]", "", "")["c"] == [{"b": [1, 2]}] * 2


@pytest.mark.parametrize("text", ["[1, 2", "&a {b: *a}", "9" * 5000, "!!int ''", "[" * 3000, "{[1]: 2}", "\udcff"])
def test_a_single_value_is_read_by_the_same_rules(text: str) -> None:
    with pytest.raises(
        InputError, match=r"^'?--set x'?: not valid YAML \(.*\); a number, word, \[list\] or {map} is expected$"
    ):
        parse_yaml_value(text, "--set x")
    assert parse_yaml_value("[1, {a: b}]", "--set x") == [1, {"a": "b"}]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[1,\n2", "line 2: is not JSON (Expecting ',' delimiter)"),
        ("[" * 100_000, "nested too deeply"),
        ("9" * 5000, "limit (4300 digits)"),
        (r'"\ud800"', "half a surrogate pair"),
        ("[NaN]", "NaN is no number in it"),
    ],
)
def test_json_that_is_only_bad_is_one_sentence(text: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_json(text, "file.json", "a baseline")
    assert str(caught.value).startswith("file.json") and said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_json_is_what_it_says() -> None:
    content = {"a": [1, 2.5, "ä", None, True]}
    assert parse_json(json.dumps(content), "", "") == content


def test_a_device_and_a_text_without_end_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^/dev/zero: is a device, not a file; a rig\.yaml is expected$"):
        read_text(Path("/dev/zero"), "a rig.yaml")
    endless = tmp_path / "pipe"
    os.mkfifo(endless)

    def fill() -> None:
        with suppress(BrokenPipeError):
            endless.write_bytes(bytes(10_000_000))

    writer = threading.Thread(target=fill)
    writer.start()
    with pytest.raises(
        InputError, match=r"pipe: holds more than 1 MiB; a rig\.yaml of no more, or --no-limits, is expected$"
    ):
        read_text(endless, "a rig.yaml", 2**20)
    writer.join()


@pytest.mark.parametrize("name", ["a" * 300, "a\0b", "missing", "."])
def test_a_path_of_no_file_is_one_sentence(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"; a rig\.yaml is expected$|^(a rig\.yaml|rig): .* is no path"):
        read_text(tmp_path / name, "a rig.yaml")


def test_a_rig_is_read_by_the_same_rules(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(BOMB)
    with pytest.raises(InputError, match="aliases"):
        Rig.load(path)


def test_a_file_with_a_fault_in_every_line_tells_of_some_and_counts_the_rest() -> None:
    with pytest.raises(InputError) as caught:
        Rig.parse("sensors: {" + ", ".join(f"s{number}: {'x' * 1000}" for number in range(3000)) + "}", "rig.yaml")
    lines = str(caught.value).splitlines()
    assert len(lines) == 51 and lines[-1] == "rig.yaml: and 2950 faults more"
    assert max(map(len, lines)) < 400


@pytest.fixture
def without_libyaml(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module as it is where PyYAML has no libyaml."""
    monkeypatch.setitem(sys.modules, "yaml.cyaml", None)
    spec = importlib.util.spec_from_file_location("plain_data_without_libyaml", plain_data.__file__)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PIECES = [
    *"ab\n:#-'\"é\t\r@&*{}[],?|>!%01e.~",
    "😀",
    " ",
    "  ",
    "\x85",
    "\u2028",
    "\ufeff",
    "\x07",
    "null",
    "on",
    "long " * 20,
]


def test_any_text_is_written_so_that_it_is_read_again_with_libyaml_and_without(without_libyaml: ModuleType) -> None:
    rng = random.Random(1)
    for _ in range(300):
        word = "".join(rng.choices(PIECES, k=rng.randrange(9)))
        content = {word: [word, {"within": word * 9}]}
        for writes in (plain_data, without_libyaml):
            text = writes.dump_yaml(content)
            assert parse_yaml(text, "", "") == without_libyaml.parse_yaml(text, "", "") == content, text


@pytest.mark.parametrize("folder", ["scenarios", "suites", "studies"])
def test_shipped_files_are_the_same_without_libyaml(folder: str, without_libyaml: ModuleType) -> None:
    paths = sorted((Path(__file__).parents[3] / "models" / folder).glob("*.yaml"))
    assert paths
    for path in paths:
        content = parse_yaml(read_text(path, ""), "", "")
        assert without_libyaml.parse_yaml(read_text(path, ""), "", "") == content
        assert without_libyaml.dump_yaml(content) == plain_data.dump_yaml(content), path


@pytest.mark.parametrize(
    "text", ["[" * 3000, "a: 1\na: 2", "a: *b", "&a {b: *a}", "a: !!int ''", "a: &b 1\nc: &b 2", "\udcff"]
)
def test_what_is_refused_is_refused_without_libyaml_in_the_same_words(text: str, without_libyaml: ModuleType) -> None:
    said = []
    for reads in (plain_data, without_libyaml):
        with pytest.raises(InputError) as refused:
            reads.parse_yaml(text, "s.yaml", "a scenario")
        said.append(str(refused.value))
    assert said[0].startswith("s.yaml") or text == "\udcff"
    assert said[0] == said[1] or text == "a: *b", said  # the parsers' own words of an alias of nothing
