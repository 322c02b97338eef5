"""Contact models of the knee in one run on one thread: time per pose, errors, roughness; run on demand:

python -m tests.benchmarks.bench_foundation
"""

from __future__ import annotations

import platform
from functools import partial

import numpy as np

import casadi_contact as cc
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.machine import machine_record
from casadi_contact.workflow.benchmark.kernel_speed import jacobian_of, lagrangian_hessian
from casadi_contact.workflow.benchmark.timing import compare, one_thread, time_batch, time_single_calls

POLAR = (Rays(8, 3), Rays(12, 3), Rays(16, 3), Rays(24, 3))
GRIDS = ((40, 30), (80, 40))
REACH_DEG = (
    -10.0,
    0.0,
    30.0,
    60.0,
    90.0,
    120.0,
)  # flexion, and the tx [mm] that contact can reach there inside the rim
REACH_MM = ((-3.0, -3.3, -9.3, -10.8, -10.3, -7.5), (10.0, 10.8, 10.8, 13.8, 18.5, 22.3))
LINE_MM = np.linspace(-0.02, 0.02, 41)


def reach_poses(model: cc.PolarFoundation, count: int = 300) -> np.ndarray:
    """Settled poses over the knee's whole reach: 5 to 2,500 N a side, contact inside the rim."""
    random = np.random.default_rng(1)
    flexion = random.uniform(-10.0, 120.0, count)
    low, high = (np.interp(flexion, REACH_DEG, ends) for ends in REACH_MM)
    poses = np.zeros((count, 6))
    poses[:, 0] = low + 0.5 + (high - low - 1.0) * random.random(count)
    poses[:, 1], poses[:, 2] = 27.2, random.uniform(-2.0, 2.0, count)
    poses[:, 4], poses[:, 5] = np.deg2rad(random.uniform(-5.0, 5.0, count)), -np.deg2rad(flexion)
    forces = -np.exp(random.uniform(np.log(5.0), np.log(2500.0), (2, count)))
    poses, report = cc.settle(model, poses, ("ty", "rx"), {"Fy_med": forces[0], "Fy_lat": forces[1]})
    return np.asarray(poses[report.converged & ~model.at_edge(poses).any(axis=1)])


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


def main() -> None:
    """Print all of it."""
    scene, surrogate = cc.load_scene("knee"), cc.load_surrogate("knee")
    polar = {str(rays): cc.PolarFoundation(scene, rays) for rays in POLAR}
    poses = reach_poses(polar[str(POLAR[-1])])
    truth = cc.PolarFoundation(scene, Rays(64, 6))(poses)
    print(machine_record(), platform.processor())
    print(f"{len(poses)} poses of the whole reach; errors against {Rays(64, 6)}; EF 640×320 is off by", end=" ")
    print(np.round(np.sqrt(np.mean((cc.ElasticFoundation(scene, (640, 320))(poses) - truth) ** 2, axis=0)), 3))
    functions = {name: model.function() for name, model in polar.items()}
    functions["shipped network"] = surrogate.function(compiled=True)
    measures = {}
    for name, function in functions.items():
        weights = np.ones(function.numel_out(0))
        measures[f"{name}, value"] = partial(time_single_calls, function, poses)
        measures[f"{name}, Jacobian"] = partial(time_single_calls, jacobian_of(function), poses)
        measures[f"{name}, Hessian"] = partial(time_single_calls, lagrangian_hessian(function), poses, weights)
    ways = {"": True, ", numba's loops": False}
    grids = {
        f"EF {nx}×{nz}{way}": cc.ElasticFoundation(scene, (nx, nz), compiled=compiled)
        for nx, nz in GRIDS
        for way, compiled in ways.items()
    }
    measures |= {name: partial(time_batch, model, poses) for name, model in grids.items()}
    with one_thread():
        for name, timing in compare(measures, 31).items():
            print(f"{name:34s} {timing.median_us:7.2f} µs, at best {timing.low_us:.2f}")
    for name, model in {**polar, **grids}.items():
        errors = np.abs(model(poses) - truth)
        rough, missed = roughness(model, poses[:60])
        rms, worst = np.sqrt(np.mean(errors**2, axis=0)), errors.max(axis=0)
        print(f"{name}: RMS {np.round(rms, 3)}, largest {np.round(worst, 2)} ({', '.join(scene.load_names)})")
        print(f"  dN/dty: roughness {rough:.1e} %, against differences of N {missed:.1e} % (medians)")


if __name__ == "__main__":
    main()
