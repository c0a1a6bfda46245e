"""Learn where the axis of a body is behind what a scanner at waist height sees of it, from drawn rooms of the twin.

    scripts/learn-trunks [--samples FOLDER] [--seeds FIRST LAST] [--out FILE]

The same seeds make the same file. Printed is what a fifth of the rooms shows that was left out at first.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from leg_classifier.complete_trees import complete_trees
from leg_classifier.samples import DURATION_S, Scanner, drawn_world, places_in, scanned
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingRegressor

from trackers.arrays import Array
from trackers.laser.bearings import returns
from trackers.laser.clusters import Clusters, find_clusters
from trackers.laser.layer import WaistOptions, trunk_mask
from trackers.laser.legs.classifier import Forest, write_forests
from trackers.laser.outlines import SHIPPED, TrunkOutlines, mirrored, outline_features
from trackers.observations import NS_PER_S, LaserScan
from twin.streams import stream

SEEDS = (1000, 1119)
"""Seeds from 1000 to 1999 are there to be learned from."""
TIMES, PLACES = 9, 20
"""Times of a scene that are looked at, and scanners that look at each."""
_HEIGHT_M = (0.75, 1.3)
_OWN_SHARE = 0.8
"""Share of a cluster's samples that must be one person's, or nobody's axis is behind it."""
_REACH_M = 0.5
"""Greatest distance of a cluster from its person's axis, beyond which it is an outstretched arm or a leg [m]."""
_HELD_OUT = 5
"""Every so many-th seed is left out while the figures are found."""
_DEPTH, _TREES = 5, 150
_LEAST_M2 = 1e-5


@dataclass(frozen=True, eq=False)
class Samples:
    """k clusters: their features, and how far their people's axes are behind their middles and left of them [m]."""

    features: Array  # (k, features)
    axis: Array  # (k, 2)


def main() -> None:
    """Draw what is not drawn yet, learn, print what holds, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=Path, default=Path("out/trunks"), help="kept here, and taken up")
    parser.add_argument("--seeds", type=int, nargs=2, default=SEEDS, help="the first and the last")
    parser.add_argument("--out", type=Path, default=SHIPPED)
    arguments = parser.parse_args()
    arguments.samples.mkdir(parents=True, exist_ok=True)
    first, last = arguments.seeds
    parts = [_kept(arguments.samples / f"{seed}.npz", seed) for seed in range(first, last + 1)]
    held = [part for place, part in enumerate(parts) if place % _HELD_OUT == 0]
    print(f"{len(parts)} rooms, {sum(len(part.axis) for part in parts)} clusters", flush=True)
    _judge(_learned([part for place, part in enumerate(parts) if place % _HELD_OUT]), held)
    write_forests(vars(_learned(parts)), arguments.out, f"scripts/learn-trunks --seeds {first} {last}")
    print(f"{arguments.out}: {arguments.out.stat().st_size / 1000:.0f} kB")


def samples_of(seed: int) -> Samples:
    """Draw the scene of a seed and look at it."""
    rng, features, axes = stream(seed, "trunk samples", ""), [], []
    with tempfile.TemporaryDirectory() as folder:
        world, area, _ = drawn_world(seed, Path(folder), rng)
    for t in np.linspace(0.5, DURATION_S - 0.5, TIMES).tolist():
        people = world.truth(round(t * NS_PER_S), {}, with_feet=False).people
        places = {each.id: np.array([each.x, each.y]) for each in people}
        snapshot = world.snapshot(round(t * NS_PER_S) / NS_PER_S)
        for place in places_in(area, PLACES, rng):
            scanner = replace(Scanner.drawn(rng), height_m=float(rng.uniform(*_HEIGHT_M)))
            yaw = rng.uniform(-np.pi, np.pi)
            scan, person = scanned((snapshot,), scanner, np.array([[*place, yaw]]), rng)
            to_scanner = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
            local = {number: to_scanner @ (xy - place) for number, xy in places.items()}
            found, axis = _seen(scan, person, local)
            features.append(found)
            axes.append(axis)
    return Samples(np.concatenate(features), np.concatenate(axes))


def _seen(scan: LaserScan, person: NDArray[np.int16], places: dict[int, Array]) -> tuple[Array, Array]:
    """Return the features of a scan's trunks, and where the axes are; person: of each beam, 0: none."""
    options, foreground = WaistOptions(), (person > 0) & returns(scan)[1]
    clusters = find_clusters(scan, foreground, options.cluster)
    clusters = clusters.select(trunk_mask(clusters, options))
    rows = list(_axes(clusters, person, places))
    kept = [row for row, _ in rows]
    features = outline_features(scan, foreground, clusters.select(np.array(kept, np.intp)))
    return features, np.reshape([axis for _, axis in rows], (-1, 2))


def _axes(clusters: Clusters, person: NDArray[np.int16], places: dict[int, Array]) -> Iterator[tuple[int, Array]]:
    """Yield the clusters of one person each, and the axis behind their middle and left of it [m]."""
    for row in range(len(clusters)):
        first, last = clusters.first_beam[row], clusters.last_beam[row]
        beams = np.arange(first, last + 1 if last >= first else last + 1 + person.size) % person.size
        ids, count = np.unique(person[beams][person[beams] > 0], return_counts=True)
        middle = clusters.middle[row]
        if count.max() < _OWN_SHARE * count.sum() or clusters.range_m[row] < _REACH_M:
            continue
        off = places[int(ids[count.argmax()])] - middle
        if np.hypot(*off) <= _REACH_M:
            ahead = middle / clusters.range_m[row]
            yield row, np.array([ahead @ off, ahead[0] * off[1] - ahead[1] * off[0]])


def _kept(path: Path, seed: int) -> Samples:
    """Return the samples of a seed; drawn where they are not kept yet."""
    if not path.is_file():
        print(f"seed {seed}", flush=True)
        np.savez(path, **vars(samples_of(seed)))
    with np.load(path) as kept:
        return Samples(**{name: kept[name] for name in kept.files})


def _learned(parts: list[Samples]) -> TrunkOutlines:
    """Learn the forests; that of the variance from errors in rooms that the others have not learned from."""
    odd, even = _axis_forests(parts[1::2]), _axis_forests(parts[::2])
    errors = [_errors(even, part) for part in parts[1::2]] + [_errors(odd, part) for part in parts[::2]]
    square = np.concatenate([0.5 * (error**2).sum(axis=1) for error in errors])
    together = _joined([*parts[1::2], *parts[::2]])
    ln_variance = _forest(_both(together.features), np.tile(np.log(np.maximum(square, _LEAST_M2)), 2))
    # the mean of a logarithm is below the logarithm of the mean
    scale = np.log(np.mean(square / np.exp(ln_variance.score(together.features))))
    ln_variance = replace(ln_variance, bias=ln_variance.bias + float(scale))
    behind, left = _axis_forests(parts)
    return TrunkOutlines(behind, left, ln_variance)


def _axis_forests(parts: list[Samples]) -> tuple[Forest, Forest]:
    samples = _joined(parts)
    features, (behind, left) = _both(samples.features), samples.axis.T
    return _forest(features, np.tile(behind, 2)), _forest(features, np.concatenate([left, -left]))


def _both(features: Array) -> Array:
    return np.concatenate([features, mirrored(features)])


def _errors(forests: tuple[Forest, Forest], part: Samples) -> Array:
    return part.axis - np.column_stack([forest.score(part.features) for forest in forests])


def _joined(parts: list[Samples]) -> Samples:
    return Samples(np.concatenate([each.features for each in parts]), np.concatenate([each.axis for each in parts]))


def _forest(features: Array, value: Array) -> Forest:
    fitted = HistGradientBoostingRegressor(
        max_iter=_TREES, max_depth=_DEPTH, max_leaf_nodes=16, min_samples_leaf=100, learning_rate=0.08,
        l2_regularization=5, max_features=0.5, early_stopping=False, random_state=0,  # pyright: ignore[reportArgumentType]
    ).fit(features, value)  # fmt: skip
    return complete_trees(fitted, _DEPTH)


def _judge(outlines: TrunkOutlines, held: list[Samples]) -> None:
    """Print how far axes are off in rooms that were left out, and whether the variance says so."""
    samples = _joined(held)
    behind_m, left_m, variance_m2 = outlines.score(samples.features)
    off = samples.axis - np.column_stack([behind_m, left_m])
    along, across = 100 * np.sqrt((off**2).mean(axis=0))
    share = (0.5 * (off**2).sum(axis=1) / variance_m2).mean()
    print(
        f"held-out rooms: {along:.2f} cm along the beam, {across:.2f} cm across (rms); squares over the variance {share:.2f}"
    )


if __name__ == "__main__":
    main()
