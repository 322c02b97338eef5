"""What a GPU is for, with its bars: poses of the elastic foundation a minute, and networks of the standard knee trained
in batches; run on demand, on a GPU if there is one:

python -m pytest -s tests/benchmarks/bench_gpu.py

The device is "cuda" where there is a GPU, else "cpu" (tensors of the processor), and the bars, which are those of an
H100-class card, are then printed and not held. CASADI_CONTACT_DEVICE names another device.
"""

import os
import time

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="a device needs the extra train")

import casadi_contact as cc  # noqa: E402
from casadi_contact.bridges.torch_foundation import TorchFoundation  # noqa: E402
from casadi_contact.network import Regression  # noqa: E402
from casadi_contact.project import reference_motion_cycles  # noqa: E402
from casadi_contact.project.presets import PRESETS, effort_for  # noqa: E402
from casadi_contact.sampling.reference import reference_poses  # noqa: E402
from casadi_contact.training import TrainingSettings, fit_all  # noqa: E402

HAVE_GPU = torch.cuda.is_available()
DEVICE = os.environ.get("CASADI_CONTACT_DEVICE", "cuda" if HAVE_GPU else "cpu")
POSES = 1_000_000 if HAVE_GPU else 500
POSES_A_MINUTE, TRAINING_S = 1e7, 120.0  # bars
ROWS = 80_000  # of the standard knee's regressions: 40 % of the paper's samples, both sides in one
NETWORKS = {"root": 1, "ratio": 5}  # that the standard knee fits, its sides being mirror images


def walking_poses(count):
    """Poses of the reference cycle, 0.02 mm and 0.2° off them at most."""
    scene = cc.load_scene("knee")
    cycles = reference_motion_cycles(scene, ())[:1]
    poses, _ = reference_poses(cc.ElasticFoundation(scene), cycles, frames=21)
    moves = np.random.default_rng(0).uniform(-1.0, 1.0, (count, 6)) * ([0.02] * 3 + [0.0035] * 3)
    return np.resize(poses[0], (count, 6)) + moves


def hold(got, bar, text):
    print(f"{text} on {torch.cuda.get_device_name() if HAVE_GPU else DEVICE}")
    assert not HAVE_GPU or got <= bar


def bench_foundation_poses_a_minute():
    scene, poses = cc.load_scene("knee"), walking_poses(POSES)
    for grid in (scene.grids["fine"], scene.grids["teacher"]):
        model = TorchFoundation(scene, grid, device=DEVICE)
        model.wrenches(poses[:100])
        seconds = []
        for _ in range(3):
            begun = time.perf_counter()
            model.wrenches(poses)
            seconds.append(time.perf_counter() - begun)
        rate = 60.0 * len(poses) / min(seconds)
        text = f"foundation {grid[0]}×{grid[1]}: {rate:.3g} poses a minute (bar {POSES_A_MINUTE:.3g} at 80×40)"
        hold(0.0 if grid != (80, 40) else POSES_A_MINUTE / rate, 1.0, text)


def knee_like(name, rows, seed):
    """A regression of the size of a standard knee's: 6 inputs, a smooth function, a tenth of the rows judges."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.0, 1.0, (rows, 6))
    y = np.sqrt(2.0 + np.sin(x @ rng.normal(size=6)) * np.cos(x @ rng.normal(size=6)))
    return Regression(name, x, y, np.full(rows, 1000.0), rng.random(rows) < 0.1, 0.0)


def seconds_and_gflop(regressions, sizes, iterations):
    settings = TrainingSettings(sizes=sizes, max_iterations=iterations, device="cpu:0" if DEVICE == "cpu" else DEVICE)
    begun = time.perf_counter()
    fits = fit_all(regressions, lambda r: settings)
    return np.array([time.perf_counter() - begun, sum(fit.gflop for fit in fits.values())])


def bench_training_of_the_standard_knee():
    """The time of all the work that the preset allots: some iterations are timed, and their Gflop scaled up."""
    total, rows = 0.0, ROWS if HAVE_GPU else ROWS // 4
    for kind, count in NETWORKS.items():
        effort = effort_for(PRESETS["standard"].efforts["patch"], kind)
        regressions = [knee_like(f"{kind} {k}", rows, k) for k in range(count)]
        few, many = (seconds_and_gflop(regressions, effort.sizes, n) for n in (3, 33 if HAVE_GPU else 9))
        seconds, gflop = many - few
        needed = count * effort.gflop * seconds / gflop
        total += needed
        print(f"{count} {kind} networks {effort.sizes[-1]}: {gflop / seconds:.3g} Gflop/s, all work in {needed:.3g} s")
    hold(total, TRAINING_S, f"standard knee: {total:.3g} s if all work is used up (bar {TRAINING_S:g} s)")
