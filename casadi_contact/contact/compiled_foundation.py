"""Contact models written in C: a model like any other for arrays of poses, and a CasADi function like a surrogate's."""

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import fields
from functools import cached_property
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.approach import touching_start
from casadi_contact.contact.foundation_source import C_FOLDER, C_LAWS, kernel_source
from casadi_contact.contact.friction import SlidingContact, checked_velocities
from casadi_contact.contact.model import PatchLoads, signed_roots, with_loads
from casadi_contact.contact.pressures import PressureOutputs
from casadi_contact.contact.symbolic import SymbolicContact, check_parameters, model_callback, parametric_function
from casadi_contact.core.compiler import CompilerError, shared_library, warn_once
from casadi_contact.core.conventions import Array, batched, rotation, twist_to_pose_gradient, wrench_names
from casadi_contact.core.threads import call_in_shares
from casadi_contact.networks.functions import as_weights, hessian_function, weighted_hessians
from casadi_contact.networks.kernel.source import ExportedModel, c_text, external_function, guards
from casadi_contact.networks.names import c_name, check_name, name_of_wrenches
from casadi_contact.scenes.loading import load_scene, ready_scenes
from casadi_contact.scenes.scene import Scene

OF_PRESSURES = "pressure_"  # what names of C functions begin with


class CompiledFoundation(SlidingContact, SymbolicContact, PressureOutputs):
    """Loads, root loads and pressures of a scene by a kernel in C; without a compiler, slower, in NumPy.

    compiled: False for NumPy in any case. ``record`` says what was chosen and how wrong it is, in plain values.
    """

    lanes = 4  # the most numbers that its C has in a vector
    varies = False  # whether its layer's thickness may
    resolution: str  # how finely it integrates, in words: "12 rays × 3 points"
    moments_header: str  # the C that defines ``patch_moments`` (see ``c/pressures.h``), after that of `_code`

    def __init__(self, scene: Scene, *, compiled: bool = True) -> None:
        super().__init__(scene)
        if scene.varies and not self.varies:
            raise ValueError(f"scene {scene.name}: a layer whose thickness varies takes cc.ElasticFoundation")
        self.record: dict[str, Any] = {}
        self._kernels: dict[tuple[tuple[str, ...], str, int], Path | None] = {}
        self._compiled = compiled and scene.material.law in C_LAWS
        if compiled and not self._compiled:
            warn_once(f"the pressure law {scene.material.law!r} has no C; the contact model runs in NumPy, slower")

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.scene.name}, {self.resolution})"

    @property
    @abstractmethod
    def _code(self) -> tuple[str, bytes]:
        """C that defines ``patch_loads`` (see ``c/foundation.h``), and its data (see `compiler.shared_library`)."""

    @abstractmethod
    def _patch_loads(self, R: Array, t: Array) -> list[PatchLoads]:
        """Loads of each patch at rotations (n, 3, 3) and translations (n, 3), in NumPy."""

    @abstractmethod
    def _moments_by_twist(self, R: Array, t: Array) -> tuple[Array, Array]:
        """Moments (n, P, 6) and their derivatives by the twist (n, P, 6, 6), in NumPy."""

    def compile(self) -> None:
        """Compile the kernel for arrays of poses now, where there is a compiler, so that no pose waits for it."""
        _ = self._library

    @batched
    def wrenches(self, poses: Array, velocities: ArrayLike | None = None) -> Array:
        """Wrench of each patch on the fixed body (n, patches, 6) [N, N·mm]; velocities: see `SlidingContact`."""
        if velocities is not None:
            return self.moving_wrenches(poses, checked_velocities(poses, velocities))
        return self._evaluate(poses).wrench

    @batched
    def jacobian(self, poses: Array, loads: Iterable[str] | None = None) -> tuple[Array, Array]:
        """Named loads (n, loads) and their derivatives by the pose (n, loads, 6) [per mm, per rad]."""
        if self._library is None:
            return super().jacobian(poses, loads)
        values = np.empty((len(poses), len(self.load_names)))
        jacobian = np.empty((*values.shape, 6))
        call_in_shares(self._library, "array_jacobians", poses, values, jacobian)
        if loads is None:
            return values, jacobian
        columns = [self.load_names.index(name) for name in self.check_loads(loads)]
        return values[:, columns], jacobian[:, columns]

    @batched
    def wrench_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Wrenches (n, patches, 6) and their derivatives by the pose (n, patches, 6, 6)."""
        found = self._evaluate(poses, slopes=True)
        return found.wrench, found.stiffness

    @batched
    def hessian(self, poses: Array, weights: ArrayLike, loads: Iterable[str] | None = None) -> Array:
        """Second derivatives by the pose (n, 6, 6) of Σ weights·loads, weights (L,) or (n, L), loads by name (all if
        left out); (6, 6) for a pose (6,). Raises ValueError for weights of another shape and for an unknown load."""
        names = self.check_loads(loads)
        columns = np.eye(len(self.load_names))[[self.load_names.index(name) for name in names]]
        of_all = as_weights(weights, len(poses), names) @ columns  # other loads have no weight
        if self._library is None:
            return weighted_hessians(self._differences, poses, of_all)
        hessians = np.empty((len(poses), 6, 6))
        call_in_shares(self._library, "array_hessians", poses, of_all, hessians)
        return hessians

    @cached_property
    def _differences(self) -> ca.Function:
        return hessian_function(self.function(compiled=False))

    @batched
    def at_edge(self, poses: Array) -> np.ndarray:
        """True (n, patches) where contact reaches a patch's rim: part of it may lie beyond."""
        return self._evaluate(poses).cut

    def pressure_moments(self, poses: Array) -> tuple[Array, Array]:
        """Moments (n, P, 6) and their derivatives by the pose (n, P, 6, 6), see `contact.pressures`."""
        values, by_twist = self._moments_by_twist(rotation(poses[:, 3:]), poses[:, :3])
        return values, twist_to_pose_gradient(by_twist, poses)

    def _outputs(self, poses: Array) -> tuple[Array, Array]:
        if self.scene.varies:  # the largest pressure need not lie where depth is largest
            raise ValueError(f"{self!r} has no pressures where thickness varies: take cc.ElasticFoundation")
        if self._pressure_library is None:
            return super()._outputs(poses)
        values = np.empty((len(poses), len(self.pressure_names)))
        jacobian = np.empty((*values.shape, 6))
        call_in_shares(self._pressure_library, f"{OF_PRESSURES}array_jacobians", poses, values, jacobian)
        return values, jacobian

    def pressure_function(self, names: Iterable[str] | None = None, name: str = "contact_pressures") -> ca.Function:
        """`PressureOutputs.pressure_function`, from C where there is a compiler."""
        chosen = self._checked(names)
        if (library := self._pressure_library) is None:
            return super().pressure_function(chosen, name)
        sizes = {"pressures": len(self.pressure_names), "none": 0}
        if chosen == self.pressure_names:
            return external_function(library, name, sizes, ["pressures"], before=OF_PRESSURES)
        whole = external_function(library, f"{check_name(name)}_of_all", sizes, ["pressures"], before=OF_PRESSURES)
        pose, columns = ca.MX.sym("pose", 6), [self.pressure_names.index(each) for each in chosen]
        # Inlined, so that no product with NaN, of a centre out of contact that is not asked for, is ever formed.
        inlined = {"always_inline": True}
        return ca.Function(name, [pose], [whole(pose)[columns]], ["pose"], ["pressures"], inlined)

    def _parametric(
        self, name: str, loads: Sequence[str], outputs: Sequence[str], compiled: bool, parameters: Iterable[str]
    ) -> ca.Function:
        inputs = check_parameters(parameters, self.scene.material)
        asked = ("loads", "roots") if "roots" in outputs else ("loads",)
        names = wrench_names(self.patch_names)
        of_patches = self._function(name_of_wrenches(check_name(name)), names, asked, compiled, None)
        return parametric_function(name, inputs, self.scene, self._rows(loads), of_patches, outputs)

    def _export_name(self) -> str:
        """Of the scene: knee_foundation; with the scene's digest unless it is a ready-made one as it comes."""
        name, digest = self.scene.name, self.scene.digest
        ready = name in ready_scenes() and load_scene(name).digest == digest
        return c_name(f"{name} foundation" if ready else f"{name} foundation {digest[:8]}")

    def exported(self, loads: Iterable[str] | None = None) -> ExportedModel:
        """C of the loads, root loads and pressures; raises ValueError for a pressure law without C."""
        if self.scene.material.law not in C_LAWS:
            raise ValueError(f"the pressure law {self.scene.material.law!r} has no C, expected {' or '.join(C_LAWS)}")
        names = self.check_loads(loads)
        texts = [self._source(names), c_text("export.h", C_FOLDER)]
        if self.pressure_names:
            texts.append(self._pressure_source())
        return ExportedModel(
            name=self._export_name(),
            source="\n".join(texts),
            load_names=names,
            patch_names=self.patch_names,
            calibrated=False,
            made_for="overlap of no more than the thickness of the layer, none from behind",
            reference_load=self.scene.reference_load,
            description=f"Contact loads of the scene {self.scene.name}, elastic foundation {self!r}.",
            vectors=True,
            data=self._code[1],
            wrench_source=self._source(wrench_names(self.patch_names)),
            pressure_names=self.pressure_names,
        )

    def example_pose(self, overlap_mm: float = 0.1) -> list[float]:
        """The scene's start pose; where patches are pressed along a direction, overlap_mm beyond the first touch."""
        pose, direction = self.scene.start_pose, self.scene.normal_loads[0].direction
        if direction is not None:
            deeper = touching_start(self)
            deeper[:3] += overlap_mm * direction
            deeper = self.scene.pose_space.project(deeper)
            pose = deeper if self.gaps(deeper).min() < 0.0 else pose
        return [float(value) for value in pose]

    def _function(
        self, name: str, loads: Sequence[str], outputs: Sequence[str], compiled: bool, batch: int | None
    ) -> ca.Function:
        if compiled and (library := self._kernel(loads or self.load_names)):
            sizes = {"loads": len(loads or self.load_names), "roots": len(self.patch_names)}
            return external_function(library, name, sizes, outputs, batch or 1)
        return model_callback(with_loads(self, loads), name, loads, outputs, batch)

    def _at_rates(self, name: str, loads: Sequence[str], compiled: bool, size: int) -> ca.Function:
        """casadi.Function pose, its rates, and with size 17 coefficients of friction -> loads."""
        function = super()._at_rates(name, loads, compiled, size)
        if not compiled or (library := self._kernel(loads, inputs=size)) is None:
            return function
        return external_function(library, name, {"loads": len(loads), "roots": 0}, ["loads"], inputs=size)

    def moving_wrenches(self, poses: Array, velocities: Array) -> Array:
        """Wrenches (n, patches, 6) of poses that change at these rates (n, 6)."""
        if (library := self._kernel(wrench_names(self.patch_names), inputs=12)) is None:
            return super().moving_wrenches(poses, velocities)
        wrenches = np.empty((len(poses), len(self.patch_names), 6))
        call_in_shares(library, "values_of", np.hstack([poses, velocities]), wrenches, None)
        return wrenches

    def _source(self, loads: Sequence[str], inputs: int = 6) -> str:
        roots = len(self.patch_names) if inputs == 6 else 0
        return kernel_source(self.scene, loads, roots, self._code[0], self.lanes, inputs)

    def _kernel(self, loads: Sequence[str], more: str = "", inputs: int = 6) -> Path | None:
        """The compiled kernel of these loads and of root loads, for CasADi and for arrays, and more C with it; None,
        with one warning, where there is no compiler. inputs: more than 6 for loads of moving bodies alone."""
        if not self._compiled:
            return None
        if (key := (tuple(loads), more, inputs)) not in self._kernels:
            arrays = c_text("batch.h", C_FOLDER) if inputs == 6 else ""
            texts = ["#define ENTRY", self._source(loads, inputs), arrays, more]
            try:
                self._kernels[key] = shared_library("\n".join(texts), data=self._code[1])
            except CompilerError as error:
                warn_once(f"{error}; the contact model runs in NumPy, which is slower")
                self._kernels[key] = None
        return self._kernels[key]

    @property
    def _library(self) -> Path | None:
        """The kernel of all loads."""
        return self._kernel(self.load_names)

    def _evaluate(self, poses: Array, *, wrenches: bool = True, slopes: bool = False, gaps: bool = False) -> PatchLoads:
        """All patches in n poses: wrench (n, P, 6), gap (n, P), their derivatives by the pose, cut (n, P).

        Derivatives of wrenches with slopes; gaps where a patch carries no load, or without wrenches; else undefined.
        """
        if self._library is None:
            patches = self._patch_loads(rotation(poses[:, 3:]), poses[:, :3])
            found = PatchLoads(*(np.stack([getattr(p, part.name) for p in patches], 1) for part in fields(PatchLoads)))
            by_pose = (twist_to_pose_gradient(of, poses) for of in (found.stiffness, found.gap_gradient))
            return PatchLoads(found.wrench, next(by_pose), found.gap, next(by_pose), found.cut)
        shape = (len(poses), len(self.patch_names))
        wrench, cut = np.empty((*shape, 6)), np.zeros(shape, dtype=np.int32)
        stiffness = np.empty((*shape, 6, 6) if slopes else (0,))
        gap, gradient = np.zeros(shape), np.zeros((*shape, 6))
        asked = [wrench if wrenches else None, stiffness if slopes else None, cut]
        call_in_shares(self._library, "foundation_loads", poses, *asked, *((gap, gradient) if gaps else (None, None)))
        return PatchLoads(wrench, stiffness, gap, gradient, cut.astype(bool))

    def _wrenches_and_roots(self, poses: Array) -> tuple[Array, Array, Array, Array]:
        found = self._evaluate(poses, slopes=True, gaps=True)
        loads = found.wrench, found.stiffness
        return *loads, *signed_roots(self.scene, *loads, lambda rows: (found.gap[rows], found.gap_gradient[rows]))

    def gap_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Gaps (n, patches) [mm] and their derivatives by the pose (n, patches, 6)."""
        found = self._evaluate(poses, wrenches=False, gaps=True)
        return found.gap, found.gap_gradient

    @cached_property
    def _pressure_library(self) -> Path | None:
        """A kernel of its own, compiled when pressures are first asked for."""
        return self._kernel(self.load_names, self._pressure_source())

    def _pressure_source(self) -> str:
        texts = (c_text(name, C_FOLDER) for name in (self.moments_header, "pressures.h"))
        return "\n".join([*texts, guards(OF_PRESSURES, loads="OUTPUTS", roots="0")])
