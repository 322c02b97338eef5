"""Load that a verdict cannot know of, since all models of a scene treat it alike, by where it lies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from casadi_contact.contact.elements.foundation import TELLING_SHARE, ElasticFoundation, share_at_sharp_edges
from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.verification.open_edges import share_beyond_open_edges
from casadi_contact.optimisation.verification.walls import share_on_walls, share_outside_patches


class _Place(NamedTuple):
    """What tells the share of the load that lies there, what to say of it, and the least share that is told."""

    share: Callable[[ElasticFoundation, Array], Array]
    words: str
    least: float = 0.01


_PLACES = {
    "beyond_open_edges": _Place(
        share_beyond_open_edges,
        "beyond open edges of the moving mesh, where its surface is taken to round off: a part that ends there carries "
        "less",
    ),
    "on_walls": _Place(
        share_on_walls,
        "on walls of the fixed mesh steeper than 78 degrees, such as a post's, or on faces turned away from "
        "geometry.pressing, where there are no elements: it is not counted; geometry.cup_centre on the axis of a notch "
        "or in the middle of a cup counts it, elsewhere a patch of its own there, with its own "
        "geometry.patches.NAME.pressing",
    ),
    "outside_patches": _Place(
        share_outside_patches,
        "on the fixed mesh outside of all patches, where there are no elements: it is not counted; wider bounds in "
        "geometry.patches.NAME count it, as does a patch of its own there",
    ),
    "at_sharp_edges": _Place(
        share_at_sharp_edges,
        "at sharp edges of the moving mesh, which its distance field rounds off: up to that share of the load may be "
        "wrong; a finer geometry.spacing.moving mends it, and a smoother mesh where they are a scan's noise",
        least=TELLING_SHARE,
    ),
}

_UNCOUNTED = share_on_walls, share_outside_patches  # of triangles that are not the same


def uncertain_load_shares(model: ElasticFoundation, poses: Array) -> dict[str, Array]:
    """Shares (n,) of the load in poses (n, 6): beyond_open_edges and at_sharp_edges of the moving mesh, on_walls and
    outside_patches of the fixed one. Raises ValueError for bad poses."""
    return {where: place.share(model, poses) for where, place in _PLACES.items()}


def uncounted_share(model: ElasticFoundation, poses: Array) -> Array:
    """Share of the load (n,) in poses (n, 6) that lies where no model of the scene counts any, on walls and outside of
    all patches together: each of the two is a share of itself and what is counted. Raises ValueError for bad poses."""
    with np.errstate(divide="ignore"):  # where none is counted a share is 1
        to_counted = sum(share / (1.0 - share) for share in (of(model, poses) for of in _UNCOUNTED))
    return np.asarray(1.0 - 1.0 / (1.0 + to_counted))


def uncertain_load_words(shares: Mapping[str, Array]) -> dict[str, str]:
    """Of those of `uncertain_load_shares` that are not too small to tell, by where the load lies: in how many poses it
    does, and how much of it at most."""
    said = {}
    for where, share in shares.items():
        if count := int((share > _PLACES[where].least).sum()):
            said[where] = (
                f"in {count} of {len(share)} frames up to {share.max():.0%} of the load lies {_PLACES[where].words}"
            )
    return said
