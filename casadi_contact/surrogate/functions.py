"""CasADi functions of a surrogate, and its C: loads, root loads, validity and expected error of a pose, derivatives."""

from __future__ import annotations

import hashlib
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from typing import ClassVar

import casadi as ca
import numpy as np

from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.networks.functions import function_with_derivatives
from casadi_contact.networks.graph import Expressions, nan_if_not_finite, nan_marker
from casadi_contact.networks.kernel.networks import Bundle
from casadi_contact.networks.kernel.source import ExportedModel, Kernel
from casadi_contact.networks.names import c_name, name_of_parts
from casadi_contact.networks.network import Network
from casadi_contact.surrogate.confidence import Confidence
from casadi_contact.surrogate.kernel import OWN_ROOTS, SurrogateArrays, SurrogateKernel, compiled_arrays

_CALLED = {"never_inline": True}  # an SX expression calls them whole: CasADi has no logsumexp of SX


class SurrogateFunctions(SymbolicContact):
    """What a structure gives as CasADi expressions and as C, made into functions that optimisation can use.

    Derivatives are exact and explicit; only the networks that the loads need are in a function.
    """

    structure: ClassVar[str]
    networks: dict[str, Network]
    confidence: Confidence | None
    _kernels: dict[tuple[tuple[str, ...], bool], SurrogateArrays | None]
    ready_name = ""
    """Name under which `load_surrogate` finds it; empty for one that does not come with the library."""

    def require_confidence(self) -> Confidence:
        """The numbers behind validity and expected error; raises ValueError for a surrogate without."""
        if self.confidence is None:
            raise ValueError(
                "this surrogate has no validity and expected error, because it was never calibrated: build it again, "
                "or run casadi-contact calibrate on its samples"
            )
        self.check_roots()
        return self.confidence

    @abstractmethod
    def _expressions(self, pose: ca.MX, loads: Sequence[str], order: int) -> Expressions:
        """Loads (L) and root loads of a pose (6) in CasADi, with derivatives up to order 0, 1 or 2."""

    @abstractmethod
    def _kernel(self, loads: Sequence[str], *, roots: bool) -> Kernel:
        """The loads in C, and the root loads if asked for."""

    @abstractmethod
    def _root_networks(self) -> list[str]:
        """Names of the networks that root loads need."""

    @property
    def _root_bounds(self) -> Sequence[int]:
        """Where the root loads of each patch begin among those of `_expressions` and `_kernel`, and their end."""
        return range(len(self.patch_names) + 1)

    def _patch_roots(self, roots: ca.MX) -> ca.MX:
        """Root loads of the patches (P x n) from those (parts x n) that `_expressions` and `_kernel` give."""
        return roots

    @property
    def _validity_roots(self) -> SurrogateFunctions:
        """Whose root loads validity and expected error depend on."""
        return self

    def _confidence_expressions(self, pose: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Validity (1) and expected errors (L) of a pose (6)."""
        return self.require_confidence().expressions(pose, self._validity_roots.root_function(compiled=False)(pose))

    def validity_function(self, name: str = "contact_validity") -> ca.Function:
        """casadi.Function pose (6) -> validity (1), twice continuously differentiable.

        As a constraint for IPOPT write 1/validity <= 2, whose slope does not fade far outside.
        """
        pose = ca.MX.sym("pose", 6)
        return ca.Function(name, [pose], [self._confidence_expressions(pose)[0]], ["pose"], ["validity"], _CALLED)

    def expected_error_function(self, name: str = "contact_expected_error") -> ca.Function:
        """casadi.Function pose (6) -> expected error (L) of ``load_names``, twice continuously differentiable."""
        pose = ca.MX.sym("pose", 6)
        return ca.Function(name, [pose], [self._confidence_expressions(pose)[1]], ["pose"], ["expected_error"], _CALLED)

    def _function(
        self, name: str, loads: Sequence[str], outputs: Sequence[str], compiled: bool, batch: int | None
    ) -> ca.Function:
        if "roots" not in outputs or self._root_bounds[-1] == len(self.patch_names):
            return self._transcription(name, loads, outputs, compiled, batch)
        of_parts = self._transcription(name_of_parts(name), loads, outputs, compiled, batch)
        pose = ca.MX.sym("pose", 6, batch or 1)
        values = dict(zip(outputs, of_parts.call([pose]), strict=True))
        roots = self._patch_roots(values["roots"])
        values["roots"] = roots + ca.repmat(nan_marker(pose), roots.shape[0], 1)
        return ca.Function(name, [pose], list(values.values()), ["pose"], list(values))

    def _transcription(
        self, name: str, loads: Sequence[str], outputs: Sequence[str], compiled: bool, batch: int | None
    ) -> ca.Function:
        if compiled and (kernel := self._compiled_kernel(loads or self.load_names, roots="roots" in outputs)):
            return kernel.function(name, outputs, batch or 1)
        pose = ca.MX.sym("pose", 6)
        function = function_with_derivatives(name, pose, self._outputs(pose, loads, outputs))
        return function if batch is None else function.map(batch)

    def _outputs(
        self, pose: ca.MX, loads: Sequence[str], outputs: Sequence[str]
    ) -> dict[str, tuple[ca.MX, ca.MX, ca.MX]]:
        """Value, Jacobian and second derivatives of "loads" and "roots", each as a graph of its own."""
        values, slopes, bends = (nan_if_not_finite(pose, self._expressions(pose, loads, order)) for order in range(3))
        return {
            key: (getattr(values, key).value, getattr(slopes, key).jacobian, getattr(bends, key).second)
            for key in outputs
        }

    def _compiled_kernel(self, loads: Sequence[str], *, roots: bool = True) -> SurrogateArrays | None:
        """The loads' kernel, compiled once; of all loads there is one that gives root loads and confidence as well."""
        key = (tuple(loads), roots or tuple(loads) == self.load_names)
        if key not in self._kernels:
            waited_for = f"the kernel of the surrogate {self.scene.name}, some seconds"
            self._kernels[key] = compiled_arrays(self._whole_kernel(*key), waited_for)
        return self._kernels[key]

    def _whole_kernel(self, loads: Sequence[str], roots: bool = True) -> SurrogateKernel:
        """C of the loads; with roots all else that the networks and the calibration are enough for."""
        roots = roots and all(name in self.networks for name in self._root_networks())
        kernel, confidence = self._kernel(loads, roots=roots), self.confidence if roots else None
        bundles, roots_source = list(kernel.bundles), ""
        if confidence is not None:
            beside, roots_source = self._confidence_roots_source()
            network = confidence.network
            bundles += [*beside, Bundle("confidence", len(network.input_shift), {"confidence": network})]
        bounds = self._root_bounds if roots else ()
        whole = Kernel(bundles, kernel.code)
        return SurrogateKernel(whole, tuple(loads), self.load_names, bounds, confidence, roots_source)

    def _confidence_roots_source(self) -> tuple[Sequence[Bundle], str]:
        """Networks beside the kernel's, and C function confidence_roots (see `SurrogateKernel`)."""
        return [], OWN_ROOTS

    def _export_name(self) -> str:
        """Name of a ready-made surrogate: knee_contact; else with a digest of scene, structure and networks,
        so that two models never share a name."""
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
        kernel = self._whole_kernel(self.check_loads(loads))
        condition, made_for = kernel.outside()
        return ExportedModel(
            self._export_name(),
            f"{kernel.source()}\n{condition}",
            kernel.loads,
            self.patch_names,
            kernel.root_count,
            kernel.confidence is not None,
            made_for,
            self.scene.reference_load,
            f"Contact loads of the scene {self.scene.name}, {self.structure} surrogate.",
        )
