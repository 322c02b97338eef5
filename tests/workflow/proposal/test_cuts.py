"""Cuts of a patch into parts: the best there are, few, and between places that touch apart from each other."""

import itertools
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import casadi_contact as cc
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, Samples
from casadi_contact.workflow.proposal.cuts import CutSettings, best_cuts, cut_scene, find_cuts, worthwhile
from casadi_contact.workflow.proposal.tables import scene_text
from tests.support.meshes import cap_mesh, scene_of, sheet_mesh

RADIUS_MM, APART_MM = 12.0, 7.0


@given(st.integers(1, 6), st.integers(0, 1000))
@settings(max_examples=60, deadline=None)
def test_for_every_number_of_parts_no_other_cuts_are_better(strips, seed):
    misfit = np.random.default_rng(seed).exponential(size=(strips + 1, strips + 1))
    found = best_cuts(misfit)
    assert len(found) == strips
    for parts, (error, cuts) in enumerate(found, start=1):
        sums = [
            sum(misfit[i, j] for i, j in itertools.pairwise((0, *inner, strips)))
            for inner in itertools.combinations(range(1, strips), parts - 1)
        ]
        assert len(cuts) == parts - 1
        assert error == pytest.approx(math.sqrt(min(sums)))
        assert error == pytest.approx(
            math.sqrt(sum(misfit[i, j] for i, j in itertools.pairwise((0, *cuts, strips)))), rel=1e-12
        )


@pytest.mark.parametrize(
    ("errors", "enough", "worth", "cuts"),
    [
        ((100.0, 50.0, 46.0), 5.0, 0.1, 1),
        ((100.0, 91.0), 5.0, 0.1, 0),
        ((100.0, 50.0, 40.0), 5.0, 0.1, 2),
        ((100.0, 50.0, 40.0), 60.0, 0.1, 1),
        ((100.0, 50.0, 46.0), 5.0, 0.05, 2),
    ],
)
def test_a_part_more_must_take_its_share_of_the_error_off(errors, enough, worth, cuts):
    by_count = [(error, tuple(range(k))) for k, error in enumerate(errors)]
    assert worthwhile(by_count, enough, worth) == (tuple(range(cuts)), errors[cuts])


@pytest.fixture(scope="module")
def balls(tmp_path_factory):
    """Two balls side by side, one body, on a plate that is a single patch."""
    vertices, faces = cap_mesh(RADIUS_MM, 1.0, 0.5)
    side = np.array([0.0, 0.0, APART_MM])
    moving = np.concatenate([vertices - side, vertices + side]), np.concatenate([faces, faces + len(vertices)])
    return scene_of(tmp_path_factory.mktemp("balls"), moving, sheet_mesh(30.0, 1.0), grid=(60, 60))


def samples_of(scene, count=600):
    """One ball pressed, or both, or none."""
    rng = np.random.default_rng(0)
    poses = np.zeros((count, 6))
    poses[:, 0], poses[:, 2] = rng.uniform(-1.0, 1.0, (2, count))
    poses[:, 1], poses[:, 3] = RADIUS_MM + rng.uniform(-0.3, 0.5, count), rng.uniform(-0.12, 0.12, count)
    model = cc.ElasticFoundation(scene)
    role = rng.choice([TRAIN, VALIDATION, TEST], count, p=[0.7, 0.2, 0.1]).astype(np.uint8)
    domain = np.ones(count, dtype=np.uint8)
    return Samples(scene, poses, model.wrenches(poses), model.gaps(poses), domain, role)


def test_two_contact_areas_become_two_parts(balls, tmp_path):
    quick = CutSettings(strips=4, hidden=(3,), gflop=0.05)
    with ThreadPoolExecutor(1) as here:
        (cuts,) = find_cuts(balls, samples_of(balls), executor=here, settings=quick)
    assert cuts.cuts_mm == (0.0,)
    assert cuts.parts_n < 0.1 * cuts.whole_n
    parted = cut_scene(balls, [cuts.cuts_mm], [cuts.bounds_mm])
    path = tmp_path / "parts.toml"
    path.write_text(scene_text(parted, [str(cuts)], tmp_path))
    again = cc.load_scene(path)
    assert again.digest == parted.digest
    poses = samples_of(balls, 40).poses
    of_whole, of_parts = (cc.ElasticFoundation(scene) for scene in (balls, again))
    whole, parts = of_whole.wrenches(poses), of_parts.part_wrenches(poses)
    np.testing.assert_allclose(parts.sum(axis=1), whole[:, 0], rtol=1e-10, atol=1e-8)


def test_only_a_mesh_with_whole_patches_is_cut(balls):
    samples = samples_of(balls, 30)
    with pytest.raises(ValueError, match="split_z"):
        find_cuts(cut_scene(balls, [(0.0,)], [(-15.0, 15.0)]), samples)
    with pytest.raises(ValueError, match="mesh"):
        find_cuts(cc.load_scene("knee"), samples)
    with pytest.raises(ValueError, match="worth"):
        CutSettings(worth=1.5)
