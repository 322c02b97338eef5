"""Calibration on a made-up truth: a known surrogate plus known noise on a known region of poses."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact import foundation
from casadi_contact.contact.settle import settle
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, Dropped, Samples
from casadi_contact.scenes.loading import load_scene
from casadi_contact.surrogate.calibration import with_trust
from casadi_contact.surrogate.coverage import trust_coverage
from casadi_contact.surrogate.distrust import Confirmation
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from casadi_contact.surrogate.states import state_columns
from tests.support.noisy_samples import NOISE, SCENE, made_up_samples
from tests.support.random_surrogates import POSE_CENTRE, POSE_SPREAD, random_surrogate


@pytest.fixture(scope="module")
def surrogate():
    return random_surrogate(SCENE, "patch", seed=3)


@pytest.fixture(scope="module")
def samples(surrogate):
    return made_up_samples(surrogate)


@pytest.fixture(scope="module")
def trusted(surrogate, samples):
    return with_trust(surrogate, samples)


def test_the_stated_share_of_unseen_errors_lies_below(surrogate, samples, trusted):
    coverage = trusted.info().coverage["D1"]
    assert coverage["valid"] > 0.98
    for load in trusted.load_names:
        assert 0.92 < coverage[load] < 0.98
    noisier = with_trust(surrogate, made_up_samples(surrogate, noise=3.0 * NOISE))
    poses = samples.poses[:500]
    ratio = noisier.expected_error(poses) / trusted.expected_error(poses)
    assert 2.0 < np.median(ratio) < 4.5


def test_95_in_100_unseen_errors_lie_below_and_test_rows_take_no_part(surrogate, samples, trusted):
    """No row's own error helps to bound it in the fit: of unseen rows, spread alike, the share is the fitted one."""
    unseen = made_up_samples(surrogate, count=20_000, seed=99)
    wanted = unseen.loads(surrogate.load_names)
    below = np.abs(surrogate(unseen.poses) - wanted) <= trusted.expected_error(unseen.poses)
    assert 0.942 < below[wanted != 0.0].mean() < 0.958
    for column, rows in zip(below.T, (wanted != 0.0).T, strict=True):
        assert 0.935 < column[rows].mean() < 0.965  # a share of 1,200 rows is known to 0.006
    spoilt = samples.wrenches.copy()
    spoilt[samples.role == TEST] *= 3.0
    other = with_trust(surrogate, replace(samples, wrenches=spoilt))
    np.testing.assert_array_equal(other.trust.levels, trusted.trust.levels)
    np.testing.assert_array_equal(other.trust.shares, trusted.trust.shares)
    assert other.info().coverage["D1"]["Fy"] < 0.5


def test_each_domain_has_its_share_and_not_their_mean_alone(surrogate):
    """A tenth of the samples, anywhere among the others, errs three times as much."""
    samples = made_up_samples(surrogate, count=20_000)
    rare = np.arange(len(samples)) % 10 == 0
    noisier = made_up_samples(surrogate, count=20_000, noise=3.0 * NOISE)
    wrenches = np.where(rare[:, None, None], noisier.wrenches, samples.wrenches)
    mixed = replace(samples, wrenches=wrenches, domain=np.where(rare, 3, 1).astype(np.uint8))
    coverage = with_trust(surrogate, mixed).info().coverage
    assert min(coverage["D3"][load] for load in surrogate.load_names) > 0.93


def test_a_root_load_that_a_network_gets_wrong_lets_no_other_like_it_pass(surrogate, samples):
    """The contact model's own loads say how large root loads were sampled."""
    trust = with_trust(surrogate, replace(samples, wrenches=0.01 * samples.wrenches)).trust
    largest = 0.01 * -samples.wrenches[samples.role == TRAIN, 0, 1].min()
    assert trust.root_high == pytest.approx(np.sqrt(largest / SCENE.reference_load))
    assert trust.validity(samples.poses[:1], (trust.root_high + 4.0 * trust.margin_high)[None])[0] < 0.1


def test_a_tube_is_a_tube_not_a_box(trusted):
    """tx and rz lie each within its range, but together they were never sampled."""
    bottom, off = POSE_CENTRE.copy(), POSE_CENTRE.copy()
    bottom[0] -= POSE_SPREAD[0]
    off[0] += 0.9 * POSE_SPREAD[0]
    root = 0.5 * (trusted.trust.root_low + trusted.trust.root_high)[None]
    assert trusted.trust.validity(bottom[None], root)[0] > 0.9
    assert trusted.trust.validity(off[None], root)[0] < 0.1


def test_validity_survives_the_file(surrogate, tmp_path):
    trusted = with_trust(surrogate, made_up_samples(surrogate, count=1000))
    trusted.save(tmp_path / "it.h5")
    again = load_surrogate(tmp_path / "it.h5")
    poses = POSE_CENTRE + 2.0 * POSE_SPREAD * np.random.default_rng(2).uniform(-1.0, 1.0, (50, 6))
    np.testing.assert_array_equal(again.validity(poses), trusted.validity(poses))
    np.testing.assert_array_equal(again.expected_error(poses), trusted.expected_error(poses))
    assert again.info().coverage == trusted.info().coverage


@pytest.mark.parametrize("count", [1, 9, 10])
def test_a_share_of_errors_is_told_of_ten_poses_and_more(surrogate, count):
    """Of one pose it is 0 or 100 %, and says nothing of a bound that holds for 95 %."""
    samples = made_up_samples(surrogate)
    trusted = with_trust(surrogate, samples)
    loaded = samples.rows((samples.loads() != 0.0).all(axis=1)).select("D1")
    coverage = trust_coverage(trusted, loaded.rows(np.arange(count)), led=loaded.rows(np.arange(200)))
    (domain,) = set(coverage) - {"led"}
    assert set(coverage[domain]) == {"valid", *(surrogate.load_names if count >= 10 else ())}
    assert set(coverage["led"]) == {"valid", *surrogate.load_names}


def test_what_cannot_be_calibrated_is_named(surrogate):
    samples = made_up_samples(surrogate, count=300)
    with pytest.raises(ValueError, match="no validation rows"):
        with_trust(surrogate, samples.select(role=TRAIN))
    other = random_surrogate(load_scene("sphere_on_plane", radius=20.0), "patch")
    with pytest.raises(ValueError, match="another scene"):
        with_trust(other, samples)


@pytest.mark.parametrize(
    ("name", "columns"), [("knee", [0, 2, 4, 5]), ("hip", [0, 1, 2, 3, 4, 5]), ("sphere_on_plane", [0, 2, 3, 4, 5])]
)
def test_parameters_that_no_root_load_stands_for_tell_the_state_themselves(name, columns):
    """One root load does not say where in its cup a ball lies, which three sensitive parameters do."""
    assert state_columns(load_scene(name)) == columns


def test_nothing_is_valid_where_samples_were_dropped(surrogate, samples):
    """A plane through the sampled region, beyond which everything was dropped: most there is not valid, most of what
    was kept is."""
    beyond = samples.poses[:, 5] > POSE_CENTRE[5] + 0.5 * POSE_SPREAD[5]
    kept = replace(samples.rows(~beyond), dropped=Dropped(samples.poses[beyond], samples.domain[beyond]))
    trusted = with_trust(surrogate, kept)
    validity = trusted.validity(samples.poses)
    assert np.mean(validity[beyond] < 0.5) > 0.95
    assert np.mean(validity[~beyond] > 0.9) > 0.95


def test_just_beyond_the_sampled_range_of_an_insensitive_parameter_nothing_is_valid(samples, trusted):
    inside = samples.poses[np.argmax(samples.poses[:, 2])]
    outside = inside + 0.05 * np.ptp(samples.poses[:, 2]) * np.eye(6)[2]
    root = 0.5 * (trusted.trust.root_low + trusted.trust.root_high)[None]
    assert trusted.trust.validity(inside[None], root)[0] > 0.5
    assert trusted.trust.validity(outside[None], root)[0] < 0.1


def test_contact_that_no_root_load_confirms_is_not_valid(trusted):
    """Claims of 10 N count where the root load says contact, and not where it says that the surfaces are apart."""
    confirmation = Confirmation(tolerance=np.array([0.5]), root=np.array([0.05]), width=np.array([0.02]))
    trust = replace(trusted.trust, confirmation=confirmation)
    pose, roots = POSE_CENTRE[None], np.array([[0.1], [-0.2], [-0.2]])
    assert trust.validity(np.repeat(pose, 3, axis=0), roots, np.array([[10.0], [10.0], [0.1]])).round(1).tolist() == [
        pytest.approx(v, abs=0.11) for v in (1.0, 0.0, 1.0)
    ]


@pytest.mark.parametrize("some_pressed_apart", [True, False])
def test_contact_is_confirmed_well_above_the_largest_root_load_of_a_false_claim(surrogate, some_pressed_apart):
    """At three and a half times that root load, and at 0.0125 at least."""
    samples = made_up_samples(surrogate, count=1000)
    staged = random_surrogate(SCENE, "two_stage", seed=3)
    roots = staged.trust_roots(samples.poses)
    apart = roots[:, 0] <= (np.median(roots[roots > 0.0]) if some_pressed_apart else 0.0)
    assert apart.any()
    assert not apart.all()
    usual = SCENE.reference_load * roots.max() ** 2
    pressed = np.where(apart[:, None, None], 0.0, -np.abs(samples.wrenches) - usual)
    confirmation = with_trust(staged, replace(samples, wrenches=pressed)).trust.confirmation
    false = apart & (staged.trust_claims(samples.poses)[:, 0] > 0.1 * SCENE.boundary_load)
    assert false.any()
    largest = max(roots[false].max(), 0.0)
    width = max(largest, 0.005)
    assert confirmation.width == pytest.approx(width)
    assert confirmation.root == pytest.approx(largest + 2.5 * width)


def test_the_expected_error_covers_moved_poses_too(surrogate, samples):
    """Away from the samples the truth bends off, growing with the distance: most of these errors are expected."""
    rng = np.random.default_rng(5)
    moved = samples.rows(rng.integers(len(samples), size=2000))
    moves = 0.4 * POSE_SPREAD * rng.standard_normal((2000, 6))
    poses = moved.poses + moves
    far = 1.0 + np.linalg.norm(moves / POSE_SPREAD, axis=1)[:, None, None]
    off = moved.wrenches * 0.0 + surrogate.wrenches(poses) * (1.0 + 3.0 * NOISE * far * rng.standard_normal(far.shape))
    role = np.where(np.arange(2000) % 2 == 0, VALIDATION, TEST).astype(np.uint8)
    around = replace(moved, poses=poses, wrenches=off, role=role)
    coverage = with_trust(surrogate, samples, around).info().coverage
    for row in ("around", "outside"):
        shares = [share for load, share in coverage[row].items() if load != "valid"]
        assert min(shares) > 0.8, row


class NoisyModel:
    """A contact model that the surrogate meets but for an error that depends on the pose: `amplitude` of each load."""

    def __init__(self, surrogate, amplitude):
        self.surrogate, self.amplitude = surrogate, amplitude

    def wrenches(self, poses):
        noise = np.sin(1e4 * poses.sum(axis=1)) * self.amplitude(poses)
        return self.surrogate.wrenches(poses) * (1.0 + noise)[:, None, None]


def drawn_from(model, poses, seed=7):
    wrenches, count = model.wrenches(poses), len(poses)
    role = np.random.default_rng(seed).choice([TRAIN, VALIDATION, TEST], count, p=[0.6, 0.2, 0.2]).astype(np.uint8)
    gaps, domain = np.full((count, 1), np.nan), np.ones(count, dtype=np.uint8)
    return Samples(model.surrogate.scene, poses, wrenches, gaps, domain, role)


def test_the_expected_error_holds_over_the_whole_range_where_validity_is_high(surrogate):
    """Errors grow where tz and rx are large together, which no sample is: those tell too little of the rest of their
    range, and a contact model at hand is asked there."""

    def amplitude(poses):
        unit = (poses - POSE_CENTRE) / POSE_SPREAD
        return NOISE * (1.0 + 20.0 * np.maximum(unit[:, 2] + unit[:, 3], 0.0))

    model, unit = NoisyModel(surrogate, amplitude), np.random.default_rng(4).uniform(-1.0, 1.0, (8000, 6))
    poses = POSE_CENTRE + POSE_SPREAD * unit
    samples = drawn_from(model, poses[:4000][unit[:4000, 2] + unit[:4000, 3] < 0.3])
    unseen = poses[4000:]
    wanted = drawn_from(model, unseen).loads(surrogate.load_names)
    errors = np.abs(surrogate(unseen) - wanted)

    def covered(trusted):
        counted = (trusted.validity(unseen) > 0.5)[:, None] & (wanted != 0.0)
        return np.mean((errors <= trusted.expected_error(unseen))[counted])

    model.record = {"rms": {"Fy": 1.5}, "against": "EF 320×320"}
    asked = with_trust(surrogate, samples, model=model)
    assert "itself off by (RMS against EF 320×320): Fy 1.5" in str(asked.info()), "no error on samples includes that"
    assert "itself off by" not in str(with_trust(surrogate, samples).info())
    assert covered(with_trust(surrogate, samples)) < 0.9
    assert 0.93 < covered(asked) < 0.99
    shares = [share for load, share in asked.info().coverage["range"].items() if load != "valid"]
    assert 0.93 < np.mean(shares) < 0.99


class BallInCup(PatchSurrogate):
    """A hip's head, t off the centre of its cup, presses as deep as it is off by more than its clearance, that way:
    s = 18·(|t| - 0.4 mm), F = 1000 N·max(s, 0)²·t/|t|."""

    def trust_roots(self, poses):
        return 18.0 * (np.linalg.norm(poses[:, :3], axis=1, keepdims=True) - 0.4)

    def wrenches(self, poses):
        side = poses[:, :3] / np.linalg.norm(poses[:, :3], axis=1, keepdims=True)
        force = 1000.0 * np.maximum(self.trust_roots(poses), 0.0) ** 2 * side
        return np.hstack([force, np.zeros_like(force)])[:, None]

    def __call__(self, poses, loads=None):
        return np.einsum("lpk,npk->nl", self.scene.part_selection(self.load_names), self.wrenches(poses))


def test_a_force_towards_a_side_that_was_never_sampled_is_not_valid():
    """The root load of a hip tells how large its force is and not where it points: upwards all sizes were sampled."""
    hip = load_scene("hip")
    surrogate = BallInCup(hip, random_surrogate(hip, "patch").networks)
    model = NoisyModel(surrogate, lambda poses: NOISE)
    poses = np.random.default_rng(4).uniform(-1.0, 1.0, (20_000, 6)) * [0.5, 0.5, 0.5, 0.1, 0.1, 0.1]
    force = np.abs(surrogate.wrenches(poses)[:, 0, :3])
    size = np.linalg.norm(force, axis=1)
    sampled = (size < 2500.0) & (force[:, 0] < 400.0)
    sideways = (size < 2400.0) & (force[:, 0] > 800.0)
    samples = drawn_from(model, poses[sampled][:3000])

    def valid_shares(trusted):
        validity = trusted.validity(poses)
        return np.mean(validity[sampled] > 0.5), np.mean(validity[sideways] > 0.5)

    like_samples, towards_a_side = valid_shares(with_trust(surrogate, samples, model=model))
    assert like_samples > 0.97
    assert towards_a_side < 0.15
    assert valid_shares(with_trust(surrogate, samples))[1] > 0.7  # nothing but the model tells


def test_light_contact_on_both_sides_of_the_shipped_knee_has_its_share():
    """D7: a boundary load on each side. Bounds that only grow with loads held 93 % of the errors there, 90 % of some
    loads, and there were nine held-back samples to tell."""
    knee, model, rng = load_surrogate("knee"), foundation("knee"), np.random.default_rng(2)
    scene, count = knee.scene, 1500
    low, high = np.array([[-5.0, 28.0, -1.3, -0.04, -0.17, -1.5], [9.5, 31.0, 1.6, 0.06, 0.11, 0.45]])
    wanted = {name: np.full(count, -scene.boundary_load) for name in ("Fy_med", "Fy_lat")}
    starts = low + (high - low) * rng.random((count, 6))
    poses, report = settle(model, starts, scene.sensitive_pose, wanted)
    poses = poses[report.converged]
    poses = poses[knee.validity(poses) > 0.9]
    assert len(poses) > 0.8 * count
    below = np.abs(knee(poses) - model(poses)) <= knee.expected_error(poses)
    assert 0.945 < below.mean() < 0.99
    assert below.mean(axis=0).min() > 0.93
