"""People tracking with a two-layer laser and a fisheye camera, after Bai and Takahashi: "Identification and Tracking Using
Laser and Vision of Maneuvering People".

Per epoch: gather what the sensors report of one moment; detect trunks and legs in front of the room; predict every track
under every motion model; associate by global nearest neighbour on d = N + w E, trunks first, legs for who is left (never
both); update who was measured, let the others coast; end tracks; start tracks.

Not modelled: that sensors of one epoch look at slightly different moments (up to half a scan period), and that a scan sweeps.

Ours, not the paper's, each an option: the correction from a cluster's middle to the body's axis, the completion of half
hidden clusters, the grouping of arms and legs, confirmed tracks associated before tentative ones, the velocity of a new track
from its first two measurements, and brightness bins for shirts without hue.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, field_validator

from trackers.area import within
from trackers.epochs import Epoch, EpochGatherer
from trackers.errors import InputError
from trackers.filters.gating import global_nearest_neighbour, mahalanobis, validation_region
from trackers.filters.imm import Imm, ImmState
from trackers.filters.motion import IMM_MODELS, KALMAN_MODELS, MotionModel, transition_matrix
from trackers.laser.grouping import distances, pair_legs
from trackers.laser.layer import Detections, KneeOptions, LaserLayer, LayerOptions, WaistOptions
from trackers.observations import NS_PER_S, Image, LaserScan, Observation
from trackers.people import ManagementOptions, People
from trackers.rig import LaserSensor, Rig, Strict
from trackers.tracks import Track, TrackFrame
from trackers.vision.histogram import ColourHistogram, HistogramOptions, chi_squared_distance, updated_reference
from trackers.vision.torso import TorsoOptions, TorsoProjector, TorsoWindows

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
Role = Literal["waist", "knee"]

logger = logging.getLogger(__name__)

CITATION = (
    "Z. Bai, K. Takahashi: Identification and Tracking Using Laser and Vision of Maneuvering People "
    "(two-layer laser, fisheye camera, interacting multiple model estimator)"
)

WAIST_FROM_M = 0.7
"""A scanner without a role mounted at least this high [m] is taken for the waist scanner, lower for the knee scanner."""
