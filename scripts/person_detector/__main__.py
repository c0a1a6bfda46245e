"""Learn people's silhouettes: recorded by the twin, learned by scikit-learn, written as plain arrays.

    scripts/train-person-detector [halls|rooms] [--recordings FOLDER] [--out FILE]

Every place of the floor with some foreground in its window is a sample, so that the model is learned on the very windows that it
is asked about. It prints what it finds in a recording that it was not fitted to. The same recordings make the same file.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from person_detector.found import found
from person_detector.samples import Samples, Scene, samples_of, scenes
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor

from trackers.vision.person_detector import INPUTS, ROOMS, SHIPPED, Network, PersonModel
from twin.run.live import run_scenario
from twin.scenario import load_scenario

_HALL = ("sensors.camera.rate_hz=2", "sensors.west=null", "sensors.east=null")
_FROM_ABOVE = (
    *_HALL,
    "sensors.camera.mount={xyz: [0, -1, 8], yaw_deg: 90, pitch_deg: 85}",
    "sensors.camera.vertical_field_of_view_deg=95",
)
_ROOMS = (
    "sensors={kind: drawn, scanners: [0, 0], fisheyes: [1, 1], fisheye_px: [320, 320], cameras: [2, 2], camera_px: [320, 240], "
    "camera_hz: [2, 3], stereos: [0, 0], floor: 0}",
)
_HOME = tuple(f"sensors.camera_{number}.rate_hz=2" for number in range(1, 5))
_OF_HALLS = (
    *(("hall", seed, "library-hall", 70, _HALL) for seed in range(1100, 1107)),
    *(("over", seed, "library-hall", 25, _FROM_ABOVE) for seed in range(1110, 1113)),
    *(("home", seed, "home-cameras", 12, _HOME) for seed in range(1200, 1202)),
)
"""Name, seed, scenario, duration [s] and overrides of each recording; seeds 1000 to 1999 are for learning."""
_HALLS_HELD_OUT = (("hall", 1107, "library-hall", 40, _HALL), ("over", 1113, "library-hall", 25, _FROM_ABOVE))


@dataclass(frozen=True)
class Plan:
    """Recordings to learn from and those held out, the file, units of a network, passes, batch, and share of far windows."""

    learned: tuple[tuple[str, int, str, int, tuple[str, ...]], ...]
    held_out: tuple[tuple[str, int, str, int, tuple[str, ...]], ...]
    shipped: Path
    hidden: int
    passes: int
    batch: int
    of_far: int  # of windows far from everybody, which are most of them and alike, one in so many is learned from


PLANS = {
    "halls": Plan(_OF_HALLS, _HALLS_HELD_OUT, SHIPPED, 32, 20, 256, 1),
    "rooms": Plan(
        (*_OF_HALLS, *(("rooms", seed, "drawn", 12, _ROOMS) for seed in range(1300, 1332))),
        (*_HALLS_HELD_OUT, *(("rooms", seed, "drawn", 12, _ROOMS) for seed in range(1340, 1346))),
        *(ROOMS, 48, 10, 512, 4),
    ),
}
_HEAT_M = 0.15
_NEAR_M = 0.4
"""A person nearer than this to a window's place is the one that it means."""
_ABOUT_M = 1.0
"""A window farther than this from everybody is far."""


def main() -> None:
    """Record what is not recorded yet, learn, print what is found, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=Path, default=Path("out/person-detector"), help="kept here, and taken up")
    parser.add_argument("plan", choices=PLANS, nargs="?", default="halls", help="the model to learn")
    parser.add_argument("--out", type=Path, help="default: the shipped file")
    arguments = parser.parse_args()
    plan: Plan = PLANS[arguments.plan]
    out: Path = arguments.out or plan.shipped
    cv2.setNumThreads(1)
    untaught = PersonModel(*(_silent(outputs) for outputs in (1, 2)), np.ones(2))
    learned = Samples.joined([samples_of(scene, untaught) for scene in _scenes(plan.learned, arguments.recordings)])
    print(f"{len(learned.inputs)} windows, {int((learned.distance_m < _NEAR_M).sum())} of them near somebody")
    kept = learned.distance_m < _ABOUT_M
    kept[np.flatnonzero(~kept)[:: plan.of_far]] = True
    nearness = _fitted(plan, learned, kept, np.exp(-0.5 * (learned.distance_m / _HEAT_M) ** 2))
    offset = _fitted(plan, learned, learned.distance_m < _NEAR_M, learned.offset_m)
    held_out = list(_scenes(plan.held_out, arguments.recordings))
    windows = Samples.joined([samples_of(scene, untaught) for scene in held_out])
    near = windows.distance_m < _NEAR_M
    deviation_m = (offset(windows.inputs[near]) - windows.offset_m[near]).std(axis=0)
    model = PersonModel(nearness, offset, deviation_m.astype(float))
    for scene in held_out:
        recall, precision, error_m = found(scene, model)
        print(f"{scene.name}: recall {recall:.3f}, precision {precision:.3f}, off by {error_m:.3f} m on average")
    model.save(out)
    print(f"{out}: {out.stat().st_size / 1000:.0f} kB, deviations {deviation_m.round(3).tolist()} m")


def _scenes(plan: Sequence[tuple[str, int, str, int, tuple[str, ...]]], folder: Path) -> Iterator[Scene]:
    for name, seed, scenario_name, duration_s, changes in plan:
        out = folder / f"{name}-{seed}"
        if not (out / "recording.mcap").is_file():
            print(f"recording {out}", flush=True)
            scenario = load_scenario(scenario_name, [f"seed={seed}", f"duration_s={duration_s}", *changes])
            run_scenario(scenario, trackers=(), out=out, video=False)
        yield from scenes(out)


def _fitted(plan: Plan, samples: Samples, which: np.ndarray, targets: np.ndarray) -> Network:
    """A network fitted to samples and to their mirror images."""
    inputs, targets = samples.inputs[which], np.atleast_2d(targets.T).T[which]
    mirrored = targets * [-1, 1] if targets.shape[1] == 2 else targets
    regressor = MLPRegressor(
        hidden_layer_sizes=(plan.hidden,),
        alpha=1e-3,
        learning_rate_init=2e-3,
        max_iter=plan.passes,
        n_iter_no_change=20,
        batch_size=plan.batch,
        random_state=0,
    )
    whole = np.concatenate([inputs, samples.mirrored()[which]])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # so many passes are meant
        regressor.fit(whole, np.squeeze(np.concatenate([targets, mirrored])).astype(np.float32))
    parts = [each for pair in zip(regressor.coefs_, regressor.intercepts_, strict=True) for each in pair]
    return Network(*(np.asarray(part, np.float32) for part in parts))


def _silent(outputs: int) -> Network:
    return Network(*(np.zeros(shape, np.float32) for shape in ((INPUTS, 1), (1,), (1, outputs), (outputs,))))


if __name__ == "__main__":
    main()
