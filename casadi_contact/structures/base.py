"""What surrogate structures share: named networks, CasADi functions, file and description."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import casadi as ca

from casadi_contact.conventions import Array, pose_or_poses
from casadi_contact.dataset import Samples
from casadi_contact.network import Network, Regression
from casadi_contact.scenes.scene import Scene
from casadi_contact.structures.file import Content, write_file
from casadi_contact.structures.info import SurrogateInfo, describe
from casadi_contact.structures.trust import Trust
from casadi_contact.transcription import export_c, function_with_derivatives
from casadi_contact.transcription.expressions import Expressions, nan_if_not_finite, nan_marker
from casadi_contact.transcription.kernel import CompilerError, Kernel, compiled_function, warn_once


class Surrogate(ABC):
    """Networks and the scene they were trained for.

    networks: by name; record: what trained them (see `casadi_contact.structures.info`), plain JSON values; trust: what
    `validity` and `expected_error` are made of (see `casadi_contact.structures.calibration`).
    ``load_names`` are the scene's loads that the given networks are enough for.
    """

    structure: ClassVar[str]
    title: ClassVar[str]
    """What charts call it."""
    budget_shares: ClassVar[Mapping[str, float]] = {}
    """Share of a network's training time, by the start of its name; 1 for all others."""

    def __init__(
        self,
        scene: Scene,
        networks: Mapping[str, Network],
        record: Mapping[str, Any] | None = None,
        trust: Trust | None = None,
    ) -> None:
        self.scene = scene
        self.networks = dict(networks)
        self.record = dict(record or {})
        self.trust = trust
        self.patch_names = scene.patch_names
        known = self.network_inputs(scene)
        for name, network in self.networks.items():
            if name not in known:
                raise ValueError(
                    f"unknown network {name!r} for a {self.structure} surrogate of scene {scene.name!r}, "
                    f"expected one of {', '.join(known)}"
                )
            if len(network.input_shift) != known[name]:
                raise ValueError(f"network {name!r} has {len(network.input_shift)} inputs, expected {known[name]}")
        self.load_names = tuple(load for load in scene.load_names if not self._missing([load]))
        if not self.load_names:
            raise ValueError(
                f"networks {', '.join(networks) or '(none)'} are not enough for any load of scene "
                f"{scene.name!r}, expected some of {', '.join(known)}"
            )

    @staticmethod
    def fits(scene: Scene) -> bool:
        """True where this structure can stand for the scene's loads."""
        return True

    @classmethod
    @abstractmethod
    def network_inputs(cls, scene: Scene) -> dict[str, int]:
        """Every network this structure can have for a scene, with its number of inputs."""

    @staticmethod
    @abstractmethod
    def regressions(samples: Samples) -> list[Regression]:
        """The regressions, one for each network, that samples pose."""

    @classmethod
    @abstractmethod
    def networks_for(cls, scene: Scene, loads: Sequence[str]) -> list[str]:
        """Names of the networks that the loads need; raises ValueError for an unknown load."""

    def needed_networks(self, loads: Sequence[str]) -> list[str]:
        """Names of the networks that the loads need; raises ValueError for an unknown load."""
        return self.networks_for(self.scene, loads)

    @pose_or_poses
    def __call__(self, poses: Array, loads: Iterable[str] | None = None) -> Array:
        """Loads (n, L) for poses (n, 6), or (L,) for a pose (6,): ``load_names``, or the loads asked for."""
        return self._loads(poses, self.check_loads(loads))

    @pose_or_poses
    def jacobian(self, poses: Array, loads: Iterable[str] | None = None) -> tuple[Array, Array]:
        """Loads (n, L) and d loads / d pose (n, L, 6) for poses (n, 6); (L,) and (L, 6) for a pose (6,)."""
        return self._loads_and_jacobian(poses, self.check_loads(loads))

    @pose_or_poses
    def root_loads(self, poses: Array) -> tuple[Array, Array]:
        """Signed root loads s (n, P), s = √(N/N0) in contact and negative outside, and ds/dpose (n, P, 6).

        (P,) and (P, 6) for a pose (6,).
        """
        self._check_roots()
        return self._roots_and_jacobian(poses)

    @abstractmethod
    def _loads(self, poses: Array, loads: Sequence[str]) -> Array:
        """Loads (n, L)."""

    @abstractmethod
    def _loads_and_jacobian(self, poses: Array, loads: Sequence[str]) -> tuple[Array, Array]:
        """Loads (n, L) and their derivatives (n, L, 6)."""

    @abstractmethod
    def _roots_and_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Root loads (n, P) and their derivatives (n, P, 6)."""

    @abstractmethod
    def _expressions(self, pose: ca.MX, loads: Sequence[str], order: int) -> Expressions:
        """The same in CasADi, with derivatives up to order 0, 1 or 2."""

    @abstractmethod
    def _kernel(self, loads: Sequence[str], *, roots: bool) -> Kernel:
        """The same in C."""

    @abstractmethod
    def _root_networks(self) -> list[str]:
        """Names of the networks that root loads need."""

    def _root_count(self) -> int:
        """Number of root loads that `_expressions` and `_kernel` give."""
        return len(self.patch_names)

    def _patch_roots(self, roots: ca.MX) -> ca.MX:
        """Root loads of the patches (P x n) from those (`_root_count` x n) that `_expressions` and `_kernel` give."""
        return roots

    @classmethod
    def assemble(
        cls, scene: Scene, networks: Mapping[str, Network], record: Mapping[str, Any] | None = None
    ) -> Surrogate:
        """Put trained networks together; the same as calling the class."""
        return cls(scene, networks, record)

    def _missing(self, loads: Sequence[str]) -> list[str]:
        return [name for name in self.needed_networks(loads) if name not in self.networks]

    def check_loads(self, loads: Iterable[str] | None) -> tuple[str, ...]:
        """The loads asked for (None: all of ``load_names``); ValueError where one is unknown or lacks a network."""
        if loads is None:
            return self.load_names
        if isinstance(loads, str):
            loads = (loads,)
        names = tuple(loads)
        if not names:
            raise ValueError(f"no loads asked for, expected some of {', '.join(self.load_names)}")
        for name in names:
            missing = self._missing([name])
            if missing:
                raise ValueError(
                    f"load {name!r} needs the network {', '.join(missing)} that this surrogate lacks, "
                    f"it gives {', '.join(self.load_names)}"
                )
        return names

    def _check_roots(self) -> None:
        missing = [name for name in self._root_networks() if name not in self.networks]
        if missing:
            raise ValueError(f"root loads need the network {', '.join(missing)} that this surrogate lacks")

    def require_trust(self) -> Trust:
        """The numbers behind validity and expected error; raises ValueError for a surrogate without."""
        if self.trust is None:
            raise ValueError(
                "this surrogate has no validity and expected error (it was never calibrated, or written by an older "
                "version): build it again, or run casadi-contact calibrate on its samples"
            )
        self._check_roots()
        return self.trust

    def trust_roots(self, poses: Array) -> Array:
        """Signed root loads (n, P) that validity and expected error go by: those of `root_loads`."""
        return self.root_loads(poses)[0]

    def trust_claims(self, poses: Array) -> Array | None:
        """Normal loads (n, P) [N] that `trust_roots` must confirm; None where the loads come from these roots."""
        return None

    def _trust_expressions(self, pose: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Validity (1) and expected errors (L) of a pose (6)."""
        return self.require_trust().expressions(pose, self.root_function()(pose))

    @pose_or_poses
    def validity(self, poses: Array) -> Array:
        """Validity (n,) of poses (n, 6): 1 well inside the sampled region, 0 far outside; see `trust`."""
        trust = self.require_trust()
        return trust.validity(poses, self.trust_roots(poses), self.trust_claims(poses))

    @pose_or_poses
    def expected_error(self, poses: Array) -> Array:
        """Expected error (n, L) [N, N·mm] of ``load_names``: 95 % of held-out errors lie below it; see `trust`."""
        trust = self.require_trust()
        return trust.expected_errors(poses, self.trust_roots(poses), self.trust_claims(poses))

    def validity_function(self, name: str = "contact_validity") -> ca.Function:
        """casadi.Function pose (6) -> validity (1), twice continuously differentiable.

        As a constraint for IPOPT write 1/validity <= 2, whose slope does not fade far outside.
        """
        pose = ca.MX.sym("pose", 6)
        return ca.Function(name, [pose], [self._trust_expressions(pose)[0]], ["pose"], ["validity"])

    def expected_error_function(self, name: str = "contact_expected_error") -> ca.Function:
        """casadi.Function pose (6) -> expected error (L) of ``load_names``, twice continuously differentiable."""
        pose = ca.MX.sym("pose", 6)
        return ca.Function(name, [pose], [self._trust_expressions(pose)[1]], ["pose"], ["expected_error"])

    def function(
        self,
        loads: Iterable[str] | None = None,
        name: str = "contact_loads",
        *,
        compiled: bool = False,
        batch: int | None = None,
    ) -> ca.Function:
        """casadi.Function pose (6) -> loads (L), with exact, explicit first and second derivatives.

        Only the networks that the loads need are in it. Works in ``map`` and in nlpsol. compiled: a C kernel instead
        of a CasADi graph, compiled once and kept in the user's cache folder; where that fails, one warning and the
        graph. It has no third derivatives, and is not for `save_function` (the library lies in the cache). batch:
        pose (6 x batch) -> loads (L x batch), in one call.
        """
        return self._function(name, self.check_loads(loads), ("loads",), compiled, batch)

    def root_function(
        self, name: str = "contact_roots", *, compiled: bool = False, batch: int | None = None
    ) -> ca.Function:
        """casadi.Function pose (6) -> signed root load of every patch (P); the rest as for `function`."""
        self._check_roots()
        return self._function(name, (), ("roots",), compiled, batch)

    def load_and_root_function(
        self,
        loads: Iterable[str] | None = None,
        name: str = "contact_loads_and_roots",
        *,
        compiled: bool = False,
        batch: int | None = None,
    ) -> ca.Function:
        """casadi.Function pose (6) -> loads (L), roots (P): both for the price of the loads."""
        names = self.check_loads(loads)
        self._check_roots()
        return self._function(name, names, ("loads", "roots"), compiled, batch)

    def _function(
        self, name: str, loads: Sequence[str], wanted: Sequence[str], compiled: bool, batch: int | None
    ) -> ca.Function:
        if batch is not None and batch < 1:
            raise ValueError(f"batch is {batch}, expected a number of poses of 1 or more")
        if "roots" not in wanted or self._root_count() == len(self.patch_names):
            return self._transcription(name, loads, wanted, compiled, batch)
        of_parts = self._transcription(f"{name}_of_parts", loads, wanted, compiled, batch)
        pose = ca.MX.sym("pose", 6, batch or 1)
        outputs = dict(zip(wanted, of_parts.call([pose]), strict=True))
        roots = self._patch_roots(outputs["roots"])
        outputs["roots"] = roots + ca.repmat(nan_marker(pose), roots.shape[0], 1)
        return ca.Function(name, [pose], [outputs[key] for key in wanted], ["pose"], list(wanted))

    def _transcription(
        self, name: str, loads: Sequence[str], wanted: Sequence[str], compiled: bool, batch: int | None
    ) -> ca.Function:
        if compiled:
            sizes = {"loads": len(loads), "roots": self._root_count()}
            kernel = self._kernel(loads, roots="roots" in wanted)
            try:
                return compiled_function(kernel, name, {key: sizes[key] for key in wanted}, batch or 1)
            except CompilerError as error:
                warn_once(f"{error}; using the CasADi graph, which is slower")
        pose = ca.MX.sym("pose", 6)
        function = function_with_derivatives(name, pose, self._outputs(pose, loads, wanted))
        return function if batch is None else function.map(batch)

    def jacobian_function(self, loads: Iterable[str] | None = None, name: str = "contact_jacobian") -> ca.Function:
        """casadi.Function pose (6) -> loads (L), Jacobian (L x 6) in one pass: for numbers, not for optimisation."""
        pose = ca.MX.sym("pose", 6)
        both = self._graph(pose, self.check_loads(loads), 1).loads
        inputs: list[Any] = [pose]
        return ca.Function(name, inputs, [both.value, both.jacobian], ["pose"], ["loads", "jacobian"])

    def _graph(self, pose: ca.MX, loads: Sequence[str], order: int) -> Expressions:
        return nan_if_not_finite(pose, self._expressions(pose, loads, order))

    def _outputs(
        self, pose: ca.MX, loads: Sequence[str], wanted: Sequence[str]
    ) -> dict[str, tuple[ca.MX, ca.MX, ca.MX]]:
        """Value, Jacobian and second derivatives of "loads" and "roots", each as a graph of its own."""
        graphs = [self._graph(pose, loads, order) for order in range(3)]
        outputs = {}
        for key in wanted:
            value, jacobian, second = (getattr(graph, key) for graph in graphs)
            outputs[key] = (value.value, jacobian.jacobian, second.second)
        return outputs

    def export_c(
        self,
        folder: str | Path,
        name: str | None = None,
        loads: Iterable[str] | None = None,
        example_pose: Sequence[float] = (0.0,) * 6,
    ) -> list[Path]:
        """Write C source and header for loads, Jacobian and Hessian, an example and a Makefile; return their paths."""
        names = self.check_loads(loads)
        return export_c(
            self._kernel(names, roots=False),
            folder,
            name=name or f"{self.scene.name}_contact",
            load_names=names,
            example_pose=example_pose,
            description=f"Contact loads of the scene {self.scene.name}, {self.structure} surrogate.",
        )

    def info(self) -> SurrogateInfo:
        """What this surrogate is, what it was trained on and how wrong it is; print it."""
        return describe(self.structure, self.scene, self.load_names, self.networks, self.record)

    def save(self, path: str | Path) -> None:
        """Write an HDF5 file that `load_surrogate` reads; raises OSError where it cannot be written."""
        write_file(path, Content(self.structure, self.scene, self.networks, self.record, self.trust))
