"""Assemblies: the same loads as their contacts one by one, sparse exact derivatives, balance of forces, equilibrium."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import casadi_contact as cc
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.conventions import rotation
from casadi_contact.networks import frames
from casadi_contact.optimisation.assembly import Assembly, Settling
from casadi_contact.optimisation.assembly.connections import Ligament, Pull, Spring
from tests.support.compiler import needs_compiler

FREE = {"femur": ("tx", "ty", "tz", "rx", "ry"), "patella": ("tx", "ty", "tz", "rx", "ry", "rz")}
PRESSED = {"femur": [0.0, -700.0, 0.0, 0.0, 0.0, 0.0]}
QUADRICEPS_N = 400.0


@pytest.fixture(scope="module")
def knee():
    """A surrogate for one contact, a foundation for the other."""

    def contact(scene):
        return cc.load_surrogate("knee") if scene.name == "knee" else PolarFoundation(scene, Rays(24, 3))

    return cc.load_assembly("knee_with_patella", contact)


@pytest.fixture(scope="module")
def held(knee):
    """In equilibrium at 20 degrees of flexion."""
    poses = knee.start_poses()
    poses[0, 5] = -np.deg2rad(20.0)
    found = Settling(knee, FREE)(poses, PRESSED, [QUADRICEPS_N])
    assert found.converged, found
    return found.poses


def transform(pose):
    return rotation(pose[3:]), np.asarray(pose[:3])


def after(first, second):
    """The frame `second`, given in `first`, where `first` is."""
    return first[0] @ second[0], first[1] + first[0] @ second[1]


@needs_compiler
def test_one_function_gives_the_loads_of_the_contacts_one_by_one(knee, held):
    function, rng = knee.function(), np.random.default_rng(3)
    for _ in range(5):
        poses = held + rng.uniform(-1.0, 1.0, held.shape) * [0.2, 0.02, 0.1, 0.01, 0.02, 0.05]
        loads = dict(zip(knee.load_names, np.asarray(function(poses.T)).ravel(), strict=True))
        bodies = {"tibia": np.zeros(6), **dict(zip(knee.bodies, poses, strict=True))}
        for contact in knee.contacts:
            (R_f, t_f), (R_m, t_m) = (
                after(transform(bodies[body]), transform(frame))
                for body, frame in ((contact.fixed, contact.fixed_frame), (contact.moving, contact.moving_frame))
            )
            angles = Rotation.from_matrix(R_f.T @ R_m).as_euler("XYZ")
            alone = contact.model(np.concatenate([R_f.T @ (t_m - t_f), angles]))
            together = [loads[f"{contact.name}_{name}"] for name in contact.model.load_names]
            usual = [1000.0 if name.startswith("F") else 25_000.0 for name in contact.model.load_names]
            np.testing.assert_allclose(np.divide(together, usual), np.divide(alone, usual), rtol=0.0, atol=1e-12)


def test_in_a_chain_of_bodies_derivatives_know_neighbours_only():
    points = (np.ones(3), np.array([3.0, -2.0, 1.0]))
    ends = [("a", "b"), ("b", "c"), ("c", "d")]
    bands = [Ligament("".join(bodies), bodies, points, 1000.0, 1.0) for bodies in ends]
    start = {body: 10.0 * k * np.ones(6) for k, body in enumerate("abcd")}
    x = ca.MX.sym("x", 24)
    loads = Assembly("chain", "earth", start, ligaments=bands).function()(ca.reshape(x, 6, 4))
    assert ca.jacobian(loads, x).nnz() == 3 * 12
    hessian = ca.hessian(ca.sum1(loads), x)[0]
    for k in range(4):
        for j in range(4):
            block = hessian[6 * k : 6 * k + 6, 6 * j : 6 * j + 6]
            assert (block.nnz() > 0) == (abs(k - j) <= 1)


def test_a_line_does_on_both_bodies_what_its_length_says():
    """Virtual work: Q = -tension·∂length/∂q; a ligament's tension follows its toe and its straight part."""
    points = (np.array([10.0, 0.0, 3.0]), np.array([-5.0, 2.0, 0.0]))
    ligament = Ligament("band", ("upper", "lower"), points, 1000.0, 50.0)
    pull = Pull("rope", ("upper", "earth"), points)
    start = {"upper": np.zeros(6), "lower": np.zeros(6)}
    assembly = Assembly("two", "earth", start, ligaments=[ligament], pulls=[pull])
    x, lengths = ca.MX.sym("x", 12), []
    poses = {"upper": x[:6], "lower": x[6:], "earth": ca.MX.zeros(6)}
    for line in (ligament, pull):
        first, second = (
            poses[body][:3] + frames.rotation(poses[body][3:]) @ ca.DM(point)
            for body, point in zip(line.bodies, line.points_mm, strict=True)
        )
        lengths.append(ca.norm_2(first - second))
    slopes = ca.Function("slopes", [x], [ca.gradient(length, x) for length in lengths])
    at = np.array([0.0, 50.0, 4.0, 0.1, -0.2, 0.3, 1.0, -2.0, 0.0, -0.3, 0.2, 0.1])
    (tension,) = np.asarray(assembly.function()(at.reshape(2, 6).T)).ravel()
    assert tension > 0.0
    band, rope = (np.asarray(part).ravel() for part in slopes(at))
    found = np.asarray(assembly.forces()(at.reshape(2, 6).T, 30.0)).T.ravel()
    np.testing.assert_allclose(found, -tension * band - 30.0 * rope, rtol=1e-12, atol=1e-9)
    for length, expected in ((49.0, 0.0), (52.75, 1000.0 * 0.055**2 / 0.12), (53.5, 1000.0 * 0.04)):
        assert float(ca.DM(ligament.tension(ca.DM(length)))) == pytest.approx(expected)


def test_a_spring_pulls_back_to_its_rest():
    spring = Spring("soft", "body", np.array([5.0, 0.0, 2.0, 0.0, 0.0, 100.0]), np.ones(6))
    assembly = Assembly("one", "earth", {"body": np.zeros(6)}, springs=[spring])
    assert assembly.load_names == ()
    found = Settling(assembly, {"body": ("tx", "tz", "rz")})(np.zeros((1, 6)))
    np.testing.assert_allclose(found.poses, [[1.0, 0.0, 1.0, 0.0, 0.0, 1.0]], atol=1e-6)
    early = Settling(assembly, {"body": ("tx",)})(np.zeros((1, 6)), max_iterations=1)
    assert early.residual == pytest.approx(5.0 * (1.0 - early.poses[0, 0]))
    assert not early.converged


ROPE = Pull("rope", ("body", "earth"), (np.zeros(3), np.ones(3)))
ONE = Assembly("one", "earth", {"body": np.zeros(6)}, pulls=[ROPE])


@pytest.mark.parametrize(
    ("build", "word"),
    [
        (lambda: replace(ONE, pulls=[replace(ROPE, bodies=("body", "moon"))]), "moon"),
        (lambda: replace(ONE, ground="body"), "differ"),
        (lambda: replace(ONE, springs=[Spring("soft", "earth", np.ones(6), np.zeros(6))]), "free body"),
        (lambda: replace(ROPE, points_mm=(np.zeros(2), np.ones(3))), "finite"),
        (lambda: Spring("soft", "body", -np.ones(6), np.zeros(6)), "stiffness"),
        (lambda: Ligament("band", ("body", "earth"), ROPE.points_mm, 1000.0, 0.0), "slack_length_mm"),
        (lambda: Settling(ONE, {"body": ("tx",)})(np.zeros((1, 6)), tensions=[-1.0]), "pushes"),
        (lambda: Settling(ONE, {"body": ("tx", "tx")}), "once"),
        (lambda: ONE.function("my loads"), "name"),
        (lambda: cc.load_assembly("elbow"), "knee_with_patella"),
    ],
)
def test_what_does_not_fit_is_refused(build, word):
    with pytest.raises(ValueError, match=word):
        build()


def test_a_line_whose_ends_coincide_pulls_nowhere():
    start = np.array([0.0, 28.0, 0.0, 0.0, 0.0, 0.0])
    ends = ("femur", "tibia"), (np.zeros(3), start[:3])
    ligament = Ligament("slack", *ends, stiffness_n=100.0, slack_length_mm=10.0)
    assembly = Assembly("a", "tibia", {"femur": start}, [], [ligament], [Pull("tendon", *ends)])
    np.testing.assert_array_equal(assembly.forces()(start, [100.0]), 0.0)
    poses, tensions = ca.MX.sym("poses", 6), ca.MX.sym("tensions")
    slopes = ca.Function("slopes", [poses, tensions], [ca.jacobian(assembly.forces()(poses, tensions), poses)])
    assert np.isfinite(slopes(start, [0.0]).full()).all()


SOUND = """format = 1
name = "joint"
ground = "earth"
[bodies.body]
pose = [0, 0, 0, 0, 0, 0]
[ligaments.band]
bodies = ["body", "earth"]
points_mm = [[0, 0, 0], [0, 1, 0]]
stiffness_n = 1.0
slack_length_mm = 1.0
"""


@pytest.mark.parametrize(
    ("sound", "changed", "word"),
    [
        ("[ligaments.band]", '[ligaments."band;exit(1)"]', "name"),
        ("stiffness_n = 1.0", "stiffness_n = nan", "stiffness_n"),
        ("pose = [0,", "pose = [", "pose"),
        ("format = 1", "format = 2", "format"),
        ("[ligaments.band]", "[ropes.band]", "ropes"),
        (
            "[ligaments.band]",
            '[contacts.c]\nscene = "knee"\nfixed = "earth"\nmoving = "body"\nchange = 3\n[ligaments.band]',
            "change",
        ),
    ],
)
def test_a_file_that_says_something_else_is_refused_in_one_printable_line(sound, changed, word, tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(SOUND)
    assert cc.load_assembly(path).load_names == ("band",)
    path.write_text(SOUND.replace(sound, changed))
    with pytest.raises(ValueError, match=word) as refused:
        cc.load_assembly(path)
    assert str(refused.value).isprintable()
