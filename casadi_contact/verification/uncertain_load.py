"""Load that a verdict cannot know of, since all models of a scene treat it alike, by where it lies."""

from __future__ import annotations

from collections.abc import Mapping

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import Array
from casadi_contact.verification.open_edges import share_beyond_open_edges, words_beyond_open_edges
from casadi_contact.verification.sharp_edges import share_at_sharp_edges, words_at_sharp_edges
from casadi_contact.verification.walls import (
    share_on_walls,
    share_outside_patches,
    words_on_walls,
    words_outside_patches,
)

_WHERE = {
    "beyond_open_edges": (share_beyond_open_edges, words_beyond_open_edges),
    "on_walls": (share_on_walls, words_on_walls),
    "outside_patches": (share_outside_patches, words_outside_patches),
    "at_sharp_edges": (share_at_sharp_edges, words_at_sharp_edges),
}


def uncertain_load_shares(model: ElasticFoundation, poses: Array) -> dict[str, Array]:
    """Shares (n,) of the load in poses (n, 6): beyond_open_edges and at_sharp_edges of the moving mesh, on_walls and
    outside_patches of the fixed one. Raises ValueError for bad poses."""
    return {where: share(model, poses) for where, (share, _) in _WHERE.items()}


def uncertain_load_words(shares: Mapping[str, Array]) -> dict[str, str]:
    """In words those of `uncertain_load_shares` that are not too small to tell, by where the load lies."""
    said = {where: _WHERE[where][1](share) for where, share in shares.items()}
    return {where: words for where, words in said.items() if words}
