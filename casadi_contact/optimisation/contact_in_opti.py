"""A contact in the user's own ``casadi.Opti``: variables, bounds, a start in contact, loads that are found again; and
the settled pose as a function of the loads, for an optimisation that has no pose among its variables."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.symbolic import symbolic
from casadi_contact.core.conventions import POSE_NAMES, Array, check_above_zero, check_loads, pose_index
from casadi_contact.optimisation.contact_frames import ContactFrames
from casadi_contact.optimisation.ipopt import settled_options
from casadi_contact.optimisation.starts import learned_range


class ContactInOpti(ContactFrames):
    """`ContactFrames` whose variables, bounds and start stand in an Opti.

        contact = ContactInOpti(opti, model, locked={"ry": 0.0, "rz": -0.5})
        contact.carry({"Fy_med": -600.0, "Fy_lat": -400.0})
        opti.minimize(ca.sumsqr(contact.pose[[0, 2], :]))  # forces alone leave tx and tz open
        opti.solver("ipopt", contact.options())
        poses = contact.poses(opti.solve())

    ``pose``, ``loads`` and ``roots`` are expressions for the user's own objective and constraints.
    Raises ValueError like `ContactFrames`, and for a locked number outside what the surrogate has learned."""

    def __init__(
        self,
        opti: ca.Opti,
        model: ContactModel,
        frames: int = 1,
        *,
        locked: Mapping[str, Any] | None = None,
        loads: Iterable[str] | None = None,
        compiled: bool = True,
        parameters: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(
            model, frames, locked=locked, loads=loads, compiled=compiled, parameters=parameters, variable=opti.variable
        )
        self._opti, (low, high) = opti, learned_range(self.model)
        for name, value in self._locked.items():
            at = pose_index(name)
            if not isinstance(value, ca.MX) and not ((value >= low[at]) & (value <= high[at])).all():
                learned = f"the surrogate learned {low[at]:.4g} to {high[at]:.4g}"
                raise ValueError(f"{name} is locked at {value.min():.4g} to {value.max():.4g}, {learned}")
        bounded = np.flatnonzero(np.isfinite(self.lower) & np.isfinite(self.upper)).tolist()
        if bounded:
            opti.subject_to(opti.bounded(self.lower[bounded], ca.vec(self.q)[bounded], self.upper[bounded]))
        if not any(isinstance(value, ca.MX) for value in (locked or {}).values()):
            self.begin()

    def carry(self, targets: Mapping[str, Any]) -> None:
        """Ask for loads (as for `misfit`) as constraints, and begin where the contact carries the normal ones, unless
        targets are expressions. A load that need not be met exactly goes into the objective as
        ``ca.sumsqr(contact.misfit(targets))``; forces that press the joint together had better be constraints."""
        self._opti.subject_to(ca.vec(self.misfit(targets)) / 100.0 == 0.0)
        if not any(isinstance(value, ca.MX) for value in (*targets.values(), *self._locked.values())):
            self.begin(targets)

    def keep(self, least_n: float = 2.5) -> None:
        """Hold every patch in contact, with a normal load of at least least_n [N], as constraints: a balance that
        reserve actuators can close may otherwise end, solved, without contact."""
        check_above_zero(least_n=least_n)
        self._opti.subject_to(ca.vec(self.roots) >= np.sqrt(least_n / self._scene.reference_load))

    def begin(self, targets: Mapping[str, ArrayLike] | None = None, poses: ArrayLike | None = None) -> None:
        """Set the start: poses (n, 6) or (6,), or the middle of the learned range, settled as `start_poses` does, under
        targets or a fifth of the scene's reference load on each patch."""
        self.begin_at(self.start_poses(targets, poses))

    def begin_at(self, poses: ArrayLike) -> None:
        """Set the start to poses (n, 6) or (6,) as they are, but for the learned range."""
        self._opti.set_initial(self.q, self.variables(self.each_frame(poses)).reshape(self.frames, -1).T)

    def poses(self, solution: ca.OptiSol) -> Array:
        """Poses (n, 6) of a solution, or of ``opti.debug``."""
        return np.asarray(ca.DM(solution.value(self.pose))).reshape(6, self.frames).T

    def report(self, solution: ca.OptiSol) -> str:  # type: ignore[override]
        """Findings about a solution (`ContactFrames.report`), to be printed."""
        return super().report(solution.value)

    @staticmethod
    def options(**ipopt: Any) -> dict[str, Any]:
        """Options for ``opti.solver("ipopt", ...)`` (`settled_options`); bounds reach IPOPT as bounds, so that it never
        evaluates loads outside the learned range."""
        return {**settled_options(**ipopt), "detect_simple_bounds": True}


TOLERANCE_N = 1e-8


def settled_function(
    model: ContactModel,
    free: Sequence[str] = ("ty", "rx"),
    targets: Sequence[str] = ("Fy_med", "Fy_lat"),
    name: str = "settled",
    *,
    parameters: Sequence[str] = (),
) -> ca.Function:
    """casadi.Function targets (m) [N, N·mm, or mm of a centre of pressure], start (6) -> pose (6) that carries them.

    parameters: of a foundation's material and placement, a third input (see `ContactFunctions.function`).

    The free parameters of the pose solve the misfit of `ContactFrames` (root loads, which have a slope out of contact)
    to 1e-8 N, by Newton's method from the start; all others stay as the start has them. First and second derivatives
    by targets, parameters and what stays are exact, dq/dt = -(∂r/∂q)⁻¹ ∂r/∂t; by the free part of the start zero.
    Where Newton's method fails the function raises RuntimeError, or gives NaN: start in contact (`start_poses` of
    `ContactFrames`, `settle`). Raises ValueError for unknown names, and unless there are as many targets as free
    parameters."""
    free, targets, parameters = ((of,) if isinstance(of, str) else tuple(of) for of in (free, targets, parameters))
    model = symbolic(model)
    space = model.scene.pose_space
    check_loads(POSE_NAMES, free)
    if len(free) != len(targets):
        raise ValueError(f"got targets {', '.join(targets)} for free {', '.join(free)}, expected as many of both")
    start, given, p = (ca.MX.sym(*of) for of in (("start", 6), ("targets", len(targets)), ("p", len(parameters))))
    locked = {POSE_NAMES[i]: start[i] for i in space.free if POSE_NAMES[i] not in free}
    frame = ContactFrames(model, 1, locked=locked, parameters=dict(zip(parameters, ca.vertsplit(p), strict=True)))
    residual = frame.misfit(dict(zip(targets, ca.vertsplit(given), strict=True)))
    problem = {"x": frame.q, "p": ca.vertcat(given, start, p), "g": residual}
    options = {"abstol": TOLERANCE_N, "max_iter": 100, "error_on_fail": True}
    solve = ca.rootfinder("settle", "newton", problem, options)
    begin = ca.vertcat(*(start[POSE_NAMES.index(of)] / frame.scale(of) for of in frame.free))
    found = solve(begin, problem["p"])
    off, pose = ca.Function("at", [frame.q, problem["p"]], [ca.norm_inf(residual), frame.pose])(found, problem["p"])
    pose += ca.if_else(off <= 1e3 * TOLERANCE_N, 0.0, np.nan)  # Newton's method also ends where no step helps
    inputs = {"targets": given, "start": start} | ({"parameters": p} if parameters else {})
    return ca.Function(name, list(inputs.values()), [pose], list(inputs), ["pose"])
