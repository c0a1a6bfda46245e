"""The room as the tracker knows it: how likely a head is anywhere (eq. 8), and which cameras do not hang as the rig says."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array
from trackers.environment.model import Environment
from trackers.rgbd_head.calibration import is_turned
from trackers.rgbd_head.options import EnvironmentOptions
from trackers.rgbd_head.picture import CameraFrontEnd


class Room:
    """environment: None where it is not known."""

    def __init__(self, environment: Environment | None, options: EnvironmentOptions) -> None:
        self._environment = environment if options.used else None
        self._options = options

    def log_weight(self, places: Float[Array, "k 3"]) -> Float[Array, "k"]:
        """The logarithm of the environment's weight e, once a moment; 0 where it is not known."""
        if self._environment is None:
            return np.zeros(len(places))
        options = self._options
        weight = self._environment.head_weight(
            places,
            above_furniture=options.above_furniture,
            odd_height=options.odd_height,
            low_m=options.low_m,
            high_m=options.high_m,
        )
        if options.radius_m:
            weight = weight * ~(self._environment.distance_to_surface(places) < options.radius_m)
        with np.errstate(divide="ignore"):
            return np.log(weight)

    @property
    def warnings(self) -> list[str]:
        """That the room is not known."""
        lacking = self._environment is None and self._options.used
        return ["goes without the room's environment (`twin environment` makes one)"] if lacking else []

    def turned(self, watchers: Mapping[str, CameraFrontEnd]) -> list[str]:
        """The cameras that do not hang as the rig says, as far as the room is known."""
        room = self._environment
        if room is None:
            return []
        return [
            name
            for name, each in watchers.items()
            if each.empty_depth_m.size > 1 and is_turned(each.camera, each.empty_depth_m, room)
        ]
