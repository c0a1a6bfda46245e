"""Assignment of a rig's scanners to waist and knee height."""

from __future__ import annotations

from collections.abc import Sequence

from trackers.errors import InputError
from trackers.rig import LaserSensor, Rig, Role


def scanners_by_role(rig: Rig, wanted: Sequence[Role]) -> dict[Role, tuple[str, ...]]:
    """Return the names of the scanners for each `wanted` role that the rig can fill, waist first.

    A scanner's own `role` counts; one without is a waist scanner from 0.7 m up and a knee scanner below. At exactly 0 its
    height is unknown, and it is a knee scanner if one is wanted. Several of one role are ordered by name, but the rig's main
    sensor comes first. Raises InputError if no wanted role can be filled.
    """
    lasers = rig.lasers()
    found: dict[Role, tuple[str, ...]] = {}
    for name in sorted(lasers, key=lambda name: (name != rig.main_sensor, name)):
        role = _role(lasers[name], wanted)
        if role in wanted:
            found[role] = (*found.get(role, ()), name)
    if not found:
        there = ", ".join(
            f"{name} ({laser.role or f'at {laser.room_from_sensor.xyz[2]} m'})" for name, laser in lasers.items()
        )
        raise InputError(
            f"the rig has no laser scanner for {' or '.join(wanted)} height: {there or 'no laser at all'}; "
            f"a sensor of kind 'laser' with role {' or '.join(wanted)} is needed"
        )
    return {role: found[role] for role in ("waist", "knee") if role in found}


def _role(laser: LaserSensor, wanted: Sequence[Role]) -> Role:
    unknown = laser.role is None and laser.room_from_sensor.xyz[2] == 0
    return "waist" if unknown and "knee" not in wanted else laser.layer
