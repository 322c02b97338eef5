"""Find and load a surrogate by name or path."""

import warnings
from collections.abc import Mapping
from importlib import resources
from pathlib import Path

from casadi_contact.core.files.reading import one_line
from casadi_contact.scenes.loading import ready_scenes
from casadi_contact.scenes.material import FRICTION_NAMES
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.file import read_file
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from casadi_contact.surrogate.two_stage import TwoStageSurrogate

STRUCTURES: dict[str, type[Surrogate]] = {kind.structure: kind for kind in (PatchSurrogate, TwoStageSurrogate)}
"""The structures, by name: a new structure is its own class and one of these."""


def ready_surrogates() -> list[str]:
    """Names of the surrogates that come with the library."""
    folder = resources.files("casadi_contact.surrogate") / "ready"
    return sorted(entry.name[:-3] for entry in folder.iterdir() if entry.name.endswith(".h5"))


def load_surrogate(name_or_path: str | Path, *, compiled: bool = True, **friction: float) -> Surrogate:
    """Load a ready-made surrogate by name ("knee"), or a surrogate file by its path (ending in .h5).

    compiled: False for arrays of poses in NumPy however many they are; else `BATCH_FROM` poses or more go through a C
    kernel on all cores, which the first such call compiles and says so.

    friction: coefficients in place of its scene's (`scenes.material.FRICTION_NAMES`): dynamic_friction=0.05.

    A surrogate whose errors on held-back samples exceed the scene's tolerances (`fitness`) is loaded with a warning.
    Raises ValueError for an unknown name and for a foreign, newer or damaged file; FileNotFoundError for no file.
    """
    text = str(name_or_path)
    if isinstance(name_or_path, Path) or text.endswith(".h5") or "/" in text:
        return _load(Path(name_or_path), compiled, friction)
    if text not in ready_surrogates():
        known, cure = ", ".join(ready_surrogates()), ""
        if text in ready_scenes():
            cure = f"; scene {text} needs none: cc.foundation({text!r}), in problems --scene {text}"
        raise ValueError(f"unknown surrogate {text!r}, expected one of {known}, or a path to a .h5 file{cure}")
    with resources.as_file(resources.files("casadi_contact.surrogate") / "ready" / f"{text}.h5") as path:
        surrogate = _load(path, compiled, friction)
    surrogate.ready_name = text
    return surrogate


def _load(path: Path, compiled: bool, friction: Mapping[str, float]) -> Surrogate:
    if learned := sorted(set(friction) - set(FRICTION_NAMES)):
        raise ValueError(f"{', '.join(learned)} of a surrogate, expected some of {', '.join(FRICTION_NAMES)}")
    content = read_file(path)
    if content.structure not in STRUCTURES:
        raise ValueError(f"{path} holds a {content.structure!r} surrogate, expected one of {', '.join(STRUCTURES)}")
    try:
        kind = STRUCTURES[content.structure]
        scene = content.scene.with_overrides(**friction) if friction else content.scene
        surrogate = kind(scene, content.networks, content.record, content.confidence, compiled=compiled)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    info = surrogate.info()
    try:
        verdict, _ = info.fitness, str(info)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: its record is not of this version ({one_line(error)}): build it again") from None
    if verdict.errors and not verdict.usable:
        warnings.warn(f"{path}: {verdict}", UserWarning, stacklevel=3)
    return surrogate
