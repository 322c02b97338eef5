"""Patches between two smooth surfaces with one contact area: what polar quadrature integrates over.

The fixed surface is a plane or a piece of a torus over a chart (u, v), written in *chart axes*: x along u, y the
height, z along v. With o the distance of the tube's centre circle from the torus's axis and R the tube's radius:

    tube = √(R² - v²),   ρ = o + s_ρ·tube,   w = √(ρ² - u²),   point (u, y_0 + s_w·w, z_0 + v)

A dish has s_ρ = 1, s_w = -1 (a sphere where o = 0), the facet of a groove s_ρ = -1, s_w = 1; in both the tube's
centre lies on the side of the moving body. The moving surface are swept arcs (`geometry.moving_surface`).
"""

from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.moving_surface import MovingSurface
from casadi_contact.scenes.scene import Scene

POLAR_SHAPES = ("knee", "sphere_on_plane", "sphere_in_dish", "button_in_groove")


@dataclass(frozen=True)
class Torus:
    """o, R, y_0 [mm] and the two signs of the module's formula."""

    offset: float
    radius: float
    height: float
    rho_sign: float
    w_sign: float


@dataclass(frozen=True)
class Rim:
    """The chart's part that holds the patch: u and v [mm], and |u| <= spread·ρ(v) where spread is finite."""

    u: tuple[float, float]
    v: tuple[float, float]
    spread: float = np.inf


@dataclass(frozen=True)
class Tuning:
    """Steps, tolerances and least sizes of the searches on a patch. The C has them by the same names in capitals.

    Lengths are in mm, curvatures in 1/mm. *Part* means a part of the patch's sides, of a torus's radii or of an edge.
    """

    least_length: float = 1e-12
    least_rise: float = 1e-9  # slope of g along a line
    least_curvature: float = 1e-4
    least_upright: float = 1e-2  # part: estimated ends of a deep contact area may lie where there is no torus
    most_shorter: float = -0.5  # by the curvature along a ray: a ray from inside the body ends at a depth above zero
    steepest: float = -0.05  # cosine between ray and surface: flatter rays are cut off here
    # the nearest point
    search_steps: int = 40  # at most: the usual search ends after one to three
    sweeps: int = 3  # over the two coordinates of a step
    least_step: float = 1e-6  # part: a step so short is the last one
    least_convexity: float = 0.05  # curvature over the body's own below which there may be several minima
    # the peak
    centre_steps: int = 3
    most_rise: float = 0.25  # part of the depth: where it rises by more, the two normals are not parallel yet
    least_chord: float = 1e-3
    # edges of contact
    edge_steps: int = 2  # Newton's
    edge_tolerance: float = 2e-3  # part: where the last step moved an edge by more, all take one more
    bracket_from: float = 0.1  # part: where it moved one by more, Newton's method within brackets
    bracket_steps: int = 12
    # junctions of arcs
    chord_steps: int = 2
    least_tilt: float = 1e-9  # between the junction's plane and the patch
    # a second contact area
    close_fit: float = 0.8  # of radii: in 6,900 poses of knees that fit less closely there was no second one
    rim_reach: float = 1.0  # more than g falls between two starts
    rim_tolerance: float = 1e-9  # part
    facing: float = -0.9  # cosine between a ray and the surface that it meets: a body's back faces away


@dataclass(frozen=True)
class SmoothPatch:
    """One patch: its fixed surface (None: the plane y = 0), its rim and the moving arcs that face it.

    turn: rotation (3, 3) from the fixed body's axes to chart axes. z_0: chart's origin along z [mm].
    arcs (k, 5): axis x, y; the tube's distance from it; end tangent x, y [mm]. tube_radius, centre_z [mm] of the tube.
    """

    torus: Torus | None
    rim: Rim
    turn: Array
    z_0: float
    arcs: Array
    tube_radius: float
    centre_z: float
    tuning: Tuning = Tuning()


def smooth_patches(scene: Scene) -> list[SmoothPatch]:
    """The patches of a scene of one of `POLAR_SHAPES`, in patch order; raises ValueError for another shape."""
    if scene.shape not in POLAR_SHAPES:
        known = f"expected one of {', '.join(POLAR_SHAPES)}; others take cc.ElasticFoundation"
        raise ValueError(
            f"scene {scene.name} has the shape {scene.shape}, which polar quadrature does not cover: {known}"
        )
    laid = _facet if scene.shape == "button_in_groove" else _upright
    return [laid(scene, p, surface) for p, surface in enumerate(scene.surfaces())]


def _upright(scene: Scene, p: int, surface: MovingSurface) -> SmoothPatch:
    """A dish or a plane, open upwards, above a rectangle."""
    torus, g = None, scene.patch_geometry(scene.patch_names[p])
    length, width = (float(g[key] if key in g else g["patch_side"]) for key in ("plateau_length", "plateau_width"))
    if scene.shape == "knee":
        sagittal, frontal = g["dish_sagittal_radius"], g["dish_frontal_radius"]
        torus = Torus(sagittal - frontal, frontal, sagittal, 1.0, -1.0)
    elif scene.shape == "sphere_in_dish":
        torus = Torus(0.0, g["dish_radius"], g["dish_radius"], 1.0, -1.0)
    rim = Rim((-0.5 * length, 0.5 * length), (-0.5 * width, 0.5 * width))
    return _patch(torus, rim, np.eye(3), float(scene.anchors_mm[p, 2]), surface)


def _facet(scene: Scene, p: int, surface: MovingSurface) -> SmoothPatch:
    """A facet of a groove about the z axis, open towards -x: chart axes are y, -x, z of the fixed body."""
    g, side = scene.geometry, 1.0 - 2.0 * p
    slope, radius = np.deg2rad(g["facet_angle_deg"]), g["facet_radius"]
    spread, reach = np.deg2rad(g["facet_half_width_deg"]), np.deg2rad(g["groove_half_angle_deg"])
    torus = Torus(g["groove_radius"] + radius * np.cos(slope), radius, 0.0, -1.0, 1.0)
    ends = sorted(side * radius * np.sin(slope + np.array([-spread, spread])))
    rim = Rim((-1e3, 1e3), (ends[0], ends[1]), float(np.sin(reach)))
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return _patch(torus, rim, turn, side * (g["facet_offset"] - radius * np.sin(slope)), surface)


def _patch(torus: Torus | None, rim: Rim, turn: Array, z_0: float, surface: MovingSurface) -> SmoothPatch:
    arcs = surface.parameters[3:].reshape(-1, 5)
    tube_radius, centre_z = float(surface.parameters[1]), float(surface.parameters[2])
    return SmoothPatch(torus, rim, turn, z_0, arcs, tube_radius, centre_z)


def rim_box(patch: SmoothPatch) -> tuple[Array, Array]:
    """Least and largest (w, v) of the patch, each (2,)."""
    w = (-patch.rim.spread, patch.rim.spread) if _curved(patch) else patch.rim.u
    return tuple(np.array([w, patch.rim.v]).T)  # type: ignore[return-value]


def stretch(patch: SmoothPatch, v: Array) -> tuple[Array, Array, Array]:
    """s(v) with its first and second derivative."""
    if not _curved(patch) or patch.torus is None:
        return np.ones_like(v), np.zeros_like(v), np.zeros_like(v)
    f = patch.torus
    tube = np.sqrt(f.radius**2 - v * v)
    return f.offset + f.rho_sign * tube, -f.rho_sign * v / tube, -f.rho_sign * f.radius**2 / tube**3


def u_range(patch: SmoothPatch, v: Array) -> tuple[Array, Array]:
    """Least and largest u of the patch at v."""
    (low, _), (high, _) = rim_box(patch)
    s = stretch(patch, v)[0]
    return low * s, high * s


def within(patch: SmoothPatch, u: Array, v: Array) -> tuple[Array, Array]:
    """The point (u, v) moved onto the patch, along u and along v."""
    v = np.clip(v, *patch.rim.v)
    low, high = u_range(patch, v)
    return np.clip(u, low, high), v


def _curved(patch: SmoothPatch) -> bool:
    return patch.torus is not None and bool(np.isfinite(patch.rim.spread))
