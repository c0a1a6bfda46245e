"""Detect people in a foreground mask: a learned model scores a window at every position of a grid on the floor.

The floor's geometry gives the size of a person at each position, so that one window per position suffices and no pyramid of
scales is needed. Windows with little foreground are dropped before the model runs. The model has two outputs per window: a
score, exp(−d² / 2 σ²) for a person at the distance d of the window's position, and the offset to that person. A detection
is a window whose score exceeds those of all others that point to a nearby position; its position is the score-weighted mean
of theirs. `scripts/train-person-detector` fits the model with scikit-learn and stores it as plain arrays.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from trackers.arrays import AnyArray, Array, Bool, Bytes, Float, Float32, Index, Int, Mask, Singles, UInt8
from trackers.cameras.placed import PlacedCamera
from trackers.configuration import Strict
from trackers.filters.gating import distances
from trackers.user_input.array_files import ArraySpec, read_arrays
from trackers.user_input.text_file import AnyPath
from trackers.vision.foreground import ForegroundOptions
from trackers.vision.person_windows import FloorPlaces

ROWS, COLUMNS = 14, 8
"""Cells of a window, the inputs of the model."""
INPUTS = ROWS * COLUMNS + 2
SHIPPED = Path(__file__).with_name("person_model.npz")
"""Learned from a hall and two homes: that of the system of Song and others."""
LEARNED = "people"
"""Name under which `Prior.learned` may hold another model in its place."""
ROOMS = Path(__file__).with_name("room_person_model.npz")
"""Learned from drawn rooms too, whose cameras hang in corners and look past furniture."""
_PARTS = ("into", "into_bias", "out", "out_bias")
_OUTPUTS = {"nearness": 1, "offset": 2}
_BLOCK = 16
"""Windows whose products with the weights of a layer no BLAS shares out."""
_LARGEST_WEIGHT, _LARGEST_M = 1e4, 10.0
_ARRAYS = {"deviation_m": ArraySpec("f", (2,), 1e-6, _LARGEST_M)} | {
    f"{name}_{part}": ArraySpec("f", shape, -_LARGEST_WEIGHT, _LARGEST_WEIGHT)
    for name, outputs in _OUTPUTS.items()
    for part, shape in zip(
        _PARTS,
        ((INPUTS, f"{name}'s hidden"), (f"{name}'s hidden",), (f"{name}'s hidden", outputs), (outputs,)),
        strict=True,
    )
}


@dataclass(frozen=True, eq=False)
class Network:
    """One hidden layer of rectified linear units: y = W₂ᵀ max(0, W₁ᵀ x + b₁) + b₂."""

    into: Float32[Singles, "inputs hidden"]
    into_bias: Float32[Singles, "hidden"]
    out: Float32[Singles, "hidden outputs"]
    out_bias: Float32[Singles, "outputs"]

    def __call__(self, inputs: Float32[Singles, "n inputs"]) -> Float32[Singles, "n outputs"]:
        """Return the outputs of n windows.

        They are taken in blocks: BLAS shares out larger products among its threads, and rounds by their number.
        """
        n, width = inputs.shape
        blocks = np.zeros((-(-n // _BLOCK), _BLOCK, width), np.float32)
        blocks.reshape(-1, width)[:n] = inputs
        hidden = np.maximum(blocks @ self.into + self.into_bias, 0)
        return (hidden @ self.out + self.out_bias).reshape(-1, self.out.shape[1])[:n]

    def symmetrized(self, *signs: float) -> Network:
        """Average the outputs for a window and for its mirror image; signs: of each output in the mirror image."""
        window = np.arange(ROWS * COLUMNS).reshape(ROWS, COLUMNS)[:, ::-1].ravel()
        mirror = np.append(window, np.arange(ROWS * COLUMNS, INPUTS))
        return Network(
            np.hstack([self.into, self.into[mirror]]),
            np.tile(self.into_bias, 2),
            np.vstack([self.out, self.out * np.array(signs, np.float32)]) / np.float32(2),
            (self.out_bias * (1 + np.array(signs, np.float32)) / 2).astype(np.float32),
        )


@dataclass(frozen=True, eq=False)
class PersonModel:
    """The two networks, and the error of the second on windows that it was not fitted to."""

    nearness: Network
    offset: Network  # to the right and ahead of the window's position, from the camera's view [m]
    deviation_m: Float[Array, "2"]  # standard deviations of that [m]

    def save(self, path: AnyPath) -> None:
        """Write the arrays to a file, identically for identical models."""
        arrays = {f"{name}_{part}": getattr(getattr(self, name), part) for name in _OUTPUTS for part in _PARTS}
        np.savez(path, allow_pickle=False, deviation_m=self.deviation_m, **arrays)

    @classmethod
    def load(cls, path: AnyPath = SHIPPED) -> PersonModel:
        """Load a model written by `save`. Raises InputError for a missing, damaged or invalid file."""
        held = read_arrays(path, _ARRAYS, "a file that scripts/train-person-detector wrote")
        nearness, offset = (
            Network(*(held[f"{name}_{part}"].astype(np.float32) for part in _PARTS)) for name in _OUTPUTS
        )
        return cls(nearness, offset, held["deviation_m"].astype(float))

    def symmetrized(self) -> PersonModel:
        """Return the model that treats left and right alike; in a mirror image the offset to the right changes sign."""
        return replace(self, nearness=self.nearness.symmetrized(1), offset=self.offset.symmetrized(-1, 1))


_SQUARE = 3
"""Side of the squares averaged over [px of the level]."""
_MOST_LEVELS = 6


def level_of(cell_px: Float[Array, "n"]) -> Int[AnyArray, "n"]:
    """Choose the level whose squares are nearest in size to cells of this side; the finest for NaN (outside the picture)."""
    wanted = np.log2(np.maximum(np.nan_to_num(cell_px), 1.0) / _SQUARE)
    return np.clip(np.rint(wanted), 0, _MOST_LEVELS - 1).astype(np.intp)


class MaskLevels:
    """Pyramid levels of masks of one size in one table, each with an empty border.

    A mask is halved repeatedly and averaged over squares of three by three at each level (the sum-pooled channels of Dollár
    et al., "Fast feature pyramids for object detection", 2014). A cell is read at the level whose squares are nearest to its
    size, so that windows of all sizes cost the same.
    """

    def __init__(self, width: int, height: int, levels: Iterable[int]) -> None:
        self._shape = {level: (max(height >> level, 1), max(width >> level, 1)) for level in sorted(set(levels))}
        lengths = [(rows + 2) * (columns + 2) for rows, columns in self._shape.values()]
        self._start = dict(zip(self._shape, np.cumsum([0, *lengths]).tolist(), strict=False))
        self._length = sum(lengths)

    def index(self, pixels: Float[Array, "n *cells 2"], level: Int[AnyArray, "n"]) -> Int[AnyArray, "n *cells"]:
        """Return the indices in the table of the squares about pixels; those of the border outside the picture or for NaN."""
        index = np.zeros(pixels.shape[:-1], np.int32)
        for each, (rows, columns) in self._shape.items():
            of = level == each
            place = np.floor(np.nan_to_num(pixels[of] + 0.5, nan=-1.0) / 2**each) + 1
            column, row = np.clip(place[..., 0], 0, columns + 1), np.clip(place[..., 1], 0, rows + 1)
            index[of] = self._start[each] + row * (columns + 2) + column
        return index

    def table(self, mask: Bool[Mask, "height width"]) -> UInt8[Bytes, "size"]:
        """Return the filled share of each square of a mask, 0 to 255."""
        table = np.zeros(self._length, np.uint8)
        plane, level = np.asarray(mask).view(np.uint8) * np.uint8(255), 0
        for each, (rows, columns) in self._shape.items():
            for _ in range(level, each):
                size = (max(plane.shape[1] >> 1, 1), max(plane.shape[0] >> 1, 1))
                plane = np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_AREA), np.uint8)
            level = each
            bordered = table[self._start[each] :][: (rows + 2) * (columns + 2)].reshape(rows + 2, columns + 2)
            bordered[1:-1, 1:-1] = cv2.blur(plane, (_SQUARE, _SQUARE), borderType=cv2.BORDER_REPLICATE)
        return table


_FULL = np.float32(255)

SILHOUETTES = ForegroundOptions(
    value_change=0.06, saturation_change=0.12, shadows=False, erode_px=0, dilate_px=0, least_area_px=0
)
"""Masks for the model: with faint differences, shadows, and legs of a single pixel, since it decides what is a person."""


class DetectorOptions(Strict):
    """Options of the search positions, and of detections."""

    former_names: ClassVar[Mapping[str, str]] = {"least_inside": "least_in_picture"}

    pitch_m: float = Field(default=0.2, ge=0.05, description="from place to place of the floor [m]")
    margin_m: float = Field(default=0.5, ge=0, description="how far outside the rig's area they are looked for [m]")
    reach_m: float = Field(
        default=15.0, gt=0, le=50, description="how far off they are looked for where the rig has no area [m]"
    )
    least_in_picture: float = Field(
        default=0.5, gt=0, le=1, description="least share of a person's window that the picture must show"
    )
    least_foreground: float = Field(
        default=0.2,
        ge=0,
        le=1,
        description="share of foreground in the middle of a window below which it shows no person",
    )
    least_score: float = Field(default=0.25, gt=0, lt=1, description="score from which a window shows a person")
    apart_m: float = Field(default=0.4, gt=0, description="two detections are farther apart than this [m]")


@dataclass(frozen=True, eq=False)
class PeopleSeen:
    """k people in a picture, best first, and the score of every position of the floor (`FloorPlaces.map`)."""

    position: Float[Array, "k 2"]  # ground point [m]
    covariance: Float[Array, "k 2 2"]  # of the position [m²]
    score: Float[Array, "k"]
    scores: Float32[Singles, "rows columns"]

    def __len__(self) -> int:
        return len(self.position)


class PersonDetector:
    """Detector of people in the masks of one camera."""

    def __init__(
        self,
        camera: PlacedCamera,
        area: ArrayLike | None = None,
        options: DetectorOptions = DetectorOptions(),
        model: PersonModel | None = None,
    ) -> None:
        """area: corners of the tracked area (c, 2) [m]; None: wherever the camera sees. model: None: the shipped one."""
        self.options, self.model = options, (model or PersonModel.load()).symmetrized()
        self.places = FloorPlaces(
            camera,
            area,
            cells=(ROWS, COLUMNS),
            pitch_m=options.pitch_m,
            margin_m=options.margin_m,
            reach_m=options.reach_m,
            least_in_picture=options.least_in_picture,
        )
        windows, lens = self.places.windows, camera.intrinsics
        level = level_of(windows.cell_px)
        self._levels = MaskLevels(lens.width, lens.height, level.tolist())
        index = self._levels.index(windows.pixels, level)
        middle = index[:, ROWS // 4 : ROWS - ROWS // 4 : 2, COLUMNS // 2 - 1 : COLUMNS // 2 + 1]
        self._middle = np.ascontiguousarray(middle.reshape(len(index), middle[0].size if len(index) else 0))
        self._index = index.reshape(len(index), ROWS * COLUMNS)
        self._more_inputs = np.stack([windows.steepness, self.places.share_in_picture], axis=1).astype(np.float32)

    def warnings(self, camera: str) -> list[str]:
        """Return that people are not looked for as far as this camera sees them, where that is so."""
        if not self.places.is_cut:
            return []
        return [
            f"the rig has no area, and {camera} sees people farther off than {self.options.reach_m:g} m, where none is looked "
            "for; an area in the rig, or a greater detector.reach_m, changes that"
        ]

    def candidates(self, mask: Bool[Mask, "height width"]) -> tuple[Int[Index, "c"], Float32[Singles, "c inputs"]]:
        """Return the positions at which a person may stand, and the model's inputs from their windows."""
        table = self._levels.table(mask)
        filled = table.take(self._middle).sum(axis=1, dtype=np.int64)
        index = (filled >= 255 * self.options.least_foreground * self._middle.shape[1]).nonzero()[0]
        inputs = np.empty((len(index), INPUTS), np.float32)
        np.divide(table.take(self._index[index]), _FULL, out=inputs[:, : ROWS * COLUMNS])
        inputs[:, ROWS * COLUMNS :] = self._more_inputs[index]
        return index, inputs

    def detect(self, mask: Bool[Mask, "height width"]) -> PeopleSeen:
        """Detect the people in a mask."""
        options, places = self.options, self.places
        index, inputs = self.candidates(mask)
        score = self.model.nearness(inputs)[:, 0]
        scores = places.map(index, np.maximum(score, 0))
        shown = score >= options.least_score
        index, score = index[shown], score[shown].astype(float)
        offset = self.model.offset(inputs[shown]).astype(float)
        windows = places.windows
        right, ahead = windows.right[index], windows.ahead[index]
        meant = places.position[index] + offset[:, :1] * right + offset[:, 1:] * ahead
        near = distances(meant, meant) <= options.apart_m
        rank = np.empty(score.size, np.intp)
        rank[np.argsort(-score, kind="stable")] = np.arange(score.size)
        first = ~(near & (rank[None] < rank[:, None])).any(axis=1)
        best = first.nonzero()[0][np.argsort(rank[first])]
        weight = near[best] * score
        position = weight @ meant / weight.sum(axis=1, keepdims=True)
        axes = np.stack([right[best], ahead[best]], axis=-1)  # (k, 2, 2): columns are the view's two directions
        covariance = axes * self.model.deviation_m**2 @ axes.swapaxes(1, 2)
        return PeopleSeen(position, covariance, score[best], scores)
