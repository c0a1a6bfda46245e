"""Body model: a jointed humanoid of geoms, made from an appearance, to be attached to a room.

Frames: every segment has x ahead, y left, z up when the person stands straight; the pelvis' origin is the middle between the
hip joints. The body is moved by writing coordinates (`mj_kinematics`), never by forces, and collides with nothing. Cameras
and rays meet the same rigid closed meshes. Adjacent segments are round about their joint. Simplifications: skin and clothes
neither bend nor fold, and fingers are not separate.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import lru_cache, partial
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.people.body import appearance, head, limbs
from twin.people.body.appearance import TILE_M, BodyAppearance, coat_front, printed, tile
from twin.people.body.proportions import Proportions
from twin.people.body.surfaces import Surface, cord

SPINE = ("spine_yaw", "spine_pitch", "spine_roll")
NECK = ("neck_yaw", "neck_pitch")
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
LEG = ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll", "toes")
SIDES = ("left", "right")

JOINTS = (
    *SPINE,
    *NECK,
    *(f"{side}_{joint}" for side in SIDES for joint in ARM),
    *(f"{side}_{joint}" for side in SIDES for joint in LEG),
)
"""Hinges in the order of a person's coordinates, after the seven of the free joint `root` of the pelvis (x, y, z, then the
quaternion w, x, y, z).

Angles [rad], zero when standing straight. Positive: yaw to the left, pitch forward and down, roll to the right (right-hand
rule about z, y, x). So a leg or arm swings forward by a negative hip or shoulder pitch, the knee bends by a positive and the
elbow by a negative angle, and the foot points down by a positive ankle pitch.
"""

NQ_PERSON = 7 + len(JOINTS)
"""Coordinates of one person in `qpos`."""

JOINT_PLACE = {name: 7 + place for place, name in enumerate(JOINTS)}
"""Index of each hinge in a person's coordinates."""

GEOM_GROUP = 1
"""Geom group of people: drawn, and met by rays; the room's is 0."""

TRIM_GROUP = 4
"""Geom group of straps, which are drawn only."""

_AXES = {
    "yaw": (0, 0, 1),
    "pitch": (0, 1, 0),
    "roll": (1, 0, 0),
    "elbow": (0, 1, 0),
    "knee": (0, 1, 0),
    "toes": (0, 1, 0),
}
_DRAWN_AT_M = 1.75
_COAT_ADDS_M = 0.014
_SKIRT_HEM, _COAT_HEM = 0.97, 0.74
"""Ends of a skirt and of a coat, as shares of the thigh from the hip.

A scanner at their height sees one object, half a metre broad; one at the height of shins, or of knees, sees two legs.
"""


def person_spec(
    appearance: BodyAppearance, only: Collection[str] | None = None, *, pictures: bool = True
) -> mujoco.MjSpec:
    """Build the body as a model of its own, to be attached to a room's worldbody with a prefix.

    `only`: names of the geoms to build, None for all; segments and joints are always complete. `pictures`: False leaves face,
    prints and texture coordinates out, for a model that is never drawn.

    `spec.attach(person_spec(appearance), prefix="anna/", frame=spec.worldbody.add_frame())` keeps the free joint
    `anna/root`. Sites: `head` (centre of the head, x ahead), `pelvis`, and `point_00`, `point_01`, ... inside the body, the
    fixed points of the truth's "visible share".
    """
    wanted = frozenset(only) if only is not None else None
    return _kept_spec(appearance, wanted, pictures).copy()


@lru_cache(maxsize=64)
def _kept_spec(appearance: BodyAppearance, only: frozenset[str] | None, pictures: bool) -> mujoco.MjSpec:
    """Build the body; cached, as the cases of a worker often share people."""
    return _BodyBuilder(appearance, only, pictures).spec


class _BodyBuilder:
    """Builder of the spec, segment by segment; lengths from the proportions, radii scaled with stature and build."""

    def __init__(self, looks: BodyAppearance, only: Collection[str] | None, pictures: bool) -> None:
        self.looks = looks
        self._only = only
        self._pictures = pictures
        self.lengths: Proportions = looks.proportions
        self.scale = looks.height_m / _DRAWN_AT_M
        self.girth = self.scale * looks.build
        self.shape = limbs.Girths(self.lengths, self.girth, looks.build)
        self.points = 0
        self._both_sides: dict[str, Surface] = {}
        self.spec = mujoco.MjSpec()
        self.spec.modelname = "person"
        self.spec.compiler.degree = False
        self.outside = _COAT_ADDS_M * self.scale if looks.coat is not None else 0.0
        self._add_materials()
        pelvis = self._add_pelvis()
        trunk = self._add_trunk(pelvis)
        self._add_head(trunk)
        for side, sign in zip(SIDES, (1, -1), strict=True):
            self._add_arm(trunk, side, sign)
        for side, sign in zip(SIDES, (1, -1), strict=True):
            self._add_leg(pelvis, side, sign)
        self._add_bag(pelvis, trunk)

    def _add_materials(self) -> None:
        looks = self.looks
        colours = {
            "trousers": looks.trousers,
            "shoes": looks.shoes,
            "skin": looks.skin,
            "hair": looks.hair,
            "skirt": looks.skirt,
            "coat": looks.coat,
            "cap": looks.cap,
            "bag": looks.bag_colour if looks.bag != "none" else None,
        }
        for name, rgb in colours.items():
            if rgb is not None:
                self._material(name, rgb)
        woven = looks.shirt_pattern in ("striped", "checked")
        if looks.coat is not None:
            self._material("trunk", picture=partial(coat_front, looks.coat, looks.shirt))
        elif looks.shirt_pattern == "printed":
            self._material("shirt", looks.shirt)
            self._material("trunk", picture=partial(printed, looks.print_motif, looks.shirt, looks.shirt_second))
        elif woven:
            self._material("shirt", picture=partial(tile, looks.shirt_pattern, looks.shirt, looks.shirt_second))
        else:
            self._material("shirt", looks.shirt)
        names = {material.name for material in self.spec.materials}
        self.cloth = "coat" if looks.coat is not None else "shirt"
        self.trunk_cloth = "trunk" if "trunk" in names else "shirt"
        self.woven = woven and looks.coat is None

    def _material(
        self, name: str, rgb: ArrayLike = (1.0, 1.0, 1.0), picture: Callable[[], NDArray[np.uint8]] | None = None
    ) -> None:
        # matt, so that a camera sees the given colour times the light
        red, green, blue = np.asarray(rgb, dtype=float)
        material = self.spec.add_material(
            name=name, rgba=[red, green, blue, 1.0], specular=0.0, shininess=0.0, reflectance=0.0
        )
        if picture is not None and self._pictures:
            painted = picture()
            height, width, _ = painted.shape
            texture = self.spec.add_texture(
                name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=width, height=height, nchannel=3
            )
            texture.data = np.ascontiguousarray(painted[::-1]).tobytes()
            material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name

    def _segment(self, parent: Any, name: str, place: Sequence[float], joints: tuple[str, ...]) -> Any:
        body = parent.add_body(name=name, pos=place)
        for joint in joints:
            axis = _AXES[joint.rpartition("_")[2]]
            body.add_joint(name=joint, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
        return body

    def _geom(self, body: Any, name: str, material: str, make: Callable[[], Surface], group: int = GEOM_GROUP) -> None:
        if not self._wants(name):
            return
        surface = make()
        if material == "shirt" and self.woven and self._pictures:
            breadth = np.linalg.norm(np.ptp(surface.vertex, axis=0)[:2]) / 1.4142
            length = float(np.ptp(surface.vertex[:, 2]))
            surface = surface.tiled(max(1, round(np.pi * breadth / TILE_M)), length / TILE_M)
        surface.add_to(self.spec, name, pictures=self._pictures)
        body.add_geom(
            name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=material, group=group, contype=0,
            conaffinity=0,
        )  # fmt: skip

    def _side_geom(self, body: Any, side: str, part: str, material: str, make: Callable[[], Surface]) -> None:
        """Add a geom of one side, from a surface that serves both and is made once."""
        self._geom(body, f"{side}_{part}", material, lambda: self._of_both(part, make))

    def _of_both(self, part: str, make: Callable[[], Surface]) -> Surface:
        """Return the surface of a part that is the same on the left and on the right, made once."""
        if part not in self._both_sides:
            self._both_sides[part] = make()
        return self._both_sides[part]

    def _wants(self, geom: str) -> bool:
        return self._only is None or geom in self._only

    def _point(self, body: Any, *places: Sequence[float]) -> None:
        for place in places:
            body.add_site(name=f"point_{self.points:02d}", pos=place, size=[0.005] * 3, group=4)
            self.points += 1

    def _add_pelvis(self) -> Any:
        height, girth, looks = self.looks.height_m, self.girth, self.looks
        body = self.spec.worldbody.add_body(name="pelvis", pos=[0, 0, self.lengths.hip_height])
        body.add_freejoint(name="root")
        body.add_site(name="pelvis", size=[0.01] * 3, group=4)
        cloth = "coat" if looks.coat is not None else "skirt" if looks.skirt is not None else "trousers"
        # a skirt's belt holds the shirt; a coat and a shirt over trousers hang over the hips
        belted = cloth == "skirt"
        grow = 0.004 * self.scale if belted else 0.6 * self.outside
        self._geom(body, "hips", cloth, lambda: self.shape.hips(grow, belted))
        for z in (0.0, 0.05 * height):
            self._point(body, *((0, y * girth, z) for y in (-0.11, 0.0, 0.11)))
        return body

    def _add_trunk(self, pelvis: Any) -> Any:
        girth = self.girth
        trunk = self._segment(pelvis, "trunk", (0, 0, self.lengths.waist_height - self.lengths.hip_height), SPINE)
        tucked = self.looks.skirt is not None and self.looks.coat is None
        self._geom(trunk, "chest", self.trunk_cloth, lambda: self.shape.trunk(self.outside, tucked))
        self._geom(trunk, "neck", "skin", lambda: self.shape.neck())
        length = self.lengths.shoulder_height - self.lengths.waist_height
        for share in (0.09, 0.36, 0.64, 0.88):
            self._point(trunk, *((0, y * girth, share * length) for y in (-0.11, 0.0, 0.11)))
        return trunk

    def _add_head(self, trunk: Any) -> None:
        looks, lengths = self.looks, self.lengths
        pivot = lengths.chin_height - 0.012 * looks.height_m
        body = self._segment(trunk, "head", (0, 0, pivot - lengths.waist_height), NECK)
        # stature includes hair and cap, as it includes the shoes
        shape = head.shape_of(
            lengths.chin_height - pivot, looks.height_m - pivot, lengths.head_length, lengths.head_breadth, looks
        )
        centre = 0.5 * (lengths.chin_height + looks.height_m) - pivot
        body.add_site(name="head", pos=[0.004 * self.scale, 0, centre], size=[0.01] * 3, group=4)
        if self._wants("skull"):
            self._material("face", picture=partial(head.picture, shape, looks))
            self._geom(body, "skull", "face", lambda: head.skull(shape, looks))
        hair = head.hair(shape, looks.hair_style, looks.cap is not None, lengths.shoulder_height - pivot)
        if hair is not None:
            self._geom(body, "hair", "hair", lambda: hair)
        if looks.cap is not None:
            self._geom(body, "cap", "cap", lambda: head.cap(shape))
        self._point(body, *((0, y * lengths.head_breadth, centre) for y in (-0.26, 0.0, 0.26)))

    def _add_arm(self, trunk: Any, side: str, sign: int) -> None:
        lengths, looks, shape = self.lengths, self.looks, self.shape
        x, y, z = shape.shoulder_joint()
        upper = self._segment(
            trunk, f"{side}_upper_arm", (x, sign * y, z), tuple(f"{side}_{joint}" for joint in ARM[:3])
        )
        covered = looks.long_sleeves or looks.coat is not None
        if covered:
            self._side_geom(upper, side, "sleeve", self.cloth, lambda: shape.upper_arm(self.outside + 0.004))
        else:
            self._side_geom(upper, side, "sleeve", self.cloth, shape.short_sleeve)
            self._side_geom(upper, side, "upper_arm", "skin", shape.bare_upper_arm)
        self._point(upper, (0, 0, -0.5 * lengths.upper_arm), (0, 0, -0.95 * lengths.upper_arm))
        lower = self._segment(upper, f"{side}_forearm", (0, 0, -lengths.upper_arm), (f"{side}_elbow",))
        cloth = self.cloth if covered else "skin"
        outside = self.outside + 0.004 if covered else 0.0
        self._side_geom(lower, side, "forearm", cloth, lambda: shape.forearm(outside, covered))
        hand = -(lengths.forearm + 0.42 * lengths.hand)
        surface = self._of_both("hand", lambda: limbs.hand(lengths, self.scale))
        self._geom(lower, f"{side}_hand", "skin", lambda: surface if sign > 0 else surface.mirrored())
        self._point(lower, (0, 0, -0.5 * lengths.forearm), (0, 0, hand))

    def _add_leg(self, pelvis: Any, side: str, sign: int) -> None:
        lengths, looks, shape = self.lengths, self.looks, self.shape
        y = sign * lengths.hip_joint_width / 2
        joints = tuple(f"{side}_{joint}" for joint in LEG)
        thigh = self._segment(pelvis, f"{side}_thigh", (0, y, 0), joints[:3])
        bare = looks.skirt is not None and not looks.leggings
        slim = looks.skirt is not None
        cloth = "skin" if bare else "trousers"
        self._side_geom(thigh, side, "thigh", cloth, lambda: shape.thigh(slim))
        if looks.skirt is not None:
            self._geom(thigh, f"{side}_skirt", "skirt", lambda: shape.bell(sign, _SKIRT_HEM, 0.16, 0.004))
        if looks.coat is not None:
            self._geom(thigh, f"{side}_tail", "coat", lambda: shape.bell(sign, _COAT_HEM, 0.20, self.outside + 0.006))
        self._point(thigh, (0, 0, -0.35 * lengths.thigh), (0, 0, -0.7 * lengths.thigh))
        shank = self._segment(thigh, f"{side}_shank", (0, 0, -lengths.thigh), joints[3:4])
        self._side_geom(shank, side, "shank", cloth, lambda: shape.shank(slim))
        self._point(shank, *((0, 0, -share * lengths.shank) for share in (0.0, 0.35, 0.75)))
        foot = self._segment(shank, f"{side}_foot", (0, 0, -lengths.shank), joints[4:6])
        self._side_geom(foot, side, "shoe", "shoes", lambda: limbs.shoe(lengths, self.scale))
        self._point(foot, (0.03 * self.scale, 0, -0.5 * lengths.ankle_height))
        toes = self._segment(foot, f"{side}_toes", (lengths.ball_before_ankle, 0, -lengths.ankle_height), joints[6:])
        self._side_geom(toes, side, "toes", "shoes", lambda: limbs.toe_cap(lengths, self.scale))

    def _add_bag(self, pelvis: Any, trunk: Any) -> None:
        looks, shape, k = self.looks, self.shape, self.scale
        match looks.bag:
            case "backpack":
                back = shape.back(self.outside)
                self._geom(trunk, "bag", "bag", lambda: appearance.backpack(shape.trunk_length, back, k))
                strap = cord(shape.strap_path(self.outside), 0.013 * k)
                self._geom(trunk, "straps", "bag", lambda: strap + strap.mirrored(), TRIM_GROUP)
            case "shoulder":
                behind = shape.hip_depth(self.outside) + 0.045 * k
                bag = appearance.shoulder_bag(k).moved((-behind, -0.055 * k, 0.015 * looks.height_m))
                self._geom(pelvis, "bag", "bag", lambda: bag)
                self._geom(trunk, "straps", "bag", lambda: shape.sash(self.outside), TRIM_GROUP)
            case "handbag":
                fist = (0.004, -0.022 * k, -(self.lengths.forearm + 0.55 * self.lengths.hand))
                forearm = self.spec.body("right_forearm")
                self._geom(forearm, "bag", "bag", lambda: appearance.handbag(k).moved(fist))
