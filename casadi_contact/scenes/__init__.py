"""Scenes: what is in contact, of which material, and which loads are wanted how precisely."""

from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.material import Material
from casadi_contact.scenes.ready_files import ready_scenes
from casadi_contact.scenes.scene import Scene

__all__ = ["Material", "Scene", "load_scene", "ready_scenes"]
