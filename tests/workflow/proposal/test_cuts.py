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
from casadi_contact.workflow.proposal import cuts as cuts_module
from casadi_contact.workflow.proposal.cuts import best_cuts, cut_scene, find_cuts, worthwhile
from casadi_contact.workflow.proposal.text import cut_lines, cut_text
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


def test_a_part_more_must_take_a_tenth_of_the_error_off():
    assert worthwhile([(100.0, ()), (50.0, (4,)), (46.0, (2, 4))], 5.0) == ((4,), 50.0)
    assert worthwhile([(100.0, ()), (91.0, (4,))], 5.0) == ((), 100.0)
    assert worthwhile([(100.0, ()), (50.0, (4,)), (40.0, (2, 4))], 5.0) == ((2, 4), 40.0)
    assert worthwhile([(100.0, ()), (50.0, (4,)), (40.0, (2, 4))], 60.0) == ((4,), 50.0)
    assert worthwhile([(100.0, ()), (50.0, (4,)), (46.0, (2, 4))], 5.0, worth=0.05) == ((2, 4), 46.0)


@pytest.fixture(scope="module")
def balls(tmp_path_factory):
    """Two balls side by side, one body, on a plate that is a single patch."""
    vertices, faces = cap_mesh(RADIUS_MM, 1.0, 0.5)
    side = np.array([0.0, 0.0, APART_MM])
    moving = np.concatenate([vertices - side, vertices + side]), np.concatenate([faces, faces + len(vertices)])
    return scene_of(tmp_path_factory.mktemp("balls"), moving, sheet_mesh(30.0, 1.0), grid=(60, 60))


def samples_of(scene, count=1200):
    """One ball pressed, or both, or none."""
    rng = np.random.default_rng(0)
    poses = np.zeros((count, 6))
    poses[:, 0], poses[:, 2] = rng.uniform(-1.0, 1.0, (2, count))
    poses[:, 1], poses[:, 3] = RADIUS_MM + rng.uniform(-0.3, 0.5, count), rng.uniform(-0.12, 0.12, count)
    model = cc.CellFoundation(scene)
    role = rng.choice([TRAIN, VALIDATION, TEST], count, p=[0.7, 0.2, 0.1]).astype(np.uint8)
    domain = np.ones(count, dtype=np.uint8)
    return Samples(scene, poses, model.wrenches(poses), model.gaps(poses), domain, role)


def test_two_places_that_touch_apart_from_each_other_are_parted(balls, monkeypatch, tmp_path):
    for name, value in (("STRIPS", 6), ("_HIDDEN", (3,)), ("_GFLOP", 0.2)):
        monkeypatch.setattr(cuts_module, name, value)
    told = []
    with ThreadPoolExecutor(1) as here:  # which knows of the three
        (found,) = find_cuts(balls, samples_of(balls), lambda *said: told.append(said), here)
    assert found.cuts_mm == (0.0,)
    assert found.parts_n < 0.1 * found.whole_n
    assert told[-1] == ("parts tried", 21, 21, "")
    parted = cut_scene(balls, [found.cuts_mm], [found.bounds_mm])
    assert len(parted.parts) == len(found.cuts_mm) + 1
    path = tmp_path / "parts.toml"
    path.write_text(cut_text(parted, [found], "casadi-contact cut balls.toml", tmp_path))
    again = cc.load_scene(path)
    assert again.digest == parted.digest
    assert path.read_text().startswith("# Cut into parts by casadi-contact cut balls.toml:\n# - patch contact: ")
    poses = samples_of(balls, 40).poses
    whole, parts = cc.CellFoundation(balls).wrenches(poses), cc.CellFoundation(again).part_wrenches(poses)
    np.testing.assert_allclose(parts.sum(axis=1), whole[:, 0], rtol=0.0, atol=0.02 * np.abs(whole).max())


def test_what_is_cut_already_or_no_mesh_is_refused(balls):
    samples = samples_of(balls, 30)
    with pytest.raises(ValueError, match="split_z"):
        find_cuts(cut_scene(balls, [(0.0,)], [(-15.0, 15.0)]), samples)
    with pytest.raises(ValueError, match="has the shape knee, expected a mesh"):
        find_cuts(cc.load_scene("knee"), samples)
    with pytest.raises(ValueError, match=r"worth is 1\.5, expected a share of the error, above 0 and below 1"):
        find_cuts(balls, samples, worth=1.5)


def test_a_patch_that_stays_whole_is_told():
    said = cut_lines([cuts_module.PatchCuts("med", (0.0, 1.0), (), 3.0, 3.0)])
    assert said == ["patch med stays whole: small networks err by 3 N, little less on parts"]
