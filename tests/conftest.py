"""What holds for every test."""

import os

# Before anything imports mujoco: tests that use its own renderer draw through EGL too.
os.environ["MUJOCO_GL"] = "egl"
