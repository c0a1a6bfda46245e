"""Trunk, arms, hands, legs and feet as surfaces, each in the frame of its segment.

Girths are those of a clothed adult of 1.75 m and average build [m], near the medians of adults (circumferences: chest 0.98
m, waist 0.88, hips 1.0, thigh 0.55, calf 0.37, upper arm 0.32). They scale with stature and build (ours).
"""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array
from twin.people.body.proportions import Proportions
from twin.people.body.surfaces import Surface, cord, ellipsoid, limb, loft, rings

# trunk: height as a share of waist to shoulder; x of the middle, half depth, half breadth [m]
_TRUNK = np.array(
    [
        (-0.200, -0.005, 0.118, 0.169),
        (-0.150, -0.004, 0.117, 0.166),
        (-0.050, 0.001, 0.114, 0.157),
        (0.130, 0.004, 0.111, 0.149),
        (0.360, 0.003, 0.113, 0.154),
        (0.580, 0.000, 0.117, 0.169),
        (0.740, -0.002, 0.115, 0.184),
        (0.860, -0.006, 0.104, 0.192),
        (0.945, -0.011, 0.090, 0.188),
        (1.000, -0.014, 0.078, 0.166),
        (1.050, -0.016, 0.068, 0.124),
        (1.105, -0.016, 0.066, 0.090),
        (1.135, -0.014, 0.063, 0.070),
    ]
)
_HEM_ADDS_M = 0.010


class Girths:
    """Surfaces of one body; `girth`: scale of all breadths, `build`: breadth beyond what stature explains."""

    def __init__(self, lengths: Proportions, girth: float, build: float) -> None:
        self.lengths = lengths
        self.girth = girth
        self._build = build
        self.trunk_length = lengths.shoulder_height - lengths.waist_height
        self._sections = _TRUNK.copy()
        # a broad body is broadest, and comes forward most, at the belly
        belly = np.exp(-(((_TRUNK[:, 0] - 0.15) / 0.42) ** 2)) * max(build - 1.0, -0.1)
        self._sections[:, 1] += 0.08 * belly
        self._sections[:, 2] += 0.09 * belly
        self._sections[:, 3] += 0.06 * belly
        # the neck does not grow with the build
        narrow = np.interp(_TRUNK[:, 0], [0.94, 1.15], [0.0, 1.0])
        self._sections[:, 2:] *= (1 - 0.6 * narrow * (1 - 1 / build))[:, None]

    def trunk(self, grow: float, tucked: bool) -> Surface:
        """Make the trunk from the hem over the hips to the neck, `grow` [m] wider than a shirt; in the trunk's frame.

        `tucked`: the hem is inside the garment on the hips, otherwise it hangs over it.
        """
        rows = np.array(self._rows(grow))
        if tucked:
            rows[:2, 3:] *= np.array([[0.75], [0.88]])
        else:
            more = _HEM_ADDS_M * self.girth * (1 + 4 * max(1 - self._build, 0.0))
            rows[:, 3:] += (more * np.interp(self._sections[:, 0], [-0.2, 0.1], [1.0, 0.0]))[:, None]
        return loft(rings(rows, 16, square=2.35))

    def _rows(self, grow: float) -> list[tuple[float, ...]]:
        g, length = self.girth, self.trunk_length
        return [(x * g, 0.0, share * length, a * g + grow, b * g + grow) for share, x, a, b in self._sections]

    def _front(self, share: Array | float, grow: float, sign: int = 1) -> Array:
        """Return x of the trunk's front (sign 1) or back (-1) at shares of waist to shoulder [m]."""
        s = self._sections
        x, a = np.interp(share, s[:, 0], s[:, 1]), np.interp(share, s[:, 0], s[:, 2])
        return np.asarray((x + sign * a) * self.girth + sign * grow)

    def _lateral(self, share: Array | float, grow: float) -> Array:
        return np.asarray(np.interp(share, self._sections[:, 0], self._sections[:, 3]) * self.girth + grow)

    def back(self, grow: float) -> float:
        """Return the distance of the back behind the trunk's middle [m]."""
        return -float(self._front(0.7, grow, -1))

    def strap_path(self, grow: float) -> Array:
        """Return the path of a backpack's left strap over the shoulder, (m, 3) [m], from the back to below the arm."""
        length, g = self.trunk_length, self.girth
        top = 1.02 * length + grow
        over = [
            (float(self._front(0.85, grow, -1)) - 0.004, 0.085 * g, 0.86 * length),
            (-0.060 * g, 0.092 * g, top - 0.012 * g),
            (-0.012 * g, 0.096 * g, top + 0.022 * g),
            (0.040 * g, 0.100 * g, top - 0.012 * g),
        ]
        down = [
            (float(self._front(share, grow)) * lean, y * g, share * length)
            for share, lean, y in ((0.86, 0.93, 0.105), (0.72, 0.94, 0.112), (0.55, 0.89, 0.125), (0.42, 0.76, 0.140))
        ]
        under = [(0.02 * g, float(self._lateral(0.33, grow)) + 0.004, 0.33 * length)]
        return np.array(over + down + under)

    def sash(self, grow: float) -> Surface:
        """Make a shoulder bag's strap: from the left shoulder across chest and back to the right hip."""
        share = np.array([-0.15, 0.10, 0.35, 0.60, 0.82, 0.95])
        y = np.interp(share, [-0.15, 0.95], [-0.150, 0.105]) * self.girth
        halves = []
        for sign in (1, -1):
            middle = np.interp(share, self._sections[:, 0], self._sections[:, 1]) * self.girth
            reach = np.abs(self._front(share, grow, sign) - middle)
            curve = (1 - np.minimum(np.abs(y) / self._lateral(share, grow), 0.97) ** 2.35) ** (1 / 2.35)
            halves.append(np.column_stack([middle + sign * (reach * curve + 0.004), y, share * self.trunk_length]))
        top = np.array([[-0.012 * self.girth, 0.108 * self.girth, 1.045 * self.trunk_length + grow]])
        side = np.array([[-0.06 * self.girth, -float(self._lateral(-0.15, grow)) + 0.01, -0.20 * self.trunk_length]])
        path = np.vstack([side, halves[0], top, halves[1][::-1], side])
        return cord(path, 0.012 * self.girth)

    def neck(self) -> Surface:
        """Make the neck from between the shoulders into the head; in the trunk's frame."""
        k = self.lengths.shoulder_width / 0.453
        low = 0.98 * self.trunk_length
        high = self.lengths.chin_height - self.lengths.waist_height + 0.016 * k
        radius = 0.31 * self.lengths.head_breadth + 0.012 * k
        return limb([(low, 1.12 * radius, 1.15 * radius, -0.012 * k), (high, radius, 0.95 * radius, -0.006 * k)], 12)

    def hips(self, grow: float, belted: bool) -> Surface:
        """Make the hips from belt to crotch; in the pelvis' frame. `belted`: closed over the shirt, not under it."""
        g = self.girth
        rise = self.lengths.waist_height - self.lengths.hip_height
        rows = [
            (-0.014, -0.066, 0.040, 0.050),
            (-0.015, -0.054, 0.076, 0.105),
            (-0.015, -0.028, 0.103, 0.146),
            (-0.012, 0.008, 0.118, 0.168),
            (-0.006, 0.050, 0.116, 0.167),
            (-0.001, 0.095, 0.107, 0.153),
            (0.002, 0.140, 0.099, 0.142),
        ]
        if belted:
            rows[:2] = [(-0.018, -0.070, 0.070, 0.095), (-0.018, -0.056, 0.097, 0.135)]
            rows[-2:] = [(-0.001, 0.095, 0.119, 0.168), (0.001, 0.135, 0.120, 0.161), (0.001, 0.139, 0.112, 0.153)]
        unit = rise / 0.1225
        section = [(x * g, 0.0, z * unit, a * g + grow, b * g + grow) for x, z, a, b in rows]
        return loft(rings(section, 14, square=2.3))

    def hip_depth(self, grow: float) -> float:
        """Return the distance of the buttocks behind the hip joints [m]."""
        return 0.130 * self.girth + grow

    def shoulder_joint(self) -> tuple[float, float, float]:
        """Return the left shoulder joint in the trunk's frame [m], inside sleeve, deltoid and acromion."""
        build = 1 + 0.75 * (self.girth * 1.75 / (self.lengths.hip_joint_width / 0.1) - 1)
        return -0.008 * self.girth, 0.415 * self.lengths.shoulder_width * build, 0.865 * self.trunk_length

    def upper_arm(self, grow: float) -> Surface:
        """Make a covered upper arm; in its own frame, the shoulder at the origin."""
        g, length = self.girth, self.lengths.upper_arm
        rows = [(-1.0, 0.041), (-0.65, 0.046), (-0.30, 0.051), (0.0, 0.053)]
        return limb([(share * length, r * g + grow, r * g * 0.95 + grow) for share, r in rows], 10)

    def short_sleeve(self) -> Surface:
        """Make a short sleeve, its open end cut level; in the upper arm's frame."""
        length, top, end = 0.58 * self.lengths.upper_arm, 0.054 * self.girth, 0.055 * self.girth
        middle = 0.5 * (top + end)
        return limb([(-length, end, end), (-0.5 * length, middle, middle), (0.0, top, top)], 10, False)

    def bare_upper_arm(self) -> Surface:
        """Make the bare part of the upper arm below a short sleeve; in the upper arm's frame."""
        g, length = self.girth, self.lengths.upper_arm
        return limb([(share * length, r * g, r * g) for share, r in ((-1.0, 0.039), (-0.7, 0.043), (-0.35, 0.046))], 10)

    def forearm(self, grow: float, covered: bool) -> Surface:
        """Make the forearm from elbow to wrist; in the forearm's frame."""
        g, length = self.girth, self.lengths.forearm
        wrist = 0.034 if covered else 0.028
        rows = [(-1.0, wrist, wrist * 0.85), (-0.6, 0.036, 0.034), (-0.22, 0.043, 0.040), (0.0, 0.039, 0.039)]
        return limb([(s * length, a * g + grow, b * g + grow) for s, a, b in rows], 10, round_low=not covered)

    def thigh(self, slim: bool) -> Surface:
        """Make the thigh from hip to knee; in the thigh's frame. `slim`: without trousers."""
        g, length = self.girth, self.lengths.thigh
        grow = -0.005 * g if slim else 0.0
        rows = [
            (-1.0, 0.063, 0.061, 0.004, 0.0),
            (-0.70, 0.074, 0.072, 0.004, 0.0),
            (-0.35, 0.086, 0.083, 0.003, 0.0),
            (-0.12, 0.095, 0.085, -0.002, 0.0),
            (0.02, 0.089, 0.080, -0.008, 0.0),
        ]
        return limb([(s * length, a * g + grow, b * g + grow, x * g, y) for s, a, b, x, y in rows], 12)

    def shank(self, slim: bool) -> Surface:
        """Make the shank from knee to ankle; in the shank's frame. `slim`: a bare calf, otherwise a trouser leg over
        the shoe."""
        g, length = self.girth, self.lengths.shank
        if slim:
            rows = [
                (-1.02, 0.037, 0.034, -0.006),
                (-0.75, 0.041, 0.038, -0.008),
                (-0.32, 0.059, 0.054, -0.010),
                (-0.12, 0.055, 0.053, -0.003),
                (0.0, 0.056, 0.055, 0.003),
            ]
        else:
            rows = [
                (-1.03, 0.056, 0.050, -0.004),
                (-0.75, 0.054, 0.050, -0.006),
                (-0.32, 0.064, 0.059, -0.008),
                (-0.12, 0.062, 0.060, -0.001),
                (0.0, 0.063, 0.061, 0.004),
            ]
        return limb([(s * length, a * g, b * g, x * g) for s, a, b, x in rows], 12, round_low=False)

    def bell(self, sign: int, hem: float, flare: float, grow: float) -> Surface:
        """Make half of a skirt or of a coat's tail; in the frame of the left (sign 1) or right (-1) thigh.

        `hem`: its end as a share of the thigh; `flare`: relative widening there; `grow`: how far it is off the hips [m]. The
        halves overlap in the middle: standing it looks closed, walking it opens like a tent, sitting it lies on the lap.
        """
        breadth, depth = 0.170 * self.girth + grow, 0.117 * self.girth + grow
        rows = []
        for share in (-0.09, 0.03, 0.35, 0.65, 0.94, 1.0):
            widened = 1 + flare * max(share, 0.0)
            outer = breadth * widened * (0.84 if share < 0 else 1.0)
            inner = -0.075 * breadth / 0.16 * (1 + 0.4 * max(share, 0.0))
            middle, half = 0.5 * (outer + inner) - self.lengths.hip_joint_width / 2, 0.5 * (outer - inner)
            height = -share * hem * self.lengths.thigh
            rows.append((-0.004, sign * middle, height, depth * widened * (0.82 if share < 0 else 1.0), half))
        return loft(rings(np.array(rows[::-1]), 14, square=2.3))


def hand(lengths: Proportions, k: float) -> Surface:
    """Make the left hand, hanging: palm to the thigh, thumb ahead, fingers half closed; in the forearm's frame."""
    wrist, span = -lengths.forearm, lengths.hand
    rows = [
        (0.010, -0.020, -1.00, 0.016, 0.009),
        (0.010, -0.017, -0.95, 0.026, 0.012),
        (0.007, -0.010, -0.78, 0.035, 0.014),
        (0.003, -0.002, -0.52, 0.042, 0.017),
        (0.002, 0.000, -0.25, 0.040, 0.018),
        (0.000, 0.000, -0.02, 0.029, 0.020),
        (0.000, 0.000, 0.10, 0.026, 0.022),
    ]
    palm = loft(rings([(x * k, y * k, wrist + z * span, a * k, b * k) for x, y, z, a, b in rows], 10, square=2.6))
    thumb = limb([(-0.052 * k, 0.011 * k, 0.011 * k), (0.0, 0.014 * k, 0.014 * k)], 8).turned(-0.42)
    return (
        palm
        + thumb.moved((0.034 * k, -0.010 * k, wrist - 0.24 * span))
        + ellipsoid((0.0, 0.0, wrist), (0.029 * k, 0.024 * k, 0.024 * k), 8)
    )


def _sole_rings(rows: Array) -> Array:
    """Make upright rings (m, 12, 3) along x, flat below and round above, from rows (m, 4): x, half breadth, top, sole
    [m].
    """
    angle = -np.pi + 2 * np.pi * (np.arange(12) + 0.5) / 12
    c, s = np.cos(angle), np.sin(angle) / np.sin(angle).max()
    across = np.sign(c) * np.abs(c) ** 0.62
    x, half, top, sole = rows.T
    edge = np.minimum(0.35 * (top - sole), 0.020 * (top - sole).max() / 0.09)
    # the lower half is squeezed to a flat sole with an edge
    above = edge[:, None] + (top - sole - edge)[:, None] * np.maximum(s, 0.0)
    below = edge[:, None] * (1 - np.abs(s) ** 0.35)
    z = sole[:, None] + np.where(s > 0, above, below)
    y = half[:, None] * across
    return np.stack([np.broadcast_to(x[:, None], y.shape), y, z], axis=-1)


def shoe(lengths: Proportions, k: float) -> Surface:
    """Make the shoe from heel to ball with its collar; in the foot's frame, the sole level and at its lowest."""
    half, ankle = 0.5 * lengths.foot_breadth, lengths.ankle_height
    heel, ball = -lengths.heel_behind_ankle, lengths.ball_before_ankle
    rows = [
        (heel, 0.40 * half, 0.045 * k),
        (heel + 0.006 * k, 0.62 * half, 0.066 * k),
        (heel + 0.022 * k, 0.76 * half, 0.080 * k),
        (0.0, 0.80 * half, 0.088 * k),
        (0.35 * ball, 0.82 * half, 0.080 * k),
        (0.68 * ball, 0.92 * half, 0.062 * k),
        (ball + 0.004 * k, 1.0 * half, 0.050 * k),
    ]
    table = np.array([(x, b, z - ankle, -ankle) for x, b, z in rows])
    return loft(_sole_rings(table))


def toe_cap(lengths: Proportions, k: float) -> Surface:
    """Make the toe cap from ball to tip; in the toes' frame, whose origin is on the sole under the ball."""
    half = 0.5 * lengths.foot_breadth
    length = lengths.shoe_length - lengths.heel_behind_ankle - lengths.ball_before_ankle
    rows = [
        (-0.012 * k, 0.96 * half, 0.048 * k, 0.0),
        (0.30 * length, 1.0 * half, 0.045 * k, 0.0),
        (0.62 * length, 0.90 * half, 0.038 * k, 0.0),
        (0.86 * length, 0.66 * half, 0.031 * k, 0.0),
        (0.97 * length, 0.38 * half, 0.024 * k, 0.0),
        (length, 0.20 * half, 0.018 * k, 0.0),
    ]
    return loft(_sole_rings(np.array(rows)))
