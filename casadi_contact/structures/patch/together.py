"""What the parts of a patch are to carry together (`network.PartsRegression`): the wrench of the whole patch.

With the ratios ρ_kc that the networks of each part k give, and its normal load N_k = N0·max(s_k, 0)², the residuals of
a row are (Σ_k ρ_kc·N_k - W_c)/τ_c over the wrench components c that the scene's loads need, in shares of what each may
be off by, divided by the root of their number, and `_NORMAL` times where c belongs to the normal load, which all others
follow from. That is what the surrogate is off by: root loads make up for what ratios miss. Those of the parts' own root
loads are added: `_OWN_LOAD` times where a part bears, since which part bears what matters little beside what all of
them carry, and `_OWN_GAP` times where it does not. Far from contact it is the share of a gap that counts, lest a part
bear there, and one row in `_FAR_ROWS` stands for all: the others weigh nothing of their own.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from casadi_contact.conventions import WRENCH_NAMES, Array, load_selection
from casadi_contact.dataset import Samples
from casadi_contact.network import PartsRegression, Regression
from casadi_contact.scenes.normal_load import FORCE_NAMES, NormalLoad
from casadi_contact.scenes.scene import Scene
from casadi_contact.structures.sample_rows import fitted_rows

_NORMAL = 3.0
_OWN_LOAD, _OWN_GAP = 0.015, 0.1  # with 0.1 for both a fit takes twice as long for the same error of the patch
_FAR, _OWN_FAR, _FAR_ROWS = 0.3, 0.12, 8  # root loads s below -_FAR are far from contact, and weigh _OWN_FAR/|s|


def parts_regressions(
    samples: Samples, roots: dict[str, Regression], ratios: Callable[[Array, int], Array]
) -> list[PartsRegression]:
    """One for each patch that is cut into parts and carries something that the scene's loads need.

    roots: regressions of the parts' root loads by part (`patch_regressions`), of the same samples. ratios: what a
    newton of a part's normal load brings of each wrench component, (n, 6) of poses and the part's index.
    """
    scene = samples.scene
    rows, validation = fitted_rows(samples)
    poses = samples.poses[rows]
    found = []
    for p, patch in enumerate(scene.patch_names):
        parts = [k for k, part in enumerate(scene.parts) if part.patch == p]
        allowed = _allowed(scene, p)
        used = np.isfinite(allowed)
        if len(parts) < 2 or not used.any():
            continue
        wrench = samples.wrenches[rows][:, parts].sum(axis=1)[:, used]
        scale = (allowed / np.where(_pressing(scene.parts[parts[0]].normal), _NORMAL, 1.0))[used] * np.sqrt(used.sum())
        own, counting = [roots[scene.parts[k].name] for k in parts], samples.row_weights[rows][:, None]
        found.append(
            PartsRegression(
                f"together_{patch}",
                tuple(root.name for root in own),
                tuple(root.inputs for root in own),
                counting[:, None] * scene.reference_load * _stacked(poses, parts, used, ratios) / scale,
                counting * wrench / scale,
                np.stack([root.targets for root in own], axis=1),
                np.stack([_own_weights(root) for root in own], axis=1) / np.sqrt(len(own)),
                validation,
                tolerance=1.0,
                domain=samples.domain[rows],
            )
        )
    return found


def _stacked(poses: Array, parts: list[int], used: np.ndarray, ratios: Callable[[Array, int], Array]) -> Array:
    """Ratios (n, K, used) of all parts."""
    return np.stack([ratios(poses, k)[:, used] for k in parts], axis=1)


def _pressing(normal: NormalLoad) -> np.ndarray:
    """True for the wrench components (6,) that a normal load is made of."""
    return np.isin(WRENCH_NAMES, FORCE_NAMES if normal.component is None else normal.component)


def _own_weights(root: Regression) -> Array:
    """The weights (n,) of a part's root load, in most rows far from contact 0."""
    far = root.targets < -_FAR
    drawn = np.random.default_rng(0).random(len(far)) < 1.0 / _FAR_ROWS
    of_far = np.where(drawn, np.sqrt(_FAR_ROWS), 0.0) * _OWN_FAR / np.maximum(-root.targets, _FAR)
    own = np.where(far, of_far, np.where(root.targets > 0.0, _OWN_LOAD, _OWN_GAP))
    return own * root.weights / root.tolerance


def _allowed(scene: Scene, p: int) -> Array:
    """What each wrench component (6,) of patch p may be off by: the least of τ/√m over the loads that m patches make it
    part of; infinite where none needs it."""
    selection = load_selection(scene.load_names, scene.patch_names) != 0.0
    tolerances = scene.tolerances_of()
    shares = tolerances[:, None] / np.sqrt(np.maximum(selection.sum(axis=1), 1))
    return np.where(selection[:, p], shares, np.inf).min(axis=0)
