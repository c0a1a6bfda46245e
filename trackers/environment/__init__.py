"""The room as a tracker knows it: measured by a range scanner beforehand, made into walls, furniture and free space."""

from trackers.environment.build import EnvironmentOptions, build_environment
from trackers.environment.file import load_environment, save_environment
from trackers.environment.grid import FREE, OCCUPIED, UNKNOWN, Grid, PointCloud
from trackers.environment.model import Environment

__all__ = [
    "FREE",
    "OCCUPIED",
    "UNKNOWN",
    "Environment",
    "EnvironmentOptions",
    "Grid",
    "PointCloud",
    "build_environment",
    "load_environment",
    "save_environment",
]
