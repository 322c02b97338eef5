"""Contact models on real meshes, timed in turn: python -m pytest tests/benchmarks/bench_mesh_foundation.py -s

Needs the meshes that `problems/scenes/tka_mesh.toml` names; no wall time is asserted.
"""

import time
from pathlib import Path
from statistics import median

import numpy as np

import casadi_contact as cc
from casadi_contact.core.machine import machine_record
from casadi_contact.workflow.benchmark.timing import one_thread, time_batch
from tests.support import meshes  # noqa: F401  (skips without the extra `mesh`)
from tests.support.shared_data import shared_file

SCENE = Path(__file__).parents[2] / "problems" / "scenes" / "tka_mesh.toml"

REPEATS = 9
COUNT = 200


def loaded_poses(model):
    """Poses (n, 6) over flexion, each side under 100 to 1500 N."""
    rng = np.random.default_rng(0)
    poses = np.zeros((COUNT, 6))
    poses[:, 1], poses[:, 5] = 44.0, rng.uniform(-1.2, 0.2, COUNT)
    forces = {name: -rng.uniform(100.0, 1500.0, COUNT) for name in ("Fy_med", "Fy_lat")}
    poses, report = cc.settle(model, poses, ("ty", "rx"), forces, tolerance=1.0)
    return poses[report.converged]


def bench_time_per_pose_of_the_elastic_foundation_and_the_ray_caster():
    shared_file("data/dm_tka/femoral_component.stl")
    scene = cc.load_scene(SCENE)
    began = time.perf_counter()
    cc.ElasticFoundation(scene, (40, 30))
    print(f"\nboth distance fields and the first elements built in {time.perf_counter() - began:.1f} s")
    models = {f"EF {nx}×{nz}": cc.ElasticFoundation(scene, (nx, nz)) for nx, nz in ((40, 30), (80, 40), (160, 80))}
    models["ray caster, flat triangles"] = cc.RayCastFoundation(scene)
    poses = loaded_poses(models["EF 80×40"])
    times: dict[str, list[float]] = {name: [] for name in models}
    with one_thread():
        for _ in range(REPEATS):
            for name, model in models.items():
                few = poses if name.startswith("EF") else poses[::10]
                times[name].append(1e6 * time_batch(model.wrenches, few))
    machine = machine_record()
    print(f"{len(poses)} poses, one thread, {machine['processor']}, numba {machine['numba']}: median (least) [µs]")
    for name, values in times.items():
        ratio = median(values) / median(times["EF 80×40"])
        print(f"{name:28s} {median(values):8.1f} ({min(values):.1f}), {ratio:.2f} times EF 80×40")
