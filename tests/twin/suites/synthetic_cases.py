"""Cases that are quick: figures made up, and what can go wrong, without a twin."""

from __future__ import annotations

import os
import time

from synthetic_work import do

from twin.suites.worker import CaseResult, CaseWork, Incident


def result_of(work: CaseWork) -> CaseResult:
    """A case's figures without recording or tracking: made up from its seed, the environment saying what goes wrong."""
    case = work.case
    time.sleep(float(os.environ.get("SYNTHETIC_CASE_S", "0")))
    for each in os.environ.get("SYNTHETIC_FAULT", "").split(","):  # KIND, or BEGINNING=KIND for cases of such an id
        beginning, _, kind = each.rpartition("=")
        if kind and case.tracker == "laser-kalman" and case.id.startswith(beginning):
            do({"kind": kind})
    noise = float(os.environ.get("SYNTHETIC_NOISE", "1"))
    worse = float(os.environ.get("SYNTHETIC_WORSE_M", "0"))
    return CaseResult(
        metrics={
            "mota": 0.9 + 0.01 * (case.seed % 5),
            "motp_m": 0.06 + 0.001 * (case.seed % 7) + worse,
            "misidentifications": case.seed % 2,
            "head_error_m": {"x": None, "y": None, "z": None},
            "gate_m": 0.5,
            "at_1m": {"mota": 0.95},
            "ms_per_frame": {"mean": 2.0, "p95": 3.0},
        },
        incidents=(Incident(3.0 + case.seed, "misidentification", "blue → white", 1.0),),
        files={"metrics.json": b"{}"} | ({"report.html": b"<p>a report</p>"} if case.report else {}),
        renderer="none",
        recording=f"{case.scenario} {case.seed} {noise}",
        people=f"{case.scenario} {case.seed} people",
        scatter_m={"scanner at 0, 0, 0.95": 0.008 * noise},
        tracker_warnings=(f"{case.tracker}: doubts everything from {case.seed}.5 s on",),
    )
