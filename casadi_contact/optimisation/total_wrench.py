"""The whole wrench of a contact from its named loads, as numbers and as a CasADi function."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from casadi_contact.contact import ContactModel, symbolic
from casadi_contact.conventions import WRENCH_NAMES, Array, loads_of_total


def total_selection(load_names: Sequence[str], patch_names: Sequence[str]) -> Array:
    """Matrix (6, L) that adds named loads up to the total wrench, each component as `loads_of_total` says; ValueError
    where one is named neither in total nor of every patch."""
    parts = {component: loads_of_total(component, load_names, patch_names) for component in WRENCH_NAMES}
    if missing := [component for component, names in parts.items() if not names]:
        raise ValueError(
            f"the loads {', '.join(load_names)} hold no {', '.join(missing)}, "
            f"expected all of {', '.join(WRENCH_NAMES)} in total or of every patch"
        )
    return np.array([[float(name in parts[component]) for name in load_names] for component in WRENCH_NAMES])


def wrench_function(model: ContactModel, name: str = "contact_wrench") -> ca.Function:
    """casadi.Function pose (6) -> total contact wrench on the fixed body (6), about its origin [N, N·mm].

    A surrogate or foundation gives its own compiled function with exact derivatives; any other contact model is called
    back, with its analytic Jacobian and differences of that. Raises ValueError where the model lacks a component of the
    wrench.
    """
    total = ca.sparsify(ca.DM(total_selection(model.load_names, model.patch_names)))
    pose = ca.MX.sym("pose", 6)
    loads = symbolic(model).function(name=f"{name}_loads", compiled=True)(pose)
    return ca.Function(name, [pose], [ca.mtimes(total, loads)])
