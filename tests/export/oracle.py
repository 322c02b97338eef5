"""Loads and both derivatives of the same model from its CasADi graph, which no bridge uses for its own numbers."""

import casadi as ca
import numpy as np

import casadi_contact as cc
from tests.support.random_surrogates import random_poses, random_surrogate, scene_called

SURROGATE = random_surrogate(scene_called("knee"), "patch", seed=4)
POSES = random_poses(12, seed=9)
ON_PLANE = np.array([0.1, 29.9, 0.0, 0.0, 0.0, 0.1])  # a sphere of 30 mm


def sphere_elements():
    """A contact model that has slopes and no second derivatives."""
    return cc.ElasticFoundation(cc.load_scene("sphere_on_plane"), grid=(40, 40))


def graph_derivatives(model, poses):
    """Loads (n, L), Jacobians (n, L, 6) and Hessians (n, L, 6, 6)."""
    pose, function = ca.MX.sym("pose", 6), model.function()
    jacobian = ca.jacobian(function(pose), pose)
    both = ca.Function("both", [pose], [function(pose), jacobian, ca.jacobian(ca.vec(jacobian), pose)])
    rows = [[part.full() for part in both(p)] for p in poses]
    loads, slopes, bends = (np.stack(parts) for parts in zip(*rows, strict=True))
    count = slopes.shape[1]
    return loads[..., 0], slopes, bends.reshape(len(poses), 6, count, 6).swapaxes(1, 2)
