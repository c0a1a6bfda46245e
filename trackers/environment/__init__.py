"""Environment: the room measured beforehand by a range scanner, as walls, furniture and free space."""

from trackers.environment.build import EnvironmentOptions, build_environment, load_environment, save_environment
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
