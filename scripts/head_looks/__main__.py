"""Learn the appearance of heads: recorded by the twin, counted, written as plain arrays.

    scripts/learn-heads [--recordings FOLDER] [--out FILE] [--real FILE] [--picture FILE]

Learned are the region of skin in hue and saturation; the chance that a cell of the head is face; and how often each colour
is face, and hair, among people. `--real` is an .npz of real colours, `rgb` (n, 3) and `skin` (n,), on which the region is
judged; nothing is learned from it. The same recordings make the same file.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from head_looks.samples import PAINT, Head, heads
from numpy.typing import NDArray
from scipy import ndimage

from trackers.vision.head_colours import COLOURS, HUES, SATURATIONS, SHIPPED, STEPS
from trackers.vision.head_outlines import CELLS
from twin.run.live import run_scenario
from twin.scenario import load_scenario

SEEDS = range(1101, 1113)
"""Seeds from 1000 to 1999 are there to be learned from."""
_CHANGES = tuple(
    f"sensors.stereo_{number}.{change}"
    for number in range(1, 5)
    for change in ("mode=ideal", "rate_hz=1.5", "phase_s=0")
)
_DIMMED = "lights=[{at_s: 0, name: all, brightness: 0.6}]"
"""Every third recording is in less light."""
_KEPT = 0.98
"""The region holds this share of what is learned: the rest is lips and what shines."""
_ANYTHING = 0.05


def main() -> None:
    """Record what is not recorded yet, count, print what holds, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=Path, default=Path("out/heads"), help="kept here, and taken up")
    parser.add_argument("--out", type=Path, default=SHIPPED)
    parser.add_argument("--real", type=Path, help="real colours to judge the region of skin on")
    parser.add_argument("--picture", type=Path, help="where to draw the region of skin")
    arguments = parser.parse_args()
    seen = [head for seed in SEEDS for head in heads(*(_recorded(arguments.recordings, seed, kind) for kind in (0, 1)))]
    print(f"{len(seen)} heads")
    face, hair = (
        _counted(seen, name, lambda head: head.cell, CELLS[0] * CELLS[1]).reshape(CELLS) for name in ("face", "hair")
    )
    face, hair = face + face[::-1], hair + hair[::-1]  # people are alike on both sides
    common = np.stack([_colours(seen, name) for name in ("face", "hair")])
    region = _region(seen)
    np.savez_compressed(
        arguments.out,
        skin=region,
        share=(face / np.maximum(face + hair, 1)).ravel().astype(np.float32),
        common=common.astype(np.float32),
    )
    print(f"{arguments.out}: {arguments.out.stat().st_size / 1000:.0f} kB, skin is {region.mean():.1%} of the plane")
    real = None if arguments.real is None else np.load(arguments.real, allow_pickle=False)
    if real is not None:
        is_skin = region[tuple(_hue_saturation(real["rgb"]).T)]
        print(
            f"real colours: recall {is_skin[real['skin']].mean():.3f}, false share {is_skin[~real['skin']].mean():.3f}"
        )
    if arguments.picture is not None:
        cv2.imwrite(str(arguments.picture), _drawn(region, None if real is None else real["rgb"][real["skin"]]))


def _recorded(folder: Path, seed: int, painted: int) -> Path:
    """The folder of one recording; made where it is not there yet."""
    out = folder / f"{seed}{'-painted' if painted else ''}"
    if not (out / "recording.mcap").is_file():
        print(f"recording {out}", flush=True)
        changes = [f"seed={seed}", "duration_s=12", *_CHANGES, *([_DIMMED] if seed % 3 == 0 else [])]
        if painted:
            people = load_scenario("meeting-three-people").people
            changes += [f'people.{name}.{part}="{colour}"' for name in people for part, colour in PAINT.items()]
        run_scenario(load_scenario("meeting-three-people", changes), trackers=(), out=out, video=False)
    return out


def _counted(seen: list[Head], which: str, what, size: int) -> NDArray[np.float64]:
    return np.sum([np.bincount(what(head)[getattr(head, which)], minlength=size) for head in seen], axis=0)


def _colours(seen: list[Head], which: str) -> NDArray[np.float64]:
    """Estimate the smoothed frequency of each part per colour; no colour is impossible."""
    counts = ndimage.gaussian_filter(
        _counted(seen, which, lambda head: head.colour, COLOURS).reshape(STEPS), (1.5, 0.7, 0.7)
    )
    return (1 - _ANYTHING) * counts.ravel() / counts.sum() + _ANYTHING / COLOURS


def _region(seen: list[Head]) -> NDArray[np.bool_]:
    """The densest part of the plane of hue and saturation that holds `_KEPT` of the faces."""
    plane = _counted(seen, "face", lambda head: head.hue_saturation @ [SATURATIONS, 1], HUES * SATURATIONS).reshape(
        HUES, SATURATIONS
    )
    plane = ndimage.gaussian_filter1d(plane.astype(float), 2, axis=0, mode="wrap")  # hue goes around
    plane = ndimage.gaussian_filter1d(plane, 8, axis=1, mode="nearest")
    densest = np.sort(plane.ravel())[::-1]
    return plane > densest[np.searchsorted(np.cumsum(densest) / densest.sum(), _KEPT)]


def _hue_saturation(rgb: NDArray[np.uint8]) -> NDArray[np.intp]:
    return cv2.cvtColor(rgb[None], cv2.COLOR_RGB2HSV)[0, :, :2].astype(np.intp)


def _drawn(region: NDArray[np.bool_], real: NDArray[np.uint8] | None) -> NDArray[np.uint8]:
    """The plane in its colours, dim outside the region, and real skin as dots; 4 pixels a step of hue."""
    hue, saturation = np.mgrid[:HUES, :SATURATIONS]
    value = np.where(region, 230, 90)
    plane = cv2.cvtColor(np.stack([hue, saturation, value], axis=-1).astype(np.uint8), cv2.COLOR_HSV2BGR)
    if real is not None:
        plane[tuple(_hue_saturation(real).T)] = 255
    return np.asarray(cv2.resize(plane, None, fx=3, fy=4, interpolation=cv2.INTER_NEAREST), np.uint8)


if __name__ == "__main__":
    main()
