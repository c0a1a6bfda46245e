"""People in a mask, where they stand on the floor: a window at every place of a grid, judged by what has been learned.

The floor's geometry says how large a person is at each place, so that one window a place is looked at and no pyramid of
scales. Windows with little foreground are left out before the rest is judged (`trackers.vision.person_model`). Somebody
stands where a window is judged higher than all others that mean a place nearby; the position is the mean of the places that
such windows mean, weighted by how high they are judged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from numpy.typing import ArrayLike
from pydantic import Field

from trackers.arrays import Array, Index, Mask, Singles
from trackers.cameras.placed import PlacedCamera
from trackers.configuration import Strict
from trackers.filters.gating import distances
from trackers.vision.floor_places import FloorPlaces
from trackers.vision.foreground import ForegroundOptions
from trackers.vision.mask_levels import MaskLevels, level_of
from trackers.vision.person_model import COLUMNS, INPUTS, ROWS, PersonModel

_FULL = np.float32(255)

SILHOUETTES = ForegroundOptions(
    value_change=0.06, saturation_change=0.12, shadows=False, erode_px=0, dilate_px=0, least_area_px=0
)
"""The masks that the model is learned on: faint differences count, and shadows, and legs of a single pixel: it tells what
is a person."""


class DetectorOptions(Strict):
    """Options of the places where people are looked for, and of what is a detection."""

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
        default=0.2, ge=0, le=1, description="share of foreground in the middle of a window below which nobody is there"
    )
    least_score: float = Field(default=0.25, gt=0, lt=1, description="score from which a window shows a person")
    apart_m: float = Field(default=0.4, gt=0, description="two detections are farther apart than this [m]")


@dataclass(frozen=True, eq=False)
class PeopleSeen:
    """k people whom a picture shows, best first, and the score of every place of the floor (`FloorPlaces.map`)."""

    position: Float[Array, "k 2"]  # ground point [m]
    covariance: Float[Array, "k 2 2"]  # of the position [m²]
    score: Float[Array, "k"]
    scores: Float32[Singles, "rows columns"]

    def __len__(self) -> int:
        return len(self.position)


class PersonDetector:
    """Looks for people in the masks of one camera."""

    def __init__(
        self,
        camera: PlacedCamera,
        area: ArrayLike | None = None,
        options: DetectorOptions = DetectorOptions(),
        model: PersonModel | None = None,
    ) -> None:
        """area: corners of the tracked area (c, 2) [m]; None: wherever the camera sees. model: None: the shipped one."""
        self.options, self.model = options, model or PersonModel.load()
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

    def candidates(self, mask: Bool[Mask, "height width"]) -> tuple[Int[Index, "c"], Float32[Singles, "c inputs"]]:
        """The places at which somebody may stand, and what the model is told of each one's window."""
        table = self._levels.table(mask)
        filled = table.take(self._middle).sum(axis=1, dtype=np.int64)
        index = (filled >= 255 * self.options.least_foreground * self._middle.shape[1]).nonzero()[0]
        inputs = np.empty((len(index), INPUTS), np.float32)
        np.divide(table.take(self._index[index]), _FULL, out=inputs[:, : ROWS * COLUMNS])
        inputs[:, ROWS * COLUMNS :] = self._more_inputs[index]
        return index, inputs

    def detect(self, mask: Bool[Mask, "height width"]) -> PeopleSeen:
        """The people whom a mask shows."""
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
