"""The rules of Song et al. ("Fusion of Laser and Vision for Multiple Targets Tracking via On-line Learning") by themselves.

One table for `laser-vision-learning-paper`; `-paper-laser` and `-paper-vision` are its two baselines (section VI).

| rule | the paper | here |
|---|---|---|
| two-feet proposal, laser points as observation | stated, IV.A (details in its ref. 2) | as ours |
| training below 1.5 m | stated, VI | `situations.interacting_m` 1.5 |
| challenging below 0.3 m | stated, VI | `situations.correlated_m` 0.3, a gap between bodies |
| random patches, RGB and edge orientations | stated, IV.A | `looks.kinds`; no height on the body as a feature |
| negatives: patches of possibly confused targets | stated, IV.B | `looks.background` 0: no patches of the room |
| M trees anew in the first frame, then K kept | stated, fig. 7 | `boosting.first_a_frame` null, all targets each frame |
| score maps draw correlated targets | stated, V.A, eq. 1 | `recognition.drawn` all: seen by a scanner or not |
| levels of re-weighting and re-sampling | stated, V.A; their number is not | `maps.levels` 3, as ours |
| classifiers identify who comes out of a merge | stated, V.B | `identities.margin` 0: looks decide, however narrowly |
| pictures on which they decide | unstated | `identities.pictures` 1: the frame of the split, as figure 9 |
| one track for merged targets | stated, V.B | unmet: each member keeps particles at the group's place |
| missing targets | unstated | one time for all, `coast_hidden_s` as `coast_s`; no re-identification in passing |
| a point near two targets | unstated | measures both, `points.own_m` 0 |
| β of negative scores | unstated | 0, as ours |
| M, K, patches, σ, particles | empirical, not given | 30, 25, 40 of 0.2 m, one side of a patch, 500: as ours |
| PD-PF, vision only | cited (ref. 18) | no re-identification by colour: `association.foreign_above` 1 |

The empirical values are those of ours, chosen on development seed 1003 by the choices that `twin reproduce
laser-vision-learning` prints (M 20 to 50, K 0 to M, patches of 0.12 to 0.3 m, 20 to 80 of them).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

PAPER_LASER: Mapping[str, Any] = {
    "points": {"own_m": 0.0},
    "track_management": {"coast_hidden_s": 1.0, "reid_speed_m_s": None},
}
"""The laser half: options of `laser-vision-learning-paper-laser`, beside `camera`."""

PAPER: Mapping[str, Any] = {
    **PAPER_LASER,
    "recognition": {"drawn": "all"},
    "identities": {"margin": 0.0, "pictures": 1},
    "looks": {
        "height": False,
        "background": 0,
        "classifiers_a_frame": 100,
        "boosting": {"first_a_frame": None},
    },
}
"""The options of `laser-vision-learning-paper`."""

PAPER_VISION: Mapping[str, Any] = {"association": {"foreign_above": 1.0}}
"""The options of `laser-vision-learning-paper-vision`."""
