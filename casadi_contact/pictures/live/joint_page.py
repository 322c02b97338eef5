"""A joint as one HTML file that works offline: all its data, its kernel as WebAssembly, and the code that draws."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from html import escape
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.files.writing import write_text
from casadi_contact.core.quantities import quantity
from casadi_contact.pictures.live.contact_model import packed, page_contact, page_kernel
from casadi_contact.pictures.live.cycle import PageCycle, page_cycle, presets, settled_by, slider_ranges
from casadi_contact.pictures.live.fixed_surface import FixedSurface, Triangles, fixed_surfaces
from casadi_contact.pictures.live.moving_body import map_view, moving_body, pose_words
from casadi_contact.pictures.page import patch_title
from casadi_contact.scenes.loading import load_scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.workflow.project import shipped_surrogate

_LIBRARY = ("third_party", "twgl-full.js")
# In the order in which each can use those before it.
_MODULES = (
    *("format.js", "linear.js", "assets.js", "kernel.js", "settle.js", "canvas.js", "pace.js", "scene.js"),
    *("covered.js", "map.js", "section.js", "controls.js", "panel.js", "timeline.js", "save.js", "main.js"),
)
_IMPORT = re.compile(r"^import .*? from \"\./\w+\.js\";\n", re.MULTILINE | re.DOTALL)
_COLOURS = 64
_PRESETS_FIRST = "stance"


def write_joint_page(scene: str, path: Path, poses: str | None = None, surrogate: str | None = None) -> PageCycle:
    """Write `joint_page` of a scene (name or file); return its cycle. Raises OSError where it cannot be written."""
    html, cycle = joint_page(scene, poses, surrogate)
    write_text(path, html)
    return cycle


def joint_page(scene: str, poses: str | None = None, surrogate: str | None = None) -> tuple[str, PageCycle]:
    """HTML of a scene, and the cycle that it shows.

    poses: a file of poses to scrub through, the scene's reference cycle if left out. surrogate: a ready name or file,
    the shipped one of the scene, if any, if left out. Raises ValueError for a surrogate of another scene and for a
    scene without `cc.foundation`, ImportError without the extra `page`.
    """
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
        "models": escape(_models(contact, learned)),
        "moving": "moving body",
        "fixed": "fixed body",
        "source": escape(f"{cycle.source}. Written by casadi_contact {version('casadi_contact')}."),
        "style": _text("web", "style.css"),
        "content": json.dumps(content, separators=(",", ":")).replace("</", "<\\/"),
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


def _surrogate(contact: CompiledFoundation, name: str | None) -> tuple[Surrogate | None, str]:
    """The surrogate and the Python that loads it; none and no text where the scene has none."""
    if name is None:
        shipped = shipped_surrogate(contact.scene)
        return (shipped, f"cc.load_surrogate({contact.scene.name!r})") if shipped else (None, "")
    surrogate = load_surrogate(name)
    if surrogate.scene.digest != contact.scene.digest:
        raise ValueError(
            f"the surrogate {name} was trained for another scene ({surrogate.scene.name}) than {contact.scene.name}: "
            "name the scene file that it was built from"
        )
    return surrogate, f"cc.load_surrogate({name!r})"


def _models(contact: CompiledFoundation, surrogate: Surrogate | None) -> str:
    learned = "" if surrogate is None else f", {surrogate.title}"
    return f"contact model: {contact!r}{learned}"


def _arrays(
    contact: CompiledFoundation, surrogate: Surrogate | None, surfaces: Sequence[FixedSurface], moving: Triangles
) -> dict[str, np.ndarray]:
    arrays: dict[str, np.ndarray] = {"kernel": np.frombuffer(page_kernel(contact, surrogate), dtype=np.uint8)}
    named = dict(zip(contact.patch_names, surfaces, strict=True))
    behind = [surface.coarse.behind(contact.scene.material.thickness) for surface in surfaces]
    parts = {f"patch_{name}": surface.triangles for name, surface in named.items()}  # a patch may be named "moving"
    for name, part in {**parts, "behind": Triangles.together(behind), "moving": moving}.items():
        arrays[f"{name}_points"] = np.round(part.points_mm, 2).astype(np.float32)
        arrays[f"{name}_normals"] = np.round(part.normals, 2).astype(np.float32)
        arrays[f"{name}_corners"] = part.corners.astype(np.uint32)
    for name, surface in named.items():
        arrays[f"patch_{name}_coarse"] = surface.coarse.corners.astype(np.uint32)
        arrays[f"patch_{name}_places"] = surface.places
    return arrays


def _content(
    contact: CompiledFoundation, surrogate: Surrogate | None, cycle: PageCycle, surfaces: Sequence[FixedSurface]
) -> dict[str, Any]:
    scene = contact.scene
    ranges, why = slider_ranges(cycle.poses, surrogate)
    free, target = settled_by(scene)
    begun = presets(contact, cycle.poses)
    points = np.concatenate([surface.triangles.points_mm for surface in surfaces])
    extent = 0.5 * float(np.linalg.norm(np.ptp(points, axis=0)))
    start = contact(begun[_PRESETS_FIRST])
    return {
        "scene": scene.name,
        "patches": [{"name": name, "title": patch_title(name)} for name in scene.patch_names],
        "loads": [
            {"name": load, "unit": quantity(load).unit, "column": quantity(load).column} for load in scene.load_names
        ],
        "surrogateLoads": None if surrogate is None else list(surrogate.load_names),
        "modelLoads": list((surrogate or contact).load_names),
        "sensitive": [name for name in scene.sensitive_loads if name in scene.load_names],
        "referenceLoad": scene.reference_load,
        "gapSlope": scene.gap_slope,
        "normals": [
            {"loads": list(normal.loads), "directed": normal.component is not None, "sign": normal.sign}
            for normal in scene.normal_loads
        ],
        "pose": pose_words(scene.shape, ranges),
        "space": None
        if (space := scene.pose_space).unconstrained
        else {"matrix": space.matrix.tolist(), "offset": space.offset.tolist()},
        "range": why,
        "presets": {name: pose.tolist() for name, pose in begun.items()},
        "settle": {
            "free": list(free),
            "loads": list(target),
            "start": [float(start[scene.load_names.index(name)]) for name in target],
        },
        "cycle": {"time": cycle.time_s.tolist(), "poses": cycle.poses.tolist()},
        "view": map_view(ElasticFoundation(scene, scene.grids.get("coarse")), extent),
        "colours": _colours(),
    }


def _colours() -> list[list[float]]:
    from matplotlib import colormaps

    return np.round(colormaps["YlOrRd"](np.linspace(0.0, 1.0, _COLOURS))[:, :3], 3).tolist()
