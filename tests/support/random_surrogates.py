"""Untrained surrogates with random weights, scaled so that root loads cross zero: enough to compare evaluations."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from casadi_contact.networks.network import Network
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.load import STRUCTURES

POSE_CENTRE = np.array([0.0, 27.0, 0.0, 0.0, 0.0, -0.5])
POSE_SPREAD = np.array([6.0, 0.4, 3.0, 0.05, 0.1, 0.6])


IN_PARTS = "knee in parts"


def scene_called(name: str) -> Scene:
    """A ready-made scene, or the knee with its medial patch in three parts (a surrogate does not ask how it is cut)."""
    if name != IN_PARTS:
        return load_scene(name)
    knee = load_scene("knee")
    medial, lateral = knee.parts
    cut = []
    for k in (1, 2, 3):
        anchor, normal = (
            medial.anchor_mm + np.array([0.0, 0.0, 6.0 * (k - 2)]),
            replace(medial.normal, patch=f"med_{k}"),
        )
        cut.append(replace(medial, name=f"med_{k}", anchor_mm=anchor, normal=normal))
    return replace(knee, parts=(*cut, lateral))


def random_poses(count: int, seed: int = 0) -> np.ndarray:
    return POSE_CENTRE + POSE_SPREAD * np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 6))


def random_network(rng, shift, scale, hidden, activation, output_scale, bias=0.0) -> Network:
    sizes = [len(shift), *hidden, np.size(output_scale)]
    weights = tuple(rng.normal(size=(b, a)) / np.sqrt(a) for a, b in pairwise(sizes))
    biases = tuple(0.3 * rng.normal(size=b) for b in sizes[1:-1])
    return Network(shift, scale, weights, (*biases, np.atleast_1d(bias / output_scale)), output_scale, activation)


def random_surrogate(scene: Scene, structure: str, activation: str = "algebraic", seed: int = 0) -> Surrogate:
    """Random networks of two hidden layers; torque-like outputs are larger than force-like ones."""
    rng, kind, networks = np.random.default_rng(seed), STRUCTURES[structure], {}
    outputs = kind.network_outputs(scene)
    for name, inputs in kind.network_inputs(scene).items():
        shift, scale = np.zeros(max(inputs, 6)), np.full(max(inputs, 6), 500.0)
        shift[:6], scale[:6] = POSE_CENTRE, POSE_SPREAD
        if structure != "two_stage":
            shift[:3] += scene.anchors_mm[[p in name.split("_") for p in scene.patch_names].index(True)]
            shift, scale = shift[list(scene.pose_space.free)], scale[list(scene.pose_space.free)]
            output = 1.5 if name.startswith("root") else (20.0 if "_T" in name else 0.3)
            if outputs[name] > 1:
                output = np.linspace(0.3, 20.0, outputs[name])
        else:
            output = 20000.0 if name.startswith("T") else 800.0
        networks[name] = random_network(rng, shift, scale, (14, 9), activation, output)
    return kind(scene, networks)
