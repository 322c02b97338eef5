"""In words: a share of the load that a verdict cannot know of, since all models of a scene treat it alike."""

from __future__ import annotations

from casadi_contact.conventions import Array

WORTH_A_WORD = 0.01  # of the load


def share_in_words(share: Array, where: str) -> str | None:
    """In how many poses more than `WORTH_A_WORD` of the load, by its share (n,), lies there, and how much at most; None
    for none."""
    if not (count := int((share > WORTH_A_WORD).sum())):
        return None
    return f"in {count} of {len(share)} frames up to {share.max():.0%} of the load lies {where}"
