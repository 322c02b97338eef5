"""The spacing of the distance fields of thin bodies, by a convergence test.

Half way through a body of thickness t its distance has a kink, which a cubic spline carries to both of its surfaces: at
a spacing of t/4 by up to 0.004 t, at 0.15 t by 0.0005 t. What that is of a load depends on how deep the bodies overlap.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Array
from casadi_contact.geometry.distance_field import SPACING_MM, field_fits
from casadi_contact.geometry.triangle_mesh import TriangleMesh
from casadi_contact.scenes.scene import Scene

_SHARES = (0.25, 0.15, 0.1)  # of the thickness
_FINER = 0.8  # times the one before, at most: fields that hardly differ tell nothing of each other
_ENOUGH = 0.01  # of the forces at rest
_ORDER = 4  # of the error in the spacing
_NEEDED = "a distance field of {}, as thin bodies need"


@dataclass(frozen=True, eq=False)
class Resting:
    """A scene's model and its pose at rest (6,), and why there is none ("" if there is); remark: on the spacing of its
    fields, "" where no body is thin; enough: False where nothing tells that they are fine enough."""

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
    """The scene of the tables at rest, with the coarsest fields that are fine enough.

    They are where finer ones change the forces at rest by less than 1 %, or where they changed those of coarser ones by
    less than 1 % of (h/h')⁴ - 1, h and h' the spacings: the error falls with the fourth power. ``enough`` is False
    where the finest that are tried and fit into memory are not, and where there are no forces at rest to tell.

    thickness_mm: of both bodies, infinite for open surfaces. rest: gives the pose at rest and why there is none.
    """
    usual = tables["geometry"].get("spacing", SPACING_MM)
    tried: list[dict[str, float]] = []
    for share in _SHARES:
        each = {body: min(usual, round(share * thickness, 3)) for body, thickness in thickness_mm.items()}
        if not tried or any(spacing < _FINER * tried[-1][body] for body, spacing in each.items()):
            tried.append(each)
    model = _model(tables, tried[0])
    found = Resting(model, *rest(model))
    for coarse, fine in itertools.pairwise(tried):
        before, now = (f"{_words(each, usual)} mm" for each in (coarse, fine))
        if not all(field_fits(meshes[body], spacing) for body, spacing in fine.items()):
            remark = f"{_NEEDED.format(before)}: whether it is fine enough; one of {now} does not fit into memory"
            return replace(found, remark=remark, enough=False)
        finer = _model(tables, fine)
        forces, other = (model.wrenches(found.pose)[..., :3] for model in (found.model, finer))
        if not forces.any():
            remark = f"{_NEEDED.format(now)}: whether it is fine enough; there are no forces at rest to tell"
            found = Resting(finer, *rest(finer), remark, enough=False)
            continue
        change = float(np.linalg.norm(other - forces) / np.linalg.norm(forces))
        if change < _ENOUGH:
            remark = f"{_NEEDED.format(before)}: one of {now} changes the forces at rest by {change:.1%}"
            return replace(found, remark=remark, enough=True)
        ratio = min(coarse[body] / spacing for body, spacing in fine.items() if spacing < coarse[body])
        enough = change < _ENOUGH * (ratio**_ORDER - 1.0)
        question = "" if enough else "whether it is fine enough; "
        remark = f"{_NEEDED.format(now)}: {question}one of {before} changes the forces at rest by {change:.1%}"
        found = Resting(finer, *rest(finer), remark, enough)
        if enough:
            break
    return found


def _model(tables: Mapping[str, Any], spacing_mm: Mapping[str, float]) -> ElasticFoundation:
    each = set(spacing_mm.values())
    spacing = each.pop() if len(each) == 1 else dict(spacing_mm)
    return ElasticFoundation(Scene.from_tables({**tables, "geometry": {**tables["geometry"], "spacing": spacing}}))


def _words(spacing_mm: Mapping[str, float], usual: float) -> str:
    """The spacings that differ from the usual one."""
    return " and ".join(f"{spacing:g}" for spacing in spacing_mm.values() if spacing < usual) or f"{usual:g}"
