"""Muscle and contact with the patella between them: equilibrium, what agrees with the arms of the walk, mistakes."""

import csv
import json
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.conventions import POSE_IN_MM
from casadi_contact.optimisation.assembly.file import load_assembly
from casadi_contact.optimisation.knee import in_newtons, shear_free_poses
from casadi_contact.optimisation.muscle_walk import example_walk
from casadi_contact.optimisation.starts import pose_steps
from casadi_contact.optimisation.verification.verdict import judge, own_model
from problems import muscle_contact
from problems.muscle_contact import __main__
from problems.muscle_contact.compared import Compared
from problems.muscle_contact.extensor import quadriceps
from problems.muscle_contact.picture import draw
from problems.muscle_contact.report import report
from problems.muscle_contact.with_patella import patella_verdict
from tests.support.command import ended
from tests.support.compiler import needs_compiler

pytestmark = needs_compiler
FRAMES = 4  # of flexion from 3 degrees of hyperextension to 62


@pytest.fixture(scope="module")
def extensor(knee):
    return muscle_contact.load_extensor("knee_with_patella", knee)


@pytest.fixture(scope="module")
def solved(knee, extensor):
    problem = muscle_contact.build_with_patella(knee, example_walk(FRAMES), extensor)
    return problem, muscle_contact.solve(problem)


def tension(problem, result):
    return result.muscle_forces_n[:, quadriceps(problem.walk.muscles.names)].sum(axis=1)


def test_femur_and_patella_balance_in_one_problem_and_both_contact_models_agree(solved):
    problem, result = solved
    assert result.converged.all(), result.reason
    assert not result.overloaded.any()
    assert result.patella.left_n.max() < 0.01
    assert max(np.abs(curve).max() * in_newtons(name) for name, curve in result.unbalanced.items()) < 0.01
    assert patella_verdict(problem, result).exit_code == 0


def test_the_whole_assembly_says_the_same_of_both_bodies(solved):
    """The ready assembly with both of its contacts, evaluated at the solution: nothing is left on the patella, and the
    femur needs just what hamstrings and calf, reserves and inverse dynamics leave."""
    problem, result = solved
    model = problem.contact_model
    whole = load_assembly("knee_with_patella", lambda scene: model if scene.name == "knee" else cc.foundation(scene))
    forces, walk = whole.forces(), problem.walk
    others = np.delete(np.arange(len(walk.muscles.names)), quadriceps(walk.muscles.names))
    for k, pull in enumerate(tension(problem, result)):
        found = np.asarray(forces(np.column_stack([result.poses[k], result.patella.poses[k]]), pull))
        np.testing.assert_allclose(found[:, 1] / POSE_IN_MM, 0.0, atol=0.01)
        for name, row, unit in (("knee_ty", 1, 1.0), ("knee_adduction", 3, 1e-3), ("knee_flexion", 5, 1e-3)):
            direct = walk.arms[name][k, others] @ result.muscle_forces_n[k, others]
            left = unit * found[row, 0] + direct + result.reserves[name][k] - walk.loads[name][k]
            assert abs(left) * in_newtons(name) < 0.05


def test_the_tendon_compresses_the_knee_less_than_the_quadriceps_pull_in_flexion(solved):
    problem, result = solved
    share = result.patella.loads["patellar_tendon"] / tension(problem, result)
    straight, bent = problem.walk.rz.argmax(), problem.walk.rz.argmin()
    assert share[straight] == pytest.approx(1.0, abs=0.02)
    assert 0.5 < share[bent] < 0.8
    pressed = result.patella.loads["patellofemoral_Fx_med"] + result.patella.loads["patellofemoral_Fx_lat"]
    assert pressed[bent] / tension(problem, result)[bent] > 0.5
    assert pressed.min() > -1e-6


def test_moved_forward_the_quadriceps_have_the_arm_of_the_walk(knee, extensor):
    """Where tendon and quadriceps pull alike, an arm grows by as much as its line moves away."""
    walk = example_walk(FRAMES)
    poses = shear_free_poses(knee, walk.ry, walk.rz)
    usual = extensor.arms(poses)["knee_flexion"]
    gained = extensor.moved_forward(5.0).arms(poses)["knee_flexion"] - usual
    np.testing.assert_allclose(gained[walk.rz > -0.2], 0.005, atol=1e-4)
    fitted = muscle_contact.fitted_to_arms(extensor, knee, walk)
    own = walk.arms["knee_flexion"][:, quadriceps(walk.muscles.names)].mean()
    assert abs(usual.mean() - own) > 0.005
    assert fitted.arms(poses)["knee_flexion"].mean() == pytest.approx(own, abs=1e-4)


def test_the_hessian_of_the_coupled_problem_is_the_derivative_of_its_gradient(solved):
    """Central differences of the Lagrangian's gradient in a random direction of the pose variables, in frames whose
    facets both press: where one lifts off the second derivative jumps."""
    problem, result = solved
    facets = [result.patella.loads[f"patellofemoral_Fx_{side}"] for side in ("med", "lat")]
    pressed = np.min(facets, axis=0) > 20.0
    assert pressed.any()
    rng = np.random.default_rng(2)
    x, g = problem.nlp["x"], problem.nlp["g"]
    lagrangian = problem.nlp["f"] + ca.dot(ca.DM(rng.normal(size=g.numel())), g)
    second, first = ca.hessian(lagrangian, x)
    slopes = ca.Function("slopes", [x, problem.nlp["p"]], [first, second])
    poses = np.hstack([result.poses[:, [1, 3]], result.patella.contact_poses])
    steps = np.concatenate([pose_steps(("ty", "rx"))[[1, 3]], problem.extensor.steps])
    moved = [13, 14, 19, 20, 21, 22, 23, 24]
    at, way = np.tile(0.1, (2, FRAMES, 25))
    at[:, moved], way[:] = poses / steps, 0.0
    way[:, moved] = rng.normal(size=(FRAMES, len(moved)))
    resting = at[:, 19:].ravel()
    gradients = [np.asarray(slopes(at.ravel() + h * way.ravel(), resting)[0]) for h in (0.01, -0.01)]
    product = np.asarray(slopes(at.ravel(), resting)[1] @ way.ravel())
    found, expected = (v.reshape(FRAMES, -1)[pressed] for v in (product, (gradients[0] - gradients[1]) / 0.02))
    np.testing.assert_allclose(found, expected, atol=5e-3 * np.abs(expected).max())


def test_table_files_and_summary_tell_of_the_patella(solved, tmp_path, capsys):
    problem, result = solved
    model = problem.contact_model
    verdict = judge(model, result.poses, result.converged, own_model(model.scene))
    report(problem, result, verdict, tmp_path, patellar=patella_verdict(problem, result))
    said = capsys.readouterr().out
    assert f"patella: {FRAMES} of {FRAMES} solved and verified" in said
    assert "patellar_tendon" in said
    rows = list(csv.DictReader((tmp_path / "muscle_contact.csv").open(encoding="utf-8")))
    assert float(rows[2]["patellar_tendon_N"]) == pytest.approx(result.patella.loads["patellar_tendon"][2], rel=1e-6)
    assert float(rows[2]["patella_ty_mm"]) == pytest.approx(result.patella.poses[2, 1], rel=1e-6)
    assert "EF" in json.loads((tmp_path / "summary.json").read_text("utf-8"))["patella"]
    assert (tmp_path / "muscle_contact.png").read_bytes().startswith(b"\x89PNG")


def test_the_picture_shows_three_forces_on_the_patella_that_close_a_triangle(solved, tmp_path, monkeypatch):
    problem, result = solved
    pages = []
    monkeypatch.setattr("problems.muscle_contact.picture.save_page", lambda page, path, **_: pages.append(page))
    compared = Compared.of(problem, result, None)
    draw(problem, result, compared, tmp_path / "page.png", patella_verdict(problem, result))
    axes = {axis.get_title(): axis for axis in pages[0].axes}
    lines = axes["what holds the patella"].get_lines()
    forces = {line.get_label(): line.get_ydata() for line in lines}
    assert list(forces) == ["quadriceps", "groove contact", "patellar tendon"]
    np.testing.assert_allclose(forces["quadriceps"], tension(problem, result))
    sides = np.sort(list(forces.values()), axis=0)
    assert (sides[2] <= sides[0] + sides[1] + 0.05).all()
    facets = {line.get_label(): line.get_ydata() for line in axes["facets of the patella"].get_lines()}
    np.testing.assert_allclose(facets["Fx_lat"], result.patella.loads["patellofemoral_Fx_lat"])


def test_a_walk_or_assembly_without_its_parts_is_refused(knee, extensor):
    walk = example_walk(FRAMES)
    names = tuple(f"muscle_{k}" for k in range(len(walk.muscles.names)))
    strange = replace(walk, muscles=replace(walk.muscles, names=names))
    with pytest.raises(ValueError, match="no rectus femoris or vastus pulls the patella"):
        muscle_contact.build_with_patella(knee, strange, extensor)
    loads, arms = ({n: c for n, c in curves.items() if n != "knee_flexion"} for curves in (walk.loads, walk.arms))
    stiff = replace(walk, loads=loads, arms=arms)
    with pytest.raises(ValueError, match=r"arms of knee_flexion; it has .*: give knee_flexion_Nm in inverse dynamics"):
        muscle_contact.fitted_to_arms(extensor, knee, stiff)
    with pytest.raises(ValueError, match=r"arms of knee_flexion; it has .* and arm_knee_flexion of the muscles"):
        muscle_contact.build_with_patella(knee, stiff, extensor)
    with pytest.raises(ValueError, match="expected scene"):
        muscle_contact.load_extensor("knee_with_patella", cc.foundation("knee_reach"))
    with pytest.raises(ValueError, match=r"patella finds no equilibrium at .* expected a groove that reaches so far"):
        muscle_contact.Extensor(replace(extensor.assembly, ligaments=[])).settled(np.zeros((1, 6)), np.ones(1))


def test_a_contact_model_of_another_material_does_not_stand_for_a_scene_of_its_name(knee):
    thin = cc.foundation(cc.load_scene("knee", thickness=4.0))
    assert thin.scene.name == knee.scene.name
    with pytest.raises(ValueError, match="expected scene knee of the same bodies, material and loads"):
        muscle_contact.load_extensor("knee_with_patella", thin)


def test_an_unknown_assembly_is_one_line(tmp_path, monkeypatch):
    said = ended(monkeypatch, __main__.main, "--patella", "elbow", "--out", tmp_path)
    assert "unknown assembly 'elbow', expected one of knee_with_patella" in said
    assert "\n" not in said
