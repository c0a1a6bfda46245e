"""Behaviour of people in a scenario: a small vocabulary of actions, done one after another.

A person's script is one action or a list of them. Every action may wait for a time (`at_s`) and for a condition (`when`),
standing meanwhile; `for_s` is its duration if it has no end of its own. After the last action people stand. A sitting or
lying person gets up before walking, turning or standing.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, FiniteFloat, model_validator

from trackers.area import Point3
from trackers.rig import Name, Point2
from twin.scenario.action import (
    LastingAction,
    RecordedPath,
    RunSpeed,
    Seconds,
    Share,
    Spacing,
    Target,
    TimedAction,
    WalkSpeed,
    check_ranges,
    check_repeat,
)  # fmt: skip


class Wander(LastingAction):
    """Walk about the tracked area at random, with sudden stops, starts and turns.

    The person walks to random places in turn, each stretch at its own speed. Stretches end after an exponentially
    distributed time of mean `stretch_s`, or on arrival: then the person stops suddenly with probability `stop_share` for a
    time uniform in `stop_s`, and otherwise turns at once.
    """

    kind: Literal["wander"] = Field(default="wander", description="the action: walk about at random")
    speed_m_s: tuple[WalkSpeed, WalkSpeed] = Field(
        default=(0.6, 1.3), description="slowest and fastest walking speed [m/s]"
    )
    stretch_s: float = Field(default=2.5, ge=0.2, le=60, description="mean time between two stops or turns [s]")
    stop_share: Share = Field(default=0.4, description="share of stretches that end in a stop, 0 to 1")
    stop_s: tuple[float, float] = Field(default=(0.3, 1.0), description="shortest and longest stop [s]")

    @model_validator(mode="after")
    def _ordered(self) -> Wander:
        check_ranges(speed_m_s=self.speed_m_s, stop_s=self.stop_s)
        return self


class Stand(LastingAction):
    """Stand still in place, getting up first if sitting or lying; others walk around the person."""

    kind: Literal["stand"] = Field(default="stand", description="the action: stand still")


class Walk(TimedAction):
    """Walk through waypoints, around furniture and people, then stop; with `repeat`, over and over.

    `face`: a person or a place to keep facing meanwhile, with (slow) steps backwards and sideways.
    """

    kind: Literal["walk"] = Field(default="walk", description="the action: walk through waypoints")
    waypoints: tuple[Point2, ...] = Field(min_length=1, description="places in the room frame [m], in order")
    speed_m_s: WalkSpeed = Field(default=1.2, description="walking speed [m/s]")
    repeat: bool = Field(default=False, description="whether to begin again after the last waypoint, over and over")
    face: Target | None = Field(
        default=None, description="somebody by name, or a place [x, y] [m], to keep facing; none: the way ahead"
    )

    @model_validator(mode="after")
    def _goes_on(self) -> Walk:
        check_repeat(self.waypoints, self.repeat)
        return self


class Run(TimedAction):
    """Run through waypoints, around furniture and people, then stop; with `repeat`, over and over."""

    kind: Literal["run"] = Field(default="run", description="the action: run through waypoints")
    waypoints: tuple[Point2, ...] = Field(min_length=1, description="places in the room frame [m], in order")
    speed_m_s: RunSpeed = Field(default=3.0, description="running speed [m/s]")
    repeat: bool = Field(default=False, description="whether to begin again after the last waypoint, over and over")

    @model_validator(mode="after")
    def _goes_on(self) -> Run:
        check_repeat(self.waypoints, self.repeat)
        return self


class Turn(TimedAction):
    """Turn on the spot: to a heading, by an angle, or towards a person or a place; exactly one of the three."""

    kind: Literal["turn"] = Field(default="turn", description="the action: turn on the spot")
    to_deg: FiniteFloat | None = Field(default=None, description="heading, counter-clockwise from x [deg]")
    by_deg: FiniteFloat | None = Field(default=None, description="positive: to the left [deg]")
    towards: Target | None = Field(
        default=None, description="somebody by name, or a place [x, y] in the room frame [m], to turn to"
    )

    @model_validator(mode="after")
    def _one(self) -> Turn:
        if sum(each is not None for each in (self.to_deg, self.by_deg, self.towards)) != 1:
            raise ValueError("a turn needs exactly one of to_deg, by_deg and towards")
        return self


class Sit(LastingAction):
    """Walk to a seat of the room and sit down; the person stands up when the time is over.

    `seated` (the first action only, without `start` and `heading_deg`): the person starts seated there.
    """

    kind: Literal["sit"] = Field(default="sit", description="the action: sit down on a seat")
    seat: str = Field(description="NAME of a site seat_NAME of the room")
    seated: bool = Field(
        default=False, description="whether the person sits there from the start (the first action only)"
    )


class Lie(LastingAction):
    """Walk to a bed of the room, sit on its edge and lie down; the person gets up when the time is over."""

    kind: Literal["lie"] = Field(default="lie", description="the action: lie down on a bed")
    bed: str = Field(description="NAME of a site bed_NAME of the room")


class Bend(TimedAction):
    """Bend the trunk forward by an angle, hold it for `for_s`, and straighten up."""

    kind: Literal["bend"] = Field(default="bend", description="the action: bend forward")
    angle_deg: float = Field(
        default=60.0, gt=0, le=100, description="how far the trunk bends forward from upright [deg]"
    )
    for_s: Seconds = Field(default=1.0, description="how long the person stays bent [s]")


class Reach(TimedAction):
    """Stretch a hand out to a point, hold it there for `for_s`, and take it back.

    A point out of reach is reached for, not touched: walk there first. The hand stops up to 0.15 m before a point that is on
    or in an object; a point farther in, or behind one, is given up with a warning.
    """

    kind: Literal["reach"] = Field(default="reach", description="the action: stretch a hand out to a point")
    point: Point3 = Field(description="what the hand goes to, [x, y, z] in the room frame [m]")
    hand: Literal["left", "right", "auto"] = Field(
        default="auto", description="the hand that reaches; auto: the one without a bag, or on the point's side"
    )
    for_s: Seconds = Field(default=1.0, description="how long the hand is held there [s]")


class TurnHead(TimedAction):
    """Turn the head: at a person or a place, or by an angle (left and down positive); with neither, look about freely.

    The script continues at once, and the head stays turned, also while walking, for `for_s` (none: until the next look).
    """

    kind: Literal["look"] = Field(default="look", description="the action: turn the head, while the script goes on")
    at: Target | None = Field(
        default=None, description="somebody by name, or a place [x, y] or [x, y, z] in the room frame [m], to look at"
    )
    yaw_deg: float | None = Field(
        default=None,
        ge=-90,
        le=90,
        description="how far the head is turned, positive to the left [deg]; neither this nor `at`: look about freely",
    )
    pitch_deg: float = Field(default=0.0, ge=-40, le=40, description="how far the head is bowed, positive down [deg]")
    for_s: Seconds | None = Field(default=None, description="how long [s]; none: until the next look")

    @model_validator(mode="after")
    def _one(self) -> TurnHead:
        if self.at is not None and self.yaw_deg is not None:
            raise ValueError("look has both at and yaw_deg; one of them, or none, is expected")
        return self


class Follow(LastingAction):
    """Walk after a person at a distance, as they go; or, with `beside`, abreast of them where there is room, else behind.

    A follower beside falls behind before a wall, furniture or an oncoming person, and draws level again. At 0.5 m the two
    walk shoulder to shoulder, as near as their bodies allow, with the arms between them held in.
    """

    kind: Literal["follow"] = Field(default="follow", description="the action: walk after somebody")
    person: Name = Field(description="name of the person who is followed")
    beside: Literal["left", "right"] | None = Field(
        default=None, description="the side of the other to walk on, abreast; none: behind"
    )
    distance_m: float | None = Field(
        default=None,
        ge=0.5,
        le=20,
        description="how far from the other the follower keeps, from middle to middle [m]; "
        "none: 1.2 behind, where at least 0.8 is expected, 0.7 beside, where 0.5 (shoulder to shoulder) to 1.5 is",
    )
    speed_m_s: WalkSpeed = Field(default=1.8, description="the fastest that the follower walks [m/s]")

    @property
    def keeps_m(self) -> float:
        """Distance that the follower keeps from the other [m]."""
        default_m = 1.2 if self.beside is None else 0.7
        return default_m if self.distance_m is None else self.distance_m

    @model_validator(mode="after")
    def _a_distance_to_keep(self) -> Follow:
        low, high = (0.8, 20.0) if self.beside is None else (0.5, 1.5)
        if not low <= self.keeps_m <= high:
            where = "behind somebody" if self.beside is None else "beside somebody"
            raise ValueError(f"distance_m {self.keeps_m:g} cannot be kept {where}; {low:g} to {high:g} is expected")
        return self


class Meet(TimedAction):
    """Walk up to a person, stand face to face for `for_s`, and part: continue with the script."""

    kind: Literal["meet"] = Field(default="meet", description="the action: walk up to somebody and stand face to face")
    person: Name = Field(description="name of the person who is met")
    distance_m: float = Field(default=0.9, ge=0.7, le=5, description="how far apart the two stand [m]")
    speed_m_s: WalkSpeed = Field(default=1.2, description="walking speed on the way there [m/s]")
    for_s: Seconds = Field(default=3.0, description="how long they stand face to face [s]")


class Lead(LastingAction):
    """Lead a group about the tracked area: people who `join` walk with the person, talk with them, and part.

    The group walks to random places in turn, more slowly the larger it is (Moussaïd et al. 2010, figure 2). At the end of a
    stretch it may stop and talk in a ring. `formation`, where there is room: abreast; as a V, whose middle lags behind
    (usual for three); or in file. Neighbours draw near to the first distance of `spacing_m` for `near_s`, at least what
    their shoulders need, and keep the second for `far_s`.
    """

    kind: Literal["lead"] = Field(default="lead", description="the action: lead a group of those who join")
    formation: Literal["abreast", "v", "file"] = Field(
        default="abreast", description="how the group walks: abreast, abreast with the middle behind, or in file"
    )
    spacing_m: tuple[Spacing, Spacing] = Field(
        default=(0.65, 0.9),
        description="near and far distance between neighbours, in turn [m]; 0.5: shoulder to shoulder",
    )
    near_s: tuple[Seconds, Seconds] = Field(
        default=(2.0, 4.0), description="shortest and longest time for which neighbours are near [s]"
    )
    far_s: tuple[Seconds, Seconds] = Field(
        default=(2.0, 4.0), description="shortest and longest time for which neighbours keep the far distance [s]"
    )
    speed_m_s: tuple[WalkSpeed, WalkSpeed] = Field(
        default=(1.12, 1.32), description="slowest and fastest speed that the person would walk at alone [m/s]"
    )
    slowdown_m_s: float = Field(
        default=0.04, ge=0, le=0.3, description="how much slower the group walks for each member but the first [m/s]"
    )
    stretch_s: float = Field(
        default=8.0, ge=0.5, le=60, description="mean time for which the group walks to one place [s]"
    )
    change_share: Share = Field(
        default=0.25, description="share of the times they are near in which a member changes sides, 0 to 1"
    )
    talk_share: Share = Field(default=0.3, description="share of stretches that end in a talk in a ring, 0 to 1")
    talk_s: tuple[Seconds, Seconds] = Field(default=(3.0, 8.0), description="shortest and longest talk [s]")
    ring_m: float = Field(default=0.9, ge=0.7, le=2, description="distance between neighbours in the ring [m]")

    @model_validator(mode="after")
    def _ordered(self) -> Lead:
        check_ranges(
            spacing_m=self.spacing_m, speed_m_s=self.speed_m_s, near_s=self.near_s, far_s=self.far_s, talk_s=self.talk_s
        )
        return self


class Join(LastingAction):
    """Walk up to the leader of a group, and go with them for `for_s`, or until they stop leading.

    The person waits in place until the other leads.
    """

    kind: Literal["join"] = Field(default="join", description="the action: go with a group")
    person: Name = Field(description="name of the person who leads the group")
    speed_m_s: WalkSpeed = Field(default=1.8, description="the fastest that the person walks, to draw level [m/s]")


class Leave(TimedAction):
    """Walk to a place, such as a door, and leave there."""

    kind: Literal["leave"] = Field(default="leave", description="the action: walk to a place and leave")
    to: Point2 = Field(description="the place to leave at, [x, y] in the room frame [m]")
    speed_m_s: WalkSpeed = Field(default=1.2, description="walking speed [m/s]")


Action = Annotated[
    Wander
    | Stand
    | Walk
    | Run
    | Turn
    | Sit
    | Lie
    | Bend
    | Reach
    | TurnHead
    | Follow
    | Meet
    | Lead
    | Join
    | RecordedPath
    | Leave,
    Field(discriminator="kind"),
]


def endless(action: Action) -> bool:
    """Return whether no later action would ever begin."""
    if isinstance(action, Wander | Stand | Sit | Lie | Follow | Lead):
        return action.for_s is None
    return isinstance(action, RecordedPath | Leave) or (isinstance(action, Walk | Run) and action.repeat)


def companions(action: Action) -> list[tuple[str, str]]:
    """Return the people an action names, each as (field, name)."""
    named = []
    match action:
        case Follow() | Meet() | Join():
            named.append(("person", action.person))
        case Turn(towards=str() as name):
            named.append(("towards", name))
        case TurnHead(at=str() as name):
            named.append(("at", name))
        case Walk(face=str() as name):
            named.append(("face", name))
        case _:
            pass
    if action.when is not None:
        if isinstance(action.when.near, str):
            named.append(("when.near", action.when.near))
        if action.when.person is not None:
            named.append(("when.person", action.when.person))
    return named
