"""A room of boxes and what a scanner in it would see, worked out with pencil and paper: no simulator."""

from __future__ import annotations

import numpy as np

from trackers.environment import PointCloud

ROOM = np.array([[-2.0, -1.5, 0.0], [2.0, 1.5, 2.5]])
TABLE = np.array([[0.6, -0.4, 0.68], [1.4, 0.4, 0.72]])
CUPBOARD = np.array([[-1.6, 0.7, 0.0], [-0.8, 1.2, 1.0]])
BOXES = (TABLE, CUPBOARD)
STATIONS = np.array([[0.0, -0.9, 1.3], [-1.2, -0.6, 1.3], [1.6, 0.9, 1.3]])


def box_distance(origin, directions, box):
    """Distance (n,) along unit directions (n, 3) to where a ray from outside enters a box (2, 3); inf for a miss."""
    with np.errstate(divide="ignore"):
        first, second = (box[0] - origin) / directions, (box[1] - origin) / directions
    enters, leaves = np.minimum(first, second).max(axis=1), np.maximum(first, second).min(axis=1)
    return np.where((enters < leaves) & (enters > 0), enters, np.inf)


def room_distance(origin, directions, room=ROOM):
    """Distance (n,) along unit directions (n, 3) to the room's shell from inside."""
    with np.errstate(divide="ignore"):
        sides = np.where(directions > 0, room[1] - origin, room[0] - origin) / directions
    return np.where(directions == 0, np.inf, sides).min(axis=1)


def sphere(step_deg):
    """Unit directions (n, 3), a step apart in azimuth and elevation."""
    elevation = np.deg2rad(np.arange(-90 + step_deg / 2, 90, step_deg))
    azimuth = np.deg2rad(np.arange(step_deg / 2, 360, step_deg))
    up, around = np.meshgrid(elevation, azimuth)
    return np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=-1).reshape(-1, 3)


def box_room_cloud(stations=STATIONS, boxes=BOXES, noise_m=0.004, step_deg=0.6, turn_rad=0.0, seed=0):
    """The cloud of the room of boxes, turned about the vertical axis through the origin."""
    rng = np.random.default_rng(seed)
    directions = sphere(step_deg)
    points = []
    for origin in stations:
        ranges = np.min(
            [room_distance(origin, directions), *(box_distance(origin, directions, b) for b in boxes)], axis=0
        )
        ranges = ranges + noise_m * rng.standard_normal(len(ranges))
        points.append(origin + ranges[:, None] * directions)
    station = np.repeat(np.arange(len(stations), dtype=np.int16), len(directions))
    turn = np.array([[np.cos(turn_rad), np.sin(turn_rad), 0], [-np.sin(turn_rad), np.cos(turn_rad), 0], [0, 0, 1]])
    return PointCloud(np.concatenate(points) @ turn, station, np.array(stations, dtype=float) @ turn)
