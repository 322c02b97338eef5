"""Scenes: what is in contact, of which material, and which loads are wanted how precisely."""

from casadi_contact.scenes.material import Material
from casadi_contact.scenes.scene import Scene, load_scene, ready_scenes

__all__ = ["Material", "Scene", "load_scene", "ready_scenes"]
