"""Draw the pictures of the gallery that are missing, for `scripts/docs`."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from documentation.gallery import (
    DRAWN_COUNT,
    DRAWN_SEED,
    EXAMPLES,
    FOLDER,
    ROOT,
    TILE_PX,
    example_path,
    picture_path,
    sheet_path,
    shown,
)
from documentation.notebook import NOTEBOOKS, output_path, run_notebook
from twin.models import MODELS
from twin.recording.atomic_file import atomic_path


def draw_all() -> None:
    """Draw every picture that is not there yet."""
    for page, name, _, _, drawn in shown():
        path = picture_path(page, name, drawn)
        if not path.is_file():
            print(f"drawing {path.relative_to(ROOT)}", file=sys.stderr)
            write_webp(path, _study(name) if page == "studies" else _scenario(page, name, drawn))
    if not sheet_path().is_file():
        write_webp(sheet_path(), _sheet())
    for notebook in NOTEBOOKS:
        if not output_path(notebook).is_file():
            run_notebook(notebook)
    for script in EXAMPLES:
        path = example_path(script)
        if not path.is_file() or path.stat().st_mtime < script.stat().st_mtime:
            path.parent.mkdir(parents=True, exist_ok=True)
            subprocess.run(
                [sys.executable, str(script), str(path)], check=True, env={**os.environ, "PYTHONPATH": str(ROOT)}
            )


def write_webp(path: Path, rgb: NDArray[np.uint8]) -> None:
    """Write a picture (height, width, 3), RGB, and remove older ones of the same entry."""
    for older in path.parent.glob(f"{path.stem.rpartition('-')[0]}-??????????.webp"):
        older.unlink()
    _, webp = cv2.imencode(".webp", rgb[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, 80])
    with atomic_path(path) as partial:
        partial.write_bytes(webp.tobytes())


def _scenario(page: str, name: str, drawn: str) -> NDArray[np.uint8]:
    from twin.scenario import load_scenario
    from twin.view import write_room
    from twin.view.contact_sheet import drawn_view

    if page == "scenarios":
        scenario = load_scenario(name)
        return drawn_view(scenario, round(scenario.duration_s / 2, 1), TILE_PX)[0]
    with tempfile.TemporaryDirectory() as folder:
        if page == "rooms":
            write_room(name, Path(folder) / "room.png")
            return _read_rgb(Path(folder) / "room.png")
        path = Path(folder) / "shown.yaml"
        path.write_text(drawn, encoding="utf-8")
        return drawn_view(load_scenario(path), 6.0, TILE_PX)[0]


def _sheet() -> NDArray[np.uint8]:
    from twin.view.contact_sheet import write_drawn

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drawn.png"
        write_drawn("drawn", [], range(DRAWN_SEED, DRAWN_SEED + DRAWN_COUNT), 5.0, path)
        return _read_rgb(path)


def _read_rgb(path: Path) -> NDArray[np.uint8]:
    return np.asarray(cv2.imread(str(path)), dtype=np.uint8)[..., ::-1]


def _study(name: str) -> NDArray[np.uint8]:
    """Draw the plan of a study's room with every candidate pose as an arrow."""
    import matplotlib as mpl
    import mujoco

    from twin.room.building import room_outline
    from twin.studies.preflight import prepare

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    study = prepare(MODELS / "studies" / f"{name}.yaml")
    building = study.candidate_set.building
    mujoco.mj_kinematics(building.model, building.data)
    figure, axes = plt.subplots(figsize=(8, 5), dpi=100, layout="compressed")
    for polygon in room_outline(building.model, building.data):
        axes.plot(*np.vstack([polygon, polygon[:1]]).T, color="0.6", linewidth=0.8)
    for number, (device, poses) in enumerate(_poses(study).items()):
        x, y, yaw = np.array(poses).T
        label, shorter = f"{device}: {len(x)} poses", 30 + 15 * number  # all show where they hang at the same places
        axes.quiver(x, y, np.cos(yaw), np.sin(yaw), color=f"C{number}", scale=shorter, width=0.003, label=label)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    figure.legend(loc="outside right upper", frameon=False)
    figure.canvas.draw()  # places the ticks,
    figure.canvas.draw()  # whose widths the layout then leaves room for
    rgb = np.asarray(figure.canvas.buffer_rgba())[..., :3].copy()  # pyright: ignore[reportAttributeAccessIssue]
    plt.close(figure)
    return rgb


def _poses(study) -> dict[str, list[tuple[float, float, float]]]:
    found: dict[str, list[tuple[float, float, float]]] = {}
    for pose in study.candidate_set.poses:
        mount = pose.mounts[0]
        found.setdefault(pose.device, []).append((*mount.xyz[:2], np.radians(getattr(mount, "yaw_deg", 0.0))))
    return found


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    draw_all()
