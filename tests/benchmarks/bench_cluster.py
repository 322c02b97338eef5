"""Samples drawn by one and by two worker processes of a Dask scheduler, and what a task costs the scheduler's side; run
on demand:

python -m pytest -s tests/benchmarks/bench_cluster.py

The wall clock is that of a machine which others may use; the CPU seconds of the workers, and of scheduler and client
together, say what more workers cost, whoever else is working.
"""

import os
import pickle
import time
from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.workers import cluster_workers
from casadi_contact.samples.chunk import plan_chunks
from casadi_contact.samples.draw import draw_samples
from casadi_contact.samples.reference import reference_motion
from casadi_contact.samples.settings import PAPER_COUNTS, SamplingSettings
from casadi_contact.workflow.presets import PRESETS
from casadi_contact.workflow.project import reference_motion_cycles

distributed = pytest.importorskip("distributed", reason="extra cluster is not installed")

SCENE = "knee"
CHUNK = 100  # samples of a task here; a preset's has 500
PLAN, FIRST_PLAN = {**dict.fromkeys(PAPER_COUNTS, 0), "D1": 3000}, {"D1": 400}
ROUNDS = 2


@pytest.fixture(scope="module")
def plan():
    scene = cc.load_scene(SCENE)
    settings = SamplingSettings.from_scene(scene, counts=PLAN, frames=21, chunk_size=CHUNK)
    cycles = reference_motion_cycles(scene, ())
    motion, _ = reference_motion(cc.ElasticFoundation(scene, scene.grids["coarse"]), cycles, settings)
    return scene, motion, settings


def cpu_of_workers(client):
    return sum(client.run(time.process_time).values())


def drawn_by(workers, plan, path):
    """Wall seconds, CPU seconds of the workers and CPU seconds of scheduler and client, of one drawing."""
    scene, motion, settings = plan
    with distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        with cluster_workers(address) as executor, distributed.Client(address, set_as_default=False) as client:
            first = replace(settings, counts=FIRST_PLAN, seed=1)  # makes the workers' models
            draw_samples(scene, motion, path.with_suffix(".first.h5"), settings=first, executor=executor)
            begun = time.perf_counter(), cpu_of_workers(client), time.process_time()
            samples = draw_samples(scene, motion, path, settings=settings, executor=executor)
            ended = time.perf_counter(), cpu_of_workers(client), time.process_time()
    return samples, np.subtract(ended, begun)


def bench_two_workers_against_one(plan, tmp_path):
    wall, of_workers, beside, chunks = {1: [], 2: []}, {1: [], 2: []}, [], len(plan_chunks(*plan))
    for turn in range(ROUNDS):
        for workers in (1, 2):
            samples, seconds = drawn_by(workers, plan, tmp_path / f"{turn}-{workers}.h5")
            wall[workers].append(seconds[0])
            of_workers[workers].append(seconds[1])
            beside.append(seconds[2] / chunks)
            assert len(samples) > 0.8 * CHUNK * (chunks - 1)
    load = os.getloadavg()[0]
    gain, cost = min(wall[1]) / min(wall[2]), min(of_workers[2]) / min(of_workers[1])
    task = 500 / CHUNK * min(of_workers[1]) / chunks
    print(f"\n{chunks} chunks of {CHUNK} samples of {SCENE}, {os.cpu_count()} cores, load {load:.1f}")
    for workers in wall:
        print(f"{workers} workers: {min(wall[workers]):.2f} s, {min(of_workers[workers]):.2f} CPU s in the workers")
    print(f"two workers are {gain:.2f} times as fast as one and need {cost:.2f} times its CPU seconds")
    print(
        f"a preset's chunk of 500 samples takes {task:.2f} CPU s in a worker; scheduler and client {min(beside):.3f} s"
    )
    print(f"on paper: they feed {task / min(beside):.0f} workers")
    assert (tmp_path / "0-1.h5").read_bytes() == (tmp_path / "0-2.h5").read_bytes()


def bench_what_workers_are_sent(plan):
    """Counted, not run: tasks of the preset `paper`, and the bytes that one moves."""
    scene, motion, _ = plan
    settings = SamplingSettings.from_scene(scene, scale=PRESETS["paper"].sampling_scale)
    chunks = plan_chunks(scene, motion, settings)
    sent = np.mean([len(pickle.dumps(chunk)) for chunk in chunks])
    print(f"\npreset paper: {len(chunks)} chunks, {sent / 1e3:.0f} kB sent with each")
