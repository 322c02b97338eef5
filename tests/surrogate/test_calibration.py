"""Calibration on a made-up truth: a known surrogate, known noise in a known region of poses, a rim that it ignores."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.samples.calibration_poses import label_poses, perturbed_poses, poses_in_range, self_settled_poses
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, Samples
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.loading import load_scene
from casadi_contact.surrogate.calibration import CalibrationSettings, calibrate, spread_centres
from tests.support.random_surrogates import POSE_CENTRE, POSE_SPREAD, random_surrogate

SCENE = load_scene("sphere_on_plane")
NOISE = 0.02


def made_up_samples(surrogate, count=6000, noise=NOISE, seed=0):
    """Poses on a curved tube in tx and rz; wrenches of the surrogate times (1 + noise)."""
    rng = np.random.default_rng(seed)
    unit = rng.uniform(-1.0, 1.0, (count, 6))
    unit[:, 0] = 2.0 * unit[:, 5] ** 2 - 1.0 + 0.1 * unit[:, 0]
    poses = POSE_CENTRE + POSE_SPREAD * unit
    return samples_of(rng, poses, surrogate.wrenches(poses) * (1.0 + noise * rng.standard_normal((count, 1, 1))))


def samples_of(rng, poses, wrenches, scene=SCENE, shares=(0.6, 0.2, 0.2)):
    role = rng.choice([TRAIN, VALIDATION, TEST], len(poses), p=shares).astype(np.uint8)
    domain = np.ones(len(poses), dtype=np.uint8)
    return Samples(scene, poses, wrenches, np.full(wrenches.shape[:2], np.nan), domain, role)


QUICK = CalibrationSettings(tolerances=200.0, light=1.0, hidden=(8, 8), iterations=60)
RIM = replace(QUICK, tolerances=20.0)


class Rimmed:
    """A contact model that is the surrogate with noise, and nothing beyond a curved rim in tx and tz."""

    def __init__(self, surrogate, noise=0.1 * NOISE):
        self.surrogate, self.noise = surrogate, noise

    def on_the_plane(self, poses):
        unit = (poses - POSE_CENTRE) / POSE_SPREAD
        return unit[:, 2] < 0.5 - 0.5 * unit[:, 0] ** 2

    def wrenches(self, poses):
        rng = np.random.default_rng(len(poses))
        factors = (1.0 + self.noise * rng.standard_normal(len(poses))) * self.on_the_plane(poses)
        return self.surrogate.wrenches(poses) * factors[:, None, None]


@pytest.fixture(scope="module")
def surrogate():
    return random_surrogate(SCENE, "patch", seed=3)


@pytest.fixture(scope="module")
def samples(surrogate):
    return made_up_samples(surrogate)


@pytest.fixture(scope="module")
def calibrated(surrogate, samples):
    return calibrate(surrogate, samples, settings=QUICK)


@pytest.fixture(scope="module")
def model(surrogate):
    return Rimmed(surrogate)


@pytest.fixture(scope="module")
def on_the_plane(surrogate, model):
    """Samples of the rimmed model; none of them lies beyond the rim."""
    rng = np.random.default_rng(0)
    poses = POSE_CENTRE + POSE_SPREAD * rng.uniform(-1.0, 1.0, (6000, 6))
    poses = poses[model.on_the_plane(poses)]
    return samples_of(rng, poses, model.wrenches(poses))


@pytest.fixture(scope="module")
def with_model(surrogate, on_the_plane, model):
    told = {}
    made = calibrate(
        surrogate, on_the_plane, model, lambda what, n, of, _: told.setdefault(what, []).append(n / of), RIM
    )
    assert told == {"patch: other poses": pytest.approx([1 / 3, 2 / 3, 1.0])}
    return made


def pressed_poses(surrogate, seed, count=3000):
    """Poses over the whole range at which the surrogate presses."""
    poses = POSE_CENTRE + POSE_SPREAD * np.random.default_rng(seed).uniform(-1.0, 1.0, (2 * count, 6))
    return poses[surrogate.confidence_roots(poses)[:, 0] > 0.3][:count]


def test_the_stated_share_of_unseen_errors_lies_below_the_expected_one(surrogate, calibrated):
    unseen = made_up_samples(surrogate, count=20_000, seed=99)
    target = unseen.loads(surrogate.load_names)
    below = np.abs(surrogate(unseen.poses) - target) <= calibrated.expected_error(unseen.poses)
    for column, rows in zip(below.T, (target != 0.0).T, strict=True):
        assert 0.93 < column[rows].mean() < 0.975
    assert calibrated.info().coverage["D1"]["valid"] > 0.97


@pytest.mark.parametrize(("share", "worse"), [(0.1, 3.0), (0.03, 5.0)])
def test_each_domain_has_its_share_unless_it_is_too_few_to_tell(surrogate, share, worse):
    """A tenth of the samples, anywhere among the others, errs three times as much; a few more do not widen all."""
    samples = made_up_samples(surrogate, count=10_000)
    rare = np.arange(len(samples)) % round(1.0 / share) == 0
    noisier = made_up_samples(surrogate, count=10_000, noise=worse * NOISE)
    wrenches = np.where(rare[:, None, None], noisier.wrenches, samples.wrenches)
    mixed = replace(samples, wrenches=wrenches, domain=np.where(rare, 3, 1).astype(np.uint8))
    coverage = calibrate(surrogate, mixed, settings=QUICK).info().coverage
    if share > 0.05:
        assert min(coverage["D3"][load] for load in surrogate.load_names) > 0.92
    else:
        assert max(coverage["D1"][load] for load in surrogate.load_names) < 0.985


def test_test_rows_take_no_part(surrogate, samples, calibrated):
    spoilt = samples.wrenches.copy()
    spoilt[samples.role == TEST] *= 3.0
    other = calibrate(surrogate, replace(samples, wrenches=spoilt), settings=QUICK)
    np.testing.assert_array_equal(other.expected_error(samples.poses), calibrated.expected_error(samples.poses))
    assert other.info().coverage["D1"]["Fy"] < 0.5


def test_poses_between_the_samples_that_were_never_sampled_are_not_valid(calibrated):
    """tx and rz lie each within its range, but together they were never sampled."""
    bottom, off = POSE_CENTRE.copy(), POSE_CENTRE.copy()
    bottom[0] -= POSE_SPREAD[0]
    off[0] += 0.9 * POSE_SPREAD[0]
    assert calibrated.validity(bottom) > 0.9
    assert calibrated.validity(off) < 0.1


OWN = CalibrationSettings(hidden=(8, 8), iterations=60)


@pytest.mark.parametrize(("seed", "factor"), [(3, 0.5), (8, 1.0)], ids=["twice the load", "not trained"])
def test_a_surrogate_that_misses_a_few_tolerances_everywhere_is_nowhere_valid(samples, seed, factor):
    """As usual for this surrogate is not good enough."""
    off = replace(samples, wrenches=factor * samples.wrenches)
    surrogate = random_surrogate(SCENE, "patch", seed=seed)
    validity = calibrate(surrogate, off, settings=OWN).validity(samples.poses)
    pressed = (np.abs(samples.loads(["Fy"])[:, 0])) > 100.0
    assert pressed.sum() > 500
    assert np.mean(validity[pressed] > 0.5) < 0.02


def test_less_is_allowed_in_light_contact(surrogate):
    """An error of 3.5 tolerances in Fy is a few under the reference load, and many where little is carried."""
    samples = made_up_samples(surrogate, noise=0.0)
    wrenches = samples.wrenches.copy()
    wrenches[:, 0, 1] += 3.5 * SCENE.tolerances["Fy"]
    made = calibrate(surrogate, replace(samples, wrenches=wrenches), settings=OWN)
    validity, load = made.validity(samples.poses), np.linalg.norm(samples.wrenches[:, 0, :3], axis=1)
    heavy, light = load > 0.9 * SCENE.reference_load, load < 0.1 * SCENE.reference_load
    assert min(heavy.sum(), light.sum()) > 50
    assert np.mean(validity[light] > 0.5) < 0.05 < 0.8 < np.mean(validity[heavy] > 0.5)


def test_poses_with_load_at_an_edge_are_not_valid_though_the_surrogate_agrees(surrogate, on_the_plane):
    class Edged(Rimmed):
        """Beyond the rim the elements' edges carry all."""

        def on_the_plane(self, poses):
            return np.ones(len(poses), dtype=bool)

        def edge_wrenches(self, poses):
            return self.surrogate.wrenches(poses) * ~super().on_the_plane(poses)[:, None, None]

    poses, model = pressed_poses(surrogate, 2), Edged(surrogate)
    validity = calibrate(surrogate, on_the_plane, model, settings=RIM).validity(poses)
    carries = model.edge_wrenches(poses)[:, 0, 1] != 0.0
    assert np.mean(validity[carries] > 0.5) < 0.05
    assert np.mean(validity[~carries] > 0.5) > 0.5


def test_poses_are_not_valid_where_the_surrogate_is_wrong(surrogate, model, on_the_plane, with_model):
    poses = pressed_poses(surrogate, 2)
    right = model.on_the_plane(poses)
    before, after = (
        made.validity(poses) > 0.5 for made in (calibrate(surrogate, on_the_plane, settings=RIM), with_model)
    )
    assert before[~right].mean() > 0.3, "the distance from the samples does not tell these poses"
    assert after[~right].mean() < 0.05
    assert (after & right).sum() > 0.85 * (before & right).sum()
    assert np.mean(with_model.validity(on_the_plane.poses) > 0.9) > 0.9


@pytest.mark.parametrize("slow_s", [0.0, 1e3])
def test_workers_evaluate_poses_of_a_slow_model(samples, slow_s):
    settings = SamplingSettings(settle_grid=(10, 10), teacher_grid=(20, 20))
    drawn = replace(samples, provenance={"models": "elements", "settings": settings.to_table()})
    teacher, asked = ElasticFoundation(SCENE, (20, 20)), []

    class Workers(ThreadPoolExecutor):
        def map(self, job, blocks):
            asked.extend(blocks)
            return super().map(job, asked)

    with Workers(2) as workers:
        labelled = label_poses(teacher, drawn, samples.poses[:250], workers, slow_s=slow_s)
    assert len(asked) == (2 if slow_s == 0.0 else 0)
    np.testing.assert_array_equal(labelled.wrenches, teacher.wrenches(samples.poses[:250]))


def test_errors_of_other_poses_are_covered_where_they_are_valid(surrogate, model, with_model, on_the_plane):
    poses = pressed_poses(surrogate, 5)
    poses = poses[model.on_the_plane(poses) & (with_model.validity(poses) > 0.5)]
    errors = np.abs(surrogate(poses) - label_poses(model, on_the_plane, poses).loads())
    below = errors <= with_model.expected_error(poses)
    assert below.mean() > 0.92
    assert {"D1", "around", "range", "settled"} <= set(with_model.info().coverage)


def test_poses_at_which_the_model_gives_no_number_are_wrong(surrogate, model, on_the_plane):
    class Fails(Rimmed):
        def wrenches(self, poses):
            return np.where(self.on_the_plane(poses)[:, None, None], super().wrenches(poses), np.nan)

    poses = pressed_poses(surrogate, 2)
    validity = calibrate(surrogate, on_the_plane, Fails(surrogate), settings=RIM).validity(poses)
    assert np.mean(validity[~model.on_the_plane(poses)] > 0.5) < 0.1


def test_what_is_known_of_the_models_own_errors_is_kept(surrogate, samples):
    model = Rimmed(surrogate)
    model.record = {"rms": {"Fy": 1.5}, "against": "EF 320×320"}
    settings = replace(QUICK, own_rows=300, iterations=5)
    assert "EF 320×320): Fy 1.5" in str(calibrate(surrogate, samples, model, settings=settings).info())


def test_what_cannot_be_calibrated_is_named(surrogate):
    samples = made_up_samples(surrogate, count=300)
    with pytest.raises(ValueError, match="validation"):
        calibrate(surrogate, samples.select(role=TRAIN))
    other = random_surrogate(load_scene("sphere_on_plane", radius=20.0), "patch")
    with pytest.raises(ValueError, match="another scene"):
        calibrate(other, samples)


def test_the_classifier_takes_what_root_loads_do_not_stand_for():
    """One root load does not say where in its cup a ball lies, which three sensitive parameters do."""
    for scene, columns in {"knee": [0, 2, 4, 5], "hip": [0, 1, 2, 3, 4, 5], "sphere_on_plane": [0, 2, 3, 4, 5]}.items():
        assert list(random_surrogate(load_scene(scene), "patch").confidence_columns) == columns
    assert list(random_surrogate(load_scene("knee"), "two_stage").confidence_columns) == [0, 2, 4, 5]


def test_a_pose_beside_what_the_scene_locks_is_not_valid():
    """planar_knee locks all but tx, ty and rz: loads beside that are those of another pose."""
    scene = load_scene("planar_knee")
    surrogate, rng = random_surrogate(scene, "patch", seed=1), np.random.default_rng(0)
    poses = scene.pose_space.project(POSE_CENTRE + POSE_SPREAD * rng.uniform(-1.0, 1.0, (900, 6)))
    samples = samples_of(rng, poses, np.zeros((len(poses), len(scene.patches), 6)), scene, (0.5, 0.5, 0.0))
    made = calibrate(surrogate, samples, settings=replace(QUICK, tolerances=1e6))
    assert np.median(made.validity(poses)) > 0.9
    pose = ca.MX.sym("pose", 6)
    slope = ca.Function("s", [pose], [ca.gradient(1.0 / made.validity_function()(pose), pose)])
    for column, beside in ((2, 0.05), (3, 0.01)):
        off = poses + beside * np.eye(6)[column]
        assert made.validity(off).max() < 0.1
        assert float(slope(off[0])[column]) > 0.0, "a constraint on validity leads back"


def test_centres_lie_among_the_points_and_no_two_alike():
    points = np.repeat(np.random.default_rng(3).standard_normal((700, 3)), 2, axis=0)
    centres = spread_centres(points, 40, cell=0.1)
    assert 30 < len(centres) <= 40
    assert len(np.unique(centres, axis=0)) == len(centres)
    np.testing.assert_array_equal(centres, spread_centres(points, 40, cell=0.1))
    assert len(spread_centres(points[:10], 40)) == 5


def test_perturbations_have_the_stated_size(samples):
    """Of one pose: a mixture of uniform and normal moves of 1 mm and 2°, times u, has a variance of 2/9 of theirs."""
    moves = perturbed_poses(samples.rows(np.zeros(40_000, dtype=int)), 40_000, seed=1) - samples.poses[0]
    np.testing.assert_allclose(moves.std(axis=0), np.sqrt(2.0) / 3.0 * np.repeat([1.0, np.deg2rad(2.0)], 3), rtol=0.03)


def test_poses_in_range_lie_over_the_range_and_half_of_it_beyond_and_most_press(surrogate, samples):
    poses = poses_in_range(samples, 400, lambda p: np.ones(len(p), dtype=bool), surrogate.confidence_roots)
    known = samples.poses[samples.role != TEST]
    low, span = known.min(axis=0), np.ptp(known, axis=0)
    assert (np.abs((poses - low) / span - 0.5) <= 1.0).all()
    inside = (np.abs((poses - low) / span - 0.5) <= 0.5).all(axis=1)
    assert 0.5 < inside.mean() < 0.8
    assert np.mean(surrogate.confidence_roots(poses)[:, 0] > 0.0) == pytest.approx(2 / 3)


def test_self_settled_poses_carry_loads_of_samples(surrogate, samples):
    poses = self_settled_poses(surrogate, samples, 300)
    assert len(poses) > 150
    carried, sampled = -surrogate(poses, ["Fy"])[:, 0], -samples.loads(["Fy"])[:, 0]
    assert 0.6 < np.mean(np.abs(carried[:, None] - sampled).min(axis=1) < 0.02) < 0.99
    assert carried.max() < sampled.max() + 0.02
    assert np.mean(carried < 0.1 * np.median(sampled[sampled > 0.0])) > 0.03
