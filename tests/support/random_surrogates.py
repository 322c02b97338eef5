"""Untrained surrogates and confidences of random weights, scaled so that root loads cross zero; random samples."""

from itertools import pairwise

import numpy as np

from casadi_contact.networks.network import Network
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, Samples
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.confidence import Confidence
from casadi_contact.surrogate.load import STRUCTURES

POSE_CENTRE = np.array([0.0, 27.0, 0.0, 0.0, 0.0, -0.5])
POSE_SPREAD = np.array([6.0, 0.4, 3.0, 0.05, 0.1, 0.6])
THREE = "three patches"


def scene_called(name: str) -> Scene:
    """A ready-made scene, or one of three patches, an odd number."""
    if name != THREE:
        return load_scene(name)
    tables = {
        key: value for key, value in load_scene("knee").tables.items() if key not in ("material", "grids", "motion")
    }
    patches = {name: {"anchor": [0.0, 0.0, z]} for name, z in (("med", 20.0), ("post", 0.0), ("lat", -20.0))}
    loads = {**tables["loads"], "sensitive": [f"Fy_{name}" for name in patches]}
    return Scene.from_tables({**tables, "shape": "own_model", "geometry": {"patches": patches}, "loads": loads})


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
        if structure == "patch":
            shift[:3] += scene.anchors_mm[[p in name.split("_") for p in scene.patch_names].index(True)]
            shift, scale = shift[list(scene.pose_space.free)], scale[list(scene.pose_space.free)]
            output = 1.5 if name.startswith("root") else (20.0 if "_T" in name else 0.3)
            if outputs[name] > 1:
                output = np.linspace(0.3, 20.0, outputs[name])
        else:
            output = 20000.0 if name.startswith("T") else 800.0
        networks[name] = random_network(rng, shift, scale, (14, 9), activation, output)
    return kind(scene, networks)


def random_confidence(patches: int, loads: int, *, root_size: float = 1.0) -> Confidence:
    """root_size: of usual root loads. Validity varies over random poses."""
    rng = np.random.default_rng(0)
    columns = np.array([0.0, 2.0, 4.0])
    sizes = (3 + patches, 7, 5, 1 + loads)
    whitening = np.sqrt(3.0) * np.diag(1.0 / POSE_SPREAD)
    whitening[1, 0] = 0.1  # as of a parameter that is tied to another
    layers = [(0.5 * rng.normal(size=(m, n)), 0.1 * rng.normal(size=m)) for n, m in pairwise(sizes)]
    layers[-1][1][0] -= 1.0  # some poses are valid
    network = Network(
        np.r_[POSE_CENTRE[[0, 2, 4]], np.zeros(patches)],
        np.r_[POSE_SPREAD[[0, 2, 4]], np.full(patches, root_size)],
        tuple(weights for weights, _ in layers),
        tuple(bias for _, bias in layers),
    )
    return Confidence(
        whitening=whitening,
        centres=POSE_CENTRE @ whitening.T + 1.7 * rng.uniform(-1.0, 1.0, (37, 6)),
        bandwidth=0.9,
        sharpness=0.6,
        edge=1.0,
        columns=columns,
        network=network,
        growth=rng.uniform(0.2, 1.0, loads),
    )


KNEE = load_scene("knee")


def invented_samples(count=300, seed=0) -> Samples:
    """Each side 40 % lifted, ratios that are simple functions of the pose."""
    rng = np.random.default_rng(seed)
    poses, gaps = random_poses(count, seed), rng.uniform(-0.1, 0.15, (count, 2))
    normal = np.where(gaps < 0.0, 8e4 * gaps**2, 0.0)
    ratios = np.array([0.05, -1.0, 0.03, 22.0, 1.0, -4.0])
    wrenches = normal[:, :, None] * np.stack([ratios, ratios * [1, 1, -1, -1, 1, 1]])
    role = rng.choice([TRAIN, VALIDATION, TEST], count, p=[0.8, 0.1, 0.1]).astype(np.uint8)
    return Samples(KNEE, poses, wrenches, gaps, np.ones(count, dtype=np.uint8), role)
