"""Soles on a floor as a MuJoCo model: the touching points of a foot, and the touch sensors under them.

Each foot has its own sheet of the floor: a plane that only this foot touches, with a touch sensor for every cell within its
reach, aligned to the grid. As the floor is rigid, feet do not act on each other through it, and the loads of all sheets add
up to those of one grid. A foot needs few cells, however many the grid has, and every load is known by foot.
"""

from __future__ import annotations

from math import ceil

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.instant.snapshot import FootShapes

TIMESTEP_S = 0.005
_TIME_CONSTANT_S = 0.01
_IMPEDANCE = 0.99
"""Contacts as stiff as the time step allows: under 700 N a foot sinks in by 0.05 mm."""

_MASS_KG = 1.0
_RADIUS_M = 0.01
_ZONE_M = 0.05
_SLACK_M = 1e-4
"""Greatest sideways motion of a point [m] while its foot settles (it rolls on a sphere)."""

# Points of a right sole: (along, across). Along: -1 is the heel, 0 under the ankle, 1 the ball, 2 the toes' tips.
# Across: share of half the breadth at the ball, to the left, which is inwards.
_POINTS = np.array(
    [
        (-1.0, 0.0), (-0.75, 0.55), (-0.75, -0.55), (-0.2, 0.5), (-0.2, -0.6),  # heel
        (0.4, -0.75), (0.75, -0.9),  # outer edge: the arch carries nothing
        (1.0, 0.95), (1.05, 0.3), (1.0, -0.3), (0.9, -0.95),  # ball, from the big toe's joint to the little one's
        (2.0, 0.0), (1.85, 0.65), (1.6, -0.7),  # toes
    ]
)  # fmt: skip
POINTS = len(_POINTS)
"""Points of a sole that can touch the floor."""


def sole_points(shapes: FootShapes) -> Array:
    """Return the touching points of soles of n people, (n, 2, POINTS, 2), x ahead of the ankle, y to its left [m]; left foot
    first.
    """
    along = _POINTS[:, 0]
    toes = shapes.length - shapes.heel - shapes.ball  # from the ball on
    pieces = np.stack([np.minimum(along, 0), along.clip(0, 1), np.maximum(along - 1, 0)])  # (3, POINTS)
    ahead = np.stack([shapes.heel, shapes.ball, toes], axis=1) @ pieces  # (n, POINTS)
    across = _POINTS[:, 1] * shapes.breadth[:, None] / 2
    return np.stack([np.stack([ahead, -across], axis=-1), np.stack([ahead, across], axis=-1)], axis=1)


def sheet_cells(points: Array, pitch_m: float) -> int:
    """Return the number of cells along a sheet's side, so that every sole (n, 2, POINTS, 2) [m] fits on it, however turned."""
    flat = points.reshape(-1, POINTS, 2)
    gaps = flat[:, :, None] - flat[:, None]
    return ceil((float(np.sqrt((gaps**2).sum(axis=-1).max())) + 2 * _SLACK_M) / pitch_m) + 1


def sheet_start(points: Array, pitch_m: float) -> NDArray[np.int64]:
    """Return the column and row (f, 2) of a sheet's first cell under feet whose points lie at (f, POINTS, 2) [m]."""
    return np.floor((points.min(axis=1) - _SLACK_M) / pitch_m).astype(np.int64)


def soles_model(points: Array, pitch_m: float, cells: int) -> mujoco.MjModel:
    """Build feet with soles (f, POINTS, 2) [m], each over a sheet of `cells` x `cells` touch sensors of side `pitch_m`.

    Foot k: mocap body k is its sheet (origin at the first cell's corner), mocap body f + k its carrier: the place under the
    ankle and the yaw are written there. Its three joints are free: down (slide z), heel-toe (hinge y), inwards-outwards (hinge
    x), in this order in qpos. Its sensors are row after row, cell after cell. No gravity: the weight of the foot is part of
    the load that presses it. No friction: it would carry nothing vertical.
    """
    spec = mujoco.MjSpec()
    spec.option.gravity = [0, 0, 0]
    spec.option.timestep = TIMESTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    spec.option.tolerance = 1e-12
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_WARMSTART
    for foot in range(len(points)):
        _add_sheet(spec, foot, pitch_m, cells)
    for foot, sole in enumerate(points):
        _add_foot(spec, foot, sole)
    return spec.compile()


def first_sink_m(model: mujoco.MjModel) -> Array:
    """Return how deep each foot rests [m/N] with equally loaded points, (f,), as a good start.

    From MuJoCo's soft contacts: force = impedance · stiffness · depth / regularisation (manual, "Solver parameters").
    """
    feet = model.body_mocapid >= model.nmocap // 2
    weight_inverse = model.body_invweight0[np.flatnonzero(feet) + 1, 0]  # a carrier is followed by its foot
    return (1 - _IMPEDANCE) * weight_inverse * _TIME_CONSTANT_S**2 / POINTS


def _add_sheet(spec: mujoco.MjSpec, foot: int, pitch_m: float, cells: int) -> None:
    sheet = spec.worldbody.add_body(name=f"sheet{foot}", mocap=True)
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    sheet.add_geom(name=f"sheet{foot}", type=plane, size=[0, 0, 1], contype=0, conaffinity=0)
    half = pitch_m / 2
    for row in range(cells):
        for column in range(cells):
            cell = sheet.add_site(
                name=f"cell{foot}.{row}.{column}",
                type=mujoco.mjtGeom.mjGEOM_BOX,
                pos=[(column + 0.5) * pitch_m, (row + 0.5) * pitch_m, 0],
                size=[half, half, _ZONE_M],
            )
            spec.add_sensor(type=mujoco.mjtSensor.mjSENS_TOUCH, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=cell.name)


def _add_foot(spec: mujoco.MjSpec, foot: int, sole: Array) -> None:
    carrier = spec.worldbody.add_body(name=f"carrier{foot}", mocap=True)
    body = carrier.add_body(name=f"foot{foot}")
    body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[1, 0, 0])
    length, breadth = np.ptp(sole, axis=0)
    thickness = 2 * _RADIUS_M
    body.explicitinertial = True
    body.mass = _MASS_KG
    body.ipos = [sole[:, 0].mean(), 0, 0]
    square = np.array([length, breadth, thickness]) ** 2  # a slab's
    body.inertia = _MASS_KG / 12 * (square.sum() - square)
    for number, (x, y) in enumerate(sole):
        point = body.add_geom(
            name=f"foot{foot}.{number}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[_RADIUS_M, 0, 0],
            pos=[x, y, _RADIUS_M],
            contype=0,
            conaffinity=0,
        )
        spec.add_pair(
            geomname1=f"sheet{foot}",
            geomname2=point.name,
            condim=1,
            solref=[_TIME_CONSTANT_S, 1],
            solimp=[_IMPEDANCE, _IMPEDANCE, 0.001, 0.5, 2],
        )
