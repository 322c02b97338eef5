"""The contact model, its wrench and the cycle that a problem runs on."""

import warnings
from collections.abc import Sequence
from pathlib import Path

import casadi as ca
import numpy as np

from casadi_contact.contact.choice import foundation
from casadi_contact.contact.convergence import NotGoodEnoughError
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.symbolic import SymbolicContact, symbolic
from casadi_contact.core.compiler import CompilerError, compiler_command
from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.joint_mechanics import total_selection, whole_wrench
from casadi_contact.samples.reference import found_sensitive_pose, reference_poses
from casadi_contact.scenes.cycle import Cycle
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.walking import has_gait, reference_cycle, reference_motion_cycles
from casadi_contact.surrogate.load import load_surrogate


def load_contact(
    surrogate: str | None = None, scene: str | None = None, *, whole: bool = False, cycles: Sequence[Cycle] = ()
) -> SymbolicContact:
    """A surrogate by name or path, or the foundation of a scene by name or path; that of the scene `knee` for neither,
    or with a warning the surrogate `knee` where there is no C compiler, without which a foundation takes minutes.

    whole: a foundation has the whole wrench among its loads, as equations of motion need it. cycles: at whose poses a
    mesh's foundation is tested too. A scene that no foundation fits takes its fine elements, with a warning."""
    if surrogate is not None and scene is not None:
        raise ValueError(f"got surrogate {surrogate} and scene {scene}, expected one of them")
    if surrogate is None and scene is None:
        try:
            compiler_command()
        except CompilerError as error:
            warnings.warn(f"{error}; the surrogate knee stands for the foundation", RuntimeWarning, stacklevel=2)
            surrogate = "knee"
    if surrogate is not None:
        return load_surrogate(surrogate)
    known = load_scene(scene or "knee")
    poses = _poses_on_elements(known, cycles) if cycles and known.shape == "mesh" else None
    model = _untrained(whole_wrench(known) if whole else known, poses)
    if not model.scene.sensitive_pose:
        found = found_sensitive_pose(model, reference_motion_cycles(model.scene, ()))
        model = _untrained(model.scene.with_sensitive_pose(found))
    return model


def load_cycle(scene: Scene, path: Path | None = None) -> Cycle:
    """The cycle in a CSV file, or that of the scene: of a knee mean walking, else the first of its own motion."""
    if path is None and has_gait(scene):
        return reference_cycle()
    return reference_motion_cycles(scene, [] if path is None else [path])[0]


def wrench_function(model: ContactModel, name: str = "contact_wrench", *, velocity: bool = False) -> ca.Function:
    """casadi.Function pose (6), and velocity (6) if asked for -> total contact wrench on the fixed body (6), about its
    origin [N, N·mm]; ValueError where the model lacks a component of it."""
    total = ca.sparsify(ca.DM(total_selection(model.load_names, model.patch_names)))
    inputs = [ca.MX.sym(key, 6) for key in ("pose", "velocity")[: 1 + velocity]]
    loads = symbolic(model).function(name=f"{name}_loads", velocity=velocity)(*inputs)
    return ca.Function(name, inputs, [ca.mtimes(total, loads)])


def _poses_on_elements(scene: Scene, cycles: Sequence[Cycle], frames: int = 25) -> Array:
    """Poses (n, 6) that carry the cycles' loads on the elements that the scene settles on."""
    elements = ElasticFoundation(scene, scene.grids["settle"])
    found = [reference_poses(elements, [cycle], frames=frames, every_cycle=False) for cycle in cycles]
    return np.concatenate([poses[report.converged] for poses, report in found])


def _untrained(scene: Scene, poses: Array | None = None) -> SymbolicContact:
    try:
        return foundation(scene, poses=poses)
    except NotGoodEnoughError as error:
        elements = ElasticFoundation(scene, scene.grids["fine"])
        said = f"{error}; solved on {elements}, slower and with differenced second derivatives"
        warnings.warn(said, RuntimeWarning, stacklevel=3)
        return symbolic(elements)
