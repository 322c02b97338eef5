"""The pose at which contact carries given loads, as a CasADi function of the loads: contact inside an optimisation that
has no pose among its variables."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.symbolic import symbolic
from casadi_contact.core.conventions import POSE_NAMES, check_loads
from casadi_contact.optimisation.contact_frames import ContactFrames

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
    parameters.
    """
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
