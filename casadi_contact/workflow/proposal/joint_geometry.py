"""What two meshes show of their joint: contact areas over a sweep of poses, the patches into which valleys between them
part the fixed surface, and which kind of joint it is."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

from casadi_contact.core.conventions import WRENCH_NAMES, Array, rotation
from casadi_contact.geometry.mesh import axes_rotation
from casadi_contact.geometry.projection import LEAST_UPWARD
from casadi_contact.geometry.triangle_mesh import TriangleMesh
from casadi_contact.workflow.proposal.pair import (
    AXES,
    REACH_MM,
    ContactPlacement,
    Pair,
    centre_of_normals,
    contact_placement,
    unit_rows,
)


@dataclass(frozen=True)
class PatchSettings:
    """Lengths [mm] of a large joint, multiplied by `Pair.scale`; shares of the summed weight near contact."""

    turns_deg: tuple[float, ...] = (-15.0, 0.0, 15.0)  # about each axis
    near_mm: float = 1.0
    bin_mm: float = 1.0
    smooth_bins: float = 2.0
    valley: float = 0.5  # largest height of a valley, relative to the lower of its two peaks
    least_share: float = 0.1  # of a patch
    least_share_requested: float = 0.03  # of a patch if the user names a joint with two patches
    cup_share: float = 0.95  # share of a cup that is visible from its centre
    plane_cos: float = 0.998  # least cosine between a plane's normals and their mean, for `round_share` of it
    apart_mm: float = 80.0  # most between a knee's two patches
    straight_cos: float = 0.85  # least cosine between a normal and the direction to the centre, for most of a cup
    socket_cos: float = 0.985  # the same for `socket_share` of a ball's socket, which has one patch
    socket_share: float = 0.9
    round_share: float = 0.95  # least share of convex moving surface, for a round body


SETTINGS = PatchSettings()


@dataclass(frozen=True, eq=False)
class Patches:
    """Contact areas of a joint, in the axes of the files: weight (n,), how often each fixed point was near contact,
    times areas; the axis along which patches lie beside each other (None for one patch), cuts_mm between them, rising;
    centres of curvature of the fixed body near contact (3,) and of the moving body for each patch (patches, 3). round:
    the moving body is convex wherever it touches. hollow: the fixed body is a cup about the centre. exchanged: it is a
    dome where the moving one is flat or hollow. plane: which body is one wherever it touches, "" if neither is."""

    weight: Array
    axis: int | None
    cuts_mm: tuple[float, ...]
    centre_mm: Array
    anchors_mm: Array
    round: bool
    hollow: bool
    exchanged: bool
    plane: str

    def patch_of(self, points_mm: Array) -> np.ndarray:
        """Number of the patch (n,) that each point belongs to, by rising coordinate."""
        return _patch_numbers(points_mm, self.axis, self.cuts_mm)

    def mean_normals(self, pair: Pair) -> Array:
        """Unit mean normals (patches, 3) of the fixed surface near contact."""
        of_patch = self.patch_of(pair.points_mm) == np.arange(len(self.anchors_mm))[:, None]
        return unit_rows((self.weight * of_patch) @ pair.normals)


def find_patches(pair: Pair, placement: ContactPlacement, least_share: float = SETTINGS.least_share) -> Patches:
    """Rotate the moving body a little about every axis, let it touch, and collect the surface near contact, split at
    valleys that have at least `least_share` of the weight on each side (1: nowhere), unless it is a ball's socket."""
    centre, pivot = _centre_and_pivot(pair, placement)
    weight, touched = np.zeros(len(pair.points_mm)), []
    for angles in itertools.product(np.radians(SETTINGS.turns_deg), repeat=3):
        R = rotation(angles)
        t = pair.touching(R, pivot - R @ (pivot - placement.translation_mm), placement.pressing)
        near = np.flatnonzero(pair.near(R, t, pair.scale * SETTINGS.near_mm))
        touched.append((near, (pair.points_mm[near] - t) @ R, pair.distances(R, t)[1][near] @ R))
        weight[near] += pair.areas_mm2[near] * pair.areas_mm2[near].sum()  # corners that touch count little

    def share(mask: np.ndarray) -> float:
        return float(weight @ mask) / float(weight.sum())

    towards_centre = np.einsum("nk,nk->n", unit_rows(centre - pair.points_mm), pair.normals)
    axis: int | None = None
    cuts: tuple[float, ...] = ()
    if share(np.abs(towards_centre) > SETTINGS.socket_cos) < SETTINGS.socket_share:
        axis, cuts = _deepest_valleys(pair, weight, placement.pressing, least_share)
    rows, on_moving, gradients = (np.concatenate([each[k] for each in touched]) for k in range(3))
    normals, areas = unit_rows(gradients), pair.areas_mm2[rows]
    numbers = _patch_numbers(pair.points_mm, axis, cuts)[rows]
    each = [numbers == p for p in range(len(cuts) + 1)]
    anchors = np.array([centre_of_normals(on_moving[p], normals[p], areas[p]) for p in each])
    outward_cos = np.einsum("nk,nk->n", unit_rows(on_moving - anchors[numbers]), normals)
    fixed_bend = sum(_bend(pair.points_mm[rows[p]], pair.normals[rows[p]], areas[p]) for p in each)
    moving_bend = sum(_bend(on_moving[p], normals[p], areas[p]) for p in each)
    planes = {"fixed": pair.normals[rows], "moving": normals}
    visible, straight = share(towards_centre > LEAST_UPWARD), share(towards_centre > SETTINGS.straight_cos)
    return Patches(
        weight,
        axis,
        cuts,
        centre,
        anchors,
        round=float(areas @ (outward_cos > 0.0)) > SETTINGS.round_share * float(areas.sum()),
        hollow=visible > SETTINGS.cup_share and straight > 0.5,
        exchanged=moving_bend < 0.25 * fixed_bend,
        plane=next((body for body, of in planes.items() if _is_plane(of, areas)), ""),
    )


def _is_plane(normals: Array, weights: Array) -> bool:
    mean = weights @ normals
    straight = normals @ (mean / np.linalg.norm(mean)) > SETTINGS.plane_cos
    return float(weights @ straight) > SETTINGS.round_share * float(weights.sum())


def _like_condyles(pair: Pair, placement: ContactPlacement, patches: Patches) -> bool:
    """Whether a plane's patches are a knee's: one valley, no wider, over which bodies that just touch are apart. A sole
    that rolls over the ground touches it elsewhere in every pose: valleys between such places part nothing."""
    if len(patches.cuts_mm) != 1:
        return False
    points, of = pair.points_mm, patches.patch_of(pair.points_mm)
    one, other = (np.average(points[of == p], axis=0, weights=patches.weight[of == p]) for p in (0, 1))
    along_cut = np.abs(points[:, patches.axis] - patches.cuts_mm[0]) < pair.scale * REACH_MM
    gap = pair.distances(np.eye(3), placement.translation_mm)[0][along_cut].min(initial=np.inf)
    return bool(gap > pair.scale * REACH_MM and np.linalg.norm(one - other) < SETTINGS.apart_mm)


def _bend(points_mm: Array, normals: Array, weights: Array) -> float:
    """Curvature [1/mm] of a surface, Σ w δx·δn / Σ w δx²: above 0 of a dome, below of a hollow."""
    x, n = (each - weights @ each / weights.sum() for each in (points_mm, normals))
    return float(weights @ (x * n).sum(axis=1) / max(weights @ (x**2).sum(axis=1), 1e-300))


def _patch_numbers(points_mm: Array, axis: int | None, cuts_mm: tuple[float, ...]) -> np.ndarray:
    if axis is None:
        return np.zeros(len(points_mm), dtype=int)
    return np.searchsorted(cuts_mm, points_mm[:, axis], side="right")


def _centre_and_pivot(pair: Pair, placement: ContactPlacement) -> tuple[Array, Array]:
    """The centre of curvature (3,) of the fixed body near contact, and the pivot (3,) of the rotations: the nearer
    centre of curvature. The moving body's is shifted so that it does not roll out of its contact area: a condyle
    rolling in a shallow dish would seem to have several patches."""
    at_touch = (np.eye(3), placement.translation_mm)
    near, spot = (pair.near(*at_touch, pair.scale * mm) for mm in (REACH_MM, SETTINGS.near_mm))
    points, areas = pair.points_mm[near], pair.areas_mm2[near]
    gradients = unit_rows(pair.distances(*at_touch)[1][near])
    fixed, moving = (centre_of_normals(points, normals, areas) for normals in (pair.normals[near], gradients))
    middle = areas @ points / areas.sum()
    if np.linalg.norm(fixed - middle) <= np.linalg.norm(moving - middle):
        return fixed, fixed
    rolled_mm = np.sin(np.radians(max(SETTINGS.turns_deg))) * float(np.linalg.norm(fixed - moving))
    share = min(1.0, float(np.sqrt(pair.areas_mm2[spot].sum() / np.pi)) / rolled_mm)
    return fixed, moving + share * (fixed - moving)


def _deepest_valleys(pair: Pair, weight: Array, pressing: Array, share: float) -> tuple[int | None, tuple[float, ...]]:
    """The axis across the direction of pressing with the deepest valley, and the cuts [mm] in its valleys."""
    best: tuple[float, int | None, tuple[float, ...]] = (1.0, None, ())
    surface = pair.areas_mm2 * (pair.normals @ pressing < 0)
    for axis in range(3):
        if axis != int(np.abs(pressing).argmax()):
            depth, cuts = _valleys(pair.points_mm[:, axis], weight, surface, pair.scale * SETTINGS.bin_mm, share)
            if cuts and depth < best[0]:
                best = (depth, axis, cuts)
    return best[1], best[2]


def _valleys(at: Array, weight: Array, surface: Array, bin_mm: float, share: float) -> tuple[float, tuple[float, ...]]:
    """Height of the deepest valley relative to its lower peak, and the coordinates of all valleys [mm]. The profile is
    the weight per surface area in bins along the coordinate `at`, zero where there is no surface."""
    low, high = at[weight > 0.0].min(), at[weight > 0.0].max()
    edges = np.arange(low, max(high, low + bin_mm) + bin_mm, bin_mm)
    middles = 0.5 * (edges[1:] + edges[:-1])
    profiles = [np.histogram(at, edges, weights=each)[0] for each in (weight, surface)]
    near, whole = ndimage.gaussian_filter1d(profiles, SETTINGS.smooth_bins)
    profile = near / np.maximum(whole, 0.1 * whole.max())
    cuts, depth, start = list[float](), 1.0, 0
    for k in range(1, len(profile) - 1):
        is_minimum = profile[k] <= profile[k - 1] and profile[k] < profile[k + 1]
        if profile[k] != profile[start:].min() and not is_minimum:
            continue
        peak = min(profile[start:k].max(initial=0.0), profile[k + 1 :].max(initial=0.0))
        left, right = near[start:k].sum(), near[k + 1 :].sum()
        if profile[k] < SETTINGS.valley * peak and min(left, right) > share * near.sum():
            cuts.append(float(middles[k]))
            depth, start = min(depth, profile[k] / peak), k
    return depth, tuple(cuts)


JOINTS = ("knee", "hip", "patella", "other")


@dataclass(frozen=True)
class Joint:
    """kind: one of `JOINTS`. patches: names by falling coordinate (library's axes) along which they lie side by side.
    pressing: signed axis of the library along which each patch is pressed ("-y"); "" if the force turns (a cup)."""

    kind: str
    patches: tuple[str, ...]
    pressing: str

    @property
    def sensitive(self) -> list[str]:
        """The scene's loads.sensitive: the normal load of each patch."""
        if not self.pressing:
            return ["F"] if len(self.patches) == 1 else [f"F_{patch}" for patch in self.patches]
        sign = "-" if self.pressing[0] == "-" else "+"
        return [f"{sign}{name}" for name in self._forces]

    @property
    def loads(self) -> list[str]:
        """The scene's loads.names: the normal loads by patch, all others summed over the patches."""
        if not self.pressing:
            split = [f"{force}_{patch}" for patch in self.patches for force in WRENCH_NAMES[:3]]
            return [*(split if len(self.patches) > 1 else WRENCH_NAMES[:3]), *WRENCH_NAMES[3:]]
        pressed = f"F{self.pressing[1]}"
        return [*self._forces, *(name for name in WRENCH_NAMES if name != pressed)]

    @property
    def sensitive_pose(self) -> list[str]:
        """The pose parameters to which the normal loads are most sensitive; of the knee [EF15 §2.1]."""
        if not self.pressing:
            return ["tx", "ty", "tz"]
        press = f"t{self.pressing[1]}"
        if len(self.patches) == 1:
            return [press]
        return [press, "tz" if self.kind == "patella" else "rx" if self.pressing[1] == "y" else "ry"]

    @property
    def _forces(self) -> list[str]:
        force = f"F{self.pressing[1]}"
        return [force] if len(self.patches) == 1 else [f"{force}_{patch}" for patch in self.patches]


@dataclass(frozen=True, eq=False)
class JointGeometry:
    """How and where the bodies touch, and as which joint, in the axes of the files, after a rotation (3, 3) of both."""

    pair: Pair
    placement: ContactPlacement
    patches: Patches
    joint: Joint
    rotation: Array

    @property
    def tilt_deg(self) -> float:
        """Angle between the direction of pressing and the nearest axis; 0 for a cup. At most that of the direction
        midway between the patches: files may place the body on the slope of one of them."""
        midway = self.patches.mean_normals(self.pair).sum(axis=0)
        ways = (self.placement.pressing, midway / np.linalg.norm(midway))
        return min(float(np.degrees(np.arccos(np.abs(way).max()))) for way in ways) if self.joint.pressing else 0.0


def joint_geometry(
    meshes: Mapping[str, TriangleMesh], kind: str | None = None, axes: Sequence[str] | None = None
) -> JointGeometry:
    """Analyse the "moving" and the "fixed" mesh. axes: of the files, which say whereto the body of a known kind of
    joint presses; without them both meshes are rotated and analysed again if it presses across their axes."""
    if axes is not None:
        posterior, up, _ = axes_rotation(axes)
        ways = {"patella": [posterior], "knee": [-up], "hip": [-up], None: [-up, posterior]}.get(kind, AXES)
        return _analysed(meshes, kind, np.eye(3), np.array(ways))
    geometry = _analysed(meshes, kind, np.eye(3))
    if geometry.tilt_deg <= 15.0:
        return geometry
    pressing = geometry.placement.pressing
    axis = np.sign(pressing) * (np.abs(pressing) == np.abs(pressing).max())
    turn, _ = Rotation.align_vectors(axis[None], pressing[None])
    return _analysed(meshes, kind, turn.as_matrix())


def _analysed(meshes: Mapping[str, TriangleMesh], kind: str | None, turn: Array, ways: Array = AXES) -> JointGeometry:
    given = (meshes["moving"], meshes["fixed"])
    pair = Pair.of(*(TriangleMesh(mesh.name, mesh.vertices_mm @ turn.T, mesh.faces) for mesh in given))
    placement = contact_placement(pair, ways)
    patches = find_patches(pair, placement)
    rolls = patches.plane and kind not in ("knee", "patella") and not _like_condyles(pair, placement, patches)
    if patches.axis is not None and (rolls or (kind == "hip" and patches.hollow)):
        patches = find_patches(pair, placement, 1.0)
    if kind in ("knee", "patella") and len(patches.anchors_mm) == 1:
        patches = find_patches(pair, placement, SETTINGS.least_share_requested)
    return JointGeometry(pair, placement, patches, joint_of(pair, placement, patches, kind), turn)


def joint_of(pair: Pair, placement: ContactPlacement, patches: Patches, kind: str | None) -> Joint:
    """The given kind of joint, or the one that the bodies resemble. A single patch with normals less concentrated than
    0.9 encloses the moving body. Two patches whose normals differ by more than 40 degrees are a patella's."""
    count = len(patches.cuts_mm) + 1
    encloses = placement.concentration < 0.9
    if kind is None:
        kind = "hip" if count == 1 and encloses and patches.hollow else "other"
        if count == 2 and pair.scale == 1.0:  # as large as a knee
            one, other = patches.mean_normals(pair)
            kind = "patella" if one @ other < np.cos(np.radians(40.0)) else "knee"
    expected = {"knee": 2, "hip": 1, "patella": 2}.get(kind, count)
    if count != expected:
        raise ValueError(f"the bodies touch in {count} places, a {kind} in {expected}: choose another --joint")
    several = [f"p{k + 1}" for k in range(count)] if kind == "other" else ["med", "lat"]
    names = several if count > 1 else ["contact"]
    force_turns = count == 1 and (kind == "hip" or encloses)
    return Joint(kind, tuple(names), "" if force_turns else "+x" if kind == "patella" else "-y")
