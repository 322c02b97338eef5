"""The contact model that decides, and what comparing with it does not show.

That is load which all models of a scene treat alike, by where it lies, and elements that are too coarse.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial

import numpy as np

from casadi_contact.contact.elements.foundation import (
    SHARP_SHARE,
    ElasticFoundation,
    share_at_sharp_edges,
    share_of_force,
)
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.pressure_law import law_of, pressures
from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import Array, as_poses, rotation
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.mesh_bodies import bare_mesh, body_field, body_mesh, body_surface, field_spacing
from casadi_contact.scenes.shapes.shape import shape_named


def reference_model(of: Scene | SymbolicContact, grid: str = "teacher") -> ContactModel | str:
    """The contact model that verification compares with: the scene's elements on this grid, or finite elements for a
    surrogate whose record says that its samples were drawn from them. Text that says why, where there is none."""
    scene = of if isinstance(of, Scene) else of.scene
    if scene.layer is None:
        return f"the scene {scene.name} has no contact model at hand (ask yours in Python: cc.verify)"
    try:
        if getattr(of, "record", {}).get("drawn_from") == "finite-elements":
            from casadi_contact.contact.finite_elements.model import FiniteElements  # needs the extra `fem`

            return FiniteElements(scene)
        return ElasticFoundation(scene, scene.grids.get(grid))
    except (ValueError, OSError, ImportError) as error:
        return f"the scene {scene.name} has no contact model at hand ({error})"


def loads_on(model: ContactModel, poses: Array, names: Sequence[str]) -> Array:
    """Named loads (n, L) of a contact model at poses (n, 6); ValueError naming those that it lacks."""
    missing = [name for name in names if name not in model.load_names]
    if missing:
        raise ValueError(f"the model lacks the loads {', '.join(missing)}, expected all that the surrogate gives")
    return np.asarray(model(poses)[:, [model.load_names.index(name) for name in names]])


def off_finer(model: ElasticFoundation, poses: Array, names: Sequence[str], allowed: Array) -> Array:
    """Discretisation error of the elements in poses (n, 6): their named loads (n, L) minus those of elements half as
    wide, and of distance fields of meshes with 0.7 times the spacing.

    A coarser model, twice as wide and 1.4 times the spacing, is a cheap sieve (a quarter of the time): where it differs
    by at most half of `allowed` (n, L), the error is taken as zero. Of 544 wrong poses of the knee on 40×20 elements
    two passed it. Where the finer model is too large for memory, the difference from the coarser one stands in for
    it."""
    loads = loads_on(model, poses, names)
    try:
        off = loads - loads_on(_scaled(model, 0.5), poses, names)
    except ValueError:  # fields as coarse are refused for a thin body
        off = np.full(loads.shape, np.inf)
    unsure = (np.abs(off) > 0.5 * allowed).any(axis=1)
    with suppress(ValueError):
        if unsure.any():
            off[unsure] = loads[unsure] - loads_on(_scaled(model, 2.0), poses[unsure], names)
    off[~unsure] = 0.0
    return off


def _scaled(model: ElasticFoundation, times: float, most_mm: float = 1.5) -> ElasticFoundation:
    """The model with so many times the elements a side, and of meshes fields whose nodes lie √times closer."""
    scene, (nx, nz) = model.scene, model.grid
    if shape_named(scene.shape).mesh_bodies:
        finer = [min(field_spacing(scene.geometry, body) / np.sqrt(times), most_mm) for body in ("moving", "fixed")]
        spacing = dict(zip(("moving", "fixed"), finer, strict=True))
        scene = Scene.from_tables({**scene.tables, "geometry": {**scene.geometry, "spacing": spacing}})
    return ElasticFoundation(scene, (int(np.ceil(times * nx)), int(np.ceil(times * nz))))


def share_at_edges(model: ElasticFoundation, poses: Array) -> Array:
    """Share (n,) of the patches' forces, by size, on elements at an edge (`ElasticFoundation.edge_wrenches`)."""
    poses = as_poses(poses)
    force = np.linalg.norm(model.wrenches(poses)[..., :3], axis=2)
    return np.asarray((model.edge_share(poses) * force).sum(axis=1) / np.maximum(force.sum(axis=1), 1e-300))


def share_on_walls(
    model: ElasticFoundation, poses: Array, *, within: bool = True, longest_mm: float = 1.0, facing: float = 0.5
) -> Array:
    """Share (n,) of the pressing force Σ p·A on walls of the fixed mesh: triangles within the patches' boxes that are
    steeper than 78 degrees against the rays that lay out elements, or undercut; else, outside of all boxes. 0 out of
    contact and without a mesh.

    longest_mm: edges of the triangles, each of which is pressed or not. facing: cosine of the angle between normal and
    direction to the body, above which a triangle is pressed; the side of a rim is not. Depths are minus the moving
    mesh's distance from the triangles' centres; beyond its open edges they are unknown and count as none."""
    poses, geometry = as_poses(poses), model.scene.geometry
    share = np.zeros(len(poses))
    if model.scene.shape != "mesh" or not len(poses):
        return share
    moving, rotations = body_mesh(geometry, "moving"), rotation(poses[:, 3:])
    low, high = moving.vertices_mm.min(axis=0), moving.vertices_mm.max(axis=0)
    middles, halves = poses[:, :3] + rotations @ (0.5 * (low + high)), np.abs(rotations) @ (0.5 * (high - low))
    box = (middles - halves).min(axis=0), (middles + halves).max(axis=0)
    bare = bare_mesh(geometry, longest_mm, *box, within=within)
    if not len(bare.faces):
        return share
    centres, normals, areas = bare.corners_mm.mean(axis=1), bare.normals, bare.areas_mm2
    law, field = law_of(model.scene.material), body_field(geometry, "moving")
    pressed: list[tuple[np.ndarray, Array, Array]] = []  # pose, point of the moving body [mm] and force [N] of each
    for k, (R, t) in enumerate(zip(rotations, poses[:, :3], strict=True)):
        local = (centres - t) @ R
        near = np.flatnonzero(((local > low) & (local < high)).all(axis=1))
        distance, gradient = field(local[near])
        towards = np.einsum("nk,nk->n", gradient, normals[near] @ R) < -facing
        deep, near = -distance[towards & (distance < 0.0)], near[towards & (distance < 0.0)]
        pressed.append((np.full(len(near), k), local[near], pressures(*law, deep) * areas[near]))
    pose, points, forces = (np.concatenate(each) for each in zip(*pressed, strict=True))
    if len(forces) and len(moving.boundary_edges):
        forces = forces * ~body_surface(geometry, "moving").beyond_open_edges(points)
    on_bare = np.bincount(pose, forces, len(poses))
    for k in np.flatnonzero(on_bare).tolist():
        counted = sum(float(each.forces_n.sum()) for each in model.pressure_maps(poses[k]))
        share[k] = on_bare[k] / (on_bare[k] + counted)
    return share


share_outside_patches = partial(share_on_walls, within=False)


def share_beyond_open_edges(model: ElasticFoundation, poses: Array) -> Array:
    """`share_of_force` (n,) on elements nearest to an open edge of the moving mesh, where the surface is taken to round
    off (`geometry.smooth_surface`) and the part may have ended. 0 for closed meshes."""
    poses, geometry = as_poses(poses), model.scene.geometry
    if model.scene.shape != "mesh" or not len(body_mesh(geometry, "moving").boundary_edges):
        return np.zeros(len(poses))
    return share_of_force(model, poses, body_surface(geometry, "moving").beyond_open_edges)


# The share (n,) of the load that lies there, and words for it.
_PLACES: dict[str, tuple[Callable[[ElasticFoundation, Array], Array], str]] = {
    "beyond_open_edges": (
        share_beyond_open_edges,
        "beyond open edges of the moving mesh, where its surface is taken to round off: a part may end there",
    ),
    "at_edges": (
        share_at_edges,
        "within 1 mm of an edge of the elements, beyond which none is counted: wider bounds in geometry.patches or a "
        'larger mesh count it; open_edges = "rim" says that the part ends',
    ),
    "on_walls": (
        share_on_walls,
        "on walls of the fixed mesh, where no elements count it: geometry.cup_centre on the axis of a notch or in the "
        "middle of a cup counts it, elsewhere a patch of its own with its own geometry.patches.NAME.pressing",
    ),
    "outside_patches": (
        share_outside_patches,
        "on the fixed mesh outside of all patches, where no elements count it: wider bounds in geometry.patches.NAME "
        "do, or a patch of its own",
    ),
    "at_sharp_edges": (
        share_at_sharp_edges,
        "at sharp edges of the moving mesh, which its distance field rounds off: a finer geometry.spacing.moving mends "
        "it, and a smoother mesh where they are a scan's noise",
    ),
}


def unmodelled_load_shares(model: ElasticFoundation, poses: Array) -> dict[str, Array]:
    """Shares (n,) of the load in poses (n, 6) by place: at edges of a mesh or of the elements, on walls and outside
    of the patches of the fixed one. Raises ValueError for bad poses."""
    return {where: share(model, poses) for where, (share, _) in _PLACES.items()}


def unmodelled_fraction(model: ElasticFoundation, poses: Array) -> Array:
    """Share of the load (n,) in poses (n, 6) where the scene has no elements: at most what lies on walls and outside of
    all patches. Raises ValueError for bad poses."""
    return np.minimum(share_on_walls(model, poses) + share_outside_patches(model, poses), 1.0)


def unmodelled_load_words(shares: Mapping[str, Array]) -> dict[str, str]:
    """Of `unmodelled_load_shares` above 1 %, or `SHARP_SHARE`: in how many frames, and the largest share."""
    words = {}
    for where, share in shares.items():
        if count := int((share > (SHARP_SHARE if where == "at_sharp_edges" else 0.01)).sum()):
            said = f"in {count} of {len(share)} frames up to {share.max():.0%} of the load lies"
            words[where] = f"{said} {_PLACES[where][1]}"
    return words
