"""The paper's surrogate, [EF15 Eqs. 1-7]: one network per load in two stages.

    f_i = min(net_i(pose), 0)          sensitive loads, one per patch (knee: Fy_med, Fy_lat; [EF15 Eqs. 1, 2])
    F_j = net_j(pose, f_1, ..., f_P)   every other load ([EF15 Eqs. 3-7])

The clamp is the paper's: a positive vertical force would be surfaces that pull, so it is set to zero [EF15 §3.5].
Networks carry the names of their loads.

Such networks give the same small load for a light contact and for a false one some millimetres apart. Where the samples
hold gaps, small networks of the signed root loads (``root_med``; those of the patch structure) are therefore trained
beside them. They give no load; they are inputs of the classifier of wrong poses (`surrogate.confidence`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.networks.graph import network_value
from casadi_contact.networks.kernel.networks import Bundle
from casadi_contact.networks.kernel.source import Kernel, c_text, table
from casadi_contact.networks.network import Regression
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.kernel import OWN
from casadi_contact.surrogate.patch.formulas import patch_kernel
from casadi_contact.surrogate.patch.networks import root_name
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate

if TYPE_CHECKING:
    from casadi_contact.samples.samples import Samples

# The root √|N/N0| has an infinite slope at N = 0; it is rounded off within this fraction of the boundary load,
# which changes s by less than 3e-5 (relative) at the boundary load itself.
ROOT_SMOOTHING = 0.01


class TwoStageSurrogate(Surrogate):
    """One network per load (`scene.load_names`); the sensitive ones feed the others."""

    structure = "two_stage"
    title = "two-stage surrogate"

    @classmethod
    def network_inputs(cls, scene: Scene) -> dict[str, int]:
        """The pose (6); for loads of the second stage the sensitive loads as well. ValueError: no fit."""
        if not cls.fits(scene):
            needed = "two_stage takes loads.sensitive of negative forces (-Fy_med) alone and no locked pose parameters"
            raise ValueError(f"scene {scene.name}: {needed}: use the patch structure")
        names = dict.fromkeys((*scene.sensitive_loads, *scene.load_names))
        inputs = {name: 6 if name in scene.sensitive_loads else 6 + len(scene.sensitive_loads) for name in names}
        return inputs | {root_name(patch): 6 for patch in scene.patch_names}

    @staticmethod
    def fits(scene: Scene) -> bool:
        """True where patches are pressed along negative forces, as the clamp wants, and no pose parameter is bound."""
        directed = all(normal.component is not None and normal.sign < 0.0 for normal in scene.normal_loads)
        return directed and scene.pose_space.unconstrained

    @staticmethod
    def regressions(samples: Samples) -> list[Regression]:
        """One regression per load on training and validation rows: raw loads, the scene's tolerance.

        The second stage is trained on the samples' own sensitive loads. Raises ValueError for NaN or no samples.
        """
        from casadi_contact.samples.samples import finite, fitted_rows
        from casadi_contact.surrogate.patch.regressions import patch_regressions

        scene = samples.scene
        rows, validation = fitted_rows(samples)
        poses = finite("poses", samples.poses)[rows]
        names = list(dict.fromkeys((*scene.sensitive_loads, *scene.load_names)))
        loads = finite("loads", samples.loads(names))[rows]
        count = len(scene.sensitive_loads)
        with_forces = np.hstack([poses, np.minimum(loads[:, :count], 0.0)])
        of_loads = [
            Regression(
                name,
                poses if column < count else with_forces,
                loads[:, column],
                np.ones(rows.sum()),
                validation,
                float(scene.tolerances.get(name, scene.boundary_load)),
                domain=samples.domain[rows],
            )
            for column, name in enumerate(names)
        ]
        beside = patch_regressions(samples) if np.isfinite(samples.gaps).all() else []
        return [*of_loads, *(each for each in beside if each.name.startswith(root_name("")))]

    @cached_property
    def _validity_roots(self) -> Surrogate:  # type: ignore[override]
        """The root load networks as a surrogate; this one where a patch has none."""
        names = [root_name(patch) for patch in self.scene.patch_names]
        if not all(name in self.networks for name in names):
            return self
        return _RootLoads(self.scene, {name: self.networks[name] for name in names})

    @property
    def confidence_columns(self) -> Sequence[int]:
        """All six where no root load network tells how far the surfaces are apart."""
        return range(6) if self._validity_roots is self else super().confidence_columns

    def _confidence_roots(self) -> Kernel | None:
        roots = self._validity_roots
        if not isinstance(roots, PatchSurrogate):
            return None
        nothing = np.zeros((0, len(roots.patches), 6))
        return patch_kernel(roots.patches, nothing, self.scene.reference_load, None, OWN)

    @property
    def _rounding(self) -> float:
        """e² of the root loads (see `_roots`)."""
        return float((ROOT_SMOOTHING * self.scene.boundary_load / self.scene.reference_load) ** 2)

    @classmethod
    def required_networks(cls, scene: Scene) -> list[str]:
        """All but those of root loads."""
        return list(dict.fromkeys((*scene.sensitive_loads, *scene.load_names)))

    @classmethod
    def networks_for(cls, scene: Scene, loads: Sequence[str]) -> list[str]:
        """The loads' own networks, with the sensitive ones first where a second stage takes them."""
        first = list(scene.sensitive_loads)
        second = [load for load in loads if load not in first]
        return [*(first if second else [name for name in first if name in loads]), *second]

    def _loads(self, poses: Array, loads: Sequence[str], *, derivative: bool) -> tuple[Array, Array]:
        """By the chain rule through the clamped forces."""
        first = [name for name in self.networks_for(self.scene, loads) if name in self.scene.sensitive_loads]
        raw, d_raw = self._raw(poses, first, derivative=derivative)
        forces = np.minimum(raw, 0.0)
        d_forces = np.where((raw < 0.0)[: len(d_raw), :, None], d_raw, 0.0)
        inputs = np.hstack([poses, forces])
        values, jacobian = np.empty((len(poses), len(loads))), np.empty((len(d_raw), len(loads), 6))
        for k, name in enumerate(loads):
            if name in first:
                values[:, k], jacobian[:, k] = forces[:, first.index(name)], d_forces[:, first.index(name)]
            elif derivative:
                values[:, k], gradient = self.networks[name].value_and_gradient(inputs)
                jacobian[:, k] = gradient[:, :6] + np.einsum("nf,nfj->nj", gradient[:, 6:], d_forces)
            else:
                values[:, k] = self.networks[name].value(inputs)
        return values, jacobian

    def _raw(self, poses: Array, first: Sequence[str], *, derivative: bool) -> tuple[Array, Array]:
        """First-stage outputs before the clamp (n, F) and their gradients (n, F, 6), (0, F, 6) if not asked for."""
        if not derivative:
            return np.stack([self.networks[name].value(poses) for name in first], axis=1), np.empty((0, len(first), 6))
        pairs = [self.networks[name].value_and_gradient(poses) for name in first]
        return np.stack([y for y, _ in pairs], axis=1), np.stack([g for _, g in pairs], axis=1)

    def _roots(self, poses: Array, *, derivative: bool) -> tuple[Array, Array]:
        """s = sign(N)·√(|N|/N0) of the raw first-stage output N = -net(pose), and ds/dpose: (n, P), (n, P, 6).

        The best this structure can give, and not much: out of contact the networks have only learned "about zero",
        so there the sign and the gradient of s carry no direction back into contact. The infinite slope at N = 0 is
        rounded off: s = u/(u² + e²)^(1/4), u = N/N0, e·N0 = 1 % of the boundary load.
        """
        raw, d_raw = self._raw(poses, self.scene.sensitive_loads, derivative=derivative)
        u, e2 = -raw / self.scene.reference_load, self._rounding
        q = u * u + e2
        slope = (0.5 * u * u + e2) / q**1.25
        return u / q**0.25, (-slope / self.scene.reference_load)[: len(d_raw), :, None] * d_raw

    def _expressions(self, pose: ca.MX, loads: Sequence[str]) -> tuple[ca.MX, ca.MX]:
        raw = {name: network_value(self.networks[name], pose) for name in self.scene.sensitive_loads}
        clamped = {name: ca.fmin(force, 0) for name, force in raw.items()}
        u = ca.vertcat(pose, *clamped.values())
        values = [clamped[name] if name in clamped else network_value(self.networks[name], u) for name in loads]
        n = ca.vertcat(*raw.values()) / -self.scene.reference_load
        return n / ca.sqrt(ca.sqrt(n * n + self._rounding)), ca.vertcat(*values)

    def _kernel(self, loads: Sequence[str], *, roots: bool) -> Kernel:
        needed = {*self.networks_for(self.scene, loads), *(self.scene.sensitive_loads if roots else ())}
        first = {name: self.networks[name] for name in self.scene.sensitive_loads if name in needed}
        second = {name: self.networks[name] for name in loads if name not in first}
        definitions = [
            f"#define FORCES {len(first)}",
            f"#define INPUTS {6 + len(first)}",
            f"#define OUTPUTS {len(second)}",
            f"#define REFERENCE_LOAD {float(self.scene.reference_load)!r}",
            f"#define ROUNDING {self._rounding!r}",
            "/* Which force, or output of the second stage after them, each load is. */",
            table("SOURCE", np.array([*map([*first, *second].index, loads), -1])),
        ]
        bundles = [Bundle("first", 6, first), Bundle("second", 6 + len(first), second)]
        return Kernel(bundles, "\n".join([*definitions, "", c_text("two_stage.h", __package__)]))


class _RootLoads(PatchSurrogate):
    """The root loads of a patch surrogate alone."""

    @classmethod
    def required_networks(cls, scene: Scene) -> list[str]:
        return [root_name(patch) for patch in scene.patch_names]
