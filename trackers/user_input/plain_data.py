"""Read users' YAML and JSON as plain data of bounded size, and merge mappings.

Only mappings with text or numbers as keys, lists, texts, numbers and booleans. Input that makes other readers hang, run out
of memory or stack, or raise various exceptions is reported in one sentence: aliases that grow without end or hold
themselves, deep nesting, numbers of thousands of digits, keys that are lists, tags of other types.

A bare word is interpreted literally: true and false are booleans, decimal numbers are numbers, null and ~ nothing. Words
that YAML 1.1, YAML 1.2 and Python interpret differently are texts, which no field of numbers or booleans accepts: yes, no,
on, off, 010, 0x10, 1_000, 12:30:00, dates.

libyaml is used if PyYAML has it, several times faster than PyYAML's own reader and writer.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from math import isfinite
from typing import Any

import yaml
from yaml.composer import Composer, ComposerError
from yaml.constructor import ConstructorError, SafeConstructor
from yaml.events import AliasEvent
from yaml.nodes import MappingNode, Node, ScalarNode
from yaml.parser import Parser, ParserError
from yaml.reader import Reader
from yaml.resolver import BaseResolver, Resolver
from yaml.scanner import Scanner

from trackers.errors import InputError
from trackers.user_input.text_file import are_limits_lifted

try:
    from yaml.cyaml import CParser as _Events, CSafeDumper as _SafeDumper
except ImportError:  # a PyYAML built without libyaml
    from yaml.dumper import SafeDumper as _SafeDumper

    class _Events(Reader, Scanner, Parser):
        """Events of a text."""

        def __init__(self, stream: str) -> None:
            Reader.__init__(self, stream)
            Scanner.__init__(self)
            Parser.__init__(self)


DEEPEST = 64
"""Greatest nesting of mappings and lists."""
_TOO_DEEP = f"more than {DEEPEST} lists and mappings in each other"
MOST_VALUES = 1_000_000
"""Greatest number of keys, values, lists and mappings of a text, counting repetitions by aliases."""
MOST_KEYS = 10_000
"""Greatest number of keys of a mapping: each names a thing that its reader validates, in some tenths of a millisecond."""
LONGEST_NUMBER = 64
"""Greatest length of a number, in characters."""

_TAG = "tag:yaml.org,2002:"
_NUMBERS = (f"{_TAG}int", f"{_TAG}float")
_SCALARS = (*_NUMBERS, f"{_TAG}str", f"{_TAG}bool", f"{_TAG}null")
_PLAIN = (*_SCALARS, f"{_TAG}seq", f"{_TAG}map")


_WHOLE = "[-+]?(?:0|[1-9][0-9]*)"
_WORDS = {
    f"{_TAG}bool": (re.compile("true|True|TRUE|false|False|FALSE"), "tTfF"),
    f"{_TAG}null": (re.compile("~|null|Null|NULL|"), ["~", "n", "N", ""]),
    f"{_TAG}int": (re.compile(_WHOLE), "-+0123456789"),
    f"{_TAG}float": (
        re.compile(
            rf"(?:{_WHOLE}(?:\.[0-9]*)?|[-+]?\.[0-9]+)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)"
        ),
        "-+.0123456789",
    ),
}
"""Patterns of bare words of each type, and their first characters; tried in this order."""
_OF_1_1 = ("merge", "value")  # '<<' and '=', which are rejected
_COLOUR = re.compile(r"\s*:?\s*(#(?:[0-9a-fA-F]{3}|[0-9a-fA-F]{6}|[0-9a-fA-F]{8}))(?=[\s,\]}]|$)")
_FLOW_COLOUR = re.compile(r"[\[{,:]" + _COLOUR.pattern)
_QUOTED_OR_COLOUR = re.compile(
    r"""("(?:[^"\\]|\\.)*"|'(?:[^']|'')*')|(?<![^\s\[{,])(#[0-9a-fA-F]{3,8})(?=[\s,\]}]|$)"""
)
"""A quoted text, left unchanged, or a bare colour."""


_OTHER_BREAKS = re.compile("[\r\x85\u2028\u2029]")


class _PlainResolver(Resolver):
    """Resolver of the types of bare words."""


_PlainResolver.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag.removeprefix(_TAG) in _OF_1_1]
    for first, resolvers in Resolver.yaml_implicit_resolvers.items()
}
for _tag, (_pattern, _first) in _WORDS.items():
    _PlainResolver.add_implicit_resolver(_tag, re.compile(rf"(?:{_pattern.pattern})\Z"), list(_first))


class _Dumper(_SafeDumper):  # pyright: ignore[reportGeneralTypeIssues]
    """Dumper that quotes texts which YAML 1.1 or this module would read as something else."""

    def represent_text(self, text: str) -> ScalarNode:
        """Represent a text; line breaks that readers would change are escaped in double quotes."""
        return self.represent_scalar(f"{_TAG}str", text, style='"' if _OTHER_BREAKS.search(text) else None)


_Dumper.add_representer(str, _Dumper.represent_text)
_tag, (_pattern, _first) = f"{_TAG}float", _WORDS[f"{_TAG}float"]
_Dumper.add_implicit_resolver(_tag, re.compile(rf"(?:{_pattern.pattern})\Z"), list(_first))


class _Loader(Composer, SafeConstructor, _PlainResolver, _Events):  # pyright: ignore[reportGeneralTypeIssues]
    """Loader of plain data; depth and size are checked during composition."""

    def __init__(self, stream: str) -> None:
        self._lines = stream.split("\n")
        _Events.__init__(self, stream)
        Composer.__init__(self)
        SafeConstructor.__init__(self)
        BaseResolver.__init__(self)
        self._depth = 0
        self._n_value = 0
        self._n_within: dict[Node, int] = {}  # of the completed anchored nodes

    def compose_node(self, parent: Node | None, index: Any) -> Node | None:
        """Compose the node of the next events."""
        event = self.peek_event()
        if isinstance(event, AliasEvent):
            node = super().compose_node(parent, index)
            assert node is not None
            if node not in self._n_within:
                raise ComposerError(None, None, f"*{event.anchor} stands within what it names", event.start_mark)
            self._count(self._n_within[node], event)
            return node
        if self._depth == DEEPEST:
            raise ComposerError(None, None, _TOO_DEEP, event.start_mark)
        if event.anchor in self.anchors:
            raise ComposerError(None, None, f"&{event.anchor} names two things", event.start_mark)
        self._depth += 1
        before = self._n_value
        self._count(1, event)
        node = super().compose_node(parent, index)
        self._depth -= 1
        if node is not None and event.anchor is not None:
            self._n_within[node] = self._n_value - before
        return node

    def _count(self, n: int, event: Any) -> None:
        self._n_value += n
        if self._n_value > MOST_VALUES and not are_limits_lifted():
            what = f"more than {MOST_VALUES} values, those that aliases repeat included, without --no-limits"
            raise ComposerError(None, None, what, event.start_mark)

    def construct_object(self, node: Node, deep: bool = False) -> Any:
        """Construct the plain value of a node."""
        if node.tag not in _PLAIN:
            kind = node.tag.removeprefix(_TAG)
            what = "a merge '<<'" if kind == "merge" else f"the tag {kind!r}"
            raise ConstructorError(None, None, f"{what} is none of plain data", node.start_mark)
        if not isinstance(node, ScalarNode):
            return super().construct_object(node, deep)
        if node.tag == f"{_TAG}null" and node.value == "":
            self._check_no_colour(node.start_mark)
        if node.tag in _NUMBERS and len(node.value) > LONGEST_NUMBER:
            raise ConstructorError(
                None, None, f"a number of {len(node.value)} characters; at most {LONGEST_NUMBER}", node.start_mark
            )
        try:
            if node.tag in _WORDS and not _WORDS[node.tag][0].fullmatch(node.value):
                raise ValueError
            return super().construct_object(node, deep)
        except (ValueError, LookupError, TypeError, AttributeError, OverflowError) as error:
            kind = node.tag.removeprefix(_TAG)
            raise ConstructorError(None, None, f"{node.value!r} is no {kind}", node.start_mark) from error

    def _check_no_colour(self, mark: Any) -> None:
        """Raise for an empty value before a colour: after a blank, # begins a comment."""
        line = self._lines[mark.line] if mark.line < len(self._lines) else ""
        found = _COLOUR.match(line[mark.column :])
        if found:
            raise ConstructorError(None, None, _no_colour(found.group(1)), mark)

    def construct_mapping(self, node: MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Construct the mapping; reject a repeated key, which plain YAML would silently overwrite."""
        seen = set()
        if isinstance(node, MappingNode) and len(node.value) > MOST_KEYS and not are_limits_lifted():
            what = f"a mapping of {len(node.value)} keys; at most {MOST_KEYS}, or --no-limits"
            raise ConstructorError(None, None, what, node.start_mark)
        for key_node, value_node in node.value if isinstance(node, MappingNode) else ():
            if isinstance(value_node, ScalarNode) and value_node.value == "":
                self._check_no_colour(key_node.end_mark)
            if not isinstance(key_node, ScalarNode):
                raise ConstructorError(None, None, "a key is a list or mapping, not a word", key_node.start_mark)
            key = self.construct_object(key_node, deep=True)
            if key in seen:
                raise ConstructorError(None, None, f"the key {key!r} stands twice in one mapping", key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)


def parse_yaml(text: str, source: str, expected: str) -> dict[str, Any]:
    """Parse the mapping in a YAML text. Raises InputError naming the source, the line and what is `expected`."""
    content = _loaded(text, source, expected, tells_line=True)
    if not isinstance(content, dict):
        kind = "a list" if isinstance(content, list) else "a text" if isinstance(content, str) else "one value"
        what = "is empty" if content is None else f"holds {kind}, not a mapping"
        raise InputError(f"{source}: {what}; {expected} is expected")
    return content


def parse_yaml_value(text: str, source: str) -> Any:
    """Parse any YAML text; `source`: start of the InputError's sentence.

    A text that begins with #, or a bare colour in a list or mapping, is a text: an argument holds no comments.
    """
    if text.lstrip().startswith("#"):
        return text.strip()
    text = _QUOTED_OR_COLOUR.sub(lambda found: found[1] or f"'{found[2]}'", text)
    return _loaded(text, source, "a number, word, [list] or {map}", tells_line=False)


def parse_number(text: str) -> int | float | None:
    """Parse a finite number of an argument as a bare word of a file is; None for any other text."""
    is_of = {tag: pattern.fullmatch(text) is not None for tag, (pattern, _) in _WORDS.items()}
    if not any(is_of[tag] for tag in _NUMBERS) or len(text) > LONGEST_NUMBER or text[-1].isalpha():  # .inf, .nan
        return None
    number = int(text) if is_of[f"{_TAG}int"] else float(text)
    return number if isfinite(number) else None


def dump_yaml(content: Any) -> str:
    """Format plain data as YAML in the order of mappings, read identically by `parse_yaml` and YAML 1.1 readers."""
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True)


def _loaded(text: str, source: str, expected: str, *, tells_line: bool) -> Any:
    try:
        return _load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{source}, line {mark.line + 1}" if mark is not None and tells_line else source
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        if problem == "exceeded maximum nesting depth":  # libyaml's own limit, as it reads ahead
            problem = _TOO_DEEP
        line = text.split("\n")[mark.line - 1 if mark.line else 0] if isinstance(error, ParserError) and mark else ""
        if swallowed := _FLOW_COLOUR.search(line):  # with the bracket that closes the list
            problem = _no_colour(swallowed.group(1))
        raise InputError(f"{where}: not valid YAML ({problem}); {expected} is expected") from error
    except UnicodeEncodeError as error:  # an argument that is no valid UTF-8
        raise InputError(f"{source!r}: not valid YAML (it is not UTF-8); {expected} is expected") from error


def _no_colour(colour: str) -> str:
    return f"{colour} without quotes is a comment and says nothing: write '{colour}' in quotes"


def _load(text: str) -> Any:
    text.encode("utf-8")  # rejects half a surrogate pair
    loader = _Loader(text)
    try:
        return loader.get_single_data()
    finally:
        loader.dispose()


def parse_json(text: str, source: str, expected: str) -> Any:
    """Parse a JSON text; raises InputError naming the source, the line where known, and what is `expected`."""

    def refuse(constant: str) -> None:
        raise InputError(f"{source}: is not JSON ({constant} is no number in it); {expected} is expected")

    try:
        content = json.loads(text, parse_constant=refuse)
        json.dumps(content, ensure_ascii=False).encode("utf-8")  # half a surrogate pair cannot be written
    except json.JSONDecodeError as error:
        raise InputError(f"{source}, line {error.lineno}: is not JSON ({error.msg}); {expected} is expected") from error
    except RecursionError as error:
        raise InputError(
            f"{source}: is not JSON that can be read (nested too deeply); {expected} is expected"
        ) from error
    except UnicodeEncodeError as error:
        raise InputError(f"{source}: is not JSON (half a surrogate pair in a text); {expected} is expected") from error
    except InputError:
        raise
    except ValueError as error:  # Python's own limit of an integer's digits
        raise InputError(f"{source}: is not JSON that can be read ({error}); {expected} is expected") from error
    return content


def deep_merge(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """Merge `change` into `base`: mappings merge at every depth, other values are replaced.

    A mapping with another `kind` than in `base` replaces it, since its fields differ.
    """
    merged = dict(base)
    for key, value in change.items():
        held = merged.get(key)
        if isinstance(value, Mapping) and isinstance(held, Mapping) and value.get("kind") in (None, held.get("kind")):
            merged[key] = deep_merge(held, value)
        else:
            merged[key] = value
    return merged
