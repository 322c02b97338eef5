"""CasADi functions of a surrogate, and its C: loads, root loads, validity and expected error of a pose, derivatives."""

from __future__ import annotations

import hashlib
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import casadi as ca
import numpy as np

from casadi_contact.contact.friction import motion_functions
from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import WRENCH_NAMES, loads_of_total, wrench_names
from casadi_contact.networks.functions import checked_batch
from casadi_contact.networks.graph import nan_if_not_finite
from casadi_contact.networks.kernel.source import ExportedModel, Kernel, external_function
from casadi_contact.networks.names import c_name, check_name
from casadi_contact.networks.network import Network
from casadi_contact.scenes.material import FRICTION_NAMES
from casadi_contact.surrogate.confidence import Confidence
from casadi_contact.surrogate.kernel import SurrogateArrays, compiled_arrays, confidence_kernel

if TYPE_CHECKING:
    from casadi_contact.surrogate.sliding import SlidingPatches

_OUTSIDE = """\
INLINE int outside(const double *pose) {{
  {statement}
}}
"""
_ALWAYS_INSIDE = "return (void)pose, 0;"
_BY_VALIDITY = "double validity;\n  confidence_guarded_value(pose, 0, &validity);\n  return !(validity >= 0.5);"


class SurrogateFunctions(SymbolicContact):
    """What a structure gives as CasADi expressions and as C, made into functions that optimisation can use.

    Derivatives are exact; only the networks that the loads need are in a function.
    """

    structure: ClassVar[str]
    networks: dict[str, Network]
    confidence: Confidence | None
    _kernels: dict[tuple[tuple[str, ...], int], SurrogateArrays | None]
    ready_name = ""
    """Name under which `load_surrogate` finds it; empty for one that does not come with the library."""

    def require_confidence(self) -> Confidence:
        """The numbers behind validity and expected error; raises ValueError for a surrogate without."""
        if self.confidence is None:
            cure = "build it again, or run casadi-contact calibrate on its samples"
            raise ValueError(f"this surrogate was never calibrated, it has no validity and expected error: {cure}")
        return self.confidence

    @abstractmethod
    def _expressions(self, pose: ca.MX, loads: Sequence[str]) -> tuple[ca.MX, ca.MX]:
        """Signed root load of every patch (P) and the named loads (L) of a pose (6) in CasADi."""

    @abstractmethod
    def _kernel(self, loads: Sequence[str], *, roots: bool) -> Kernel:
        """The loads in C, and the root loads if asked for."""

    @property
    def _validity_roots(self) -> SurrogateFunctions:
        """Whose root loads validity and expected error depend on."""
        return self

    def validity_function(
        self, name: str = "contact_validity", *, compiled: bool = True, batch: int | None = None
    ) -> ca.Function:
        """casadi.Function pose (6) -> validity (1), twice continuously differentiable; the rest as for `function`.

        As a constraint for IPOPT write 1/validity <= 2, whose slope does not fade far outside.
        """
        return self._confidence_function(name, "validity", compiled, batch)

    def expected_error_function(
        self, name: str = "contact_expected_error", *, compiled: bool = True, batch: int | None = None
    ) -> ca.Function:
        """casadi.Function pose (6) -> expected error (L) of ``load_names``; as `validity_function`."""
        return self._confidence_function(name, "expected_error", compiled, batch)

    def _confidence_function(self, name: str, output: str, compiled: bool, batch: int | None) -> ca.Function:
        confidence, frames = self.require_confidence(), checked_batch(batch)
        if compiled and (kernel := self._compiled_kernel(self.load_names)):
            return kernel.function(name, [output], frames or 1)
        pose = ca.MX.sym("pose", 6)
        values = confidence.expressions(pose, self._validity_roots.root_function(compiled=False)(pose))
        # An SX expression calls it whole: CasADi has no logsumexp of SX.
        function = ca.Function(name, [pose], [values[output]], ["pose"], [output], {"never_inline": True})
        return function if frames is None else function.map(frames)

    def _function(
        self, name: str, loads: Sequence[str], outputs: Sequence[str], compiled: bool, batch: int | None
    ) -> ca.Function:
        if compiled and (kernel := self._compiled_kernel(loads or self.load_names, roots="roots" in outputs)):
            return kernel.function(name, outputs, batch or 1)
        pose = ca.MX.sym("pose", 6)
        values = dict(zip(("roots", "loads"), self._expressions(pose, loads), strict=True))
        given = [nan_if_not_finite(pose, values[key]) for key in outputs]
        function = ca.Function(check_name(name), [pose], given, ["pose"], list(outputs), {"never_inline": True})
        return function if batch is None else function.map(batch)

    @cached_property
    def sliding(self) -> SlidingPatches:
        """What its friction is made of, measured on the scene's elements when it is first asked for; raises ValueError
        for a scene without geometry, and for a surrogate that was never calibrated."""
        from casadi_contact.surrogate.sliding import SlidingPatches  # what evaluates a surrogate at rest needs none

        _ = self.scene.material
        return SlidingPatches(self.scene, self.require_confidence().centre_poses)

    def _moving(self, name: str, loads: Sequence[str], compiled: bool, parameters: Iterable[str]) -> ca.Function:
        names = tuple([parameters] if isinstance(parameters, str) else parameters)
        if learned := [each for each in names if each not in FRICTION_NAMES]:
            raise ValueError(f"parameters {', '.join(learned)} of a surrogate, expected {', '.join(FRICTION_NAMES)}")
        return super()._moving(name, loads, compiled, names)

    def _at_rates(self, name: str, loads: Sequence[str], compiled: bool, size: int) -> ca.Function:
        """casadi.Function pose, its rates, and with size 17 coefficients of friction -> loads."""
        if self.structure != "patch" or not all(
            loads_of_total(component, self.load_names, self.patch_names) for component in WRENCH_NAMES
        ):
            raise ValueError(
                f"{self!r} knows no wrench of each patch, of which friction is made: expected a patch surrogate"
            )
        wrenches, key = wrench_names(self.patch_names), (tuple(loads), size)
        motion = motion_functions(size, self.scene.friction, by_pose=True)
        if compiled and key not in self._kernels:
            source, law = self.sliding.sources(self._kernel(wrenches, roots=False), loads, motion)
            self._kernels[key] = compiled_arrays(source, loads, 0, f"friction of {self.scene.name}, some seconds", law)
        if compiled and (kernel := self._kernels[key]):
            return external_function(
                kernel.library, name, {"loads": len(loads), "roots": 0}, ["loads"], 1, "moving_", size
            )
        still = self._function(f"{name}_at_rest", wrenches, ("loads",), compiled, None)
        return self.sliding.function(still, name, loads, motion[0])

    def _compiled_kernel(self, loads: Sequence[str], *, roots: bool = True) -> SurrogateArrays | None:
        """The loads' kernel, compiled once; of all loads there is one that gives root loads and confidence as well."""
        key = (tuple(loads), roots or tuple(loads) == self.load_names)
        if key not in self._kernels:
            said, patches = f"the kernel of the surrogate {self.scene.name}, some seconds", len(self.patch_names)
            self._kernels[key] = compiled_arrays(self._source(*key), loads, patches * key[1], said)
        return self._kernels[key]

    def _source(self, loads: Sequence[str], roots: bool = True) -> str:
        """C of the loads, with roots also of these and of confidence."""
        count, beside = len(self.patch_names), None
        if roots and self.confidence is not None:
            beside = confidence_kernel(self.confidence, loads, self.load_names, count, self._confidence_roots())
        return self._kernel(loads, roots=roots).source(loads=len(loads), roots=count * roots, beside=beside)

    def _confidence_roots(self) -> Kernel | None:
        """A kernel of the root loads that confidence depends on; None where they are the surrogate's own."""
        return None

    def _export_name(self) -> str:
        """Name of a ready-made surrogate: knee_contact; else with a digest of scene, structure and networks."""
        if self.ready_name:
            return c_name(f"{self.ready_name} contact")
        digest = hashlib.sha256(f"{self.structure} {self.scene.digest}".encode())
        for name, net in sorted(self.networks.items()):
            digest.update(f"{name} {net.activation} {net.hidden}".encode())
            for array in (net.output_scale, net.input_shift, net.input_scale, *net.weights, *net.biases):
                digest.update(np.asarray(array, dtype="<f8").tobytes())
        return c_name(f"{self.scene.name} contact {digest.hexdigest()[:8]}")

    def exported(self, loads: Iterable[str] | None = None) -> ExportedModel:
        """C of the loads, and of all that the surrogate knows of them."""
        names = self.check_loads(loads)
        calibrated = self.confidence is not None
        return ExportedModel(
            self._export_name(),
            f"{self._source(names)}\n{_OUTSIDE.format(statement=_BY_VALIDITY if calibrated else _ALWAYS_INSIDE)}",
            names,
            self.patch_names,
            calibrated,
            "validity of at least 1/2" if calibrated else "unknown: this surrogate was never calibrated",
            self.scene.reference_load,
            f"Contact loads of the scene {self.scene.name}, {self.structure} surrogate.",
        )
