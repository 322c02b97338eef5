"""In words: a share of the load that a verdict cannot know of, since all models of a scene treat it alike."""

from __future__ import annotations

from casadi_contact.conventions import Array

_REPORTED = 0.01  # of the load: a smaller share is left out


def share_in_words(share: Array, where: str, least: float = _REPORTED) -> str | None:
    """In how many poses more than the least share of the load, by its share (n,), lies there, and how much at most;
    None where in none."""
    if not (count := int((share > least).sum())):
        return None
    return f"in {count} of {len(share)} frames up to {share.max():.0%} of the load lies {where}"
