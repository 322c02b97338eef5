"""From two mesh files to a proposed scene, with what was recognised and what the user must check."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import Array, Update
from casadi_contact.core.quantities import FORCE, TORQUE, of_kind, quantity
from casadi_contact.geometry.distance_field import SPACING_MM, field_fits
from casadi_contact.geometry.mesh import MM_PER_UNIT, load_mesh
from casadi_contact.geometry.projection import DOWN, axis_name
from casadi_contact.geometry.triangle_mesh import TriangleMesh
from casadi_contact.optimisation.reference import unmodelled_load_shares, unmodelled_load_words
from casadi_contact.samples.reference import ReferenceReport, reference_poses
from casadi_contact.samples.settings import ALONE_COUNTS
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.mesh_bodies import MOST_BOTH_SIDES, THIN_MM, body_mesh, outer_side, shell_thickness
from casadi_contact.scenes.walking import reference_motion_cycles
from casadi_contact.workflow.proposal.frame import Frame, frame_of
from casadi_contact.workflow.proposal.joint_geometry import Joint, JointGeometry, joint_geometry
from casadi_contact.workflow.proposal.pair import extent_mm
from casadi_contact.workflow.proposal.tables import MATERIALS, direction_of, first_tables

REST_SHARE = 0.3  # of the reference load, on every patch of a body at rest


@dataclass(frozen=True, eq=False)
class Proposal:
    """A scene and its pose at rest (6,); settled, frames: how many of its reference motion have a pose, and were tried.
    findings: what was recognised in the meshes; open_questions: what the user must check."""

    scene: Scene
    joint: Joint
    rest_pose: Array
    settled: int
    frames: int
    findings: list[str]
    open_questions: list[str]

    def __str__(self) -> str:
        kind = "" if self.joint.kind == "other" else f"a joint like a {self.joint.kind}, "
        questions = [f"not given by the meshes: {question}" for question in self.open_questions]
        settled = f"{self.settled} of {self.frames} reference frames settle ({self.settled / self.frames:.1%})"
        return "\n".join([f"{kind}patches: {', '.join(self.joint.patches)}", *self.findings, *questions, settled])


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
    """Analyse the meshes, propose a scene, and try it in the first 2 cycles of its reference motion; element grids are
    chosen at 40 of these poses."""
    begin = partial(progress, "proposing a scene")
    begin(0, 4, "surfaces")
    files = {"moving": Path(moving), "fixed": Path(fixed)}
    unit, meshes = load_meshes(files, units)
    if np.array_equal(meshes["moving"].vertices_mm, meshes["fixed"].vertices_mm):
        raise ValueError(f"{files['moving']} and {files['fixed']} hold the same body, expected two that touch")
    geometry = joint_geometry(meshes, kind, axes)
    wider = extent_mm(meshes["fixed"]) > extent_mm(meshes["moving"])
    if geometry.patches.plane == "fixed" and geometry.joint.kind == "other" and wider:  # a plane that moves has no end
        files = {"moving": files["fixed"], "fixed": files["moving"]}
        meshes = {"moving": meshes["fixed"], "fixed": meshes["moving"]}
        geometry = joint_geometry(meshes, kind, axes)
    frame = frame_of(geometry, side, axes)
    if axes is not None and geometry.joint.kind == "other" and geometry.joint.pressing:
        along = axis_name(frame.directions(geometry.placement.pressing))
        geometry = replace(geometry, joint=replace(geometry.joint, pressing=along))
    on_ground = geometry.patches.plane == "moving" and extent_mm(meshes["fixed"]) > 150.0
    made_of = material or ("sole" if on_ground else "cartilage" if geometry.placement.together else "polyethylene")
    findings, questions = _remarks(geometry, frame, unit, made_of, chosen=material is not None)
    tables = first_tables(geometry, frame, files, unit, MATERIALS[made_of], name)
    joint, direction = geometry.joint, direction_of(geometry, frame)
    shells_mm = {body: shell_thickness(mesh) for body, mesh in meshes.items()}
    if made_of == "cartilage" and (layers := [mm for mm in shells_mm.values() if mm < THIN_MM]):
        tables["material"]["thickness"] = round(sum(layers), 1)
        sizes = " and ".join(f"{mm:.2g}" for mm in layers)
        findings.append(f"thin shells of {sizes} mm: the elastic layer's thickness")
    if shells_mm["moving"] < THIN_MM:
        tables["geometry"]["shell"] = _shell(geometry)

    begin(1, 4, "pose at rest")
    # Of a shell that counts on one side alone, only that surface has a distance field.
    one_sided = tables["geometry"].get("shell") == "outer"
    thickness_mm = {**shells_mm, "moving": np.inf if one_sided else shells_mm["moving"]}
    usual_mm = tables["geometry"].get("spacing", SPACING_MM)
    spacing = thin_spacing(meshes, thickness_mm, usual_mm)
    if plane := geometry.patches.plane:  # which may be wide, and is straight
        fitting = (mm for mm in (spacing[plane], 1.0, 1.33) if field_fits(meshes[plane], mm))
        spacing[plane] = next(fitting, spacing[plane])
    if set(spacing.values()) != {usual_mm}:
        tables["geometry"]["spacing"] = spacing
    if min(spacing.values()) < usual_mm:
        findings.append(f"a distance field of {min(spacing.values()):g} mm, as thin bodies need")
    scene = Scene.from_tables(tables)
    try:
        model = ElasticFoundation(scene)
    except ValueError as error:  # its cures are keys of a scene file, which there is not
        raise ValueError(f"{error} (of a scene that was tried: choose other --axes or --joint)") from None
    pose, found = rest_pose(model, joint, direction)
    if found:
        tables["geometry"]["start_pose"] = pose.round(4).tolist()
    tables["loads"]["gap_slope"] = gap_slope(model, pose if found else scene.start_pose, direction)
    tables["sampling"] = _sampling(joint, geometry.pair.scale)
    tables |= made_up_motion(scene, joint)

    begin(2, 4, "reference motion")
    poses, report = _reference(tables)
    if not found:  # a frame of the motion has a pose that carries loads
        pose = poses[0]
        tables["geometry"]["start_pose"] = pose.round(4).tolist()
        tables["loads"]["gap_slope"] = gap_slope(model, pose, direction)
    tables["tolerances"] = motion_tolerances(model, poses)
    begin(3, 4, "element grids")
    tables["grids"], off = converged_grids(Scene.from_tables(tables), poses[:: max(1, len(poses) // 40)])
    (nx, nz), (most_x, most_z) = tables["grids"]["fine"], CONVERGED
    text = f"{nx}×{nz} elements a patch are {off:.2g} tolerances (RMS) off {most_x}×{most_z}"
    findings += [text] if off <= 1.0 else []
    questions += [f"enough elements: {text}"] if off > 1.0 else []
    model = ElasticFoundation(Scene.from_tables(tables))
    questions += _questions_about_motion(model, poses, report)
    begin(4, 4, "done")
    frames = report.converged.size
    return Proposal(Scene.from_tables(tables), joint, pose, len(poses), frames, findings, questions)


def load_meshes(files: Mapping[str, Path], unit: str | None) -> tuple[str, dict[str, TriangleMesh]]:
    """The unit, and both meshes [mm]: the given unit, else mm or m, in which they have the size of a joint, of 10 mm to
    1 m: files in centimetres or inches would seem smaller, and larger in m."""
    errors = []
    for candidate in (unit,) if unit else ("mm", "m"):
        try:
            meshes = {body: load_mesh(path, candidate) for body, path in files.items()}
        except ValueError as error:
            errors.append(str(error))
            continue
        extent = max(map(extent_mm, meshes.values()))
        if unit is None and not 10.0 <= extent <= 1000.0:
            extent /= MM_PER_UNIT[candidate]
            sizes = [f"{extent * MM_PER_UNIT[other]:.3g} mm across in {other}" for other in ("mm", "cm", "inch")]
            names = " and ".join(path.name for path in files.values())
            raise ValueError(f"the larger of {names} is {', '.join(sizes)}: give the unit by --units")
        return candidate, meshes
    raise ValueError(next((error for error in errors if "mm across" not in error), f"{errors[0]} (--units)"))


def _remarks(
    geometry: JointGeometry, frame: Frame, unit: str, material: str, *, chosen: bool
) -> tuple[list[str], list[str]]:
    """Findings and open questions about the surfaces."""
    together = geometry.placement.together
    findings = [f"both files are in {unit}", *frame.findings]
    findings.insert(1, "the files place both bodies in one frame" if together else "each body has its own frame")
    scan = f"the files {'share' if together else 'do not share'} a frame, as a scan's do"
    since = "" if chosen else f", since {'a plane touches what is long' if material == 'sole' else scan}"
    taken = f"the material's stiffness and thickness: taken as {material}{since} (--material)"
    questions = [*frame.open_questions, taken]
    if geometry.pair.scale < 1.0:
        questions.insert(0, f"the size and the loads: taken for a small joint's, in {unit} (--units)")
    return findings, questions


def _shell(geometry: JointGeometry) -> str:
    """Which side of a thin moving shell touches: "outer" if it is convex and has one outer side, else "whole"."""
    patches = geometry.patches
    one = patches.round and outer_side(geometry.pair.moving, patches.anchors_mm)[1] <= MOST_BOTH_SIDES
    return "outer" if one else "whole"


def _sampling(joint: Joint, scale: float, offsets_mm: Sequence[float] = (0.5, 2.0)) -> dict[str, Any]:
    """Settings of the sampling. A small joint's translations outside of its motion vary by scaled offsets (D1, D2)."""
    edges = {"most_edge_share": 0.9, "most_dropped": 0.9}  # validity learns what is unsure, a report tells what is lost
    if joint.kind == "knee":
        return {**edges, "d3_minimum_widths": {"tz": 3.0, "ry": 0.3}}
    still = [name for name in ("tx", "ty", "tz") if name not in joint.sensitive_pose] if scale < 1.0 else []
    offsets = {name: [round(scale * offset, 2) for offset in offsets_mm] for name in still}
    own = {"fixed_offsets": offsets} if offsets else {}
    return {**edges, "counts": dict(ALONE_COUNTS), "liftoff_mm": 0.4, **own}


def made_up_motion(scene: Scene, joint: Joint, load_ratio: float = 1.5) -> dict[str, Any]:
    """A [motion] for a joint without a built-in one: every patch carries 10 to 100 % of 1.5 reference loads, and the
    body rotates by up to 6 degrees about axes that the loads do not determine. A knee walks and needs none."""
    if joint.kind == "knee":
        return {}
    mean = rest_loads(scene, joint, 0.55 * load_ratio * scene.reference_load)
    harmonics: dict[str, Any] = {f"{name}_N": [round(v, 1), round(-0.8 * v, 1), 0.0] for name, v in mean.items()}
    turns = {"rx": [0.0, 0.04, 0.02], "ry": [0.0, 0.02, 0.04], "rz": [0.0, -0.1, 0.05]}
    harmonics |= {f"{name}_rad": curve for name, curve in turns.items() if name not in joint.sensitive_pose}
    return {"motion": {"cycles": 4, "duration_s": 1.0, "deviation": 0.03, "harmonics": harmonics}}


def _reference(tables: Mapping[str, Any]) -> tuple[Array, ReferenceReport]:
    """The settled poses (n, 6) of the first 2 cycles of the scene's reference motion."""
    scene = Scene.from_tables(tables)
    model = ElasticFoundation(scene, scene.grids["settle"])
    poses, report = reference_poses(model, reference_motion_cycles(scene, ())[:2], every_cycle=False)
    if not report.converged.any():
        raise ValueError(f"no frame of the reference motion has a pose that carries its loads ({report.reason[0, 0]})")
    return poses[report.converged], report


def motion_tolerances(model: ContactModel, poses: Array, share: float = 0.01) -> dict[str, float]:
    """A share of the largest force in the poses for every force; of the largest torque, at least that force times
    10 mm, for every torque: a ball turns about its centre without torque."""
    largest = dict(zip(model.load_names, np.abs(model(poses)).max(axis=0).tolist(), strict=True))
    of = {kind: max(largest[name] for name in of_kind(model.load_names, kind)) for kind in (FORCE, TORQUE)}
    of[TORQUE] = max(of[TORQUE], 10.0 * of[FORCE])
    return {name: float(f"{share * of[quantity(name).kind]:.2g}") for name in model.load_names}


def _questions_about_motion(model: ElasticFoundation, poses: Array, report: ReferenceReport) -> list[str]:
    """Frames without a pose, and load in the poses (n, 6) that the model may miss."""
    questions, scene, failed = [], model.scene, ~report.converged
    if failed.any():
        whose = "made up" if "motion" in scene.tables else "of another knee"
        said = f"{int(failed.sum())} of {failed.size} frames ({whose}) find no pose ({report.reason[failed][0]})"
        questions.append(f"whether it can move so: {said}; give measured cycles of this joint")
    if len(body_mesh(scene.geometry, "fixed").boundary_edges):
        questions.append("whether the part ends at the fixed mesh's open edges: taken as cut there (open_edges)")
    some = poses[:: max(1, len(poses) // 50)]
    unmodelled = unmodelled_load_words(unmodelled_load_shares(model, some))
    return [*questions, *(f"load that the model may miss: {words}" for words in unmodelled.values())]


def rest_pose(model: ElasticFoundation, joint: Joint, direction: Sequence[float]) -> tuple[Array, bool]:
    """The pose (6,) near the start pose in which every patch carries 0.3 of the scene's reference load, and whether it
    was found; also from poses lifted against the direction of pressing: bodies of one scan may overlap."""
    scene = model.scene
    out = np.outer((0.0, 0.5, 1.0, 2.0), np.asarray(direction) / np.linalg.norm(direction))
    starts = scene.start_pose - np.pad(out, ((0, 0), (0, 3)))
    loads = rest_loads(scene, joint, REST_SHARE * scene.reference_load)
    poses, report = settle(model, starts, scene.sensitive_pose, loads)
    first = int(report.converged.argmax())
    return poses[first], bool(report.converged[first])


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
    meshes: Mapping[str, TriangleMesh], thickness_mm: Mapping[str, float], usual_mm: float
) -> dict[str, float]:
    """The spacing [mm] of each body's distance field: of thin bodies a share of the thickness (infinite for open
    surfaces), the first that fits into memory. Half way through a body of thickness t its distance has a kink, which a
    cubic spline carries to both of its surfaces: at a spacing of t/4 by up to 0.004 t, at 0.15 t by 0.0005 t."""
    of_all = thickness_mm.items()
    tried = [{body: min(usual_mm, round(share * mm, 3)) for body, mm in of_all} for share in (0.15, 0.25)]
    return next((each for each in tried if all(field_fits(meshes[b], mm) for b, mm in each.items())), tried[-1])


CANDIDATES = (
    *((20, 20), (20, 40), (40, 20), (40, 40), (40, 80), (80, 40), (80, 80)),
    *((80, 160), (160, 80), (160, 160), (160, 240), (240, 160)),
)
CONVERGED = (320, 320)


def converged_grids(scene: Scene, poses: Array, most_to_settle: int = 80 * 80) -> tuple[dict[str, list[int]], float]:
    """By purpose the fewest elements whose loads at these poses (n, 6) are within tolerance of `CONVERGED`, and the RMS
    of the worst load of "fine" over its tolerance. "settle" may be wrong by 2 tolerances and "coarse" by 8, both with
    at most `most_to_settle` elements."""
    truth = ElasticFoundation(scene, CONVERGED)(poses)
    errors: dict[tuple[int, int], float] = {}
    for grid in CANDIDATES:
        off = ElasticFoundation(scene, grid)(poses) - truth
        errors[grid] = float((np.sqrt(np.mean(off**2, axis=0)) / scene.tolerances_of()).max())
        if errors[grid] < 0.5 and grid[0] == grid[1]:
            break
    chosen = {}
    for purpose, most_error in {"fine": 1.0, "settle": 2.0, "coarse": 8.0}.items():
        tried = [grid for grid in errors if purpose == "fine" or grid[0] * grid[1] <= most_to_settle]
        good = [grid for grid in tried if errors[grid] <= most_error] or [min(tried, key=lambda grid: errors[grid])]
        chosen[purpose] = min(good, key=lambda grid: (grid[0] * grid[1], errors[grid]))
    nx, nz = chosen["fine"]
    grids = {purpose: [*grid] for purpose, grid in chosen.items()} | {"teacher": [min(2 * n, 320) for n in (nx, nz)]}
    return grids, errors[nx, nz]
