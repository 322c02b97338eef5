"""From two mesh files to a proposed scene, and what was understood of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Array, Update
from casadi_contact.core.quantities import FORCE, TORQUE, of_kind, quantity, three_digits
from casadi_contact.geometry.mesh import MM_PER_UNIT, load_mesh
from casadi_contact.geometry.triangle_mesh import TriangleMesh
from casadi_contact.samples.reference import ReferenceReport, reference_poses
from casadi_contact.samples.settings import ALONE_COUNTS
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.mesh_bodies import MOST_BOTH_SIDES, THIN_MM, outer_side, shell_thickness
from casadi_contact.workflow.project import reference_motion_cycles
from casadi_contact.workflow.proposal.damage import folds, holes, rough, specks, spikes
from casadi_contact.workflow.proposal.frame import frame_of
from casadi_contact.workflow.proposal.grids import converged_grids
from casadi_contact.workflow.proposal.joint import Joint
from casadi_contact.workflow.proposal.open_questions import (
    beyond_elements,
    coarse_coordinates,
    shells_passed,
    unsettled,
)
from casadi_contact.workflow.proposal.pair import Pair, across_mm, largest_piece
from casadi_contact.workflow.proposal.rest import REST_SHARE, gap_slope, motion, rest_pose
from casadi_contact.workflow.proposal.sight import Sight, sight_of
from casadi_contact.workflow.proposal.spacings import at_rest
from casadi_contact.workflow.proposal.tables import MATERIALS, direction_of, first_tables

_MOST_DROPPED = 0.6  # of a domain, where the reference motion itself reaches an edge
_TOLERANCE = 0.01  # of the largest load
_LARGEST_LOAD = 1.5  # reference loads of a patch, in a made-up motion
_TEST_CYCLES, _TEST_POSES = 2, 40
_MOSTLY = 0.9  # of the frames of two cycles with a pose, for the others to be tried: those without take seconds each
_OFFSETS_MM = (0.5, 2.0)  # of D1 and D2 in a translation of a large joint that its motion leaves out
_STEPS = ("surfaces", "pose at rest", "two cycles", "element grids", "reference motion", "done")
_LEAST_GUESSED_MM = 10.0  # across the larger body: smaller, and files in centimetres look like a joint's in millimetres
_LEAST_LEVER_MM = 10.0  # of the force that a torque's tolerance is 1 % of: a ball turns about its centre


@dataclass(frozen=True, eq=False)
class Proposal:
    """A scene, its pose at rest (6,), the poses (n, 6) of those frames of its reference motion that settle, of how many
    frames, and what the meshes told and did not."""

    scene: Scene
    joint: Joint
    rest_pose: Array
    poses: Array
    frames: int
    told: list[str]
    untold: list[str]


@dataclass(frozen=True, eq=False)
class _Draft:
    """How the bodies were seen, along which direction (3,) they press, the meshes as in their files and the thickness
    of each; and what grows as the scene is tried: its tables, what the meshes told, and what they did not."""

    sight: Sight
    direction: list[float]
    meshes: dict[str, TriangleMesh]
    shells_mm: dict[str, float]
    tables: dict[str, Any]
    told: list[str]
    untold: list[str]


def propose(
    moving: Path,
    fixed: Path,
    *,
    name: str,
    side: str | None = None,
    kind: str | None = None,
    axes: Sequence[str] | None = None,
    material: str | None = None,
    units: str | None = None,
    progress: Update = lambda what, done, total, remark: None,
) -> Proposal:
    """Look at the meshes, propose a scene, and try it: see the modules of this subpackage for what is found how.

    progress: told of each step before it begins, as of `progress_bars`.

    Raises FileNotFoundError, and ValueError for meshes that cannot work, saying what to do.
    """

    def begin(step: str) -> None:
        progress("proposing a scene", _STEPS.index(step), len(_STEPS) - 1, step)

    begin("surfaces")
    files = {"moving": Path(moving), "fixed": Path(fixed)}
    draft = _drafted(files, name, side=side, kind=kind, axes=axes, material=material, units=units)
    tables, told, untold = draft.tables, draft.told, draft.untold
    begin("pose at rest")
    model, pose = _put_to_rest(draft)
    begin("two cycles")
    poses, report = _reference(tables, cycles=_TEST_CYCLES)
    tables["tolerances"] = _tolerances(model, poses)
    begin("element grids")
    convergence = converged_grids(Scene.from_tables(tables), poses[:: max(1, len(poses) // _TEST_POSES)])
    tables["grids"] = convergence.grids
    (told if convergence.enough else untold).append(f"{'' if convergence.enough else 'enough elements: '}{convergence}")
    begin("reference motion")
    if report.converged.mean() > _MOSTLY:
        poses, report = _reference(tables)
    final = ElasticFoundation(Scene.from_tables(tables))
    tables["sampling"] |= _lost_at_edges(final, poses)
    untold += [*unsettled(final.scene, report), *beyond_elements(final, poses)]
    untold += shells_passed(final, poses, draft.shells_mm)
    begin("done")
    return Proposal(Scene.from_tables(tables), draft.sight.joint, pose, poses, report.converged.size, told, untold)


def _drafted(
    files: Mapping[str, Path],
    name: str,
    *,
    side: str | None,
    kind: str | None,
    axes: Sequence[str] | None,
    material: str | None,
    units: str | None,
) -> _Draft:
    """What the surfaces alone tell."""
    unit, meshes = _meshes(files, units)
    if np.array_equal(meshes["moving"].vertices_mm, meshes["fixed"].vertices_mm):
        raise ValueError(
            f"{files['moving']} and {files['fixed']} hold the same body, expected the two that touch each other"
        )
    sight = sight_of(meshes, kind, upright=axes is None)
    pair, meeting = sight.pair, sight.meeting
    frame = frame_of(sight, side, axes)
    if axes is not None:
        sight = replace(sight, joint=sight.joint.pressed_along(frame.directions(meeting.pressing)))
    joint = sight.joint
    made_of = material or ("cartilage" if meeting.together else "polyethylene")
    tables = first_tables(sight, frame, files, unit, MATERIALS[made_of], name)
    told = [f"both files are in {unit}", *frame.told]
    untold = [*coarse_coordinates(meshes, unit), *frame.untold]
    damages = (specks, spikes, folds, holes, rough)
    untold += [question for mesh in meshes.values() for damage in damages for question in damage(mesh)]
    why = " (--material)" if material else _guess(meeting.together)
    untold.append(f"the material's stiffness and thickness: taken as {made_of}{why}")
    if pair.carrying < pair.scale or (units is None and pair.scale < 1.0):
        untold.insert(0, _small(pair, meshes["fixed"], unit))
    told.insert(1, "the files place both bodies in one frame" if meeting.together else "each body has its own frame")
    if sight.regions.passed_over and kind is None:
        untold.append(
            "a second place of contact, small and clearly apart: taken for part of the one patch (--joint knee or "
            "patella makes two patches)"
        )
    if sight.places > len(joint.patches):
        told.append(f"the bodies touch in {sight.places} places, one patch: turning shifts no load between them")
    shells = {body: shell_thickness(mesh) for body, mesh in meshes.items()}
    if made_of == "cartilage" and (layers := [each for each in shells.values() if each < THIN_MM]):
        tables["material"]["thickness"] = round(sum(layers), 1)
        told.append(
            f"thin shells of {' and '.join(f'{each:.2g}' for each in layers)} mm: the elastic layer's thickness"
        )
    if shells["moving"] < THIN_MM:
        tables["geometry"]["shell"] = _shell(sight)
    return _Draft(sight, direction_of(joint, frame, meeting), meshes, shells, tables, told, untold)


def _put_to_rest(draft: _Draft) -> tuple[ElasticFoundation, Array]:
    """The draft's model and its pose at rest (6,), or at the start where none is found; both go into its tables, with
    how stiff contact is there and what to begin with for samples and motion."""
    tables, joint, direction = draft.tables, draft.sight.joint, draft.direction
    one_sided = tables["geometry"].get("shell") == "outer"  # which is no thin shell
    thickness = {"moving": np.inf if one_sided else draft.shells_mm["moving"], "fixed": draft.shells_mm["fixed"]}
    resting = at_rest(tables, draft.meshes, thickness, lambda model: rest_pose(model, joint, direction))
    model, pose, scene = resting.model, resting.pose, resting.model.scene
    if resting.remark:
        tables["geometry"]["spacing"] = scene.geometry["spacing"]
        (draft.told if resting.enough else draft.untold).append(resting.remark)
    if resting.reason:
        draft.untold.append(
            f"a pose at rest under {three_digits(REST_SHARE * scene.reference_load)} N a patch: {resting.reason}"
        )
        pose = scene.start_pose
    tables["geometry"]["start_pose"] = [round(float(v), 4) for v in pose]
    tables["loads"]["gap_slope"] = gap_slope(model, pose, direction)
    tables["sampling"] = _sampling(joint, draft.sight.pair.scale)
    tables |= motion(scene, joint, _LARGEST_LOAD * scene.reference_load)
    return model, pose


def _shell(sight: Sight) -> str:
    """Which side of a moving shell counts: the outer one where it is one side and what touches is of it, else both."""
    one = sight.regions.round and outer_side(sight.pair.moving, sight.regions.anchors_mm)[1] <= MOST_BOTH_SIDES
    return "outer" if one else "whole"


def _guess(together: bool) -> str:
    """Why a material is guessed, and what to do where the guess is wrong."""
    if together:
        return ", since the files share a frame, as a scan's do; an implant's may as well (--material polyethylene)"
    return ", since the files do not share a frame, as a scan's would (--material cartilage)"


def _small(pair: Pair, fixed: TriangleMesh, unit: str) -> str:
    """The question about a size at which a large joint's file in another unit would look the same, or about loads."""
    if pair.scale < 1.0:
        across = across_mm(fixed)
        return f"the size: a fixed surface {across:.2g} mm across is taken for a small joint's, in {unit} (--units)"
    across = across_mm(largest_piece(fixed))
    return f"the loads: the fixed surface is in pieces of {across:.2g} mm at most, and is loaded as a small joint"


def _meshes(files: Mapping[str, Path], asked: str | None) -> tuple[str, dict[str, TriangleMesh]]:
    """The unit in which both meshes have the size of a joint's, and the meshes as in their files [mm]; no unit but the
    one that is asked for. Centimetres and inches are never guessed, since they would do for most files in millimetres
    or metres: bodies of a few millimetres, if these they are, are asked about."""
    errors = []
    for unit in dict.fromkeys((*(() if asked is None else (asked,)), "mm", "m")):
        try:
            meshes = {body: load_mesh(path, unit) for body, path in files.items()}
        except ValueError as error:
            errors.append(str(error))
            continue
        if asked not in (None, unit):
            break  # the files are in another unit than the one that is asked for
        across = max(map(across_mm, meshes.values()))
        if asked is None and across < _LEAST_GUESSED_MM:
            sizes = [f"{across * MM_PER_UNIT[other]:.3g} mm across in {other}" for other in ("mm", "cm", "inch")]
            raise ValueError(
                f"the larger of {' and '.join(path.name for path in files.values())} is {', '.join(sizes)}, expected "
                f"{_LEAST_GUESSED_MM:g} mm and more for a size that tells the unit: say which it is with --units"
            )
        return unit, meshes
    wrong = {error.partition(" is ")[0] for error in errors}  # in mm one file, in m the other one
    cure = " Say so with --units" if len(wrong) == 1 else " No unit does for both files: scale one"
    cure = cure if "is the file in" in errors[0] else ""
    raise ValueError(next((error for error in errors if "mm across" not in error), errors[0] + cure))


def _sampling(joint: Joint, scale: float) -> dict[str, Any]:
    """Settings of the sampling. The made-up motion moves no translation: offsets of a small joint's are as small as it
    is, of a large joint's as `sampling.envelopes` assumes."""
    if joint.kind == "knee":
        return {"d3_minimum_widths": {"tz": 3.0, "ry": 0.3}}
    still = [name for name in ("tx", "ty", "tz") if name not in joint.sensitive_pose] if scale < 1.0 else []
    offsets = {name: [round(scale * offset, 2) for offset in _OFFSETS_MM] for name in still}
    own = {"fixed_offsets": offsets} if offsets else {}
    return {"counts": dict(ALONE_COUNTS), "liftoff_mm": 0.4, **own}


def _lost_at_edges(model: ElasticFoundation, poses: Array) -> dict[str, Any]:
    """Settings of the sampling where contact reaches an edge in some of the poses (n, 6): what is lost there is told,
    and no reason to refuse what is left."""
    return {"most_dropped": _MOST_DROPPED} if model.at_edge(poses).any() else {}


def _reference(tables: Mapping[str, Any], cycles: int | None = None) -> tuple[Array, ReferenceReport]:
    """The settled poses (n, 6) of the scene's reference motion, or of its first cycles, and what became of each."""
    scene = Scene.from_tables(tables)
    model = ElasticFoundation(scene, scene.grids["settle"])
    poses, report = reference_poses(model, reference_motion_cycles(scene, ())[:cycles], every_cycle=False)
    if not report.converged.any():
        raise ValueError(f"no frame of the reference motion has a pose that carries its loads ({report.reason[0, 0]})")
    return poses[report.converged], report


def _tolerances(model: ElasticFoundation, poses: Array) -> dict[str, float]:
    """1 % of the largest force in the reference motion for every force; of the largest torque, or of that force at a
    least lever, for every torque."""
    largest = dict(zip(model.load_names, np.abs(model(poses)).max(axis=0).tolist(), strict=True))
    of = {kind: max(largest[name] for name in of_kind(model.load_names, kind)) for kind in (FORCE, TORQUE)}
    of[TORQUE] = max(of[TORQUE], _LEAST_LEVER_MM * of[FORCE])
    return {name: float(f"{_TOLERANCE * of[quantity(name).kind]:.2g}") for name in model.load_names}
