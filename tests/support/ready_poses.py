"""Poses of ready-made scenes (contacts with a known force, a loaded knee, balls in cups); scenes that lock and tie."""

from typing import Any

import numpy as np

import casadi_contact as cc
from casadi_contact.scenes.scene import Scene

CASES = [  # scene, overrides, overlap [mm], vertical force [N] (closed form)
    ("sphere_on_plane", {}, 0.05, 63.0103),
    ("sphere_on_plane", {}, 0.1, 251.9012),
    ("sphere_on_plane", {}, 0.2, 1006.4840),
    ("sphere_on_plane", {}, 0.5, 6269.5098),
    ("sphere_on_plane", {"law": "log"}, 0.05, 63.1420),
    ("sphere_on_plane", {"law": "log"}, 0.1, 252.9577),
    ("sphere_on_plane", {"law": "log"}, 0.2, 1014.9826),
    ("sphere_on_plane", {"law": "log"}, 0.5, 6404.5580),
    ("sphere_in_dish", {}, 0.1, 749.0413),
    ("sphere_in_dish", {}, 0.2, 2966.6461),
    ("sphere_in_dish", {"dish_radius": 33.0}, 0.1, 2652.6872),
    ("cylinder_on_plane", {}, 0.1, 873.4519),
]
KNEE = [2.0, 27.256, 0.3, -0.0007, 0.02, -0.3]  # about 900 N medial, 600 N lateral
# Displacements of the ball along the pole and across it [mm]: deep, cut by the rim, pressed on the rim from beyond it,
# and free.
PLACES = {
    "hip": ([0.45, 0.02], [0.2, 0.44], [-0.05, 0.52], [0.1, -0.2]),
    "glenohumeral": ([6.1, 0.4], [5.6, 2.6], [5.1, 3.9], [5.5, 0.3]),
}


def at(ty, **others):
    pose = {"tx": 0.0, "ty": ty, "tz": 0.0, "rx": 0.0, "ry": 0.0, "rz": 0.0} | others
    return np.array([list(pose.values())])


def in_cup(scene, displacements):
    """Poses (n, 6) of the ball displaced (n, 3) from the cup's centre."""
    return np.pad(scene.geometry["cup_centre"] + np.atleast_2d(displacements), ((0, 0), (0, 3)))


def pole(scene):
    return np.array(scene.geometry["cup_pole"]) / np.linalg.norm(scene.geometry["cup_pole"])


def placed(scene, displacements):
    along = pole(scene)
    across = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    across /= np.linalg.norm(across)
    aside = np.cross(along, across)
    return in_cup(scene, [a * along + b * (0.8 * across + 0.6 * aside) for a, b in displacements])


def walking(n, seed=3):
    """Poses (n, 6) of the knee about those of walking, and forces [N] that press both sides."""
    rng = np.random.default_rng(seed)
    poses = np.c_[
        rng.uniform(-3, 5, n),
        np.full(n, 27.8),
        rng.uniform(-0.5, 0.5, n),
        rng.uniform(-0.02, 0.02, n),
        rng.uniform(-0.1, 0.1, n),
        rng.uniform(-1.2, 0.15, n),
    ]
    return poses, {"Fy_med": -rng.uniform(30, 1500, n), "Fy_lat": -rng.uniform(30, 1500, n)}


SLOPE, AT_ZERO, LOCKED = 0.5, 0.2, 0.05  # tz = 0.2 + 0.5·tx [mm], rx = 0.05 rad
BALL_POSE = {"locked": {"rx": LOCKED, "ry": 0.0}, "tied": {"tz": {"to": "tx", "slope": SLOPE, "at_zero": AT_ZERO}}}


def scene_held(name: str, pose: dict[str, Any], **keys: Any) -> Scene:
    """A ready scene with this [pose], and other values of single keys."""
    tables = cc.load_scene(name, **keys).tables
    return Scene.from_tables({**tables, "pose": pose})


def held_ball(**keys: Any) -> Scene:
    """A ball in a dish on a rail across it: tz follows tx, rx and ry are locked."""
    return scene_held("sphere_in_dish", BALL_POSE, **keys)
