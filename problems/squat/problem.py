"""A squat by direct collocation: least activation, with a weight on the medial contact force.

    min  mean over time of [ mean_m a_m² + w·(F_med/BW)² ] + ε·Σ (change of a_m from point to point)²

with the sum over all points and muscles m, over the segments' angles φ, their rates, activations a and the knee's pose
(tx, ty, rx) at every collocation point, subject to the leg's equations of motion, the balance of forces across the knee
with the contact model's loads (`leg`), and the centre of pressure under the foot. Knee flexion goes down and up once as
a cosine of time, as to a metronome; ankle, hip and muscles are free, at rest at both ends. (With free timing the least
activation is to stand as long as possible and drop.) w is a parameter of the nlp: one solver for all points of the
trade-off, exact Hessian.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact import SymbolicContact
from casadi_contact.conventions import Array, pose_index
from casadi_contact.optimisation import KNEE_STEPS, total_selection
from casadi_contact.optimisation.collocation import Collocation, Unknowns
from casadi_contact.optimisation.knee import check_knee
from problems.squat.leg import Body, LegMechanics
from problems.squat.muscles import MUSCLES

FREE = ("tx", "ty", "rx")
STANDING_FLEXION_DEG = 10.0
LEAST_DURATION_S = 0.3  # nobody falls as fast, and IPOPT looks for muscles that do for minutes
LEAST_ACTIVATION = 0.01
_COST_SCALE = 100.0  # the cost is some thousandths, which a barrier of usual size would drown
_STEADINESS = 1e-3  # ε
_LOWEST = np.array([-0.2, -2.0, -0.4])  # lean of shank, thigh, trunk [rad]
_HIGHEST = np.array([0.8, 0.2, 1.4])
_TO_STEPS = KNEE_STEPS[[pose_index(name) for name in FREE]]
_REACH = np.array([15.0, np.inf, 0.05])  # tx [mm], ty, rx [rad]: where the condyles still lie in their dishes
_AT_BOUND = 1e-3  # of its size
SEGMENTS = ("shank", "thigh", "trunk")
_IN_WORDS = np.array([1.0, 1.0, 180.0 / np.pi])  # tx, ty [mm], rx [degrees]
_FORCE_N, _MOMENT_NM = 1000.0, 100.0  # of constraints


@dataclass(frozen=True)
class Squat:
    """A problem that can be looked at unsolved: nlp with parameter w, bounds on x and g, and the parts of x.

    unpack: x -> φ (3, points), rates (3, points) [rad/s], activations (m, points), poses of the knee (6, points).
    """

    model: SymbolicContact
    mechanics: LegMechanics
    grid: Collocation
    depth_deg: float
    nlp: dict[str, Any]
    lower: Array
    upper: Array
    lower_g: Array
    upper_g: Array
    unpack: ca.Function


def build(
    model: SymbolicContact,
    body: Body | None = None,
    *,
    depth_deg: float = 80.0,
    duration_s: float = 3.0,
    intervals: int = 24,
    degree: int = 3,
) -> Squat:
    """Transcribe the squat. Raises ValueError for a depth that is no squat, for a contact model of no knee with two
    sides (`check_knee`), and as `Collocation` does."""
    check_knee("a squat", model.scene, model.load_names)
    if not STANDING_FLEXION_DEG < depth_deg <= 110.0 or not LEAST_DURATION_S <= duration_s < np.inf:
        raise ValueError(
            f"depth {depth_deg} deg, {duration_s} s: expected a knee flexion above {STANDING_FLEXION_DEG:g} and up to "
            f"110 deg, and a time of {LEAST_DURATION_S:g} s or more"
        )
    grid = Collocation(intervals, degree, duration_s)
    mechanics = LegMechanics.of(Body() if body is None else body)
    unknowns, nodes, points = Unknowns(), intervals + 1, intervals * degree
    reach = _REACH / _TO_STEPS
    node_phi = unknowns.add("node_phi", 3, nodes, _LOWEST, _HIGHEST)
    node_rate = unknowns.add("node_rate", 3, nodes)
    phi = unknowns.add("phi", 3, points, _LOWEST, _HIGHEST)
    rate = unknowns.add("rate", 3, points)
    a = unknowns.add("a", len(MUSCLES), points, LEAST_ACTIVATION, 1.0)
    knee = unknowns.add("knee", 3, points, -reach, reach)
    bend = grid.derivatives(node_rate, rate) / grid.step_s
    left, within, medial = _moment_function(model, mechanics).map(points)(phi, rate, bend, a, knee)
    given = ca.DM(flexion_rad(grid.times_s, depth_deg, duration_s)).T
    zero = _defects(grid, (node_phi, node_rate), (phi, rate), left, given)
    weight, (lower, upper) = ca.MX.sym("weight"), unknowns.bounds
    return Squat(
        model=model,
        mechanics=mechanics,
        grid=grid,
        depth_deg=depth_deg,
        nlp={
            "x": unknowns.x,
            "p": weight,
            "f": _cost(grid, a, weight, medial / mechanics.body.weight_n),
            "g": ca.vertcat(zero, ca.vec(within)),
        },
        lower=lower,
        upper=upper,
        lower_g=np.zeros(zero.numel() + within.numel()),
        upper_g=np.concatenate([np.zeros(zero.numel()), np.full(within.numel(), np.inf)]),
        unpack=ca.Function("unpack", [unknowns.x], [phi, rate, a, _poses(phi, knee)]),
    )


def _defects(
    grid: Collocation, nodes: tuple[ca.MX, ca.MX], points: tuple[ca.MX, ca.MX], left: ca.MX, flexion: ca.DM
) -> ca.MX:
    """What is zero where angles and rates (3, n), at nodes and at points, are one motion with this flexion (1, n) that
    begins and ends at rest, and nothing is left (6, n) of its balances."""
    (node_phi, node_rate), (phi, rate) = nodes, points
    return ca.vertcat(
        ca.vec(grid.derivatives(node_phi, phi) - grid.step_s * rate),
        ca.vec(grid.jumps(node_phi, phi)),
        ca.vec(grid.jumps(node_rate, rate)),
        ca.vec(left),
        ca.vec(phi[0, :] - phi[1, :] - flexion),
        node_phi[0, 0] - node_phi[1, 0] - np.radians(STANDING_FLEXION_DEG),
        node_rate[:, 0],
        node_rate[[0, 2], -1],  # the thigh's follows from these and the flexion
    )


def _cost(grid: Collocation, a: ca.MX, weight: ca.MX, medial: ca.MX) -> ca.MX:
    """Of activations (m, n), and of the medial force (1, n) over the body's weight, at the points."""
    weights = ca.DM(grid.weights)
    effort = ca.dot(weights, ca.sum1(a**2).T) / len(MUSCLES)
    cost = effort + weight * ca.dot(weights, medial.T**2)
    return _COST_SCALE * (cost + _STEADINESS * ca.sumsqr(a[:, 1:] - a[:, :-1]))


def at_bounds(phi: Array, poses: Array) -> str:
    """Which bounds of the search hold a squat's leans φ (n, 3) or poses (n, 6), and at how many moments; "" for none.
    They are no part of a leg: what they hold would move farther for a lower cost."""
    low = [*np.degrees(_LOWEST), *-_REACH * _IN_WORDS]
    high = [*np.degrees(_HIGHEST), *_REACH * _IN_WORDS]
    values = np.hstack([np.degrees(phi), poses[:, [pose_index(name) for name in FREE]] * _IN_WORDS])
    words = [f"{name} lean" for name in SEGMENTS] + list(FREE)
    units = ["degrees"] * len(SEGMENTS) + ["mm", "mm", "degrees"]
    found = [
        f"{name} at {bound:.3g} {unit} ({int(held.sum())} of {len(phi)} moments)"
        for name, unit, column, *ends in zip(words, units, values.T, low, high, strict=True)
        for bound in ends
        if np.isfinite(bound) and (held := np.abs(column - bound) <= _AT_BOUND * abs(bound)).any()
    ]
    return ", ".join(found)


def flexion_rad(time_s: Array, depth_deg: float, duration_s: float) -> Array:
    """Knee flexion (n,) of the squat: from standing to the depth and back."""
    swing = 0.5 * (depth_deg - STANDING_FLEXION_DEG) * (1.0 - np.cos(2.0 * np.pi * time_s / duration_s))
    return np.asarray(np.radians(STANDING_FLEXION_DEG + swing))


def _poses(phi: ca.MX, knee: ca.MX) -> ca.MX:
    """Poses of the femur in the insert (6, n)."""
    moved, zero = ca.mtimes(ca.diag(ca.DM(_TO_STEPS)), knee), 0.0 * phi[0, :]
    return ca.vertcat(moved[0, :], moved[1, :], zero, moved[2, :], zero, phi[1, :] - phi[0, :])


def _moment_function(model: SymbolicContact, mechanics: LegMechanics) -> ca.Function:
    """(φ, φ̇, φ̈, a, scaled knee pose) -> what is left of the balances (6), room of the centre of pressure (2), and
    medial contact force [N]."""
    phi, rate, bend = (ca.MX.sym(name, 3) for name in ("phi", "rate", "acceleration"))
    a, knee = ca.MX.sym("a", len(MUSCLES)), ca.MX.sym("knee", 3)
    pose = _poses(phi, knee)
    loads = model.function(compiled=True)(pose)
    wrench = ca.mtimes(ca.sparsify(ca.DM(total_selection(model.load_names, model.patch_names))), loads)
    motion, across, _, within = mechanics.residuals(phi, rate, bend, a, pose, wrench)
    left = ca.vertcat(motion / _MOMENT_NM, across[:2] / _FORCE_N, across[2] / _MOMENT_NM)
    medial = -loads[model.load_names.index("Fy_med")]
    return ca.Function("moment", [phi, rate, bend, a, knee], [left, within / _MOMENT_NM, medial])
