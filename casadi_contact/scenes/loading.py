"""A scene by the name of a ready one or by the path of its file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from casadi_contact.core.files.reading import toml_text
from casadi_contact.scenes.ready_files import ready_text
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.registry import shape_named


def load_scene(name_or_path: str | Path, /, **overrides: Any) -> Scene:
    """Load a ready-made scene by name, or a scene file by its path; keywords replace single parameters:
    ``load_scene("sphere_on_plane", radius=25.0)``.

    Raises ValueError for an unknown name, an unknown key or a bad value, FileNotFoundError for a missing file.
    """
    text_name = str(name_or_path)
    text = toml_text(Path(name_or_path), "scene") if text_name.endswith(".toml") else ready_text(text_name)
    try:
        scene = Scene.from_toml(text)
        given = scene.tables["geometry"]
        located = shape_named(scene.shape).locate_files(given, Path(name_or_path).resolve().parent)
        if located is not given:
            scene = Scene.from_tables({**scene.tables, "geometry": located})
    except ValueError as error:
        raise ValueError(f"{text_name}: {error}") from None
    return scene.with_overrides(**overrides) if overrides else scene
