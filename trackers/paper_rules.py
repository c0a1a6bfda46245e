"""Rules of a paper's own system as a table: stated by the paper, filled in where it is silent, or called empirical.

A preset `NAME-paper` has exactly these rules. `twin list trackers --rules NAME` prints them.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from trackers.user_input.plain_data import deep_merge

Kind = Literal["stated", "unstated", "empirical"]
KINDS: Mapping[Kind, str] = {
    "stated": "Stated by the paper",
    "unstated": "Unstated by the paper: filled in the least way",
    "empirical": "Empirical by the paper: chosen on development seeds",
}


@dataclass(frozen=True)
class PaperRule:
    """One rule of a paper's system, and the tracker's options for it (none: the tracker has no alternative).

    where: section, equation or figure; text: of a stated rule the paper's words; of an unstated one our choice, reason and
    its effect; of an empirical one the value and the sweep that chose it.
    """

    name: str
    kind: Kind
    where: str
    text: str
    options: Mapping[str, Any] = field(default_factory=dict)


def options_of(rules: Iterable[PaperRule]) -> dict[str, Any]:
    """Return the joint options of these rules. Raises ValueError where two of them set the same one."""
    options: dict[str, Any] = {}
    taken: dict[str, str] = {}
    for rule in rules:
        for path in option_paths(rule.options):
            if path in taken:
                raise ValueError(f"rules {taken[path]!r} and {rule.name!r} both set {path}")
            taken[path] = rule.name
        options = deep_merge(options, rule.options)
    return options


def option_paths(options: Mapping[str, Any], above: str = "") -> Iterator[str]:
    """Yield the dotted paths of the options of a mapping."""
    for name, value in options.items():
        if isinstance(value, Mapping):
            yield from option_paths(value, f"{above}{name}.")
        else:
            yield f"{above}{name}"


def at_paths(options: Mapping[str, Any], paths: Iterable[str]) -> dict[str, Any]:
    """Return the options at these paths. Raises KeyError for a missing path."""
    part: dict[str, Any] = {}
    for path in paths:
        value: Any = options
        for name in path.split("."):
            value = value[name]
        for name in reversed(path.split(".")):
            value = {name: value}
        part = deep_merge(part, value)
    return part


def rules_markdown(title: str, rules: Iterable[PaperRule]) -> str:
    """Return the table as Markdown, one section per kind of rule."""
    rules = list(rules)
    lines = [f"## {title}"]
    for kind, heading in KINDS.items():
        own = [rule for rule in rules if rule.kind == kind]
        if own:
            lines += ["", f"### {heading}", "", "| rule | where | | options |", "| --- | --- | --- | --- |"]
            lines += [f"| {rule.name} | {rule.where} | {rule.text} | {_options_text(rule.options)} |" for rule in own]
    return "\n".join(lines) + "\n"


def _options_text(options: Mapping[str, Any]) -> str:
    values = {path: at_paths(options, [path]) for path in option_paths(options)}
    return ", ".join(f"`{path}` {_leaf(value)}" for path, value in values.items()) or "–"


def _leaf(value: Any) -> str:
    while isinstance(value, Mapping):
        (value,) = value.values()
    return "none" if value is None else "no" if value is False else "yes" if value is True else str(value)


_CITATION = re.compile(r"(?P<authors>[^:]+): (?P<title>[^(]+?)(?: \((?P<note>[^)]+)\).*)?")


def bibtex(citations: Iterable[str]) -> str:
    """Return a BibTeX entry per paper of citations like 'Author, Author: Title (year, or where it is from)'; others are left out.

    One whose own text states no year has the authors' universities instead.
    """
    entries = {}
    for found in filter(None, map(_CITATION.fullmatch, citations)):
        authors, title, note = found["authors"].split(", "), found["title"], found["note"] or ""
        year = re.search(r"\b(19|20)\d\d\b", note)
        plain = unicodedata.normalize("NFKD", authors[0].lower()).encode("ascii", "ignore").decode()
        key = f"{plain}-{re.sub(r'[^a-z]+', '-', title.lower()).strip('-').split('-')[0]}"
        surnames = [f"{{{each}}}" if " " in each else each for each in authors]  # else the first word is a given name
        fields = {"author": " and ".join(surnames), "title": f"{{{title}}}"}
        if year is not None:
            fields["year"] = year[0]
        if note and note != (year[0] if year is not None else ""):
            fields["note"] = note
        body = ",\n".join(f"  {field} = {{{value}}}" for field, value in fields.items())
        entries[key] = f"@misc{{{key},\n{body}\n}}"
    return "\n\n".join(entries.values())
