"""The scene files that come with the library."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from typing import Any

from casadi_contact.core.files.reading import toml_tables


def ready_scenes() -> list[str]:
    """Names of the scenes that come with the library."""
    folder = resources.files("casadi_contact.scenes") / "ready"
    texts = {p.name[:-5]: p.read_text("utf-8") for p in folder.iterdir() if p.name.endswith(".toml")}
    return sorted(name for name, text in texts.items() if "shape = " in text or "like = " in text)


def ready_text(name: str) -> str:
    """The text of a ready-made scene; raises ValueError for an unknown name."""
    if name not in ready_scenes():
        possible = ", ".join(ready_scenes())
        raise ValueError(f"unknown scene {name!r}, expected one of {possible}, or a path to a .toml file")
    return (resources.files("casadi_contact.scenes") / "ready" / f"{name}.toml").read_text("utf-8")


def ready_tables(name: str) -> Mapping[str, Any]:
    """The tables of a ready-made scene; raises ValueError likewise."""
    return toml_tables(ready_text(name), "scene")
