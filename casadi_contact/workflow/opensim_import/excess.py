"""What wrapping adds to the length of each path, fitted to lengths that the opensim wheel gives at sampled coordinates.

Coordinates are drawn about `centres`, states that the joint takes: half of the samples near them, half far from them.
Where a path wraps, the points at both ends of that stretch, seen from the body that carries the surface, determine the
excess: in closed form over a cylinder, where that agrees with the wheel at least as well as a network would, else by a
network, whose inputs are those that move against the surface, three where one end does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import casadi as ca
import numpy as np
from scipy.stats import qmc

from casadi_contact.core.conventions import Array, Update, rotation
from casadi_contact.networks.network import Network, Regression
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.optimisation.assembly.assembly import Assembly
from casadi_contact.optimisation.assembly.paths import Roll, Wrap
from casadi_contact.workflow.opensim_import.process import measure


@dataclass(frozen=True)
class Sampling:
    """How coordinates are drawn and networks grow. Reaches are to each side of a centre: near and far."""

    count: int = 3000
    turn_rad: tuple[float, float] = (0.12, 0.35)
    shift_mm: tuple[float, float] = (4.0, 15.0)
    widest_rad: float = 1.2  # that the first turn of a joint goes from its rest, within its range
    far_weight: float = 0.3
    wrong_cylinder: float = 0.1  # share of samples outside of it in which a cylinder may differ
    cylinder_mm: float = 0.1  # that it may differ by in all others, before a network is tried: the wheel's own error
    leap_mm: float = 0.1  # beyond what nine tenths of the samples are off, six times, a sample is left out
    tolerance_mm: float = 0.02
    first: tuple[tuple[int, ...], ...] = ((8,),)
    sizes: tuple[tuple[int, ...], ...] = ((6,), (10,), (16,), (24,), (32,))
    most_gflop: float = 5.0  # of one path; with more, networks bend so that IPOPT takes many iterations


def draw(assembly: Assembly, centres: Array, given: Sequence[str], settings: Sampling) -> tuple[Array, np.ndarray]:
    """Coordinates (n, c) [m, rad], and which are near (n,). centres (k, c) hold values of the coordinates `given`; all
    others are drawn over their ranges: the first of a joint widely, the rest as far as a sample may be from its
    centre."""
    n, names = settings.count, assembly.coordinates
    unit = qmc.Sobol(len(names) + 1, seed=0).random(1 << (n - 1).bit_length())[:n]
    near = np.arange(n) % 2 == 0
    values = centres[(unit[:, -1] * len(centres)).astype(int)].copy()
    firsts = {name for joint in assembly.joints for name in joint.coordinates[:1]}
    for i, (name, c) in enumerate(assembly.coordinate_table.items()):
        reach = np.array(settings.shift_mm if c.kind == "translation" else settings.turn_rad)
        if name in given:
            values[:, i] += np.where(near, *reach) * (2.0 * unit[:, i] - 1.0) / c.scale
            continue
        most = settings.widest_rad if c.kind != "translation" and name in firsts else reach[1]
        low, high = max(c.low, c.default - most), min(c.high, c.default + most)
        values[:, i] = (low + (high - low) * unit[:, i]) / c.scale
    return values, near


def fit_excesses(
    assembly: Assembly,
    model: str,
    wraps: Mapping[str, Mapping[str, Any]],
    centres: Array,
    given: Sequence[str],
    progress: Update | None = None,
    settings: Sampling | None = None,
) -> dict[str, tuple[Wrap | Roll, float]]:
    """The wrap of each path that wraps over a body's surface (wraps: by path, with radius and frame of a
    cylinder); paths that never touch it are left out. With each comes its RMS error [mm] near
    the centres. model: the file for the wheel."""
    settings = settings or Sampling()
    values, near = draw(assembly, centres, given, settings)
    found = measure(model, assembly.coordinates, values, list(wraps))
    paths = {path.name: path for path in (*assembly.ligaments, *assembly.muscles)}
    made = {}
    for k, (name, over) in enumerate(wraps.items()):
        path, stretch, body = paths[name], found["stretches"][:, k], over["body"]
        wrapped = np.array([0, len(path.bodies) - 1]) if over.get("moves") else stretch[stretch[:, 0] >= 0]
        if not len(wrapped):
            continue
        points = list(range(int(wrapped.min()), int(wrapped.max()) + 1))
        parts = [path.inputs(assembly._chain, body, points), path.straight(assembly._chain)]
        inputs, straight = (each.full().T for each in ca.Function("parts", [assembly._q], parts)(values.T))
        excess = 1e3 * found["lengths"][:, k] - straight[:, 0]
        found_wraps = _rolled(over, points, inputs, excess, settings)
        if not found_wraps or np.abs(found_wraps[0][1]).max() > settings.cylinder_mm:
            found_wraps.append(_fitted(name, body, points, inputs, excess, near, settings))
        errors = [float(np.sqrt(np.mean(residual[near] ** 2))) for _, residual in found_wraps]
        made[name] = found_wraps[int(np.argmin(errors))][0], min(errors)
        if progress:
            progress("paths", k + 1, len(wraps), name)
    return made


def _rolled(
    over: Mapping[str, Any], points: list[int], x: Array, excess: Array, settings: Sampling
) -> list[tuple[Wrap | Roll, Array]]:
    """The cylinder's closed form, on the side where it agrees best with the wheel, and what it leaves (n,) [mm], but
    for points within the cylinder, where the wheel does not wrap; none for another surface."""
    if "radius_mm" not in over or len(points) != 2:
        return []
    tried, place, radius = [], over["frame"], over["radius_mm"]
    local = (x.reshape(-1, 2, 3) - place[:3]) @ rotation(np.array(place[3:]))
    outside = (np.linalg.norm(local[..., :2], axis=2) > radius).all(axis=1)
    for side in (0.0, 1.0, -1.0):
        roll = Roll(over["body"], points, place, radius, side)
        symbol = ca.SX.sym("x", 6)
        residual = ca.Function("roll", [symbol], [roll.excess(symbol)])(x.T).full()[0] - excess
        most = float(np.quantile(np.abs(residual[outside]), 1.0 - settings.wrong_cylinder))
        tried.append((most, roll, np.where(np.abs(residual) <= most, residual, 0.0)))
    return [min(tried, key=itemgetter(0))[1:]]


def _fitted(
    name: str, body: str, points: list[int], inputs: Array, excess: Array, near: np.ndarray, settings: Sampling
) -> tuple[Wrap, Array]:
    """The network of the points that move against the surface, and what it leaves (n,) [mm]. A small network first
    finds samples where the wheel's path leaps to another side, which are dropped, of both fit and errors."""
    moving = [i for i in range(len(points)) if np.ptp(inputs[:, 3 * i : 3 * i + 3], axis=0).max() > 1e-6] or [0]
    x, chosen = inputs[:, [3 * i + j for i in moving for j in range(3)]], [points[i] for i in moving]
    if np.ptp(excess) < 1e-3:
        constant = Network(x[0], np.ones(x.shape[1]), (np.zeros((1, x.shape[1])),), (np.array([excess.mean()]),))
        return Wrap(body, chosen, constant), excess - excess.mean()
    weights, held_out, kept = np.where(near, 1.0, settings.far_weight), np.arange(len(x)) % 10 >= 8, near | True
    for sizes in (settings.first, settings.sizes):
        rows = Regression(name, x[kept], excess[kept], weights[kept], held_out[kept], settings.tolerance_mm)
        network = fit(rows, TrainingSettings(sizes=sizes, max_gflop=settings.most_gflop)).network
        residual = np.abs(network.value(x) - excess)
        if sizes is settings.first:
            kept = residual <= settings.leap_mm + 6.0 * np.quantile(residual, 0.9)
    return Wrap(body, chosen, network), np.where(kept, residual, 0.0)


def described(errors_mm: Mapping[str, float], tolerance_mm: float = 0.1) -> list[str]:
    """Lines that say how well lengths are fitted, the worst by name."""
    worst = sorted(errors_mm.items(), key=lambda item: -item[1])
    over = [f"{name} {error:.2g} mm" for name, error in worst if error > tolerance_mm]
    lines = [f"{len(worst)} paths are fitted; RMS error of length near the joint's motion {worst[0][1]:.2g} mm at most"]
    return lines + ([f"less exact than {tolerance_mm:g} mm: {', '.join(over)}"] if over else [])
