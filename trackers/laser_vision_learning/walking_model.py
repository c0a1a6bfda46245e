"""State of every track, and the two-feet walking model: motion of a person's particles, and their legs in a scanner's plane.

State (x, y, θ, v, φ): ground point under the pelvis [m], heading [rad], speed ≥ 0 [m/s], phase of the stride in [0, 1). One foot
stands while the other swings past it: seen from the body, a leg goes evenly from before it to behind it while it stands and
back while it swings, the other leg the other way round. With the length of a step l = c √v and the legs' reach a = s l / 2 at
the height of the scanner,

    left leg  = p + a(v) τ(φ) h + w n      right leg = p − a(v) τ(φ) h − w n      φ' = φ + v T / (2 l(v))

h the unit vector along the heading, n that to its left, τ the triangle wave from 1 (φ = 0) to −1 (φ = ½) and back: half a
stride is one step (Shao et al., IROS 2007, and Zhao and Shibasaki, 2005, have two feet that alternate so; the shape of the
wave and the constants are ours).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from pydantic import Field

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.configuration import Strict
from trackers.filters.gating import distances
from trackers.filters.particle import Cloud
from trackers.filters.rows import Rows, written
from trackers.tracking.roster import NEVER_NS, Roster

STATE_SIZE = 5
X, Y, HEADING, SPEED, PHASE = range(STATE_SIZE)


class WalkingOptions(Strict):
    """Options of the two-feet walking model."""

    step: float = Field(
        default=0.62, gt=0, description="length of a step at 1 m/s [m]; it grows with the root of the speed (ours)"
    )
    reach_share: float = Field(
        default=0.7,
        ge=0,
        le=1,
        description="how far the legs come apart at the scanner's height, as a share of the step on the floor (ours)",
    )
    half_width_m: ClassVar[float] = 0.09
    """Half the lateral distance between the legs [m] (ours)."""
    acceleration_m_s2: float = Field(
        default=0.7, gt=0, description="random walk of the speed: its standard deviation after a second [m/s] (ours)"
    )
    turn_rad: float = Field(
        default=0.6,
        gt=0,
        description="random walk of the heading: its standard deviation after a second at speed [rad] (ours)",
    )
    turn_slow_rad: float = Field(
        default=4.0,
        ge=0,
        description="what that is more for a standing person, fading over 0.5 m/s [rad] (ours)",
    )
    turn_about: float = Field(
        default=2.0, ge=0, description="how often people turn about, to any heading [1/s]; 0: never at once (ours)"
    )
    drift_m: float = Field(
        default=0.08,
        ge=0,
        description="random walk of the place besides the walk: its standard deviation after a second [m] (ours)",
    )
    phase: float = Field(
        default=0.35,
        ge=0,
        description="random walk of the phase: its standard deviation after a second of walking, in strides (ours)",
    )
    speed_start_m_s: ClassVar[float] = 1.0
    """Standard deviation of a new person's speed [m/s] (ours)."""
    place_start_m: ClassVar[float] = 0.12
    """Standard deviation of a new person's position on each axis [m] (ours)."""
    apart_m: float = Field(
        default=0.5,
        ge=0,
        description="distance within which two people hardly come of one another, from axis to axis [m]; 0: they may be in one "
        "place (ours)",
    )
    slowdown_s: float = Field(
        default=0.7, gt=0, description="time constant at which the speed of who is not seen fades [s] (ours)"
    )


class WalkingModel:
    """The model as a proposal, which moves particles of n people, batched."""

    def __init__(self, options: WalkingOptions) -> None:
        self.options = options

    def start(self, place: Float[Array, "n 2"], n_particle: int, rng: np.random.Generator) -> Float[Array, "5 n p"]:
        """Draw particles of people first measured at `place` [m]: any heading and phase, any walking speed."""
        options, shape = self.options, (len(place), n_particle)
        state = np.empty((STATE_SIZE, *shape))
        state[:2] = place.T[..., None] + options.place_start_m * rng.standard_normal((2, *shape))
        state[HEADING] = rng.uniform(-np.pi, np.pi, shape)
        state[SPEED] = np.abs(options.speed_start_m_s * rng.standard_normal(shape))
        state[PHASE] = rng.random(shape)
        return state

    def move(
        self, state: Float[Array, "5 n p"], elapsed_s: float, missed: Float[Array, "n"], rng: np.random.Generator
    ) -> Float[Array, "5 n p"]:
        """Return the particles `elapsed_s` later; missed: 1 for people missed by the last scan, who are likelier to stop,
        else 0.
        """
        options, root = self.options, np.float32(np.sqrt(elapsed_s))
        noise = rng.standard_normal(state.shape, dtype=np.float32)
        noise *= root
        _, _, heading, speed, phase = state
        # changes in single precision, many times faster and exact far below a millimetre; their sums in double
        before = (speed * np.exp(-elapsed_s / options.slowdown_s * missed)[:, None]).astype(np.float32)
        after = np.abs(before + options.acceleration_m_s2 * noise[SPEED])
        mean = np.float32(0.5) * (before + after)
        turned = (options.turn_rad + options.turn_slow_rad * np.exp(-2 * mean)) * noise[HEADING]
        about = rng.random(mean.shape, dtype=np.float32)
        chance = max(options.turn_about * elapsed_s, 1e-12)
        turned += np.where(about < chance, np.float32(2 * np.pi / chance) * about, np.float32(0))
        moved = np.empty_like(state)
        np.add(heading, turned, out=moved[HEADING])
        way = moved[HEADING].astype(np.float32)
        travelled, drift = np.float32(elapsed_s) * mean, np.float32(options.drift_m)
        np.add(state[X], travelled * np.cos(way) + drift * noise[X], out=moved[X])
        np.add(state[Y], travelled * np.sin(way) + drift * noise[Y], out=moved[Y])
        moved[SPEED] = after
        # half a stride is a step: v T / (2 c √v)
        strides = np.sqrt(mean) * np.float32(elapsed_s / (2 * options.step))
        strides += np.float32(options.phase) * noise[PHASE] * np.minimum(mean, 1)
        np.add(phase, strides, out=moved[PHASE])
        moved[PHASE] -= np.floor(moved[PHASE])
        moved[HEADING] -= (2 * np.pi) * np.rint(moved[HEADING] / (2 * np.pi))
        return moved

    def legs(self, state: Float[Array, "5 *batch"]) -> Float[Array, "2 2 *batch"]:
        """Return the left and the right leg at the scanner's height: (side, x or y, ...) [m]."""
        options = self.options
        heading, speed, phase = state[HEADING:].astype(np.float32)
        cos, sin, half_width = np.cos(heading), np.sin(heading), np.float32(options.half_width_m)
        reach = np.float32(0.5 * options.reach_share * options.step)
        ahead = reach * np.sqrt(speed) * (4 * np.abs(phase - np.float32(0.5)) - 1)
        off_x = ahead * cos - half_width * sin
        off_y = ahead * sin + half_width * cos
        legs = np.empty((2, 2, *state.shape[1:]))
        np.add(state[X], off_x, out=legs[0, 0])
        np.add(state[Y], off_y, out=legs[0, 1])
        np.subtract(state[X], off_x, out=legs[1, 0])
        np.subtract(state[Y], off_y, out=legs[1, 1])
        return legs


_SQUEEZED_M = 0.1
"""Standard deviation of how much nearer than `apart_m` people come [m]."""
_NEAR = 2.5
"""Greatest distance of people whose particles may come near one another, in the distance they keep."""


def log_apart(
    state: Float[Array, "5 n p"], places: Float[Array, "n 2"], pairs: Bool[Mask, "n n"], apart_m: float
) -> Float[Array, "n p"]:
    """Return ln ψ of each particle: bodies take up room, so that two people are not where only one has room.

    ψ = Π exp(−½ max(0, a − d)² / s²) over the others that a person makes `pairs` with, d the particle's distance from where
    the other is expected, a = `apart_m`: the Markov random field of Khan, Balch and Dellaert (PAMI 27, 2005) with the others
    at their `places` [m].
    """
    log_psi = np.zeros(state.shape[1:])
    one, other = np.nonzero(pairs & (distances(places, places) < _NEAR * apart_m))
    away = np.hypot(state[X, one] - places[other, 0, None], state[Y, one] - places[other, 1, None])
    np.add.at(log_psi, one, -0.5 * (np.maximum(apart_m - away, 0.0) / _SQUEEZED_M) ** 2)
    return log_psi


@dataclass(frozen=True, eq=False)
class WalkerTracks(Rows):
    """n tracks, oldest first."""

    serial: Int[Index, "n"]  # number in the order of starts; unlike identities it never changes
    roster: Roster[Cloud]
    missing_s: Float[
        Array, "n"
    ]  # time in which they should have been detected and were not, less that of detections since
    pictured_ns: Int[Index, "n"]  # stamp of the last measurement by a camera's detection; before any: `NEVER_NS`
    alone_ns: Int[Index, "n"]  # stamp at which the track was merged with no other last

    @classmethod
    def started(cls, state: Cloud, ns: int, first: int) -> Self:
        """Make tentative tracks in `state`, first measured at stamp ns, numbered from `first` on."""
        n = len(state)
        return cls(first + np.arange(n), Roster.started(state, ns), np.zeros(n), np.full(n, NEVER_NS), np.full(n, ns))

    @property
    def cloud(self) -> Cloud:
        """Particles of all tracks."""
        return self.roster.state

    @property
    def places(self) -> Float[Array, "n 2"]:
        """Mean positions [m]."""
        return self.cloud.expectation(self.cloud.state[:2]).T

    @property
    def velocities(self) -> Float[Array, "n 2"]:
        """Mean velocities [m/s]."""
        heading, speed = self.cloud.state[[HEADING, SPEED]].astype(np.float32)
        return self.cloud.expectation(np.stack([speed * np.cos(heading), speed * np.sin(heading)])).T

    def continued_as(self, track: Int[Index, "p"], other: Int[Index, "p"]) -> Self:
        """Return the tracks with those at `track` moved to the states of those at `other`, which have turned out to be the
        same.
        """
        roster, source = self.roster, self.roster.select(other)
        roster = roster.changed(
            state=roster.state.replaced(track, source.state),
            measured_ns=written(roster.measured_ns, track, source.measured_ns),
        )
        return self.changed(roster=roster, missing_s=written(self.missing_s, track, self.missing_s[other]))
