"""Gallery: everything that is shipped, each with a picture, a line and its YAML.

Pictures are drawn into out/gallery by `scripts/docs`, each under a name with the digest of what it shows, so that only
what changed is drawn again. A page without them says how to draw them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from documentation.notebook import FOLDER as NOTEBOOK_FOLDER, NOTEBOOKS, outputs_of
from twin import models

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "out" / "gallery"
DRAWN_SEED, DRAWN_COUNT = 1000, 24
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("*.py"))
TILE_PX = (420, 315)

_SENSORS: Mapping[str, dict[str, Any]] = {
    "laser": {"kind": "laser", "role": "waist", "rate_hz": 10, "mount": {"xyz": [-2.3, -1.9, 0.95], "yaw_deg": 40}},
    "fisheye": {"kind": "fisheye", "rate_hz": 10, "mount": {"xyz": [-2.3, -1.9, 1.05], "yaw_deg": 40}},
    "camera": {
        "kind": "camera", "rate_hz": 10, "size": [640, 480], "vertical_field_of_view_deg": 66,
        "mount": {"xyz": [2.35, 1.95, 2.4], "yaw_deg": -140, "pitch_deg": 27},
    },
    "stereo": {
        "kind": "stereo", "rate_hz": 5, "size": [640, 480], "vertical_field_of_view_deg": 66, "baseline_m": 0.12,
        "mode": "matched", "mount": {"xyz": [2.35, -1.95, 2.4], "yaw_deg": 140, "pitch_deg": 27},
    },
    "floor": {"kind": "floor", "rate_hz": 10},
}  # fmt: skip
"""A sensor of each kind in the home."""

_FAULTS: Mapping[str, dict[str, Any]] = {
    "dropout": {"sensor": "waist", "kind": "dropout", "from_s": 4},
    "freeze": {"sensor": "waist", "kind": "freeze", "from_s": 4},
    "delay": {"sensor": "waist", "kind": "delay", "delay_s": 0.3, "jitter_s": 0.1, "from_s": 4},
    "clock": {"sensor": "waist", "kind": "clock", "offset_s": 0.2, "drift_ppm": 200, "from_s": 4},
    "occlusion": {"sensor": "fisheye", "kind": "occlusion", "at": [0.38, 0.55], "size": 0.35, "from_s": 4},
    "blocked_sector": {
        "sensor": "waist",
        "kind": "blocked_sector",
        "bearings_deg": [25, 55],
        "at_m": 0.15,
        "from_s": 4,
    },
    "dead_beams": {"sensor": "waist", "kind": "dead_beams", "beams": [[100, 160]], "from_s": 4},
    "dead_cells": {"sensor": "floor", "kind": "dead_cells", "share": 0.1, "from_s": 4},
}
"""A fault of each kind, in the home from 4 s on."""


def _home(sensors: Mapping[str, Any], faults: Mapping[str, Any] | None = None) -> dict[str, Any]:
    left_out = {name: None for name in ("waist", "knee", "fisheye", "floor") if name not in sensors}
    return {
        "extends": "home-three-people", "name": "shown", "duration_s": 12, "trackers": {"laser-fisheye-imm": None},
        "sensors": {**left_out, **{name: each for name, each in sensors.items() if each}}, "faults": dict(faults or {}),
    }  # fmt: skip


def shown() -> Iterator[tuple[str, str, str, str, str]]:
    """Yield page, name, line, YAML as shown and YAML as drawn of every picture but the sheet of drawn rooms."""
    for name in models.names("scenarios"):
        text = (models.MODELS / "scenarios" / f"{name}.yaml").read_text(encoding="utf-8")
        yield "scenarios", name, models.first_description("scenarios", name), text, text
    for name in models.names("rooms"):
        text = (models.MODELS / "rooms" / f"{name}.xml").read_text(encoding="utf-8")
        yield "rooms", name, _first_comment(text), f"room: {name}\n", text
    for kind, sensor in _SENSORS.items():
        text = yaml.safe_dump({"sensors": {kind: sensor}}, sort_keys=False, default_flow_style=None)
        yield "sensors", kind, models.SENSOR_KINDS[kind], text, yaml.safe_dump(_home({kind: sensor}))
    for kind, fault in _FAULTS.items():
        text = yaml.safe_dump({"faults": {"shown": fault}}, sort_keys=False, default_flow_style=None)
        drawn = yaml.safe_dump(_home({fault["sensor"]: None}, {"shown": fault}))
        yield "sensors", f"fault: {kind}", models.FAULTS[kind], text, drawn
    for name in models.names("studies"):
        text = (models.MODELS / "studies" / f"{name}.yaml").read_text(encoding="utf-8")
        yield "studies", name, models.first_description("studies", name), text, text


def _first_comment(xml: str) -> str:
    comment = xml.partition("<!--")[2].partition("-->")[0]
    return " ".join(comment.split()).partition(". ")[0] + "."


def picture_path(page: str, name: str, drawn: str) -> Path:
    """Return where the picture of an entry is drawn; its name holds the digest of what is drawn."""
    digest = hashlib.sha256(f"{page} {name}\n{drawn}".encode()).hexdigest()[:10]
    return FOLDER / page / f"{name.replace('fault: ', 'fault-')}-{digest}.webp"


def sheet_path() -> Path:
    """Return where the sheet of drawn rooms is drawn."""
    return picture_path("drawn", "rooms", (models.MODELS / "scenarios" / "drawn.yaml").read_text(encoding="utf-8"))


def example_path(script: Path) -> Path:
    """Return where the picture of an example is."""
    return FOLDER / "examples" / f"{script.stem}.png"


def pictures() -> dict[str, Path]:
    """Return every picture that has been drawn, by its path in the pages."""
    paths = [picture_path(page, name, drawn) for page, name, _, _, drawn in shown()]
    paths += [sheet_path(), *(example_path(script) for script in EXAMPLES)]
    paths += [
        NOTEBOOK_FOLDER / own["picture"] for each in NOTEBOOKS for own in outputs_of(each).values() if "picture" in own
    ]
    return {f"gallery/pictures/{path.parent.name}/{path.name}": path for path in paths if path.is_file()}


def _image(path: Path, said: str) -> str:
    if path.is_file():
        return f"![{said}](pictures/{path.parent.name}/{path.name})"
    return "*No picture has been drawn: `scripts/docs` without `--no-gallery` draws all.*"


_INTRODUCTIONS = {
    "scenarios": (
        "Scenarios",
        "`twin run NAME` runs one, `extends: NAME` starts from one. Each is shown in the middle of its time.",
    ),
    "rooms": (
        "Rooms",
        "A room is an MJCF file; [MJCF in rooms](../mjcf.md) lists the elements. `room: NAME` puts one into a scenario, "
        "`twin view NAME` draws it.",
    ),
    "sensors": (
        "Sensors and faults",
        "A sensor of each kind in the home, and a fault of each kind from its fourth second on, shown at 6 s.",
    ),
    "studies": ("Studies", "`twin study run NAME` searches a placement. Arrows are the poses that it chooses from."),
}


def pages() -> dict[str, str]:
    """Make the pages of the gallery, by path."""
    made = {}
    entries = list(shown())
    for page, (title, introduction) in _INTRODUCTIONS.items():
        lines = [f"# {title}", "", introduction, ""]
        for _, name, line, text, drawn in (each for each in entries if each[0] == page):
            lines += [f"## {name}", "", _escaped(line), "", _image(picture_path(page, name, drawn), name), ""]
            if page == "rooms":
                lines += ["```yaml", text.rstrip(), "```", ""]
            else:
                lines += [
                    '??? example "YAML"',
                    "",
                    "    ```yaml",
                    *(f"    {row}" for row in text.rstrip().splitlines()),
                    "    ```",
                    "",
                ]
        made[f"gallery/{page}.md"] = "\n".join(lines)
    made["gallery/drawn.md"] = _drawn_page()
    made["tutorials/examples.md"] = _examples_page()
    return made


def _drawn_page() -> str:
    text = (models.MODELS / "scenarios" / "drawn.yaml").read_text(encoding="utf-8").rstrip()
    last = DRAWN_SEED + DRAWN_COUNT - 1
    return "\n".join(
        ["# Drawn rooms", "", f"The scenario `drawn` under {DRAWN_COUNT} seeds, {DRAWN_SEED} to {last}.",
         "Each runs by its seed, as plain files too:", "",
         f"    twin run drawn --seed {DRAWN_SEED} --tracker laser-imm",
         f"    twin new scenario --drawn --seed {DRAWN_SEED} --out office", "",
         _image(sheet_path(), f"{DRAWN_COUNT} drawn rooms"), "", "```yaml", text, "```", ""]
    )  # fmt: skip


def _examples_page() -> str:
    lines = [
        "# Examples",
        "",
        "Each file of `docs/examples/` runs by itself: `python docs/examples/01-….py`. It writes one picture.",
        "",
    ]
    for script in EXAMPLES:
        code = script.read_text(encoding="utf-8")
        title = code.partition('"""')[2].partition('"""')[0].splitlines()[0].rstrip(".")
        image = _image(example_path(script), title).replace("](pictures", "](../gallery/pictures")
        lines += [
            f"## {script.stem[:2]} {title}",
            "",
            image,
            "",
            f'```python title="docs/examples/{script.name}"',
            code.rstrip(),
            "```",
            "",
        ]
    return "\n".join(lines)


def _escaped(text: str) -> str:
    return text.replace("<", "&lt;")
