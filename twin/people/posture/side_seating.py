"""Sitting down from the side of a seat: how one comes to a chair that faces a desk.

The person stands beside the chair with the back to it, sits down facing its side, and turns in with small steps until the
legs are under the table. Room is needed for the standing body beside the seat, for the trunk over it, and for the legs that
swing from the side to the front; a table top above the thighs leaves them room.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from trackers.area import wrap_angle
from trackers.arrays import Array, Mask, Planar
from twin.geometry.polygon import ConvexHull, gap_between
from twin.people.posture.body_measures import BodyMeasures
from twin.people.posture.posture_rows import minimum_jerk
from twin.people.posture.resting import BEFORE_M, SeatedPose, seated_pose
from twin.room.furniture import Seat

TURN_S = 2.4
"""Duration of the turn on the seat, of four small steps [s] (ours)."""
STANDS_M, TURNS_M = 0.36, 0.36
"""Half the breadth of a standing body with its arms, and of a trunk that turns on a seat with the hands on the thighs [m],
for the reference leg."""
_ARM_M = 0.06
_LEGS_M = 0.20
_SHOE_M = 0.20
_HANDS_M = (0.40, 0.08)
"""Reach of hands on the thighs ahead of the hips, and their height over the thighs [m], for the reference leg."""
_HANDS_OVER = (0.6, 1.0)
"""Progress of the turn over which the hands come to rest on the thighs."""
_SPARE_M = 0.02
_OVER_SEAT_M = 0.10
"""Height over a seat from which its own geoms are a back or an arm rest [m]."""
_TOUCH_M = 1e-6


def side_poses(seat: Seat, measures: BodyMeasures, person: int) -> Iterator[tuple[SeatedPose, str]]:
    """Yield the poses of a person seated facing the left and the right side of a seat.

    With each, in words, why they cannot sit down there and turn in; empty where they can.
    """
    front = seated_pose(seat, measures, person)
    for side in (1.0, -1.0):
        pose, fault = _side_pose(seat, front, measures, person, side)
        yield pose, fault or _blocked(seat, pose, front, measures, person)


def _side_pose(
    seat: Seat, front: SeatedPose, measures: BodyMeasures, person: int, side: float
) -> tuple[SeatedPose, str]:
    """Return the pose that faces a side (1 left, -1 right), and why the seat itself rules it out, empty where it does not."""
    scale, thigh = float(measures.scale[person]), float(measures.thigh[person])
    shank = float(measures.shank_radius[person])
    middle, ahead = complex(seat.place[0], seat.place[1]), np.exp(1j * seat.yaw)
    front_m = hips_m = float(((complex(*front.hips[:2]) - middle) * ahead.conjugate()).real)
    half_m = float(measures.shoulder_lateral[person]) + _ARM_M * scale
    fault = ""
    for each in seat.around:
        if each.furniture != seat.furniture or each.high_m < seat.height + _OVER_SEAT_M:
            continue
        local = (each.corners @ np.array([1, 1j]) - middle) * ahead.conjugate()
        if local.real.max() <= front_m:  # a back: one sits down before it
            hips_m = max(hips_m, float(local.real.max()) + half_m)
        elif (side * local.imag).max() > 0:
            fault = "its arm rest is in the way"
    to_side_m = seat.to_sides_m[0 if side > 0 else 1]
    if to_side_m + shank + 0.04 > thigh:
        fault = "it is too wide"
    elif hips_m > seat.to_front_m - 0.05:
        fault = "it is too shallow before its back"
    hips = middle + hips_m * ahead
    feet_m = max(front.feet_ahead_m, to_side_m + shank + 0.03)
    yaw = float(seat.yaw + side * 0.5 * np.pi)
    return SeatedPose((float(hips.real), float(hips.imag), front.hips[2]), yaw, feet_m, front.feet_hang), fault


def _blocked(seat: Seat, pose: SeatedPose, front: SeatedPose, measures: BodyMeasures, person: int) -> str:
    """Return, in words, which furniture is where the body must be; empty for none."""
    scale, stature = float(measures.scale[person]), float(measures.stature[person])
    knees = float(measures.ankle_height[person] + measures.shank[person])
    thighs = max(pose.hips[2], knees) + float(measures.thigh_over[person]) + _SPARE_M
    long_m = max(float(measures.thigh[person]) + 0.08 * scale, front.feet_ahead_m + _SHOE_M * scale)
    hips, turned = complex(*pose.hips[:2]), complex(*front.hips[:2])
    out, ahead = np.exp(1j * pose.yaw), np.exp(1j * front.yaw)
    beside = pose.standing_place
    swing = [
        turned + long_m * np.exp(1j * (front.yaw + share * (pose.yaw - front.yaw))) for share in (0, 0.25, 0.5, 0.75, 1)
    ]
    reach_m, over_m = _HANDS_M
    needs = (
        ((beside, beside + BEFORE_M * out), STANDS_M, 0.0, stature, "for a body beside it"),
        ((hips, turned), TURNS_M, thighs, stature, "to turn in"),
        ((turned, *swing), 0.5 * _LEGS_M, 0.0, thighs, "for the legs (a table top on legs does)"),
        ((turned + (reach_m - 0.1) * ahead * scale,), 0.1, 0.0, thighs + over_m * scale, "for hands on the thighs"),
    )
    for places, radius_m, low_m, high_m, what in needs:
        shape = _around(np.array(places), radius_m * scale)
        for each in seat.around:
            is_there = each.furniture != seat.furniture and each.low_m < high_m and each.high_m > low_m
            if is_there and gap_between(shape, each.corners) < _TOUCH_M:
                return f"{each.furniture!r}, {each.low_m:.2f} to {each.high_m:.2f} m high, leaves no room {what}"
    return ""


def _around(places: Planar, radius_m: float) -> Array:
    """Return the convex outline (k, 2) of discs about places (n,) x + iy [m]."""
    ring = radius_m * np.exp(2j * np.pi * np.arange(12) / 12)
    points = (places[:, None] + ring).ravel()
    corners = np.stack([points.real, points.imag], axis=1)
    return corners[ConvexHull(corners).vertices]


class TurnsOnSeats:
    """Turns of n people on their seats, from facing the side (progress 0) to facing ahead (1)."""

    def __init__(self, count: int) -> None:
        self.progress = np.zeros(count)
        self._side = np.zeros((5, count))  # hips x, y, z [m], yaw [rad], ankles ahead of the hips [m]
        self._by = np.zeros((5, count))
        self._off = np.zeros(count, dtype=complex)  # from the place to stand at to where the person stood [m]
        self._arms_hang = np.zeros(count)

    def take(
        self,
        person: int,
        side: SeatedPose | None,
        front: SeatedPose,
        yaw: float,
        here: complex,
        arms_hang: bool = False,
    ) -> None:
        """Note how one person sits down: facing `side`, at an unwrapped yaw [rad], from `here` x + iy [m]; None: no turn.

        arms_hang: beside the thighs, also after the turn.
        """
        self.progress[person] = 0.0
        self._arms_hang[person] = arms_hang
        self._by[:, person] = 0.0
        if side is None:
            return
        turn = wrap_angle(front.yaw - side.yaw)
        self._side[:, person] = *side.hips, yaw, side.feet_ahead_m
        self._by[:, person] = *np.subtract(front.hips, side.hips), turn, front.feet_ahead_m - side.feet_ahead_m
        self._off[person] = here - side.standing_place

    def goal(self, sits: Mask) -> Mask:
        """Return a mask (n,) of the people who are to face ahead after a turn, of those who are to sit (n,)."""
        return sits & (self._by[3] != 0)

    @property
    def aside(self) -> Array:
        """1 for people whose arms hang: who face the side of a seat, towards 0 as they have turned in, or who lack room for
        their elbows; 0 for all others, (n,).
        """
        return np.maximum((self._by[3] != 0) * (1.0 - minimum_jerk(self.progress, *_HANDS_OVER)), self._arms_hang)

    def step(self, inward: Mask, outward: Mask, dt: float) -> None:
        """Turn some in and others out by dt [s]."""
        progress = self.progress + (dt / TURN_S) * (inward & (self._by[3] != 0)) - (dt / TURN_S) * outward
        self.progress = np.minimum(np.maximum(progress, 0.0), 1.0)

    def pose(self, seated: Array) -> Array:
        """Return the poses (4, n), hips x, y, z [m] and yaw [rad], of people who sat down in poses `seated` (4, n)."""
        return seated + minimum_jerk(self.progress) * self._by[:4] if self.progress.any() else seated

    def footing(self, people: NDArray[np.intp]) -> tuple[Planar, Array]:
        """Return ground points of the feet, x + iy [m], and headings [rad] of some people who turn, (k,) each."""
        share = minimum_jerk(self.progress[people])
        x, y, _, yaw, ahead = self._side[:, people] + share * self._by[:, people]
        return x + 1j * y + ahead * np.exp(1j * yaw) + (1.0 - share) * self._off[people], yaw
