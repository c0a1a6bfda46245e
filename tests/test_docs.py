"""README and docs: every block of code runs or says why not, links lead somewhere, and measured values have a source."""

from __future__ import annotations

import re
import runpy
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import pytest
import typer.main
from documentation import gallery, reference, tables
from documentation.build import assembled
from documentation.figures import commits_since, read_figures, read_sources
from documentation.tables import PLACEHOLDER, readme_with_tables, sources_in
from typer.testing import CliRunner

import twin
from trackers.configuration import leaves_of, validate
from trackers.observations import Observation
from trackers.presets import PRESETS, options_of
from trackers.rig import Rig
from trackers.rig_sensors import RigSensor
from trackers.user_input.plain_data import parse_yaml
from twin.cli import app
from twin.models import SENSOR_KINDS
from twin.recording.situation_table import SITUATION_COLUMNS
from twin.recording.tables import TRUTH_COLUMNS
from twin.recording.truth_tables import BASE_COLUMNS, BOX_COLUMNS, FEET_COLUMNS, PEOPLE_COLUMNS, RAY_COLUMNS
from twin.scenario import load_scenario
from twin.scenario.sensor_descriptions import LaserDescription
from twin.studies.spec import load_study
from twin.suites.spec import load_suite

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("*.py"))

FENCE = re.compile(
    r'(?:^<!-- not run: (?P<reason>[^>]+) -->\n)?^```(?P<language>\w*)(?: title="(?P<title>[^"]+)")?\n(?P<code>.*?)^```$',
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    language: str
    title: str | None
    code: str
    reason: str | None

    def commands(self) -> Iterator[list[str]]:
        for line in self.code.replace("\\\n", "").splitlines():
            if words := shlex.split(line, comments=True):
                yield words


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    return [Block(each["language"], each["title"], each["code"], each["reason"]) for each in FENCE.finditer(text)]


def named(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


WITH_CODE = [page for page in PAGES if blocks(page)]


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_CODE, ids=named)
def test_the_blocks_of_a_page_run_in_their_order(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    names: dict[str, Any] = {}
    for number, block in enumerate(blocks(page)):
        if block.title:
            (tmp_path / block.title).write_text(block.code, encoding="utf-8")
        if block.language == "sh":
            for words in block.commands():
                run_command(words, parse_only=block.reason is not None)
        elif block.reason is None:
            match block.language:
                case "python" if not block.title:
                    exec(compile(block.code, f"{named(page)}, block {number}", "exec"), names)
                case "yaml":
                    load_described(tmp_path / (block.title or f"block-{number}.yaml"), block.code)
                case "python" | "xml":
                    pass  # a later block uses the file
                case other:
                    pytest.fail(f"a block of {other!r} neither runs nor says why not: {block.code[:80]}")


def run_command(words: list[str], parse_only: bool) -> None:
    """Run a line of a shell, or check that its command and options exist."""
    if words[0] == "twin":
        if parse_only:
            command, rest = typer.main.get_command(app), words[1:]
            while hasattr(command, "commands"):
                assert rest[0] in command.commands, f"twin has no command {rest[0]}"
                command, rest = command.commands[rest[0]], rest[1:]
            options = {name for parameter in command.params for name in (*parameter.opts, "-h", "--help")}
            unknown = {word.partition("=")[0] for word in rest if word.startswith("--")} - options
            assert not unknown, f"{shlex.join(words)}: there are no options {unknown}"
        else:
            assert app(words[1:], standalone_mode=False) in (0, None), shlex.join(words)
    else:
        assert parse_only, f"{words[0]} is not run; `<!-- not run: REASON -->` before the block says why"
        if "scripts/" in words[0]:
            assert (ROOT / words[0]).is_file(), words[0]


def load_described(path: Path, text: str) -> None:
    """Load a YAML file by what it describes: a study, a suite, a rig or a scenario."""
    path.write_text(text, encoding="utf-8")
    content = parse_yaml(text, str(path), "a mapping")
    if "devices" in content:
        load_study(path)
    elif "scenarios" in content or "recordings" in content:
        load_suite(path)
    elif any("topic" in each for each in content["sensors"].values() if each) if "sensors" in content else False:
        Rig.parse(text, str(path))
    else:
        load_scenario(path)


@pytest.mark.slow
@pytest.mark.parametrize("script", EXAMPLES, ids=lambda path: path.stem)
def test_the_examples_write_their_pictures(script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", [str(script), str(tmp_path / "shown.png")])
    runpy.run_path(str(script), run_name="__main__")
    assert (tmp_path / "shown.png").stat().st_size > 5000


def test_the_examples_are_numbered_from_one_on() -> None:
    assert [path.name[:3] for path in EXAMPLES] == [f"{number:02d}-" for number in range(1, len(EXAMPLES) + 1)]


LINK = re.compile(r"(?<!`)\[[^\]]*\]\((?P<to>[^)\s]+)\)")


def anchors(text: str) -> set[str]:
    headings = re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL), re.MULTILINE)
    slugs = {
        re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", each.replace("`", "")).strip().lower()) for each in headings
    }
    return slugs | set(re.findall(r"^::: (\S+)$", text, re.MULTILINE))


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    """Every page as it is built: those that the build makes, and figures filled in."""
    made = {f"docs/{path}": text for path, text in assembled().items()}
    return made | {named(page): page.read_text(encoding="utf-8") for page in PAGES[:2]}


def test_links_and_anchors_lead_somewhere(pages: dict[str, str]) -> None:
    built = {"docs/assets/moment.webp", "docs/assets/walk.webp", *(f"docs/{path}" for path in gallery.pictures())}
    faults = []
    for page, text in pages.items():
        prose = re.sub(r"^( *)```.*?^\1```$", "", text, flags=re.MULTILINE | re.DOTALL)
        for link in LINK.finditer(prose):
            to, _, anchor = link["to"].partition("#")
            if re.match(r"[a-z]+:", to):
                continue
            target = (ROOT / page).parent.joinpath(to).resolve().relative_to(ROOT).as_posix() if to else page
            if target not in pages and target not in built and not (ROOT / target).exists():
                faults.append(f"{page}: {link['to']}: there is no {target}")
            elif anchor and anchor not in anchors(pages.get(target, "")):
                faults.append(f"{page}: {link['to']}: {target} has no such heading")
    assert not faults, "\n".join(faults)


NAMED = re.compile(r"`((?:twin|trackers|scripts|models|tests|docs)/[\w/.-]+|(?:twin|trackers)\.\w+\.[\w.]+)`")


def test_files_and_modules_that_pages_name_are_there(pages: dict[str, str]) -> None:
    faults = []
    for page, text in pages.items():
        for name in NAMED.findall(text):
            module = Path(*name.split(".")) if "/" not in name else Path(name)
            places = [module, module.with_suffix(".py"), module.parent.with_suffix(".py")]
            if not any((ROOT / place).exists() for place in places):
                faults.append(f"{page}: {name}: is not there")
    assert not faults, "\n".join(faults)


def test_every_page_is_in_the_menu(pages: dict[str, str]) -> None:
    menu = (ROOT / "scripts" / "documentation" / "site.yml").read_text(encoding="utf-8")
    listed = {f"docs/{path}" for path in re.findall(r"(\S+\.md)$", menu, re.MULTILINE)}
    assert listed == {page for page in pages if page.startswith("docs/")}


@pytest.mark.parametrize("schema", ["scenario", "suite", "study", "rig"])
def test_the_reference_of_a_schema_has_every_field_with_its_meaning(schema: str, pages: dict[str, str]) -> None:
    text = pages[f"docs/reference/{schema}.md"]
    rows = re.findall(r"^\| `([^`]+)` \|(?:[^|\\]|\\.)*\|(?:[^|\\]|\\.)*\|((?:[^|\\]|\\.)*)\|$", text, re.MULTILINE)
    assert len(rows) > 15
    assert [name for name, meaning in rows if not meaning.strip() and name not in {"kind"}] == []


def test_the_page_of_sensors_has_every_field_of_a_scanner_with_its_default(pages: dict[str, str]) -> None:
    rows = dict(re.findall(r"^\| `(\w+)` \| `?([^|`]*)`? \| \S.*\|$", pages["docs/concepts/sensors.md"], re.MULTILINE))
    fields = LaserDescription.model_fields
    assert rows.keys() >= fields.keys() - {"kind"} and rows["rate_hz"] == "required"
    assert float(rows["range_max_m"]) == fields["range_max_m"].default


@pytest.mark.parametrize("name", PRESETS)
def test_the_reference_of_trackers_has_every_option_with_its_meaning(name: str, pages: dict[str, str]) -> None:
    """As the trackers themselves take them: each value of an option of a preset is on the page, or the class's own is."""
    model, given = options_of(name)
    printed = CliRunner().invoke(app, ["list", "trackers", "--options", name]).stdout
    rows = {
        row[0]: row[1:]
        for row in re.findall(r"^\| `([^`]+)` \| `([^`]*)` \| ([^|]*) \| (.*) \|$", printed, re.MULTILINE)
    }
    options = dict(leaves_of(validate(model, given, name)))
    assert rows.keys() >= options.keys() and all(meaning.strip() for _, _, meaning in rows.values())
    page = pages["docs/reference/trackers.md"]
    assert f"## {name}\n" in page and all(f"| `{path}` |" in page for path in options)
    assert [path for path, value in options.items() if isinstance(value, float) and float(rows[path][0]) != value] == []


def test_nothing_is_installed_by_a_name_that_an_index_may_not_have(pages: dict[str, str]) -> None:
    sources = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "twin").rglob("*.py")}
    named = re.compile(r"pip install[^\n]*\broomtwin(?! @|\.git)")
    assert [name for name, text in {**pages, **sources}.items() if named.search(text)] == []


def test_the_command_line_page_has_every_command() -> None:
    found = reference.command_page()
    for name, command in typer.main.get_command(app).commands.items():
        assert f"## twin {name}" in found, name
        assert not hasattr(command, "help") or command.help


def test_the_gallery_shows_everything_that_is_shipped() -> None:
    assert {name for page, name, *_ in gallery.shown() if page == "sensors"} >= set(SENSOR_KINDS)
    assert all(text.strip() and line.strip() for _, _, line, text, _ in gallery.shown())


@pytest.mark.parametrize(
    ("table", "columns"),
    [
        ("truth_people.csv", PEOPLE_COLUMNS),
        ("truth.csv", (*TRUTH_COLUMNS, "visible_SENSOR")),
        ("truth_feet.csv", (*FEET_COLUMNS, "cells_FLOOR")),
        ("truth_boxes.csv", BOX_COLUMNS),
        ("truth_rays.csv", RAY_COLUMNS),
        ("truth_bases.csv", BASE_COLUMNS),
        ("truth_situations.csv", SITUATION_COLUMNS),
    ],
)
def test_every_column_of_the_truth_is_explained_in_its_order(table: str, columns: tuple[str, ...]) -> None:
    text = (ROOT / "docs" / "reference" / "files.md").read_text(encoding="utf-8")
    (explained,) = re.findall(rf"^\| `{re.escape(table)}` \|[^|]+\|(.*)\|$", text, re.MULTILINE)
    assert tuple(re.findall(r"`(\w+)`", explained)) == columns


def test_the_reference_holds_every_kind_of_observation_and_of_sensor() -> None:
    text = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    for kind in (*get_args(Observation), *get_args(get_args(RigSensor)[0])):
        assert f"::: {kind.__module__}.{kind.__name__}\n" in text, kind.__name__


def test_the_python_reference_holds_every_public_name_with_its_fields() -> None:
    held = reference.entries((ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8"))
    names = {name.rpartition(".")[2] for name in held}
    assert set(twin.__all__) <= names
    written = {page: page.read_text(encoding="utf-8") for page in [*PAGES, *EXAMPLES]}
    for page, text in written.items():
        found = re.findall(r"^from (?:twin|trackers)[\w.]* import (.+)$", text, re.MULTILINE)
        found += re.findall(r"`(?:twin|trackers)\.[\w.]+\.([A-Z]\w+)`", text)
        used = {name for line in found for name in re.split(r", *", line)}
        assert used <= names, f"{named(page)}: {used - names}: of these python.md has no entry"
    for name, kind in held.items():
        silent = [field for field, _, meaning in reference.field_rows(kind) if not meaning]
        assert not silent, f"{name}: {silent} say nothing of themselves"
    fields = reference.fill("::: trackers.observations.LaserScan\n")
    assert (
        all(f"| `{name}` |" in fields for name in ("sensor", "stamp_ns", "ranges_m", "range_min_m"))
        and "\\[ns]" in fields
    )


def test_a_page_that_is_filled_in_says_so_and_where_to_read_it_whole() -> None:
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        listed = re.search(r"\{\{ list \w+ \}\}", text)
        if listed:
            assert "`twin list" in text, f"{named(page)}: names no command that prints what is filled in"
        elif reference.is_filled(text) or PLACEHOLDER.search(text):
            html = named(page).removeprefix("docs/").replace(".md", ".html")
            assert f"`out/docs/{html}`" in text, f"{named(page)}: says nowhere that scripts/docs fills it in"


def test_what_a_gate_keeps_holds_the_cases_that_its_page_links_to() -> None:
    found = []
    for block in blocks(ROOT / "docs" / "howto" / "gate.md"):
        content = parse_yaml(block.code, "gate.md", "a mapping") if block.language == "yaml" else {}
        steps = content.get("jobs", {}).get("twin", {}).get("steps", [])
        found += [[each["with"]["path"]] for each in steps if "upload-artifact" in each.get("uses", "")]
        found += [content["twin"]["artifacts"]["paths"]] if "artifacts" in content.get("twin", {}) else []
    assert len(found) == 2
    for paths in found:
        kept = {path for path in ("out/report.html", "out/cases") if any(path.startswith(each) for each in paths)}
        assert kept == {"out/report.html", "out/cases"}, paths


BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)


@pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome is on this machine")
def test_the_search_of_pages_on_a_disk_shares_nothing_with_its_page(tmp_path: Path) -> None:
    """A worker has copies of what it is sent: one that changed the page's own query emptied the box at every letter."""
    (tmp_path / "worker.js").write_text("onmessage = (e) => { e.data.words.push('b'); postMessage(e.data); };", "utf-8")
    shim = (ROOT / "docs" / "assets" / "iframe-worker.js").read_text("utf-8")
    script = """const sent = {words: ["a"]}, worker = new Worker("worker.js");
worker.onmessage = (e) => { document.title = `${sent.words} ${e.data.words}`; };
worker.postMessage(sent);"""
    page = tmp_path / "page.html"
    page.write_text(f"<!doctype html><body><script>{shim}</script><script>{script}</script></body>", "utf-8")
    command = [str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    command += [f"--user-data-dir={tmp_path / 'browser'}", "--virtual-time-budget=3000", "--dump-dom", page.as_uri()]
    shown = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout
    assert "<title>a a,b</title>" in shown, shown[:2000]


class TestFigures:
    """Measured values come from docs/figures.json, each with its command, commit and n."""

    def test_every_table_of_a_page_has_its_source(self) -> None:
        asked = {source for page in PAGES for source in sources_in(page.read_text(encoding="utf-8"))}
        assert asked <= read_figures().keys()

    def test_every_source_can_be_made_again(self) -> None:
        sources = read_sources()["sources"]
        for name, kept in read_figures().items():
            assert name in sources, f"docs/figures.json: {name}: figures.yaml has no such source"
            assert kept["code"] == sources[name]["code"], f"{name}: figures.yaml names other code"
            assert all((ROOT / path).exists() for path in kept["code"]), (
                f"{name}: measures code that is not there any more"
            )
            assert re.fullmatch("[0-9a-f]{40}", kept["commit"]) and kept["command"] and kept["measured"]
            assert all(each["n"] >= 1 and isinstance(each["value"], float | int) for each in kept["figures"])

    def test_no_source_is_older_than_it_may_be(self) -> None:
        most = read_sources()["most_behind"]
        for name, kept in read_figures().items():
            behind = commits_since(kept["commit"], kept["code"])  # None in a copy without the history
            assert behind is None or behind <= most, f"{name}: measure it again, its code changed in {behind} commits"

    def test_the_readme_shows_the_table_as_it_is(self) -> None:
        text = (ROOT / "README.md").read_text(encoding="utf-8")
        assert readme_with_tables(text) == text, "`scripts/figures readme` fills the table"

    def test_a_metric_across_conditions_has_a_mean_only_where_all_have_a_value(self, monkeypatch) -> None:
        values = {("lab", "sort"): 0.5, ("hall", "sort"): 0.7, ("lab", "mine"): 0.9}
        figures = [
            {"where": at, "row": row, "column": "hota", "value": each, "n": 2} for (at, row), each in values.items()
        ]
        kept = read_figures()["shipped"] | {"figures": figures}
        monkeypatch.setattr(tables, "read_figures", lambda: {"shipped": kept})
        lines = tables.fill("{{ figures shipped across=hota }}").splitlines()
        assert lines[0] == "| | lab | hall | mean |" and "n = 2 runs in each cell." in lines
        assert lines[2:4] == ["| `sort` | 0.500 | 0.700 | 0.600 |", "| `mine` | 0.900 | – | – |"]
        with pytest.raises(tables.MissingFigureError, match="no mota"):
            tables.fill("{{ figures shipped across=mota }}")

    def test_rows_of_a_bench_are_grouped_and_none_is_lost(self, monkeypatch) -> None:
        rows = ["one, sort: F1, 5 scans", "one, sort: twin's, 5 scans", "two, sort: F1, 7 scans", "rank correlation"]
        figures = [{"row": row, "column": "value", "value": 0.5, "unit": "1", "target": ""} for row in rows]
        kept = read_figures()["speed"] | {"figures": figures}
        monkeypatch.setattr(tables, "read_figures", lambda: {"speed": kept})
        pattern = r"(?P<where>\w+),\s(?P<row>\w+):\s(?P<column>[^,]+),\s(?P<n>.*)"
        lines = tables.fill(f"{{{{ figures speed rows={pattern} }}}}").splitlines()
        assert lines[0] == "| | | F1 | twin's |" and "| rank correlation | 0.5 | – |" in lines
        assert lines[2:4] == ["| one, 5 scans | `sort` | 0.5 | 0.5 |", "| two, 7 scans | `sort` | 0.5 | – |"]

    def test_what_pages_say_of_all_rules_together_holds(self) -> None:
        """docs/results/rules.md: by HOTA ahead of the paper and of `sort` in every scene, and best with every rule."""
        hota = {
            source: {
                (each["where"], each["row"]): each["value"] for each in kept["figures"] if each["column"] == "hota"
            }
            for source, kept in read_figures().items()
            if source in ("ablation", "leave-one-out")
        }
        ours = {where: value for (where, row), value in hota["ablation"].items() if row == "laser-fisheye-imm"}
        assert len(ours) >= 5
        for row in ("laser-fisheye-imm-paper", "sort"):
            assert all(value > hota["ablation"][where, row] for where, value in ours.items())
        matters = {row: value for (where, row), value in hota["leave-one-out"].items() if where == "home-three-people"}
        assert matters["without-postures"] < matters["laser-fisheye-imm"]

    def test_no_table_of_results_is_typed(self) -> None:
        """A table in the results and the README holds no decimal fraction but the paper's, made by the command."""
        made = re.compile(r"<!-- table: papers -->.*?<!-- end -->", re.DOTALL)
        for page in (
            ROOT / "README.md",
            ROOT / "docs/results/figures.md",
            ROOT / "docs/results/rules.md",
            ROOT / "docs/results/twin-against-real.md",
            ROOT / "docs/howto/choose.md",
        ):
            text = PLACEHOLDER.sub("", made.sub("", FENCE.sub("", page.read_text(encoding="utf-8"))))
            rows = [row for row in re.findall(r"^\|.*\|$", text, re.MULTILINE) if re.search(r"\d\.\d{2}", row)]
            assert not rows, f"{named(page)}: {rows}"
