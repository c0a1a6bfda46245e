"""Where to look when a figure is worse: the page of the case, and the time in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from twin.suites.comparison import Change
from twin.suites.results import Results
from twin.suites.store import ResultStore

_KIND_OF = {"misidentifications": "misidentification", "lost_tracks": "lost", "id_switches": "switch"}
"""Figures that count events; of every other the worst second is shown."""


@dataclass(frozen=True)
class Look:
    """A case's page and the moment to look at [s]; `what` happened there."""

    page: Path
    t_s: float
    what: str

    def text(self) -> str:
        """Path and moment on one line."""
        return f"{self.page} at {self.t_s:.1f} s ({self.what})"


def look_at(change: Change, results: Results, store: ResultStore, folder: Path) -> Look | None:
    """The moment behind a change, in the seed that got worst; None where the run has no case of it."""
    group = results.groups.get(change.key)
    case_id = group.cases.get(change.worst_seed) if group is not None and change.worst_seed is not None else None
    if case_id is None:
        return None
    moments = store.moments(case_id)
    kind = _KIND_OF.get(change.metric)
    chosen = next((moment for moment in moments if moment.kind == kind), moments[0] if moments else None)
    if chosen is None:
        return None
    return Look(page_of(folder, case_id), chosen.t_s, chosen.what)


def page_of(folder: Path, case_id: str) -> Path:
    """The report of a case of the run in `folder`; of a suite without reports the case's folder, its tracks and figures."""
    case = folder / "cases" / case_id
    return report if (report := case / "report.html").is_file() else case
