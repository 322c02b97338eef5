"""Contact models of a knee implant's meshes in one run on one thread: time per pose, errors, roughness; run on demand:

python -m tests.benchmarks.bench_cells
python -m tests.benchmarks.bench_cells --samples samples.h5

The second takes errors over samples of the domains D1, D3 and D4 (``casadi-contact sample``), and times in D1. Needs
the meshes that `problems/scenes/tka_mesh.toml` names.
"""

from __future__ import annotations

import platform
from functools import partial
from pathlib import Path
from typing import Annotated

import casadi as ca
import numpy as np
import typer

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.core.compiler import FLAGS, machine_flags
from casadi_contact.core.machine import machine_record
from casadi_contact.core.workers import one_thread
from casadi_contact.samples.samples import read_samples
from casadi_contact.workflow.benchmark.kernel_speed import jacobian_of, lagrangian_hessian
from casadi_contact.workflow.benchmark.timing import compare, time_batch, time_single_calls

LINE_MM = np.linspace(-0.02, 0.02, 41)
SCENE = Path(__file__).parents[2] / "problems" / "scenes" / "tka_mesh.toml"

SIZES = (Cells(1.17, 0.71), Cells(1.4, 0.85, 3, 3), Cells(1.9, 1.2, 3, 3))
GRIDS = ((80, 40), (40, 80), (160, 80))
REFERENCE = (320, 160)
DOMAINS, OF_DOMAIN = ("D1", "D3", "D4"), 300  # poses, spread evenly over a domain's samples
ROUNDS = 5  # over the poses of a measurement: what another model drove from the cache counts a fifth
SHIFT_MM, YAW_RAD = 3.0, 0.1  # from where the knee stands in walking, of the wide poses


def roughness(model: cc.PolarFoundation | cc.ElasticFoundation, poses: np.ndarray) -> tuple[float, float]:
    """Median RMS [%] of dN/dty about a fourth-degree polynomial over a line; median miss of N' against differences."""
    rough, missed = [], []
    step = LINE_MM[1] - LINE_MM[0]
    for pose in poses:
        line = pose + LINE_MM[:, None] * np.eye(6)[1]
        loads, slopes = model.jacobian(line)
        force, slope = loads[:, :2], slopes[:, :2, 1]
        smooth = np.polynomial.Polynomial
        fitted = np.stack([smooth.fit(LINE_MM, column, 4)(LINE_MM) for column in slope.T], 1)
        size = np.abs(slope).mean(axis=0)
        loaded = np.abs(slope).min(axis=0) > 1.0
        differences = (force[:-4] - 8.0 * force[1:-3] + 8.0 * force[3:-1] - force[4:]) / (12.0 * step)
        rough.append((np.sqrt(np.mean((slope - fitted) ** 2, axis=0)) / size)[loaded])
        missed.append((np.abs(differences - slope[2:-2]).max(axis=0) / size)[loaded])
    return tuple(100.0 * float(np.median(np.concatenate(part))) for part in (rough, missed))  # type: ignore[return-value]


def settled_poses(scene: cc.Scene, *, wide: bool, count: int = 200) -> np.ndarray:
    """Poses over -10 to 70° of flexion, each side under 100 to 1,500 N; wide: shifted and turned, 20 to 2,000 N."""
    random = np.random.default_rng(1)
    poses = np.zeros((count, 6))
    poses[:, 1], poses[:, 5] = 44.0, random.uniform(-1.2, 0.17, count)
    if wide:
        poses[:, 0], poses[:, 2] = random.uniform(-SHIFT_MM, SHIFT_MM, (2, count))
        poses[:, 4] = random.uniform(-YAW_RAD, YAW_RAD, count)
    low, high = (20.0, 2000.0) if wide else (100.0, 1500.0)
    forces = {name: -random.uniform(low, high, count) for name in ("Fy_med", "Fy_lat")}
    poses, report = cc.settle(cc.ElasticFoundation(scene, (80, 80)), poses, ("ty", "rx"), forces, tolerance=1.0)
    return np.asarray(poses[report.converged])


def main(
    samples: Annotated[Path | None, typer.Option(help="errors and times on these alone")] = None,
) -> None:
    """Print all of it."""
    scene = cc.load_scene(SCENE)
    reference = cc.ElasticFoundation(scene, REFERENCE)
    models: dict[str, cc.CellFoundation | cc.ElasticFoundation] = {str(c): cc.CellFoundation(scene, c) for c in SIZES}
    chosen = cc.foundation(scene)
    models["chosen"] = chosen
    models |= {f"EF {nx}×{nz}": cc.ElasticFoundation(scene, (nx, nz)) for nx, nz in GRIDS}
    print(machine_record(), platform.processor(), " ".join((*FLAGS, *machine_flags())))
    print(f"cc.foundation: {chosen.record}")
    if samples is not None:
        for domain in DOMAINS:
            poses = read_samples(samples).select(domain=domain).poses
            poses = poses[np.linspace(0, len(poses) - 1, min(len(poses), OF_DOMAIN)).astype(int)]
            errors(models, reference, poses, domain)
            if domain == "D1":
                times(models, poses)
        return
    for wide in (False, True):
        poses = settled_poses(scene, wide=wide)
        poses = poses[~reference.at_edge(poses).any(axis=1)]
        errors(models, reference, poses, "wide" if wide else "usual")
        for name, model in models.items():
            rough, missed = roughness(model, poses[:30])
            print(f"{name:40s} roughness of dN/dty {rough:.1e} %, against differences of N {missed:.1e} % (medians)")
        if not wide:
            times(models, poses)


def errors(
    models: dict[str, cc.CellFoundation | cc.ElasticFoundation],
    reference: cc.ElasticFoundation,
    poses: np.ndarray,
    where: str,
) -> None:
    """RMS and largest errors of every load, against the reference."""
    truth = reference(poses)
    print(f"{len(poses)} {where} poses, errors against EF {REFERENCE} ({', '.join(reference.load_names)}):")
    for name, model in models.items():
        off = np.abs(model(poses) - truth)
        rms, worst = np.sqrt(np.mean(off**2, axis=0)), off.max(axis=0)
        print(f"{name:40s} RMS {np.round(rms, 2)}, largest {np.round(worst, 1)}")


def all_three(function: ca.Function) -> ca.Function:
    """pose, λ -> loads, their Jacobian and the Hessian of λᵀ·loads: what an optimiser asks for in a pose."""
    pose, weights = ca.MX.sym("pose", 6), ca.MX.sym("weights", function.numel_out(0))
    outputs = [function(pose), jacobian_of(function)(pose), lagrangian_hessian(function)(pose, weights)]
    return ca.Function("all_three", [pose, weights], outputs)


def times(models: dict[str, cc.CellFoundation | cc.ElasticFoundation], poses: np.ndarray) -> None:
    """Value, Jacobian and Hessian of the kernels, and values of the element grids, in turn."""
    measures, poses = {}, np.tile(poses, (ROUNDS, 1))
    for name, model in models.items():
        if isinstance(model, cc.ElasticFoundation):
            measures[name] = partial(time_batch, model, poses)
            continue
        function = model.function()
        weights = np.ones(function.numel_out(0))
        measures[f"{name}, value"] = partial(time_single_calls, function, poses)
        measures[f"{name}, Jacobian"] = partial(time_single_calls, jacobian_of(function), poses)
        measures[f"{name}, Hessian"] = partial(time_single_calls, lagrangian_hessian(function), poses, weights)
        measures[f"{name}, all three in a pose"] = partial(time_single_calls, all_three(function), poses, weights)
    with one_thread():
        for name, timing in compare(measures, 15).items():
            print(f"{name:52s} {timing.median_us:8.1f} µs, at best {timing.low_us:.1f}")


if __name__ == "__main__":
    typer.run(main)
