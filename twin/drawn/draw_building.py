"""Drawn building: plan, furniture and free floor, and its pose in the room frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np

from trackers.arrays import Array
from twin.drawn.distributions import DrawnRoom
from twin.drawn.draw_furniture import Geom, Piece, draw_furniture, draw_pillars
from twin.drawn.floor_plan import DOOR_M, PARTITION_M, FloorPlan, FreeSpace, Wall, draw_floor_plan
from twin.streams import stream

_DOOR_HIGH_M = 2.05
_SKIRTING_M = 0.008

_FLOORS = (
    ("0.46 0.48 0.50", "0.43 0.45 0.475", "0.36 0.38 0.41"),  # carpet tiles
    ("0.58 0.45 0.32", "0.52 0.40 0.28", "0.44 0.33 0.22"),  # parquet
    ("0.62 0.62 0.60", "0.57 0.57 0.55", "0.50 0.50 0.49"),  # stone
    ("0.34 0.42 0.46", "0.31 0.39 0.43", "0.26 0.33 0.37"),  # linoleum
)
_PAINTS = ("0.89 0.89 0.87", "0.90 0.86 0.78", "0.78 0.83 0.86", "0.80 0.86 0.78", "0.86 0.80 0.80")
_WOODS = ("0.62 0.47 0.32", "0.45 0.32 0.22", "0.78 0.70 0.58", "0.82 0.82 0.81")
_CLOTHS = ("0.22 0.31 0.45", "0.45 0.24 0.20", "0.33 0.36 0.33", "0.55 0.50 0.42")
_FURNITURE = ("0.80 0.81 0.81", "0.55 0.57 0.58", "0.66 0.58 0.46", "0.36 0.42 0.48")
_BOOKS = ("0.20 0.30 0.46", "0.22 0.38 0.32", "0.50 0.16 0.18")


@dataclass(frozen=True)
class Placement:
    """Pose of the plan in the room frame: turned by `turn` [rad] about its middle, the room's origin."""

    middle: tuple[float, float]
    turn: float

    def to_room(self, places: Array) -> Array:
        """Return places (n, 2) of the plan in the room frame [m], to the millimetre."""
        cos, sin = np.cos(self.turn), np.sin(self.turn)
        turned = (places - np.array(self.middle)) @ np.array([[cos, sin], [-sin, cos]])
        return np.round(turned, 3) + 0.0


def room_mjcf(
    name: str,
    plan: FloorPlan,
    area: Array,
    pieces: Sequence[Piece],
    placement: Placement,
    is_dim: bool,
    rng: np.random.Generator,
) -> str:
    """Write the building as MJCF; `area` (k, 2): walkable area in the plan [m]. `rng` draws colours, windows and lights."""
    chosen = {key: str(rng.choice(list(options))) for key, options in
              (("paint", _PAINTS), ("wood", _WOODS), ("cloth", _CLOTHS), ("furniture", _FURNITURE))}  # fmt: skip
    floor = _FLOORS[int(rng.integers(len(_FLOORS)))]
    extent = float(np.hypot(*plan.size_m)) / 2
    turn = f"{np.degrees(placement.turn):.6g}"
    x, y = (-np.array(placement.middle)).tolist()
    length, width = plan.size_m
    lines = [
        f"<mujoco model={quoteattr(name)}>",
        '  <compiler angle="degree"/>',
        f'  <statistic center="0 0 1.2" extent="{max(extent, 3):.3g}"/>',
        "  <visual>",
        '    <headlight active="0"/>',
        '    <global offwidth="2048" offheight="2048"/>',
        '    <quality offsamples="0" numslices="20" numstacks="12" numquads="1"/>',
        '    <rgba haze="0.75 0.82 0.88 1"/>',
        "  </visual>",
        "  <custom>",
        f'    <numeric name="walkable_area" data="{" ".join(f"{x:g} {y:g}" for x, y in placement.to_room(area))}"/>',
        "  </custom>",
        "  <default>",
        '    <geom group="0" contype="0" conaffinity="0"/>',
        '    <site group="5" size="0.02"/>',
        "  </default>",
        *_assets(chosen, floor),
        "  <worldbody>",
        *_lights(is_dim, rng),
        f'    <geom name="floor" type="plane" size="{length / 2 + 0.2:.3f} {width / 2 + 0.2:.3f} 0.5" euler="0 0 {turn}" '
        'material="floor" contype="1" conaffinity="1"/>',
        f'    <geom name="ceiling" type="plane" pos="0 0 {plan.height_m:g}" size="{length / 2:.3f} {width / 2:.3f} 0.5" '
        f'xyaxes="{_axes(placement.turn)}" material="ceiling"/>',
        f'    <frame euler="0 0 {turn}"><frame pos="{x:.4f} {y:.4f} 0">',
        *_shell(plan, rng),
        *_partitions(plan),
        *(line for number, piece in enumerate(pieces, start=1) for line in _piece(piece, number)),
        "    </frame></frame>",
        "  </worldbody>",
        "</mujoco>",
    ]
    return "\n".join(lines) + "\n"


def _axes(turn: float) -> str:
    """Return the axes of a plane that looks down, its x along the plan's."""
    cos, sin = np.cos(turn), np.sin(turn)
    return f"{cos:.9g} {sin:.9g} 0 {sin:.9g} {-cos:.9g} 0"


def _assets(chosen: dict[str, str], floor: tuple[str, str, str]) -> Iterator[str]:
    yield "  <asset>"
    gradient = '<texture name="{}" type="{}" builtin="gradient" rgb1="{}" rgb2="{}" width="{}" height="{}"/>'
    yield "    " + gradient.format("sky", "skybox", "0.80 0.88 0.95", "0.55 0.62 0.68", 64, 384)
    yield (
        f'    <texture name="ground" type="2d" builtin="checker" rgb1="{floor[0]}" rgb2="{floor[1]}" mark="random" '
        f'markrgb="{floor[2]}" random="0.18" width="128" height="128"/>'
    )
    darker = " ".join(f"{0.87 * float(part):.3f}" for part in chosen["paint"].split())
    yield (
        f'    <texture name="plaster" type="2d" builtin="gradient" rgb1="{chosen["paint"]}" rgb2="{darker}" mark="random" '
        f'markrgb="{darker}" random="0.03" width="512" height="256"/>'
    )
    yield "    " + gradient.format("outdoors", "cube", "0.90 0.96 1.0", "0.62 0.76 0.60", 128, 128)
    yield '    <material name="floor" texture="ground" texrepeat="1 1" texuniform="true" specular="0" shininess="0"/>'
    yield '    <material name="wall" texture="plaster" specular="0" shininess="0"/>'
    yield '    <material name="daylight" texture="outdoors" emission="0.55" specular="0" shininess="0"/>'
    plain = {
        "ceiling": "0.95 0.95 0.94", "partition": chosen["paint"], "trim": "0.60 0.60 0.59", "door": "0.52 0.47 0.42",
        "wood": chosen["wood"], "cloth": chosen["cloth"], "furniture": chosen["furniture"], "pillar": "0.72 0.72 0.71",
        "metal": "0.54 0.56 0.58", "dark": "0.17 0.18 0.20", "leaf": "0.24 0.47 0.23", "sheet": "0.84 0.84 0.82",
        **{f"books_{number}": colour for number, colour in enumerate(_BOOKS)},
    }  # fmt: skip
    for name, colour in plain.items():
        yield f'    <material name="{name}" rgba="{colour} 1" specular="0" shininess="0"/>'
    yield '    <material name="glass" rgba="0.70 0.82 0.84 0.25" specular="0.3" shininess="0.5"/>'
    yield "  </asset>"


def _lights(is_dim: bool, rng: np.random.Generator) -> Iterator[str]:
    """Add directional lights without shadows, as in the shipped rooms: daylight, ceiling lights, and fill from two sides."""
    level = rng.uniform(0.35, 0.5) if is_dim else rng.uniform(0.9, 1.1)
    side = rng.uniform(0, 2 * np.pi)
    cos, sin = np.cos(side), np.sin(side)
    for name, (x, y, z), diffuse, ambient in (
        ("daylight", (0.85 * cos, 0.85 * sin, -0.45), 0.36, 0.60),
        ("ceiling_lights", (-0.10, 0.30, -0.95), 0.36, 0.0),
        ("fill", (-0.45 * cos - 0.8 * sin, 0.8 * cos - 0.45 * sin, -0.05), 0.26, 0.0),
        ("bounce", (0.3 * sin, -0.75 * cos, 0.60), 0.30, 0.0),
    ):
        yield (
            f'    <light name="{name}" type="directional" pos="0 0 2" dir="{x:.4f} {y:.4f} {z:.4f}" '
            f'diffuse="{" ".join([f"{level * diffuse:.4f}"] * 3)}" ambient="{" ".join([f"{level * ambient:.4f}"] * 3)}" '
            'specular="0 0 0" castshadow="false"/>'
        )


def _shell(plan: FloorPlan, rng: np.random.Generator) -> Iterator[str]:
    """Add outer walls with skirting, doors and windows."""
    half = plan.height_m / 2
    for number, wall in enumerate(plan.walls, start=1):
        (x, y), (ax, ay) = wall.at(wall.length_m / 2), wall.along
        yield (
            f'      <geom name="wall_{number}" type="plane" pos="{x:.4f} {y:.4f} {half:.4f}" '
            f'size="{wall.length_m / 2:.4f} {half:.4f} 0.5" xyaxes="{-ax:.6f} {-ay:.6f} 0 0 0 1" material="wall"/>'
        )
        yield from _on_wall(
            f"skirting_{number}", wall, wall.length_m / 2, wall.length_m, 0.0, 0.08, _SKIRTING_M, "trim"
        )
        doors = [door.along_m for door in plan.doors if door.wall == wall]
        for place, along_m in enumerate(doors, start=1):
            name = f"door_{number}_{place}"
            yield f'      <body name="{name}">'
            yield from _on_wall(f"{name}_frame", wall, along_m, DOOR_M + 0.12, 0.0, _DOOR_HIGH_M + 0.06, 0.015, "trim")
            yield from _on_wall(f"{name}_leaf", wall, along_m, DOOR_M, 0.0, _DOOR_HIGH_M, 0.03, "door")
            yield "      </body>"
        for place in range(int(rng.integers(0, 1 + int(wall.length_m / 2.5)))):
            along_m = float(rng.uniform(0.9, max(wall.length_m - 0.9, 0.91)))
            width = float(rng.uniform(0.8, 1.4))
            clear = [abs(along_m - each) for each in doors]
            if min(clear, default=9.0) < (width + DOOR_M) / 2 + 0.2 or along_m + width / 2 > wall.length_m - 0.1:
                continue
            top = min(plan.height_m - 0.3, 2.2)
            if rng.random() < 0.6:
                yield from _on_wall(
                    f"window_{number}_{place}", wall, along_m, width, 0.95, top, 0.006 + 0.002 * place, "daylight"
                )
            else:
                yield from _on_wall(
                    f"picture_{number}_{place}", wall, along_m, width, 1.2, 1.9, 0.007 + 0.002 * place, "furniture"
                )


def _on_wall(
    name: str, wall: Wall, along_m: float, width_m: float, low_m: float, high_m: float, thick_m: float, material: str
) -> Iterator[str]:
    """Add a flat box on the inner face of a wall."""
    x, y = wall.at(along_m, thick_m / 2)
    yaw = np.degrees(wall.yaw)
    yield (
        f'      <geom name="{name}" type="box" pos="{x:.4f} {y:.4f} {(low_m + high_m) / 2:.4f}" '
        f'size="{width_m / 2:.4f} {thick_m / 2:.4f} {(high_m - low_m) / 2:.4f}" euler="0 0 {yaw:.6g}" material="{material}"/>'
    )


def _partitions(plan: FloorPlan) -> Iterator[str]:
    """Add walls between rooms: two stretches beside the doorway, and a lintel over it."""
    for number, partition in enumerate(plan.partitions, start=1):
        wall, (first, last) = partition.wall, partition.gap_m
        low = min(2.1, plan.height_m - 0.1)
        parts = ((0.0, first, 0.0), (last, wall.length_m, 0.0), (first, last, low))
        for place, (start, end, foot) in enumerate(parts, start=1):
            if end - start < 0.01:
                continue
            x, y = wall.at((start + end) / 2)
            yaw = np.degrees(wall.yaw)
            seen = 'material="glass" group="4"' if partition.is_glass else 'material="partition"'
            pos = f"{x:.4f} {y:.4f} {(foot + plan.height_m) / 2:.4f}"
            size = f"{(end - start) / 2:.4f} {PARTITION_M / 2:.4f} {(plan.height_m - foot) / 2:.4f}"
            name = f"partition_{number}_{place}"
            yield f'      <geom name="{name}" type="box" pos="{pos}" size="{size}" euler="0 0 {yaw:.6g}" {seen}/>'


def _piece(piece: Piece, number: int) -> Iterator[str]:
    name = f"{piece.name}_{number}"
    yield f'      <body name="{name}" pos="{piece.place[0]:.4f} {piece.place[1]:.4f} 0" euler="0 0 {np.degrees(piece.yaw):.6g}">'
    for place, solid in enumerate(piece.solids, start=1):
        yield f'        <geom name="{name}_{place}" {_geom(solid)}/>'
    for place, spot in enumerate(piece.spots, start=1):
        x, y, z = spot.place
        named = f"{spot.kind}_{name}_{place}"
        yield f'        <site name="{named}" pos="{x:.4f} {y:.4f} {z:.4f}" euler="0 0 {np.degrees(spot.yaw):.6g}"/>'
    yield "      </body>"


def _geom(solid: Geom) -> str:
    size, middle = (" ".join(f"{each:.4f}" for each in values) for values in (solid.size, solid.middle))
    return f'type="{solid.kind}" size="{size}" pos="{middle}" material="{solid.material}"'


_TRIES = 20
_LEAST_FREE = 0.35
"""Least share of the floor that must be free to walk on."""


@dataclass(frozen=True)
class DrawnBuilding:
    """Drawn building with its MJCF file, into which people and sensors are drawn."""

    plan: FloorPlan
    pieces: tuple[Piece, ...]
    space: FreeSpace
    placement: Placement
    mjcf: str

    def spots(self, kind: str) -> list[str]:
        """Return the scenario's names of the seats or beds."""
        return [
            f"{piece.name}_{number}_{place}"
            for number, piece in enumerate(self.pieces, start=1)
            for place, spot in enumerate(piece.spots, start=1)
            if spot.kind == kind
        ]

    def to_room(self, places: Array) -> list[tuple[float, float]]:
        """Return places (n, 2) of the plan in the room frame [m]."""
        return [(float(x), float(y)) for x, y in self.placement.to_room(np.reshape(places, (-1, 2)))]


def draw_building(options: DrawnRoom, seed: int, name: str) -> DrawnBuilding:
    """Draw a building; equal options and seed give an equal file. Plans with too little reachable floor are drawn again."""
    seed = options.seed if options.seed is not None else seed
    for attempt in range(_TRIES):
        rng = stream(seed, "drawn room", str(attempt))
        plan = draw_floor_plan(options, rng)
        space = FreeSpace(plan)
        floor_m2 = sum(room.area_m2 for room in plan.rooms)
        area = space.walkable_area()
        enough = plan.doors and space.area_m2 >= _LEAST_FREE * floor_m2 and space.is_reached(plan.thresholds()).all()
        if enough and area is not None:
            break
    else:
        raise ValueError(
            f"no building in {_TRIES} draws has doors and floor enough; larger lengths or fewer rooms are expected"
        )
    pieces = draw_furniture(plan, options, space, draw_pillars(plan, options, space, rng), rng)
    length, width = plan.size_m / 2
    placement = Placement((float(length), float(width)), float(np.deg2rad(rng.uniform(*options.turned_deg))))
    mjcf = room_mjcf(name, plan, area, pieces, placement, bool(rng.random() < options.dim), rng)
    return DrawnBuilding(plan, tuple(pieces), space, placement, mjcf)
