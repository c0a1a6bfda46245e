"""Labels of people in pictures: boxes, masks and keypoints, from the bag's truth or by simulating its scenario again.

The bag holds boxes of a few pictures a second of each camera. A scenario that is simulated again moves its people to the bit
as it did, so that every picture can have boxes, a mask of each person's pixels, and the 17 keypoints of COCO. The eye of the
simulation has no noise, delay or fault: labels are those of the picture's stamp.

A truth of the user's has positions alone: a box is that of an upright person, 0.5 m wide and up to 0.12 m above the head, else
1.7 m high, hidden or not; as in WILDTRACK (Chavdarova et al., CVPR 2018).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from math import nan

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Mask
from trackers.cameras.placed import PlacedCamera
from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.rig import CameraSensor, placed_camera
from twin.export.pictures import ExportedPicture, Recorded, pictures
from twin.people.body.head import EYES
from twin.recording.bags.bag import open_bag
from twin.recording.ros import topics
from twin.recording.truth_tables import decode_boxes
from twin.truth.truth_types import Box, PersonTruth, TruthFrame
from twin.truth.visibility import person_boxes
from twin.world.scene import Scene
from twin.world.simulation import Simulation

_ELSEWHERE_M = 1e-3
"""Deviation of simulated people from the bag's truth beyond which their motion differs [m]."""
_TRUTH_WITHIN_NS = NS_PER_S // 1000
"""Greatest distance to a stamp of the truth, which exists at every stamp of every sensor."""
_TRUTH_WINDOW_NS = 3 * NS_PER_S
"""Greatest delay of a picture's stamp behind the latest one."""
_HEAD_TOP_M, _UPRIGHT_M, _WIDE_M = 0.12, 1.7, 0.5
_SIDES = ("left", "right")
KEYPOINTS = (
    "nose",
    *(
        f"{side}_{part}"
        for part in ("eye", "ear", "shoulder", "elbow", "wrist", "hip", "knee", "ankle")
        for side in _SIDES
    ),
)
"""COCO's keypoints of a person, in its order."""
SKELETON = (
    *((16, 14), (14, 12), (17, 15), (15, 13), (12, 13), (6, 12), (7, 13), (6, 7), (6, 8), (7, 9), (8, 10), (9, 11)),
    *((2, 3), (1, 2), (1, 3), (2, 4), (3, 5), (4, 6), (5, 7)),
)
"""COCO's edges between keypoints, counted from 1."""
BAG_KEYPOINTS = ("head", "pelvis")
"""Points of the body in a bag's truth."""
BAG_SKELETON = ((1, 2),)


class Truth:
    """Truth of a recording at stamps nearly in order: one pass over the bag, with a window of it in memory."""

    def __init__(self, frames: Iterator[TruthFrame]) -> None:
        self._frames = frames
        self._held: deque[TruthFrame] = deque()

    def at(self, stamp_ns: int) -> TruthFrame | None:
        """Return the truth at a stamp [ns]; None if the bag lacks it."""
        while not self._held or self._held[-1].stamp_ns < stamp_ns:
            frame = next(self._frames, None)
            if frame is None:
                break
            self._held.append(frame)
            while self._held[0].stamp_ns < frame.stamp_ns - _TRUTH_WINDOW_NS:
                self._held.popleft()
        nearest = min(self._held, key=lambda frame: abs(frame.stamp_ns - stamp_ns), default=None)
        return nearest if nearest is not None and abs(nearest.stamp_ns - stamp_ns) <= _TRUTH_WITHIN_NS else None


@dataclass(frozen=True, eq=False, slots=True)
class Label:
    """One person in one picture: box and visible pixels, share that rays from the camera reach (NaN: unknown), keypoints.

    keypoints (k, 3): u, v [px, pixel centres are integers] and 2 where the picture shows the point or the person's clothes
    before it, 1 where something else hides it, 0 out of the picture or unknown; mask (height, width): the person's pixels.
    """

    box: Box
    visible: float
    in_area: bool
    keypoints: Array
    mask: NDArray[np.bool_] | None = None


@dataclass(frozen=True, eq=False, slots=True)
class LabelledPicture:
    """A picture and all people in it, possibly none."""

    picture: ExportedPicture
    labels: tuple[Label, ...]


class Labeller(ABC):
    """Labeller of a recording's pictures; a context manager, made by `open_labeller`."""

    keypoints: tuple[str, ...] = BAG_KEYPOINTS
    skeleton: tuple[tuple[int, int], ...] = BAG_SKELETON

    def __init__(self, recorded: Recorded) -> None:
        self._recorded = recorded
        self._cameras = recorded.recording.rig.cameras()
        self._truth = Truth(recorded.truth())

    def labelled(self, cameras: Collection[str]) -> Iterator[LabelledPicture]:
        """Yield the labelled pictures of these cameras, in order of arrival."""
        for picture in pictures(self._recorded, cameras):
            truth = self._truth.at(picture.stamp_ns)
            if self._is_labelled(picture, truth):
                yield LabelledPicture(picture, tuple(self._labels(picture, truth)))

    @abstractmethod
    def _is_labelled(self, picture: ExportedPicture, truth: TruthFrame | None) -> bool:
        """Return whether this picture gets labels."""

    @abstractmethod
    def _labels(self, picture: ExportedPicture, truth: TruthFrame | None) -> Iterator[Label]:
        """Yield the labels of the people in a picture."""


class BagLabeller(Labeller):
    """Labeller of pictures with boxes in the bag's truth."""

    def __init__(self, recorded: Recorded) -> None:
        super().__init__(recorded)
        self._boxes = boxes_in(recorded)

    def _is_labelled(self, picture: ExportedPicture, truth: TruthFrame | None) -> bool:
        return (picture.camera, picture.stamp_ns) in self._boxes

    def _labels(self, picture: ExportedPicture, truth: TruthFrame | None) -> Iterator[Label]:
        people = {person.id: person for person in truth.people} if truth is not None else {}
        camera = placed_camera(self._cameras[picture.camera])
        for box in self._boxes[picture.camera, picture.stamp_ns]:
            person = people.get(box.id, PersonTruth(box.id, nan, nan))
            yield _boxed(box, person, picture.camera, camera)


class TableLabeller(Labeller):
    """Labeller of pictures at the stamps of the user's truth: boxes of upright people, hidden or not."""

    def __init__(self, recorded: Recorded, hz: float | None) -> None:
        """`hz`: labelled pictures of each camera per second; None: all."""
        super().__init__(recorded)
        self._thinned = Thinned(hz)

    def _is_labelled(self, picture: ExportedPicture, truth: TruthFrame | None) -> bool:
        return truth is not None and self._thinned.is_due(picture)

    def _labels(self, picture: ExportedPicture, truth: TruthFrame | None) -> Iterator[Label]:
        people, sensor = truth.people if truth is not None else (), self._cameras[picture.camera]
        camera = placed_camera(sensor)
        rows = np.array([(each.x, each.y, each.head_z) for each in people]).reshape(-1, 3)
        boxes, shown, cut = upright_boxes(sensor, rows[:, :2], rows[:, 2])
        for person, box, is_shown, is_cut in zip(people, boxes, shown, cut, strict=True):
            if is_shown and person.visible.get(picture.camera, nan) != 0:
                left, top = np.floor(box[:2]).astype(int).tolist()
                width, height = (np.ceil(box[:2] + box[2:]).astype(int) - (left, top)).tolist()
                whole = Box(person.id, left, top, width, height, width * height, bool(is_cut))
                yield _boxed(whole, person, picture.camera, camera)


def upright_heights(head_z: Array) -> Array:
    """Return the heights of upright people (n,) by those of their heads, NaN: unknown [m]."""
    return np.where(np.isnan(head_z), _UPRIGHT_M, head_z + _HEAD_TOP_M)


def upright_boxes(camera: CameraSensor, xy: Array, head_z: Array) -> tuple[Array, Mask, Mask]:
    """Return boxes left, top, width, height [px] of upright people in the image, pixel (0, 0) spanning 0 to 1, masks of those
    that it shows and of those that its edges cut.

    `xy` (n, 2): positions; `head_z` (n,): heights of the heads, NaN: unknown [m].
    """
    corners, shown = placed_camera(camera).person_boxes(xy, upright_heights(head_z), _WIDE_M)
    edges = np.array([camera.intrinsics.width, camera.intrinsics.height], dtype=float)
    low, high = np.clip(corners[:, :2] + 0.5, 0, edges), np.clip(corners[:, 2:] + 0.5, 0, edges)
    size = high - low
    is_cut = (low != corners[:, :2] + 0.5).any(axis=1) | (high != corners[:, 2:] + 0.5).any(axis=1)
    return np.concatenate([low, size], axis=1), shown & (size > 0).all(axis=1), is_cut


def _boxed(box: Box, person: PersonTruth, name: str, camera: PlacedCamera) -> Label:
    """Return the label of a person of whom a box, head and pelvis are known, to the camera of this name."""
    points = np.array([(person.head_x, person.head_y, person.head_z), (person.x, person.y, person.z)])
    pixels, shown = camera.project(points)
    # occlusion of a point is unknown: a point in the box counts as shown
    inside = (np.abs(pixels - (box.left + box.width / 2, box.top + box.height / 2) + 0.5) * 2).T
    seen = (inside[0] <= box.width) & (inside[1] <= box.height)
    return Label(box, person.visible.get(name, nan), person.in_area, _flagged(pixels, shown, seen))


class Thinned:
    """Choice of the first picture of each camera in each period."""

    def __init__(self, hz: float | None) -> None:
        """`hz`: periods per second; None: every picture."""
        self._hz = hz
        self._last_period: dict[str, int] = {}

    def is_due(self, picture: ExportedPicture) -> bool:
        """Return whether the picture is its camera's first in a period; pictures in order of arrival."""
        if self._hz is None:
            return True
        period = int(picture.stamp_ns * self._hz / NS_PER_S + 1e-9)
        is_due = period > self._last_period.get(picture.camera, -1)
        self._last_period[picture.camera] = period
        return is_due


def boxes_in(recorded: Recorded) -> dict[tuple[str, int], tuple[Box, ...]]:
    """Read the boxes of the bag's truth by camera and stamp [ns]; none where a truth of the user's takes its place."""
    recording = recorded.recording
    if topics.TRUTH_BOXES not in recording.topics or recorded.own_truth is not None:
        return {}
    with open_bag(recording.path) as bag:
        found = (decode_boxes(message.data, stamp_ns) for _, stamp_ns, message in bag.messages([topics.TRUTH_BOXES]))
        return {(frame.camera, frame.stamp_ns): frame.boxes for frame in found}


class SimulatingLabeller(Labeller):
    """Labeller of pictures by simulating the bag's scenario again."""

    keypoints, skeleton = KEYPOINTS, SKELETON

    def __init__(self, recorded: Recorded, simulation: Simulation, hz: float | None) -> None:
        """`hz`: labelled pictures of each camera per second; None: those with boxes in the bag."""
        super().__init__(recorded)
        self._simulation, self._thinned = simulation, Thinned(hz)
        self._boxed = boxes_in(recorded) if hz is None else None
        true = simulation.true_rig.cameras()
        self._true: Mapping[str, CameraSensor] = {name: true[name] for name in self._cameras if name in true}

    def _is_labelled(self, picture: ExportedPicture, truth: TruthFrame | None) -> bool:
        if self._boxed is not None:
            return (picture.camera, picture.stamp_ns) in self._boxed
        return self._thinned.is_due(picture)

    def _labels(self, picture: ExportedPicture, truth: TruthFrame | None) -> Iterator[Label]:
        t, name = picture.stamp_ns / NS_PER_S, picture.camera
        people = {person.id: person for person in truth.people} if truth is not None else {}
        image = self._simulation.person_images(t, [name])[name]
        check_same_people(self._recorded, self._simulation, truth)
        world = self._simulation.world
        snapshot, camera = world.snapshot(t), placed_camera(self._true[name])
        person_of_id = {number: person for person, number in world.scene.ids.items()}
        for box in person_boxes(image):
            person, mask = people.get(box.id), image == box.id
            pixels, shown = camera.project(body_keypoints(world.scene, snapshot.data, person_of_id[box.id]))
            places = np.where(shown[:, None], np.rint(np.nan_to_num(pixels)), 0).astype(int)
            near = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), dtype=np.uint8)) > 0  # skin is drawn to a pixel
            seen = near[np.clip(places[:, 1], 0, mask.shape[0] - 1), np.clip(places[:, 0], 0, mask.shape[1] - 1)]
            yield Label(
                box,
                person.visible.get(name, nan) if person is not None else nan,
                person.in_area if person is not None else True,
                _flagged(pixels, shown, seen),
                mask,
            )


def _flagged(pixels: Array, shown: NDArray[np.bool_], seen: NDArray[np.bool_]) -> Array:
    """Return keypoints (k, 3): u, v and the flag; zeros where the picture does not show the point."""
    flags = np.where(shown, 1 + seen, 0)
    return np.column_stack([np.where(flags[:, None] > 0, pixels, 0.0), flags])


def check_same_people(recorded: Recorded, simulation: Simulation, truth: TruthFrame | None) -> None:
    """Raise InputError where simulated people deviate from the bag's truth."""
    if truth is None:
        return
    pose = simulation.world.people.truth(truth.stamp_ns / NS_PER_S)
    ids = [simulation.world.scene.ids[name] for name in simulation.world.scene.names]
    places = {
        number: place
        for number, place, there in zip(ids, zip(pose.x, pose.y, strict=True), pose.present, strict=True)
        if there
    }
    for person in truth.people:
        x, y = places.get(person.id, (nan, nan))
        if not np.hypot(x - person.x, y - person.y) <= _ELSEWHERE_M:
            raise InputError(
                f"{recorded.title}: person {person.id} is not where the bag's scenario, simulated here, has them at "
                f"{truth.stamp_ns / NS_PER_S:g} s: another version made the bag; --labels bag is expected"
            )


def body_keypoints(scene: Scene, data: mujoco.MjData, name: str) -> Array:
    """Return COCO's 17 keypoints of a person in the room (17, 3) [m]: axes of joints, and points on the head.

    Eyes, ears and the tip of the nose are on the skin (`twin.people.body.head.skull`).
    """
    lengths, model = scene.appearances[name].proportions, scene.model
    head = model.site(f"{name}/head").id
    centre, turned = data.site_xpos[head], data.site_xmat[head].reshape(3, 3)
    height_m = scene.appearances[name].height_m
    eye_m = (EYES - 0.5) * (height_m - lengths.chin_height)
    front, scale = 0.46 * lengths.head_length, (height_m - lengths.chin_height) / 0.2275
    face = [(front + 0.024 * scale, 0.0, eye_m - 0.044 * scale)]
    face += [(front * np.cos(0.37), sign * front * np.sin(0.37), eye_m) for sign in (1, -1)]
    face += [(-0.010 * scale, sign * 0.5 * lengths.head_breadth, eye_m - 0.014 * scale) for sign in (1, -1)]

    def joint(side: str, part: str) -> Array:
        return data.xanchor[model.joint(f"{name}/{side}_{part}").id]

    def wrist(side: str) -> Array:
        forearm = model.body(f"{name}/{side}_forearm").id
        return data.xpos[forearm] - lengths.forearm * data.xmat[forearm].reshape(3, 3)[:, 2]

    limbs = [joint(side, part) for part in ("shoulder_pitch", "elbow") for side in _SIDES]
    limbs += [wrist(side) for side in _SIDES]
    limbs += [joint(side, part) for part in ("hip_yaw", "knee", "ankle_pitch") for side in _SIDES]
    return np.vstack([centre + np.array(face) @ turned.T, limbs])


def open_labeller(stack: ExitStack, recorded: Recorded, *, simulate: bool, hz: float | None = None) -> Labeller | None:
    """Make the labeller of a recording's pictures, closed with `stack`; None if there is no truth.

    By the user's truth where there is one. Else `simulate`: by simulating its scenario again; else, or if impossible (with a
    warning), by the bag's own truth. `hz`: labelled pictures of each camera per second; None: those with boxes in the bag, or
    at stamps of the user's truth.
    """
    if not recorded.has_truth:
        return None
    if recorded.own_truth is not None:
        return TableLabeller(recorded, hz)
    if simulate and recorded.scenario is not None:
        try:
            simulation = stack.enter_context(Simulation(recorded.scenario))
            check_same_people(recorded, simulation, next(recorded.recording.truth(), None))
            return SimulatingLabeller(recorded, simulation, hz)
        except InputError as error:
            recorded.on_warning(f"labels are those of the bag, without masks, head and pelvis for keypoints: {error}")
    return BagLabeller(recorded)
