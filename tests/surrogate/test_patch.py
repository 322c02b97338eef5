"""The patch structure: what must hold for any weights (README), and its training targets."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.core.conventions import WRENCH_NAMES, load_selection, local_poses
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.patch.networks import ratio_outputs
from casadi_contact.surrogate.patch.regressions import root_weight
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from tests.support.random_surrogates import invented_samples, random_poses, random_surrogate

KNEE = load_scene("knee")


@pytest.fixture(scope="module")
def surrogate():
    return random_surrogate(KNEE, "patch", seed=2)


def test_no_load_out_of_contact_and_nothing_pulls(surrogate):
    poses = random_poses(500)
    wrenches, (roots, _) = surrogate.wrenches(poses), surrogate.root_loads(poses)
    lifted = roots <= 0.0
    assert lifted.any()
    assert (~lifted).any()
    assert not wrenches[lifted].any(), "every component vanishes exactly"
    normal = -wrenches[:, :, WRENCH_NAMES.index("Fy")]
    np.testing.assert_allclose(normal, KNEE.reference_load * np.maximum(roots, 0.0) ** 2, rtol=1e-14)
    of_loads = load_selection(surrogate.load_names, KNEE.patch_names)
    np.testing.assert_allclose(surrogate(poses), np.einsum("lpk,npk->nl", of_loads, wrenches), rtol=1e-12, atol=1e-9)
    of_tx, contact = ratio_outputs(KNEE)["ratios_med"].index("Tx"), ~lifted[:, 0]
    ratio = surrogate.networks["ratios_med"].value(local_poses(poses[contact], KNEE.anchors_mm[0]))[:, of_tx]
    np.testing.assert_allclose(wrenches[contact, 0, WRENCH_NAMES.index("Tx")] / normal[contact, 0], ratio, rtol=1e-9)
    loads, slopes = surrogate.jacobian(np.empty((0, 6)))
    assert (loads.shape, slopes.shape) == ((0, 7), (0, 7, 6))


def test_missing_and_unknown_networks_are_named_and_so_are_loads_that_were_not_learned(surrogate):
    vertical = {name: net for name, net in surrogate.networks.items() if name.startswith("root")}
    for bad, said in ((vertical, "lacks the networks ratios_med"), ({"top": vertical["root_med"]}, "network 'top'")):
        with pytest.raises(ValueError, match=said):
            PatchSurrogate(KNEE, bad)
    tables = {**KNEE.tables, "tolerances": {"Fy_med": 2.0, "Fy_lat": 2.0}}
    tables["loads"] = {**tables["loads"], "names": ["Fy_med", "Fy_lat"]}
    vertically = PatchSurrogate(Scene.from_tables(tables), vertical)
    poses = random_poses(5)
    np.testing.assert_array_equal(vertically(poses), surrogate(poses, ["Fy_med", "Fy_lat"]))
    for ask in (lambda: vertically(poses, ["Fx"]), lambda: vertically.function(["Fx"]), lambda: surrogate.function([])):
        with pytest.raises(ValueError, match="loads"):
            ask()
    with pytest.raises(ValueError, match="Fx, Fz, Tx, Ty, Tz of med not learned"):
        vertically.wrenches(poses)


def test_targets_are_roots_gaps_and_ratios():
    drawn = invented_samples()
    regressions = {r.name: r for r in PatchSurrogate.regressions(drawn)}
    assert set(regressions) == set(PatchSurrogate.network_inputs(KNEE))
    fitted = drawn.role != TEST
    root = regressions["root_lat"]
    normal, gap = -drawn.wrenches[fitted, 1, 1], drawn.gaps[fitted, 1]
    contact, count = normal > 0.0, len(normal)
    deeper, root = root.of_rows(np.arange(count, len(root.targets))), root.of_rows(np.arange(count))
    assert len(deeper.targets) >= contact[~root.validation].sum() // 4
    assert not deeper.validation.any()
    assert deeper.targets.min() > 1.1 * root.targets.max(), "a load of the plan is met at one depth alone"
    np.testing.assert_allclose(root.targets[contact] ** 2 * KNEE.reference_load, normal[contact])
    np.testing.assert_allclose(root.targets[~contact], -KNEE.gap_slope * gap[~contact])
    np.testing.assert_allclose(root.inputs, local_poses(drawn.poses[fitted], KNEE.anchors_mm[1]))
    np.testing.assert_array_equal(root.validation, drawn.role[fitted] == VALIDATION)
    ratio, components = regressions["ratios_lat"], ratio_outputs(KNEE)["ratios_lat"]
    np.testing.assert_allclose(ratio.targets[:, components.index("Tx")], -22.0)
    want = np.outer(normal[contact], ratio.weights[0] / normal[contact][0])
    np.testing.assert_allclose(ratio.weights, want)
    np.testing.assert_array_equal(ratio.validation, root.validation[contact])


def test_root_residuals_are_newtons_in_contact_and_fade_out_of_it():
    drawn = invented_samples()
    root = next(r for r in PatchSurrogate.regressions(drawn) if r.name == "root_med")
    root = root.of_rows(np.arange((drawn.role != TEST).sum()))  # those pressed on weigh less
    normal = KNEE.reference_load * np.maximum(root.targets, 0.0) ** 2
    loaded = normal > KNEE.boundary_load
    small = 1e-6
    change = KNEE.reference_load * (root.targets[loaded] + small) ** 2 - normal[loaded]
    np.testing.assert_allclose(root.weights[loaded] * small, change, rtol=1e-4)
    boundary = 2.0 * np.sqrt(KNEE.boundary_load * KNEE.reference_load)
    assert root.weights[loaded].min() >= boundary * (1 - 1e-12)
    lifted = root.targets < 0.0
    assert (root.weights[lifted] <= boundary * (1 + 1e-12)).all()
    far = root_weight(np.array([-KNEE.gap_slope * 20.0]), KNEE)  # 20 mm
    np.testing.assert_allclose(far, 0.02 * boundary, rtol=1e-12)
    order = np.argsort(root.targets[lifted])
    assert (np.diff(root.weights[lifted][order]) >= 0.0).all(), "the nearer to contact, the more an error counts"


def test_tolerances_add_up_to_the_loads_tolerance():
    """Both sides' errors of N·δρ and ρ·δN, independent, give at most the tolerance of each load."""
    drawn = invented_samples()
    regressions = {r.name: r for r in PatchSurrogate.regressions(drawn)}
    tolerance = {name: r.tolerance for name, r in regressions.items()}
    for load in ("Fx", "Fz", "Tx", "Ty", "Tz"):
        square = 0.0
        for p, patch in enumerate(KNEE.patch_names):
            wrench = drawn.wrenches[drawn.role != TEST, p]
            k = WRENCH_NAMES.index(load)
            lever = np.abs(wrench[wrench[:, 1] < 0, k] / wrench[wrench[:, 1] < 0, 1]).max()
            of_ratios, components = regressions[f"ratios_{patch}"], ratio_outputs(KNEE)[f"ratios_{patch}"]
            per_newton = of_ratios.weights[:, components.index(load)] / -wrench[wrench[:, 1] < 0, 1]
            ratio_tolerance = 1.0 / (per_newton.max() * np.sqrt(len(components)))
            square += ratio_tolerance**2 + (lever * tolerance[f"root_{patch}"]) ** 2
        assert np.sqrt(square) <= KNEE.tolerances[load] * (1 + 1e-9)
    for patch in KNEE.patch_names:
        assert tolerance[f"root_{patch}"] <= KNEE.tolerances[f"Fy_{patch}"]


def test_samples_that_cannot_be_fitted_are_refused():
    good = invented_samples(50)
    lifted = int(np.flatnonzero((good.gaps[:, 0] > 0) & (good.role == TRAIN))[0])
    for said, columns in {
        "NaN or infinity in wrenches at row 7": {"wrenches": ((7, 1, 2), np.nan)},
        "row 5: med pulls with 3 N": {"wrenches": ((4, 0, 1), 3.0), "role": (4, TRAIN)},
        "no row for training": {"role": (slice(None), TEST)},
        f"gap of patch 'med' is unknown at row {lifted}": {"gaps": ((lifted, 0), np.nan)},
    }.items():
        changed = {name: getattr(good, name).copy() for name in columns}
        for name, (index, value) in columns.items():
            changed[name][index] = value
        with pytest.raises(ValueError, match=said):
            PatchSurrogate.regressions(replace(good, **changed))
