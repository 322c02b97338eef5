"""Stability where methods fail, one table of method by failure: bad starts, lift-off, poses out of the learned range.

Methods are surrogates of a scene, its foundation, its elements, and two peers fitted to poses about the motion. Run
``python -m problems.studies.stability --help``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from casadi_contact.contact.callable_model import CallableModel
from casadi_contact.contact.choice import foundation
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.settle import settle
from casadi_contact.core.conventions import POSE_IN_MM, POSE_NAMES, Array, pose_index
from casadi_contact.core.files.writing import writable_folder, write_text
from casadi_contact.core.machine import machine_record
from casadi_contact.core.quantities import three_digits
from casadi_contact.core.terminal import PlainConsole, run_program
from casadi_contact.optimisation.starts import pose_bounds
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.workflow.project import built_in_motion, shipped_surrogates
from problems.studies.peers import LOADS, Peer
from problems.studies.regressors import METHODS, learned

FAILURES = {1: "starts out of contact and too deep", 2: "lift-off", 3: "poses to three times the learned range"}
FOUNDATION, ELEMENTS = "foundation", "EF"
LIFTS_MM = (0.5, 2.0, 5.0, 20.0, -0.5, -2.0, -5.0)  # out of contact; below zero, too deep


@dataclass(frozen=True)
class Line:
    """One measured quantity of one failure: for every method a number, a short text, or no entry."""

    row: int
    case: str
    quantity: str
    values: Mapping[str, float | str]

    def cell(self, method: str) -> str:
        """What the table shows: "-" where the quantity makes no sense for a method."""
        value = self.values.get(method, "-")
        return value if isinstance(value, str) else three_digits(value)


@dataclass(frozen=True)
class Bench:
    """Models by method, poses (n, 6) of the scene's motion, and the EF on the finest grid, the truth; surrogates: names
    of the methods that are; the range of the first is the learned range."""

    scene: Scene
    models: Mapping[str, Any]
    surrogates: tuple[str, ...]
    truth: ElasticFoundation
    poses: Array

    @classmethod
    def of(cls, scene_name: str, surrogates: Sequence[str] = ()) -> Bench:
        """Surrogates (the shipped ones of the scene, or names and paths), foundation, elements, and peers."""
        scene = load_scene(scene_name)
        learned = {name: load_surrogate(name) for name in surrogates} if surrogates else shipped_surrogates(scene)
        if not learned:
            raise ValueError(f"no surrogate of scene {scene.name} is shipped: name one by --surrogate")
        poses = built_in_motion(scene).poses.reshape(-1, 6)
        elements = ElasticFoundation(scene, scene.grids["fine"])
        models = {**learned, FOUNDATION: foundation(scene), ELEMENTS: elements, **_peers(elements, poses)}
        chosen = poses[np.linspace(0, len(poses) - 1, min(101, len(poses))).astype(int)]
        return cls(scene, models, tuple(learned), ElasticFoundation(scene, scene.grids["teacher"]), chosen)


def _peers(model: ElasticFoundation, poses: Array, count: int = 400) -> dict[str, CallableModel]:
    """Regressors fitted to poses moved by up to 1 mm (rotations over 25 mm), the sensitive parameters by a fifth."""
    rng, scene = np.random.default_rng(0), model.scene
    size = np.where(np.isin(POSE_NAMES, scene.sensitive_pose), 0.2, 1.0)
    drawn = poses[rng.integers(len(poses), size=count)] + size / POSE_IN_MM * rng.uniform(-1.0, 1.0, (count, 6))
    models = {}
    for family, settings in (("polynomial", "3"), ("Gaussian process", "2000 points")):
        fit = learned(METHODS[family][settings], drawn[:, list(scene.pose_space.free)], model(drawn), np.ones(count))
        models[family] = contact_model(Peer(scene, scene.load_names, {LOADS: fit}))
    return models


def contact_model(peer: Peer) -> CallableModel:
    """A fitted peer as a contact model: s = √(N/N0) where it predicts contact, 0 without a slope elsewhere."""
    return CallableModel(
        peer.scene,
        lambda poses: patch_wrenches(peer, peer(poses)),
        lambda poses: np.zeros((len(poses), len(peer.scene.patch_names))),
    )


def patch_wrenches(model: Any, loads: Array) -> Array:
    """Wrenches (n, patches, 6) that give a model's named loads (n, L): patches take equal shares of one together."""
    picked = model.scene.selection(model.load_names)
    return np.einsum("lpk,nl->npk", picked / (picked**2).sum(axis=(1, 2), keepdims=True), loads)


def normal_loads(model: Any, loads: Array) -> Array:
    """Normal load (n, patches) of named loads (n, L), below zero where a patch pulls."""
    return normal_forces(model.scene.normal_loads, patch_wrenches(model, loads))


def lifted(model: ElasticFoundation, poses: Array, lift_mm: float, rng: np.random.Generator) -> Array:
    """Poses moved at random in the scene's sensitive parameters by up to 1 mm (rotations over 25 mm), and by lift_mm
    against the force that the body presses with (into the other body, if negative)."""
    free = [pose_index(name) for name in model.scene.sensitive_pose]
    moved, force = poses.copy(), model.wrenches(poses)[:, :, :3].sum(axis=1)
    force[:, [k for k in range(3) if k not in free]] = 0.0
    moved[:, :3] -= lift_mm * force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-300)
    moved[:, free] += rng.uniform(-1.0, 1.0, (len(moved), len(free))) / POSE_IN_MM[free]
    return moved


def starts(bench: Bench, count: int = 200, lifts_mm: tuple[float, ...] = LIFTS_MM) -> list[Line]:
    """Row 1: from bad starts, does settling under the loads that a method itself has at a pose find that pose again,
    within 0.01 mm, and in how many iterations? Poses press every patch by 20 N or more."""
    rng, scene = np.random.default_rng(1), bench.scene
    near = bench.poses[(normal_loads(bench.truth, bench.truth(bench.poses)) > 20.0).all(axis=1)]
    near = near[np.linspace(0, len(near) - 1, count).astype(int)]
    presses, lines = ElasticFoundation(scene, scene.grids["coarse"]), []
    for lift in lifts_mm:
        start, shares = lifted(presses, near, lift, rng), dict[str, float | str]()
        for method, model in bench.models.items():
            loads = model(near)
            targets = {name: loads[:, model.load_names.index(name)] for name in scene.sensitive_loads}
            found, report = settle(model, start, scene.sensitive_pose, targets, tolerance=1e-3, max_iterations=100)
            there = np.abs((found - near) * POSE_IN_MM).max(axis=1) < 0.01  # mm
            good = report.converged & there & (normal_loads(model, loads) > 0.0).all(axis=1)
            used = f" / {np.median(report.iterations[good]):.0f}" if good.any() else ""
            shares[method] = f"{100.0 * good.mean():.0f}{used}"
        case = f"{abs(lift):g} mm {'out' if lift > 0.0 else 'too deep'}"
        lines.append(Line(1, case, f"of {count} solved [%] / median iterations", shares))
    return lines


def lift_off_height(model: Any, pose: Array, patch: int, highest_mm: float = 5.0) -> float:
    """Height [mm] above a pose at which a patch ceases to carry load; NaN where it carries load 5 mm up."""
    up = np.eye(6)[pose_index("ty")]
    low, high = 0.0, highest_mm
    for _ in range(6):  # each time a part in 500 of the interval, so that the first zero is found
        heights = np.linspace(low, high, 501)
        free = np.flatnonzero(normal_loads(model, model(pose + heights[:, None] * up))[:, patch] <= 0.0)
        if not len(free) or free[0] == 0:
            return float("nan")
        low, high = heights[free[0] - 1], heights[free[0]]
    return float(low)


def one_sided(model: Any, pose: Array, height_mm: float, load: str) -> dict[str, tuple[float, float]]:
    """N [N], dN/dty [N/mm], d²N/dty² [N/mm²] of a vertical load just in contact and just out of it."""
    column, up = model.load_names.index(load), np.eye(6)[pose_index("ty")]
    sides: dict[str, list[float]] = {"N": [], "dN": [], "ddN": []}
    for way in (-1.0, 1.0):
        at = [pose + (height_mm + way * off) * up for off in (1e-5, 1e-3, 2e-3)]
        loads, slopes = model.jacobian(np.array(at))
        slope = 0.0 - slopes[:, column, pose_index("ty")]  # a difference, so that no load is 0, not -0
        sides["N"].append(0.0 - loads[0, column])
        sides["dN"].append(slope[0])
        sides["ddN"].append(way * (slope[2] - slope[1]) / 1e-3)
    return {name: (float(pair[0]), float(pair[1])) for name, pair in sides.items()}


def liftoff(bench: Bench) -> list[Line]:
    """Row 2, of a knee: how the lateral load and its derivatives end where that side lifts off."""
    names = {"N": "N [N]", "dN": "dN/dty [N/mm]", "ddN": "d²N/dty² [N/mm²]"}
    cells: dict[str, dict[str, float | str]] = {name: {} for name in names}
    for method, model in bench.models.items():
        height = lift_off_height(model, bench.poses[0], bench.scene.patch_names.index("lat"))
        if not np.isnan(height):
            for name, pair in one_sided(model, bench.poses[0], height, "Fy_lat").items():
                cells[name][method] = " → ".join(map(three_digits, pair))
    return [Line(2, "in contact → out", names[name], values) for name, values in cells.items()]


def count_failures(model: Any, poses: Array, gaps_of: ElasticFoundation, apart_mm: float = 3.0) -> tuple[int, ...]:
    """Poses with a load that is not finite, with a pulling patch, with contact where the patch's surfaces are more than
    apart_mm apart; of a surrogate also how many of these have a validity above 1/2."""
    loads = np.concatenate([model(chunk) for chunk in np.array_split(poses, max(1, len(poses) // 5000))])
    broken = ~np.isfinite(loads).all(axis=1)
    pressed = normal_loads(model, loads)
    pulling, touching = (pressed < 0.0).any(axis=1), (pressed > 0.0).any(axis=1)
    apart = np.zeros(len(poses), dtype=bool)
    if touching.any():
        apart[touching] = ((gaps_of.gaps(poses[touching]) > apart_mm) & (pressed[touching] > 0.0)).any(axis=1)
    counts = tuple(int(rows.sum()) for rows in (broken, pulling, apart))
    if not isinstance(model, Surrogate):
        return counts
    wrong = poses[broken | pulling | apart]
    return (*counts, int((model.validity(wrong) > 0.5).sum()) if len(wrong) else 0)


def out_of_range(bench: Bench, count: int = 100_000, times: float = 3.0, per_parameter: int = 600) -> list[Line]:
    """Row 3: each parameter alone over three times the learned range, then all at once at random."""
    gaps_of = ElasticFoundation(bench.scene, bench.scene.grids["fine"])
    low, high = pose_bounds(bench.models[bench.surrogates[0]])
    middle, half = 0.5 * (low + high), 0.5 * times * (high - low)
    cases = {}
    for column, name in enumerate(POSE_NAMES):
        poses = np.tile(bench.poses[len(bench.poses) // 3], (per_parameter, 1))
        poses[:, column] = middle[column] + half[column] * np.linspace(-1.0, 1.0, per_parameter)
        cases[f"{name}, {per_parameter} poses"] = poses
    cases[f"all at random, {count:,} poses"] = middle + half * np.random.default_rng(0).uniform(-1.0, 1.0, (count, 6))
    quantity = "not finite / pulling / false contact / of these called valid"
    lines = []
    for case, poses in cases.items():
        counts = {method: count_failures(model, poses, gaps_of) for method, model in bench.models.items()}
        lines.append(Line(3, case, quantity, {method: " / ".join(map(str, found)) for method, found in counts.items()}))
    return lines


def run(
    scene: Annotated[str, typer.Argument(help="ready scene, or the path of a .toml")] = "knee",
    surrogate: Annotated[
        list[str] | None,
        typer.Option(help="name or .h5 file of a surrogate of the scene; the shipped ones if left out"),
    ] = None,
    out: Annotated[Path, typer.Option(help="folder for stability.json")] = Path("results/stability"),
    quick: Annotated[bool, typer.Option("--quick", help="fewer starts and poses: some minutes")] = False,
) -> None:
    """Measure every method on every failure."""
    writable_folder(out)
    bench, lines = Bench.of(scene, surrogate or ()), list[Line]()
    settings = {"scene": bench.scene.name, "surrogates": ", ".join(bench.surrogates), "quick": "yes" if quick else "no"}
    lines += starts(bench, 20 if quick else 200)
    lines += liftoff(bench) if "Fy_lat" in bench.scene.load_names else []
    lines += out_of_range(bench, 2_000 if quick else 100_000)
    content = {"settings": settings, "lines": [asdict(line) for line in lines], "machine": machine_record()}
    write_text(out / "stability.json", json.dumps(content, indent=1, ensure_ascii=False, default=str))
    table = Table("failure, case", "quantity", *bench.models, title="Stability where methods fail")
    for line in lines:
        cells = (f"{line.row}. {line.case}", line.quantity, *(line.cell(method) for method in bench.models))
        table.add_row(*map(escape, cells))
    PlainConsole().print(table)
    print(f"results in {out}")


if __name__ == "__main__":
    run_program(run)
