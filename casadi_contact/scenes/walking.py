"""The built-in reference motion: walking cycles from a low-order harmonic description.

Each curve of a cycle is c_0 + Σ_k c_{2k-1} cos(2πkp) + c_{2k} sin(2πkp) over the share p of the cycle, with
coefficients drawn about their mean with their deviation between measured cycles. Forces are described by the
logarithm of their compression, so that none pulls; the medial-lateral centre of pressure by its distance from the
point that the two condyles' forces at z = ±22 mm give, so that it stays reachable. The rotation ry is one curve for
all cycles [EF15 §3.3]. The figures and their source stand in ``walking.toml``.
"""

import tomllib
from collections.abc import Mapping, Sequence
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.scenes.cycle import CONDYLE_MM, Cycle, driving_loads, harmonic_curve, read_cycle, scene_cycles
from casadi_contact.scenes.scene import Scene

CURVES = ("rz", "ry", "log_fy_med", "log_fy_lat", "cop_ap_mm", "cop_shift_mm")


def walking_description() -> dict[str, Any]:
    """The figures of ``walking.toml``."""
    return tomllib.loads((resources.files(__package__) / "walking.toml").read_text("utf-8"))


def reference_cycle(frames: int = 101) -> Cycle:
    """The mean cycle of the built-in reference motion."""
    return _cycle(walking_description(), "reference", frames, None)


def reference_cycles(count: int = 14, frames: int = 101, seed: int = 2015) -> list[Cycle]:
    """`count` cycles of the built-in reference motion (the paper's envelopes come from 14), the same for a seed."""
    figures, rng = walking_description(), np.random.default_rng(seed)
    return [_cycle(figures, f"reference {k + 1}", frames, rng) for k in range(count)]


def _cycle(figures: Mapping[str, Any], name: str, frames: int, rng: np.random.Generator | None) -> Cycle:
    """The mean cycle, or with a generator a random one about it."""
    curves = {}
    for key in CURVES:
        coefficients = np.array(figures[key]["mean"])
        if rng is not None and key != "ry":
            coefficients = coefficients + rng.standard_normal(len(coefficients)) * figures[key]["deviation"]
        curves[key] = harmonic_curve(coefficients, np.linspace(0.0, 1.0, frames))
    mean, deviation = figures["duration_s"]
    duration = mean + (rng.standard_normal() * deviation if rng is not None else 0.0)
    fy_med, fy_lat = -np.exp(curves["log_fy_med"]), -np.exp(curves["log_fy_lat"])
    centres = {
        "cop_ap": curves["cop_ap_mm"],
        "cop_ml": curves["cop_shift_mm"] + CONDYLE_MM * (fy_med - fy_lat) / (fy_med + fy_lat),
    }
    pose, forces = {"ry": curves["ry"], "rz": curves["rz"]}, {"Fy_med": fy_med, "Fy_lat": fy_lat}
    return Cycle(name, np.linspace(0.0, duration, frames), pose, forces, centres)


def has_gait(scene: Scene) -> bool:
    """True for a knee without a motion of its own: its cycles are a knee's, and the built-in ones walking."""
    return not scene.motion and {"Fy_med", "Fy_lat"} <= set(driving_loads(scene))


def reference_motion_cycles(scene: Scene, cycle_files: Sequence[Path]) -> list[Cycle]:
    """The cycles in the files, or the built-in ones: the scene's own [motion], for a knee without one its walking."""
    built_in = reference_cycles if has_gait(scene) else partial(scene_cycles, scene)
    return [read_cycle(path, scene) for path in cycle_files] or built_in()
