"""The whole wrench of a contact from its named loads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.conventions import WRENCH_NAMES, Array


def total_selection(load_names: Sequence[str]) -> Array:
    """Matrix (6, L) that adds named loads up to the total wrench; ValueError where a component is not among them."""
    components = [name.partition("_")[0] for name in load_names]
    missing = [component for component in WRENCH_NAMES if component not in components]
    if missing:
        raise ValueError(
            f"the loads {', '.join(load_names)} hold no {', '.join(missing)}, "
            f"expected all of {', '.join(WRENCH_NAMES)} in total or per patch"
        )
    return np.array([[float(component == of) for of in components] for component in WRENCH_NAMES])
