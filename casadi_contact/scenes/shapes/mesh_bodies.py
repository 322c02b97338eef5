"""The bodies of a mesh scene by its [geometry]: meshes and smooth surfaces, made once in a process, and the patches."""

import itertools
from collections.abc import Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.distance_field import DistanceField, kept_field
from casadi_contact.geometry.elements import CellGrid
from casadi_contact.geometry.mesh import FILE_AXES, Box, Placement, file_digest, load_mesh
from casadi_contact.geometry.projection import DOWN, LEAST_UPWARD, Projection, projection_of
from casadi_contact.geometry.smooth_surface import SmoothSurface
from casadi_contact.geometry.triangle_mesh import RayCaster, TriangleMesh
from casadi_contact.scenes.shapes.shape import patch_anchors

MOST_BOTH_SIDES = 0.2  # largest share of an outer side's area that holds both sides of a shell: some of its rim
LONGEST_MM = 3.0  # edges of triangles that are elements
THIN_MM = 4.0  # a moving body thinner than this is a shell: overlaps may reach its middle


class _Source(NamedTuple):
    """All that a body's mesh and field are made of. about_mm: the points that a shell's outer side faces away from."""

    path: str
    digest: str
    units: str
    axes: tuple[str, ...]
    contact: tuple[Box, ...] | None
    placement: Placement
    about_mm: tuple[tuple[float, ...], ...] | None


Geometry = Mapping[str, Any]
_NO_BOUND = [-np.inf, np.inf]


def body_mesh(geometry: Geometry, body: str) -> TriangleMesh:
    """The mesh of the "moving" or the "fixed" body, in mm and the library's axes. Raises FileNotFoundError for a
    missing file, ValueError for one that changed since the scene was loaded or that the geometry does not name."""
    return _mesh(_source(geometry, body))


def body_field(geometry: Geometry, body: str) -> DistanceField:
    """The signed distance from the body's smooth surface, in the body's own frame; its `fit` says how good it is."""
    return _field(body_mesh(geometry, body), field_spacing(geometry, body))


def field_spacing(geometry: Geometry, body: str) -> float:
    """The spacing [mm] of the nodes of the body's distance field; the backing has that of the fixed body."""
    spacing = geometry["spacing"]
    return float(spacing["fixed" if body == "backing" else body] if isinstance(spacing, Mapping) else spacing)


def body_surface(geometry: Geometry, body: str) -> SmoothSurface:
    """The body's smooth surface, in the body's own frame."""
    return _surface(body_mesh(geometry, body))


def backing_depths(
    geometry: Geometry, points_mm: Array, normals: Array, flattest: float = 0.3, least_mm: float = 0.2, rounds: int = 30
) -> Array:
    """The way (n,) [mm] from points (n, 3) of the fixed surface along minus their normals (n, 3) to the smooth surface
    of the backing, at least least_mm, by Newton's method on its distance g: d ← d - g/g'. Beyond the backing's rim the
    normal misses it; there g' is taken as `flattest` at least, which gives the slanted way to the nearest part."""
    field, way = body_field(geometry, "backing"), np.zeros(len(points_mm))
    for _ in range(rounds):
        g, slope = field(points_mm - way[:, None] * normals)
        step = g / np.maximum(np.einsum("nk,nk->n", slope, normals), flattest)
        way += step
        if np.abs(step).max(initial=0.0) < 1e-6:
            break
    return np.maximum(way, least_mm)


def check_shells(geometry: Geometry, most_spacing: float = 0.4) -> None:
    """Raise ValueError for a moving body that is a thin shell, unless the scene says which side of it counts, and for a
    shell whose field's spacing exceeds 0.4 times its thickness: its surface would be wrong by 0.01 mm and more."""
    for body in {"moving", "fixed"} & {*geometry}:
        source = _source(geometry, body)
        if source.about_mm is not None or (thickness := shell_thickness(_mesh(source))) > THIN_MM:
            continue
        what = f"scene: the {body} mesh {Path(source.path).name} is a thin shell about {thickness:.2g} mm thick"
        if body == "moving" and "shell" not in geometry:
            cure = "set geometry.shell to 'outer' (its side away from the anchors counts) or 'whole' (small overlaps)"
            raise ValueError(f"{what}, which loses load where it is pressed as deep: {cure}")
        if (spacing := field_spacing(geometry, body)) > (allowed := most_spacing * thickness):
            raise ValueError(f"{what}, geometry.spacing = {spacing:g} mm is too coarse: expected {allowed:.2g} at most")


@lru_cache(maxsize=8)
def shell_thickness(mesh: TriangleMesh) -> float:
    """The way [mm] from its triangles straight through a body, the median; infinite where most rays do not come out of
    it, as behind a single open surface. A shell with a hole, or of two loose sheets, is as thin as a closed one."""
    return float(np.median(_through(mesh)[0]))


def outer_side(mesh: TriangleMesh, anchors_mm: Array) -> tuple[np.ndarray, float]:
    """Triangles (f,) of a shell that face away from the nearest anchor (patches, 3); share of area with both sides."""
    centres = mesh.corners_mm.mean(axis=1)
    away = centres - anchors_mm[np.linalg.norm(centres[:, None] - anchors_mm, axis=2).argmin(axis=1)]
    outer = np.einsum("nk,nk->n", away, mesh.area_vectors_mm2) > 0.0
    thickness, behind = _through(mesh)
    areas = mesh.areas_mm2 * outer
    return outer, float(areas @ (outer[behind] & (thickness < THIN_MM)) / max(areas.sum(), 1e-300))


def _through(mesh: TriangleMesh, below_mm: float = 1e-3) -> tuple[Array, np.ndarray]:
    """The thickness (f,) [mm] below each triangle, infinite if no ray leaves it, and the triangle it leaves by."""
    caster, inwards = RayCaster(mesh), -mesh.normals
    distance, face = caster.first_hits(mesh.corners_mm.mean(axis=1) + below_mm * inwards, inwards)
    return np.where(caster.leaves(inwards, face), distance, np.inf), face


def patch_box(geometry: Geometry, patch: str) -> tuple[Array, Array]:
    """Lowest and highest corner (3,) of the box that bounds a patch, infinite where the scene names no bound [mm]."""
    bounds = geometry["patches"][patch]
    box = np.array([bounds.get(axis, _NO_BOUND) for axis in FILE_AXES])
    return box[:, 0], box[:, 1]


def patch_view(geometry: Geometry, patch: str) -> tuple[list[float], list[float] | None]:
    """Where to the moving body presses (3,), and, unless the patch states it itself, a `cup_centre` (3,) [mm]."""
    scene = geometry.get("pressing", DOWN)
    own = geometry["patches"][patch].get("pressing")
    return (list(scene), geometry.get("cup_centre")) if own is None else (own, None)


def _source(geometry: Geometry, body: str) -> _Source:
    """contact: where the fixed body is touched, its patches; the moving one may be touched anywhere."""
    if body not in geometry:
        raise ValueError(f"the scene's geometry names no mesh of its {body} body, expected a scene of the shape mesh")
    path = Path(geometry[body])
    digest = file_digest(path)
    if geometry.get(f"{body}_sha256", digest) != digest:
        raise ValueError(f"scene: {path} has changed since the scene was made with it: load it again")
    about = contact = None
    if body == "fixed":
        boxes = (np.array(patch_box(geometry, patch)).tolist() for patch in geometry["patches"])
        contact = tuple((tuple(low), tuple(high)) for low, high in boxes)
    elif geometry.get("shell") == "outer":
        about = tuple(map(tuple, patch_anchors(geometry).tolist()))
    placed: dict[str, Any] = dict(geometry.get("placement", {}).get("fixed" if body == "backing" else body, {}))
    placed |= {key: tuple(placed[key]) for key in placed if key != "mirror"}
    placement = Placement(**placed)
    return _Source(str(path), digest, geometry["units"], tuple(geometry["axes"]), contact, placement, about)


@lru_cache(maxsize=8)
def _mesh(source: _Source) -> TriangleMesh:
    mesh = load_mesh(source.path, source.units, source.axes, source.contact, source.placement)
    if source.about_mm is None:
        return mesh
    outer, both = outer_side(mesh, np.array(source.about_mm))
    if both > MOST_BOTH_SIDES:
        got = f"geometry.shell = 'outer' keeps both sides of {mesh.name} over {both:.0%}, expected one"
        raise ValueError(f"scene: {got}: cut the mesh to what touches, or set it to 'whole' for small overlaps")
    return mesh.part(outer)


_surface = lru_cache(maxsize=4)(SmoothSurface)


@lru_cache(maxsize=4)
def _field(mesh: TriangleMesh, spacing_mm: float) -> DistanceField:
    return kept_field(mesh, spacing_mm, partial(_surface, mesh))


@lru_cache(maxsize=16)
def _boxed(mesh: TriangleMesh, low: tuple[float, ...], high: tuple[float, ...]) -> TriangleMesh:
    return mesh.inside_box(np.array(low), np.array(high), reaching=True)


_divided = lru_cache(maxsize=16)(TriangleMesh.subdivided)


def patch_mesh(geometry: Geometry, patch: str, *, reaching: bool = False) -> TriangleMesh:
    """All triangles of the fixed mesh that reach into a patch's box, or those that belong to it by their centres,
    divided until no edge is longer than 3 mm or, of a small moving body, a twelfth of its size, since contact counts
    at centres alone. Where scene or patch state `pressing`, or `cup_centre`, only those that face the moving body."""
    box = patch_box(geometry, patch)
    mesh = _boxed(body_mesh(geometry, "fixed"), tuple(box[0]), tuple(box[1]))
    if reaching:
        return mesh
    size_mm = np.ptp(body_mesh(geometry, "moving").vertices_mm, axis=0).max() if "moving" in geometry else np.inf
    mesh = _divided(mesh, min(LONGEST_MM, float(size_mm) / 12.0)).inside_box(*box)
    return mesh.part(_seen(geometry, patch, mesh.corners_mm.mean(axis=1), mesh.normals))


def bare_mesh(geometry: Geometry, longest_mm: float, low: Array, high: Array, *, within: bool) -> TriangleMesh:
    """The triangles of the fixed mesh without elements that reach into the box [mm], divided until no edge is longer
    than `longest_mm`. within: those in the patches' boxes that are too steep for elements, or undercut; else those
    outside of all boxes. A triangle that is an element counts as a whole, by its centre; else by its parts."""

    def covered(mesh: TriangleMesh, points: Sequence[Array]) -> tuple[np.ndarray, np.ndarray]:
        """Whether a box holds all of some points (f, 3) of each triangle, and whether its patch's elements do."""
        centres, patches = mesh.corners_mm.mean(axis=1), geometry["patches"]
        boxed = np.array([np.all([_in_box(geometry, patch, each) for each in points], axis=0) for patch in patches])
        seen = np.array([_seen(geometry, patch, centres, mesh.normals) for patch in patches])
        return np.asarray(boxed.any(axis=0)), np.asarray((boxed & seen).any(axis=0))

    def reached(mesh: TriangleMesh, longest_mm: float) -> TriangleMesh:
        for length in (8.0 * longest_mm, longest_mm):  # of a plate's large triangles what is near is divided alone
            mesh = mesh.subdivided(length)
            corners = mesh.corners_mm
            mesh = mesh.part(((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1))
        return mesh

    mesh = body_mesh(geometry, "fixed")
    if on_grid := geometry["elements"] == "grid":
        mesh = reached(mesh.part(~covered(mesh, list(np.moveaxis(mesh.corners_mm, 1, 0)))[1]), longest_mm)
    boxed, borne = covered(mesh, [mesh.corners_mm.mean(axis=1)])
    chosen = mesh.part(boxed & ~borne if within else ~boxed)
    return chosen if on_grid else reached(chosen, longest_mm)


def _seen(geometry: Geometry, patch: str, points: Array, normals: Array) -> np.ndarray:
    """Mask (n,) of points (n, 3) of a patch's box that bear elements: on a grid those whose normals (n, 3) are not too
    steep, of triangles those that face the moving body (all, if the scene gives no direction)."""
    grid = geometry["elements"] == "grid"
    if not grid and not {"pressing", "cup_centre"} & {*geometry, *geometry["patches"][patch]}:
        return np.ones(len(points), dtype=bool)
    return np.asarray(_upward(geometry, patch, points, normals) > (LEAST_UPWARD if grid else 0.0))


def _upward(geometry: Geometry, patch: str, points: Array, normals: Array) -> Array:
    """Components (n,) of normals (n, 3) at points (n, 3) towards the side from which a patch is pressed."""
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


def check_patches(geometry: Geometry, least_mm2: float = 4.0, least_side_mm: float = 0.2) -> None:
    """Raise ValueError for a patch with hardly any surface."""
    for patch in geometry["patches"]:
        low, high = patch_box(geometry, patch)
        mesh = _divided(patch_mesh(geometry, patch, reaching=True), LONGEST_MM)
        inside, thin = _in_box(geometry, patch, mesh.corners_mm.mean(axis=1)), (high - low).min() < least_side_mm
        area_mm2 = mesh.areas_mm2[inside].sum()
        if area_mm2 < least_mm2 or thin:
            remedy = "are they in m?" if thin else f"the mesh reaches {body_mesh(geometry, 'fixed').extent}"
            got = f"{area_mm2:.2g} mm² of the mesh {mesh.name} within its bounds"
            expected = f"{least_mm2:g} mm² at least, and bounds {least_side_mm:g} mm apart: {remedy}"
            raise ValueError(f"scene: geometry.patches.{patch} holds {got}, expected {expected}")


def check_shared(geometry: Geometry, elements: Sequence[CellGrid]) -> None:
    """Raise ValueError for two patches, with elements in their order, that share some surface: it would count twice.
    Seen from different sides they share what both see: a post's wall and the floor below it nothing."""
    patches = dict(zip(geometry["patches"], elements, strict=True))
    for one, other in itertools.permutations(patches, 2):
        centres, normals, areas = patches[one]
        points, normals = centres.reshape(-1, 3), normals.reshape(-1, 3)
        both = _in_box(geometry, other, points) & _seen(geometry, other, points, normals)
        if (shared := areas.ravel()[both].sum()) > 0.0:
            got = f"share {shared:.3g} mm² of the mesh, which would carry load twice"
            raise ValueError(f"scene: geometry.patches.{one} and {other} {got}: let one begin where the other ends")


def cut_cells(
    geometry: Geometry,
    patch: str,
    cells: CellGrid,
    field: DistanceField,
    *,
    same_surface: float = 0.35,
    turning_sine: float = 0.3,
    flat_cosine: float = 0.5,
    edge_cells: float = 1.5,
) -> np.ndarray:
    """Mask (nx, nz) of cells beside which the surface goes on without elements, or the mesh was cut open.

    Contact that reaches them may be larger than the model knows. A point one step of the grid away from an outermost
    cell (at least the spacing of the field, which rounds off rims) decides. The surface goes on if it passes within
    ``same_surface`` of the step from this point, except

    - if it turns away by more than an angle of sine ``turning_sine`` within the patch's box: a rim of the part;
    - if it is flat enough to bear elements there (cosine to the line of sight above ``flat_cosine``);
    - in another patch.

    Within ``edge_cells`` steps of an open edge of the mesh, geometry.open_edges decides instead.
    """
    centres, normals, areas = cells
    mesh, cut, present = body_mesh(geometry, "fixed"), np.zeros(areas.shape, dtype=bool), np.pad(areas > 0.0, 1)
    ends = mesh.vertices_mm[mesh.boundary_edges]
    along = np.linspace(0.0, 1.0, 9)[:, None, None]
    points = ((1.0 - along) * ends[:, 0] + along * ends[:, 1]).reshape(-1, 3)
    open_edges = cKDTree(points) if len(points) else None
    others = [other for other in geometry["patches"] if other != patch]
    for axis, step in ((0, -1), (0, 1), (1, -1), (1, 1)):
        beside = np.roll(present, -step, axis)
        rows = np.nonzero((present & ~beside)[1:-1, 1:-1])
        centre, normal, sideways = centres[rows], normals[rows], step * _along(cells, axis, rows)
        width = np.maximum(np.linalg.norm(sideways, axis=1), field_spacing(geometry, "fixed"))
        tangent = sideways - np.einsum("nk,nk->n", normal, sideways)[:, None] * normal
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        beyond = centre + width[:, None] * tangent
        distance, gradient = field(beyond)
        size, away = np.linalg.norm(gradient, axis=1), np.einsum("nk,nk->n", gradient, tangent)
        turned = np.linalg.norm(np.cross(normal, gradient), axis=1) > turning_sine * size
        turned_away = turned & (away > -turning_sine * size)
        borne = _upward(geometry, patch, beyond, gradient) > flat_cosine * size
        ends_here = _in_box(geometry, patch, beyond) & (turned_away | borne)
        goes_on = (np.abs(distance) < same_surface * width) & ~(turned & (away > 0.0)) & ~ends_here
        goes_on &= ~np.any([_in_box(geometry, other, beyond) for other in others], axis=0)
        if open_edges is not None:
            near = open_edges.query(centre)[0] < edge_cells * width
            goes_on = np.where(near, geometry["open_edges"] == "cut", goes_on)
        cut[rows] |= goes_on
    return cut


def _along(cells: CellGrid, axis: int, rows: tuple[np.ndarray, ...]) -> Array:
    """Steps (n, 3) [mm] of the grid along an axis at cells by their rows; the mean one where there is no neighbour."""
    centres, _, areas = cells
    both = (np.delete(areas, 0, axis) > 0.0) & (np.delete(areas, -1, axis) > 0.0)
    steps = np.where(both[..., None], np.diff(centres, axis=axis), 0.0)
    sides = [[side if each == axis else (0, 0) for each in range(3)] for side in ((0, 1), (1, 0))]
    summed = np.sum([np.pad(steps, side) for side in sides], axis=0)[rows]
    count = np.sum([np.pad(both, side[:2]) for side in sides], axis=0)[rows]
    mean = steps.sum(axis=(0, 1)) / both.sum() if both.any() else np.sqrt(areas.max()) * np.eye(3)[2 * axis]
    return np.where(count[:, None] > 0, summed / np.maximum(count, 1)[:, None], mean)
