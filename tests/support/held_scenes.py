"""Scenes whose [pose] locks and ties parameters."""

from __future__ import annotations

from typing import Any

import casadi_contact as cc
from casadi_contact.scenes.scene import Scene

SLOPE, AT_ZERO, LOCKED = 0.5, 0.2, 0.05  # tz = 0.2 + 0.5·tx [mm], rx = 0.05 rad
BALL_POSE = {"locked": {"rx": LOCKED, "ry": 0.0}, "tied": {"tz": {"to": "tx", "slope": SLOPE, "at_zero": AT_ZERO}}}


def scene_held(name: str, pose: dict[str, Any], **keys: Any) -> Scene:
    """A ready scene with this [pose], and other values of single keys."""
    tables = cc.load_scene(name, **keys).tables
    return Scene.from_tables({**tables, "pose": pose})


def held_ball(**keys: Any) -> Scene:
    """A ball in a dish on a rail across it: tz follows tx, rx and ry are locked."""
    return scene_held("sphere_in_dish", BALL_POSE, **keys)
