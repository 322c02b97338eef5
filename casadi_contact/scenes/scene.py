"""A scene: bodies, patches, material, grids, the loads it needs and how precisely it needs them.

A scene is a readable TOML table that a user can copy and edit. Errors for unknown keys and bad values name the key.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import tomli_w

from casadi_contact.core.conventions import Array, load_selection
from casadi_contact.core.files.reading import toml_tables
from casadi_contact.geometry.elements import ElementGrid
from casadi_contact.geometry.moving_surface import MovingSurface
from casadi_contact.scenes.material import FRICTION_NAMES, Friction, Material
from casadi_contact.scenes.normal_load import LoadsTable, NormalLoad, Patch, in_sum
from casadi_contact.scenes.pose_space import PoseSpace
from casadi_contact.scenes.shapes.checks import fail, grid_size, number, plain_values, scene_name, table_of
from casadi_contact.scenes.shapes.shape import shape_named

FORMAT = 1
_KEYS = (
    *("format", "name", "shape", "geometry", "material", "friction", "grids"),
    *("loads", "tolerances", "sampling", "motion", "pose"),
)
MOST_PATCHES = 256
GRIDS = ("fine", "coarse", "settle", "teacher")


@dataclass(frozen=True)
class Scene:
    """One contact scene; see ``scenes/ready/knee.toml`` for every key with its unit and meaning. ``tables`` is the TOML
    content the scene was made from, and the only thing that is stored: `to_toml` writes it, `digest` names it."""

    tables: Mapping[str, Any] = field(repr=False)
    name: str
    shape: str
    geometry: Mapping[str, Any]
    layer: Material | None
    friction: Friction
    patch_names: tuple[str, ...]
    anchors_mm: Array = field(compare=False)
    load_names: tuple[str, ...]
    tolerances: Mapping[str, float]
    sensitive_pose: tuple[str, ...]
    pose_space: PoseSpace = field(compare=False)
    normal_loads: tuple[NormalLoad, ...]
    patches: tuple[Patch, ...] = field(compare=False)
    reference_load: float
    gap_slope: float
    boundary_load: float
    grids: Mapping[str, tuple[int, int]]
    sampling: Mapping[str, Any]
    motion: Mapping[str, Any]

    @classmethod
    def from_tables(cls, tables: Mapping[str, Any]) -> Scene:
        """Check every key and value; raises ValueError naming the key at fault."""
        plain_values("", tables)
        table_of("scene", tables, _KEYS, complete=False)
        if tables.get("format") != FORMAT:
            raise fail("format", tables.get("format"), f"{FORMAT} (this version reads scene format {FORMAT})")
        shape = shape_named(tables.get("shape"))
        name = scene_name(tables.get("name", shape.name))
        geometry = shape.check(tables.get("geometry", {}))
        patch_names = shape.patches(geometry)
        space = PoseSpace.from_table(tables.get("pose", {}))
        loads = LoadsTable.from_table(tables.get("loads", {}), patch_names, space)
        anchors_mm = shape.anchors(geometry)
        tolerances = table_of("tolerances", tables.get("tolerances", {}), loads.load_names, complete=True)
        grids = {
            grid: grid_size(f"grids.{grid}", value)
            for grid, value in table_of("grids", tables.get("grids", {}), GRIDS, complete=shape.has_layer).items()
        }
        if len(patch_names) > MOST_PATCHES:
            raise ValueError(f"scene: {len(patch_names)} patches, expected {MOST_PATCHES} at most")
        sampling = tables.get("sampling", {})
        motion = tables.get("motion", {})
        for key, table in (("sampling", sampling), ("motion", motion)):
            if not isinstance(table, Mapping):
                raise fail(key, table, "a table")
        return cls(
            tables=dict(tables),
            name=name,
            shape=shape.name,
            geometry=geometry,
            layer=Material.from_table(tables.get("material", {})) if shape.has_layer else None,
            friction=Friction.from_table(tables.get("friction", {})),
            patch_names=patch_names,
            anchors_mm=anchors_mm,
            tolerances={load: number(f"tolerances.{load}", value, low=0.0) for load, value in tolerances.items()},
            pose_space=space,
            patches=tuple(map(Patch, patch_names, anchors_mm, loads.normal_loads)),
            grids=grids,
            sampling=dict(sampling),
            motion=dict(motion),
            **vars(loads),
        )

    @classmethod
    def from_toml(cls, text: str) -> Scene:
        """A scene from complete TOML text; raises ValueError for text that is not TOML or not a scene."""
        return cls.from_tables(toml_tables(text, "scene"))

    def to_toml(self) -> str:
        """The scene as TOML text that `from_toml` reads back equal."""
        return tomli_w.dumps(self.tables)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of what determines loads and samples: the scene's TOML text without paths of meshes, tolerances,
        friction (samples are taken at rest) and what of a sampling plan may be dropped."""
        tables = {key: value for key, value in self.tables.items() if key not in ("tolerances", "friction")}
        tables["geometry"] = shape_named(self.shape).identity(self.tables["geometry"])
        tables["sampling"] = {key: value for key, value in self.sampling.items() if not key.startswith("most_")}
        if not tables["sampling"]:
            del tables["sampling"]
        return hashlib.sha256(tomli_w.dumps(tables).encode()).hexdigest()

    @property
    def material(self) -> Material:
        """The elastic layer; raises ValueError for a scene without geometry."""
        if self.layer is None:
            raise ValueError(f"scene {self.name} ({self.shape}) has no geometry: give a cc.CallableModel, or samples")
        return self.layer

    @property
    def varies(self) -> bool:
        """Whether the layer's thickness does."""
        return self.material.thickness_map is not None or "backing" in self.geometry

    def thickness_at(self, points_mm: Array, normals: Array) -> Array:
        """Thickness (n,) [mm] of a layer of the material's modulus that is as stiff as both bodies' layers in series,
        under points (n, 3) of the fixed surface with outward unit normals (n, 3)."""
        backed = shape_named(self.shape).thickness_at(self.geometry, points_mm, normals)
        own = self.material.thickness_at(points_mm) if backed is None else backed
        return np.asarray(own + self.material.in_series)

    @property
    def sensitive_loads(self) -> tuple[str, ...]:
        """The named loads that the normal loads are made of, in patch order."""
        return tuple(name for normal in self.normal_loads for name in normal.loads)

    @property
    def controllable_normal_loads(self) -> tuple[NormalLoad, ...]:
        """The normal loads that a static analysis can set independently: those of the patches, or their sum if there is
        a single sensitive pose parameter (a knee whose r_x is locked)."""
        return in_sum(self.normal_loads) if len(self.sensitive_pose) == 1 else self.normal_loads

    def selection(self, loads: Sequence[str]) -> Array:
        """`load_selection` (loads, patches, 6) of the scene's patches."""
        return load_selection(loads, self.patch_names)

    @property
    def start_pose(self) -> Array:
        """A pose (6,) from which the moving body can be brought into contact."""
        return shape_named(self.shape).start_pose(self.geometry)

    def surfaces(self) -> list[MovingSurface]:
        """The moving surface that faces each patch, in patch order."""
        return shape_named(self.shape).surfaces(self.geometry)

    def elements(self, grid: tuple[int, int]) -> list[ElementGrid]:
        """The elements (nx along x, nz along z) of each patch of the fixed surface, in patch order. A mesh scene whose
        elements are its triangles has these instead, whatever the grid."""
        return shape_named(self.shape).elements(self.geometry, grid)

    @cached_property
    def reach_mm(self) -> float:
        """How far [mm] the moving body may go from its first touch: half the diagonal of the largest patch, and
        twice the way from its origin to the anchors, which it may turn round. Infinite without elements."""
        if self.layer is None:
            return np.inf
        patches = [np.linalg.norm(np.ptp(patch.centres_mm, axis=0)) for patch in self.elements((20, 20))]
        return float(0.5 * max(patches) + 2.0 * np.linalg.norm(self.anchors_mm.mean(axis=0)))

    @property
    def symmetric(self) -> bool:
        """True where the joint's two patches, and the poses it can take, mirror each other in the plane z = 0."""
        space = self.pose_space
        return shape_named(self.shape).symmetric(self.geometry) and len(self.patches) == 2 and space.symmetric

    def with_overrides(self, **overrides: Any) -> Scene:
        """A copy with single keys replaced, each found in the one table that holds it: radius=30.0, law="log". Raises
        ValueError for a key that no table holds, and for values that the scene refuses."""
        tables = {key: dict(value) if isinstance(value, Mapping) else value for key, value in self.tables.items()}
        for key, value in overrides.items():
            if key in tables and not isinstance(tables[key], dict):
                tables[key] = value
                continue
            homes = [name for name, table in tables.items() if isinstance(table, dict) and key in table]
            if key in FRICTION_NAMES:  # a scene may leave its table out
                tables.setdefault("friction", {})
                homes = ["friction"]
            if not homes:
                possible = sorted(k for table in tables.values() if isinstance(table, dict) for k in table)
                raise ValueError(f"scene {self.name}: unknown parameter {key!r}, expected one of {', '.join(possible)}")
            tables[homes[0]][key] = list(value) if isinstance(value, tuple) else value
        return Scene.from_tables(tables)

    def tolerances_of(self, loads: Iterable[str] | None = None) -> Array:
        """Tolerances (L,) [N, N·mm] of named loads, all of ``load_names`` if left out."""
        return np.array([self.tolerances[name] for name in (self.load_names if loads is None else loads)])

    def with_tolerances(self, **tolerances: float) -> Scene:
        """A copy with the tolerances of these loads replaced [N, N·mm]."""
        return Scene.from_tables({**self.tables, "tolerances": {**self.tolerances, **tolerances}})

    def with_sensitive_pose(self, names: Sequence[str]) -> Scene:
        """A copy with these sensitive pose parameters, for a scene that leaves them out."""
        loads = {**self.tables["loads"], "sensitive_pose": list(names)}
        return Scene.from_tables({**self.tables, "loads": loads})

    def patch_geometry(self, patch: str) -> dict[str, Any]:
        """The numbers of [geometry] that hold for one patch: a knee's side may have its own."""
        return shape_named(self.shape).patch_geometry(self.geometry, patch)
