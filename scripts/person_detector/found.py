"""Recall and precision of a model on a recorded scene."""

from __future__ import annotations

import numpy as np
from person_detector.samples import Scene
from scipy.optimize import linear_sum_assignment

from trackers.filters.gating import distances
from trackers.vision.person_detector import PersonDetector, PersonModel

_GATE_M = 0.5


def found(scene: Scene, model: PersonModel) -> tuple[float, float, float]:
    """Recall of the people in plain sight, precision against everybody, and the mean error of the position [m]."""
    detector = PersonDetector(scene.camera, scene.area, model=model)
    owed = hits = wrong = 0
    errors: list[float] = []
    for look in scene.looks:
        seen = detector.detect(scene.foreground.mask(look.picture)).position
        plain = look.in_plain_sight(scene.camera)
        distance = distances(seen, look.position_m)
        rows, columns = linear_sum_assignment(np.minimum(distance, 2 * _GATE_M))
        kept = distance[rows, columns] < _GATE_M
        errors += distance[rows, columns][kept].tolist()
        owed, hits = owed + int(plain.sum()), hits + int(plain[columns[kept]].sum())
        wrong += len(seen) - int(kept.sum())
    return hits / owed, hits / (hits + wrong), float(np.mean(errors))
