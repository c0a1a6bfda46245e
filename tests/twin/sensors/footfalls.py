"""Feet for the floor's tests: people who stand anywhere, walk heel to toe, or are not there."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

from twin.instant.snapshot import Feet, FootShapes, Snapshot


def soles(people: int, stature_m: float = 1.75) -> FootShapes:
    """Soles of people of this stature, by the proportions of Drillis and Contini."""
    return FootShapes(
        heel=np.full(people, 0.040 * stature_m),
        ball=np.full(people, 0.070 * stature_m),
        length=np.full(people, 0.152 * stature_m),
        breadth=np.full(people, 0.055 * stature_m),
    )


def standing(
    middle: np.ndarray, yaw: np.ndarray, weight_n: np.ndarray, left: np.ndarray, ahead_m: np.ndarray, gap_m: float = 0.2
) -> Feet:
    """People (n,) on both feet beside their middles (n, 2); `left`: share of the weight on the left foot."""
    sideways = np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1)
    return Feet(
        place=np.stack([middle + sideways * gap_m / 2, middle - sideways * gap_m / 2], axis=1),
        yaw=np.stack([yaw, yaw], axis=1),
        height=np.zeros((len(yaw), 2)),
        load_n=np.stack([weight_n * left, weight_n * (1 - left)], axis=1),
        pressure_ahead_m=np.stack([ahead_m, ahead_m], axis=1),
        present=np.ones(len(yaw), dtype=bool),
    )


def somewhere(rng: np.random.Generator, people: int, low: tuple[float, float], high: tuple[float, float]) -> Feet:
    """People who stand at random places between two corners [m], turned and loaded at random."""
    return standing(
        rng.uniform(low, high, (people, 2)),
        rng.uniform(-np.pi, np.pi, people),
        rng.uniform(200, 1200, people),
        rng.uniform(0.05, 0.95, people),
        rng.uniform(-0.04, 0.12, people),
    )


def walking(t: float, weight_n: float = 700.0, y: float = 1.3) -> Feet:
    """One person walking along x at 1.2 m/s: a step each 0.5 s, 62 % of the stride on each foot, two humps, heel to toe."""
    stride_s, stride_m, stance = 1.0, 1.2, 0.62
    phase = np.array([t, t - stride_s / 2]) / stride_s
    number, within = np.floor(phase), phase % 1.0
    share = within / stance
    on_floor = share < 1
    curve = np.sin(np.pi * share) + 0.35 * np.sin(3 * np.pi * share)
    load_n = np.where(on_floor, weight_n * np.maximum(curve, 0) * 1.05, 0.0)
    landed_m = 0.3 + stride_m * (number + np.array([0.0, 0.5]))
    return Feet(
        place=np.stack([landed_m, y + np.array([0.05, -0.05])], axis=-1)[None],
        yaw=np.zeros((1, 2)),
        height=np.where(on_floor, 0.0, 0.05)[None],
        load_n=load_n[None],
        pressure_ahead_m=(-0.05 + 0.21 * np.clip(share, 0, 1))[None],
        present=np.ones(1, dtype=bool),
    )


def moved(feet: Feet, xy: tuple[float, float], yaw: float) -> Feet:
    """The feet as they lie in the room if they were seen from a frame at `xy`, turned by `yaw`."""
    rotation = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return replace(feet, place=feet.place @ rotation.T + xy, yaw=feet.yaw + yaw)


@dataclass(eq=False)
class WalkedWorld:
    """A world of which nothing but a walker's feet is there; `empty`: before anybody enters."""

    empty: bool = False
    model: mujoco.MjModel = field(default_factory=lambda: mujoco.MjModel.from_xml_string("<mujoco/>"))

    def snapshot(self, t: float) -> Snapshot:
        data = mujoco.MjData(self.model)
        owner = np.zeros(0, dtype=np.int16)
        return Snapshot(t, self.model, data, owner, feet=None if self.empty else walking(t + 0.3))
