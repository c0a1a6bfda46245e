"""Data of the interactive plan: the room as prisms, and the sensors, for a page that computes coverage without a server.

The page (`interactive_plan.js`) computes the visibility of `twin.studies.visibility`: beams on a body, pixels per metre,
lines of sight. A solid is a stack of convex prisms: one for an upright box or cylinder (round ones to 1 %); slices of
`SLICE_M` of the convex hull for any other. Height fields are not represented.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from markupsafe import Markup
from scipy.spatial import ConvexHull, QhullError

from trackers.arrays import Array
from trackers.rig_sensors import MOST_TILT_DEG, WAIST_FROM_M
from twin.geometry.geom_hull import hull_points
from twin.instant.snapshot import RAY_GROUPS
from twin.room.building import Building
from twin.room.doorways import doorways
from twin.room.obstacles import OBSTACLE_REACH_M, obstacles_of
from twin.scenario import Scenario
from twin.scenario.housings import in_the_room
from twin.scenario.sensor_descriptions import LaserDescription
from twin.studies.devices import Constraints, KeepFreeZone
from twin.studies.spec import Coverage

SLICE_M = 0.05
"""Height of a slice of a solid that is no upright prism [m]."""
_SAME_M = 1e-6
_PLACED = {"mount", "housing", "calibration_error", "role"}
"""Fields of a sensor that belong to its placement, not to its model."""


def plan_data(
    scenario: Scenario,
    names: Sequence[str],
    building: Building,
    area: Array,
    coverage: Coverage,
    cell_m: float,
    *,
    extends: str,
    folder: Path = Path(),
    prices: Mapping[str, float | None] | None = None,
    firsts: Mapping[str, str] | None = None,
    constraints: Constraints | None = None,
    zones: Sequence[KeepFreeZone] = (),
) -> dict[str, Any]:
    """Collect the content of the page's plan, ready for JSON.

    names: the scanners and cameras on it; area (k, 2) [m]; extends: the scenario file, in `folder`, that the copied YAML
    extends; prices: of the devices that a study places, by the name of each one's first sensor, None: free; firsts: the
    first sensor of the device that each other is part of; constraints: those of the study, and its `zones` as polygons.
    """
    return {
        "area": np.round(area, 4).tolist(),
        "outline": np.round(building.outline, 4).tolist(),
        "cell_m": cell_m,
        "beams": coverage.beams,
        "px_per_m": coverage.px_per_m,
        "height_m": coverage.heights_m[-1],
        "extends": extends,
        "saved_as": (folder / "plan.yaml").as_posix(),
        "run_by": shlex.join(["twin", "run", (folder / "plan.yaml").as_posix()]),
        "name": f"{scenario.name}-plan",
        "prisms": room_prisms(building.model, building.data),
        "glass": room_prisms(building.model, building.data, glass=True),
        "sensors": [
            _sensor(scenario, name, prices or {}) | {"device": (firsts or {}).get(name, name)} for name in names
        ],
        "constraints": _constraints(constraints, zones, building),
        "waist_from_m": WAIST_FROM_M,
        "most_tilt_deg": MOST_TILT_DEG,
    }


def _constraints(constraints: Constraints | None, zones: Sequence[KeepFreeZone], building: Building) -> dict[str, Any]:
    """Return the constraints of a study, empty without one; cables with the doorways along the outline."""
    if constraints is None:
        return {"zones": []}
    cable = constraints.cable and {
        "start": list(constraints.cable.start),
        "straight": constraints.cable.along == "straight",
        "most_m": constraints.cable.most_m,
        "price_per_m": constraints.cable.price_per_m,
        "doors": [[*each.span_m, each.top_m] for each in doorways(building) if each.span_m and np.isfinite(each.top_m)],
    }
    return {
        "zones": [
            {"name": each.name, "corners": each.polygon, "from_m": each.from_m, "to_m": each.to_m} for each in zones
        ],
        "budget": constraints.budget,
        "apart_m": constraints.apart_m,
        "cable": cable,
        "walked_below_m": constraints.walked_below_m,
        "walkable": np.round(building.walkable.corners, 4).tolist(),
        "obstacles": [np.round(each.corners, 4).tolist() for each in obstacles_of(building.model)],
        "obstacle_reach_m": OBSTACLE_REACH_M,
    }


def section(plan: dict[str, Any]) -> dict[str, Any]:
    """Return the variables of the template `interactive_plan.html.j2`, from `plan_data`."""
    folder = Path(__file__).parent
    scripts = [(folder / name).read_text("utf-8") for name in ("interactive_plan.js", "interactive_plan_view.js")]
    return {
        "plan": plan,
        "plan_json": Markup(json.dumps(plan, allow_nan=False).replace("<", "\\u003c")),
        "plan_scripts": Markup("\n".join(scripts)),
        "priced": any(each["price"] is not None for each in plan["sensors"]),
    }


def room_prisms(model: mujoco.MjModel, data: mujoco.MjData, *, glass: bool = False) -> list[dict[str, Any]]:
    """Return the prisms of all geoms that rays meet, or pass: `z` (low, high) and `corners` (k, 2), counter-clockwise [m].

    `data` needs kinematics. Geoms without volume are left out.
    """
    prisms = []
    for geom in range(model.ngeom):
        if model.geom_rgba[geom, 3] == 0 or bool(RAY_GROUPS[model.geom_group[geom]]) == glass:
            continue
        points = hull_points(model, data, geom)
        if points is None:
            continue
        low, high = points[:, 2].min(), points[:, 2].max()
        ends = np.minimum(points[:, 2] - low, high - points[:, 2])
        if (ends < _SAME_M).all():
            prisms.append(_prism(low, high, points[:, :2]))
            continue
        try:
            hull = ConvexHull(points)
        except QhullError:
            continue
        edges = points[np.unique(np.sort(hull.simplices[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)), axis=0)]
        count = max(1, round((high - low) / SLICE_M))
        levels = np.linspace(low, high, count + 1)
        for bottom, top in pairwise(levels.tolist()):
            prisms.append(_prism(bottom, top, _cut(edges, (bottom + top) / 2)))
    return [each for each in prisms if each is not None]


def _cut(edges: Array, level_m: float) -> Array:
    """Return the points (k, 2) [m] at which edges (n, 2, 3) cross a level."""
    start, end = edges[:, 0], edges[:, 1]
    crosses = (start[:, 2] - level_m) * (end[:, 2] - level_m) <= 0
    start, end = start[crosses], end[crosses]
    rise = end[:, 2] - start[:, 2]
    share = np.divide(level_m - start[:, 2], rise, out=np.zeros_like(rise), where=rise != 0)
    return start[:, :2] + share[:, None] * (end - start)[:, :2]


def _prism(low_m: float, high_m: float, points: Array) -> dict[str, Any] | None:
    """Return the prism over the convex hull of points (n, 2) [m]; None without area."""
    try:
        corners = points[ConvexHull(points).vertices]
    except (QhullError, ValueError):  # collinear, or fewer than three
        return None
    return {"z": [round(float(low_m), 4), round(float(high_m), 4)], "corners": np.round(corners, 4).tolist()}


def _sensor(scenario: Scenario, name: str, prices: Mapping[str, float | None]) -> dict[str, Any]:
    """Return a sensor: its mount, the pose of its own frame in that of the mount, its field, and its description."""
    description = in_the_room(scenario, name)
    assert hasattr(description, "mount")
    mount = description.mount
    held, own = mount.room_from_housing(), description.rig_sensor(name).room_from_sensor
    rotation = held.rotation.T @ own.rotation
    offset = held.rotation.T @ (own.translation - held.translation)
    if isinstance(description, LaserDescription):
        field: dict[str, Any] = {
            "field_of_view_deg": description.field_of_view_deg,
            "beams": description.n_beam,
            "range_max_m": description.range_max_m,
        }
    else:
        field = {"intrinsics": description.intrinsics().model_dump(mode="json")}
    return {
        "name": name,
        "kind": description.kind,
        "role": getattr(description, "role", None),
        "is_housed": getattr(scenario.sensors[name], "housing", None) is not None,
        "is_device": name in prices,
        "price": prices.get(name),
        "xyz": list(mount.xyz),
        "yaw_deg": mount.yaw_deg,
        "pitch_deg": mount.pitch_deg,
        "roll_deg": mount.roll_deg,
        "mount_from_sensor": {"rotation": np.round(rotation, 9).tolist(), "offset_m": np.round(offset, 6).tolist()},
        "field": field,
        "model": description.model_dump(mode="json", exclude_none=True, exclude=_PLACED),
    }
