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
from scipy import signal, sparse
from scipy.interpolate import CubicSpline

import casadi_contact as cc
from casadi_contact.core.conventions import Array
from casadi_contact.core.terminal import run_program
from casadi_contact.optimisation.assembly.assembly import Assembly, Loaded
from casadi_contact.optimisation.assembly.balance import FrameBalance
from casadi_contact.optimisation.assembly.file import ray_casting
from casadi_contact.optimisation.ipopt import IpoptOutcome, settled_options
from casadi_contact.pictures.page import FOUNDATION, SURROGATE, TARGET, frame, new_page, save_page
from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.opensim import TIME, Table, read_opensim_table, write_table
from casadi_contact.workflow.opensim_import.importing import states_of
from casadi_contact.workflow.opensim_import.model_file import opensim_root
from problems.summary import write_summary

LEAST, MOST = 0.01, 1.0  # activations
STRESS_MPA = 0.35  # of muscles, as COMAK has it
RESERVE_WEIGHT, MOST_RESERVE = 1000.0, 50.0  # per N² or (N·m)², as COMAK's default; N or N·m
FARTHEST_MM = 25.0  # from the start, rotations at 25 mm
REST = 0.02  # activation while secondary coordinates settle


@dataclass(frozen=True)
class Settings:
    """Of a COMAK settings file: times [s] (-1: the motion's), cut-off [Hz] (-1: no filter), names of coordinates and
    weights of muscles by name, and of the contacts' energy."""

    start_s: float
    stop_s: float
    step_s: float
    cutoff_hz: float
    primary: tuple[str, ...]
    secondary: tuple[str, ...]
    weights: Mapping[str, float]
    energy_weight: float = 0.0

    @classmethod
    def read(cls, path: Path) -> Settings:
        """Raises ValueError for a file without the settings that are needed."""
        root = opensim_root(path)
        texts = {element.tag: (element.text or "").strip() for tool in root for element in tool}  # not of its analyses
        try:
            start, stop, step = (float(texts[key]) for key in ("start_time", "stop_time", "time_step"))
            cutoff, energy = float(texts["lowpass_filter_frequency"]), float(texts.get("contact_energy_weight") or 0.0)
            weights = {
                names_of(each.findtext("actuator"))[0]: float(next(each.iter("value")).text or "")
                for each in root.iter()
                if each.find("actuator") is not None
            }
            primary = names_of(texts["primary_coordinates"])
        except (KeyError, ValueError, StopIteration) as error:
            raise ValueError(f"{path} lacks settings of COMAK, or has others than numbers: {error}") from None
        found = [each.findtext("coordinate") or "" for each in root.iter("COMAKSecondaryCoordinate")]
        return cls(start, stop, step, cutoff, primary, names_of(" ".join(found)), weights, energy)


def names_of(paths: str | None) -> tuple[str, ...]:
    """The last parts of OpenSim's paths, a word each."""
    return tuple(path.split("/")[-1] for path in (paths or "").split())


@dataclass(frozen=True)
class Motion:
    """Times (n,), coordinates with rates and accelerations (n, c) [m, rad], and loads (n, 6, bodies) [N, N·m], told as
    `Assembly.function` says."""

    time_s: Array
    q: Array
    u: Array
    udot: Array
    bodies: tuple[Loaded, ...] = ()
    loads: Array | None = None

    def inputs(self, rows: Any = slice(None)) -> list[Array]:
        """q, u, udot and loads of some frames, as `FrameBalance` takes them: frames side by side."""
        loads = np.zeros((len(self.time_s), 6, 0)) if self.loads is None else self.loads
        return [self.q[rows].T, self.u[rows].T, self.udot[rows].T, np.concatenate(list(loads[rows]), axis=1)]


def read_motion(assembly: Assembly, settings: Settings, coordinates: Path, loads: Path | None) -> Motion:
    """A measured motion as OpenSim's tools prepare it: resampled, padded by its reflection, filtered there and back by
    a Butterworth filter of third order, its derivatives those of cubic splines."""
    table = read_opensim_table(coordinates)
    measured, values = table.columns[TIME], states_of(assembly, table)
    step = settings.step_s if settings.step_s > 0.0 else float(np.diff(measured).mean())
    t = measured[0] + step * np.arange(int((measured[-1] - measured[0]) / step + 1e-6) + 1)
    x = np.column_stack([np.interp(t, measured, curve) for curve in values.T])
    if settings.cutoff_hz > 0.0:
        filtered = signal.butter(3, 2.0 * step * settings.cutoff_hz)
        x = signal.filtfilt(*filtered, x, axis=0, padlen=len(x) // 2)
    stop = settings.stop_s if settings.stop_s >= 0.0 else t[-1]
    kept = t[(t > settings.start_s - 0.5 * step) & (t < stop + 0.5 * step)]
    spline = CubicSpline(t, x)
    bodies, wrenches = read_loads(loads, kept) if loads else ((), None)
    return Motion(kept, spline(kept), spline(kept, 1), spline(kept, 2), bodies, wrenches)


def loads_table(path: Path) -> Table:
    """The forces over time that an OpenSim ExternalLoads file names."""
    return read_opensim_table(path.parent / (opensim_root(path).findtext(".//datafile") or "").strip())


def read_loads(path: Path, time_s: Array) -> tuple[tuple[Loaded, ...], Array]:
    """Bodies and their loads (n, 6, bodies) [N, N·m] of an OpenSim ExternalLoads file, as `Motion` has them; a force
    and its point are both told in the ground, or both in the same body."""
    table, found = loads_table(path), dict[Loaded, Array]()
    for force in opensim_root(path).iter("ExternalForce"):
        told = {key.tag: (key.text or "").strip() for key in force}
        body, of_force, of_point = (
            told.get(key, "ground").split("/")[-1]
            for key in ("applied_to_body", "force_expressed_in_body", "point_expressed_in_body")
        )
        if of_force != of_point:
            raise ValueError(
                f"{path}: {force.get('name')} is told in {of_force}, its point in {of_point}: expected one"
            )
        F, point, T = (
            np.column_stack([np.interp(time_s, table.columns[TIME], table.column(key + axis)) for axis in "xyz"])
            if (key := told.get(f"{what}_identifier"))
            else np.zeros((len(time_s), 3))
            for what in ("force", "point", "torque")
        )
        wrench = np.column_stack([F, T + np.cross(point, F)])
        of = body if of_force == "ground" else (body, of_force)
        found[of] = found.get(of, 0.0) + wrench
    return tuple(found), np.stack(list(found.values()), axis=2)


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
    networks: list[Path] | None = None,
    whole: bool = True,
    out: Path = Path("results/comak"),
) -> None:
    """Find muscle and contact forces of a measured motion with an imported model.

    model: the folder that `casadi-contact import` wrote; settings: of COMAK, .xml; coordinates: measured, .mot or .sto;
    loads: ExternalLoads, .xml; against: a folder with COMAK's values.sto and force.sto, to compare with; networks:
    surrogates of the contacts' scenes, to solve with as well, from the same start. no-whole: each frame given the last,
    as COMAK has it. Exit status 3: not solved.
    """
    assembly, told, begun = cc.load_assembly(model), Settings.read(settings), time.process_time()
    walk = Walk(assembly, read_motion(assembly, told, coordinates, loads), told)
    start, walks = walk.frame_by_frame(), {"cells": walk}
    rays = cc.load_assembly(model, contact=ray_casting) if against or networks else assembly
    if networks:
        known = {surrogate.scene.name: surrogate for surrogate in map(cc.load_surrogate, networks)}
        learned = cc.load_assembly(model, contact=lambda scene: known.get(scene.name))
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


def write_values(path: Path, assembly: Assembly, time_s: Array, q: Array) -> None:
    """Coordinates (n, c) [m, rad] as a motion for OpenSim, in degrees."""
    turns = [c.kind == "rotation" for c in assembly.coordinate_table.values()]
    values = dict(zip(assembly.coordinates, np.where(turns, np.degrees(q), q).T, strict=True))
    write_table(Table("values", {TIME: time_s, **values}, in_degrees=True), path)


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
