"""The loads of a knee with two sides, and whether a scene is one."""

from __future__ import annotations

from collections.abc import Sequence

from casadi_contact.scenes import Scene

SIDES = ("Fy_med", "Fy_lat")
KNEE_LOADS = (*SIDES, "Fx", "Fz", "Tx", "Ty", "Tz")


def check_knee(what: str, scene: Scene, load_names: Sequence[str], needed: Sequence[str] = KNEE_LOADS) -> None:
    """ValueError for a contact model of a scene whose loads (L,) are not those needed of a knee that carries on two
    sides, or that locks or ties pose parameters; what: the problem that needs such a knee, with its article."""
    if not set(needed) <= set(load_names):
        raise ValueError(
            f"{what} needs a knee with two sides, but scene {scene.name} has the loads {', '.join(load_names)}, "
            f"expected {', '.join(needed)}: take the scene knee or one like it"
        )
    scene.pose_space.check_whole(what)
