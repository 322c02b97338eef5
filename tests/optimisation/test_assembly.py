"""Free bodies: the same loads as their contacts one by one, sparse exact derivatives, virtual work, equilibrium."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.conventions import rotation
from casadi_contact.optimisation.assembly.assembly import CoordinateSpring
from casadi_contact.optimisation.assembly.paths import Bundle, Muscle
from casadi_contact.optimisation.assembly.settling import CoordinateSettling
from tests.support.assemblies import free_bodies
from tests.support.compiler import needs_compiler

QUADRICEPS_N = 400.0


@pytest.fixture(scope="module")
def knee():
    """A surrogate for one contact, a foundation for the other."""

    def contact(scene):
        return cc.load_surrogate("knee") if scene.name == "knee" else PolarFoundation(scene, Rays(24, 3))

    return cc.load_assembly("knee_with_patella", contact)


@pytest.fixture(scope="module")
def held(knee):
    """Coordinates in equilibrium at 20 degrees of flexion, the femur pressed by 700 N."""
    free = [name for name in knee.coordinates if name != "femur_rz"]
    q, pressed = knee.default, np.zeros(12)
    q[5], pressed[1] = -np.deg2rad(20.0), -700.0
    found = CoordinateSettling(knee, free, by_force=True)(q, [QUADRICEPS_N], pressed, tolerance=1e-6)
    assert found.converged, found
    return found.q


def transform(pose):
    return np.block([[rotation(pose[3:]), np.reshape(pose[:3], (3, 1))], [np.eye(4)[3:]]])


@needs_compiler
def test_one_function_gives_the_loads_of_the_contacts_one_by_one(knee, held):
    function, rng = knee.function(["contact_wrenches"]), np.random.default_rng(3)
    for _ in range(5):
        poses = held.reshape(2, 6) * ([1e3] * 3 + [1.0] * 3)
        poses += rng.uniform(-1.0, 1.0, poses.shape) * [0.2, 0.02, 0.1, 0.01, 0.02, 0.05]
        wrenches = np.asarray(function((poses * ([1e-3] * 3 + [1.0] * 3)).ravel(), 0.0, 0.0, 0.0)).T
        bodies = {"tibia": np.zeros(6), **dict(zip(("femur", "patella"), poses, strict=True))}
        for contact, wrench in zip(knee.contacts, wrenches, strict=True):
            ends = (contact.fixed, contact.fixed_frame), (contact.moving, contact.moving_frame)
            fixed, moving = (transform(bodies[body]) @ transform(frame) for body, frame in ends)
            X = np.linalg.inv(fixed) @ moving
            angles = Rotation.from_matrix(X[:3, :3]).as_euler("XYZ")
            alone = contact.model.wrenches([[*X[:3, 3], *angles]])[0].sum(axis=0)
            np.testing.assert_allclose(wrench, alone * ([1.0] * 3 + [1e-3] * 3), rtol=0.0, atol=1e-9)


def test_in_a_chain_of_bodies_derivatives_know_neighbours_only():
    points = [[1.0, 1.0, 1.0], [3.0, -2.0, 1.0]]
    bands = [Bundle(a + b, (a, b), points, stiffness_n=1000.0, slack_length_mm=1.0) for a, b in ("ab", "bc", "cd")]
    chain = free_bodies("earth", {body: 10.0 * k * np.ones(6) for k, body in enumerate("abcd")}, ligaments=bands)
    x = ca.MX.sym("x", 24)
    tensions = chain.function(["ligament_tensions"])(x, 0.0, 0.0, ca.DM(0, 1))
    assert ca.jacobian(tensions, x).nnz() == 3 * 12
    hessian = ca.hessian(ca.sum1(tensions), x)[0]
    for k in range(4):
        for j in range(4):
            block = hessian[6 * k : 6 * k + 6, 6 * j : 6 * j + 6]
            assert (block.nnz() > 0) == (abs(k - j) <= 1)


def test_a_path_does_on_both_bodies_what_its_length_says():
    """Virtual work: Q = -tension·∂length/∂q; a ligament's tension follows its toe and its straight part, and
    while it lengthens its damping: numbers of OpenSim's wheel."""
    points = [[10.0, 0.0, 3.0], [-5.0, 2.0, 0.0]]
    band = Bundle("band", ("upper", "lower"), points, stiffness_n=1000.0, slack_length_mm=50.0)
    rope = Muscle("rope", ("upper", "earth"), points)
    two = free_bodies("earth", {"upper": np.zeros(6), "lower": np.zeros(6)}, ligaments=[band], muscles=[rope])
    q = np.array([0.0, 0.05, 0.004, 0.1, -0.2, 0.3, 0.001, -0.002, 0.0, -0.3, 0.2, 0.1])
    lengths = two.function(["ligament_lengths", "muscle_lengths"], by_force=True)
    found, tension = two.function(["forces", "ligament_tensions"], by_force=True)(q, 0.0, 0.0, 30.0)
    assert float(tension) > 0.0
    slopes = []
    for step in 1e-6 * np.eye(12):
        ahead, behind = (np.ravel(lengths(q + s, 0.0, 0.0, 0.0)) for s in (step, -step))
        slopes.append((np.array(ahead, dtype=float) - np.array(behind, dtype=float)) / 2e-6)
    by_band, by_rope = np.array(slopes).T
    np.testing.assert_allclose(np.ravel(found), -float(tension) * by_band - 30.0 * by_rope, rtol=1e-6, atol=1e-6)
    damped = replace(band, bodies=("upper", "earth"), points_mm=np.zeros((2, 3)), damping_n_s=12.0)
    tensions = replace(two, ligaments=[damped]).function(["ligament_tensions"], by_force=True)
    along, toe = np.eye(12)[1], 1000.0 / 0.12
    for length, rate, expected in (
        *((49.0, 0.2, 0.0), (52.75, -0.2, toe * 0.055**2), (53.5, -0.2, 1000.0 * 0.04)),
        *((50.05, 0.2, 0.020544 + toe * 0.001**2), (50.25, 0.2, 1.2 + toe * 0.005**2)),
        (51.0, 0.2, 2.4 + toe * 0.02**2),
    ):
        found = float(tensions(1e-3 * length * along, 0.05 * rate * along, 0.0, 0.0))
        assert found == pytest.approx(expected, rel=1e-5), (length, rate)


def test_a_load_told_in_a_body_s_frame_is_the_same_load():
    two = free_bodies("earth", {"upper": np.zeros(6), "lower": np.zeros(6)})
    q, load = np.random.default_rng(1).normal(size=(2, 12))
    own = two.function(loaded=[("upper", "lower")])(q, 0.0, 0.0, ca.DM(0, 1), load[:6])
    X = two.places(["lower"])(q).full()
    force, torque = X[:, :3] @ load[:3], X[:, :3] @ load[3:6]
    given = np.concatenate([force, torque + np.cross(X[:, 3], force)])
    np.testing.assert_allclose(own, two.function(loaded=["upper"])(q, 0.0, 0.0, ca.DM(0, 1), given), atol=1e-9)


def test_a_spring_pulls_back_to_its_rest():
    springs = [CoordinateSpring(name, f"body_{name}", 5e3, rest, 0.0) for name, rest in (("tx", 1e-3), ("rz", 0.5))]
    one = free_bodies("earth", {"body": np.zeros(6)}, springs=springs)
    found = CoordinateSettling(one, ["body_tx", "body_rz"])(one.default)
    np.testing.assert_allclose(found.q, [1e-3, 0.0, 0.0, 0.0, 0.0, 0.5], atol=1e-8)
    early = CoordinateSettling(one, ["body_tx"])(one.default, max_iterations=1)
    assert early.residual == pytest.approx(5e3 * (1e-3 - early.q[0]))
    assert not early.converged


def test_a_path_whose_ends_coincide_pulls_nowhere():
    start = np.array([0.0, 28.0, 0.0, 0.0, 0.0, 0.0])
    tendon = Muscle("tendon", ("femur", "tibia"), [[0.0, 0.0, 0.0], start[:3]])
    one = free_bodies("tibia", {"femur": start}, muscles=[tendon])
    function, q = one.function(by_force=True), ca.MX.sym("q", 6)
    np.testing.assert_allclose(function(one.default, 0.0, 0.0, 100.0).full()[:3], 0.0, atol=1e-6)
    slopes = ca.Function("slopes", [q], [ca.jacobian(function(q, 0.0, 0.0, 0.0), q)])
    assert np.isfinite(slopes(one.default).full()).all()


ROPE = Muscle("rope", ("body", "earth"), np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
ONE = free_bodies("earth", {"body": np.zeros(6)}, muscles=[ROPE])


@pytest.mark.parametrize(
    ("build", "word"),
    [
        (lambda: replace(ONE, muscles=[replace(ROPE, bodies=("body", "moon"))]), "moon"),
        (lambda: replace(ROPE, points_mm=np.zeros((3, 3))), "points"),
        (lambda: Bundle("band", ROPE.bodies, ROPE.points_mm, stiffness_n=1000.0, slack_length_mm=0.0), "slack"),
        (lambda: CoordinateSettling(ONE, ["body_tx", "body_tx"]), "once"),
        (lambda: CoordinateSettling(ONE, ["head_tx"]), "head_tx"),
        (lambda: ONE.function(name="my loads"), "name"),
        (lambda: cc.load_assembly("elbow"), "knee_with_patella"),
    ],
)
def test_what_does_not_fit_is_refused(build, word):
    with pytest.raises(ValueError, match=word):
        build()


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
        ("[bodies.body]", '[bodies."body;exit(1)"]', "body"),
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
    assert cc.load_assembly(path).ligament_names == ("band",)
    path.write_text(SOUND.replace(sound, changed))
    with pytest.raises(ValueError, match=word) as refused:
        cc.load_assembly(path)
    assert str(refused.value).isprintable()


def test_a_foot_of_two_segments_stands_as_one_until_its_toes_bend():
    """Both soles together carry about what the whole sole does; bent up by 20 degrees the toes carry nothing."""

    def in_cells(scene):
        return cc.CellFoundation(scene, Cells(10.0, 10.0, 4, 4), compiled=False)

    foot = cc.load_assembly("foot_with_toes", in_cells)
    wrenches = foot.function(("contact_wrenches",))
    n = len(foot.coordinates)
    flat, bent = foot.default, foot.default + np.radians(20.0) * np.eye(n)[foot.rows(["toe_extension"])[0]]
    (behind, toes), (_, lifted) = (np.asarray(wrenches(q, np.zeros(n), np.zeros(n), [])).T for q in (flat, bent))
    whole = in_cells(cc.load_scene("foot_on_ground"))([0.0, -23.0, 0.0, 0.0, 0.0, 0.0])
    assert behind[1] > toes[1] > 5.0
    assert behind[1] + toes[1] == pytest.approx(whole[1], rel=0.15)  # the outlines of the parts end at the joint
    assert lifted[1] == 0.0
