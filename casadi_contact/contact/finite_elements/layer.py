"""An elastic layer of hexahedra on a rigid back, and its compliance at the nodes of its contact surface.

Linear elasticity, small strain: ∫ σ(u):ε(v) dV = Σ f_i·v(x_i), with Young's modulus E and Poisson's ratio ν, and u = 0
on the back. Nodes lie at the points of a grid on the surface and, under each, along its normal down to the thickness.
"""

from __future__ import annotations

import hashlib
import itertools
from contextlib import suppress
from dataclasses import astuple, dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.ndimage import uniform_filter
from scipy.sparse import coo_matrix, csr_matrix

from casadi_contact.core.compiler import cache_folder
from casadi_contact.core.conventions import Array
from casadi_contact.core.files.containers import new_hdf5, open_hdf5
from casadi_contact.scenes.material import Material

try:
    from skfem import Element, ElementHex1, ElementHex2, ElementQuad1, ElementQuad2
    from skfem.quadrature import get_quadrature
except ModuleNotFoundError:
    raise ModuleNotFoundError("finite elements need scikit-fem: pip install casadi_contact[fem]") from None

FORMAT = 1  # of kept compliances: another one where the same settings give other numbers


@dataclass(frozen=True)
class Hexahedra:
    """Elements of a layer: `layers` over the thickness, each `grading` times as thick as the one above it, of `order` 1
    (8 nodes) or 2 (27 nodes). Order 2 takes two steps of the surface's grid for each element."""

    layers: int = 3
    order: int = 2
    grading: float = 1.6

    def __post_init__(self) -> None:
        if self.layers < 1 or self.order not in (1, 2) or not self.grading > 0.0:
            raise ValueError(f"{self}, expected at least 1 layer, order 1 or 2 and a grading above 0")

    def depths(self, thickness_mm: float) -> Array:
        """Depths (layers·order + 1,) [mm] of the nodes under a point of the surface, from 0 to the thickness."""
        bounds = np.concatenate([[0.0], np.cumsum(self.grading ** np.arange(self.layers))])
        return np.interp(np.arange(self.layers * self.order + 1) / self.order, np.arange(self.layers + 1), bounds) * (
            thickness_mm / bounds[-1]
        )


@dataclass(frozen=True)
class Layer:
    """The surface of a condensed layer, m nodes: points, normals (m, 3) [mm], the area of each (m,) [mm²], which is the
    integral of its shape function, and compliance (m, m) [mm/N]: C_ij is the way of node i along its normal into the
    layer under a force of 1 N on node j along its normal."""

    points_mm: Array
    normals: Array
    areas_mm2: Array
    compliance: Array

    @classmethod
    def of(cls, points_mm: Array, normals: Array, present: np.ndarray, material: Material, mesh: Hexahedra) -> Layer:
        """Under a grid of points and unit normals (nx, nz, 3), where present (nx, nz): kept in the cache folder.

        Raises ValueError where no element is whole or one is turned inside out.
        """
        digest = hashlib.sha256(repr((FORMAT, astuple(mesh), material)).encode())
        for array in (points_mm, normals, present):
            digest.update(np.ascontiguousarray(array).tobytes())
        path = cache_folder() / f"finite-elements-{digest.hexdigest()[:32]}.h5"
        try:
            with open_hdf5(path) as file:
                return cls(*(file[name][()] for name in cls.__annotations__))
        except (OSError, ValueError):  # not there, or damaged
            layer = _condensed(points_mm, normals, present, material, mesh)
        with suppress(OSError):  # condensed again where the folder takes no files
            path.parent.mkdir(parents=True, exist_ok=True)
            with new_hdf5(path) as file:
                for name, array in vars(layer).items():
                    file[name] = array
        return layer


def _condensed(points_mm: Array, normals: Array, present: np.ndarray, material: Material, mesh: Hexahedra) -> Layer:
    order, depths = mesh.order, mesh.depths(material.thickness)
    nodes = np.arange(present.size * len(depths)).reshape(*present.shape, len(depths))
    sides = [range(0, count - order, order) for count in nodes.shape]
    corner = np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, 3)
    lattice = np.stack(np.meshgrid(*[np.arange(order + 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    at = corner[:, None] + lattice
    at = at[present[at[..., 0], at[..., 1]].all(axis=1)]
    if not len(at):
        raise ValueError(f"a surface of {present.sum()} of {present.size} points holds no whole element: refine grid")
    elements = nodes[tuple(at.transpose(2, 0, 1))]
    used = np.unique(elements)
    elements = np.searchsorted(used, elements)
    x = _upright(points_mm, normals, present, depths, used, elements, order)
    free = used % len(depths) < len(depths) - 1
    surface = np.flatnonzero(used % len(depths) == 0)
    stiffness = _stiffness(x, elements, material, order)
    free3 = np.repeat(free, 3)
    into = -normals.reshape(-1, 3)[used[surface] // len(depths)]
    rows = 3 * np.searchsorted(np.flatnonzero(free), surface)[:, None] + np.arange(3)
    columns = np.broadcast_to(np.arange(len(surface))[:, None], rows.shape)
    pressed = csr_matrix((into.ravel(), (rows.ravel(), columns.ravel())), shape=(free3.sum(), len(surface)))
    # Elements couple the nodes of at most `order` neighbouring lines of the grid: blocks of these are tridiagonal.
    block = np.repeat((used[free] // (nodes.shape[1] * len(depths)) + order - 1) // order, 3)
    compliance = _compliance(stiffness[free3][:, free3], pressed, np.flatnonzero(np.diff(block, prepend=-1, append=-1)))
    top = elements.reshape(len(elements), -1, order + 1)[:, :, 0]
    areas = np.zeros(len(x))
    np.add.at(areas, top, _face_areas(x[top], order))
    return Layer(x[surface], -into, areas[surface], compliance)


def _upright(
    points_mm: Array,
    normals: Array,
    present: np.ndarray,
    depths: Array,
    used: np.ndarray,
    elements: np.ndarray,
    order: int,
    most_rounds: int = 40,
) -> Array:
    """The used nodes (n, 3), under the points along their normals. Where elements turn inside out, under the bends and
    rims of a scanned surface, these directions are averaged over neighbours, round by round; ValueError where that does
    not help."""
    _, slopes, _ = _shape_functions((ElementHex1, ElementHex2)[order - 1](), order)
    into = np.where(present[..., None], normals, 0.0)
    for _ in range(most_rounds):
        x = (points_mm[:, :, None] - depths[:, None] * into[:, :, None]).reshape(-1, 3)[used]
        volumes = np.linalg.det(np.einsum("eni,nkq->eqik", x[elements], slopes))
        if (volumes * np.sign(volumes.sum()) > 0.0).all():
            return x
        into = uniform_filter(into, (3, 3, 1), mode="nearest")
        into /= np.maximum(np.linalg.norm(into, axis=-1, keepdims=True), 1e-12)
    raise ValueError("elements under the surface turn inside out, expected a thinner layer or a flatter surface")


def _stiffness(x: Array, elements: np.ndarray, material: Material, order: int) -> csr_matrix:
    """K (3n, 3n): ∫ λ·div(u)·div(v) + 2μ·ε(u):ε(v) dV over elements (e, (order + 1)³) of nodes x (n, 3)."""
    _, slopes, weights = _shape_functions((ElementHex1, ElementHex2)[order - 1](), order)
    to_local = np.einsum("eni,nkq->eqik", x[elements], slopes)
    volumes = np.linalg.det(to_local)
    gradients = np.einsum("nkq,eqki->eqni", slopes, np.linalg.inv(to_local)).reshape(*volumes.shape, -1)
    count = elements.shape[1]
    products = gradients.transpose(0, 2, 1) @ (gradients * (weights * abs(volumes))[..., None])
    products = products.reshape(-1, count, 3, count, 3)
    E, nu = material.youngs_modulus, material.poissons_ratio
    lame, shear = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))
    blocks = lame * products + shear * products.swapaxes(2, 4)
    for axis in range(3):
        blocks[:, :, axis, :, axis] += shear * np.einsum("eiaja->eij", products)
    freedoms = (3 * elements[..., None] + np.arange(3)).reshape(len(elements), -1)
    rows, columns = np.broadcast_arrays(freedoms[:, :, None], freedoms[:, None, :])
    return coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * len(x),) * 2).tocsr()


def _face_areas(x: Array, order: int) -> Array:
    """∫ N_i dA (e, (order + 1)²) of faces with nodes x (e, (order + 1)², 3)."""
    values, slopes, weights = _shape_functions((ElementQuad1, ElementQuad2)[order - 1](), order)
    along = np.einsum("eni,nkq->keqi", x, slopes)
    return np.einsum("nq,q,eq->en", values, weights, np.linalg.norm(np.cross(*along), axis=-1))


def _shape_functions(element: Element, order: int) -> tuple[Array, Array, Array]:
    """Values (nodes, q), derivatives by the local coordinates (nodes, axes, q) and weights (q,) at the points of
    Gauss's rule with order + 1 points along each axis; nodes in the order of the lattice, the last axis fastest."""
    at, weights = get_quadrature(element.refdom, 2 * order + 1)
    nodes = np.lexsort(np.array(element.doflocs).T[::-1])
    values, slopes = zip(*(element.lbasis(at, node) for node in nodes), strict=True)
    return np.array([np.broadcast_to(value, weights.shape) for value in values]), np.array(slopes), weights


def _compliance(stiffness: csr_matrix, pressed: csr_matrix, cuts: np.ndarray) -> Array:
    """Pᵀ·K⁻¹·P for a symmetric K that is tridiagonal in blocks between the cuts: with K = L·Lᵀ, the sum over the
    blocks of L⁻¹P of YᵀY. Columns of P come in the order of the rows that they press: later ones are zero in Y."""
    total = np.zeros((pressed.shape[1],) * 2)
    factor = solved = np.empty((0, 0))
    before = slice(0, 0)
    for start, end in itertools.pairwise(cuts):
        here, count = slice(start, end), int(pressed[:end].indices.max()) + 1
        diagonal, right = stiffness[here, here].toarray(), pressed[here, :count].toarray()
        if len(factor):
            beside = solve_triangular(factor, stiffness[before, here].toarray(), lower=True, check_finite=False)
            diagonal -= beside.T @ beside
            right[:, : solved.shape[1]] -= beside.T @ solved
        factor = cholesky(diagonal, lower=True, check_finite=False)
        solved, before = solve_triangular(factor, right, lower=True, check_finite=False), here
        total[:count, :count] += solved.T @ solved
    return total
