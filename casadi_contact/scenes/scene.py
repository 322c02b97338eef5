"""A scene: bodies, patches, material, grids, the loads it needs and how precisely it needs them.

A scene is a readable TOML table that a user can copy and edit; every key is known by name, and an unknown key
or a bad value is refused with the key's name.
"""

from __future__ import annotations

import hashlib
import itertools
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from casadi_contact.conventions import POSE_NAMES, Array, load_selection, pose_index
from casadi_contact.scenes.joint_shapes import (
    JOINT_PARAMETERS,
    JOINT_PATCHES,
    check_joint_geometry,
    joint_anchors,
    joint_start,
)
from casadi_contact.scenes.normal_load import NormalLoad, normal_loads
from casadi_contact.scenes.own_model import OWN_MODEL, check_own_geometry, own_anchors

FORMAT = 1
LAWS = ("linear", "log")

# What each shape needs in [geometry]; lengths in mm, angles in degrees, areas in mm².
SHAPE_PARAMETERS: dict[str, tuple[str, ...]] = {
    "knee": (
        "sagittal_radii",
        "sagittal_junctions_deg",
        "frontal_radius",
        "condyle_offset",
        "dish_sagittal_radius",
        "dish_frontal_radius",
        "plateau_length",
        "plateau_width",
    ),
    "sphere_on_plane": ("radius", "patch_side"),
    "sphere_in_dish": ("radius", "dish_radius", "patch_side"),
    "cylinder_on_plane": ("radius", "length", "patch_side"),
    "punch_on_plane": ("area",),
    **JOINT_PARAMETERS,
    OWN_MODEL: ("patches",),
}
SIDES = ("med", "lat")
GRIDS = ("fine", "coarse", "settle", "teacher")


def _fail(key: str, got: object, expected: str) -> ValueError:
    return ValueError(f"scene: {key} = {got!r}, expected {expected}")


def _number(key: str, value: object, *, low: float = -math.inf, high: float = math.inf) -> float:
    """A finite number with low < value < high."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise _fail(key, value, "a finite number")
    if not low < value < high:
        raise _fail(key, value, f"a number between {low:g} and {high:g}")
    return float(value)


def _grid(key: str, value: object) -> tuple[int, int]:
    """Elements per side (along x, along z)."""
    if (
        not isinstance(value, list | tuple)
        or len(value) != 2
        or not all(isinstance(n, int | np.integer) and not isinstance(n, bool) and 0 < n <= 4096 for n in value)
    ):
        raise _fail(key, value, "two whole numbers of elements from 1 to 4096, for example [80, 40]")
    return int(value[0]), int(value[1])


def _names(key: str, value: object) -> tuple[str, ...]:
    if not isinstance(value, list | tuple) or not value or not all(isinstance(v, str) for v in value):
        raise _fail(key, value, "a list of names")
    if len(set(value)) != len(value):
        raise _fail(key, value, "names that differ")
    return tuple(value)


def _table(
    key: str, value: object, known: tuple[str, ...], *, complete: bool, optional: tuple[str, ...] = ()
) -> dict[str, Any]:
    """A table all of whose keys are known or optional (and, if complete, all of the known keys)."""
    if not isinstance(value, Mapping):
        raise _fail(key, value, f"a table with {', '.join(known)}")
    for name in value:
        if name not in (*known, *optional):
            raise ValueError(f"scene: unknown key {key}.{name}, expected one of {', '.join((*known, *optional))}")
    missing = [name for name in known if name not in value]
    if complete and missing:
        raise ValueError(f"scene: {key} lacks {', '.join(missing)}")
    return dict(value)


@dataclass(frozen=True)
class Material:
    """Elastic layer of the fixed body: Young's modulus [MPa], Poisson's ratio, thickness [mm], pressure law."""

    youngs_modulus: float
    poissons_ratio: float
    thickness: float
    law: str = "linear"

    @classmethod
    def from_table(cls, table: object) -> Material:
        values = _table("material", table, ("youngs_modulus", "poissons_ratio", "thickness", "law"), complete=True)
        if values["law"] not in LAWS:
            raise _fail("material.law", values["law"], " or ".join(LAWS))
        return cls(
            youngs_modulus=_number("material.youngs_modulus", values["youngs_modulus"], low=0.0),
            poissons_ratio=_number("material.poissons_ratio", values["poissons_ratio"], low=-1.0, high=0.5),
            thickness=_number("material.thickness", values["thickness"], low=0.0),
            law=values["law"],
        )


@dataclass(frozen=True)
class Scene:
    """One contact scene; see ``scenes/ready/knee.toml`` for every key with its unit and meaning.

    ``tables`` is the TOML content the scene was made from, and the only thing that is stored: `to_toml` writes
    it, `digest` names it.
    """

    tables: Mapping[str, Any] = field(repr=False)
    name: str
    shape: str
    geometry: Mapping[str, Any]
    layer: Material | None
    patch_names: tuple[str, ...]
    anchors_mm: Array = field(compare=False)
    load_names: tuple[str, ...]
    tolerances: Mapping[str, float]
    sensitive_pose: tuple[str, ...]
    normal_loads: tuple[NormalLoad, ...]
    reference_load: float
    gap_slope: float
    boundary_load: float
    grids: Mapping[str, tuple[int, int]]
    sampling: Mapping[str, Any]
    motion: Mapping[str, Any]

    @classmethod
    def from_tables(cls, tables: Mapping[str, Any]) -> Scene:
        """Check every key and value; raises ValueError naming the key at fault."""
        known = (
            "format",
            "name",
            "shape",
            "geometry",
            "material",
            "grids",
            "loads",
            "tolerances",
            "sampling",
            "motion",
        )
        _table("scene", tables, known, complete=False)
        if tables.get("format") != FORMAT:
            raise _fail("format", tables.get("format"), f"{FORMAT} (this version reads scene format {FORMAT})")
        shape = tables.get("shape")
        if shape not in SHAPE_PARAMETERS:
            raise _fail("shape", shape, f"one of {', '.join(SHAPE_PARAMETERS)}")
        geometry = _check_geometry(shape, tables.get("geometry", {}))
        patch_names = _patch_names(shape, geometry)
        loads = _table(
            "loads",
            tables.get("loads", {}),
            ("names", "sensitive", "reference_load", "gap_slope", "boundary_load"),
            complete=True,
            optional=("sensitive_pose",),
        )
        load_names = _names("loads.names", loads["names"])
        pressed = normal_loads(_names("loads.sensitive", loads["sensitive"]), patch_names)
        load_selection(load_names, patch_names)
        sensitive_pose = _names("loads.sensitive_pose", loads["sensitive_pose"]) if "sensitive_pose" in loads else ()
        for name in sensitive_pose:
            pose_index(name)
        tolerances = {
            name: _number(f"tolerances.{name}", value, low=0.0)
            for name, value in _table("tolerances", tables.get("tolerances", {}), load_names, complete=True).items()
        }
        grids = {
            name: _grid(f"grids.{name}", value)
            for name, value in _table("grids", tables.get("grids", {}), GRIDS, complete=shape != OWN_MODEL).items()
        }
        sampling = tables.get("sampling", {})
        motion = tables.get("motion", {})
        for key, table in (("sampling", sampling), ("motion", motion)):
            if not isinstance(table, Mapping):
                raise _fail(key, table, "a table")
        return cls(
            tables=dict(tables),
            name=str(tables.get("name", shape)),
            shape=shape,
            geometry=geometry,
            layer=None if shape == OWN_MODEL else Material.from_table(tables.get("material", {})),
            patch_names=patch_names,
            anchors_mm=_anchors(shape, geometry),
            load_names=load_names,
            tolerances=tolerances,
            sensitive_pose=sensitive_pose,
            normal_loads=pressed,
            reference_load=_number("loads.reference_load", loads["reference_load"], low=0.0),
            gap_slope=_number("loads.gap_slope", loads["gap_slope"], low=0.0),
            boundary_load=_number("loads.boundary_load", loads["boundary_load"], low=0.0),
            grids=grids,
            sampling=dict(sampling),
            motion=dict(motion),
        )

    @classmethod
    def from_toml(cls, text: str) -> Scene:
        """Read a scene from TOML text; raises ValueError for text that is not TOML or not a scene."""
        try:
            return cls.from_tables(tomllib.loads(text))
        except tomllib.TOMLDecodeError as error:
            raise ValueError(f"scene: not valid TOML ({error})") from None

    def to_toml(self) -> str:
        """The scene as TOML text that `from_toml` reads back equal."""
        return tomli_w.dumps(self.tables)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the scene's TOML text: two scenes with one digest are the same scene."""
        return hashlib.sha256(self.to_toml().encode()).hexdigest()

    @property
    def material(self) -> Material:
        """The elastic layer; raises ValueError for a scene without geometry."""
        if self.layer is None:
            raise ValueError(
                f"scene {self.name} has no geometry for an elastic foundation (shape {self.shape}): "
                "give your own contact model (cc.CallableModel), or a table of samples"
            )
        return self.layer

    @property
    def sensitive_loads(self) -> tuple[str, ...]:
        """The named loads that the normal loads are made of, in patch order."""
        return tuple(name for normal in self.normal_loads for name in normal.loads)

    @property
    def start_pose(self) -> Array:
        """A pose (6,) from which the moving body can be brought into contact."""
        return joint_start(self.geometry)

    @property
    def insensitive_pose(self) -> tuple[str, ...]:
        """The pose parameters that are not sensitive (§2.1), in pose order."""
        return tuple(name for name in POSE_NAMES if name not in self.sensitive_pose)

    def with_overrides(self, **overrides: Any) -> Scene:
        """A copy with single keys replaced, each found in the one table that holds it: radius=30.0, law="log"."""
        tables = {key: dict(value) if isinstance(value, Mapping) else value for key, value in self.tables.items()}
        for key, value in overrides.items():
            if key in tables and not isinstance(tables[key], dict):
                tables[key] = value
                continue
            homes = [name for name, table in tables.items() if isinstance(table, dict) and key in table]
            if not homes:
                possible = sorted(k for table in tables.values() if isinstance(table, dict) for k in table)
                raise ValueError(f"scene {self.name}: unknown parameter {key!r}, expected one of {', '.join(possible)}")
            tables[homes[0]][key] = list(value) if isinstance(value, tuple) else value
        return Scene.from_tables(tables)

    def with_sensitive_pose(self, names: Sequence[str]) -> Scene:
        """A copy with these sensitive pose parameters, for a scene that leaves them out."""
        loads = {**self.tables["loads"], "sensitive_pose": list(names)}
        return Scene.from_tables({**self.tables, "loads": loads})

    def geometry_of(self, side: str) -> dict[str, Any]:
        """The geometry of one side of a knee: the common values, with that side's own values in their place."""
        common = {key: value for key, value in self.geometry.items() if key not in SIDES}
        return common | dict(self.geometry.get(side, {}))


def _check_geometry(shape: str, table: object) -> dict[str, Any]:
    known = SHAPE_PARAMETERS[shape]
    if shape != "knee":
        values = _table("geometry", table, known, complete=True)
        if shape == OWN_MODEL:
            return check_own_geometry(values)
        if shape in JOINT_PARAMETERS:
            return check_joint_geometry(shape, values)
        numbers = {key: _number(f"geometry.{key}", value, low=0.0) for key, value in values.items()}
        if shape == "sphere_in_dish":
            limit = max(numbers["radius"], numbers["patch_side"] / math.sqrt(2.0))
            if numbers["dish_radius"] <= limit:
                raise _fail("geometry.dish_radius", numbers["dish_radius"], f"more than {limit:g} (sphere, half patch)")
        return numbers
    values = _table("geometry", table, (*known, *SIDES), complete=False)
    missing = [key for key in known if key not in values]
    if missing:
        raise ValueError(f"scene: geometry lacks {', '.join(missing)}")
    for side in SIDES:
        if side in values:
            values[side] = _table(f"geometry.{side}", values[side], known, complete=False)
        _check_knee_side(side, {k: v for k, v in values.items() if k not in SIDES} | values.get(side, {}))
    return values


def _check_knee_side(side: str, values: Mapping[str, Any]) -> None:
    radii, junctions = values["sagittal_radii"], values["sagittal_junctions_deg"]
    for key, listed in (("sagittal_radii", radii), ("sagittal_junctions_deg", junctions)):
        if not isinstance(listed, list | tuple):
            raise _fail(f"geometry.{key}", listed, "a list of numbers")
        for value in listed:
            _number(f"geometry.{key}", value, low=-60.0 if key.endswith("deg") else 0.0, high=180.0)
    if len(junctions) != len(radii) - 1 or any(a >= b for a, b in itertools.pairwise(junctions)):
        raise _fail("geometry.sagittal_junctions_deg", junctions, f"{len(radii) - 1} rising angles between the arcs")
    for key in SHAPE_PARAMETERS["knee"][2:]:
        _number(f"geometry.{key}", values[key], low=0.0)
    # A condyle more curved than its dish has one contact region; half the patch must lie inside the dish's circle.
    limits = {
        "dish_frontal_radius": max(values["frontal_radius"], 0.5 * values["plateau_width"]),
        "dish_sagittal_radius": max(*radii, 0.5 * values["plateau_length"]),
    }
    for key, limit in limits.items():
        if values[key] <= limit:
            raise _fail(f"geometry.{key} ({side})", values[key], f"more than {limit:g} (condyle and half patch)")


def _patch_names(shape: str, geometry: Mapping[str, Any]) -> tuple[str, ...]:
    if shape == OWN_MODEL:
        return tuple(geometry["patches"])
    return SIDES if shape == "knee" else JOINT_PATCHES.get(shape, ("contact",))


def _anchors(shape: str, geometry: Mapping[str, Any]) -> Array:
    """Anchor of each patch on the moving body [mm]: a condyle's centre, or the body's own origin."""
    if shape == OWN_MODEL:
        return own_anchors(geometry)
    if shape in JOINT_PARAMETERS:
        return joint_anchors(shape)
    if shape != "knee":
        return np.zeros((1, 3))
    offsets = [geometry.get(side, {}).get("condyle_offset", geometry["condyle_offset"]) for side in SIDES]
    return np.array([[0.0, 0.0, offsets[0]], [0.0, 0.0, -offsets[1]]])


def ready_scenes() -> list[str]:
    """Names of the scenes that come with the library."""
    folder = resources.files("casadi_contact.scenes") / "ready"
    texts = {p.name[:-5]: p.read_text("utf-8") for p in folder.iterdir() if p.name.endswith(".toml")}
    return sorted(name for name, text in texts.items() if "shape = " in text)


def load_scene(name_or_path: str | Path, **overrides: Any) -> Scene:
    """Load a ready-made scene by name, or a scene file by its path; keywords replace single parameters.

    >>> load_scene("sphere_on_plane", radius=25.0).geometry["radius"]
    25.0

    Raises ValueError for an unknown name, an unknown key or a bad value, FileNotFoundError for a missing file.
    """
    text_name = str(name_or_path)
    if text_name.endswith(".toml"):
        path = Path(name_or_path)
        if not path.is_file():
            raise FileNotFoundError(f"scene file {path} does not exist")
        text = path.read_text("utf-8")
    elif text_name in ready_scenes():
        text = (resources.files("casadi_contact.scenes") / "ready" / f"{text_name}.toml").read_text("utf-8")
    else:
        possible = ", ".join(ready_scenes())
        raise ValueError(f"unknown scene {text_name!r}, expected one of {possible}, or a path to a .toml file")
    try:
        scene = Scene.from_toml(text)
    except ValueError as error:
        raise ValueError(f"{text_name}: {error}") from None
    return scene.with_overrides(**overrides) if overrides else scene
