"""Tables and values of docs/figures.json as Markdown, for the pages and the README.

A page writes `{{ figures SOURCE [where=TEXT] [columns=a,b] }}`, `{{ figures SOURCE across=METRIC }}`,
`{{ figures SOURCE rows=PATTERN [rest=none|source] }}`, `{{ papers }}` or `{{ all KIND }}` on a line of its own, or
`{{ value SOURCE | where | row | column }}` within a sentence; the README holds its table between two comments, which
`scripts/figures readme` fills.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from itertools import groupby

from documentation.figures import ROOT, Figure, commits_since, read_figures, read_sources

README = ROOT / "README.md"
PLACEHOLDER = re.compile(r"\{\{ (figures|papers|all|value)\b(.*?) ?\}\}")
_BLOCK = re.compile(r"(<!-- table: papers -->\n).*?(<!-- end -->)", re.DOTALL)


class MissingFigureError(Exception):
    """A page asks for a figure that docs/figures.json does not hold."""


def fill(text: str) -> str:
    """Put the figures into a page, where it names them. Raises MissingFigureError for a figure that is not there."""

    def filled(found: re.Match[str]) -> str:
        kind, given = found[1], found[2].strip()
        if kind == "papers":
            return papers_table()
        if kind == "all":
            return all_of_kind(given)
        if kind == "value":
            source, where, row, column = (part.strip() for part in given.split("|"))
            return format_value(_figure(source, where, row, column))
        source, *options = given.split()
        chosen = dict(option.split("=", 1) for option in options)
        if "rows" in chosen:
            return grouped_table(source, chosen["rows"], chosen.get("rest", "rows"))
        if "across" in chosen:
            return conditions_table(source, chosen["across"])
        return figures_table(source, chosen.get("where"), chosen["columns"].split(",") if "columns" in chosen else None)

    return PLACEHOLDER.sub(filled, text)


def sources_in(text: str) -> set[str]:
    """List the sources that a page shows figures of."""
    found = PLACEHOLDER.findall(text)
    of_papers = {each.get("source", "papers") for each in read_sources()["papers"]}
    return {
        name
        for kind, given in found
        if kind != "all"
        for name in (of_papers if kind == "papers" else {given.split()[0]})
    }


def _source(name: str) -> dict:
    kept = read_figures()
    if name not in kept:
        raise MissingFigureError(
            f"{name}: docs/figures.json has no such source; `scripts/figures measure {name}` makes it"
        )
    return kept[name]


def _figure(source: str, where: str, row: str, column: str) -> Figure:
    for each in _source(source)["figures"]:
        if (each["where"], each["row"], each["column"]) == (where, row, column):
            return each
    raise MissingFigureError(f"{source}: docs/figures.json has no {where} | {row} | {column}")


def figures_table(source: str, where: str | None = None, columns: Sequence[str] | None = None) -> str:
    """Format a source as a table: one line per condition and row, one column per metric, the best of a condition in bold."""
    from twin.report.metrics_table import METRICS

    kept = _source(source)
    figures = [each for each in kept["figures"] if where is None or each["where"] == where]
    if not figures:
        raise MissingFigureError(f"{source}: docs/figures.json has nothing of {where}")
    if kept["kind"] in _TABLES:
        return _TABLES[kept["kind"]](figures) + "\n\n" + provenance(source)
    columns = columns or list(dict.fromkeys(each["column"] for each in figures))
    names = [METRICS[each].name if each in METRICS else each for each in columns]
    lines = ["| | | n | " + " | ".join(names) + " |", "|---|---|--:|" + "--:|" * len(columns)]
    for condition, of_condition in groupby(figures, key=lambda each: each["where"]):
        cells = {(each["row"], each["column"]): each for each in of_condition}
        rows = list(dict.fromkeys(row for row, _ in cells))
        for number, row in enumerate(rows):
            shown = [cells.get((row, column)) for column in columns]
            texts = [
                "–"
                if each is None
                else _bold(format_value(each), each, [cells.get((other, each["column"])) for other in rows])
                for each in shown
            ]
            n = next((each["n"] for each in shown if each is not None), "")
            lines.append(f"| {'' if number else condition} | `{row}` | {n} | " + " | ".join(texts) + " |")
    return "\n".join(lines) + "\n\n" + provenance(source)


def grouped_table(source: str, pattern: str, rest: str = "rows") -> str:
    """Format a bench by the groups `where`, `row`, `column` and `n` of a pattern of its rows; rows of other forms below.

    rest: of several tables of a source, 'none' for one without these rows and the line of where they come from, 'source' for
    one with this line alone.
    """
    found = [(re.fullmatch(pattern, each["row"]), each) for each in _source(source)["figures"]]
    cells = {(f"{match['where']}, {match['n']}", match["row"], match["column"]): each for match, each in found if match}
    if not cells:
        raise MissingFigureError(f"{source}: docs/figures.json has no row like {pattern}")
    wheres, rows, columns = (list(dict.fromkeys(key[part] for key in cells)) for part in range(3))
    lines = ["| | | " + " | ".join(columns) + " |", "|---|---|" + "--:|" * len(columns)]
    for where in wheres:
        of_where = [row for row in rows if any((where, row, column) in cells for column in columns)]
        for number, row in enumerate(of_where):
            shown = [cells.get((where, row, column)) for column in columns]
            texts = ["–" if each is None else format_value(each) for each in shown]
            shown_row = row if " " in row else f"`{row}`"
            lines.append(f"| {'' if number else where} | {shown_row} | {' | '.join(texts)} |")
    parts = ["\n".join(lines)]
    if rest == "rows":
        parts.append(_bench_table([each for match, each in found if not match]))
    if rest != "none":
        parts.append(provenance(source))
    return "\n\n".join(parts)


def conditions_table(source: str, metric: str) -> str:
    """Format one metric of a source: a line per row, a column per condition, and the mean of these where all have a value."""
    figures = [each for each in _source(source)["figures"] if each["column"] == metric]
    if not figures:
        raise MissingFigureError(f"{source}: docs/figures.json has no {metric}")
    conditions = list(dict.fromkeys(each["where"] for each in figures))
    lines = ["| | " + " | ".join([*conditions, "mean"]) + " |", "|---|" + "--:|" * (len(conditions) + 1)]
    n = ", ".join(dict.fromkeys(str(each["n"]) for each in figures))
    for row in dict.fromkeys(each["row"] for each in figures):
        found = {each["where"]: each for each in figures if each["row"] == row}
        texts = [format_value(found[where]) if where in found else "–" for where in conditions]
        whole = len(found) == len(conditions)
        mean = sum(each["value"] for each in found.values()) / len(found)
        texts.append(format_value({**next(iter(found.values())), "value": mean}) if whole else "–")
        lines.append(f"| `{row}` | " + " | ".join(texts) + " |")
    return "\n".join(lines) + f"\n\nn = {n} runs in each cell.\n\n" + provenance(source)


def _reproduction_table(figures: Sequence[Figure]) -> str:
    """Format what a reproduction has printed values for: these, the paper's system here, ours and the plain baseline."""
    figures = [each for each in figures if each.get("paper") is not None]
    lines = ["| | printed | its system here | ours | 95 % | baseline | n |", "|---|--:|--:|--:|--:|--:|--:|"]
    reported = [key for key in ("where", "row", "column") if len({each[key] for each in figures}) > 1]
    for each in figures:
        unit = "" if each["unit"] in ("", "1") else f" [{each['unit']}]"
        printed, published, ours, low, high, plain = (
            "–" if each.get(key) is None else f"{each[key]:.3g}".replace("-", "−")
            for key in ("paper", "paper_system", "value", "low", "high", "baseline")
        )
        cells = (
            ": ".join(each[key] for key in reported) + unit,
            printed,
            published,
            ours,
            f"{low} to {high}",
            plain,
        )
        lines.append(f"| {' | '.join(cells)} | {each['n']} |")
    return "\n".join(lines)


def _bench_table(figures: Sequence[Figure]) -> str:
    """Format benchmarks: value, target and whether it is met."""
    lines = ["| measured | value | target |", "|---|--:|--:|"]
    for each in figures:
        lines.append(f"| {each['row']} | {format_value(each)} | {each['target'] or '–'} |")
    return "\n".join(lines)


_TABLES = {"reproduce": _reproduction_table, "bench": _bench_table}


def all_of_kind(kind: str) -> str:
    """Format every source of a kind ('reproduce', 'bench') that docs/figures.json holds, each under its heading."""
    names = [name for name, each in read_figures().items() if each["kind"] == kind]
    if not names:
        return f"*docs/figures.json holds none yet; sources of the kind `{kind}` in figures.yaml can be measured.*"
    return "\n\n".join(f"### {name.removeprefix(f'{kind}-')}\n\n{figures_table(name)}" for name in names)


def _bold(text: str, figure: Figure, rivals: Sequence[Figure | None]) -> str:
    from twin.report.metrics_table import METRICS

    values = [each["value"] for each in rivals if each is not None]
    if figure["column"] not in METRICS or len(values) < 2 or len(set(values)) == 1:
        return text
    best = max(values) if METRICS[figure["column"]].better == "more" else min(values)
    return f"**{text}**" if figure["value"] == best else text


def format_value(figure: Figure) -> str:
    """Format a figure in its unit, which no line break parts from it."""
    from twin.report.metrics_table import METRICS

    metric = METRICS.get(figure["column"])
    if metric is not None:
        value, unit = f"{figure['value']:.{metric.decimals or 1}f}", metric.unit
    else:
        value, unit = f"{figure['value']:.3g}", "" if figure["unit"] == "1" else figure["unit"]
    return value.replace("-", "−") + (f"\N{NO-BREAK SPACE}{unit}" if unit else "")


def provenance(source: str) -> str:
    """Format where a table comes from: command, seeds, commit and date of the measured code, and its age."""
    kept = _source(source)
    seeds = f"seeds {kept['seeds']}; " if kept["seeds"] else ""
    age = commits_since(kept["commit"], kept["code"])
    older = f", {age} later commits of that code" if age else ""
    return (
        f"<small>`{kept['command']}`; {seeds}made {kept['measured']} on {kept['machine']}, at commit "
        f"`{kept['commit'][:10]}` of {kept['committed']}{older}.</small>"
    )


def papers_table() -> str:
    """Format the papers: the value that each prints, its system in the twin, and the system as it is here."""
    lines = ["| paper | measured | printed | its system in the twin | here | runs |", "|---|---|--:|--:|--:|--:|"]
    for each in read_sources()["papers"]:
        decimals, times = each["decimals"], each.get("times", 1)

        def cell(tracker: str, each=each, decimals=decimals, times=times) -> tuple[str, int]:
            source = each.get("source", "papers")
            found = [_figure(source, each["condition"], tracker, metric) for metric in each["metrics"]]
            return f"{times * sum(one['value'] for one in found):.{decimals}f}", found[0]["n"]

        published, n = cell(each["published"])
        ours = "the same" if each["ours"] == each["published"] else cell(each["ours"])[0]
        lines.append(f"| {each['cited']} | {each['measure']} | {each['paper']:g} | {published} | {ours} | {n} |")
    return "\n".join(lines)


def readme_with_tables(text: str) -> str:
    """Return the README with its table of papers as docs/figures.json has it."""
    return _BLOCK.sub(lambda found: f"{found[1]}{papers_table()}\n{found[2]}", text)


def fill_readme() -> None:
    """Write the tables into the README."""
    text = README.read_text(encoding="utf-8")
    if not _BLOCK.search(text):
        sys.exit("README.md: has no <!-- table: papers --> ... <!-- end -->")
    README.write_text(readme_with_tables(text), encoding="utf-8")
