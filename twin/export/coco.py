"""COCO: the labelled pictures of all cameras, with boxes, masks and keypoints of people, in one `annotations.json`.

Pictures are in `images/SEQUENCE/CAMERA/`. Boxes are those of a person's visible pixels, pixel (0, 0) spanning 0 to 1. Masks are
uncompressed run lengths, column by column, from a run of 0. Besides COCO's fields an image has `sequence`, `camera`, `frame`
(the picture's number) and `t` [s]; an annotation has `track_id`, `visibility` (share that rays from the camera reach, null:
unknown) and `truncated`. Source: Lin et al., Microsoft COCO, ECCV 2014; https://cocodataset.org/#format-data.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from twin.export.labels import Label, Labeller, open_labeller
from twin.export.pictures import Recorded

_COPIED_BYTES = 1 << 20


def export_coco(recordings: Sequence[Recorded], out: Path, *, simulate: bool = True, hz: float | None = None) -> None:
    """Write pictures and `annotations.json`; `simulate`, `hz`: see `open_labeller`.

    Raises InputError where no recording has both a camera and truth, and where some can be simulated again and others not.
    """
    usable = [each for each in recordings if each.recording.rig.cameras() and each.has_truth]
    for each in recordings:
        if each not in usable:
            each.on_warning(f"{each.title}: has no camera or no truth: left out; --truth FILE.csv gives a truth")
    if not usable:
        raise InputError("--format coco: no recording has a camera and truth; one whose people are known is expected")
    with ExitStack() as stack:
        images, annotations = (_JsonList(stack) for _ in range(2))
        names, skeleton = set(), ()
        for recorded in usable:
            with ExitStack() as opened:
                labeller = open_labeller(opened, recorded, simulate=simulate, hz=hz)
                assert labeller is not None
                names.add(labeller.keypoints)
                skeleton = labeller.skeleton
                _add_pictures(recorded, labeller, out, images, annotations)
        if len(names) > 1:
            raise InputError("--format coco: not every recording can be simulated again; --labels bag is expected")
        (keypoints,) = names
        category = {"id": 1, "name": "person", "supercategory": "person"}
        category |= {"keypoints": list(keypoints), "skeleton": [list(each) for each in skeleton]}
        with (out / "annotations.json").open("w", encoding="utf-8") as stream:
            info = {"description": "exported by roomtwin", "sequences": [each.name for each in usable]}
            stream.write(
                f'{{"info": {json.dumps(info)}, "licenses": [], "categories": {json.dumps([category])},\n"images": '
            )
            images.copy_to(stream)
            stream.write(',\n"annotations": ')
            annotations.copy_to(stream)
            stream.write("}\n")


class _JsonList:
    """List that grows in a temporary file."""

    def __init__(self, stack: ExitStack) -> None:
        self._stream = stack.enter_context(tempfile.TemporaryFile("w+", encoding="utf-8"))  # noqa: SIM115
        self.count = 0

    def add(self, entry: dict[str, Any]) -> None:
        self._stream.write(("[" if self.count == 0 else ",\n") + json.dumps(entry, allow_nan=False))
        self.count += 1

    def copy_to(self, target: TextIO) -> None:
        self._stream.seek(0)
        target.write("" if self.count else "[")
        while text := self._stream.read(_COPIED_BYTES):
            target.write(text)
        target.write("]")


def _add_pictures(recorded: Recorded, labeller: Labeller, out: Path, images: _JsonList, annotations: _JsonList) -> None:
    cameras, before = recorded.recording.rig.cameras(), images.count
    for name in cameras:
        (out / "images" / recorded.name / name).mkdir(parents=True)
    for each in labeller.labelled(cameras):
        picture, lens = each.picture, cameras[each.picture.camera].intrinsics
        file = picture.save(out / "images" / recorded.name / picture.camera)
        image_id = images.count + 1
        images.add(
            {
                "id": image_id,
                "file_name": f"{recorded.name}/{picture.camera}/{file}",
                "width": lens.width,
                "height": lens.height,
                "sequence": recorded.name,
                "camera": picture.camera,
                "frame": picture.number,
                "t": picture.stamp_ns / NS_PER_S,
            }
        )
        for label in each.labels:
            annotations.add({"id": annotations.count + 1, "image_id": image_id, **_annotation(label)})
    if images.count == before:
        recorded.on_warning(f"{recorded.title}: no picture has labels; --labels-hz labels any")


def _annotation(label: Label) -> dict[str, Any]:
    box, points = label.box, label.keypoints
    places = np.where(points[:, 2:] > 0, points[:, :2] + 0.5, 0.0).round(2)  # pixel (0, 0) spans 0 to 1
    flagged = [
        value
        for (u, v), flag in zip(places.tolist(), points[:, 2].astype(int).tolist(), strict=True)
        for value in (u, v, flag)
    ]
    annotation = {
        "category_id": 1,
        "track_id": box.id,
        "bbox": [box.left, box.top, box.width, box.height],
        "area": box.visible_px,
        "iscrowd": 0,
        "visibility": None if np.isnan(label.visible) else round(label.visible, 4),
        "truncated": int(box.truncated),
        "num_keypoints": int((points[:, 2] > 0).sum()),
        "keypoints": flagged,
    }
    return annotation if label.mask is None else annotation | {"segmentation": run_lengths(label.mask)}


def run_lengths(mask: NDArray[np.bool_]) -> dict[str, list[int]]:
    """Encode a mask (height, width) as COCO's uncompressed run lengths: size, and counts column by column from a run of 0."""
    flat = mask.T.ravel()
    edges = np.flatnonzero(np.diff(flat)) + 1
    counts = np.diff(np.concatenate([[0], edges, [flat.size]])).tolist()
    return {"size": list(mask.shape), "counts": [0, *counts] if flat[0] else counts}
