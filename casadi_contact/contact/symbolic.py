"""Contact models as CasADi functions: of models without a kernel, and of material and placement besides the pose.

A model without a kernel is called back with its own Jacobian; CasADi differences that for Hessians.

Loads are proportional to K(E, ν) and, under the linear law, to 1/h: material inputs are factors on the scene's own
loads, NaN unless E > 0, -1 < ν < 0.5 and h > 0. The fixed body placed at (t_f, R_f) in the scene's frame is met by the
moving body at R_fᵀ(t - t_f), R_fᵀR; its wrench (F', T') there is F = R_f F', T = R_f T' + t_f × F about the origin.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from operator import attrgetter
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.friction import SlidingContact
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.pressure_law import law_of
from casadi_contact.core.conventions import (
    POSE_NAMES,
    Array,
    batched,
    load_jacobian,
    load_selection,
    wrench_names,
)
from casadi_contact.networks.frames import relative_pose, rotation
from casadi_contact.networks.functions import ContactFunctions
from casadi_contact.networks.names import check_name, name_of_wrenches
from casadi_contact.scenes.material import FRICTION_NAMES, Material
from casadi_contact.scenes.scene import Scene

Output = tuple[str, int, Callable[[Array], tuple[Array, Array]]]  # name, rows m, poses -> (n, m), (n, m, 6)
INLINED: dict[str, Any] = {"always_inline": True}  # derivatives of a call within a call take twice as long
_KEPT: list[ca.Callback] = []  # CasADi does not keep the Python side of a callback alive


def contact_callback(name: str, outputs: Sequence[Output], size: int = 6) -> ca.Function:
    """casadi.Function pose (6), or `size` numbers, -> outputs by name, through Python; NaN for what is not finite."""
    vector = ca.Sparsity.dense(size, 1)

    def evaluated(arg: Sequence[Any], which: int) -> list[Array]:
        """Values (which = 0) or Jacobians (1) of all outputs."""
        pose = np.array(arg[0], dtype=float).reshape(1, size)
        if not np.isfinite(pose).all():
            return [np.full((rows, size if which else 1), np.nan) for _, rows, _ in outputs]
        return [model(pose)[which][0] for _, _, model in outputs]

    def jacobian(name: str, options: dict[str, Any]) -> ca.Function:
        """Its inputs are the vector and the outputs, which are not needed."""
        inputs = {"i0": vector} | {f"i{k}": ca.Sparsity(rows, 1) for k, (_, rows, _) in enumerate(outputs, 1)}
        jacobians = {f"o{k}": ca.Sparsity.dense(rows, size) for k, (_, rows, _) in enumerate(outputs)}
        options = {**options, "enable_fd": True, "fd_method": "central"}
        return _Called(name, inputs, jacobians, lambda arg: evaluated(arg, 1), options=options)

    columns = {key: ca.Sparsity.dense(rows, 1) for key, rows, _ in outputs}
    made = _Called(check_name(name), {"pose": vector}, columns, lambda arg: evaluated(arg, 0), jacobian)
    made.made_by = (contact_callback, (name, outputs, size))
    return made


class _Called(ca.Callback):
    """A Python function for CasADi: shapes of inputs and outputs by name; what makes its Jacobian, if it has one.

    made_by: what makes it anew in another process, with arguments that can be pickled.
    """

    made_by: tuple[Any, ...] = ()

    def __init__(
        self,
        name: str,
        inputs: dict[str, ca.Sparsity],
        outputs: dict[str, ca.Sparsity],
        function: Callable[[Sequence[Any]], list[Array]],
        jacobian: Callable[[str, dict[str, Any]], ca.Function] | None = None,
        options: dict[str, Any] | None = None,
    ) -> None:
        super().__init__()
        self._shapes, self._function, self._jacobian = (list(inputs.items()), list(outputs.items())), function, jacobian
        self.construct(name, options or {})
        _KEPT.append(self)

    def get_n_in(self) -> int:
        return len(self._shapes[0])

    def get_n_out(self) -> int:
        return len(self._shapes[1])

    def get_name_in(self, i: int) -> str:
        return self._shapes[0][i][0]

    def get_name_out(self, i: int) -> str:
        return self._shapes[1][i][0]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return self._shapes[0][i][1]

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self._shapes[1][i][1]

    def __copy__(self) -> _Called:
        return self

    def __deepcopy__(self, memo: Any = None) -> _Called:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return self.made_by

    def eval(self, arg: Sequence[Any]) -> list[Array]:
        """CasADi's call."""
        return self._function(arg)

    def has_jacobian(self) -> bool:
        return self._jacobian is not None

    def get_jacobian(self, name: str, inames: Any, onames: Any, opts: Any) -> ca.Function:
        return self._jacobian(name, opts)  # type: ignore[misc]


def _some_loads(model: ContactModel, rows: Sequence[int], poses: Array) -> tuple[Array, Array]:
    values, jacobian = model.jacobian(poses)
    return values[:, rows], jacobian[:, rows]


def model_callback(
    model: ContactModel, name: str, loads: Sequence[str], outputs: Sequence[str], batch: int | None = None
) -> ca.Function:
    """casadi.Function pose (6) -> outputs of a contact model, some of "loads" and "roots"; batch: number of poses."""
    some_loads = partial(_some_loads, model, [model.load_names.index(load) for load in loads])
    known: dict[str, Any] = {"loads": (len(loads), some_loads), "roots": (len(model.patch_names), model.root_loads)}
    function = contact_callback(name, [(key, *known[key]) for key in outputs])
    return function if batch is None else function.map(batch)


def _moving_loads(model: SlidingContact, selection: Array, inputs: Array) -> tuple[Array, Array]:
    """Loads (n, L) and their derivatives (n, L, m) by poses, their rates and perhaps coefficients (n, m)."""
    coefficients = inputs[0, 12:] if inputs.shape[1] > 12 else None
    values, slopes = load_jacobian(selection, *model.moving_jacobian(inputs[:, :6], inputs[:, 6:12], coefficients))
    return values, slopes[..., : inputs.shape[1]]


class SymbolicContact(ContactFunctions, ContactModel):
    """A `ContactModel` with CasADi functions: a surrogate, a foundation (`cc.foundation`), or `symbolic` of any other.

    record: plain values, with the learned range of poses as "pose_range" where there is one.
    """

    record: dict[str, Any]

    @abstractmethod
    def __call__(self, poses: Array, loads: Iterable[str] | None = None) -> Array:
        """Named loads (n, loads) [N, N·mm], all or those asked for."""

    def _at_rates(self, name: str, loads: Sequence[str], compiled: bool, size: int) -> ca.Function:
        """casadi.Function pose, its rates, and with size 17 coefficients of friction -> loads."""
        model = self.model if isinstance(self, CallbackContact) else self
        if not isinstance(model, SlidingContact):
            return super()._moving(name, loads, compiled, ())
        model.pressed_points(np.empty((0, 6)))  # refuses, where there are none
        selection = load_selection(loads, self.patch_names)
        return contact_callback(name, [("loads", len(loads), partial(_moving_loads, model, selection))], size)

    def _moving(self, name: str, loads: Sequence[str], compiled: bool, parameters: Iterable[str]) -> ca.Function:
        inputs = check_parameters(parameters, self.scene.material, moving=True)
        if inputs:
            size = 17 if set(inputs) & set(FRICTION_NAMES) else 12
            of_patches = self._at_rates(name_of_wrenches(name), wrench_names(self.patch_names), compiled, size)
            selection = load_selection(loads, self.patch_names)
            return parametric_function(name, inputs, self.scene, selection, of_patches, ("loads",), moving=True)
        pose, velocity = ca.MX.sym("pose", 6), ca.MX.sym("velocity", 6)
        found = self._at_rates(f"{name}_at_rates", loads, compiled, 12)(ca.vertcat(pose, velocity))
        return ca.Function(name, [pose, velocity], [found], ["pose", "velocity"], ["loads"], INLINED)


def symbolic(model: ContactModel) -> SymbolicContact:
    """The model itself where it has CasADi functions, else called back from CasADi, with differenced Hessians.

    Raises TypeError for a scene, or the name of one.
    """
    if isinstance(model, str | Scene):
        raise TypeError(f"got {model!r:.60}, expected a contact model: cc.foundation(scene) or cc.load_surrogate(name)")
    return model if isinstance(model, SymbolicContact) else CallbackContact(model)


class CallbackContact(SymbolicContact):
    """Any contact model with CasADi functions that call it back, through Python, with its own Jacobian."""

    jacobian: Any = property(attrgetter("model.jacobian"))
    root_loads: Any = property(attrgetter("model.root_loads"))
    jacobian_and_roots: Any = property(attrgetter("model.jacobian_and_roots"))
    wrenches: Any = property(attrgetter("model.wrenches"))
    wrench_jacobian: Any = property(attrgetter("model.wrench_jacobian"))
    gaps: Any = property(attrgetter("model.gaps"))
    at_edge: Any = property(attrgetter("model.at_edge"))

    def __init__(self, model: ContactModel) -> None:
        self.model, self.scene = model, model.scene
        self.load_names, self.patch_names = model.load_names, model.patch_names
        self.record: dict[str, Any] = {}
        self.has_wrenches, self.has_gaps = model.has_wrenches, model.has_gaps

    def __repr__(self) -> str:
        return f"symbolic({self.model!r})"

    @batched
    def __call__(self, poses: Array, loads: Iterable[str] | None = None) -> Array:
        """Named loads (n, loads) [N, N·mm], all or those asked for."""
        return self.model(poses)[:, [self.load_names.index(name) for name in self.check_loads(loads)]]

    def _function(
        self, name: str, loads: Sequence[str], outputs: Sequence[str], compiled: bool, batch: int | None
    ) -> ca.Function:
        return model_callback(self.model, name, loads, outputs, batch)  # there is nothing to compile


PLACEMENT = tuple(f"fixed_{name}" for name in POSE_NAMES)
PARAMETERS = ("youngs_modulus", "poissons_ratio", "thickness", *PLACEMENT)
"""And `FRICTION_NAMES` of what depends on the velocity."""


def check_parameters(parameters: Iterable[str], material: Material, *, moving: bool = False) -> tuple[str, ...]:
    """The parameters asked for: E [MPa], ν, h [mm], placement [mm, rad]; if moving, coefficients of friction.

    Raises ValueError for an unknown or repeated one, and for a thickness that is no factor of the loads.
    """
    names = tuple([parameters] if isinstance(parameters, str) else parameters)
    known = (*PARAMETERS, *FRICTION_NAMES) if moving else PARAMETERS
    unknown = [name for name in names if name not in known]
    if unknown or len(set(names)) < len(names):
        cure = "; with velocity=True also coefficients of friction" if set(unknown) & set(FRICTION_NAMES) else ""
        raise ValueError(f"parameters {', '.join(names)}, expected some of {', '.join(known)}, each once{cure}")
    if "thickness" in names and material.law != "linear":
        raise ValueError(f"thickness is no factor of the loads under the law {material.law!r}, expected the law linear")
    if (
        material.moving
        and (material.thickness_map or material.law != "linear")
        and not set(names) <= {*PLACEMENT, *FRICTION_NAMES}
    ):
        cause = (
            "in series with the moving layer it is no factor of the loads where thickness varies or under the law log"
        )
        raise ValueError(f"{', '.join(names)}: {cause}; expected a placement alone, or one layer")
    return names


def parametric_function(
    name: str,
    parameters: Sequence[str],
    scene: Scene,
    selection: Array,
    of_patches: ca.Function,
    outputs: Sequence[str],
    *,
    moving: bool = False,
) -> ca.Function:
    """Function pose (6), its rates (6) if moving, parameters (m) -> outputs, some of "loads" (L) and "roots" (P).

    selection (L, P, 6) picks loads. of_patches: pose (6), if moving with its rates and, where they are parameters,
    coefficients, -> wrenches (6·P), patch after patch, and for roots signed root loads (P), those of the scene's own
    material in the fixed body's frame. In contact a root load is that of the normal load N in the scene's frame,
    s·√(N/N'); out of contact it tells of the gap, which no material changes.
    """
    pose, given = ca.MX.sym("pose", 6), ca.MX.sym("parameters", len(parameters))
    value = dict(zip(parameters, ca.vertsplit(given), strict=True))
    placed = any(key in value for key in PLACEMENT)
    place = ca.vertcat(*(value.get(key, ca.MX(0.0)) for key in PLACEMENT))
    turn, shift = rotation(place[3:]), place[:3]
    met = relative_pose((shift, turn), (pose[:3], rotation(pose[3:]))) if placed else pose
    velocity = ca.MX.sym("velocity", 6)
    if moving:
        rates = ca.jtimes(met, pose, velocity) if placed else velocity
        coefficients = [value.get(key, ca.MX(number)) for key, number in vars(scene.friction).items()]
        met = ca.vertcat(met, rates, *(coefficients if of_patches.numel_in(0) > 12 else []))
    own = of_patches.call([met])
    there = found = ca.reshape(own[0], 6, selection.shape[1])
    if placed:
        force = turn @ found[:3, :]
        found = ca.vertcat(force, turn @ found[3:, :] + ca.skew(shift) @ force)
    ratio = _stiffness_ratio(value, scene.material)
    made = {"loads": ratio * (ca.DM(selection.reshape(len(selection), -1)) @ ca.vec(found))}
    if "roots" in outputs:
        roots = []
        for patch, (s, normal) in enumerate(zip(ca.vertsplit(own[1]), scene.normal_loads, strict=True)):
            grown = ratio
            if placed and normal.index is not None:
                before, after = (ca.if_else(s > 0.0, of[normal.index, patch], 1.0) for of in (there, found))
                grown = ratio * after / before
            roots.append(s * ca.sqrt(ca.if_else(s > 0.0, grown, 1.0)))
        made["roots"] = ca.vertcat(*roots)
    inputs = {"pose": pose, **({"velocity": velocity} if moving else {}), "parameters": given}
    chosen: Any = [made[key] for key in outputs]
    return ca.Function(name, [*inputs.values()], chosen, [*inputs], list(outputs), INLINED)


def _stiffness_ratio(value: dict[str, ca.MX], material: Material) -> ca.MX:
    """(K/h) over that of the scene's material; NaN where there is no such material, so that a solver steps back."""
    names = ("youngs_modulus", "poissons_ratio", "thickness")
    E, nu, h = (ca.MX(value.get(name, getattr(material, name))) for name in names)
    modulus = (1.0 - nu) * E / ((1.0 + nu) * (1.0 - 2.0 * nu))
    bounds = {"youngs_modulus": E > 0.0, "poissons_ratio": ca.logic_and(nu > -1.0, nu < 0.5), "thickness": h > 0.0}
    _, own, thickness = law_of(material)
    in_series = thickness - material.thickness  # of the modulus `own`: the moving body's layer
    ratio = thickness / (h * own / modulus + in_series)
    for name in (name for name in names if name in value):
        ratio = ca.if_else(bounds[name], ratio, np.nan)
    return ratio
