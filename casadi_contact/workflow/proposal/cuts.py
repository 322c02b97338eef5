"""Where to cut the patches of a mesh into parts (`scenes.normal_load`), from samples and short fits of small networks.

A patch is divided into narrow strips along z. For every run of strips from i to j, a small network learns the root load
with a fixed effort; its mean square error on validation rows, e²(i, j) [N²], measures how complicated the contact of
that run is. Errors of neighbouring parts are nearly independent, so the K - 1 cuts with the least Σ e² are the shortest
path from the first strip to the last in K steps, found for every K by dynamic programming.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from typing import Any

import numpy as np

from casadi_contact.contact.cells.choice import CellChoice
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.core.conventions import Array, Update, local_poses
from casadi_contact.core.quantities import FORCE, of_kind, three_digits
from casadi_contact.core.workers import cancelled_if_left, worker_pool
from casadi_contact.networks.network import Regression
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.samples.samples import VALIDATION, Samples, fitted_rows
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.patch.regressions import root_target, root_weight


@dataclass(frozen=True)
class CutSettings:
    """worth: least share of the error that one more part must remove. rows: most samples of a fit. hidden, gflop: of
    its network. outliers: share of the worst validation rows that are ignored."""

    worth: float = 0.1
    strips: int = 20
    rows: int = 4_000
    hidden: tuple[int, ...] = (10, 10)
    gflop: float = 2.0
    fewest_in_contact: int = 30
    outliers: float = 0.01

    def __post_init__(self) -> None:
        if not 0.0 < self.worth < 1.0:
            raise ValueError(f"worth is {self.worth}, expected a share of the error, above 0 and below 1")


@dataclass(frozen=True)
class PatchCuts:
    """A patch's bounds along z [mm], the cuts between them, and the validation error [N] of small networks for the
    whole patch and for the parts together."""

    patch: str
    bounds_mm: tuple[float, float]
    cuts_mm: tuple[float, ...]
    whole_n: float
    parts_n: float

    def __str__(self) -> str:
        whole, parts = three_digits(self.whole_n), three_digits(self.parts_n)
        if not self.cuts_mm:
            return f"patch {self.patch} stays whole: small networks err by {whole} N, little less on parts"
        count = len(self.cuts_mm) + 1
        return f"patch {self.patch}: {count} parts, where small networks err by {parts} N ({whole} N on the whole)"


def find_cuts(
    scene: Scene,
    samples: Samples,
    update: Update | None = None,
    executor: Executor | None = None,
    settings: CutSettings | None = None,
) -> list[PatchCuts]:
    """The cuts of each patch. Parts are added until small networks meet the scene's least tolerance of a force, or one
    more part removes too little of the error. samples: of the scene with whole patches; test rows are not used. Loads
    of the strips come from a foundation in cells of medium size. Raises ValueError for a scene that is cut already or
    is no mesh, and for samples without contact."""
    settings = settings or CutSettings()
    if scene.shape != "mesh":
        raise ValueError(f"scene {scene.name} has the shape {scene.shape}, expected a mesh: other shapes are not cut")
    if len(scene.parts) > len(scene.patch_names):
        raise ValueError(f"scene {scene.name} has a split_z, expected whole patches: take that line out")
    bounds = [_bounds_mm(scene, p) for p in range(len(scene.patch_names))]
    edges = np.array([np.linspace(*each, settings.strips + 1) for each in bounds])
    error = _squared_errors(scene, samples, edges, bounds, settings, update, executor)
    enough_n = min(scene.tolerances[name] for name in of_kind(scene.load_names, FORCE))
    result = []
    for p, patch in enumerate(scene.patch_names):
        if error[p, 0, -1] == 0.0:
            raise ValueError(f"samples: patch {patch!r} never bears, expected samples in contact")
        cuts, parts_n = worthwhile(best_cuts(error[p]), enough_n, settings.worth)
        cuts_mm = tuple(float(round(edges[p, k], 2)) for k in cuts)
        result.append(PatchCuts(patch, bounds[p], cuts_mm, math.sqrt(error[p, 0, -1]), parts_n))
    return result


def cut_scene(scene: Scene, cuts_mm: Sequence[Sequence[float]], bounds_mm: Sequence[tuple[float, float]]) -> Scene:
    """The scene with these cuts in each patch, between its bounds along z."""
    geometry = scene.tables["geometry"]
    patches: dict[str, Any] = {name: dict(table) for name, table in geometry["patches"].items()}
    for patch, cuts, bounds in zip(scene.patch_names, cuts_mm, bounds_mm, strict=True):
        if cuts:
            patches[patch] |= {"z": list(bounds), "split_z": [float(cut) for cut in cuts]}
    return Scene.from_tables({**scene.tables, "geometry": {**geometry, "patches": patches}})


def _bounds_mm(scene: Scene, patch: int) -> tuple[float, float]:
    """Extent of the patch's elements along z in whole millimetres, within the bounds of the scene."""
    z = scene.elements(scene.grids["teacher"])[patch].centres_mm[:, 2]
    low, high = scene.geometry["patches"][scene.patch_names[patch]].get("z", (-np.inf, np.inf))
    return float(max(np.floor(z.min()), low)), float(min(np.ceil(z.max()), high))


def _squared_errors(
    scene: Scene,
    samples: Samples,
    edges_mm: Array,
    bounds_mm: Sequence[tuple[float, float]],
    settings: CutSettings,
    update: Update | None,
    executor: Executor | None,
) -> Array:
    """e² [N²] (patches, strips + 1, strips + 1) of every run of strips between edges (patches, strips + 1); infinite
    where i >= j."""
    choice = CellChoice()
    size_mm = choice.sizes_of(scene)[2]
    cells = choice.cells(size_mm, size_mm)
    model = CellFoundation(cut_scene(scene, edges_mm[:, 1:-1].tolist(), bounds_mm), cells)
    rows = np.random.default_rng(0).permutation(np.flatnonzero(fitted_rows(samples)[0]))[: settings.rows]
    poses, validation = samples.poses[rows], samples.role[rows] == VALIDATION
    shape = (len(rows), len(bounds_mm), settings.strips)
    normals = [part.normal for part in model.scene.parts]
    loads_n = np.maximum(normal_forces(normals, model.part_wrenches(poses)), 0.0).reshape(shape)
    gaps_mm = model.part_gaps(poses).reshape(shape)
    errors = np.full((len(bounds_mm), settings.strips + 1, settings.strips + 1), np.inf)
    runs = [(p, *run) for p in range(len(bounds_mm)) for run in itertools.combinations(range(settings.strips + 1), 2)]
    with worker_pool(executor) as workers:
        futures = {}
        for p, i, j in runs:
            anchor = scene.anchors_mm[p].copy()
            anchor[2] = 0.5 * (edges_mm[p, i] + edges_mm[p, j])
            local = local_poses(poses, anchor)[:, list(scene.pose_space.free)]
            strip = loads_n[:, p, i:j].sum(axis=1), gaps_mm[:, p, i:j].min(axis=1)
            futures[workers.submit(squared_error, scene, local, *strip, validation, settings)] = (p, i, j)
        with cancelled_if_left(workers, futures):
            for done, future in enumerate(as_completed(futures), start=1):
                errors[futures[future]] = future.result()
                if update is not None:
                    update("parts tried", done, len(futures), "")
    return errors


def squared_error(
    scene: Scene, local: Array, loads_n: Array, gaps_mm: Array, validation: np.ndarray, settings: CutSettings
) -> float:
    """e² [N²] of a small network of one part's root load, averaged over validation rows without the worst. local (n,
    k): poses of the part; loads_n, gaps_mm (n,). With too few rows in contact, the error of zero load."""
    contact, predicted_n = loads_n > 0.0, np.zeros(int(validation.sum()))
    if (contact & ~validation).sum() >= settings.fewest_in_contact:
        target = root_target(loads_n, gaps_mm, scene)
        weight, false_load = root_weight(target, scene), np.where(contact, 0.0, scene.reference_load)
        part = Regression("part", local, target, weight, validation, tolerance=0.0, false_load=false_load)
        effort = TrainingSettings(sizes=(settings.hidden,), max_gflop=settings.gflop, restarts=0)
        predicted_n = scene.reference_load * np.maximum(fit(part, effort).network.value(local[validation]), 0.0) ** 2
    squares = np.sort((predicted_n - loads_n[validation]) ** 2)
    kept = len(squares) - int(settings.outliers * len(squares))
    return float(squares[:kept].mean()) if kept else 0.0


def best_cuts(error: Array) -> list[tuple[float, tuple[int, ...]]]:
    """For K = 1, 2, ... parts the least √Σ e² and the cuts that reach it. error (n + 1, n + 1): e² of a part from edge
    i to edge j > i. A shortest path from edge 0 to edge n in K steps."""
    last = len(error) - 1
    reached: dict[int, tuple[float, tuple[int, ...]]] = {0: (0.0, ())}
    result = []
    for _ in range(last):
        steps = {
            j: [(before + error[i, j], (*path, i)) for i, (before, path) in reached.items() if i < j]
            for j in range(1, last + 1)
        }
        reached = {j: min(ways) for j, ways in steps.items() if ways}
        total, path = reached[last]
        result.append((math.sqrt(total), path[1:]))
    return result


def worthwhile(
    by_count: Sequence[tuple[float, tuple[int, ...]]], enough: float, worth: float
) -> tuple[tuple[int, ...], float]:
    """The first cuts whose error is small enough or from which one more part removes less than a share `worth`; and
    their error."""
    for (error, cuts), (next_error, _) in itertools.pairwise(by_count):
        if error <= enough or next_error > (1.0 - worth) * error:
            return cuts, error
    return by_count[-1][1], by_count[-1][0]
