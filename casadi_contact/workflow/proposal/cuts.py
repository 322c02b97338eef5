"""Where to cut the patches of a mesh into parts (`scenes.parts`): found from samples, by what small networks can learn.

A patch is laid out in narrow strips along z, and a small network learns the root load of every run of strips from i to
j for a fixed amount of work. Its mean square error on validation rows, e²(i, j) [N²], tells how simple the contact of
that run is. Errors of neighbouring parts are nearly independent, so that the K - 1 cuts with the least Σ e² are a
shortest path from the first strip to the last in K steps, found for every K by dynamic programming.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from typing import Any

import numpy as np

from casadi_contact.contact.cells.choice import cell_sizes_mm, square_cells
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.core.conventions import Array, Update
from casadi_contact.core.quantities import FORCE, of_kind
from casadi_contact.core.workers import cancelled_if_left, worker_pool
from casadi_contact.networks.network import Regression
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.samples.samples import VALIDATION, Samples
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.patch.local_pose import local_poses
from casadi_contact.surrogate.patch.regressions import root_target, root_weight
from casadi_contact.surrogate.sample_rows import fitted_rows

STRIPS = 20  # of a patch
ROWS = 4_000  # samples that a network learns from and is judged by, at most
WORTH = 0.1  # share of the error that one more part must take off
_HIDDEN, _GFLOP = (10, 10), 2.0  # of a trial: enough to tell simple contact from contact in several places
_CELLS = 2  # of the sizes that a foundation may have, from large to small
_FEWEST = 30  # rows in contact that a network is fitted to
_OUTLIERS = 0.01  # of the validation rows, the worst, left out: what a short fit does there says little


@dataclass(frozen=True)
class PatchCuts:
    """Where a patch is best cut: its bounds (low, high) along z [mm], the cuts between them, and the validation error
    [N] that small networks reach on the patch as a whole and on the parts together."""

    patch: str
    bounds_mm: tuple[float, float]
    cuts_mm: tuple[float, ...]
    whole_n: float
    parts_n: float


def find_cuts(
    scene: Scene,
    samples: Samples,
    update: Update | None = None,
    executor: Executor | None = None,
    worth: float = WORTH,
) -> list[PatchCuts]:
    """The cuts of each patch, as few as are worth it: small networks meet the scene's least tolerance of a force, or
    one more part takes less than this share of the error off.

    samples: of the scene with whole patches; their test rows are not looked at. Loads of the strips are those of a
    foundation in cells of middling size in the samples' poses. Raises ValueError for a scene that is cut already or is
    no mesh, for samples without contact, and for a share that is not above 0 and below 1.
    """
    if not 0.0 < worth < 1.0:
        raise ValueError(f"worth is {worth}, expected a share of the error, above 0 and below 1")
    if scene.shape != "mesh":
        raise ValueError(f"scene {scene.name} has the shape {scene.shape}, expected a mesh: other shapes are not cut")
    if len(scene.parts) > len(scene.patch_names):
        raise ValueError(f"scene {scene.name} has a split_z, expected whole patches: take that line out")
    strips = _Strips.of(scene, samples)
    misfit = _misfits(strips, update, executor)
    enough_n = min(scene.tolerances[name] for name in of_kind(scene.load_names, FORCE))
    found = []
    for p, patch in enumerate(scene.patch_names):
        if misfit[p, 0, -1] == 0.0:
            raise ValueError(f"samples: patch {patch!r} never bears, expected samples in contact")
        cuts, parts_n = worthwhile(best_cuts(misfit[p]), enough_n, worth)
        edges = strips.edges_mm[p]
        cuts_mm = tuple(float(round(edges[k], 2)) for k in cuts)
        given = scene.geometry["patches"][patch].get("z", (edges[0], edges[-1]))
        bounds_mm = (float(given[0]), float(given[1]))
        found.append(PatchCuts(patch, bounds_mm, cuts_mm, math.sqrt(misfit[p, 0, -1]), parts_n))
    return found


def cut_scene(scene: Scene, cuts_mm: Sequence[Sequence[float]], bounds_mm: Sequence[tuple[float, float]]) -> Scene:
    """The scene with these cuts in each patch, between its bounds along z."""
    geometry = scene.tables["geometry"]
    patches: dict[str, Any] = {name: dict(table) for name, table in geometry["patches"].items()}
    for patch, cuts, bounds in zip(scene.patch_names, cuts_mm, bounds_mm, strict=True):
        if cuts:
            patches[patch] |= {"z": list(bounds), "split_z": [float(cut) for cut in cuts]}
    return Scene.from_tables({**scene.tables, "geometry": {**geometry, "patches": patches}})


@dataclass(frozen=True)
class _Strips:
    """The patches in strips between edges_mm (patches, STRIPS + 1): normal loads and gaps (n, patches, STRIPS) of each
    in poses (n, 6), of which validation (n,) judge."""

    scene: Scene
    edges_mm: Array
    poses: Array
    loads_n: Array
    gaps_mm: Array
    validation: np.ndarray

    @classmethod
    def of(cls, scene: Scene, samples: Samples) -> _Strips:
        """In the poses of at most `ROWS` of the samples."""
        reach = [_reach_mm(scene, p) for p in range(len(scene.patch_names))]
        edges = np.array([np.linspace(*ends, STRIPS + 1) for ends in reach])
        cells = square_cells(cell_sizes_mm(scene)[_CELLS])
        model = CellFoundation(cut_scene(scene, edges[:, 1:-1].tolist(), reach), cells)
        rows = np.flatnonzero(fitted_rows(samples)[0])
        chosen = np.random.default_rng(0).permutation(rows)[:ROWS]
        poses, shape = samples.poses[chosen], (len(chosen), len(reach), STRIPS)
        normals = [part.normal for part in model.scene.parts]
        loads = np.maximum(normal_forces(normals, model.part_wrenches(poses)), 0.0)
        validation = samples.role[chosen] == VALIDATION
        return cls(scene, edges, poses, loads.reshape(shape), model.part_gaps(poses).reshape(shape), validation)

    def run(self, p: int, i: int, j: int) -> tuple[Scene, Array, Array, Array, np.ndarray]:
        """What `mean_square_error` takes of patch p from edge i to edge j."""
        anchor = self.scene.anchors_mm[p].copy()
        anchor[2] = 0.5 * (self.edges_mm[p, i] + self.edges_mm[p, j])
        local = local_poses(self.poses, anchor)[:, list(self.scene.pose_space.free)]
        loads, gaps = self.loads_n[:, p, i:j].sum(axis=1), self.gaps_mm[:, p, i:j].min(axis=1)
        return self.scene, local, loads, gaps, self.validation


def _misfits(strips: _Strips, update: Update | None, executor: Executor | None) -> Array:
    """e² (patches, STRIPS + 1, STRIPS + 1) of every run of strips, infinite elsewhere."""
    patches = range(len(strips.edges_mm))
    misfit = np.full((len(patches), STRIPS + 1, STRIPS + 1), np.inf)
    runs = [(p, i, j) for p in patches for i, j in itertools.combinations(range(STRIPS + 1), 2)]
    with worker_pool(executor) as workers:
        futures = {workers.submit(mean_square_error, *strips.run(*run)): run for run in runs}
        with cancelled_if_left(workers, futures):
            for done, future in enumerate(as_completed(futures), start=1):
                misfit[futures[future]] = future.result()
                if update is not None:
                    update("parts tried", done, len(futures), "")
    return misfit


def mean_square_error(scene: Scene, local: Array, loads_n: Array, gaps_mm: Array, validation: np.ndarray) -> float:
    """e² [N²] of a small network of one part's root load (`patch.targets`) on validation rows, without the worst.

    local (n, k): poses of the part; loads_n, gaps_mm (n,). A part that hardly ever bears is as wrong as its load is.
    """
    contact = loads_n > 0.0
    if (contact & ~validation).sum() < _FEWEST:
        return _without_outliers(loads_n[validation] ** 2)
    target = root_target(loads_n, gaps_mm, scene)
    weight, false_load = root_weight(target, scene), np.where(contact, 0.0, scene.reference_load)
    part = Regression("part", local, target, weight, validation, tolerance=0.0, false_load=false_load)
    network = fit(part, TrainingSettings(sizes=(_HIDDEN,), max_gflop=_GFLOP, restarts=0)).network
    found_n = scene.reference_load * np.maximum(network.value(local[validation]), 0.0) ** 2
    return _without_outliers((found_n - loads_n[validation]) ** 2)


def _without_outliers(squares: Array) -> float:
    kept = len(squares) - int(_OUTLIERS * len(squares))
    return float(np.sort(squares)[:kept].mean()) if kept else 0.0


def best_cuts(misfit: Array) -> list[tuple[float, tuple[int, ...]]]:
    """For K = 1, 2, ... parts the least √Σ misfit and the cuts that reach it, of n strips.

    misfit (n + 1, n + 1): of a part from edge i to edge j > i. A shortest path from edge 0 to edge n in K steps.
    """
    last = len(misfit) - 1
    reached: dict[int, tuple[float, tuple[int, ...]]] = {0: (0.0, ())}
    found = []
    for _ in range(last):
        steps = {
            j: [(sum_before + misfit[i, j], (*path, i)) for i, (sum_before, path) in reached.items() if i < j]
            for j in range(1, last + 1)
        }
        reached = {j: min(ways) for j, ways in steps.items() if ways}
        total, path = reached[last]
        found.append((math.sqrt(total), path[1:]))
    return found


def worthwhile(
    by_count: Sequence[tuple[float, tuple[int, ...]]], enough: float, worth: float = WORTH
) -> tuple[tuple[int, ...], float]:
    """The cuts into so many parts that their error is small enough, or that one more takes less than a share of it off;
    and that error."""
    for (error, cuts), (next_error, _) in itertools.pairwise(by_count):
        if error <= enough or next_error > (1.0 - worth) * error:
            return cuts, error
    return by_count[-1][1], by_count[-1][0]


def _reach_mm(scene: Scene, patch: int) -> tuple[float, float]:
    """How far the patch's elements reach along z, in whole millimetres; no farther than the scene says."""
    z = scene.elements(scene.grids["teacher"])[patch].centres_mm[:, 2]
    low, high = scene.geometry["patches"][scene.patch_names[patch]].get("z", (-np.inf, np.inf))
    return float(max(np.floor(z.min()), low)), float(min(np.ceil(z.max()), high))
