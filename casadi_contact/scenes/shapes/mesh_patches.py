"""The patches of a mesh scene's fixed body: their triangles, what is wrong with them, and where they are cut off."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from casadi_contact.core.conventions import Array, rotation
from casadi_contact.geometry.distance_field import DistanceField
from casadi_contact.geometry.elements import Cells
from casadi_contact.geometry.projection import LEAST_UPWARD, Projection, projection_of
from casadi_contact.geometry.triangle_mesh import RayCaster, TriangleMesh
from casadi_contact.scenes.shapes.mesh_bodies import body_field, body_mesh, field_spacing, patch_box, patch_view
from casadi_contact.scenes.shapes.shape import Geometry

_LEAST_AREA_MM2, _LEAST_SIDE_MM = 4.0, 0.2  # of a patch: a smaller spot is no joint's
_SAME_SURFACE = 0.35  # of a cell: farther from the surface, the point beside an edge lies beyond it
_NEAR_MM, _LEAST_NEAR, _MOSTLY = 5.0, 10, 0.9  # elements near the moving body, and the share that is as good as all
_ABOVE_MM, _BELOW_MM, _LARGEST_SHELL_MM = 0.5, 1e-3, 25.0
_SURELY_BORNE = 0.5  # cosine of an angle to the line of sight, well above that of walls which bear no elements
_ROLLING_OVER = 0.3  # sine of the angle that the surface turns away by within a cell: there the part ends
_ALONG_EDGE = 9  # points of each open edge
_NEAR_OPEN_EDGE = 1.5  # cells


def patch_mesh(geometry: Geometry, patch: str, *, reaching: bool = False) -> TriangleMesh:
    """The triangles of the fixed mesh that belong to a patch by their centres, or all that reach into its box.

    Where the scene states `pressing` or `cup_centre`, or the patch `pressing`, only those that face the moving body.
    """
    mesh = body_mesh(geometry, "fixed").inside_box(*patch_box(geometry, patch), reaching=reaching)
    return mesh if reaching else mesh.part(_seen(geometry, patch, mesh.corners_mm.mean(axis=1), mesh.normals))


def bare_mesh(geometry: Geometry, longest_mm: float, *, within: bool) -> TriangleMesh:
    """The triangles of the fixed mesh that bear no elements, divided until their edges are no longer than `longest_mm`.

    within: those in the patches' boxes, too steep for elements of all that hold them, or undercut; else those outside
    of all boxes. Where elements are the triangles themselves each bears whole or not, by its centre; on a grid parts of
    it may.
    """

    def covered(mesh: TriangleMesh, points: Sequence[Array]) -> tuple[np.ndarray, np.ndarray]:
        """Whether a box holds all of some points (f, 3) of each triangle, and whether its patch's elements do."""
        centres, patches = mesh.corners_mm.mean(axis=1), geometry["patches"]
        held = np.array([np.all([_in_box(geometry, patch, each) for each in points], axis=0) for patch in patches])
        seen = np.array([_seen(geometry, patch, centres, mesh.normals) for patch in patches])
        return np.asarray(held.any(axis=0)), np.asarray((held & seen).any(axis=0))

    def chosen(mesh: TriangleMesh) -> TriangleMesh:
        held, borne = covered(mesh, [mesh.corners_mm.mean(axis=1)])
        return mesh.part(held & ~borne if within else ~held)

    mesh = body_mesh(geometry, "fixed")
    if geometry["elements"] == "triangles":
        return _divided(chosen(mesh), longest_mm)
    bare = mesh.part(~covered(mesh, list(np.moveaxis(mesh.corners_mm, 1, 0)))[1])
    return chosen(_divided(bare, longest_mm))


def _divided(mesh: TriangleMesh, longest_mm: float) -> TriangleMesh:
    import trimesh

    if not len(mesh.faces):
        return mesh
    vertices, faces = trimesh.remesh.subdivide_to_size(mesh.vertices_mm, mesh.faces, longest_mm, max_iter=20)
    return TriangleMesh(mesh.name, np.asarray(vertices), np.asarray(faces))


def _seen(geometry: Geometry, patch: str, points: Array, normals: Array) -> np.ndarray:
    """True (n,) where a surface at points (n, 3) with normals (n, 3) bears elements of a patch whose box holds it:
    where it is not too steep, of triangles where it faces the moving body, or anywhere if nothing says where that is.
    """
    grid = geometry["elements"] == "grid"
    if not grid and not {"pressing", "cup_centre"} & {*geometry, *geometry["patches"][patch]}:
        return np.ones(len(points), dtype=bool)
    return np.asarray(_upward(geometry, patch, points, normals) > (LEAST_UPWARD if grid else 0.0))


def _upward(geometry: Geometry, patch: str, points: Array, normals: Array) -> Array:
    """Parts (n,) of normals (n, 3) at points (n, 3) towards where a patch's elements are looked at from."""
    pressing, centre = patch_view(geometry, patch)
    inwards = np.array([pressing]) if centre is None else points - centre
    return np.asarray(-(normals * inwards).sum(axis=1) / np.linalg.norm(inwards, axis=1))


def _in_box(geometry: Geometry, patch: str, points: Array) -> np.ndarray:
    """True (n,) for points (n, 3) within a patch's box."""
    low, high = patch_box(geometry, patch)
    return np.all((points >= low) & (points < high), axis=1)


def patch_projection(geometry: Geometry, patch: str) -> Projection:
    """What a patch's elements and cells are laid out by: rays along `pressing`, or from the middle of a cup."""
    return projection_of(*patch_view(geometry, patch), patch_mesh(geometry, patch, reaching=True))


def check_patches(geometry: Geometry) -> None:
    """Raise ValueError for a patch of hardly any surface."""
    mesh = body_mesh(geometry, "fixed")
    centres, area = mesh.corners_mm.mean(axis=1), mesh.areas_mm2
    for patch in geometry["patches"]:
        low, high = patch_box(geometry, patch)
        found, thin = area[_in_box(geometry, patch, centres)].sum(), (high - low).min() < _LEAST_SIDE_MM
        if found < _LEAST_AREA_MM2 or thin:
            cure = "are its bounds in m? They are in mm" if thin else f"the mesh reaches {mesh.extent}: check them"
            raise ValueError(
                f"scene: geometry.patches.{patch} holds {found:.2g} mm² of the mesh {mesh.name} within its bounds, "
                f"expected {_LEAST_AREA_MM2:g} mm² at least, and bounds {_LEAST_SIDE_MM:g} mm apart: {cure}"
            )


def check_shared(geometry: Geometry, elements: Sequence[Cells]) -> None:
    """Raise ValueError for two patches, with elements in their order, that share some surface: it would count twice.

    Seen from different sides they share what both see: a post's wall and the floor below it nothing.
    """
    patches = dict(zip(geometry["patches"], elements, strict=True))
    for one, other in itertools.permutations(patches, 2):
        centres, normals, areas = patches[one]
        points, normals = centres.reshape(-1, 3), normals.reshape(-1, 3)
        both = _in_box(geometry, other, points) & _seen(geometry, other, points, normals)
        if (shared := areas.ravel()[both].sum()) > 0.0:
            raise ValueError(
                f"scene: geometry.patches.{one} and {other} share {shared:.3g} mm² of the mesh "
                f"{body_mesh(geometry, 'fixed').name}, which would carry load twice: let one begin where the other ends"
            )


def check_side(geometry: Geometry, patch: str, cells: Cells) -> None:
    """Raise ValueError where a patch's grid lies on the far side of a shell (the back of a cup): in the start pose the
    moving body is nearer to the shell's other side, and everything near it faces away."""
    centres, normals = (values[cells[2] > 0.0] for values in cells[:2])
    position = np.array(geometry.get("start_pose", np.zeros(6)))
    R, field = rotation(position[3:]), body_field(geometry, "moving")
    distance, slope = field((centres - position[:3]) @ R)
    mesh = body_mesh(geometry, "fixed")
    far_side, shell = _far_side(mesh, centres, normals)
    seen = (far_side - position[:3]) @ R
    behind, around = field(seen)[0], body_mesh(geometry, "moving").vertices_mm
    # Farther from an open mesh than its field reaches its inside is unknown.
    reached = np.all((seen > around.min(axis=0) - _NEAR_MM) & (seen < around.max(axis=0) + _NEAR_MM), axis=1)
    near = (np.abs(distance) < _NEAR_MM) | (reached & (np.abs(behind) < _NEAR_MM))
    turned_away = shell & (behind < distance) & (np.einsum("nk,nk->n", slope @ R.T, normals) > 0.0)
    if distance.min() < -_NEAR_MM or near.sum() < _LEAST_NEAR or turned_away[near].mean() < _MOSTLY:
        return
    key = f"geometry.patches.{patch}.pressing" if "pressing" in geometry["patches"][patch] else "geometry.pressing"
    cure = f"where to it presses, as {key} = {_opposite(normals[near])}"
    raise ValueError(
        f"scene: the elements of the patch {patch} lie on the side of {mesh.name} that faces away from the moving "
        f"body in its start pose: say {cure if patch_view(geometry, patch)[1] is None else 'where its hollow is'}"
    )


def _far_side(mesh: TriangleMesh, centres: Array, normals: Array) -> tuple[Array, np.ndarray]:
    """Where lines (n, 3) from elements into the body come out of it again, and whether they do within a shell (n,).

    Flat triangles lie a little below the smooth surface of the elements, or above: rays meet them first from outside.
    """
    caster, above = RayCaster(mesh), centres + _ABOVE_MM * normals
    down = caster.first_hits(above, -normals)[0] + _BELOW_MM
    inside = above - np.where(np.isfinite(down), down, _ABOVE_MM)[:, None] * normals
    through, face = caster.first_hits(inside, -normals)
    shell = (through < _LARGEST_SHELL_MM) & caster.leaves(-normals, face)
    return inside - np.where(shell, through, 0.0)[:, None] * normals, shell


def _opposite(normals: Array) -> list[float]:
    """The signed axis nearest to these normals: seen from the other side, where to a body presses."""
    mean = normals.mean(axis=0)
    axis = int(np.abs(mean).argmax())
    return [float(np.sign(mean[axis])) if k == axis else 0.0 for k in range(3)]


def cut_cells(geometry: Geometry, patch: str, cells: Cells, field: DistanceField) -> np.ndarray:
    """True (nx, nz) for cells beside which the surface goes on in no patch, or the mesh was cut open: contact that
    reaches them may be larger than the model knows. At a rim of the part contact ends indeed: the surface turns away
    there, or lies within the patch's own box and is flat enough to bear elements. Where it grows too steep for them, as
    deep in a cup, it goes on.

    What lies beside a cell is looked at a step of the grid away, and not nearer than the field's nodes lie, which round
    off a rim.
    """
    centres, normals, areas = cells
    mesh, cut = body_mesh(geometry, "fixed"), np.zeros(areas.shape, dtype=bool)
    ends = mesh.vertices_mm[mesh.boundary_edges]
    along = np.linspace(0.0, 1.0, _ALONG_EDGE)[:, None, None]
    points = ((1.0 - along) * ends[:, 0] + along * ends[:, 1]).reshape(-1, 3)
    open_edges = cKDTree(points) if len(points) else None
    others = [other for other in geometry["patches"] if other != patch]
    for axis, step in ((0, -1), (0, 1), (1, -1), (1, 1)):
        lacking = areas > 0.0
        beside = np.roll(areas, -step, axis) > 0.0
        at_end = [slice(None), slice(None)]
        at_end[axis] = slice(-1, None) if step > 0 else slice(0, 1)
        beside[tuple(at_end)] = False
        rows = np.nonzero(lacking & ~beside)
        here, normal, sideways = centres[rows], normals[rows], step * _along(cells, axis, rows)
        width = np.maximum(np.linalg.norm(sideways, axis=1), field_spacing(geometry, "fixed"))
        tangent = sideways - np.einsum("nk,nk->n", normal, sideways)[:, None] * normal
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        beyond = here + width[:, None] * tangent
        distance, slope = field(beyond)
        size, away = np.linalg.norm(slope, axis=1), np.einsum("nk,nk->n", slope, tangent)
        turned = np.linalg.norm(np.cross(normal, slope), axis=1) > _ROLLING_OVER * size
        turned_away = turned & (away > -_ROLLING_OVER * size)
        borne = _upward(geometry, patch, beyond, slope) > _SURELY_BORNE * size
        ends_here = _in_box(geometry, patch, beyond) & (turned_away | borne)
        goes_on = (np.abs(distance) < _SAME_SURFACE * width) & ~(turned & (away > 0.0)) & ~ends_here
        for other in others:
            goes_on &= ~_in_box(geometry, other, beyond)
        if open_edges is not None:
            near = open_edges.query(here)[0] < _NEAR_OPEN_EDGE * width
            goes_on = np.where(near, geometry["open_edges"] == "cut", goes_on)
        cut[rows] |= goes_on
    return cut


def _along(cells: Cells, axis: int, rows: tuple[np.ndarray, ...]) -> Array:
    """Steps (n, 3) [mm] of the grid along an axis at cells by their rows: to or from the neighbour there, or, of a cell
    that has none, the mean one between all cells."""
    centres, _, areas = cells
    both = (np.delete(areas, 0, axis) > 0.0) & (np.delete(areas, -1, axis) > 0.0)
    steps = np.where(both[..., None], np.diff(centres, axis=axis), 0.0)
    sides = [[side if each == axis else (0, 0) for each in range(3)] for side in ((0, 1), (1, 0))]
    summed = np.sum([np.pad(steps, side) for side in sides], axis=0)[rows]
    count = np.sum([np.pad(both, side[:2]) for side in sides], axis=0)[rows]
    mean = steps.sum(axis=(0, 1)) / both.sum() if both.any() else np.sqrt(areas.max()) * np.eye(3)[2 * axis]
    return np.where(count[:, None] > 0, summed / np.maximum(count, 1)[:, None], mean)
