"""A patch that touches in two places, known in closed form: two balls side by side on an elastic plane, which rocks."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact import pipeline
from casadi_contact.dataset import Samples, write_samples
from casadi_contact.dataset.errors import domain_errors
from casadi_contact.project.fitting import Fitting, fit_surrogate
from casadi_contact.project.presets import Effort
from casadi_contact.structures import PatchSurrogate, TwoStageSurrogate, with_trust
from tests.support.agreement import close
from tests.support.compiler import needs_compiler

RADIUS, APART, STIFFNESS = 30.0, 10.0, 267.5728  # mm, mm to each side, N/mm³


def two_balls(scene, rows=700, seed=0):
    """Samples of balls at x = ±10 mm: π·K/h·d²·(R - d/3) each, along y; the body rocks about z and moves along y."""
    rng = np.random.default_rng(seed)
    poses = np.zeros((rows, 6))
    poses[:, 1], poses[:, 5] = RADIUS + rng.uniform(-0.25, 0.1, rows), rng.uniform(-0.02, 0.02, rows)
    sides = APART * np.array([-1.0, 1.0])
    x, gaps = sides * np.cos(poses[:, 5:]), poses[:, 1:2] - RADIUS + sides * np.sin(poses[:, 5:])
    depths = np.maximum(-gaps, 0.0)
    forces = np.pi * STIFFNESS * depths**2 * (RADIUS - depths / 3.0)
    wrenches = np.zeros((rows, 1, 6))
    wrenches[:, 0, 1], wrenches[:, 0, 5] = -forces.sum(axis=1), -(x * forces).sum(axis=1)
    role = rng.choice(3, rows, p=(0.7, 0.15, 0.15)).astype(np.uint8)
    nearest, domain, table = gaps.min(axis=1, keepdims=True), np.ones(rows, np.uint8), {"table": "in closed form"}
    return Samples(scene, poses, wrenches, nearest, domain, role, table), depths


def of_spots(scene, spots):
    """The scene whose one patch is learned as so many spots, as a mesh scene says."""
    (part,) = scene.parts
    return replace(scene, parts=(replace(part, spots=spots),))


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    return pipeline.Project.open("sphere_on_plane", "quick", tmp_path_factory.mktemp("balls"))


def trained(project, samples, spots):
    efforts = {"root": Effort(((6, 6),), 1.0, tolerance_share=0.0), "ratios": Effort(((6, 6),), 0.3)}
    samples = replace(samples, scene=of_spots(samples.scene, spots))
    with ThreadPoolExecutor(1) as here:
        folder = project.folder / str(spots)
        return fit_surrogate(project, samples, Fitting("patch", efforts, folder, "a test"), executor=here)


@pytest.fixture(scope="module")
def learned(project):
    samples, depths = two_balls(project.scene)
    write_samples(project.samples_path, samples)
    return samples, depths, trained(project, samples, 2)


def test_two_spots_are_several_times_as_accurate_as_one(project, learned):
    samples, _, two = learned
    one = trained(project, samples, 1)
    errors = [domain_errors(surrogate, samples)["D1"]["Fy"]["rms"] for surrogate in (one, two)]
    assert errors[1] < 0.4 * errors[0], errors
    assert errors[1] < 0.005 * np.abs(samples.loads(["Fy"])).max()


def test_each_spot_bears_where_its_ball_touches_though_nobody_said_so(learned):
    samples, depths, surrogate = learned
    pressed = surrogate.networks["root_contact"].value(samples.poses) > 0.0
    alone = [(depths[:, k] > 0.02) & (depths[:, 1 - k] == 0.0) for k in (0, 1)]
    bearing = [pressed[rows].mean(axis=0) for rows in alone]
    first = int(np.argmax(bearing[0]))
    assert bearing[0][first] > 0.98
    assert bearing[0][1 - first] < 0.1
    assert bearing[1][1 - first] > 0.98
    assert bearing[1][first] < 0.1


@needs_compiler
def test_a_surrogate_of_spots_is_saved_trusted_and_compiled_like_any_other(learned, tmp_path):
    samples, _, surrogate = learned
    path = tmp_path / "balls.h5"
    with_trust(surrogate, samples).save(path)
    loaded = cc.load_surrogate(path, compiled=False)
    np.testing.assert_array_equal(loaded(samples.poses), surrogate(samples.poses))
    poses = samples.poses[:40]
    loads, roots = loaded.load_and_root_function(compiled=True)(poses.T)
    close(loads.full().T, loaded(poses), 10)
    close(roots.full().T, loaded.root_loads(poses)[0], 10)
    assert loaded.validity(poses).max() > 0.9
    arrays = cc.load_surrogate(path)
    many = np.tile(samples.poses, (4, 1))
    close(arrays.validity(many), loaded.validity(many), 8)
    close(arrays(many), loaded(many), 10)


def test_networks_that_confirm_the_reference_structure_keep_one_root(learned):
    samples = replace(learned[0], scene=of_spots(learned[0].scene, 2))
    assert {r.name: r.outputs for r in PatchSurrogate.regressions(samples)}["root_contact"] == 2
    assert {r.outputs for r in TwoStageSurrogate.regressions(samples)} == {1}


def test_as_many_outputs_as_there_are_spots_but_of_roots_alone(learned):
    surrogate = learned[2]
    networks = dict(surrogate.networks)
    networks["ratios_contact"] = networks["root_contact"]
    with pytest.raises(ValueError, match=r"'ratios_contact' has \(inputs, outputs\) \(6, 2\), expected \(6, 5\)"):
        type(surrogate)(surrogate.scene, networks)
