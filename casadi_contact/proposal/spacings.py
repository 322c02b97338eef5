"""The spacing of the distance fields of thin bodies, by a convergence test.

Half way through a body of thickness t its distance has a kink, which a cubic spline carries to both of its surfaces: at
a spacing of t/4 by up to 0.004 t, at 0.15 t by 0.0005 t. What that is of a load depends on how deep the bodies overlap.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import Array
from casadi_contact.geometry.distance_field import SPACING_MM, field_fits
from casadi_contact.geometry.triangle_mesh import TriangleMesh
from casadi_contact.scenes import Scene

_SHARES = (0.25, 0.15, 0.1)  # of the thickness
_ENOUGH = 0.01  # of the load at rest, that the next finer field changes
_FALLS = 4.0  # the error from each share to the next, by this at least


@dataclass(frozen=True, eq=False)
class Resting:
    """A scene's model and its pose at rest (6,), and why there is none ("" if there is); remark: on the spacing of its
    fields, "" where no body is thin; enough: False where a finer field would be needed and does not fit into memory."""

    model: ElasticFoundation
    pose: Array
    reason: str
    remark: str = ""
    enough: bool = True


def at_rest(
    tables: Mapping[str, Any],
    meshes: Mapping[str, TriangleMesh],
    thickness_mm: Mapping[str, float],
    rest: Callable[[ElasticFoundation], tuple[Array, str]],
) -> Resting:
    """The scene of the tables at rest, its fields so fine that finer ones would change its forces there by less than
    1 %.

    thickness_mm: of both bodies, infinite for open surfaces. rest: gives the pose at rest and why there is none.
    """
    usual = tables["geometry"].get("spacing", SPACING_MM)
    tried = []
    for share in _SHARES:
        each = {body: min(usual, round(share * thickness, 3)) for body, thickness in thickness_mm.items()}
        if each not in tried:
            tried.append(each)
    model = _model(tables, tried[0])
    found = Resting(model, *rest(model))
    for coarse, fine in itertools.pairwise(tried):
        words = f"a distance field of {_words(coarse, usual)} mm, as thin bodies need"
        if not all(field_fits(meshes[body], spacing) for body, spacing in fine.items()):
            remark = f"{words}: whether it is fine enough; one of {_words(fine, usual)} mm does not fit into memory"
            return Resting(found.model, found.pose, found.reason, remark, enough=False)
        finer = _model(tables, fine)
        forces, other = (model.wrenches(found.pose)[..., :3] for model in (found.model, finer))
        change = float(np.linalg.norm(other - forces)) / max(float(np.linalg.norm(forces)), 1e-300)
        if change < _ENOUGH and forces.any():
            remark = f"{words}: one of {_words(fine, usual)} mm changes the forces at rest by {change:.1%}"
            return Resting(found.model, found.pose, found.reason, remark)
        remark = f"a distance field of {_words(fine, usual)} mm, as thin bodies need: one of {_words(coarse, usual)} "
        found = Resting(finer, *rest(finer), f"{remark}mm changes the forces at rest by {change:.1%}")
        if change < _FALLS * _ENOUGH and forces.any():
            break
    return found


def _model(tables: Mapping[str, Any], spacing_mm: Mapping[str, float]) -> ElasticFoundation:
    each = set(spacing_mm.values())
    spacing = each.pop() if len(each) == 1 else dict(spacing_mm)
    return ElasticFoundation(Scene.from_tables({**tables, "geometry": {**tables["geometry"], "spacing": spacing}}))


def _words(spacing_mm: Mapping[str, float], usual: float) -> str:
    """The spacings that differ from the usual one."""
    return " and ".join(f"{spacing:g}" for spacing in spacing_mm.values() if spacing < usual) or f"{usual:g}"
