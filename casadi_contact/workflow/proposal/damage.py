"""What of a mesh a joint is not made of: loose specks, as segmentation leaves, spikes of single vertices, folds, holes,
and noise that is steep between short edges."""

from __future__ import annotations

import numpy as np

from casadi_contact.geometry.triangle_mesh import TriangleMesh, directed_edges, point_words

_SPECK = 0.01  # of the area of the largest piece, at most
_ALL_SPECKS = 0.05  # of the whole area: more is a body of many pieces
_HOLE = 0.2  # of the mesh across, at most: a wider opening is where a part ends
_ROUGH_DEG = 15.0  # between neighbouring triangles, the median: of curved surfaces that are meshed well some degrees
_FOLD_COS = -0.5  # between the normals of neighbours: a sharp rim has none below 0
_SPIKE_COS = 0.77  # all edges of a spike's tip lie within 40 degrees; a box's corner has 55
_SPIKE_MM, _SPIKE_SHARE = 1.0, 0.02  # height of a spike, or share of a small mesh across


def without_specks(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh without its specks."""
    small = _specks(mesh)
    return mesh.part(~np.isin(mesh.pieces, small)) if len(small) else mesh


def specks(mesh: TriangleMesh) -> list[str]:
    """The question about the loose pieces that `without_specks` leaves out."""
    small = _specks(mesh)
    if not len(small):
        return []
    area, whole = mesh.areas_mm2[np.isin(mesh.pieces, small)].sum(), mesh.areas_mm2.sum()
    middle = mesh.corners_mm[mesh.pieces == small[0]].mean(axis=(0, 1)).round(1) + 0.0
    return [
        f"whether {len(small)} loose pieces of {mesh.name} ({area:.2g} of {whole:.4g} mm², first "
        f"about {point_words(middle)} mm) belong to it: the joint was told without them, but they are in the file, and "
        "bear load where they are touched; remove them there if they are specks"
    ]


def _specks(mesh: TriangleMesh) -> np.ndarray:
    """Numbers of the loose pieces of less than 1 % of the largest one's area; none where these make up more than 5 % of
    the mesh."""
    areas = np.bincount(mesh.pieces, mesh.areas_mm2)
    small = np.flatnonzero(areas < _SPECK * areas.max())
    return small if areas[small].sum() <= _ALL_SPECKS * areas.sum() else small[:0]


def spikes(mesh: TriangleMesh) -> list[str]:
    """The question about vertices that stand out of all their neighbours like a needle's tip, outwards or inwards, by
    1 mm and more, or by 2 % of a mesh of less than 50 mm across; those on open edges are none."""
    edges = directed_edges(mesh.faces)
    edges = np.concatenate([edges, edges[:, ::-1]])
    offsets = mesh.vertices_mm[edges[:, 1]] - mesh.vertices_mm[edges[:, 0]]
    lengths = np.linalg.norm(offsets, axis=1)
    ways = offsets / lengths[:, None]
    size = len(mesh.vertices_mm)
    axes = np.stack([np.bincount(edges[:, 0], ways[:, k], size) for k in range(3)], axis=1)
    axes = axes / np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-300)
    least, height = np.ones(size), np.full(size, np.inf)
    along = np.einsum("nk,nk->n", ways, axes[edges[:, 0]])
    np.minimum.at(least, edges[:, 0], along)
    np.minimum.at(height, edges[:, 0], along * lengths)
    across = float(np.ptp(mesh.vertices_mm, axis=0).max())
    tips = (least > _SPIKE_COS) & (height > min(_SPIKE_MM, _SPIKE_SHARE * across))
    tips[mesh.boundary_edges.ravel()] = False
    if not tips.any():
        return []
    first = int(np.where(tips, height, -np.inf).argmax())
    return [
        f"whether {mesh.name} is so where {int(tips.sum())} of its vertices stand out like a needle, the first by "
        f"{height[first]:.2g} mm at {point_words(mesh.vertices_mm[first])} mm: smooth it there if that is a slip of "
        "segmentation"
    ]


def folds(mesh: TriangleMesh) -> list[str]:
    """The question about triangles of an open mesh that fold back over their neighbours. Far from them, too, points may
    count as inside that lie outside; of a closed mesh what it encloses tells (`geometry.smooth_surface`)."""
    sides = mesh.joined_sides
    if not len(mesh.boundary_edges) or not len(sides[0]):
        return []
    first, second = (side % len(mesh.faces) for side in sides)
    folded = np.einsum("nk,nk->n", mesh.normals[first], mesh.normals[second]) < _FOLD_COS
    if not folded.any():
        return []
    middle = mesh.corners_mm[first[folded][0]].mean(axis=0).round(1) + 0.0
    return [
        f"whether {mesh.name} is so where triangles fold back over their neighbours ({int(folded.sum())} edges, the "
        f"first about {point_words(middle)} mm): it is open, so that load may be found millimetres off the surface "
        "there; mesh it anew there, or close the mesh"
    ]


def holes(mesh: TriangleMesh) -> list[str]:
    """The question about open edges that lie close together all round, as a scan leaves where it saw nothing."""
    from scipy import sparse  # here: as where triangles are joined
    from scipy.sparse.csgraph import connected_components

    rims = mesh.boundary_edges
    if not len(rims):
        return []
    used, ends = np.unique(rims, return_inverse=True)
    first, second = ends.reshape(-1, 2).T
    links = sparse.coo_matrix((np.ones(len(rims)), (first, second)), shape=(len(used),) * 2)
    count, rim = connected_components(links, directed=False)
    points = mesh.vertices_mm[used]
    across = np.array([np.linalg.norm(np.ptp(points[rim == k], axis=0)) for k in range(count)])
    small = np.flatnonzero(across < _HOLE * np.linalg.norm(np.ptp(mesh.vertices_mm, axis=0)))
    if not len(small):
        return []
    widest = int(small[across[small].argmax()])
    place = point_words(points[rim == widest].mean(axis=0).round(1) + 0.0)
    return [
        f"whether {mesh.name} is open where it has holes ({len(small)}, the widest {across[widest]:.2g} mm across at "
        f"{place} mm): contact there counts as contact at an edge and bears less; close them if they are a scan's slips"
    ]


def rough(mesh: TriangleMesh) -> list[str]:
    """The question about noise between so short edges that neighbouring triangles stand steeply against each other:
    such a surface bears too much."""
    sides = mesh.joined_sides
    if not len(sides[0]):
        return []
    first, second = (mesh.normals[side % len(mesh.faces)] for side in sides)
    cos = np.clip(np.einsum("nk,nk->n", first, second), -1.0, 1.0)
    between_deg = float(np.degrees(np.median(np.arccos(cos))))
    if between_deg < _ROUGH_DEG:
        return []
    return [
        f"how deep {mesh.name} is pressed: its triangles stand at {between_deg:.0f} degrees to their neighbours "
        "(median), and so rough a surface bears too much; smooth it, or mesh it anew with longer edges"
    ]
