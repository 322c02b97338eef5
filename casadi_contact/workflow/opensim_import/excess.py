"""What wrapping adds to the length of each path, fitted to lengths that the opensim wheel gives at sampled coordinates.

Coordinates are drawn about `centres`, states that the joint takes: half of the samples near them, half far from them.
Where a path wraps, the points at both ends of that stretch, seen from the body that carries the surface, determine the
excess; those that move against it are the network's inputs, three where one end does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.stats import qmc

from casadi_contact.core.conventions import Array, Update
from casadi_contact.networks.network import Network, Regression
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.optimisation.assembly.jointed import JointedAssembly
from casadi_contact.workflow.opensim_import.process import measure


@dataclass(frozen=True)
class Sampling:
    """How coordinates are drawn and networks grow. Reaches are to each side of a centre: near and far."""

    count: int = 3000
    turn_rad: tuple[float, float] = (0.12, 0.35)
    shift_mm: tuple[float, float] = (4.0, 15.0)
    widest_rad: float = 1.75  # that the first turn of a joint goes from its rest, within its range
    far_weight: float = 0.3
    outliers: float = 0.005  # share of samples that may be left out, where the wheel's path leaps to another side
    tolerance_mm: float = 0.03
    sizes: tuple[tuple[int, ...], ...] = ((6,), (10,), (16,), (24,), (32,))
    most_cpu_s: float = 4.0  # of one path


def draw(
    assembly: JointedAssembly, centres: Array, given: Sequence[str], settings: Sampling
) -> tuple[Array, np.ndarray]:
    """Coordinates (n, c) [m, rad], and which are near (n,). centres (k, c) hold values of the coordinates `given`; all
    others are drawn over their ranges: the first of a joint widely, the rest as far as a sample may be from its
    centre."""
    n, names = settings.count, assembly.coordinates
    unit = qmc.Sobol(len(names) + 1, seed=0).random(1 << (n - 1).bit_length())[:n]
    near = np.arange(n) % 2 == 0
    values = centres[(unit[:, -1] * len(centres)).astype(int)].copy()
    firsts = {next((a.of for a in (*j.rotations, *j.translations) if a.of), "") for j in assembly.joints}
    for i, (name, c) in enumerate(assembly.coordinate_table.items()):
        reach = np.array(settings.shift_mm if c.kind == "translation" else settings.turn_rad)
        if name in given:
            values[:, i] += np.where(near, *reach) * (2.0 * unit[:, i] - 1.0) / c.scale
            continue
        most = settings.widest_rad if c.kind != "translation" and name in firsts else reach[1]
        low, high = max(c.low, c.default - most), min(c.high, c.default + most)
        values[:, i] = (low + (high - low) * unit[:, i]) / c.scale
    return values, near


@dataclass(frozen=True)
class Excess:
    """One path's network with its inputs, and how wrong it is [mm], near the centres and in all samples (RMS)."""

    body: str
    points: list[int]
    network: Network
    near_mm: float
    far_mm: float


def fit_excesses(
    assembly: JointedAssembly,
    model: str,
    wraps: Mapping[str, str],
    centres: Array,
    given: Sequence[str],
    progress: Update | None = None,
    settings: Sampling | None = None,
) -> dict[str, Excess]:
    """The excess of each path that wraps over a body's surface (wraps: body by path); paths that never touch it are
    left out. model: the file for the wheel."""
    settings = settings or Sampling()
    values, near = draw(assembly, centres, given, settings)
    found = measure(model, assembly.coordinates, values, list(wraps))
    paths = {path.name: path for path in (*assembly.ligaments, *assembly.muscles)}
    made = {}
    for k, (name, body) in enumerate(wraps.items()):
        path, stretch = paths[name], found["stretches"][:, k]
        wrapped = stretch[stretch[:, 0] >= 0]
        if not len(wrapped):
            continue
        points = list(range(int(wrapped.min()), int(wrapped.max()) + 1))
        local = ca.Function(
            "local", [assembly._q], [path.inputs(assembly._chain, body, points), path.straight(assembly._chain)]
        )
        inputs, straight = (np.asarray(each.full()).T for each in local(values.T))
        excess = 1e3 * found["lengths"][:, k] - straight[:, 0]
        moving = [i for i, p in enumerate(points) if np.ptp(inputs[:, 3 * i : 3 * i + 3], axis=0).max() > 1e-6] or [0]
        columns = [3 * i + j for i in moving for j in range(3)]
        network, residual = _fitted(name, inputs[:, columns], excess, near, settings)
        errors = (float(np.sqrt(np.mean(residual[rows] ** 2))) for rows in (near, near | True))
        made[name] = Excess(body, [points[i] for i in moving], network, *errors)
        if progress:
            progress("paths", k + 1, len(wraps), name)
    return made


def _fitted(name: str, x: Array, excess: Array, near: np.ndarray, settings: Sampling) -> tuple[Network, Array]:
    """The network, and what it leaves of the excess (n,) [mm]; outliers are dropped, of both fit and errors."""
    if np.ptp(excess) < 1e-3:
        constant = Network(x[0], np.ones(x.shape[1]), (np.zeros((1, x.shape[1])),), (np.array([excess.mean()]),))
        return constant, excess - excess.mean()
    kept = excess <= np.quantile(excess, 1.0 - settings.outliers) + 1.0
    weights = np.where(near, 1.0, settings.far_weight)
    held_out = np.arange(len(x)) % 10 >= 8
    regression = Regression(name, x[kept], excess[kept], weights[kept], held_out[kept], settings.tolerance_mm)
    network = fit(regression, TrainingSettings(sizes=settings.sizes, max_cpu_s=settings.most_cpu_s)).network
    return network, np.where(kept, network.value(x) - excess, 0.0)


def described(excess: Mapping[str, Excess], tolerance_mm: float = 0.1) -> list[str]:
    """Lines that say how well lengths are fitted, the worst by name."""
    worst = sorted(excess.items(), key=lambda item: -item[1].near_mm)
    over = [f"{name} {e.near_mm:.2g} mm" for name, e in worst if e.near_mm > tolerance_mm]
    lines = [
        f"{len(excess)} paths wrap; RMS error of length near the joint's motion {worst[0][1].near_mm:.2g} mm at most"
    ]
    return lines + ([f"less exact than {tolerance_mm:g} mm: {', '.join(over)}"] if over else [])


def plain(excess: Excess) -> dict[str, Any]:
    """The wrap of an assembly's table."""
    return {"body": excess.body, "points": excess.points}
