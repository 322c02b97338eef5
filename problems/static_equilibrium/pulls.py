"""Loads that no contact carries, told by a look at their direction and place: nothing is to be sought for the first."""

from __future__ import annotations

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, WRENCH_NAMES, Array
from casadi_contact.core.quantities import three_digits
from casadi_contact.optimisation.starts import shares
from problems.static_equilibrium.problem import StaticEquilibrium


def pulls(problem: StaticEquilibrium) -> np.ndarray:
    """Why no pose carries a row's loads, (n,); "" where their direction does not exclude it.

    Contact pushes: the force on patches that are all pressed along one direction d has F·d > 0, whatever the pose. So
    has the given force, then, if nothing but contact holds the body along d: the translation is free, nothing is tied
    to it, and no spring acts on it.
    """
    normals, space = problem.model.scene.normal_loads, problem.model.scene.pose_space
    words = np.full(len(problem.loads), "", dtype=object)
    if len({(normal.component, normal.sign) for normal in normals}) > 1 or normals[0].index is None:
        return words
    along, sign = normals[0].index, normals[0].sign
    tied = np.count_nonzero(space.matrix[:, along]) > 1
    if POSE_NAMES[along] not in problem.free or tied or problem.stiffness[along] > 0.0:
        return words
    force, side = WRENCH_NAMES[along], "above" if sign > 0.0 else "below"
    for row in np.flatnonzero(sign * problem.loads[:, along] <= 0.0):
        words[row] = (
            f"{force} is {problem.loads[row, along]:g} N, which does not press the bodies together, expected {side} "
            f"0 N: scene {problem.model.scene.name} is pressed along {'+' if sign > 0.0 else '-'}{force} alone, give "
            "it loads that do so"
        )
    return words


def passes_beside(problem: StaticEquilibrium, poses: Array) -> np.ndarray:
    """Which of two patches would have to pull to carry the given loads at poses (n, 6), and by how much, (n,); "" where
    none, and where anything but these two holds what presses them.

    The patches are pressed alike, at their anchors. Contact may lie some mm beside these, so that this tells why
    nothing was found, and excludes nothing.
    """
    scene, words = problem.model.scene, np.full(len(poses), "", dtype=object)
    normals, sensitive = scene.pressed, [POSE_NAMES.index(name) for name in scene.sensitive_pose]
    alike = len(normals) == 2 and len({(normal.component, normal.sign) for normal in normals}) == 1
    loose = all(i in problem.columns and problem.stiffness[i] == 0.0 for i in sensitive)
    if not (alike and loose) or normals[0].direction is None:
        return words
    loads = problem.loads.copy()
    if problem.about == "fixed":
        loads[:, 3:] -= np.cross(poses[:, :3], loads[:, :3])
    for patch, share in zip(scene.patch_names, shares(scene, loads), strict=True):
        for row in np.flatnonzero(share < 0.0):
            pull_n = three_digits(-share[row])
            words[row] = f"the given loads pass beside both patches, {patch} would have to pull by {pull_n} N"
    return words
