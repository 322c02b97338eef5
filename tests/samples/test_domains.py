import numpy as np
import pytest

from casadi_contact.contact.settle import settle
from casadi_contact.samples.chunk import lift
from casadi_contact.samples.domains import Envelopes, hammersley, plan_domains
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION
from casadi_contact.samples.settings import PAPER_COUNTS, SamplingSettings
from casadi_contact.scenes.normal_load import normal_loads
from tests.support.two_spheres import TwoSpheres, knee

INPUTS = ("tx", "Fy_med", "tz", "Fy_lat", "ry", "rz")
SENSITIVE = ("Fy_med", "Fy_lat")
LIFTED = SamplingSettings(liftoff_mm=2.0, liftoff_steps=3, settle_tolerance_n=1e-4)
NORMALS = normal_loads(SENSITIVE, ("med", "lat"))


def envelopes(frames=5):
    """Three cycles that differ by 0, 1 and 2 units of each input's spread, around curves over the cycle."""
    t = np.linspace(0.0, 1.0, frames)[:, None]
    centre = np.array([0.0, -400.0, 0.5, -200.0, 0.0, -0.6]) + np.array([3.0, 300.0, 1.0, 150.0, 0.1, 0.5]) * np.cos(
        2 * np.pi * t
    )
    spread = np.array([0.5, 60.0, 0.2, 30.0, 0.0, 0.05]) * (1.0 + t)
    return Envelopes.over(INPUTS, np.stack([centre + k * spread for k in range(3)]))


REFERENCE = envelopes()


def plan(reference=REFERENCE, normals=NORMALS, **settings):
    return plan_domains(reference, normals, 5.0, SamplingSettings(**settings))


def inputs_of(blocks, domain):
    return np.concatenate([b.inputs for b in blocks if b.domain == domain])


def test_paper_counts_at_scale_one():
    blocks = plan(envelopes(101))
    rows = {d: sum(len(b.inputs) for b in blocks if b.domain == d) for d in range(1, 8)}
    # D4 and D5 count samples, three per row.
    assert rows == {1: 24000, 2: 24000, 3: 24000, 4: 10000, 5: 100, 6: 20000, 7: 100}
    assert sum(PAPER_COUNTS.values()) == 122400


@pytest.mark.parametrize(("domain", "rule", "offset"), [(1, (0.2, 0.5), 0.02), (2, (1.0, 2.0), 0.06)])
def test_every_frame_has_its_64_vertices_and_a_filling_inside(domain, rule, offset):
    """5 frames, 1000 samples: 320 vertices and 680 fillings; two vertex coordinates in each frame are its bounds."""
    inputs = inputs_of(plan(counts={f"D{domain}": 1000}), domain)
    boxes = REFERENCE.expand(*rule, {"ry": offset}).without_pull(NORMALS, 5.0)
    for f, rows in enumerate(np.split(inputs, 5)):
        at_bound = (rows == boxes.lower[f]) | (rows == boxes.upper[f])
        assert len(np.unique(rows[at_bound.all(axis=1)], axis=0)) == 64
        assert at_bound.all(axis=1).sum() == 64
        assert (rows >= boxes.lower[f]).all()
        assert (rows <= boxes.upper[f]).all()
    small = inputs_of(plan(counts={f"D{domain}": 1000}, scale=0.25), domain)
    at_bound = [(rows == boxes.lower[f]) | (rows == boxes.upper[f]) for f, rows in enumerate(np.split(small, 5))]
    assert (len(small), np.sum(np.all(at_bound, axis=2))) == (250, 80), "in the proportion of the whole plan"


def test_d3_fills_one_box():
    inputs = inputs_of(plan(counts={"D3": 2000}), 3)
    box = REFERENCE.extremes(0.25, 2.0, {"ry": 0.06}).without_pull(NORMALS, 5.0)
    assert (inputs >= box.lower).all()
    assert (inputs <= box.upper).all()
    np.testing.assert_allclose(inputs.mean(0), 0.5 * (box.lower + box.upper)[0], atol=0.01 * box.widths.max(1)[0])
    assert (np.ptp(inputs, axis=0) > 0.99 * box.widths).all()


def test_boundary_domains_hold_five_newtons():
    blocks = plan(counts={"D4": 300, "D5": 30, "D6": 200, "D7": 40})
    med, lat = INPUTS.index("Fy_med"), INPUTS.index("Fy_lat")
    box = REFERENCE.extremes(0.25, 2.0, {"ry": 0.06}).without_pull(NORMALS, 5.0)
    for domain in (4, 6):
        of_med, of_lat = (b for b in blocks if b.domain == domain)
        assert (of_med.lifted, of_lat.lifted) == (0, 1)
        assert len(of_med.inputs) == len(of_lat.inputs)  # half per side
        assert (of_med.inputs[:, med] == -5.0).all()
        assert (of_lat.inputs[:, lat] == -5.0).all()
        assert np.ptp(of_med.inputs[:, lat]) > 0.9 * box.widths[0, lat]
        assert (of_med.inputs[:, lat] <= -5.0).all()
    for domain, rows in ((5, 10), (7, 40)):
        (both,) = (b for b in blocks if b.domain == domain)
        assert len(both.inputs) == rows
        assert (both.inputs[:, [med, lat]] == -5.0).all()
        assert (np.ptp(both.inputs, axis=0)[[0, 2, 4, 5]] > 0.8 * box.widths[0, [0, 2, 4, 5]]).all()


def test_a_plan_depends_on_its_seed_only():
    one, again, other = (plan(scale=0.01, seed=s) for s in (1, 1, 2))
    for a, b, c in zip(one, again, other, strict=True):
        np.testing.assert_array_equal(a.inputs, b.inputs)
        np.testing.assert_array_equal(a.role, b.role)
        assert a.inputs.shape == c.inputs.shape
    assert not np.array_equal(one[0].inputs, other[0].inputs)
    assert not np.array_equal(one[0].role, other[0].role)


def test_ten_percent_of_each_domain_is_held_back_and_a_tenth_of_the_rest_validates():
    blocks = plan(counts={"D1": 1000, "D3": 500, "D6": 200})
    for domain, n in ((1, 1000), (3, 500), (6, 200)):
        role = np.concatenate([b.role for b in blocks if b.domain == domain])
        assert (role == TEST).sum() == n // 10
        assert (role == VALIDATION).sum() == (n - n // 10) // 10
        assert (role == TRAIN).sum() == n - n // 10 - (n - n // 10) // 10
    for domain in range(1, 8):  # a tiny plan can still be tested
        role = np.concatenate([b.role for b in plan(scale=1e-4) if b.domain == domain])
        assert len(role) == 10
        assert {TRAIN, VALIDATION, TEST} <= set(role.tolist())


def boundary_poses(model, lifted, count=6):
    """Poses with patch `lifted` at 5 N and 100..900 N on the other."""
    rng = np.random.default_rng(3)
    poses = np.tile([0.0, 27.2, 0.0, 0.0, 0.0, -0.6], (count, 1))
    poses[:, [0, 2, 4, 5]] += rng.uniform(-1, 1, (count, 4)) * [4.0, 1.0, 0.1, 0.5]
    loads = {SENSITIVE[lifted]: np.full(count, -5.0), SENSITIVE[1 - lifted]: -np.linspace(100.0, 900.0, count)}
    poses, report = settle(model, poses, ("ty", "rx"), loads, tolerance=1e-4)
    assert report.converged.all()
    return poses, {SENSITIVE[1 - lifted]: loads[SENSITIVE[1 - lifted]]}


@pytest.mark.parametrize("lifted", [0, 1])
@pytest.mark.parametrize("gapless", [False, True])
def test_d4_lifts_one_side_and_keeps_the_other_load(lifted, gapless):
    model = TwoSpheres(knee())
    model.has_gaps = not gapless
    poses, held = boundary_poses(model, lifted)
    gaps = np.full((len(poses), 2), np.nan)
    gaps[:, lifted] = 2.0
    got = lift(model, poses, gaps)
    assert (np.sign(got[:, 3] - poses[:, 3]) == (1 if lifted else -1)).all()  # rx > 0 lowers the medial side (z > 0)
    np.testing.assert_array_equal(got[:, [0, 2, 4, 5]], poses[:, [0, 2, 4, 5]])
    np.testing.assert_allclose(TwoSpheres(knee()).gaps(got)[:, lifted], 2.0, atol=0.1 if gapless else 1e-6)
    loads = model.wrenches(got)[..., 1]
    assert (loads[:, lifted] == 0.0).all()
    (kept,) = held.values()
    np.testing.assert_allclose(loads[:, 1 - lifted], kept, rtol=1e-3)


class FailsAt(TwoSpheres):
    """Gives no loads at poses of one tx."""

    def __init__(self, scene, tx):
        super().__init__(scene)
        self.tx = tx

    def _spoilt(self, poses, *results):
        for result in results:
            result[poses[:, 0] == self.tx] = np.nan
        return results

    def _wrenches(self, poses):
        return self._spoilt(poses, *super()._wrenches(poses))

    def root_loads(self, poses):
        return self._spoilt(poses, *super().root_loads(poses))


def test_a_pose_at_which_the_model_fails_is_not_lifted_and_all_others_are():
    model = TwoSpheres(knee())
    poses, _ = boundary_poses(model, 0)
    gaps = np.tile([1.0, np.nan], (len(poses), 1))
    want, got = lift(model, poses, gaps), lift(FailsAt(knee(), poses[2, 0]), poses, gaps)
    others = np.arange(len(poses)) != 2
    np.testing.assert_array_equal(np.isfinite(got).all(axis=1), others)
    np.testing.assert_allclose(got[others], want[others], rtol=0.0, atol=1e-12)


def test_hammersley_points_by_hand_and_shifted_on_the_torus():
    expected = [[0, 0, 0], [1 / 4, 1 / 2, 1 / 3], [2 / 4, 1 / 4, 2 / 3], [3 / 4, 3 / 4, 1 / 9]]
    np.testing.assert_allclose(hammersley(4, 3), expected, atol=1e-15)
    shift = np.array([0.0, 0.3, 0.9])
    np.testing.assert_allclose(hammersley(4, 3, shift), (expected + shift) % 1.0, atol=1e-15)


def test_a_plan_without_the_load_to_lift_from_is_refused():
    torque = Envelopes(("tx", "Fy", "tz", "Tx", "ry", "rz"), REFERENCE.lower, REFERENCE.upper)
    with pytest.raises(ValueError, match=r"D4 needs Fy_med, Fy_lat as an input"):
        plan(torque)
