"""Training targets of the trunk surrogate: root loads as the patch surrogate's, its ratios side by side."""

from __future__ import annotations

import numpy as np

from casadi_contact.dataset import Samples
from casadi_contact.network import Regression
from casadi_contact.scenes.scene import Scene
from casadi_contact.structures.patch.names import ratio_name, root_name
from casadi_contact.structures.patch.targets import part_components, patch_regressions


def trunk_name(part: str) -> str:
    """Name of the network of a part's ratios."""
    return f"ratios_{part}"


def trunk_outputs(scene: Scene) -> dict[str, tuple[str, ...]]:
    """The wrench components whose ratio each trunk gives, by its name: those that the scene's loads need."""
    components = part_components(scene)
    return {trunk_name(part): names for part, names in components.items() if names}


def trunk_regressions(samples: Samples) -> list[Regression]:
    """The regressions of root loads, and one of all ratios for each part, its residuals in shares of what is wanted.

    With the residuals r_k = N·(ρ_k - W_k/N) [N, N·mm] and the tolerances τ_k of `patch_regressions`, the squares of a
    row's m outputs add up to (1/m)·Σ (r_k/τ_k)²: the root mean square is 1 where all are as wrong as they may be.
    """
    alone = {regression.name: regression for regression in patch_regressions(samples)}
    regressions = []
    for part, components in part_components(samples.scene).items():
        regressions.append(alone[root_name(part)])
        ratios = [alone[ratio_name(part, component)] for component in components]
        if not ratios:
            continue
        targets = np.stack([ratio.targets for ratio in ratios], axis=1)
        weights = np.stack([ratio.weights / ratio.tolerance for ratio in ratios], axis=1) / np.sqrt(len(ratios))
        if len(ratios) == 1:
            targets, weights = targets[:, 0], weights[:, 0]
        columns = (ratios[0].inputs, targets, weights, ratios[0].validation)
        regressions.append(Regression(trunk_name(part), *columns, tolerance=1.0, domain=ratios[0].domain))
    return regressions
