"""Parts of patches: pieces of a patch with a root network of their own.

If a patch has several contact areas, its load has kinks where one of them appears, which no small network fits. Cut
between these areas, each part's root load is as smooth as that of a simple condyle; a patch's wrench is the sum over
its parts. Most patches are one part of the same name. Only samples and the `patch` surrogate use parts.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.scenes.normal_load import FORCE_NAMES, NormalLoad


@dataclass(frozen=True)
class Part:
    """One part: its patch by number, bounds [mm] of its elements' centres along z, its anchor (3,) on the moving body
    [mm], and the normal load, which is that of the patch."""

    name: str
    patch: int
    z_mm: tuple[float, float]
    anchor_mm: Array
    normal: NormalLoad


def parts_of(geometry: Mapping[str, Any], normals: Sequence[NormalLoad], anchors_mm: Array) -> tuple[Part, ...]:
    """The parts of all patches, patch by patch: those a ``split_z`` makes ("med_1", "med_2", by rising z), or one.

    A part's anchor is the patch's, moved along z to the middle of the part.
    """
    patches = geometry.get("patches", {})
    parts = []
    for p, (normal, anchor) in enumerate(zip(normals, anchors_mm, strict=True)):
        bounds = patches.get(normal.patch, {})
        cuts = bounds.get("split_z", [])
        if not cuts:
            parts.append(Part(normal.patch, p, (-np.inf, np.inf), anchor, normal))
            continue
        low, high = bounds["z"]
        for k, (a, b) in enumerate(itertools.pairwise([low, *cuts, high]), start=1):
            name = f"{normal.patch}_{k}"
            at = np.array([anchor[0], anchor[1], 0.5 * (a + b)])
            parts.append(Part(name, p, (float(a), float(b)), at, replace(normal, patch=name)))
    return tuple(parts)


def tables_by_parts(tables: Mapping[str, Any], patch_names: Sequence[str], parts: Sequence[Part]) -> dict[str, Any]:
    """Tables of the scene whose patches are these parts, each with its normal load alone."""
    patches, names, pressed = {}, [], []
    for part in parts:
        whole = tables["geometry"]["patches"][patch_names[part.patch]]
        bounds = {key: value for key, value in whole.items() if key != "split_z"}
        within = {"z": list(part.z_mm)} if np.isfinite(part.z_mm).all() else {}
        patches[part.name] = {**bounds, **within, "anchor": part.anchor_mm.tolist()}
        component, sign = part.normal.component, "+" if part.normal.sign > 0.0 else "-"
        names += [f"{force}_{part.name}" for force in ((component,) if component else FORCE_NAMES)]
        pressed.append(f"{sign}{component}_{part.name}" if component else f"F_{part.name}")
    loads = {key: value for key, value in tables["loads"].items() if key != "sensitive_pose"}
    return {
        **tables,
        "geometry": {**tables["geometry"], "patches": patches},
        "loads": {**loads, "names": names, "sensitive": pressed},
        "tolerances": dict.fromkeys(names, 1.0),
    }
