"""A joint as one HTML file that works offline: all its data, its kernel as WebAssembly, and the code that draws."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from importlib.metadata import version
from string import Template
from typing import Any

import numpy as np

from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import POSE_NAMES, Array
from casadi_contact.core.quantities import quantity
from casadi_contact.pictures.contact_picture import contact_pose
from casadi_contact.pictures.drawn_bodies import (
    FixedSurface,
    Triangles,
    fixed_surfaces,
    map_view,
    moving_body,
    pose_words,
)
from casadi_contact.pictures.page import patch_title
from casadi_contact.pictures.page_model import packed, page_contact, page_kernel
from casadi_contact.samples.reference import reference_poses
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.scenes.pose_file import read_poses_over_time
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.walking import has_gait, reference_motion_cycles
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.load import load_surrogate, ready_surrogates

_LEAST_REACH = np.array([3.0, 3.0, 3.0, 0.1, 0.1, 0.1])  # of a slider to either side of the cycle's poses [mm, rad]


@dataclass(frozen=True, eq=False)
class PageCycle:
    """poses (n, 6) over time_s (n,), and where they come from in words."""

    time_s: Array
    poses: Array
    source: str


def page_cycle(model: ContactModel, path: str | None) -> PageCycle:
    """The poses of a file, or those that carry the scene's first reference cycle; one pose for a scene without. Poses
    of a file without times are taken to be evenly spaced over one second."""
    scene = model.scene
    if path is not None:
        time_s, poses = read_poses_over_time(path)
        even = np.linspace(0.0, 1.0, len(poses))
        return PageCycle(even if time_s is None else time_s, poses, f"{len(poses)} poses of a file")
    if not scene.motion and not has_gait(scene):
        return PageCycle(np.zeros(1), contact_pose(ElasticFoundation(scene))[None], "a pose in contact")
    cycle = reference_motion_cycles(scene, ())[0]
    poses, report = reference_poses(model, [cycle])
    return PageCycle(
        np.linspace(cycle.time_s[0], cycle.time_s[-1], len(poses[0])), poses[0], "; ".join(str(report).splitlines())
    )


def slider_ranges(poses: Array, surrogate: Surrogate | None) -> Array:
    """Lowest and highest of each pose parameter (6, 2): what was learned, or the cycle's poses (n, 6) and some."""
    learned = {} if surrogate is None else surrogate.record.get("pose_range", {})
    if set(POSE_NAMES) <= set(learned):
        return np.array([learned[name] for name in POSE_NAMES], dtype=float)
    low, high = poses.min(axis=0), poses.max(axis=0)
    reach = np.maximum(0.25 * (high - low), _LEAST_REACH)
    return np.stack([low - reach, high + reach], 1)


def settled_by(scene: Scene) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Free pose parameters and target loads of the page's settling: none where their numbers differ."""
    free, target = scene.sensitive_pose, tuple(name for name in scene.sensitive_loads if name in scene.load_names)
    return (free, target) if free and len(free) == len(target) else ((), ())


_LIBRARY = ("third_party", "twgl-full.js")
# In the order in which each can use those before it.
_MODULES = (
    *("format.js", "linear.js", "kernel.js", "settle.js", "canvas.js", "scene.js"),
    *("map.js", "section.js", "controls.js", "panel.js", "timeline.js", "save.js", "main.js"),
)
_IMPORT = re.compile(r"^import .*? from \"\./\w+\.js\";\n", re.MULTILINE | re.DOTALL)
_COLOURS = 64


def joint_page(scene: str, poses: str | None = None, surrogate: str | None = None) -> tuple[str, PageCycle]:
    """HTML of a scene, and the cycle that it shows. poses: a file of poses to scrub through, the scene's reference
    cycle if left out. surrogate: a ready name or file, the shipped one of the scene, if any, if left out. Raises
    ValueError for a surrogate of another scene and for a scene without `cc.foundation`, ImportError without the extra
    `page`."""
    contact = page_contact(load_scene(scene))
    learned, python = _surrogate(contact, surrogate)
    python = python or f"cc.foundation({scene!r})"
    cycle = page_cycle(contact, poses)
    surfaces, moving = fixed_surfaces(contact), moving_body(contact.scene)
    library = np.frombuffer(_text(*_LIBRARY).encode(), dtype=np.uint8)
    index, arrays = packed({"library": library, **_arrays(contact, learned, surfaces, moving)})
    content = _content(contact, learned, cycle, surfaces) | {"arrays": index, "python": python}
    words = {
        "title": escape(f"{contact.scene.name}: contact live"),
        "scene": escape(contact.scene.name),
        "models": escape(f"contact model: {contact!r}" + (f", {learned.title}" if learned else "")),
        "source": escape(f"{cycle.source}. Written by casadi_contact {version('casadi_contact')}."),
        "style": _text("web", "style.css"),
        "content": json.dumps(content, separators=(",", ":")).replace("<", "\\u003c"),
        "arrays": arrays,
        "modules": page_script(),
    }
    return Template(_text("web", "page.html")).substitute(words), cycle


def page_script() -> str:
    """The page's modules as one: each file's imports are those before it."""
    texts = [_IMPORT.sub("", _text("web", name)) for name in _MODULES]
    return "\n".join(re.sub(r"^export ", "", text, flags=re.MULTILINE) for text in texts)


def _text(*path: str) -> str:
    return resources.files(__package__).joinpath(*path).read_text("utf-8")


def _surrogate(contact: CompiledFoundation, given: str | None) -> tuple[Surrogate | None, str]:
    """The surrogate and the Python that loads it; none and no text where the scene has none."""
    scene = contact.scene
    name = given or (scene.name if scene.name in ready_surrogates() else None)
    surrogate = load_surrogate(name) if name else None
    if surrogate is None or surrogate.scene.digest == scene.digest:
        return surrogate, f"cc.load_surrogate({name!r})" if surrogate else ""
    if given:
        raise ValueError(f"{name} is of another scene ({surrogate.scene.name}): give the scene file it was built from")
    return None, ""


def _arrays(
    contact: CompiledFoundation, surrogate: Surrogate | None, surfaces: Sequence[FixedSurface], moving: Triangles
) -> dict[str, np.ndarray]:
    arrays: dict[str, np.ndarray] = {"kernel": np.frombuffer(page_kernel(contact, surrogate), dtype=np.uint8)}
    named = dict(zip(contact.patch_names, surfaces, strict=True))
    behind = [surface.triangles.behind(contact.scene.material.thickness) for surface in surfaces]
    parts = {f"patch_{name}": surface.triangles for name, surface in named.items()}  # a patch may be named "moving"
    for name, part in {**parts, "behind": Triangles.together(behind), "moving": moving}.items():
        arrays[f"{name}_points"] = np.round(part.points_mm, 2).astype(np.float32)
        arrays[f"{name}_normals"] = np.round(part.normals, 2).astype(np.float32)
        arrays[f"{name}_corners"] = part.corners.astype(np.uint32)
    for name, surface in named.items():
        arrays[f"patch_{name}_places"] = surface.places
    return arrays


def _content(
    contact: CompiledFoundation, surrogate: Surrogate | None, cycle: PageCycle, surfaces: Sequence[FixedSurface]
) -> dict[str, Any]:
    from matplotlib import colormaps

    scene = contact.scene
    free, target = settled_by(scene)
    pressed = normal_forces(scene.normal_loads, contact.wrenches(cycle.poses)).sum(axis=1)
    stance = int(pressed.argmax())
    points = np.concatenate([surface.triangles.points_mm for surface in surfaces])
    start = contact(cycle.poses[stance])
    return {
        "scene": scene.name,
        "patches": [
            {"name": name, "title": patch_title(name) if len(scene.patch_names) > 1 else "surfaces"}
            for name in scene.patch_names
        ],
        "loads": [
            {"name": load, "unit": quantity(load).unit, "column": quantity(load).column} for load in scene.load_names
        ],
        "surrogateLoads": None if surrogate is None else list(surrogate.load_names),
        "sensitive": [name for name in scene.sensitive_loads if name in scene.load_names],
        "referenceLoad": scene.reference_load,
        "gapSlope": scene.gap_slope,
        "normals": [
            {"loads": list(normal.loads), "directed": normal.component is not None, "sign": normal.sign}
            for normal in scene.normal_loads
        ],
        "pose": pose_words(scene.shape, slider_ranges(cycle.poses, surrogate)),
        "space": None
        if (space := scene.pose_space).unconstrained
        else {"matrix": space.matrix.tolist(), "offset": space.offset.tolist()},
        "presets": {"stance": stance, "swing": int(pressed.argmin())},
        "settle": {
            "free": list(free),
            "loads": list(target),
            "start": [float(start[scene.load_names.index(name)]) for name in target],
        },
        "cycle": {"time": cycle.time_s.tolist(), "poses": cycle.poses.tolist()},
        "view": map_view(ElasticFoundation(scene, scene.grids.get("coarse")), points),
        "colours": np.round(colormaps["YlOrRd"](np.linspace(0.0, 1.0, _COLOURS))[:, :3], 3).tolist(),
    }
