"""The elastic foundation of smooth shapes by polar quadrature: a contact model, its C, and how many rays it needs.

That is the fewest whose errors, against many more rays, stay within the scene's tolerances. Rays integrate one contact
area within the rim; more rays cannot reveal a second one. Element grids can: they check the converged rays.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from casadi_contact.contact.approach import press_until
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.convergence import Errors, NotGoodEnoughError, cheapest, forces_tried, remedy
from casadi_contact.contact.elements.foundation import ElasticFoundation, grid_text
from casadi_contact.contact.foundation_source import C_FOLDER, braces, definitions
from casadi_contact.contact.friction import PressedPoints
from casadi_contact.contact.model import PatchLoads
from casadi_contact.contact.polar.lines import Rays, fan_angles, ray_angles
from casadi_contact.contact.polar.peak import ACROSS, nearest, peak
from casadi_contact.contact.polar.quadrature import (
    OUTWARDS,
    RIM_STARTS,
    fits_closely,
    patch_loads,
    patch_moments,
    pressed_points,
)
from casadi_contact.contact.polar.ray_hits import fixed_point
from casadi_contact.contact.polar.surfaces import SmoothPatch, Torus, smooth_patches, u_range
from casadi_contact.contact.pressure_law import law_of
from casadi_contact.core.conventions import Array, evenly_spaced_indices, load_selection, rotation
from casadi_contact.networks.kernel.source import c_text
from casadi_contact.scenes.scene import Scene


def polar_source(patches: Sequence[SmoothPatch], rays: Rays) -> str:
    """Tables of the patches and `patch_loads`."""
    free, at_rim = ray_angles(rays.count), ray_angles(rays.at_rim)
    rim_starts = np.concatenate([RIM_STARTS, OUTWARDS])
    x, weight = np.polynomial.legendre.leggauss(rays.points)
    sizes = {
        "RAYS": rays.count,
        "RIM_RAYS": rays.at_rim,
        "GAUSS": rays.points,
        "ARCS": len(patches[0].arcs),
        "TORUS": int(patches[0].torus is not None),
        "TURNED": int(any((patch.turn != np.eye(3)).any() for patch in patches)),
        "CURVED_RIM": int(np.isfinite(patches[0].rim.spread)),
        "CAP_LINES": rays.in_caps,
        **{name.upper(): value for name, value in asdict(patches[0].tuning).items()},
        "STARTS": len(ACROSS),
        "RIM_STARTS": RIM_STARTS.shape[1],
    }
    tables = {
        "ray_cos[RAYS]": free[0],
        "ray_sin[RAYS]": free[1],
        "rim_cos[RIM_RAYS]": at_rim[0],
        "rim_sin[RIM_RAYS]": at_rim[1],
        "gauss_x[GAUSS]": 0.5 * (1.0 + x),
        "gauss_w[GAUSS]": 0.5 * weight,
        "starts[2 * STARTS]": np.concatenate([ACROSS, ACROSS]),
        **{f"rim_{name}[RIM_STARTS]": row for name, row in zip(("w", "v", "out_u", "out_v"), rim_starts, strict=True)},
    }
    has_caps = len(patches[0].arcs) > 1
    if has_caps:
        fan = fan_angles(rays.in_caps)
        tables |= {"fan_cos[CAP_LINES]": fan[0], "fan_sin[CAP_LINES]": fan[1], "fan_weight[CAP_LINES]": fan[2]}
    return "\n".join(
        [
            *definitions(sizes, tables),
            c_text("polar_surfaces.h", C_FOLDER),
            f"static const Surfaces surfaces[PATCHES] = {{{', '.join(map(_surfaces, patches))}}};",
            c_text("polar_peak.h", C_FOLDER),
            c_text("polar_lines.h", C_FOLDER),
            *([c_text("polar_second.h", C_FOLDER)] if patches[0].torus is not None else []),
            *([c_text("polar_caps.h", C_FOLDER)] if has_caps else []),
            c_text("polar.h", C_FOLDER),
        ]
    )


def _surfaces(patch: SmoothPatch) -> str:
    """The fields of `Surfaces` in their order."""
    torus, rim = patch.torus or Torus(0.0, 1.0, 0.0, 1.0, 1.0), patch.rim
    spread = rim.spread if np.isfinite(rim.spread) else 0.0
    numbers = [torus.offset, torus.radius, torus.height, torus.rho_sign, torus.w_sign, *rim.u, *rim.v, spread]
    numbers += [patch.z_0, patch.tube_radius, patch.centre_z, fits_closely(patch)]
    rows = (f"{{{', '.join(map(braces, table))}}}" for table in (patch.turn, patch.arcs))
    return f"{{{', '.join([*(repr(float(number)) for number in numbers), *rows])}}}"


class PolarFoundation(CompiledFoundation):
    """Elastic foundation between smooth surfaces, integrated on rays from the peak of each patch's contact area.

    Contact is found in any pose that presses the moving arcs on the patch. Where the rim cuts the contact area
    (`at_edge`), loads are off by 0.1 to 0.4 % in the median and 1 to 2 % in the worst hundredth, against elements. The
    rays serve one contact area, and a second one on the rim. Contact may be missed on the body's back.

    rays: multiples of 4. Raises ValueError for another number, or a scene of another shape than `POLAR_SHAPES`.
    """

    moments_header = "polar_pressures.h"

    def __init__(self, scene: Scene, rays: Rays = Rays(16, 3), *, compiled: bool = True) -> None:  # noqa: B008
        super().__init__(scene, compiled=compiled)
        if rays.count < 4 or rays.count % 4 or rays.points < 1:
            raise ValueError(f"rays = {rays}, expected a multiple of 4 rays and at least 1 point")
        self.rays, self.resolution = rays, str(rays)
        self.lanes = 8 if rays.count % 8 == 0 else 4
        self.patches = smooth_patches(scene)
        self.law = law_of(scene.material)

    @property
    def _code(self) -> tuple[str, bytes]:
        return polar_source(self.patches, self.rays), b""

    def _moments_by_twist(self, R: Array, t: Array) -> tuple[Array, Array]:
        found = [patch_moments(patch, self.law, self.rays, R, t) for patch in self.patches]
        return np.stack([value for value, _ in found], 1), np.stack([slope for _, slope in found], 1)

    def pressed_points(self, poses: Array) -> Iterator[list[PressedPoints]]:
        """Of each pose (n, 6), of each patch, the points that bear load."""
        for R, t in zip(rotation(poses[:, 3:]), poses[:, :3], strict=True):
            yield [pressed_points(patch, self.law, self.rays, R[None], t[None]) for patch in self.patches]

    def _patch_loads(self, R: Array, t: Array) -> list[PatchLoads]:
        return [patch_loads(patch, self.law, self.rays, R, t) for patch in self.patches]


@dataclass(frozen=True)
class RayChoice:
    """Rays and points that are tried, what they are compared with, and how many poses of each patch decide."""

    candidates: tuple[tuple[int, int], ...] = ((8, 3), (12, 3), (16, 3), (24, 3), (32, 4), (48, 5))
    converged: tuple[int, int] = (96, 6)
    poses: int = 256
    elements: tuple[int, int] = (320, 160)  # of a patch
    poses_on_elements: int = 128  # elements take their time
    most_apart: float = 0.02  # of the poses: a few of a wide draw are no reason against a model that is right elsewhere


def pressed_poses(patch: SmoothPatch, law: tuple[int, float, float], loads_n: tuple[float, float], count: int) -> Array:
    """Poses (m, 6), m <= count, that press the patch within its rim.

    The deepest point lies anywhere on the patch, faced by any place of the moving arcs, up to 25° beyond their
    outermost junctions, turned about its normal by up to 10° and leant by up to 5°. Forces spread evenly on a
    logarithmic scale between loads_n [N]. Poses whose contact the rim cuts are left out.
    """
    beyond, most_lean, most_spin = np.deg2rad([25.0, 5.0, 10.0])
    random = np.random.default_rng(0)
    v = random.uniform(*patch.rim.v, count)
    low, high = u_range(patch, v)
    u = low + (high - low) * random.random(count)
    c, N, length = fixed_point(patch, u, v)
    n = N / length[:, None]
    junctions = np.arctan2(patch.arcs[:-1, 4], patch.arcs[:-1, 3])
    first, last = (junctions[0], junctions[-1]) if len(junctions) else (0.0, 0.0)
    angle = random.uniform(first - beyond, last + beyond, count)
    lean, spin = random.uniform(-most_lean, most_lean, count), random.uniform(-most_spin, most_spin, count)
    zero = np.zeros(count)
    out = np.stack([np.sin(angle), -np.cos(angle), zero], -1)  # from the arc's axis
    facing = np.cos(lean)[:, None] * out + np.sin(lean)[:, None] * [0.0, 0.0, 1.0]  # outward normal of the body
    along = np.stack([np.cos(angle), np.sin(angle), zero], -1)
    tangent = np.stack([np.ones(count), -N[:, 0], zero], -1)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    tangent = np.cos(spin)[:, None] * tangent + np.sin(spin)[:, None] * np.cross(n, tangent)
    body = np.stack([along, facing, np.cross(along, facing)], -1)
    R = np.stack([tangent, -n, np.cross(tangent, -n)], -1) @ np.swapaxes(body, 1, 2)
    arc = patch.arcs[(angle[:, None] > junctions).sum(axis=1)]
    point = np.column_stack([arc[:, :2], np.full(count, patch.centre_z)]) + arc[:, 2:3] * out
    point += patch.tube_radius * facing
    surface = c - np.einsum("nij,nj->ni", R, point)
    touching = np.column_stack([surface @ patch.turn, Rotation.from_matrix(patch.turn.T @ R).as_euler("XYZ")])

    def force_of(poses: Array) -> Array:
        return np.linalg.norm(_loads(patch, law, Rays(16, 3), poses).wrench[:, :3], axis=1)

    target_n = np.geomspace(*loads_n, count)
    poses, _ = press_until(force_of, touching, -n @ patch.turn, target_n, 0.01, rounds=4, most_change=30.0)
    return poses[~_loads(patch, law, Rays(16, 3), poses).cut]


def _loads(patch: SmoothPatch, law: tuple[int, float, float], rays: Rays, poses: Array) -> PatchLoads:
    return patch_loads(patch, law, rays, rotation(poses[:, 3:]), poses[:, :3])


Truth = Sequence[tuple[Array, Array]]
"""Of each patch poses (m, 6) that press it within its rim, and converged wrenches (m, 6) there."""


def fraction_in_disagreement(scene: Scene, pressed: Truth, choice: RayChoice) -> float:
    """The share of poses in which some load differs from that of elements by more than one pose may be wrong
    (`convergence.Errors`) and twice what elements half as fine differ by; NotGoodEnoughError beyond what is allowed.
    """
    nx, nz = choice.elements
    fine, half = (ElasticFoundation(scene, grid) for grid in ((nx, nz), (nx // 2, nz // 2)))
    selection = load_selection(scene.load_names, scene.patch_names)
    apart: list[np.ndarray] = []
    for p, (poses, wrench) in enumerate(pressed):
        if not len(poses):
            continue
        target, rough = (model.wrenches(poses)[:, p] for model in (fine, half))
        forces_n = np.linalg.norm(target[:, :3], axis=1)
        off, unsure = (np.abs((found - target) @ selection[:, p].T) for found in (wrench, rough))
        errors = Errors(scene, np.maximum(off - 2.0 * unsure, 0.0), forces_n, np.zeros(len(poses), dtype=bool))
        apart.append(np.any(errors.of_allowed > 1.0, axis=1))
    share = float(np.mean(np.concatenate(apart))) if apart else 0.0
    if share > choice.most_apart:
        raise NotGoodEnoughError(
            f"scene {scene.name}: rays and {grid_text(choice.elements)} elements differ by more than tolerances allow "
            f"in {share:.0%} of the poses that were tried, because they have several contact areas: {remedy(scene)}"
        )
    return share


def polar_foundation(scene: Scene, *, compiled: bool = True, choice: RayChoice | None = None) -> PolarFoundation:
    """The fewest rays that agree with converged ones within the scene's tolerances (`convergence.cheapest`), over poses
    anywhere within the rim; these agree with elements (`fraction_in_disagreement`, "elements_apart" in the record)."""
    choice = choice or RayChoice()
    converged = PolarFoundation(scene, Rays(*choice.converged), compiled=False)
    truth = _truth(converged, forces_tried(scene), choice.poses)
    models = (PolarFoundation(scene, Rays(*rays), compiled=compiled) for rays in choice.candidates)
    against = f"{converged.rays}, EF {grid_text(choice.elements)}"
    model = cheapest(scene, models, lambda model: _errors(model, truth), model="polar quadrature", against=against)
    pairs, count = zip(converged.patches, truth, strict=True), choice.poses_on_elements
    apart = fraction_in_disagreement(scene, [_for_elements(p, *found, count) for p, found in pairs], choice)
    model.record |= {"rays": model.rays.count, "points": model.rays.points, "elements_apart": apart}
    return model


def _truth(model: PolarFoundation, range_n: tuple[float, float], count: int) -> Truth:
    """Poses whose contact the rim cuts between the few rays that found them are left out."""
    found = []
    for patch in model.patches:
        poses = pressed_poses(patch, model.law, range_n, count)
        loads = _loads(patch, model.law, model.rays, poses)
        found.append((poses[~loads.cut], loads.wrench[~loads.cut]))
    return found


def _for_elements(patch: SmoothPatch, poses: Array, wrench: Array, count: int) -> tuple[Array, Array]:
    """Up to so many poses and wrenches to compare with elements; none in which the body's back meets the patch."""
    few = evenly_spaced_indices(len(poses), count)
    R, t = patch.turn @ rotation(poses[few, 3:]), poses[few, :3] @ patch.turn.T
    local = peak(patch, R, t).local
    near = nearest(patch, R, t, local.u, local.v)
    front = few[(near.depth > 0.0) & (near.ends.cosine < patch.tuning.facing)]
    return poses[front], wrench[front]


def _errors(model: PolarFoundation, truth: Truth) -> Array:
    """Errors of the named loads (poses, loads), each pose with one patch pressed."""
    selection = load_selection(model.load_names, model.patch_names)
    missed = [
        (_loads(patch, model.law, model.rays, poses).wrench - wrench) @ selection[:, p].T
        for p, (patch, (poses, wrench)) in enumerate(zip(model.patches, truth, strict=True))
    ]
    return np.concatenate(missed)
