"""Wear of a tibial insert by Archard's law, summed over a closed cycle of poses.

    h = k·∮ p·|v_t| dt        [mm] of each element of the insert, k [mm³/(N·m)] over 1000 mm/m

p is the pressure, v_t the tangential part of the moving body's velocity. Between two poses the pressure is the mean of
both ends and the sliding that of the rigid motion about the middle t_m of its way Δt,

    Δs = Δt + ω × (c - t_m),    Δs_t = Δs - n·(n·Δs),    ω the axial vector of the skew part of R₂R₁ᵀ

with the element's centre c and normal n. The worn volume Σ A·h is in proportion to the number of cycles: the surface
keeps its form. Cross-shear, creep and lubrication are left out.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import casadi_contact as cc
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Array, as_poses, rotation
from casadi_contact.core.terminal import run_program
from casadi_contact.pictures.page import name_axes, new_page, save_page, view_of
from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.pose_file import read_poses
from problems import knee_simulator


@dataclass(frozen=True)
class PatchWear:
    """Elements of a patch: centres (m, 3), areas (m,), in a cycle depth worn (m,) and way slid under pressure (m,)."""

    patch: str
    centres_mm: Array
    areas_mm2: Array
    depth_mm: Array
    sliding_mm: Array

    @property
    def volume_mm3(self) -> float:
        """Volume worn off in one cycle."""
        return float(self.depth_mm @ self.areas_mm2)


def archard_wear(model: ElasticFoundation, poses: Array, wear_factor: float = 1e-7) -> list[PatchWear]:
    """Wear of every patch over a cycle of poses (n, 6), the last of which is followed by the first.

    wear_factor [mm³/(N·m)]: the default is that of Fregly, Sawyer, Harman and Banks (J Biomech 38 (2005) 305-314)."""
    poses = as_poses(poses)
    if len(poses) < 2 or not 0.0 < wear_factor < np.inf:
        raise ValueError(f"got {len(poses)} poses and wear factor {wear_factor}, expected 2 or more and a number > 0")
    elements = model.scene.elements(model.grid)
    depths, slides = ([np.zeros(len(e.areas_mm2)) for e in elements] for _ in range(2))
    before = [found.pressures_mpa for found in model.pressure_maps(poses[-1])]
    for first, second in zip(np.roll(poses, 1, axis=0), poses, strict=True):
        after = [found.pressures_mpa for found in model.pressure_maps(second)]
        turn = rotation(second[3:]) @ rotation(first[3:]).T
        omega = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        middle, way = 0.5 * (first[:3] + second[:3]), second[:3] - first[:3]
        for p, e in enumerate(elements):
            pressure = 0.5 * (before[p] + after[p])
            rows = np.flatnonzero(pressure)
            slid, n = way + np.cross(omega, e.centres_mm[rows] - middle), e.normals[rows]
            tangential = np.linalg.norm(slid - np.sum(n * slid, axis=1)[:, None] * n, axis=1)
            depths[p][rows] += wear_factor / 1000.0 * pressure[rows] * tangential
            slides[p][rows] += tangential
        before = after
    return [
        PatchWear(patch, e.centres_mm, e.areas_mm2, depth, slid)
        for patch, e, depth, slid in zip(model.patch_names, elements, depths, slides, strict=True)
    ]


def simulated_cycle(model: ElasticFoundation, frames: int) -> Array:
    """Poses (frames, 6) of the knee simulator's second cycle on the scene's foundation; by then it is periodic."""
    simulator = knee_simulator.build(cc.foundation(model.scene))
    start = knee_simulator.start_state(simulator)
    motion = knee_simulator.simulate(simulator, start, cycles=2.0, frames=2 * frames + 1, tolerance=1e-7)
    return motion.poses[frames:-1]


def main(
    scene: str = "knee",
    poses: Path | None = None,
    frames: int = 200,
    wear_factor: float = 1e-7,
    cycles: float = 1e6,
    friction: float = 0.0,
    out: Path = Path("results/wear"),
) -> None:
    """Wear of a scene's fixed body on its finest elements, over the knee simulator's cycle or one closed cycle from a
    file of poses (CSV with tx_mm ... rz_rad, or .sto). friction: of the simulated knee; it does the work μ·V/k."""
    contact = cc.load_scene(scene, **knee_simulator.rubbing(friction))
    model = cc.ElasticFoundation(contact, contact.grids["teacher"])
    path = simulated_cycle(model, frames) if poses is None else read_poses(poses)
    deepest, thickness = float(model.summary(path).penetration_mm.max()), contact.material.thickness
    if not 0.0 < deepest < thickness:
        raise ValueError(f"penetration is {deepest:g} mm of a layer of {thickness:g} mm: are poses in mm and rad?")
    wear = archard_wear(model, path, wear_factor)
    every_other = sum(patch.volume_mm3 for patch in archard_wear(model, path[::2], wear_factor))

    total = sum(patch.volume_mm3 for patch in wear)
    print(f"wear of {contact.name} in {cycles:g} cycles, {model.label}, k = {wear_factor:g} mm³/(N·m)")
    print("patch  volume [mm³]  deepest [mm]  worn area [mm²]")
    for patch in wear:
        area = patch.areas_mm2[patch.depth_mm > 0.0].sum()
        print(f"{patch.patch:5s} {cycles * patch.volume_mm3:13.3f} {cycles * patch.depth_mm.max():13.4f} {area:16.1f}")
    if friction:
        print(f"friction of {friction:g} takes {friction * total / wear_factor:.3g} J a cycle")
    print(f"with every other pose the volume is {100.0 * (every_other / total - 1.0):+.2g} %")

    out.mkdir(parents=True, exist_ok=True)
    centres = np.concatenate([patch.centres_mm for patch in wear])
    depth = cycles * np.concatenate([patch.depth_mm for patch in wear])
    slid = np.concatenate([patch.sliding_mm for patch in wear])
    named = {f"{axis}_mm": centres[:, i] for i, axis in enumerate("xyz")}
    write_columns(out / "wear.csv", {**named, "depth_mm": depth, "sliding_mm_per_cycle": slid}, digits=5)
    view = view_of(model)  # as the moving body presses
    right, up = view.right.of(centres), view.up.of(centres)
    page = new_page(10.0, 4.0)
    labels = ("worn [µm]", "slid under pressure in a cycle [mm]")
    for axis, values, label in zip(page.subplots(1, 2), (1e3 * depth, slid), labels, strict=True):
        image = axis.scatter(right, up, c=np.where(values > 0.0, values, np.nan), s=1.0, marker="s", cmap="viridis")
        page.colorbar(image, ax=axis, label=label, orientation="horizontal")
        name_axes(axis, view)
    save_page(page, out / "wear.png")


if __name__ == "__main__":
    run_program(main)
