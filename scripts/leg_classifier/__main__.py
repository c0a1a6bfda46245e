"""Learn what legs look like to a low scanner, from drawn rooms of the twin; judge it on labelled scans of real ones.

    scripts/learn-legs [--samples FOLDER] [--seeds FIRST LAST] [--out FILE]
    scripts/learn-legs --existence [--samples FOLDER] [--drives FIRST LAST]     # by the legs that are there
    scripts/learn-legs --evaluate FIRST LAST [--rates 3 10 40]   # seeds of drives; nothing is learned
    scripts/learn-legs --judge FOLDER          # nothing is learned; FOLDER holds positive_{1,2,3}_extracted.npz

The same seeds make the same file. Real scans are judged on and never learned from.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from leg_classifier.complete_trees import NEVER, complete_trees
from leg_classifier.existence import DriveCounts, TrackSamples, counted, track_samples
from leg_classifier.judge import judge
from leg_classifier.samples import Samples, samples_of
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.metrics import roc_auc_score

from trackers.arrays import Array
from trackers.laser.legs.classifier import (
    SHIPPED,
    Forest,
    LegClassifier,
    read_classifier,
    read_forest,
    with_verdicts,
    write_forests,
)
from trackers.laser_legs.tracker import EXISTENCE

SEEDS, DRIVES = (1000, 1159), (1200, 1267)
"""Seeds from 1000 to 1999 are there to be learned from."""
_DEPTH, _TREES = 5, 200
_TRACK_TREES = 200
_FOLDS = 2
_FIRST = 5
"""One of so many drives is tracked first, before there is an existence to confirm tracks by."""
_HELD_OUT = 5
"""Every so many-th seed is left out while the figures are found."""


def main() -> None:
    """Draw what is not drawn yet, learn, print what holds, write; or judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=Path, default=Path("out/legs"), help="kept here, and taken up")
    parser.add_argument("--seeds", type=int, nargs=2, default=SEEDS, help="the first and the last")
    parser.add_argument("--existence", action="store_true", help="learn which tracks are people, from drives")
    parser.add_argument("--drives", type=int, nargs=2, default=DRIVES, help="seeds of the first and the last drive")
    parser.add_argument("--evaluate", type=int, nargs=2, help="seeds of drives to count the errors of `laser-legs` on")
    parser.add_argument("--rates", type=float, nargs="+", help="rates of the scanners [Hz]; each robot's drawn without")
    parser.add_argument("--out", type=Path, default=SHIPPED)
    parser.add_argument(
        "--held-out", action="store_true", help="learn twice, first without every fifth room, and judge on these"
    )
    parser.add_argument("--judge", type=Path, help="folder of labelled scans; nothing is learned")
    arguments = parser.parse_args()
    if arguments.evaluate:
        for rate_hz in arguments.rates or [None]:
            _evaluate(range(arguments.evaluate[0], arguments.evaluate[1] + 1), rate_hz)
    elif arguments.existence:
        _learn_existence(arguments.samples, range(arguments.drives[0], arguments.drives[1] + 1))
    elif arguments.judge is None:
        arguments.samples.mkdir(parents=True, exist_ok=True)
        seeds = range(arguments.seeds[0], arguments.seeds[1] + 1)
        parts = [_kept(arguments.samples / f"{seed}.npz", seed) for seed in seeds]
        print(f"{len(parts)} rooms, {sum(len(part.is_leg) for part in parts)} clusters")
        if arguments.held_out:
            held = [part for place, part in enumerate(parts) if place % _HELD_OUT == 0]
            others = [part for place, part in enumerate(parts) if place % _HELD_OUT]
            print(f"held-out rooms: AUC {_auc(_learned(others), held):.4f}")
        write_forests(vars(_learned(parts)), arguments.out, made_by(seeds))
        print(f"{arguments.out}: {arguments.out.stat().st_size / 1000:.0f} kB")
    else:
        judge(read_classifier(arguments.out), arguments.judge)


def _evaluate(seeds: range, rate_hz: float | None) -> None:
    """Count errors among people, and where there are none."""
    at = "rates drawn" if rate_hz is None else f"{rate_hz:g} Hz"
    for people in (True, False):
        counts = DriveCounts()
        for seed in seeds:
            counts.add(counted(seed, people=people, rate_hz=rate_hz))
        false = f"{counts.false / counts.scans:.3f} false tracks a scan of {counts.scans}"
        if people:
            mota = 1 - (counts.misses + counts.false + counts.switches) / counts.people
            print(
                f"{at}, among people: MOTA {mota:.3f}, {counts.misses} misses and {counts.switches} switches of "
                f"{counts.people}; {false}",
                flush=True,
            )
        else:
            print(f"{at}, where there is no person: {false}", flush=True)


def _learn_existence(folder: Path, seeds: range) -> None:
    """Learn from the first drives with tracks that are never confirmed, then from these and all with tracks that are.

    The first ones stay: without them the forest leans on the existence of tracks beside more than real scans bear out.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _put_existence(Forest(np.zeros((1, 1), np.intp), np.full((1, 1), NEVER), np.full((1, 2), -4.0), 0.0))
    first = [(seed, _kept_tracks(folder, "never", seed)) for seed in seeds[: len(seeds) // _FIRST]]
    _put_existence(_existence([part for _, part in first]))
    parts = first + [(seed, _kept_tracks(folder, "drive", seed)) for seed in seeds]
    features, is_person = _joined([part for seed, part in parts[len(first) :] if seed % _HELD_OUT == 0])
    score = _existence([part for seed, part in parts if seed % _HELD_OUT]).score(features)
    wrong = ((score > 0) != is_person).sum() / is_person.sum()
    print(
        f"{len(seeds)} rooms; held-out rooms: AUC of tracks {roc_auc_score(is_person, score):.4f}, {wrong:.3f} wrong a person"
    )
    _put_existence(_existence([part for _, part in parts]), made_by(seeds, "--existence --drives"))


def made_by(seeds: range, option: str = "--seeds") -> str:
    """Return the command that makes the same file again."""
    return f"scripts/learn-legs {option} {seeds[0]} {seeds[-1]}"


def _put_existence(forest: Forest, command: str = "") -> None:
    """Write it, and have trackers read it anew."""
    write_forests({"existence": forest}, EXISTENCE, command)
    read_forest.cache_clear()


def _existence(parts: list[TrackSamples]) -> Forest:
    return _forest(*_joined(parts), balanced=False, trees=_TRACK_TREES)


def _joined(parts: list[TrackSamples]) -> tuple[Array, NDArray[np.bool_]]:
    return np.concatenate([part.features for part in parts]), np.concatenate([part.is_person for part in parts])


def _kept_tracks(folder: Path, kind: str, seed: int) -> TrackSamples:
    path = folder / f"{kind}-{seed}.npz"
    if not path.is_file():
        print(f"drive {seed}", flush=True)
        np.savez(path, **vars(track_samples(seed)))
    with np.load(path) as kept:
        return TrackSamples(**{name: kept[name] for name in kept.files})


def _kept(path: Path, seed: int) -> Samples:
    """The samples of a seed; drawn where they are not kept yet."""
    if not path.is_file():
        print(f"seed {seed}", flush=True)
        drawn = samples_of(seed)
        np.savez(path, **vars(drawn))
    with np.load(path) as kept:
        return Samples(**{name: kept[name] for name in kept.files})


def _learned(parts: list[Samples]) -> LegClassifier:
    """Learn both forests; the second from verdicts of first ones that have not learned from the same rooms."""
    verdicts: dict[int, list[Array]] = {}
    for fold in range(_FOLDS):
        alone = _forest(np.concatenate([each.features for each in _without(parts, fold)]),
                        np.concatenate([each.is_leg for each in _without(parts, fold)]))  # fmt: skip
        for place in range(fold, len(parts), _FOLDS):
            verdicts[place] = _verdicts(alone, parts[place])
    labels = np.concatenate([part.is_leg for part in parts])
    among = _forest(np.concatenate([each for place in range(len(parts)) for each in verdicts[place]]), labels)
    return LegClassifier(_forest(np.concatenate([part.features for part in parts]), labels), among)


def _without(parts: list[Samples], fold: int) -> list[Samples]:
    return [part for place, part in enumerate(parts) if place % _FOLDS != fold]


def _verdicts(alone: Forest, part: Samples) -> list[Array]:
    """The features of the second forest, scan by scan."""
    score = alone.score(part.features)
    edges = np.flatnonzero(np.diff(part.scan)) + 1
    return [
        with_verdicts(part.features[scan], score[scan], part.middle[scan])
        for scan in np.split(np.arange(len(score)), edges)
    ]


def _forest(features: Array, is_leg: NDArray[np.bool_], *, balanced: bool = True, trees: int = _TREES) -> Forest:
    """Boost trees; balanced: legs and the rest count alike, so that the odds are a ratio of likelihoods."""
    share = is_leg.mean()
    fitted = HistGradientBoostingClassifier(
        max_iter=trees, max_depth=_DEPTH, max_leaf_nodes=16, min_samples_leaf=150, learning_rate=0.1, l2_regularization=20,
        max_features=0.3, early_stopping=False, random_state=0,  # pyright: ignore[reportArgumentType]
    ).fit(features, is_leg, np.where(is_leg, 0.5 / share, 0.5 / (1 - share)) if balanced else None)  # fmt: skip
    return complete_trees(fitted, _DEPTH)


def _auc(classifier: LegClassifier, parts: list[Samples]) -> float:
    scores = [classifier.among.score(each) for part in parts for each in _verdicts(classifier.alone, part)]
    return float(roc_auc_score(np.concatenate([part.is_leg for part in parts]), np.concatenate(scores)))


if __name__ == "__main__":
    main()
