"""How wrong a scene's foundation is at worst: random poses, and a fine element grid on those in doubt; run on demand:

python -m tests.benchmarks.bench_worst problems/scenes/tka_mesh.toml --poses 100000
python -m tests.benchmarks.bench_worst hip

Poses are drawn over the ranges of the scene's reference motion and beyond (±4 mm, ±0.1 rad), pressed along its
direction of pressing (into a cup: along the pole) with 5 to 2,500 N. All are evaluated by the foundation that the scene
gets and by a finer one of the same kind; the reference speaks where these two differ most.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.cup.foundation import CupFoundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.core.conventions import Array
from casadi_contact.samples.reference import reference_poses
from casadi_contact.workflow.project import reference_motion_cycles

BEYOND = np.array([4.0, 4.0, 4.0, 0.1, 0.1, 0.1])  # of the reference motion, to each side [mm, rad]
FORCES_N = (5.0, 2500.0)
SHARE, LEAST_N = 0.03, 10.0  # an error may be this share of the patch's load and so much more
FINER_CELLS, FINER_RAYS = Cells(0.6, 0.45), Rays(96, 6)
REFERENCE = (320, 160)
CLEAR_MM = 10.0
_APPROACHES, _PRESSES = 12, 7


def drawn_poses(model: CompiledFoundation, count: int, seed: int = 0) -> Array:
    """Poses (m, 6), m <= count: those of `count` random ones that end pressed with the force drawn for them."""
    random = np.random.default_rng(seed)
    usual, _ = reference_poses(model, reference_motion_cycles(model.scene, ())[:2], frames=41)
    low, high = usual.min(axis=(0, 1)) - BEYOND, usual.max(axis=(0, 1)) + BEYOND
    poses, along = random.uniform(low, high, (count, 6)), pressing(model.scene)
    wanted = np.exp(random.uniform(*np.log(FORCES_N), count))
    start = (usual[..., :3] @ along).min() - CLEAR_MM
    poses[:, :3] += (start - poses[:, :3] @ along)[:, None] * along
    for _ in range(_APPROACHES):
        poses[:, :3] += np.clip(model.gaps(poses).min(axis=1), -1.0, None)[:, None] * along
    touching, depth = poses[:, :3].copy(), np.full(count, 0.1)
    for _ in range(_PRESSES):
        poses[:, :3] = touching + depth[:, None] * along
        force = np.linalg.norm(model.wrenches(poses)[:, :, :3].sum(axis=1), axis=1)
        depth *= np.clip(np.sqrt(wanted / np.maximum(force, 1e-3 * wanted)), 0.4, 2.5)
    return poses[(force > 0.5 * wanted) & (force < 2.0 * wanted)]


def pressing(scene: cc.Scene) -> Array:
    """The unit vector (3,) along which the moving body presses."""
    along = scene.normal_loads[0].direction
    if along is None:
        along = np.asarray(scene.geometry["pressing" if scene.shape == "mesh" else "cup_pole"], dtype=float)
    return np.asarray(along / np.linalg.norm(along))


def finer(model: CompiledFoundation) -> CompiledFoundation:
    """A model of the same kind that is as good as exact beside it."""
    if isinstance(model, cc.CellFoundation):
        return cc.CellFoundation(model.scene, FINER_CELLS)
    if isinstance(model, CupFoundation):
        return CupFoundation(model.scene, 96)
    return cc.PolarFoundation(model.scene, FINER_RAYS)


def excess(forces: Array, truth: Array) -> Array:
    """Errors of each patch's force over what is allowed (n, patches); forces and truth (n, patches, 3)."""
    return np.asarray(np.linalg.norm(forces - truth, axis=2) / (SHARE * np.linalg.norm(truth, axis=2) + LEAST_N))


def main(
    scene: Annotated[Path, typer.Argument(help="scene file, or a ready scene")],
    poses: Annotated[int, typer.Option(help="to draw")] = 20_000,
    doubtful: Annotated[int, typer.Option(help="evaluated by the reference")] = 200,
    cells: Annotated[tuple[float, float], typer.Option(help="instead of the chosen ones [mm]")] = (0.0, 0.0),
) -> None:
    """Print the worst of them."""
    loaded = cc.load_scene(scene)
    model = cc.foundation(loaded) if cells == (0.0, 0.0) else cc.CellFoundation(loaded, Cells(*cells))
    better = finer(model)
    print(f"{model}, {model.record}")
    drawn = drawn_poses(model, poses)
    found = model.wrenches(drawn)[..., :3]
    between = excess(found, better.wrenches(drawn)[..., :3]).max(axis=1)
    rim = model.at_edge(drawn).any(axis=1)
    print(f"{len(drawn)} of {poses} poses pressed, in {rim.sum()} contact reaches the rim")
    print(
        f"against {better}: more than allowed in {(between > 1.0).sum()}, {(between[~rim] > 1.0).sum()} within the rim"
    )
    reference = cc.ElasticFoundation(loaded, REFERENCE)
    for where, rows in (("at the rim", np.flatnonzero(rim)), ("within the rim", np.flatnonzero(~rim))):
        worst = rows[np.argsort(between[rows])[::-1][:doubtful]]
        if not len(worst):
            continue
        truth = reference.wrenches(drawn[worst])[..., :3]
        for name, forces in ((str(model), found[worst]), (str(better), better.wrenches(drawn[worst])[..., :3])):
            off = excess(forces, truth)
            n, p = np.unravel_index(off.argmax(), off.shape)
            sizes = [np.linalg.norm(each[n, p]) for each in (forces, truth)]
            print(
                f"{where}, the {len(worst)} in most doubt, {name} against EF {REFERENCE}: "
                f"{(off > 1.0).any(axis=1).sum()} off by more than {SHARE:.0%} + {LEAST_N:g} N; the worst by "
                f"{off.max():.2f} times that, {sizes[0]:.0f} instead of {sizes[1]:.0f} N in "
                f"{drawn[worst[n]].round(3).tolist()}"
            )


if __name__ == "__main__":
    typer.run(main)
