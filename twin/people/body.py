"""The body: a jointed humanoid of geoms, made from its looks, ready to be attached to a room.

Frames: every segment has x ahead, y left, z up when the person stands straight; the pelvis' origin is the middle between
the hip joints. The body is moved by writing coordinates (`mj_kinematics`), never by forces, and collides with nothing.
Limbs are capsules and the trunk ellipsoids: clothes neither hang nor fold, fingers are not told apart.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from twin.people.appearance import Appearance, Rgb
from twin.people.proportions import Proportions

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
"""Hinges in the order of a person's coordinates, after the seven of the free joint `root` of the pelvis (x, y, z, then
the quaternion w, x, y, z).

Angles [rad], zero when standing straight. Positive: yaw to the left, pitch forward and down, roll to the right (the
right-hand rule about z, y, x); so a leg or arm swings forward by a negative hip or shoulder pitch, the knee bends by a
positive and the elbow by a negative angle, and the foot points down by a positive ankle pitch.
"""

NQ_PERSON = 7 + len(JOINTS)
"""Coordinates of one person in `qpos`."""

JOINT_PLACE = {name: 7 + place for place, name in enumerate(JOINTS)}
"""Place of each hinge in a person's coordinates."""

GEOM_GROUP = 1
"""The geom group of people; the room's is 0."""

FACE_GROUP = 2
"""The geom group of eyes, ears, nose and mouth: drawn, and small enough for a scanner to leave out."""

_AXES = {
    "yaw": (0, 0, 1),
    "pitch": (0, 1, 0),
    "roll": (1, 0, 0),
    "elbow": (0, 1, 0),
    "knee": (0, 1, 0),
    "toes": (0, 1, 0),
}
_FACE = ("eye", "ear", "nose", "mouth")
_EYE: Rgb = (0.10, 0.08, 0.08)
_DRAWN_AT_M = 1.75
"""Radii below are for this stature and scale with it [m]."""


def person_spec(appearance: Appearance) -> mujoco.MjSpec:
    """The body as a model of its own, to be attached to a room's worldbody with a prefix.

    `spec.attach(person_spec(appearance), prefix="anna/", frame=spec.worldbody.add_frame())` keeps the free joint
    `anna/root`. Sites: `head` (centre of the head, x ahead), `pelvis`, and `point_00`, `point_01`, ... inside the body,
    the fixed points of the truth's "visible share".
    """
    return _Body(appearance).spec


class _Body:
    """Builds the spec segment by segment; lengths from the proportions, radii scaled with stature and build."""

    def __init__(self, appearance: Appearance) -> None:
        self.looks = appearance
        self.lengths: Proportions = appearance.proportions
        self.scale = appearance.height_m / _DRAWN_AT_M
        self.girth = self.scale * appearance.build
        self.points = 0
        self.spec = mujoco.MjSpec()
        self.spec.modelname = "person"
        self.spec.compiler.degree = False
        self._add_materials()
        pelvis = self._add_pelvis()
        trunk = self._add_trunk(pelvis)
        self._add_head(trunk)
        for side, sign in zip(SIDES, (1, -1), strict=True):
            self._add_arm(trunk, side, sign)
        for side, sign in zip(SIDES, (1, -1), strict=True):
            self._add_leg(pelvis, side, sign)

    def _add_materials(self) -> None:
        looks = self.looks
        lips = tuple(0.62 * np.array(looks.skin) + (0.14, 0.0, 0.02))
        colours = {
            "shirt": looks.shirt,
            "trousers": looks.trousers,
            "shoes": looks.shoes,
            "skin": looks.skin,
            "hair": looks.hair,
            "eyes": _EYE,
            "lips": lips,
        }
        for name, rgb in colours.items():
            # matt: what a camera sees is the colour asked for, times the light
            self.spec.add_material(name=name, rgba=[*rgb, 1.0], specular=0.0, shininess=0.0, reflectance=0.0)

    def _segment(self, parent: Any, name: str, place: tuple[float, float, float], joints: tuple[str, ...]) -> Any:
        body = parent.add_body(name=name, pos=place)
        for joint in joints:
            axis = _AXES[joint.rpartition("_")[2]]
            body.add_joint(name=joint, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
        return body

    def _geom(self, body: Any, name: str, kind: mujoco.mjtGeom, material: str, **shape: Any) -> None:
        group = FACE_GROUP if name.rpartition("_")[2] in _FACE else GEOM_GROUP
        body.add_geom(name=name, type=kind, material=material, group=group, contype=0, conaffinity=0, **shape)

    def _ellipsoid(self, body: Any, name: str, material: str, place: Any, size: Any, **more: Any) -> None:
        self._geom(body, name, mujoco.mjtGeom.mjGEOM_ELLIPSOID, material, pos=place, size=size, **more)

    def _capsule(self, body: Any, name: str, material: str, start: Any, end: Any, radius: float) -> None:
        self._geom(body, name, mujoco.mjtGeom.mjGEOM_CAPSULE, material, fromto=[*start, *end], size=[radius, 0, 0])

    def _point(self, body: Any, *places: tuple[float, float, float]) -> None:
        for place in places:
            body.add_site(name=f"point_{self.points:02d}", pos=place, size=[0.005] * 3, group=4)
            self.points += 1

    def _add_pelvis(self) -> Any:
        height, girth = self.looks.height_m, self.girth
        body = self.spec.worldbody.add_body(name="pelvis", pos=[0, 0, self.lengths.hip_height])
        body.add_freejoint(name="root")
        body.add_site(name="pelvis", size=[0.01] * 3, group=4)
        self._ellipsoid(
            body, "hips", "trousers", (-0.008, 0, 0.006 * height), (0.118 * girth, 0.163 * girth, 0.076 * height)
        )
        for z in (0.0, 0.05 * height):
            self._point(body, *((0, y * girth, z) for y in (-0.11, 0.0, 0.11)))
        return body

    def _add_trunk(self, pelvis: Any) -> Any:
        height, girth = self.looks.height_m, self.girth
        waist = self.lengths.waist_height
        trunk = self._segment(pelvis, "trunk", (0, 0, waist - self.lengths.hip_height), SPINE)
        shoulder = self.lengths.shoulder_height - waist
        self._ellipsoid(
            trunk, "belly", "shirt", (0.002, 0, 0.030 * height), (0.120 * girth, 0.170 * girth, 0.134 * height)
        )
        self._ellipsoid(
            trunk, "chest", "shirt", (0.003, 0, 0.112 * height), (0.124 * girth, 0.180 * girth, 0.126 * height)
        )
        # the neck's foot slopes down to the shoulders
        for side, sign in zip(SIDES, (1, -1), strict=True):
            self._capsule(
                trunk,
                f"{side}_shoulder",
                "shirt",
                (-0.005, sign * 0.035 * girth, shoulder + 0.006 * height),
                (-0.005, sign * 0.150 * girth, shoulder - 0.016 * height),
                0.056 * girth,
            )
        self._capsule(
            trunk, "neck", "skin", (-0.012, 0, shoulder), (0.0, 0, 0.868 * height - waist), 0.052 * self.scale
        )
        for z in (0.02, 0.08, 0.14, 0.20):
            self._point(trunk, *((0, y * girth, z * height) for y in (-0.12, 0.0, 0.12)))
        return trunk

    def _add_head(self, trunk: Any) -> None:
        height, k, looks = self.looks.height_m, self.scale, self.looks
        pivot = 0.858 * height
        head = self._segment(trunk, "head", (0, 0, pivot - self.lengths.waist_height), NECK)
        centre = 0.935 * height - pivot
        top = height - pivot
        bald = looks.hair_style == "bald"
        skull = (top - centre) - (0.0 if bald else 0.010 * k)
        head.add_site(name="head", pos=[0.004 * k, 0, centre], size=[0.01] * 3, group=4)
        self._ellipsoid(head, "skull", "skin", (0.004 * k, 0, centre), (0.096 * k, 0.077 * k, skull))
        chin = self.lengths.chin_height - pivot
        self._ellipsoid(head, "jaw", "skin", (0.022 * k, 0, chin + 0.066 * k), (0.071 * k, 0.066 * k, 0.066 * k))
        eyes = self.lengths.eye_height - pivot
        for side, sign in zip(SIDES, (1, -1), strict=True):
            self._ellipsoid(
                head, f"{side}_eye", "eyes", (0.084 * k, sign * 0.033 * k, eyes), (0.010 * k, 0.014 * k, 0.009 * k)
            )
            self._ellipsoid(
                head, f"{side}_ear", "skin", (-0.004 * k, sign * 0.078 * k, eyes - 0.012 * k),
                (0.018 * k, 0.010 * k, 0.030 * k),
            )  # fmt: skip
        self._ellipsoid(head, "nose", "skin", (0.100 * k, 0, eyes - 0.036 * k), (0.018 * k, 0.015 * k, 0.026 * k))
        self._ellipsoid(head, "mouth", "lips", (0.082 * k, 0, eyes - 0.076 * k), (0.009 * k, 0.023 * k, 0.007 * k))
        if not bald:
            self._add_hair(head, centre, top)
        self._point(head, *((0, y * k, centre) for y in (-0.04, 0.0, 0.04)))

    def _add_hair(self, head: Any, centre: float, top: float) -> None:
        """A cap that leaves the face free, and what hangs or is tied behind."""
        k = self.scale
        half = 0.072 * k
        self._ellipsoid(head, "hair", "hair", (-0.016 * k, 0, top - half), (0.096 * k, 0.085 * k, half))
        match self.looks.hair_style:
            case "long":
                self._ellipsoid(
                    head, "hair_back", "hair", (-0.055 * k, 0, centre - 0.055 * k), (0.055 * k, 0.090 * k, 0.145 * k)
                )
            case "bun":
                self._ellipsoid(
                    head, "hair_back", "hair", (-0.115 * k, 0, centre + 0.045 * k), (0.042 * k, 0.042 * k, 0.042 * k)
                )
            case _:
                self._ellipsoid(
                    head, "hair_back", "hair", (-0.032 * k, 0, centre - 0.010 * k), (0.070 * k, 0.080 * k, 0.078 * k)
                )

    def _add_arm(self, trunk: Any, side: str, sign: int) -> None:
        girth, lengths, k = self.girth, self.lengths, self.scale
        # the joint lies inside the acromion: deltoid and sleeve add the rest of the shoulders' breadth
        y = sign * (0.43 * lengths.shoulder_width * self.looks.build)
        z = lengths.shoulder_height - lengths.waist_height - 0.022 * self.looks.height_m
        upper = self._segment(trunk, f"{side}_upper_arm", (0, y, z), tuple(f"{side}_{joint}" for joint in ARM[:3]))
        self._capsule(upper, f"{side}_sleeve", "shirt", (0, 0, 0), (0, 0, -lengths.upper_arm), 0.047 * girth)
        self._point(upper, (0, 0, -0.5 * lengths.upper_arm), (0, 0, -0.95 * lengths.upper_arm))
        lower = self._segment(upper, f"{side}_forearm", (0, 0, -lengths.upper_arm), (f"{side}_elbow",))
        cloth = "shirt" if self.looks.long_sleeves else "skin"
        radius = (0.040 if self.looks.long_sleeves else 0.036) * girth
        self._capsule(lower, f"{side}_forearm", cloth, (0, 0, 0), (0, 0, -lengths.forearm), radius)
        hand = -(lengths.forearm + 0.42 * lengths.hand)
        self._ellipsoid(lower, f"{side}_hand", "skin", (0.006, 0, hand), (0.038 * k, 0.022 * k, 0.5 * lengths.hand))
        self._point(lower, (0, 0, -0.5 * lengths.forearm), (0, 0, hand))

    def _add_leg(self, pelvis: Any, side: str, sign: int) -> None:
        girth, lengths, k = self.girth, self.lengths, self.scale
        y = sign * lengths.hip_joint_width / 2
        joints = tuple(f"{side}_{joint}" for joint in LEG)
        thigh = self._segment(pelvis, f"{side}_thigh", (0, y, 0), joints[:3])
        self._capsule(thigh, f"{side}_thigh", "trousers", (0, 0, 0), (0, 0, -lengths.thigh), 0.071 * girth)
        self._point(thigh, (0, 0, -0.35 * lengths.thigh), (0, 0, -0.7 * lengths.thigh))
        shank = self._segment(thigh, f"{side}_shank", (0, 0, -lengths.thigh), joints[3:4])
        self._capsule(shank, f"{side}_shank", "trousers", (0, 0, 0), (0, 0, -0.93 * lengths.shank), 0.057 * girth)
        self._point(shank, *((0, 0, -share * lengths.shank) for share in (0.0, 0.35, 0.75)))
        foot = self._segment(shank, f"{side}_foot", (0, 0, -lengths.shank), joints[4:6])
        sole, breadth = -lengths.ankle_height, 0.5 * lengths.foot_breadth - 0.004 * k
        heel, ball = -lengths.heel_behind_ankle, lengths.ball_before_ankle
        self._capsule(
            foot, f"{side}_shoe", "shoes", (heel + breadth, 0, sole + breadth), (ball - 0.5 * breadth, 0, sole + breadth),
            breadth,
        )  # fmt: skip
        self._point(foot, (0.03, 0, 0.5 * sole))
        toe_length = lengths.foot_length - lengths.heel_behind_ankle - lengths.ball_before_ankle
        toes = self._segment(foot, f"{side}_toes", (ball, 0, sole), joints[6:])
        half = 0.5 * (toe_length + 0.028 * k)
        self._ellipsoid(
            toes, f"{side}_toes", "shoes", (toe_length - half, 0, 0.030 * k), (half, breadth * 1.12, 0.030 * k)
        )
