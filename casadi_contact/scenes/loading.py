"""A scene by the name of a ready one or by the path of its file."""

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from casadi_contact.core.files.reading import toml_tables, toml_text
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.checks import fail
from casadi_contact.scenes.shapes.shape import shape_named


def load_scene(name_or_path: str | Path, /, **overrides: Any) -> Scene:
    """Load a ready-made scene by name, or a scene file by its path; keywords replace single parameters:
    ``load_scene("sphere_on_plane", radius=25.0)``. Raises ValueError, FileNotFoundError for a missing file."""
    text_name = str(name_or_path)
    text = toml_text(Path(name_or_path), "scene") if text_name.endswith(".toml") else ready_text(text_name)
    try:
        scene = scene_from_text(text)
        given = scene.tables["geometry"]
        located = shape_named(scene.shape).locate_files(given, Path(name_or_path).resolve().parent)
        if located is not given:
            scene = Scene.from_tables({**scene.tables, "geometry": located})
    except ValueError as error:
        raise ValueError(f"{text_name}: {error}") from None
    return scene.with_overrides(**overrides) if overrides else scene


def scene_from_text(text: str) -> Scene:
    """A scene of TOML text that may name a ready-made scene with ``like``; raises ValueError as `load_scene` does."""
    return Scene.from_tables(completed(toml_tables(text, "scene")))


def ready_scenes() -> list[str]:
    """Names of the scenes that come with the library."""
    folder = resources.files("casadi_contact.scenes") / "ready"
    return sorted(path.name[:-5] for path in folder.iterdir() if path.name.endswith(".toml"))


def ready_text(name: str) -> str:
    """The text of a ready-made scene; raises ValueError for an unknown name."""
    if name not in ready_scenes():
        possible = ", ".join(ready_scenes())
        raise ValueError(f"unknown scene {name!r}, expected one of {possible}, or a path to a .toml file")
    return (resources.files("casadi_contact.scenes") / "ready" / f"{name}.toml").read_text("utf-8")


def completed(tables: Mapping[str, Any]) -> Mapping[str, Any]:
    """The tables of a scene with those of the ready-made scene that its key ``like`` names, if it has one. Tables are
    combined key by key, except [tolerances]; if left out, those of the scene's loads are taken."""
    if "like" not in tables:
        return tables
    name = tables["like"]
    if not isinstance(name, str):
        raise fail("like", name, "the name of a ready-made scene")
    whole = dict(completed(toml_tables(ready_text(name), "scene")))
    for key, value in tables.items():
        before = whole.get(key)
        if isinstance(before, Mapping) and isinstance(value, Mapping) and key != "tolerances":
            value = {**before, **value}
        whole[key] = value
    del whole["like"]
    if "tolerances" not in tables and isinstance(whole["loads"], Mapping):
        names = whole["loads"]["names"]
        whole["tolerances"] = {load: value for load, value in whole["tolerances"].items() if load in names}
    return whole
