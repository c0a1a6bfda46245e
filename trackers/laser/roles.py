"""Which scanner of a rig looks at waists and which at knees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from trackers.errors import InputError
from trackers.rig import LaserSensor, Rig

Role = Literal["waist", "knee"]

WAIST_FROM_M = 0.7
"""A scanner without a role mounted at least this high [m] is taken for a waist scanner."""


def scanners_by_role(rig: Rig, wanted: Sequence[Role]) -> dict[Role, str]:
    """The name of the scanner for each of the `wanted` roles that the rig can fill, one a role, waist first.

    A scanner's own `role` counts; one without is a waist scanner from 0.7 m up and a knee scanner below; at exactly 0 its
    height is unknown, and it is taken for a knee scanner where one is wanted. Of several with one role the first counts.
    Raises InputError where no wanted role can be filled.
    """
    lasers = rig.lasers()
    found: dict[Role, str] = {}
    stated_first = sorted(lasers.items(), key=lambda item: item[1].role is None)  # a stable sort
    for name, laser in stated_first:
        role = laser.role or _role_by_height(laser, wanted)
        if role in wanted:
            found.setdefault(role, name)
    if not found:
        there = ", ".join(
            f"{name} ({laser.role or f'at {laser.room_from_sensor.xyz[2]} m'})" for name, laser in lasers.items()
        )
        raise InputError(
            f"the rig has no laser scanner for {' or '.join(wanted)} height: {there or 'no laser at all'}; "
            f"a sensor of kind 'laser' with role {' or '.join(wanted)} is needed"
        )
    return {role: found[role] for role in ("waist", "knee") if role in found}


def _role_by_height(laser: LaserSensor, wanted: Sequence[Role]) -> Role:
    height_m = laser.room_from_sensor.xyz[2]
    if height_m == 0:
        return "knee" if "knee" in wanted else "waist"
    return "waist" if height_m >= WAIST_FROM_M else "knee"
