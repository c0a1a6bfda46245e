"""The means of a suite as a table in Markdown, for a README or a pull request."""

from __future__ import annotations

from itertools import groupby

from twin.shown import shown
from twin.suites.comparison import Comparison
from twin.suites.figures import FIGURE, figure_named, written
from twin.suites.junit import evidence
from twin.suites.results import Group, GroupKey, Results, mean_over_seeds

_SHOWN = ("mota", "idf1", "hota", "id_switches", "misidentifications", "lost_tracks")


def markdown_table(results: Results) -> str:
    """Means over seeds, a row a scenario, variant and tracker; the best trackers of each scenario in bold."""
    heads = [FIGURE[metric].name for metric in _SHOWN]
    lines = [
        _line(["scenario", "tracker", "seeds", "person-frames", *heads]),
        _line(["---", "---", *["--:"] * (2 + len(heads))]),
    ]
    for _, rows in groupby(results.groups.items(), key=lambda row: (row[0].scenario, row[0].overrides)):
        lines += _rows_of_scenario(list(rows))
    return "\n".join(lines)


def markdown_comparison(comparison: Comparison) -> str:
    """What got worse and better, a row a figure, and the warnings; one line where nothing got worse."""
    heads = ["", "scenario", "tracker", "figure", "before", "now", "change", "allowed", "p", "seeds"]
    told = [("worse", each) for each in comparison.worse] + [("better", each) for each in comparison.better]
    lines = [
        f"{len(comparison.changes)} figures compared: {len(comparison.worse)} worse, {len(comparison.better)} better."
    ]
    if told:
        lines += ["", _line(heads), _line(["---"] * 4 + ["--:"] * 6)]
    for word, change in told:
        name = f"{change.key.scenario} ({change.variant})" if change.variant else change.key.scenario
        gone = change.now is None
        cells = [
            f"**{word}**" if word == "worse" else word,
            name,
            f"`{change.key.tracker}`",
            figure_named(change.metric).name,
            written(change.metric, change.before),
            "gone" if gone else written(change.metric, change.now),
            "" if gone else written(change.metric, change.change, sign=True),
            "" if gone else written(change.metric, change.allowed),
            evidence(change),
            str(change.n_seed),
        ]
        lines.append(_line(cells))
    return "\n".join([*lines, *(f"\nWarning: {_cell(warning)}" for warning in comparison.warnings)])


def _rows_of_scenario(rows: list[tuple[GroupKey, Group]]) -> list[str]:
    columns = [_column(metric, [group for _, group in rows]) for metric in _SHOWN]
    lines = []
    for place, (key, group) in enumerate(rows):
        name = f"{key.scenario} ({group.variant})" if group.variant else key.scenario
        cells = [
            name if place == 0 else "",
            f"`{key.tracker}`",
            str(len(group.seeds)),
            group.n,
            *[column[place] for column in columns],
        ]
        lines.append(_line(cells))
    return lines


def _column(metric: str, groups: list[Group]) -> list[str]:
    """A figure of each tracker as text; the best, where not all are alike, in bold."""
    means = [mean_over_seeds(group.values(metric)) for group in groups]
    figure = FIGURE[metric]
    texts = ["–" if mean is None else f"{mean.mean:.{figure.decimals or 1}f}" for mean in means]
    known = {float(text) for text in texts if text != "–"}
    if len(known) > 1:
        best = max(known) if figure.better == "more" else min(known)
        texts = [f"**{text}**" if text != "–" and float(text) == best else text for text in texts]
    return [text.replace("-", "−") for text in texts]


def _line(cells: list[str]) -> str:
    return f"| {' | '.join(map(_cell, cells))} |"


def _cell(text: str) -> str:
    """A text as part of one line: what a user has written neither ends a cell nor is a tag."""
    return shown(" ".join(text.split())).replace("|", "\\|").replace("<", "&lt;")
