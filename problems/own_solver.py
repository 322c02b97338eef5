"""A user's own finite element solver: CalculiX (`ccx`) presses a sphere on a block, IPOPT uses what was learned of it.

    deck        block of hexahedra (C3D8I) on a rigid back, the sphere a stiff cap that moves as a whole, frictionless
    samples     one run of the solver, one *STEP for each pose (tx, ty, tz) of the sphere; reactions of the back
    surrogate   `cc.build(scene, table=...)`
    problem     find ty at tx, tz that carries F, with exact derivatives; verified by one more run of the solver

CalculiX is Debian's package calculix-ccx; 100 poses take half a minute.
"""

import os
import re
import shutil
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np

import casadi_contact as cc
from casadi_contact.core.conventions import POSE_NAMES, WRENCH_NAMES, Array
from casadi_contact.core.terminal import run_program
from casadi_contact.samples.domains import hammersley
from casadi_contact.scenes.columns import write_columns
from casadi_contact.scenes.scene import Scene
from casadi_contact.workflow.benchmark.candidates import time_single_calls

SCENE = """format = 1
name = "ccx_block"
like = "sphere_on_plane"
pose = { locked = { rx = 0.0, ry = 0.0, rz = 0.0 } }
material = { poissons_ratio = 0.3 }
loads = { names = ["Fx", "Fy", "Fz"] }
tolerances = { Fx = 10.0, Fy = 10.0, Fz = 10.0 }
"""


def bricks(x: Array, y: Array, z: Array, first: int) -> tuple[Array, np.ndarray]:
    """Nodes (n, 3) of hexahedra at x (nx,), y (nx, ny, nz) from below, z (nz,), and their numbers from `first` in each
    element (e, 8), the lower four first."""
    number = first + np.arange(y.size).reshape(y.shape)
    face = [number[:-1, :, :-1], number[:-1, :, 1:], number[1:, :, 1:], number[1:, :, :-1]]
    corners = [f[:, :-1] for f in face] + [f[:, 1:] for f in face]
    X, Z = np.broadcast_to(x[:, None, None], y.shape), np.broadcast_to(z, y.shape)
    return np.stack([X, y, Z], -1).reshape(-1, 3), np.stack(corners, -1).reshape(-1, 8)


def deck(scene: Scene, poses: Array, elements: tuple[int, int] = (12, 3)) -> str:
    """CalculiX's input for poses (n, 6): elements across the block and over its thickness."""
    material, radius, even = scene.material, scene.geometry["radius"], np.linspace(-1.0, 1.0, elements[0] + 1)
    x = 0.5 * scene.geometry["patch_side"] * (0.4 * even + 0.6 * even**3)  # dense in the middle
    depths = -material.thickness * np.linspace(1.0, 0.0, elements[1] + 1) ** 1.5
    block, of_block = bricks(x, np.broadcast_to(depths[:, None], (len(x), len(depths), len(x))), x, 1)
    s = np.linspace(-0.2, 0.2, 2 * elements[0] + 1) * radius
    under = radius - np.sqrt(radius**2 - s[:, None] ** 2 - s[None, :] ** 2)
    cap, of_cap = bricks(s, np.stack([under, under + 1.0], 1), s, len(block) + 1)
    numbers, moved = np.arange(1, len(block) + 1), np.arange(len(block) + 1, len(block) + len(cap) + 1)
    sets = {"TOP": numbers[block[:, 1] == 0.0], "BACK": numbers[block[:, 1] == depths[0]], "MOVED": moved}

    def rows(first: int, columns: np.ndarray) -> list[str]:
        return [f"{k}, {', '.join(map(str, row))}" for k, row in enumerate(columns.tolist(), first)]

    count = len(of_block)
    lines = ["*NODE", *rows(1, np.concatenate([block, cap])), "*ELEMENT, TYPE=C3D8I, ELSET=BLOCK", *rows(1, of_block)]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=CAP", *rows(count + 1, of_cap)]
    for name, nodes in sets.items():
        lines += [f"*NSET, NSET={name}", *(f"{node}," for node in nodes)]
    for part, E, nu in (("BLOCK", material.youngs_modulus, material.poissons_ratio), ("CAP", 1e6, 0.3)):
        lines += [f"*MATERIAL, NAME={part}", "*ELASTIC", f"{E}, {nu}", f"*SOLID SECTION, ELSET={part}, MATERIAL={part}"]
    lines += ["*SURFACE, NAME=NODES, TYPE=NODE", "TOP", "*SURFACE, NAME=FACES"]
    lines += [f"{count + k}, S1" for k in range(1, len(of_cap) + 1)]
    lines += ["*SURFACE INTERACTION, NAME=TOUCH", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"]
    lines += ["2e5, 0.", "*CONTACT PAIR, INTERACTION=TOUCH, TYPE=NODE TO SURFACE", "NODES, FACES"]
    for pose in poses:
        shift = pose[:3] - [0.0, radius, 0.0]
        lines += ["*STEP", "*STATIC", "1., 1.", "*BOUNDARY", "BACK, 1, 3"]
        lines += [f"MOVED, {axis}, {axis}, {way}" for axis, way in enumerate(shift, start=1)]
        lines += ["*NODE PRINT, NSET=BACK, TOTALS=ONLY", "RF", "*END STEP"]
    return "\n".join(lines) + "\n"


def solved(scene: Scene, poses: Array, folder: Path) -> Array:
    """Wrenches on the block (n, 6) [N, N·mm] about its middle at poses (n, 6), by one run of CalculiX in a folder.

    Without friction the sphere's force points through its centre."""
    (folder / "block.inp").write_text(deck(scene, poses))
    subprocess.run(["ccx", "-i", "block"], cwd=folder, check=True, capture_output=True)
    totals = re.findall(r"force \(fx,fy,fz\).*\n\n(.*)\n", (folder / "block.dat").read_text())
    numbers = re.findall(r"\S+", re.sub(r"(?<=\d)(?=[+-]\d{3}\b)", "E", " ".join(totals)))  # Fortran's 1.0-105
    forces = -np.array(numbers, dtype=float).reshape(len(poses), 3)
    forces[np.abs(forces[:, 1]) < 1e-6] = 0.0
    return np.hstack([forces, np.cross(poses[:, :3], forces)])


def main(samples: int = 100, force_n: float = 400.0, out: Path = Path("results/own_solver")) -> None:
    """Sample CalculiX, learn it, and find by IPOPT the pose that carries a force."""
    if shutil.which("ccx") is None:
        print("own_solver needs CalculiX: apt-get install calculix-ccx")
        return
    out.mkdir(parents=True, exist_ok=True)
    (out / "ccx_block.toml").write_text(SCENE)
    scene, poses = cc.load_scene(out / "ccx_block.toml"), np.zeros((samples, 6))
    low, high = np.array([-3.0, 29.7, -3.0]), np.array([3.0, 30.02, 3.0])
    poses[:, :3] = low + (high - low) * hammersley(samples, 3, np.array([0.5, 0.0, 0.0]))[:, [1, 0, 2]]
    poses = poses[np.argsort(poses[:, 1])]  # the solver goes from pose to pose
    before = os.times().children_user
    wrenches = solved(scene, poses, out)
    seconds = (os.times().children_user - before) / samples
    columns = dict(zip((*POSE_NAMES, *WRENCH_NAMES), np.hstack([poses, wrenches]).T, strict=True))
    write_columns(out / "samples.csv", {**columns, "gap": poses[:, 1] - scene.geometry["radius"]})
    surrogate = cc.build(out / "ccx_block.toml", table=out / "samples.csv", folder=out / "build")["patch"]
    of_kernel = min(time_single_calls(surrogate.function(), poses) for _ in range(50))
    error = surrogate.record["test_errors"]["D1"]["Fy"]["rms"]
    print(f"CPU time of a pose: CalculiX {seconds:.2g} s, surrogate {1e6 * of_kernel:.2g} µs; RMS {error:.2g} N")

    opti = ca.Opti()
    contact = cc.ContactInOpti(opti, surrogate, locked={"tx": 1.0, "tz": -0.5})
    contact.carry({"Fy": -force_n})
    opti.solver("ipopt", contact.options())
    found = contact.poses(opti.solve())
    again = solved(scene, found, out)[0, 1]
    print(f"IPOPT: ty = {found[0, 1]:.4f} mm; there CalculiX has {again:.1f} N, wanted {-force_n:g} N")


if __name__ == "__main__":
    run_program(main)
