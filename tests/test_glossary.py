"""Words: names and sentences are the field's, not a dialect of ours."""

from __future__ import annotations

import ast
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = sorted(path for folder in ("twin", "trackers", "scripts") for path in (ROOT / folder).rglob("*.py"))

FIELD_WORDS = {
    "moment": "frame, stamp or sample",
    "look_after": "update or manage",
    "newcomer": "unassigned detection, initiation",
    "stranger": "unassigned detection",
    "told": "a verb of what it does: format, summary, by_id",
    "gone": "deleted, left",
    "begun": "initiated, started",
    "begins": "initiates, starts",
    "worthiest": "max_weight_assignment",
    "deviations": "mahalanobis_distances",
    "absence": "negative information",
    "unseen": "miss_probability, missed",
    "held_back": "fixed-lag smoother",
    "recognised": "re-identified",
    "doubt": "warning, calibration monitor",
    "knowledge": "prior",
    "spoil": "corruption, fault injection",
    "spoiled": "corrupted",
    "doubted": "suspect",
    "spoiling": "corruption, fault injection",
    "laid_over": "deep_merge",
    "lone": "single",
    "firm": "the measured quality",
    "barred": "forbidden",
    "half_seen": "partly occluded",
    "claim": "gate",
    "watcher": "camera front end",
    "set_right": "normalize exposure",
    "believed": "assumed, calibration_error",
    "vary": "randomize",
    "cast": "body pool",
    "lair": "lying pose",
    "staged": "precomputed",
    "posed": "pose cache",
    "caveat": "note",
    "promise": "requirement",
    "aftermath": "validation",
    "tracker_at_work": "tracker runner",
    "somebody": "person, track",
    "nobody": "no person, no track",
    "everybody": "all people, all tracks",
    "whoever": "the person or track that",
    "whom": "the person or track that",
}
"""Words that no name of ours holds, each with the field's instead; plurals too."""

ALLOWED = {"_MOMENTS"}  # of a distribution


def names_in(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and name of everything that a module names itself: definitions, arguments, assigned names, attributes."""
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                yield node.lineno, node.name
            case ast.arg():
                yield node.lineno, node.arg
            case ast.Name(ctx=ast.Store()):
                yield node.lineno, node.id
            case ast.Attribute(ctx=ast.Store()):
                yield node.lineno, node.attr


def snake_case(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


PATTERN = re.compile(rf"(?:^|_)({'|'.join(FIELD_WORDS)})s?(?=_|$|\d)")


@pytest.mark.parametrize("package", ["twin", "trackers", "scripts"])
def test_names_are_the_words_of_the_field(package: str) -> None:
    found = []
    for path in SOURCES:
        if path.relative_to(ROOT).parts[0] != package:
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for line, name in [(1, path.stem), *names_in(tree)]:
            hit = PATTERN.search(snake_case(name))
            if hit and name not in ALLOWED:
                found.append(f"{path.relative_to(ROOT)}:{line}: {name} (the field says {FIELD_WORDS[hit[1]]})")
    assert not found, "\n".join(found)


ONE_MEANING = {
    "association": "detections to tracks of a system",
    "check": "what a plug-in breaks: trackers, sensors",
    "crowd": "movement among others; the folder's core",
    "environment": "model of the empty room; the twin's scan of it",
    "floor": "the pressure floor: as simulated, as evidence",
    "gait": "how a body walks; the reproduction of published gait",
    "laser": "laser scanners: as simulated, as tracked by",
    "legs": "legs in a scanner's plane: found, and as evidence",
    "options": "options of a tracking system",
    "page": "an HTML page: of a run, a study, a suite",
    "plots": "plots of a page",
    "posture": "standing, sitting, lying: as simulated, as estimated",
    "preflight": "checks before the first case",
    "reproduction": "a paper's reproduction",
    "results": "results of a batch, by group or row",
    "rules": "a paper's rules, and ours",
    "run": "runs a batch or a command from start to end",
    "runs": "runs of a reproduction, read from its suite",
    "scenario": "description of a run; the folder's core",
    "situations": "situations of several people: true, and estimated",
    "spec": "what a YAML file of a batch describes",
    "store": "results case by case, that outlive a killed run",
    "tables": "tables of text that are read and written",
    "track_manager": "initiation, existence and deletion of tracks",
    "tracker": "a system's tracker",
    "view": "the window of a room; its command",
    "visibility": "people and floor in a sensor's view: truth, studies",
    "worker": "evaluates one case in a process of its own",
    "world": "the simulated room; the folder's core",
}
"""Names that several modules or folders have, each with its one meaning. Systems and their reproductions have equal names."""


def test_a_name_of_modules_has_one_meaning() -> None:
    homes: dict[str, set[Path]] = {}
    for path in SOURCES:
        if path.relative_to(ROOT).parts[0] != "scripts":
            homes.setdefault((path.parent if path.stem == "__init__" else path).stem, set()).add(path)
    systems = {path.name for path in (ROOT / "twin" / "reproduce").iterdir()} - {"gait"}
    shared = {name: sorted(map(str, paths)) for name, paths in homes.items() if len(paths) > 1 and name not in systems}
    undecided = {name: paths for name, paths in shared.items() if name not in ONE_MEANING and name != "__main__"}
    assert undecided == {}, "give one of them another name, or write the meaning that they share"
    assert ONE_MEANING.keys() <= shared.keys()


def test_a_name_of_classes_has_one_meaning() -> None:
    homes: dict[str, list[str]] = {}
    for path in SOURCES:
        if path.relative_to(ROOT).parts[0] != "scripts":
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef):
                    homes.setdefault(node.name.strip("_"), []).append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert {name: places for name, places in homes.items() if len(places) > 1} == {}


def test_docstrings_say_what_is_done_or_what_a_thing_is() -> None:
    """No docstring begins with a question word: functions begin with a verb, things with a noun."""
    asked = re.compile(r'"""(?:What|Whether|Where|How|Who|Whom|Whose|Why|When)\b')
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in SOURCES
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if asked.search(line)
    ]
    assert not found, "\n".join(found)


PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]

PRIVATE_WORDS = {
    r"moments?": "frame, synchronized frame or time",
    r"newcomers?|strangers?": "unassigned detections, initiation",
    r"told": "reported, warned",
    r"gone|begun": "deleted, initiated",
    r"worthiest": "best assignment",
    r"recognised|known again": "re-identified",
    r"doubts?|doubted": "warning, calibration monitor",
    r"spoil(?:s|ed|t|ing)?": "corruption, fault injection",
    r"laid over": "merged",
    r"lone|barred|half-seen": "single, forbidden, partly occluded",
    r"believed": "assumed",
    r"lairs?|staged": "lying pose, precomputed",
    r"caveats?|promises?|promised": "notes, requirements",
    r"aftermath|as it stands": "validation, baseline",
    r"whoever|everyone": "the person or track that; all people",
}
"""Words of a private dialect that no sentence of the pages or of the code holds, each with the field's."""

PRIVATE_PATTERNS = [
    (re.compile(rf"(?<![\w-])(?:{words})(?![\w-])", re.IGNORECASE), instead) for words, instead in PRIVATE_WORDS.items()
]


KEPT_PHRASES = re.compile(
    r"second moments|its moments|look at one moment\)|moment\.webp|(?:INTO|FROM|ON|TABLE) moments|moments_of_case|: moments"
    r"|`[^`]*`|\btold (?:people )?apart",
    re.IGNORECASE,
)
"""Moments of a distribution and of a force; a table of results.sqlite and a description in recordings, both made before; to
tell apart is to distinguish."""


def sentences_of_code(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of comments, docstrings, and strings of several words; of a file of YAML or of a template all lines."""
    if path.suffix != ".py":
        yield from enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        return
    with tokenize.open(path) as file:
        for token in tokenize.generate_tokens(file.readline):
            if TEXT_TOKEN.fullmatch(tokenize.tok_name[token.type]) and " " in token.string:
                yield from enumerate(token.string.splitlines(), token.start[0])


TEXT_TOKEN = re.compile("COMMENT|STRING|[FT]STRING_MIDDLE")
WRITTEN = (".py", ".j2", ".yaml")


@pytest.mark.parametrize("folder", ["twin", "trackers", "models", "scripts"])
def test_code_is_written_in_the_words_of_the_field(folder: str) -> None:
    """Docstrings, comments, messages, headings of tables, templates, and the keys and comments of YAML."""
    found = [
        f"{path.relative_to(ROOT)}:{line}: {hit[0]!r} (the field says {instead})"
        for path in sorted((ROOT / folder).rglob("*"))
        if path.suffix in WRITTEN
        for line, text in sentences_of_code(path)
        for words, instead in PRIVATE_PATTERNS
        for hit in words.finditer(KEPT_PHRASES.sub("", text))
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    "text", ["# a moment ago", '"""Whoever stands."""', 'f"is told by {1}"', "x = 'gone for good'"]
)
def test_a_private_word_in_code_is_found(text: str, tmp_path: Path) -> None:
    (tmp_path / "some.py").write_text(f"{text}\n")
    sentences = [text for _, text in sentences_of_code(tmp_path / "some.py")]
    assert any(words.search(each) for words, _ in PRIVATE_PATTERNS for each in sentences)


def prose_of(page: Path) -> str:
    """Return the sentences of a page: no code, no comments, no headings, no tables; links by their text."""
    text = re.sub(r"^```.*?^```$|<!--.*?-->", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    lines = [line for line in text.splitlines() if not re.match(r"\s*(?:#|\||!\[|:::|\{\{|    )", line)]
    return re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", "\n".join(lines))


@pytest.mark.parametrize(
    "page", [*PAGES, ROOT / "CHANGELOG.md"], ids=lambda path: path.relative_to(ROOT).as_posix()
)  # former names stand in backticks
def test_pages_are_written_in_the_words_of_the_field(page: Path) -> None:
    text = re.sub(
        r"^```.*?^```$|`[^`\n]*(?:\n[^`\n]*)?`|\]\([^)]*\)",
        "",
        page.read_text(encoding="utf-8"),
        flags=re.MULTILINE | re.DOTALL,
    )
    found = [
        f"{page.name}: {hit[0]!r} (the field says {instead})"
        for words, instead in PRIVATE_PATTERNS
        for hit in words.finditer(text)
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_no_sentence_of_a_page_has_more_than_thirty_words(page: Path) -> None:
    sentences = re.split(r"(?<=[.:?!])\s+|\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )", prose_of(page))
    assert not [each for each in sentences if len(each.split()) > 30]
