"""What holds for every test."""

import os

import jaxtyping

# Before anything imports mujoco: tests that use its own renderer draw through EGL too.
os.environ["MUJOCO_GL"] = "egl"

# Before anything imports them: every call into these has its arguments' and its results' types and shapes checked.
CHECKED = (
    "trackers.camera_floor_particle",
    "trackers.cameras",
    "trackers.environment",
    "trackers.filters",
    "trackers.floor",
    "trackers.laser",
    "trackers.laser_fisheye_imm",
    "trackers.laser_vision_learning",
    "trackers.learning",
    "trackers.rgbd_head",
    "trackers.tracking",
    "trackers.vision",
)
jaxtyping.install_import_hook(CHECKED, "shape_checks.checked")
