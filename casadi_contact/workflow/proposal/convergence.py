"""A proposed scene tried out: its pose at rest, the spacing of thin bodies' distance fields, its element grids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import Array
from casadi_contact.geometry.distance_field import field_fits
from casadi_contact.geometry.projection import DOWN
from casadi_contact.geometry.triangle_mesh import TriangleMesh
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.scenes.scene import Scene
from casadi_contact.workflow.proposal.joint_geometry import Joint

REST_SHARE = 0.3  # of the reference load, on every patch of a body at rest


def rest_pose(
    model: ElasticFoundation,
    joint: Joint,
    direction: Sequence[float],
    lifted_mm: Sequence[float] = (0.0, 0.5, 1.0, 2.0),
) -> tuple[Array, str]:
    """The pose (6,) near the start pose in which every patch carries 0.3 of the scene's reference load, and in words
    why there is none, "" if there is.

    It is also sought from poses lifted against the direction of pressing, because bodies of one scan may overlap.
    """
    scene = model.scene
    out = np.outer(lifted_mm, np.asarray(direction) / np.linalg.norm(direction))
    starts = scene.start_pose - np.pad(out, ((0, 0), (0, 3)))
    poses, report = settle(
        model, starts, scene.sensitive_pose, rest_loads(scene, joint, REST_SHARE * scene.reference_load)
    )
    first = int(report.converged.argmax())
    return poses[first], str(report.reason[first])


def rest_loads(scene: Scene, joint: Joint, size_n: float) -> dict[str, float]:
    """Loads that press every patch with a force of this size along the scene's direction of pressing."""
    if joint.pressing:
        return dict.fromkeys(scene.sensitive_loads, size_n * (-1.0 if joint.pressing[0] == "-" else 1.0))
    pressing = np.array(scene.geometry.get("pressing", DOWN))
    pressing /= np.linalg.norm(pressing)
    return {name: float(size_n * pressing["xyz".index(name[1])]) for name in scene.sensitive_loads}


def gap_slope(model: ElasticFoundation, pose: Array, direction: Sequence[float]) -> float:
    """d√(N/N0)/d(depth) [1/mm] of the median patch, fitted over 0.5 mm along the direction of pressing."""
    depth_mm = np.linspace(0.0, 1.0, 41)[:20]
    moves = np.outer(depth_mm, np.asarray(direction) / np.linalg.norm(direction))
    wrenches = model.wrenches(pose + np.pad(moves, ((0, 0), (0, 3))))
    roots = np.sqrt(np.maximum(normal_forces(model.scene.normal_loads, wrenches), 0.0) / model.scene.reference_load)
    return float(f"{max(np.median(np.polyfit(depth_mm, roots, 1)[0]), 0.1):.2g}")


def thin_spacing(
    meshes: Mapping[str, TriangleMesh],
    thickness_mm: Mapping[str, float],
    usual_mm: float,
    shares: Sequence[float] = (0.15, 0.25),
) -> dict[str, float]:
    """The spacing [mm] of each body's distance field: of thin bodies a share of the thickness, the first that fits into
    memory.

    Half way through a body of thickness t its distance has a kink, which a cubic spline carries to both of its
    surfaces: at a spacing of t/4 by up to 0.004 t, at 0.15 t by 0.0005 t.
    thickness_mm: of both bodies, infinite for open surfaces.
    """
    tried = [
        {body: min(usual_mm, round(share * thickness, 3)) for body, thickness in thickness_mm.items()}
        for share in shares
    ]
    return next((each for each in tried if all(field_fits(meshes[b], mm) for b, mm in each.items())), tried[-1])


CANDIDATES = (
    *((20, 20), (20, 40), (40, 20), (40, 40), (40, 80), (80, 40), (80, 80)),
    *((80, 160), (160, 80), (160, 160), (160, 240), (240, 160)),
)
CONVERGED = (320, 320)


@dataclass(frozen=True)
class GridConvergence:
    """grids: elements by purpose. errors: of every candidate the RMS of its worst load against `CONVERGED`, divided by
    the load's tolerance. fine_enough: a candidate meets the tolerances."""

    grids: dict[str, list[int]]
    errors: dict[tuple[int, int], float]
    fine_enough: bool

    def __str__(self) -> str:
        nx, nz = self.grids["fine"]
        share = self.errors[nx, nz]
        return f"{nx}×{nz} elements a patch are {share:.2g} tolerances (RMS) off {CONVERGED[0]}×{CONVERGED[1]}"


def converged_grids(scene: Scene, poses: Array, most_to_settle: int = 80 * 80) -> GridConvergence:
    """The fewest elements whose loads at these poses (n, 6) are within tolerance of `CONVERGED`.

    "settle" may be wrong by 2 tolerances and "coarse" by 8, both with at most `most_to_settle` elements, because
    thousands of poses are settled on them.
    """
    truth = ElasticFoundation(scene, CONVERGED)(poses)
    errors: dict[tuple[int, int], float] = {}
    for grid in CANDIDATES:
        off = ElasticFoundation(scene, grid)(poses) - truth
        errors[grid] = float((np.sqrt(np.mean(off**2, axis=0)) / scene.tolerances_of()).max())
        if errors[grid] < 0.5 and grid[0] == grid[1]:
            break
    grids = {}
    for purpose, most_error in {"fine": 1.0, "settle": 2.0, "coarse": 8.0}.items():
        tried = [grid for grid in errors if purpose == "fine" or grid[0] * grid[1] <= most_to_settle]
        good = [grid for grid in tried if errors[grid] <= most_error] or [min(tried, key=lambda grid: errors[grid])]
        nx, nz = min(good, key=lambda grid: (grid[0] * grid[1], errors[grid]))
        grids[purpose] = [nx, nz]
    grids["teacher"] = [min(2 * n, 320) for n in grids["fine"]]
    return GridConvergence(grids, errors, min(errors.values()) <= 1.0)
