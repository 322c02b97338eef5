"""A joint as one HTML file that works offline: all its data, its kernel as WebAssembly, and the code that draws."""

import base64
import gzip
import json
import re
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from html import escape
from importlib import resources
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

import numpy as np

from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.contact.cells.source import cell_source
from casadi_contact.contact.choice import foundation
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.cup import CupFoundation
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.foundation_source import C_FOLDER
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.core.compiler import DATA_FILE, run_compiler
from casadi_contact.core.conventions import POSE_NAMES, Array
from casadi_contact.core.files.writing import write_bytes
from casadi_contact.core.quantities import quantity
from casadi_contact.export.c_source import c_source, header
from casadi_contact.geometry.distance_field import field_parts
from casadi_contact.geometry.moving_surface import MESH_FIELD, MovingSurface
from casadi_contact.networks.kernel.source import ExportedModel, c_text
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
from casadi_contact.samples.reference import reference_poses
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.scenes.pose_file import read_poses_over_time
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.walking import has_gait, reference_motion_cycles
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.load import load_surrogate, ready_surrogates

_KINDS = {"f4": np.float32, "f8": np.float64, "u4": np.uint32, "u1": np.uint8}
_ALIGNED = 8


def packed(arrays: Mapping[str, np.ndarray]) -> tuple[list[dict[str, Any]], str]:
    """An index of name, kind, offset and count of each array, and base64 of their bytes, compressed; always the same
    for the same arrays. Raises KeyError for a type that the page has none for."""
    kinds = {np.dtype(kind): name for name, kind in _KINDS.items()}
    index, data = [], b""
    for name, array in arrays.items():
        data += bytes(-len(data) % _ALIGNED)
        index.append({"name": name, "kind": kinds[array.dtype], "offset": len(data), "count": array.size})
        data += array.tobytes()
    return index, base64.b64encode(gzip.compress(data, compresslevel=9, mtime=0)).decode("ascii")


CONTACT, SURROGATE = "contact", "surrogate"
_FUNCTIONS = ("loads", "jacobian", "roots", "confidence")
_DEPTHS = ((PolarFoundation, "polar_depths.h"), (CupFoundation, "cup_depths.h"), (CellFoundation, "cells_depths.h"))


def page_kernel(contact: CompiledFoundation, surrogate: Surrogate | None) -> bytes:
    """WebAssembly of the exported C of both models, and of the contact model's pressures. Raises like `webassembly`,
    and ValueError for a pressure law without C."""
    exported = contact.exported()
    files: dict[str, str | bytes] = _files(exported, CONTACT)
    names = [f"{CONTACT}_{function}" for function in _FUNCTIONS]
    depths = next(name for kind, name in _DEPTHS if isinstance(contact, kind))
    names += [f"{CONTACT}_pressures", "foundation_pressures"]
    texts = [c_source(exported, CONTACT), *(c_text(name, C_FOLDER) for name in (depths, "depths.h"))]
    files[f"{CONTACT}.c"] = "\n".join(texts)
    if exported.data:
        files[DATA_FILE] = exported.data
    if surrogate is not None:
        files |= _files(surrogate.exported(), SURROGATE)
        names += [f"{SURROGATE}_{function}" for function in _FUNCTIONS]
    return webassembly(files, names)


def _files(model: ExportedModel, name: str) -> dict[str, str | bytes]:
    return {f"{name}.c": c_source(model, name), f"{name}.h": header(model, name)}


# No -ffast-math, as for every kernel. Vectors of 128 bits run in every browser since 2021 (Safari 2023).
_FLAGS = ("-std=gnu99", "-O2", "-g0", "-s", "-fno-math-errno", "-fno-trapping-math", "-msimd128", "-Wno-psabi")
_TARGET = ("-target", "wasm32-wasi", "-mexec-model=reactor")


def webassembly(files: Mapping[str, str | bytes], exports: Sequence[str]) -> bytes:
    """A WebAssembly module of C sources and what they include (by file name), with the named functions. It imports
    nothing; its memory from ``__heap_base`` on is the caller's."""
    if find_spec("ziglang") is None:
        raise ImportError("a page is compiled by ziglang, which is missing: pip install casadi_contact[page]")
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            write_bytes(Path(folder) / name, content.encode() if isinstance(content, str) else content)
        sources = [name for name in files if name.endswith(".c")]
        exported = [f"-Wl,--export={name}" for name in (*exports, "__heap_base")]
        command = [sys.executable, "-m", "ziglang", "cc", *_TARGET, *_FLAGS, "-o", "kernel.wasm", *sources, *exported]
        run_compiler(command, Path(folder))
        return (Path(folder) / "kernel.wasm").read_bytes()


FARTHEST_MM = 3.0  # at which the distance from a mesh ends: what lies farther off is as far
_NEAR_MM = 1.5  # of the surface: here the field counts for loads, farther off for gaps
_NEAR_STEP_MM, _FAR_STEP_MM = 2.0**-12, 2.0**-3  # that coefficients are rounded to, so that they compress
_CELLS = Cells(2.4, 0.85)


class PageCells(CellFoundation):
    """Cubic cells of meshes, the distance field rounded to about 0.1 µm near the surface, none beyond `FARTHEST_MM`."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene, _CELLS)
        self.patches = [
            replace(patch, body=MovingSurface(MESH_FIELD, _rounded(patch.body.parameters))) for patch in self.patches
        ]

    @cached_property
    def _code(self) -> tuple[str, bytes]:
        return cell_source(self.patches, with_tangents=False)


def page_contact(scene: Scene) -> CompiledFoundation:
    """`foundation` of a scene, or for meshes `PageCells`: the page's numbers are those of this model. Raises ValueError
    for a layer of varying thickness, of which no foundation gives pressures."""
    if scene.layer is not None and scene.varies:
        cure = "leave out material.thickness_map and geometry.backing"
        raise ValueError(f"scene {scene.name}: a page draws pressures, which need one thickness of the layer: {cure}")
    return PageCells(scene) if scene.shape == "mesh" else foundation(scene)


def _rounded(parameters: Array) -> Array:
    """A field's parameters with few digits: all that are needed near the surface, and hardly any elsewhere."""
    _, _, coefficients, bounds = field_parts(parameters)
    step = np.where(np.abs(coefficients) < _NEAR_MM, _NEAR_STEP_MM, _FAR_STEP_MM)
    rounded = np.clip(np.round(coefficients / step) * step, -FARTHEST_MM, FARTHEST_MM)
    head = parameters[: len(parameters) - 2 * coefficients.size]
    return np.concatenate([head, rounded.ravel(), bounds.ravel()])


_LEAST_REACH = np.array([3.0, 3.0, 3.0, 0.1, 0.1, 0.1])  # of a slider to either side of the cycle's poses [mm, rad]


class PageCycle(NamedTuple):
    """poses (n, 6) over time_s (n,), and a text that names their source."""

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
    (poses,), report = reference_poses(model, [cycle])
    times = np.linspace(cycle.time_s[0], cycle.time_s[-1], len(poses))
    return PageCycle(times, poses, "; ".join(str(report).splitlines()))


def slider_ranges(poses: Array, surrogate: Surrogate | None) -> Array:
    """Lowest and highest of each pose parameter (6, 2): what was learned, or the cycle's poses (n, 6) and some."""
    learned = {} if surrogate is None else surrogate.record.get("pose_range", {})
    if set(POSE_NAMES) <= set(learned):
        return np.array([learned[name] for name in POSE_NAMES], dtype=float)
    low, high = poses.min(axis=0), poses.max(axis=0)
    reach = np.maximum(0.25 * (high - low), _LEAST_REACH)
    return np.stack([low - reach, high + reach], 1)


_LIBRARY = ("third_party", "twgl-full.js")
# In the order in which each can use those before it.
_MODULES = ("canvas", "linear", "kernel", "settle", "scene", "views", "panel", "timeline", "save", "main")
_NOT_IN_ONE = re.compile(r"^import .*? from \"\./\w+\.js\";\n|^export ", re.MULTILINE | re.DOTALL)  # module of all
_COLOURS = 64


def joint_page(scene: str, poses: str | None = None, surrogate: str | None = None) -> tuple[str, PageCycle]:
    """HTML of a scene, and the cycle that it shows. poses: a file to scrub; surrogate: a ready name or file; its
    own if left out. Raises ValueError for a surrogate of another scene and for a scene without `cc.foundation`,
    ImportError without the extra `page`."""
    contact = page_contact(load_scene(scene))
    learned, cycle = _surrogate(contact, surrogate), page_cycle(contact, poses)
    surfaces, moving = fixed_surfaces(contact), moving_body(contact.scene)
    library = np.frombuffer(_text(*_LIBRARY).encode(), dtype=np.uint8)
    index, arrays = packed({"library": library, **_arrays(contact, learned, surfaces, moving)})
    content = _content(contact, learned, cycle, surfaces) | {"arrays": index}
    words = {
        "title": escape(f"{contact.scene.name}: contact live"),
        "scene": escape(contact.scene.name),
        "models": escape(f"contact model: {contact!r}" + (f", {learned.title}" if learned else "")),
        "source": escape(f"{cycle.source}. Written by casadi_contact {version('casadi_contact')}."),
        "style": _text("web", "style.css"),
        "content": json.dumps(content, separators=(",", ":")).replace("<", "\\u003c"),
        "arrays": arrays,
        "modules": "\n".join(_NOT_IN_ONE.sub("", _text("web", f"{name}.js")) for name in _MODULES),
    }
    return Template(_text("web", "page.html")).substitute(words), cycle


def _text(*path: str) -> str:
    return resources.files(__package__).joinpath(*path).read_text("utf-8")


def _surrogate(contact: CompiledFoundation, given: str | None) -> Surrogate | None:
    """The surrogate; None where the scene has none."""
    scene = contact.scene
    name = given or (scene.name if scene.name in ready_surrogates() else None)
    surrogate = load_surrogate(name) if name else None
    if given and surrogate and surrogate.scene.digest != scene.digest:
        raise ValueError(f"{name} is of another scene ({surrogate.scene.name}): give the scene file it was built from")
    return surrogate if surrogate and surrogate.scene.digest == scene.digest else None


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
    sensitive = [name for name in scene.sensitive_loads if name in scene.load_names]
    settles = len(scene.sensitive_pose) == len(sensitive)
    free, target = (scene.sensitive_pose, sensitive) if settles else ((), [])
    pressed = normal_forces(scene.normal_loads, contact.wrenches(cycle.poses)).sum(axis=1)
    stance = int(pressed.argmax())
    points = np.concatenate([surface.triangles.points_mm for surface in surfaces])
    start = contact(cycle.poses[stance])
    title, space = patch_title if len(scene.patch_names) > 1 else lambda _: "surfaces", scene.pose_space
    loads = [(load, quantity(load)) for load in scene.load_names]
    begun = [float(start[scene.load_names.index(name)]) for name in target]
    held = {"matrix": space.matrix.tolist(), "offset": space.offset.tolist()}
    return {
        "scene": scene.name,
        "patches": [{"name": name, "title": title(name)} for name in scene.patch_names],
        "loads": [{"name": load, "unit": of.unit, "column": of.column} for load, of in loads],
        "surrogateLoads": None if surrogate is None else list(surrogate.load_names),
        "sensitive": sensitive,
        "referenceLoad": scene.reference_load,
        "gapSlope": scene.gap_slope,
        "normals": [
            {"loads": list(normal.loads), "directed": normal.component is not None, "sign": normal.sign}
            for normal in scene.normal_loads
        ],
        "pose": pose_words(scene.shape, slider_ranges(cycle.poses, surrogate)),
        "space": None if space.unconstrained else held,
        "presets": {"stance": stance, "swing": int(pressed.argmin())},
        "settle": {"free": list(free), "loads": target, "start": begun},
        "cycle": {"time": cycle.time_s.tolist(), "poses": cycle.poses.tolist()},
        "view": map_view(ElasticFoundation(scene, scene.grids.get("coarse")), points),
        "colours": np.round(colormaps["YlOrRd"](np.linspace(0.0, 1.0, _COLOURS))[:, :3], 3).tolist(),
    }
