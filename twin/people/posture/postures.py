"""Postures over standing and walking bodies: sitting, lying, bending, reaching, looking, for all people at once.

State with memory is stepped on the people's clock and kept as rows that may be interpolated linearly
(`twin.people.posture.posture_rows`); `twin.people.posture.overlay` lays them over the gait's joint coordinates. People sit
and lie still, on the back and with the hands on the thighs; legs are not crossed.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from trackers.area import wrap_angle
from trackers.arrays import Array, Planar
from twin.people.body.proportions import about_z, turned
from twin.people.posture.body_measures import BodyMeasures
from twin.people.posture.gaze import GazeControl, heads_of
from twin.people.posture.overlay import BACK_PER_BEND_M, BACK_PER_DROP, PELVIS_SHARE, help_of_trunk
from twin.people.posture.posture_rows import (
    ARMS_PITCH,
    BACK,
    DROP,
    HANDS,
    NECK_PITCH,
    OFF_FEET,
    PELVIS_PITCH,
    POSTURE_ROWS,
    PRESSURE,
    SPINE_PITCH,
    SPINE_ROLL,
    SPINE_YAW,
    CentreOfMass,
    MinimumJerkProfile,
)
from twin.people.posture.resting import (
    GET_UP_S,
    LIE_DOWN_S,
    MATTRESS_SINK_M,
    SIT_DOWN_S,
    STAND_UP_S,
    SeatedPose,
    add_lying,
    add_sitting,
    lying_pose,
    seated_pose,
)
from twin.people.posture.side_seating import TurnsOnSeats
from twin.room.furniture import Bed, Seat

Hand = Literal["left", "right", "auto"]
Part = Literal["body", "bend", "reach", "look"]

MOST_BEND_RAD = 1.92
"""Greatest bend of the trunk, pelvis and spine together [rad] (110 degrees)."""

_PRESSURE_PER_BEND_M = 0.04
_TRAILS_FROM = 0.35
"""Lowering of the hips, as a share of the leg, from which the idle arm trails."""
_NEAR_M, _NEAR_RAD = 0.35, 0.8
_STANDS, _SITS, _LIES = 0, 1, 2


class Postures:
    """Postures of n people over standing and walking; `rows` (POSTURE_ROWS, n) describe the present.

    Commands take a person's index and begin at the next `step`; they raise ValueError where the present posture rules them
    out.
    """

    def __init__(self, measures: BodyMeasures, place: Planar, heading: Array) -> None:
        """Start all people standing at `place` (n,) x + iy [m], facing `heading` (n,) [rad]."""
        count = len(measures)
        self.measures = measures
        self.rows = np.zeros((POSTURE_ROWS, count))
        self._written = self.rows  # those of all but the centre of mass and the gaze
        self._place, self._heading = place.copy(), heading.copy()
        self._idle = True  # all stand or walk, without other commands
        self._all = np.ones(count, dtype=bool)
        self._aim = np.zeros(count, dtype=np.intp)
        self._sitting = np.zeros(count)  # progress of sitting down
        self._lying = np.zeros(count)  # progress of lying down from there
        self._turns = TurnsOnSeats(count)  # of people who sat down from the side
        self._seated = np.zeros((4, count))
        self._hang = np.zeros(count)
        self._lying_pose = np.zeros((4, count))
        self._turns_left = np.zeros(count)
        self._bend = MinimumJerkProfile(1, count)
        self._hands = MinimumJerkProfile(2, count)
        self._points = MinimumJerkProfile(6, count)
        self._help = MinimumJerkProfile(4, count)  # of the trunk to the hands: turn, bend, lean [rad], drop [m]
        self._gaze = GazeControl(count)
        self._mass = CentreOfMass(measures)
        self._legs_slope = np.arcsin(
            np.maximum(measures.behind - MATTRESS_SINK_M - 1.1 * measures.ankle_height, 0.0) / measures.leg
        )

    def sit(self, person: int, seat: Seat, side: SeatedPose | None = None, arms_hang: bool = False) -> None:
        """Sit down on a seat; the person must stand before it, see `SeatedPose.standing_place`.

        side: the pose beside a desk in which they sit down, before they turn in; arms_hang: the hands stay off the thighs.
        """
        self._must(person, self._aim[person] == _STANDS and self._sitting[person] == 0, "sit down", "stands")
        front = seated_pose(seat, self.measures, person)
        self._take(person, side or front)
        self._turns.take(person, side, front, float(self._seated[3, person]), complex(self._place[person]), arms_hang)
        self._aim[person] = _SITS

    def begin_seated(self, person: int, seat: Seat, side: SeatedPose | None = None) -> None:
        """Start seated; the person must have been put before the seat, see `SeatedPose.standing_place`.

        side: the pose beside a desk from which they will rise.
        """
        self.sit(person, seat)
        self._sitting[person] = 1.0
        if side is not None:
            yaw = float(self._seated[3, person]) + (side.yaw - seat.yaw)
            self._seated[:, person] = *side.hips, yaw
            self._turns.take(person, side, seated_pose(seat, self.measures, person), yaw, side.standing_place)
            self._turns.progress[person] = 1.0
        self._write()
        self._mass.begin(self._written)
        self.rows = self._written.copy()

    def lie(self, person: int, bed: Bed) -> None:
        """Lie down on a bed; the person must stand before the edge of their `LyingPose`."""
        self._must(person, self._aim[person] == _STANDS and self._sitting[person] == 0, "lie down", "stands")
        lying = lying_pose(bed, self.measures, person, complex(self._place[person]))
        self._take(person, lying.edge)
        self._turns.take(person, None, lying.edge, 0.0, 0j)
        self._lying_pose[:, person] = *lying.hips, lying.yaw + self._seated[3, person] - lying.edge.yaw
        self._turns_left[person] = float(lying.turns_left)
        self._aim[person] = _LIES

    def rise(self, person: int) -> None:
        """Stand up from a seat, or get up from a bed over its edge."""
        settled = self._aim[person] != _STANDS and self.done(person, "body")
        self._must(person, settled, "stand up", "sits or lies")
        self._aim[person] = _STANDS

    def bend(self, person: int, angle_rad: float) -> None:
        """Bend the trunk forward at hips and spine together, by an angle from 0 to MOST_BEND_RAD [rad]."""
        self._must(
            person, 0 <= angle_rad <= MOST_BEND_RAD, f"bend by {angle_rad}", f"bends by 0 to {MOST_BEND_RAD} rad"
        )
        self._must(person, self._aim[person] != _LIES and self._lying[person] == 0, "bend", "stands or sits")
        self._bend.go(person, angle_rad, 0.7 + 0.6 * abs(angle_rad - self._bend.value[0, person]))

    def straighten(self, person: int) -> None:
        """Come up from a bend."""
        self._idle = False
        self._bend.go(person, 0.0, 0.7 + 0.6 * self._bend.value[0, person])

    def reach(self, person: int, point: Array, hand: Hand = "auto") -> float:
        """Bring the middle of a hand to a point (3,) in the room [m]; auto: the free hand, or the one on the point's side.

        Trunk and knees give what the arm does not reach, from the present position of the body. Beyond that the hand gets as
        near as it can; returned is how much too far the point is [m], 0 for who lies.
        """
        point = np.asarray(point, dtype=float)
        self._must(person, point.shape == (3,) and bool(np.isfinite(point).all()), f"reach {point}", "reaches x, y, z")
        hips, yaw = self._hips(person)
        local = turned(about_z(np.array([-yaw])), (point - [hips[0], hips[1], 0.0])[None])[0]
        holds_left, holds_right = self.measures.left_carries[person], self.measures.right_carries[person]
        nearer_left = bool(local[1] >= 0) if holds_left == holds_right else bool(holds_right)
        left = nearer_left if hand == "auto" else hand == "left"
        number = 0 if left else 1
        needs, short_m = np.zeros(4), 0.0
        if self._aim[person] != _LIES and self._lying[person] == 0:
            stands = self._aim[person] == _STANDS
            needs, short_m = help_of_trunk(local, left, float(hips[2]), self.measures, person, stands)
            needs[1] = max(needs[1] - self._bend.goal(person)[0], 0.0)
        now = self._points.value[:, person].copy()
        weights = self._hands.goal(person)
        duration = 0.9 + 0.6 * float(needs[1] + needs[3])
        if self._hands.value[number, person] == 0:
            now[3 * number : 3 * number + 3] = point
            self._points.put(person, now)
        else:
            now = self._points.goal(person)
            now[3 * number : 3 * number + 3] = point
            self._points.go(person, now, duration)
        weights[number] = 1.0
        self._hands.go(person, weights, duration)
        self._help.go(person, needs, duration)
        return short_m

    def withdraw(self, person: int) -> None:
        """Take hands and trunk back."""
        self._idle = False
        duration = 0.8 + 0.6 * float(self._help.value[1, person] + self._help.value[3, person])
        self._hands.go(person, np.zeros(2), duration)
        self._help.go(person, np.zeros(4), duration)

    def look_at(self, person: int, point: Array) -> None:
        """Turn the head to a point (3,) in the room [m] and keep it there, walking or not, within the neck's limits."""
        point = np.asarray(point, dtype=float)
        self._must(person, point.shape == (3,) and bool(np.isfinite(point).all()), f"look at {point}", "sees x, y, z")
        self._gaze.at_point(person, point)

    def look_at_person(self, person: int, other: int) -> None:
        """Turn the head to another's head and keep it there."""
        self._must(person, person != other, "look at themselves", "looks at somebody else")
        self._gaze.at_person(person, other)

    def turn_head(self, person: int, yaw_rad: float, pitch_rad: float = 0.0) -> None:
        """Turn the head from straight ahead: yaw to the left, pitch down positive [rad]."""
        self._must(
            person, abs(yaw_rad) <= np.pi and abs(pitch_rad) <= 0.5 * np.pi, "turn the head so far", "turns less"
        )
        self._gaze.by_angle(person, yaw_rad, pitch_rad)

    def look_ahead(self, person: int) -> None:
        """Release the head to the gait's gaze."""
        self._idle = False
        self._gaze.ahead(person)

    def done(self, person: int, part: Part | None = None) -> bool:
        """Return whether the last command is reached, of one part or (None) of all."""
        if part is None:
            return all(self.done(person, each) for each in get_args(Part))
        if part == "body":
            goal = self._aim[person] >= _SITS, self._aim[person] == _LIES
            return (self._sitting[person], self._lying[person]) == goal and not self.turning()[person]
        if part == "look":
            return self._gaze.done(person)
        profiles = (self._bend,) if part == "bend" else (self._hands, self._points, self._help)
        return not any(profile.moving[person] for profile in profiles)

    def may_walk(self) -> NDArray[np.bool_]:
        """Return a mask (n,) of the people on their feet who may be sent about."""
        if self._idle:
            return self._all
        return (self._sitting == 0) & (self._aim == _STANDS)

    def turning(self) -> NDArray[np.bool_]:
        """Return a mask (n,) of the people who turn on their seats, or are about to, and step along."""
        if self._idle:
            return ~self._all
        return self._turns.progress != self._turns.goal((self._aim == _SITS) & (self._sitting >= 1))

    def footing(self, people: NDArray[np.intp]) -> tuple[Planar, Array]:
        """Return ground points, x + iy [m], and headings [rad] of the feet of some people who turn, (k,) each."""
        return self._turns.footing(people)

    def step(self, place: Planar, heading: Array, dt: float) -> None:
        """Step by dt [s]; place (n,) x + iy [m] and heading (n,) [rad]: those of the gait."""
        self._place, self._heading = place, heading
        if self._idle:
            return
        moves = (self._sitting != (self._aim >= _SITS)) | (self._lying != (self._aim == _LIES))
        if bodies_move := moves.any() or self.turning().any():
            self._move(dt)
        profiles = (self._bend, self._hands, self._points, self._help)
        if bodies_move or any(profile.moving.any() for profile in profiles):
            for profile in profiles:
                profile.step(dt)
            self._write()
        rows = self._written.copy()
        self._mass.step(rows, dt)
        if not self._gaze.idle():
            head, body = heads_of(self.measures, place, heading, rows)
            self._gaze.step(dt, head, body, rows)
        self.rows = rows
        moving = any(profile.moving.any() for profile in profiles)
        self._idle = not (moving or self._aim.any() or rows.any() or self._mass.moves or not self._gaze.idle())

    def _move(self, dt: float) -> None:
        down = self._aim >= _SITS
        flat = self._aim == _LIES
        lying = self._lying + np.where(flat & (self._sitting >= 1), dt / LIE_DOWN_S, 0.0)
        lying -= np.where(~flat, dt / GET_UP_S, 0.0)
        rises = ~down & (self._lying <= 0) & (self._turns.progress <= 0)
        self._turns.step(down & (self._sitting >= 1), ~down, dt)
        self._lying = np.minimum(np.maximum(lying, 0.0), 1.0)
        sitting = self._sitting + np.where(down, dt / SIT_DOWN_S, 0.0) - np.where(rises, dt / STAND_UP_S, 0.0)
        self._sitting = np.minimum(np.maximum(sitting, 0.0), 1.0)

    def _write(self) -> None:
        """Write the rows (POSTURE_ROWS, n) of all people with more than a gaze anew."""
        self._written = rows = np.zeros_like(self.rows)
        if not any(each.any() for each in (self._sitting, self._bend.value, self._hands.value, self._help.value)):
            return
        scale, stature = self.measures.scale, self.measures.stature
        who = np.nonzero(self._sitting > 0)[0]
        if len(who):
            some = rows[:, who]
            seated = self._turns.pose(self._seated)[:, who]
            add_sitting(some, self._sitting[who], seated, self._hang[who], stature[who], self._turns.aside[who])
            flat = np.nonzero(self._lying[who] > 0)[0]
            if len(flat):
                lies = who[flat]
                deep = some[:, flat]
                add_lying(
                    deep, self._lying[lies], self._seated[:, lies], self._lying_pose[:, lies], self._turns_left[lies],
                    self._legs_slope[lies],
                )  # fmt: skip
                some[:, flat] = deep
            rows[:, who] = some
        turn, more, lean, drop = self._help.value
        bend = self._bend.value[0] + more
        stands = 1.0 - rows[OFF_FEET]
        rows[PELVIS_PITCH] += PELVIS_SHARE * bend
        rows[SPINE_PITCH] += (1 - PELVIS_SHARE) * bend
        rows[SPINE_YAW] += turn
        rows[SPINE_ROLL] += lean
        rows[NECK_PITCH] -= 0.35 * bend
        # in a deep crouch an idle arm trails, or it would hang into the floor
        trails = np.minimum(drop / (_TRAILS_FROM * self.measures.leg), 1.0)
        rows[ARMS_PITCH] -= (0.92 - 0.5 * trails) * bend
        on_feet = np.where(self._sitting > 0, 0.0, 1.0)
        rows[BACK] += on_feet * (BACK_PER_BEND_M * scale * np.sin(np.minimum(bend, 0.5 * np.pi)) + BACK_PER_DROP * drop)
        rows[DROP] += on_feet * drop
        rows[PRESSURE] += stands * _PRESSURE_PER_BEND_M * scale * np.sin(np.minimum(bend, 0.5 * np.pi))
        reach = self._hands.value
        for number in range(2):
            first = HANDS + 4 * number
            rows[first] = reach[number]
            rows[first + 1 : first + 4] = reach[number] * self._points.value[3 * number : 3 * number + 3]

    def _hips(self, person: int) -> tuple[Array, float]:
        """Return hip joints x, y, z (3,) [m] and yaw [rad] of one person without their bends."""
        place, yaw = complex(self._place[person]), float(self._heading[person])
        if self._aim[person] == _STANDS:
            height = float(self.measures.leg[person] * 0.9945 + self.measures.ankle_height[person])
            return np.array([place.real, place.imag, height]), yaw
        goal = self._lying_pose if self._aim[person] == _LIES else self._turns.pose(self._seated)
        return goal[:3, person].copy(), float(goal[3, person])

    def stands_near(self, person: int, place: complex, yaw: float) -> bool:
        """Return whether a person stands near enough to a place x + iy [m], facing yaw [rad], to sit down from there."""
        turn = wrap_angle(yaw - float(self._heading[person]))
        return bool(abs(complex(self._place[person]) - place) <= _NEAR_M and abs(turn) <= _NEAR_RAD)

    def _take(self, person: int, seated: SeatedPose) -> None:
        here, faces = complex(self._place[person]), float(self._heading[person])
        near = self.stands_near(person, seated.standing_place, seated.yaw)
        self._must(
            person, near, f"sit down from {here:.2f} m facing {faces:.2f} rad",
            f"stands near {seated.standing_place:.2f} m facing {seated.yaw:.2f} rad",
        )  # fmt: skip
        self._seated[:, person] = *seated.hips, faces + wrap_angle(seated.yaw - faces)
        self._hang[person] = float(seated.feet_hang)

    def _must(self, person: int, holds: bool, what: str, who: str) -> None:
        """Raise ValueError unless a command's condition holds; else note that there is something to do."""
        if not holds:
            raise ValueError(f"person {person} cannot {what}: only one who {who} can")
        self._idle = False
