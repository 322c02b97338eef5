"""COMAK's question in one problem: which muscles pull how hard in a measured motion, and how do the bones lie?

    min Σ w·V·a² + 1000·Σ r² + w_E·E   so that   forces(x_k, (x_k - x_{k-1})/Δt, F0·a_k) + r_k = 0,   0.01 ≤ a ≤ 1

over all frames k at once, by IPOPT with exact derivatives. Unknown are activations a, secondary coordinates x of an
imported model (`casadi-contact import`) and small reserves r. Given are the measured motion, filtered, with its rates
and accelerations, and the ground's loads. The forces are those on primary and secondary coordinates; the latter do not
accelerate. V are muscles' volumes [cm³] at 0.35 MPa, E is the energy [J] of contacts, w and w_E are weights. COMAK
(Smith et al. 2018) solves one frame after the other, linearised about the last: its settings file is read as it is, its
results are compared with where they are given.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from scipy import sparse

import casadi_contact as cc
from casadi_contact.core.conventions import Array
from casadi_contact.core.terminal import run_program
from casadi_contact.optimisation.assembly.assembly import Assembly
from casadi_contact.optimisation.assembly.balance import FrameBalance
from casadi_contact.optimisation.assembly.file import ray_casting
from casadi_contact.optimisation.ipopt import IpoptOutcome, settled_options
from casadi_contact.pictures.page import FOUNDATION, SURROGATE, TARGET, frame, new_page, save_page
from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.opensim import TIME, Table, read_opensim_table, write_table
from casadi_contact.workflow.opensim_import.importing import states_of
from casadi_contact.workflow.project import trained_in
from problems.measured_motion import Motion, Settings, read_motion, write_values
from problems.summary import write_summary

LEAST, MOST = 0.01, 1.0  # activations
STRESS_MPA = 0.35  # of muscles, as COMAK has it
RESERVE_WEIGHT, MOST_RESERVE = 1000.0, 50.0  # per N² or (N·m)², as COMAK's default; N or N·m
FARTHEST_MM = 25.0  # from the start, rotations at 25 mm
REST = 0.02  # activation while secondary coordinates settle


@dataclass(frozen=True)
class Solution:
    """Activations (n, m), secondary coordinates (n, f) [m, rad], reserves (n, b) [N, N·m]; how IPOPT ended at worst."""

    activations: Array
    secondary: Array
    reserves: Array
    outcome: IpoptOutcome


class Walk:
    """The problem of a motion's frames, one given the last, or all at once. before: secondary coordinates (f) before
    the first frame; if left out at rest in it, without loads, muscles at `REST`, reached from the model's default."""

    def __init__(self, assembly: Assembly, motion: Motion, settings: Settings, before: Array | None = None) -> None:
        self.assembly, self.motion, self.settings = assembly, motion, settings
        self.balanced = (*settings.primary, *settings.secondary)
        self.balance = FrameBalance(assembly, self.balanced, settings.secondary, motion.bodies)
        self.free, self.step_s = self.balance.free, float(np.diff(motion.time_s).mean())
        self.strength = np.array([muscle.max_force_n for muscle in assembly.muscles])
        volume = 1e-3 * self.strength * [muscle.optimal_fibre_mm for muscle in assembly.muscles] / STRESS_MPA  # cm³
        if unknown := sorted(set(settings.weights) - set(assembly.muscle_names)):
            print(f"weights of {', '.join(unknown)} are passed over: the model has no such muscles")
        self.weights = volume * [settings.weights.get(name, 1.0) for name in assembly.muscle_names]
        self.before = self._rest() if before is None else before
        self.in_mm = np.array([assembly.coordinate_table[name].in_mm for name in self.balanced])

    def cost(self, activations: Array) -> Array:
        """Σ w·V·a² [cm³] of each frame."""
        found: Array = np.square(activations) @ self.weights
        return found

    def _rest(self) -> Array:
        rest, x = self.assembly.default, self.assembly.default[self.free]
        nothing = [np.zeros(len(rest)), np.zeros(len(rest)), np.zeros((6, len(self.motion.bodies)))]
        for share in np.linspace(0.0, 1.0, 9):
            q = (1.0 - share) * rest + share * self.motion.q[0]
            x, _ = self.balance.settle(x, REST * self.strength, [q, *nothing])
        return x

    def solver(self, n: int, **options: Any) -> Callable[[int, Array, Array, Array], Solution]:
        """IPOPT for n frames in a row -> function of the first frame's number, activations (n, m) and secondary
        coordinates (n, f) to start from, and those of the frame before (f)."""
        p, m, f, b = len(self.settings.primary), len(self.strength), len(self.free), len(self.balanced)
        size, scale = m + f + b, self.in_mm[p:]
        own, rates = np.zeros((m + 2 * f, size)), np.zeros((m + 2 * f, size))
        own[:m, :m], own[m : m + f, m : m + f] = np.diag(self.strength), np.diag(1.0 / scale)
        rates[m + f :, m : m + f] = np.diag(1.0 / scale) / self.step_s
        steps = sparse.kron(sparse.eye(n), own) + sparse.kron(sparse.eye(n) - sparse.eye(n, k=-1), rates)
        D = ca.DM(sparse.csc_matrix(steps))
        shapes = [(f, n), (f, 1), *(each.shape for each in self.motion.inputs(slice(0, n)))]
        ends = np.cumsum([0, *(rows * columns for rows, columns in shapes)]).tolist()
        X, P = ca.MX.sym("X", n * size), ca.MX.sym("P", ends[-1])
        lam, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", n * b)
        given = [ca.reshape(part, *shape) for part, shape in zip(ca.vertsplit(P, ends), shapes, strict=True)]
        x, before, *motion = given
        v = (x - ca.horzcat(before, x)[:, :n]) / self.step_s
        Z = ca.vertcat(ca.MX(m, n), x, v) + ca.reshape(ca.mtimes(D, X), m + 2 * f, n)
        inputs = ca.vertsplit(Z, [0, m, m + f, m + 2 * f])

        rows = ca.DM(np.tile(10.0 / self.in_mm, n))  # forces count in 100 N, moments in 100 N at 25 mm
        square = np.tile(np.concatenate([self.weights, np.zeros(f), np.full(b, RESERVE_WEIGHT)]), n)
        of_reserves = ca.DM(sparse.csc_matrix(sparse.kron(sparse.eye(n), np.hstack([np.zeros((b, m + f)), np.eye(b)]))))
        forces = ca.vec(self.balance.forces.map(n)(*inputs, *motion)) + ca.mtimes(of_reserves, X)
        J = ca.diagcat(*ca.horzsplit(self.balance.jacobian.map(n)(*inputs, *motion), m + 2 * f))
        J = ca.mtimes(ca.diag(rows), ca.mtimes(J, D) + of_reserves)
        multipliers = ca.reshape(lam_g * rows, b, n)
        H = ca.diagcat(*ca.horzsplit(self.balance.hessian.map(n)(*inputs, multipliers, *motion), m + 2 * f))
        lam_f = lam / self.weights.max()  # costs count in units of the largest weight
        H = ca.mtimes(D.T, ca.mtimes(H, D)) + lam_f * ca.diag(ca.DM(2.0 * square))
        cost = ca.dot(ca.DM(square), X**2)
        if weight := self.settings.energy_weight:
            energy, bent = (call.map(n)(inputs[1], motion[0]) for call in self.balance.energy)
            blocks = [ca.diagcat(ca.MX(m, m), each, ca.MX(f, f)) for each in ca.horzsplit(bent, f)]
            cost += weight * ca.sum2(energy)
            H += weight * lam_f * ca.mtimes(D.T, ca.mtimes(ca.diagcat(*blocks), D))
        nlp: dict[str, Any] = {"x": X, "p": P, "f": cost / self.weights.max(), "g": rows * forces}
        derivatives: dict[str, Any] = {
            "jac_g": ca.Function("jac_g", [X, P], [nlp["g"], J]),
            "hess_lag": ca.Function("hess_lag", [X, P, lam, lam_g], [ca.triu(H)]),
        }
        settings = settled_options(tolerance=1e-6, acceptable_tol=1e-4, acceptable_iter=5, **options)
        solver = ca.nlpsol("comak", "ipopt", nlp, {**derivatives, **settings})
        low = np.concatenate([np.full(m, LEAST), np.full(f, -FARTHEST_MM), np.full(b, -MOST_RESERVE)])
        high = np.concatenate([np.full(m, MOST), np.full(f, FARTHEST_MM), np.full(b, MOST_RESERVE)])

        def solve(first: int, a: Array, x: Array, before: Array) -> Solution:
            motion = self.motion.inputs(slice(first, first + n))
            parameters = np.concatenate([each.ravel(order="F") for each in (x.T, before, *motion)])
            guess = np.column_stack([a, np.zeros((n, f + b))]).ravel()
            found = solver(x0=guess, p=parameters, lbx=np.tile(low, n), ubx=np.tile(high, n), lbg=0.0, ubg=0.0)
            values = np.asarray(found["x"]).reshape(n, size)
            moved = x + values[:, m : m + f] / scale
            return Solution(values[:, :m], moved, values[:, m + f :], IpoptOutcome.of(solver))

        return solve

    def frame_by_frame(self) -> Solution:
        """COMAK's own question: the least cost of each frame, given the frame before; at first that at rest."""
        x, a, solve = self.before, np.full(len(self.strength), REST), self.solver(1, mu_init=1e-3)
        found = []
        for k in range(len(self.motion.time_s)):
            found.append(solve(k, a[None], x[None], x))
            a, x = found[-1].activations[0], found[-1].secondary[0]
        worst = max((one.outcome for one in found), key=lambda outcome: (not outcome.solved, outcome.iterations))
        a, x, r = (np.vstack([getattr(one, key) for one in found]) for key in ("activations", "secondary", "reserves"))
        return Solution(a, x, r, worst)

    def all_frames(self, start: Solution) -> Solution:
        """The least cost of all frames together, from that of each by itself."""
        solve = self.solver(len(self.motion.time_s), mu_init=1e-4)
        return solve(0, start.activations, start.secondary, self.before)


def replay(walk: Walk, assembly: Assembly, x: Array, force_n: Array) -> tuple[Array, Array]:
    """Forces (n, b) [N, N·m] left on the balanced coordinates, and those of contacts (n, contacts) [N], by the
    assembly's own function, from secondary coordinates (n, f) and muscles' forces (n, m)."""
    q, u, udot, loads = (each.copy() for each in walk.motion.inputs())
    q[walk.free], udot[walk.free] = x.T, 0.0
    u[walk.free] = np.diff(np.vstack([walk.before, x]), axis=0).T / walk.step_s
    function = assembly.function(
        ["forces", "contact_wrenches"], coordinates=walk.balanced, loaded=walk.motion.bodies, by_force=True
    )
    forces, wrenches = (np.asarray(part) for part in function.map(len(x))(q, u, udot, force_n.T, loads))
    return forces.T, np.linalg.norm(wrenches.reshape(6, len(x), -1)[:3], axis=0)


def read_result(walk: Walk, folder: Path) -> tuple[Array, Array]:
    """Secondary coordinates (n, f) and muscles' forces (n, m) of COMAK's values.sto and force.sto."""
    values, force = (read_opensim_table(next(folder.glob(f"*{name}.sto"))) for name in ("values", "force"))
    at = np.abs(values.columns[TIME] - walk.motion.time_s[:, None]).argmin(axis=1)
    forces = np.column_stack([force.column(f"/forceset/{name}") for name in walk.assembly.muscle_names])
    return states_of(walk.assembly, values)[at][:, walk.free], forces[at]


def measured(walk: Walk, found: Solution) -> dict[str, Any]:
    """Cost, energy, and what is left of the balance, of a solution; CPU time of a frame's derivatives."""
    balance, motion, ours, x = walk.balance, walk.motion.inputs(), found.activations * walk.strength, found.secondary
    left, n = replay(walk, walk.assembly, x, ours)[0], len(x)
    at = [ours.T, x.T, np.diff(np.vstack([walk.before, x]), axis=0).T / walk.step_s]
    spent = {}
    for call, more in ((balance.forces, []), (balance.jacobian, []), (balance.hessian, [np.ones_like(left.T)])):
        mapped, begun = call.map(n), time.process_time()
        mapped(*at, *more, *motion)
        spent[call.name_out(0)] = 1e3 * (time.process_time() - begun) / n
    turns = walk.in_mm < 1000.0
    return {
        "outcome": str(found.outcome),
        "CPU time of a frame [ms]": spent,
        "cost": float(walk.cost(found.activations).sum()),
        "contact energy, mean [J]": float(np.asarray(balance.energy[0].map(n)(at[1], motion[0])).mean()),
        "left [N·m, N]": [float(np.abs(left[:, which]).max()) for which in (turns, ~turns)],
        "largest reserve": float(np.abs(found.reserves).max()),
    }


def differences(walk: Walk, found: Solution, name: str, other: tuple[Array, Array], rays: Assembly) -> dict[str, Any]:
    """From secondary coordinates (n, f) and muscles' forces (n, m) of another solution: RMS of forces, mean and largest
    [N], of coordinates [mm, turns at 25 mm], and of contact forces by rays, RMS and largest over the peak."""
    ours, in_mm = (found.secondary, found.activations * walk.strength), walk.in_mm[len(walk.settings.primary) :]
    x, muscles = (np.sqrt(np.mean((here - there) ** 2, axis=0)) for here, there in zip(ours, other, strict=True))
    here, there = (replay(walk, rays, *each)[1] for each in (ours, other))
    share = np.abs(here - there) / there.max(axis=0)
    return {
        f"cost of {name}": float(walk.cost(other[1] / walk.strength).sum()),
        f"muscles from {name}": [float(muscles.mean()), float(muscles.max())],
        f"secondary from {name}": dict(zip(walk.settings.secondary, (x * in_mm).tolist(), strict=True)),
        f"contact by rays from {name}": {
            contact: [float(np.sqrt(np.mean(part**2))), float(part.max())]
            for contact, part in zip(rays.contact_names, share.T, strict=True)
        },
    }


def main(
    model: Path,
    settings: Path,
    coordinates: Path,
    loads: Path | None = None,
    against: Path | None = None,
    networks: Path | None = None,
    whole: bool = True,
    out: Path = Path("results/comak"),
) -> None:
    """Find muscle and contact forces of a measured motion with an imported model.

    model: the folder that `casadi-contact import` wrote; settings: of COMAK, .xml; coordinates: measured, .mot or .sto;
    loads: ExternalLoads, .xml; against: a folder with COMAK's values.sto and force.sto, to compare with; networks: a
    folder that `casadi-contact build` wrote, to solve with as well, from the same start. no-whole: each frame given the
    last, as COMAK has it. Exit status 3: not solved.
    """
    assembly, told, begun = cc.load_assembly(model), Settings.read(settings), time.process_time()
    walk = Walk(assembly, read_motion(assembly, told, coordinates, loads), told)
    start, walks = walk.frame_by_frame(), {"cells": walk}
    rays = cc.load_assembly(model, contact=ray_casting) if against or networks else assembly
    if networks:
        learned = cc.load_assembly(model, contact=trained_in(networks))
        walks["networks"] = Walk(learned, walk.motion, told, walk.before)
    summary: dict[str, Any] = {"frames": len(start.reserves), "CPU time of the start [s]": time.process_time() - begun}
    others = {"COMAK": read_result(walk, against)} if against else {}
    curves = {name: named(rays, replay(walk, rays, *other)[1], other[1]) for name, other in others.items()}
    solved = True
    for name, each in walks.items():
        begun = time.process_time()
        found = each.all_frames(start) if whole else start if each is walk else each.frame_by_frame()
        told_of = {"CPU time [s]": time.process_time() - begun} | measured(each, found)
        for key, other in others.items():
            told_of |= differences(walk, found, key, other, rays)
        summary |= {f"{name}: {key}": value for key, value in told_of.items()}
        others[name] = found.secondary, found.activations * walk.strength
        curves[name] = named(assembly, replay(each, each.assembly, *others[name])[1], others[name][1])
        write(out if each is walk else out / name, each, found, curves[name])
        solved &= found.outcome.solved
    for key, value in summary.items():
        print(f"{key}: {value}")
    write_summary(out / "summary.json", summary)
    strongest = sorted(assembly.muscle_names, key=lambda muscle: -curves["cells"][muscle].max())[:6]
    draw(out / "comak.png", walk.motion.time_s, curves, [*assembly.contact_names, *strongest], 2, "force [N]")
    print(f"results in {out}")
    raise SystemExit(0 if solved else 3)


def named(assembly: Assembly, contact_n: Array, muscles_n: Array) -> dict[str, Array]:
    """Forces (n, contacts) and (n, m) by what they are of."""
    return dict(zip((*assembly.contact_names, *assembly.muscle_names), (*contact_n.T, *muscles_n.T), strict=True))


def write(out: Path, walk: Walk, found: Solution, forces: Mapping[str, Array]) -> None:
    """Coordinates, activations and muscles' forces as COMAK writes them, for OpenSim, and contact forces as CSV."""
    out.mkdir(parents=True, exist_ok=True)
    q, muscles, time_s = walk.motion.q.copy(), walk.assembly.muscle_names, walk.motion.time_s
    q[:, walk.free] = found.secondary
    write_values(out / "values.sto", walk.assembly, time_s, q)
    for name, curves in (("activation", found.activations), ("force", found.activations * walk.strength)):
        columns = {f"/forceset/{muscle}": curve for muscle, curve in zip(muscles, curves.T, strict=True)}
        write_table(Table(name, {TIME: time_s, **columns}), out / f"{name}.sto")
    contacts = {f"{name}_N": forces[name] for name in walk.assembly.contact_names}
    write_columns(out / "contact.csv", {"time_s": time_s, **contacts}, digits=9)


def draw(
    path: Path, time_s: Array, curves: Mapping[str, Mapping[str, Array]], names: list[str], rows: int, label: str = ""
) -> None:
    """Named curves (n,) over time, each by several methods."""
    page = new_page(13.0, 3.0 * rows)
    axes = page.subplots(rows, -(-len(names) // rows), squeeze=False).ravel()
    looks = {"here": SURROGATE, "cells": SURROGATE, "networks": FOUNDATION}
    for method, of in curves.items():
        for axis, name in zip(axes, names, strict=False):
            axis.plot(time_s, of[name], label=method, **looks.get(method, TARGET))
            axis.set(title=name, ylabel=label)
    axes[0].legend()
    frame(axes, "time [s]")
    save_page(page, path)


if __name__ == "__main__":
    run_program(main)
