"""Names of the networks of a patch, or of one of its parts."""

from __future__ import annotations

_ROOT = "root_"


def root_name(part: str) -> str:
    """Name of the root load network of a patch or part: root_med."""
    return f"{_ROOT}{part}"


def is_root(name: str) -> bool:
    """True for the network of a root load."""
    return name.startswith(_ROOT)


def ratios_name(part: str) -> str:
    """Name of the network of all ratios of a patch or part: ratios_med."""
    return f"ratios_{part}"
