"""The pictures at the top of the README: one time through every sensor, and a few seconds of tracking.

    scripts/pictures [--out FOLDER]

Both are made by what anybody can call: the first is `twin view`, the second the preview video of `twin run`, cut and
made smaller. The same renderer draws the same pictures.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

import twin
from twin.recording.atomic_file import atomic_path
from twin.view.contact_sheet import drawn_view

FOLDER = Path(__file__).parent

# One time: three people at home before every kind of sensor; two of them hang in the corners of the ceiling.
SHOWN_SCENARIO, SHOWN_S = "home-three-people", 27.0
_IN_A_CORNER = "rate_hz: 10, size: [640, 480], noise: default"
SHOWN_CHANGES = (
    "sensors.fisheye.size=[640, 640]",
    f"sensors.camera={{kind: camera, vertical_field_of_view_deg: 66, {_IN_A_CORNER}, "
    "mount: {xyz: [2.35, 1.95, 2.4], yaw_deg: -140, pitch_deg: 27}}",
    f"sensors.stereo={{kind: stereo, baseline_m: 0.12, mode: matched, vertical_field_of_view_deg: 66, {_IN_A_CORNER}, "
    "mount: {xyz: [2.35, -1.95, 2.4], yaw_deg: 140, pitch_deg: 27}}",
)
TILE_PX = (420, 315)

# A few seconds: five people in the lab, crossing behind each other.
WALK_SCENARIO, WALK_TRACKER = "lab-five-people", "laser-fisheye-imm"
WALK_FROM_S, WALK_TO_S = 8.0, 13.0
WALK_PX = (896, 448)


def draw_sensors(path: Path) -> None:
    """Write the picture of one time through every sensor, as `twin view` draws it."""
    rgb, _ = drawn_view(twin.load_scenario(SHOWN_SCENARIO, list(SHOWN_CHANGES)), SHOWN_S, TILE_PX)
    _, webp = cv2.imencode(".webp", rgb[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, 88])
    _write(path, webp)


def draw_walk(path: Path) -> None:
    """Write the animation of people walking, with their tracks and the truth: part of a run's preview video."""
    scenario = twin.load_scenario(WALK_SCENARIO, [f"duration_s={WALK_TO_S + 0.2}"])
    with tempfile.TemporaryDirectory() as folder:
        run = twin.run_scenario(scenario, trackers=[WALK_TRACKER], out=Path(folder) / "run")
        frames = _cut(run.files["preview"], WALK_FROM_S, WALK_TO_S)
    animation = cv2.Animation()
    animation.frames = [rgb[..., ::-1] for _, rgb in frames]
    stamps_ms = np.array([1000 * t for t, _ in frames])
    animation.durations = np.diff(stamps_ms, append=2 * stamps_ms[-1] - stamps_ms[-2]).round().astype(int)
    _, webp = cv2.imencodeanimation(".webp", animation, [cv2.IMWRITE_WEBP_QUALITY, 60])
    _write(path, webp)


def _cut(video: Path, start_s: float, end_s: float) -> list[tuple[float, NDArray[np.uint8]]]:
    """The pictures (height, width, 3), RGB, of a video from one time to another, each with its time [s], made smaller."""
    with av.open(str(video)) as container:
        return [
            (
                picture.time,
                np.asarray(cv2.resize(picture.to_ndarray(format="rgb24"), WALK_PX, interpolation=cv2.INTER_AREA)),
            )
            for picture in container.decode(video=0)
            if picture.time is not None and start_s <= picture.time < end_s
        ]


def _write(path: Path, content: NDArray[np.uint8]) -> None:
    with atomic_path(path) as partial:
        partial.write_bytes(content.tobytes())
    print(f"{path}: {len(content) / 1e3:.0f} kB")


def main() -> None:
    """Draw both."""
    parser = argparse.ArgumentParser(prog="scripts/pictures", description="Draws the pictures of the README anew.")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder to write moment.webp and walk.webp into")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    draw_sensors(out / "moment.webp")
    draw_walk(out / "walk.webp")


if __name__ == "__main__":
    sys.exit(main())
