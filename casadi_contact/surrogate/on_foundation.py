"""Few samples of a slow contact model, learned on top of the scene's foundation, which knows where contact is.

Of each patch the foundation gives a wrench W with the normal load N = N0·s². With z = (local pose x, max(s, 0)), each
over its range in the samples, and the monomials φ(z) up to a degree, the slow model has

    root load    s·κ,   κ = φ·a                  wrench    κ²·W + N·δ,   δ = φ·B      (none along the normal load)

so that loads vanish exactly where the foundation's do, and nothing pulls. a and B follow from weighted least squares
with weights √N and a ridge, this and the degree from the least error of left-out samples, e_i/(1 - h_i), with leverage
h = φᵀ(ΦᵀΦ)⁻¹φ (Montgomery, Peck, Vining, Introduction to Linear Regression Analysis). Prediction intervals give the
expected error; where φᵀ(ΦᵀΦ)⁻¹φ exceeds that of all samples, hidden extrapolation, validity ends.

Measured on `knee_fem` (`problems.studies.few_samples`): 30 to 300 samples come about as near as 1,000 by networks.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from functools import reduce
from itertools import combinations_with_replacement, product
from operator import mul
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from casadi_contact.contact.choice import foundation
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.model import WrenchLoads
from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import WRENCH_NAMES, Array, batched, load_selection, local_poses, wrench_names
from casadi_contact.core.files.containers import new_hdf5, open_hdf5
from casadi_contact.core.files.reading import existing_file
from casadi_contact.networks.frames import rotation
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.scenes.scene import Scene

if TYPE_CHECKING:
    from casadi_contact.samples.samples import Samples

KIND = "casadi_contact surrogate on a foundation"


@dataclass(frozen=True)
class Correction:
    """Of one patch, m monomials of k inputs: shift, scale (k,) of z; coefficients (m, 1 + 6) of κ and δ; inverse (m, m)
    of ΦᵀΦ; spread: the largest φᵀ·inverse·φ of the samples; mean_n: of their normal loads [N]; deviation (6,): of the
    errors of left-out samples over √N."""

    degree: int
    shift: Array
    scale: Array
    coefficients: Array
    inverse: Array
    spread: float
    mean_n: float
    deviation: Array

    def monomials(self, z: Any) -> list[Any]:
        """φ of inputs z: k columns (n,), or k CasADi expressions."""
        scaled = [(each - shift) / scale for each, shift, scale in zip(z, self.shift, self.scale, strict=True)]
        return monomials(scaled, self.degree)

    @classmethod
    def of(cls, z: Array, kappa: Array, wrench: Array, found: Array, normal: Array, along: int | None) -> Correction:
        """From n samples in contact: z (n, k), κ (n,), wrench (n, 6), that of the foundation (n, 6) and its normal load
        (n,), which is the component `along` of a wrench. Raises ValueError for fewer than 10."""
        if len(z) < 10:
            raise ValueError(f"a patch is in contact in {len(z)} samples, expected at least 10")
        shift, scale = z.mean(axis=0), np.maximum(z.std(axis=0), 1e-9)
        weights = np.sqrt(normal / normal.mean())[:, None]
        delta = (wrench - kappa[:, None] ** 2 * found) / normal[:, None]
        if along is not None:
            delta[:, along] = 0.0
        targets = np.column_stack([kappa, delta])
        best: tuple[float, Correction] | None = None
        for degree, ridge in product(range(4), (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)):
            phi = np.stack(monomials(list((z - shift).T / scale[:, None]), degree), axis=1)
            A = weights * phi
            inverse = np.linalg.inv(A.T @ A + ridge * len(A) * np.eye(A.shape[1]))
            coefficients = inverse @ (A.T @ (weights * targets))
            spread = np.einsum("ij,jk,ik->i", phi, inverse, phi)
            leverage = weights[:, 0] ** 2 * spread
            left_out = phi @ coefficients + (phi @ coefficients - targets) * (leverage / (1.0 - leverage))[:, None]
            of_wrench = left_out[:, :1] ** 2 * found + normal[:, None] * left_out[:, 1:] - wrench
            deviation = np.sqrt(np.mean(of_wrench**2 / normal[:, None], axis=0))
            size = float(np.linalg.norm(deviation[:3]))
            if best is None or size < best[0]:
                numbers = float(spread.max()), float(normal.mean())
                best = size, cls(degree, shift, scale, coefficients, inverse, *numbers, deviation)
        assert best is not None
        return best[1]


def monomials(z: Sequence[Any], degree: int) -> list[Any]:
    """All products of up to `degree` of the z, the constant first."""
    found = [z[0] * 0.0 + 1.0]
    for count in range(1, degree + 1):
        for chosen in combinations_with_replacement(z, count):
            found.append(reduce(mul, chosen))
    return found


class OnFoundation(WrenchLoads, SymbolicContact):
    """The scene's foundation, and a correction of each patch's wrench; see the module's text.

    Its CasADi functions have exact derivatives. Arrays of poses go through them: 20 µs a pose.
    """

    def __init__(self, scene: Scene, corrections: Sequence[Correction], record: dict[str, Any] | None = None) -> None:
        super().__init__(scene)
        self.corrections, self.record = list(corrections), record or {}
        self.foundation: CompiledFoundation = foundation(scene)
        self._functions: dict[tuple[Any, ...], ca.Function] = {}

    def __repr__(self) -> str:
        return f"OnFoundation({self.scene.name}, degrees {[each.degree for each in self.corrections]})"

    @classmethod
    def fit(cls, samples: Samples) -> OnFoundation:
        """Learn the samples that are not held back; raises ValueError for a patch with too few in contact."""
        from casadi_contact.samples.samples import TEST, mirrored

        scene = samples.scene
        used, base = samples.rows(samples.role != TEST), foundation(scene)
        if scene.symmetric:
            used = used.join_samples(mirrored(used))
        found, roots = base.wrenches(used.poses), base.root_loads(used.poses)[0]
        normal, wanted = (normal_forces(scene.normal_loads, each) for each in (found, used.wrenches))
        corrections = []
        for p, patch in enumerate(scene.patches):
            rows = (normal[:, p] > 1e-3 * scene.boundary_load) & (wanted[:, p] > 0.0)
            x = local_poses(used.poses, patch.anchor_mm)[:, list(scene.pose_space.free)]
            z, kappa = np.column_stack([x, roots[:, p]])[rows], np.sqrt(wanted[rows, p] / normal[rows, p])
            along = None if patch.normal.component is None else WRENCH_NAMES.index(patch.normal.component)
            each = Correction.of(z, kappa, used.wrenches[rows, p], found[rows, p], normal[rows, p], along)
            corrections.append(each)
        counted = {"samples": int((samples.role != TEST).sum()), "drawn_from": samples.provenance.get("models")}
        return cls(scene, corrections, counted)

    def save(self, path: str | Path) -> None:
        """Write a file that `load` reads: scene, record, and the numbers of each patch; raises OSError."""
        with new_hdf5(Path(path)) as file:
            file.attrs["kind"] = KIND
            file["scene"], file["record"] = self.scene.to_toml(), json.dumps(self.record)
            for name, correction in zip(self.patch_names, self.corrections, strict=True):
                group = file.create_group(f"patches/{name}")
                for key, value in vars(correction).items():
                    group[key] = value

    @classmethod
    def load(cls, path: str | Path) -> OnFoundation:
        """Read a file of `save`; FileNotFoundError, and ValueError for a foreign or damaged one."""
        with open_hdf5(existing_file(Path(path))) as file:
            if file.attrs.get("kind") != KIND:
                raise ValueError(f"{path} holds something else, expected what build --on foundation writes")
            scene = Scene.from_toml(file["scene"][()].decode())
            groups = [file[f"patches/{name}"] for name in scene.patch_names]
            names = [each.name for each in fields(Correction)]
            corrections = [Correction(**{name: group[name][()] for name in names}) for group in groups]
            return cls(scene, corrections, json.loads(file["record"][()].decode()))

    def _expressions(self, pose: ca.MX, loads: Sequence[str]) -> dict[str, ca.MX]:
        """Of a pose (6): loads (L), roots (P), validity (1), expected_error (L)."""
        scene = self.scene
        names, patches = wrench_names(self.patch_names), len(self.patch_names)
        known, roots = self.foundation._function("foundation", names, ("loads", "roots"), True, None)(pose)
        found, wrenches, corrected, invalid, errors = ca.reshape(known, 6, patches), [], [], 0.0, 0.0
        selection = load_selection(loads, self.patch_names)
        for p, (patch, own) in enumerate(zip(scene.patches, self.corrections, strict=True)):
            moved = ca.vertcat(pose[:3] + rotation(pose[3:]) @ ca.DM(patch.anchor_mm), pose[3:])
            inside = ca.fmax(roots[p], 0.0)
            normal = scene.reference_load * inside**2
            phi = ca.vertcat(*own.monomials([*(moved[k] for k in scene.pose_space.free), inside]))
            values = ca.DM(own.coefficients.T) @ phi
            wrenches.append(values[0] ** 2 * found[:, p] + normal * values[1:])
            corrected.append(roots[p] * values[0])
            spread = phi.T @ ca.DM(own.inverse) @ phi
            variance = ca.DM((selection[:, p] ** 2) @ (own.deviation**2))
            errors += variance * normal * (1.0 + normal / own.mean_n * spread)
            invalid += (spread / own.spread) ** 4
        return {
            "loads": ca.DM(selection.reshape(len(loads), -1)) @ ca.vertcat(*wrenches),
            "roots": ca.vertcat(*corrected),
            "validity": 1.0 / (1.0 + invalid),
            "expected_error": 2.0 * ca.sqrt(errors),
        }

    def _function(
        self, name: str, loads: Sequence[str], outputs: Sequence[str], compiled: bool, batch: int | None
    ) -> ca.Function:
        pose = ca.MX.sym("pose", 6)
        values = self._expressions(pose, loads or self.load_names)
        function = ca.Function(name, [pose], [values[key] for key in outputs], ["pose"], list(outputs))
        return function if batch is None else function.map(batch)

    def _arrays(self, poses: Array, output: str, loads: Iterable[str], derivative: bool = False) -> Array:
        """An output (n, m) at poses (n, 6), or its derivatives (n, m, 6)."""
        key = (output, tuple(loads), derivative)
        if key not in self._functions:
            pose, names = ca.MX.sym("pose", 6), list(loads)
            value = self._function("values", names, [output], True, None)(pose)
            wanted = ca.densify(ca.jacobian(value, pose)) if derivative else value
            self._functions[key] = ca.Function("values", [pose], [wanted])
        made = [self._functions[key](pose).full() for pose in poses]
        shape = (len(poses), -1, 6) if derivative else (len(poses), -1)
        return np.reshape(made, shape)

    @batched
    def wrenches(self, poses: Array) -> Array:
        """Wrench of each patch on the fixed body (n, patches, 6) [N, N·mm]."""
        return self._arrays(poses, "loads", wrench_names(self.patch_names)).reshape(len(poses), -1, 6)

    @batched
    def wrench_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Wrenches (n, patches, 6) and their derivatives by the pose (n, patches, 6, 6)."""
        slopes = self._arrays(poses, "loads", wrench_names(self.patch_names), derivative=True)
        return self.wrenches(poses), slopes.reshape(len(poses), -1, 6, 6)

    @batched
    def root_loads(self, poses: Array) -> tuple[Array, Array]:
        """Signed root load of each patch (n, patches) and ds/dpose (n, patches, 6)."""
        roots = (self._arrays(poses, "roots", self.load_names, derivative) for derivative in (False, True))
        return next(roots), next(roots)

    @batched
    def gap_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Gaps (n, patches) [mm] and their derivatives by the pose (n, patches, 6): the foundation's."""
        return self.foundation.gap_jacobian(poses)

    @batched
    def validity(self, poses: Array) -> Array:
        """1 (n,) among the samples, 1/2 where one spreads as far as the farthest of them, 0 far outside."""
        return self._arrays(poses, "validity", self.load_names)[:, 0]

    @batched
    def expected_error(self, poses: Array) -> Array:
        """Expected error (n, L) [N, N·mm]: about 95 % of unseen errors lie below it."""
        return self._arrays(poses, "expected_error", self.load_names)
