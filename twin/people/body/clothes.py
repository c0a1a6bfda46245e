"""Clothes that hang: skirts, the tails of coats, bags; each moves with one segment of the body.

Cloth neither folds nor swings. A skirt or a coat below the hips is two bells, one on each thigh, that reach over the
middle and so into one another: standing it looks closed, walking it opens like a tent, sitting it lies on the lap. To a
scanner it is one thing, half a metre broad, where it hangs; the skirt ends over the knee and the coat at the middle of
the thigh, so that at the height of the shins there are two legs. Long skirts, which would hide the legs from a scanner at
knee height, are not in the wardrobe.
"""

from __future__ import annotations

import numpy as np

from twin.people.body.surfaces import Surface, cord, limb, loft, rings

SKIRT_HEM = 0.97
"""Where a skirt ends, as a share of the thigh from the hip."""
COAT_HEM = 0.74
"""Where a coat ends, as a share of the thigh from the hip."""


def bell(sign: int, thigh: float, hip_aside: float, breadth: float, depth: float, hem: float, flare: float) -> Surface:
    """Half of a skirt, around the left (sign 1) or right (-1) thigh, in the thigh's frame.

    `thigh`: its length; `hip_aside`: from the middle of the body to the hip joint; `breadth`, `depth`: half breadth and
    half depth of the hips with the cloth on [m]; `hem`: where it ends as a share of the thigh; `flare`: how much wider
    it is there, as a share.
    """
    rows = []
    for share in (-0.09, 0.03, 0.35, 0.65, 0.94, 1.0):
        grow = 1 + flare * max(share, 0.0)
        outer = breadth * grow * (0.84 if share < 0 else 1.0)
        inner = -0.075 * breadth / 0.16 * (1 + 0.4 * max(share, 0.0))
        middle, half = 0.5 * (outer + inner) - hip_aside, 0.5 * (outer - inner)
        rows.append((-0.004, sign * middle, -share * hem * thigh, depth * grow * (0.82 if share < 0 else 1.0), half))
    return loft(rings(np.array(rows[::-1]), 14, square=2.3))


def backpack(trunk: float, depth: float, k: float) -> Surface:
    """On the back, in the trunk's frame: `trunk` from waist to shoulder, `depth` of the back behind its middle [m]."""
    rows = [
        (-depth - 0.055 * k, 0, 0.10 * trunk, 0.045 * k, 0.105 * k),
        (-depth - 0.070 * k, 0, 0.13 * trunk, 0.075 * k, 0.130 * k),
        (-depth - 0.072 * k, 0, 0.50 * trunk, 0.080 * k, 0.135 * k),
        (-depth - 0.058 * k, 0, 0.86 * trunk, 0.065 * k, 0.125 * k),
        (-depth - 0.045 * k, 0, 0.97 * trunk, 0.038 * k, 0.085 * k),
    ]
    pocket = [
        (-depth - 0.140 * k, 0, 0.17 * trunk, 0.020 * k, 0.085 * k),
        (-depth - 0.145 * k, 0, 0.22 * trunk, 0.030 * k, 0.095 * k),
        (-depth - 0.145 * k, 0, 0.45 * trunk, 0.030 * k, 0.095 * k),
        (-depth - 0.140 * k, 0, 0.50 * trunk, 0.020 * k, 0.085 * k),
    ]
    return loft(rings(rows, 14, square=3.5)) + loft(rings(pocket, 12, square=3.5))


def over_the_shoulder(front: np.ndarray, k: float, sign: int) -> Surface:
    """One strap of a backpack; `front` (m, 3): where the chest's surface is from the top down, left side [m]."""
    return cord(front * (1, sign, 1), 0.013 * k)


def shoulder_bag(k: float) -> Surface:
    """A bag worn behind the hip, flat against the body, about its middle."""
    rows = [
        (0, 0, -0.105 * k, 0.030 * k, 0.115 * k),
        (0, 0, -0.095 * k, 0.042 * k, 0.135 * k),
        (0, 0, 0.060 * k, 0.036 * k, 0.130 * k),
        (0, 0, 0.095 * k, 0.022 * k, 0.115 * k),
    ]
    return loft(rings(rows, 14, square=4.0))


def handbag(k: float) -> Surface:
    """A bag that hangs from the fist at the origin: two handles and the bag below."""
    rows = [
        (0, 0, -0.300 * k, 0.130 * k, 0.045 * k),
        (0, 0, -0.285 * k, 0.145 * k, 0.055 * k),
        (0, 0, -0.190 * k, 0.130 * k, 0.045 * k),
        (0, 0, -0.115 * k, 0.105 * k, 0.020 * k),
    ]
    bag = loft(rings(rows, 14, square=4.0))
    turn = np.linspace(0, np.pi, 9)
    handle = np.column_stack([0.065 * k * np.cos(turn), 0 * turn, -0.125 * k + 0.120 * k * np.sin(turn)])
    apart = np.array([0, 0.010 * k, 0])
    return bag + cord(handle + apart, 0.006 * k) + cord(handle - apart, 0.006 * k)


def sleeve(length: float, top: float, end: float) -> Surface:
    """A short sleeve around the upper arm, its open end cut level [m]."""
    return limb(
        [(-length, end, end), (-0.5 * length, 0.5 * (top + end), 0.5 * (top + end)), (0.0, top, top)], 10, False
    )
