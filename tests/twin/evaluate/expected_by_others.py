"""Makes the expected values in `expected_by_others.json`: each program in an environment of its own, which has it and numpy.

python expected_by_others.py stonesoup      # stonesoup 1.9.1
python expected_by_others.py trackeval      # trackeval 1.3.0
"""

from __future__ import annotations

import json
import sys
from datetime import datetime
from pathlib import Path

import numpy as np
from synthetic_sets import ORDERS_AND_CUTOFFS, sets, similarities

EXPECTED = Path(__file__).with_suffix(".json")


def by_stonesoup() -> dict:
    from stonesoup.measures import Euclidean
    from stonesoup.metricgenerator.ospametric import GOSPAMetric, OSPAMetric
    from stonesoup.types.state import State

    def states(places: np.ndarray) -> list:
        return [State(place[:, None], timestamp=datetime(2020, 1, 1)) for place in places]

    pairs = [(states(tracks), states(people)) for people, tracks in sets()]
    found: dict = {"ospa": [], "gospa": []}
    for order, cutoff in ORDERS_AND_CUTOFFS:
        ospa = OSPAMetric(p=order, c=cutoff, measure=Euclidean())
        found["ospa"].append([float(ospa.compute_OSPA_distance(*pair).value) for pair in pairs])
        gospa = GOSPAMetric(p=order, c=cutoff, measure=Euclidean())
        values = [gospa.compute_gospa_metric(*pair)[0].value for pair in pairs]
        parts = ("distance", "localisation", "missed", "false")
        found["gospa"].append([[abs(float(value[part])) for part in parts] for value in values])
    return found | {"input_sum": float(sum(each.sum() for pair in sets() for each in pair))}


def by_trackeval() -> dict:
    from trackeval.metrics import HOTA

    frames = similarities()
    people, tracks = (np.unique(np.concatenate([frame[side] for frame in frames])) for side in (0, 1))
    scores = HOTA().eval_sequence(
        {
            "num_timesteps": len(frames),
            "num_gt_ids": len(people),
            "num_tracker_ids": len(tracks),
            "num_gt_dets": sum(len(frame[0]) for frame in frames),
            "num_tracker_dets": sum(len(frame[1]) for frame in frames),
            "gt_ids": [np.searchsorted(people, frame[0]) for frame in frames],
            "tracker_ids": [np.searchsorted(tracks, frame[1]) for frame in frames],
            "similarity_scores": [frame[2] for frame in frames],
        }
    )
    return {name: np.asarray(values).tolist() for name, values in scores.items()} | {
        "input_sum": float(sum(each.sum() for frame in frames for each in frame))
    }


if __name__ == "__main__":
    program = sys.argv[1]
    expected = json.loads(EXPECTED.read_text()) if EXPECTED.exists() else {}
    expected[program] = {"stonesoup": by_stonesoup, "trackeval": by_trackeval}[program]()
    EXPECTED.write_text(json.dumps(expected, indent=1, sort_keys=True) + "\n")
