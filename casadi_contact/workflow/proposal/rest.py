"""What contact itself tells about a proposed scene: a pose at rest, how stiff it is; and a motion to begin with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import Array
from casadi_contact.geometry.projection import DOWN
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.scenes.scene import Scene
from casadi_contact.workflow.proposal.joint import Joint

REST_SHARE = 0.3  # of the reference load
_LIFTED_MM = (0.0, 0.5, 1.0, 2.0)
_DEEPER_MM = np.linspace(0.0, 1.0, 41)


def rest_pose(model: ElasticFoundation, joint: Joint, direction: Sequence[float]) -> tuple[Array, str]:
    """The pose (6,) near the start pose in which every patch carries 0.3 of the scene's reference load, and why there
    is none ("" if there is).

    It is sought from further out too, against the direction of pressing: bodies of one scan may overlap at first.
    """
    scene = model.scene
    out = np.outer(_LIFTED_MM, np.asarray(direction) / np.linalg.norm(direction))
    starts = scene.start_pose - np.pad(out, ((0, 0), (0, 3)))
    poses, report = settle(
        model, starts, scene.sensitive_pose, rest_loads(scene, joint, REST_SHARE * scene.reference_load)
    )
    found = int(report.converged.argmax())
    return poses[found], str(report.reason[found])


def rest_loads(scene: Scene, joint: Joint, size_n: float) -> dict[str, float]:
    """Loads that press every patch with a force of this size along the scene's direction of pressing."""
    if joint.pressing:
        return dict.fromkeys(scene.sensitive_loads, size_n * (-1.0 if joint.pressing[0] == "-" else 1.0))
    pressing = np.array(scene.geometry.get("pressing", DOWN))
    pressing /= np.linalg.norm(pressing)
    return {name: float(size_n * pressing["xyz".index(name[1])]) for name in scene.sensitive_loads}


def gap_slope(model: ElasticFoundation, pose: Array, direction: Sequence[float]) -> float:
    """Root load per mm about a pose at rest: √(N/N0) of a patch gained by pressing 1 mm deeper, the median patch."""
    moves = np.outer(_DEEPER_MM, np.asarray(direction) / np.linalg.norm(direction))
    wrenches = model.wrenches(pose + np.pad(moves, ((0, 0), (0, 3))))
    roots = np.sqrt(np.maximum(normal_forces(model.scene.normal_loads, wrenches), 0.0) / model.scene.reference_load)
    slopes = [np.polyfit(_DEEPER_MM[: len(_DEEPER_MM) // 2], root[: len(_DEEPER_MM) // 2], 1)[0] for root in roots.T]
    return float(f"{max(np.median(slopes), 0.1):.2g}")


def motion(scene: Scene, joint: Joint, largest_n: float) -> dict[str, Any]:
    """A made-up reference motion for a joint without a built-in one: every patch pressed by 10 to 100 % of a load,
    turned by up to 6 degrees where the loads do not turn it; no [motion] for a knee, which walks."""
    if joint.kind == "knee":
        return {}
    mean = rest_loads(scene, joint, 0.55 * largest_n)
    harmonics: dict[str, Any] = {
        f"{name}_N": [round(value, 1), round(-0.8 * value, 1), 0.0] for name, value in mean.items()
    }
    turns = {"rx": [0.0, 0.04, 0.02], "ry": [0.0, 0.02, 0.04], "rz": [0.0, -0.1, 0.05]}
    harmonics |= {f"{name}_rad": curve for name, curve in turns.items() if name not in joint.sensitive_pose}
    return {"motion": {"cycles": 4, "duration_s": 1.0, "deviation": 0.03, "harmonics": harmonics}}
