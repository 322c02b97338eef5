"""The library's axes and origins in terms of the files', and whether the joint is mirrored."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.mesh import Placement, axes_rotation
from casadi_contact.geometry.projection import axis_name
from casadi_contact.workflow.proposal.joint_geometry import JointGeometry
from casadi_contact.workflow.proposal.pair import REACH_MM


@dataclass(frozen=True)
class Frame:
    """Axes as in a scene's geometry, and the placements of the two bodies. rotation_deg: of both placements. findings:
    what was recognised; open_questions: what the user must check."""

    axes: tuple[str, ...]
    mirror: str
    offsets_mm: dict[str, tuple[float, ...]]
    rotation_deg: tuple[float, ...] = (0.0, 0.0, 0.0)
    findings: list[str] = field(default_factory=list)
    open_questions: list[str] = field(default_factory=list)

    def directions(self, vectors: Array) -> Array:
        """Vectors (..., 3) of the files in the library's axes."""
        return Placement(mirror=self.mirror).points(vectors @ axes_rotation(self.axes).T)

    def points(self, points_mm: Array, body: str) -> Array:
        """Points (n, 3) of a body's file [mm] in its frame."""
        return np.asarray(self.directions(points_mm) + self.offsets_mm[body])


def frame_of(geometry: JointGeometry, side: str | None = None, axes: Sequence[str] | None = None) -> Frame:
    """x posterior, y superior, z medial as far as the surfaces tell; a left joint is mirrored in z. axes: those of a
    scene's geometry, if known. Raises ValueError if the patches do not lie side by side along their z."""
    findings: list[str] = []
    questions: list[str] = []
    patches, kind = geometry.patches, geometry.joint.kind
    if turned_deg := float(np.degrees(Rotation.from_matrix(geometry.rotation).magnitude())):
        findings.append(f"the bodies stand askew by {turned_deg:.0f} degrees: turned, see placement")
    if axes is not None and patches.axis is not None and not axes_rotation(axes)[2, patches.axis]:
        raise ValueError(f"--axes {','.join(axes)}: patches lie in a row along {'xyz'[patches.axis]}, expected as z")
    if patches.exchanged and not patches.plane:
        questions.append("which body is the fixed one: it is domed, the moving one flat or hollow: files exchanged?")
    if patches.plane:
        findings.append(f"the {patches.plane} body is a plane wherever they touch")
    if axes is not None:
        findings.append(f"the moving body presses along the file's {axis_name(geometry.placement.pressing)}")
    if axes is None and (others := [axis_name(way) for way in geometry.placement.doubtful]):
        taken = axis_name(geometry.placement.pressing)
        questions.append(f"which way the moving body presses: taken as {taken}, not {', '.join(others)} (--axes)")
    mirror = "z" if side == "left" and kind != "other" else ""
    if kind != "other":
        findings.append(f"a {side} joint, mirrored in z into a right one" if mirror else "a right joint")
        if side is None:
            questions.append("the side: taken as right (--side left mirrors it)")
    elif side is not None:
        questions.append(f"--side {side} is ignored: only a knee, a hip or a patella has a side (--joint)")
    chosen = tuple(axes) if axes is not None else _axes(geometry, mirror, findings, questions)
    to_library = Placement(mirror=mirror).points(axes_rotation(chosen).T).T
    offsets = _offsets(geometry, to_library, findings)
    turn = Rotation.from_matrix(to_library @ geometry.rotation @ to_library.T).as_euler("XYZ", degrees=True)
    return Frame(chosen, mirror, offsets, tuple(turn.round(4).tolist()), findings, questions)


def _axes(geometry: JointGeometry, mirror: str, findings: list[str], questions: list[str]) -> tuple[str, ...]:
    """The axes nearest to the directions that the surfaces show, by rows of the library's axes."""
    pressing, kind = geometry.placement.pressing, geometry.joint.kind
    target = {1: -pressing}
    if kind == "patella":
        target = {0: pressing}
        findings.append(f"the moving body presses along the file's {axis_name(pressing)}: posterior (+x)")
        questions.append("which way along the groove is superior: kept as in the file where it can be (--axes)")
    elif kind == "hip":
        level = pressing - pressing * (np.arange(3) == np.abs(pressing).argmax())
        target = {1: pressing, 2: -level if mirror else level}
        taken = f"the file's {axis_name(pressing)} and {axis_name(level)}"
        questions.append(f"which way is up and which medial: taken as {taken}, where the cup is deep (--axes)")
    else:
        findings.append(f"the fixed surface faces the file's {axis_name(-pressing)}: up (+y)")
    if kind == "knee":
        target[0] = _posterior(geometry, findings, questions)
    elif kind == "other":
        questions.append("what x and z stand for: kept as in the file where they can be (--axes)")

    turns = Rotation.create_group("O").as_matrix().round()  # onto the library's axes from any right-handed ones
    if geometry.patches.axis is not None:
        turns = turns[turns[:, 2, geometry.patches.axis] != 0.0]
    agreement = np.sum([turns[:, row] @ direction for row, direction in target.items()], axis=0)
    kept = np.trace(turns + 0.1 * np.abs(turns), axis1=1, axis2=2)  # among equals those nearest to the file's own
    best = turns[np.lexsort((kept, agreement.round(6)))[-1]]
    return tuple(("-" if row.sum() < 0.0 else "") + "xyz"[np.abs(row).argmax()] for row in best)


def _posterior(geometry: JointGeometry, findings: list[str], questions: list[str]) -> Array:
    """The unit vector (3,) towards the notch between a femur's condyles; the groove of the patella lies opposite. In
    the band of half-width 4 mm between the condyles, the mean vertex lies on the side of the groove."""
    pair, axis = geometry.pair, geometry.patches.axis
    assert axis is not None
    across = [a for a in range(3) if a != axis]
    flat = min(across, key=lambda a: abs(float((geometry.patches.weight @ pair.normals)[a])))
    vertices = pair.moving.vertices_mm
    along = vertices[:, axis]
    band = np.abs(along - 0.5 * (along.max() + along.min())) < max(pair.scale * 4.0, 0.06 * np.ptp(along))
    anterior = float((vertices - vertices.mean(axis=0))[band, flat].mean()) if band.any() else 0.0
    posterior = np.asarray(-np.sign(anterior or -1.0) * np.eye(3)[flat])
    if abs(anterior) > pair.scale * 2.0:
        findings.append(f"posterior is the file's {axis_name(posterior)}: condyles are joined at the other end")
    else:
        questions.append(f"which way is posterior: taken as the file's {axis_name(posterior)}; flexion is rz < 0")
    return posterior


def _offsets(geometry: JointGeometry, to_library: Array, findings: list[str]) -> dict[str, tuple[float, ...]]:
    """Offsets [mm] of the bodies that bring their origins to meaningful points; zero if the files' own are.

    - Files whose origin lies more than 50 mm from the bodies, as a scan's: to the centre of curvature of the moving
      body near contact, of a ball in a cup to the cup's centre; the same for both bodies of one scan.
    - The ball of a cup, more than 2 mm from its origin: to its centre, or rotations would use up the clearance.
    - The fixed body of a knee of one scan: to the middle of contact, because centres of pressure refer to it."""
    pair, placement, patches, joint = geometry.pair, geometry.placement, geometry.patches, geometry.joint
    centre = patches.anchors_mm.mean(axis=0) + placement.translation_mm if joint.pressing else patches.centre_mm
    origins = {}
    for body, points in (("moving", pair.moving.vertices_mm), ("fixed", pair.points_mm)):
        low, high = points.min(axis=0), points.max(axis=0)
        far = np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0)) > 50.0
        origins[body] = centre if far else np.zeros(3)
        if far and body == "moving" and not placement.together:
            origins[body] = centre - placement.translation_mm
    if any(origin.any() for origin in origins.values()):
        if placement.together:
            origins = dict.fromkeys(origins, centre)
        moved = " and ".join(body for body, origin in origins.items() if origin.any())
        findings.append(f"the origin of the {moved} file lay far from the bodies: moved to what turns, see placement")
    to_ball_mm = float(np.linalg.norm(patches.anchors_mm[0]))
    if not joint.pressing and not origins["moving"].any() and to_ball_mm > pair.scale * 2.0:
        origins["moving"] = patches.anchors_mm[0]
        findings.append(f"the moving body's origin lay {to_ball_mm:.3g} mm from what it turns about: moved there")
    if joint.kind == "knee" and placement.together:
        up = np.arange(3) == np.abs(placement.pressing).argmax()
        # The mean of the patches' centres of contact; along the axis between patches the mean cut.
        near = pair.near(np.eye(3), placement.translation_mm, pair.scale * REACH_MM)
        weight, patch = pair.areas_mm2 * near, patches.patch_of(pair.points_mm)
        of = [patch == p for p in np.unique(patch)]
        middle = np.mean([weight[p] @ pair.points_mm[p] / weight[p].sum() for p in of], axis=0)
        if patches.axis is not None:
            middle[patches.axis] = np.mean(patches.cuts_mm)
        origins["fixed"] = np.where(up, origins["fixed"], middle)
        findings.append("the fixed body's origin was moved to the middle of contact: centres of pressure refer to it")
    return {body: tuple((0.0 - to_library @ origin).round(3).tolist()) for body, origin in origins.items()}
