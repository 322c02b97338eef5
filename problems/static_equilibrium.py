"""Static equilibrium: at which pose do contact and soft tissue carry six given loads, over flexion?

    min ½ Σ |r_i/L_i|²,    r_i(q) = Q_i(q; loads) - Q_i(q; contact(q)) - k_i·(q_i - rest_i)

with generalised forces Q of the loads about the moving origin (`casadi_contact.optimisation.static_equilibrium`). All
flexions stand in one IPOPT problem.
"""

from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, WRENCH_NAMES, pose_index
from casadi_contact.core.quantities import quantity
from casadi_contact.core.terminal import numbers, run_program
from casadi_contact.optimisation.reference import reference_model
from casadi_contact.optimisation.starts import middle_pose
from casadi_contact.optimisation.static_equilibrium import SOFT_TISSUE, EquilibriumResult, StaticEquilibrium
from casadi_contact.optimisation.verification import verify
from casadi_contact.pictures.page import frame, new_page, save_page
from casadi_contact.scenes.columns import write_columns
from problems.contact_source import load_contact
from problems.summary import tell


def main(
    surrogate: str | None = None,
    scene: str | None = None,
    loads: str = "-100,-1500,0,7500,-2000,0",
    flexions: str = "0,5,15,30,45,60,75",
    soft: bool = False,
    restarts: int = 20,
    out: Path = Path("results/static_equilibrium"),
) -> None:
    """Find the poses that carry the loads Fx,Fy,Fz,Tx,Ty,Tz [N, N·mm] at flexions [degrees]; verify them on elements.

    soft: rz is free too, with soft-tissue springs that are slack at the flexion. restarts: random starts of rows that
    stay unsolved. Exit status 3: some loads have no equilibrium; 4: all have, but the elements differ in some."""
    model = load_contact(surrogate, scene, whole=True)
    space, angles = model.scene.pose_space, np.radians(numbers(flexions, "flexions"))
    rest = np.tile(middle_pose(model), (len(angles), 1))
    neutral = [pose_index(name) for name in ("tx", "tz", "ry")]
    rest[:, neutral] = model.scene.start_pose[neutral]
    rest[:, pose_index("rz")] = -angles
    free = [name for name in POSE_NAMES if not space.constraint_text(name) and (soft or name != "rz")]
    given = np.tile(numbers(loads, "loads"), (len(angles), 1))
    problem = StaticEquilibrium(
        model, given, free=free, rest=space.project(rest), stiffness=SOFT_TISSUE if soft else None, about="moving"
    )
    result = problem.solve(restarts=restarts)
    verdict = verify(model, result.poses, reference_model(model), result.solved)

    tell(result, verdict, "in equilibrium")
    print("flexion [°]  tx [mm]  ty [mm]  tz [mm]   rx [°]   ry [°]  misfit [N]")
    for pose, misfit in zip(result.poses, result.misfit_n, strict=True):
        shown = np.append(pose[:3], np.degrees(pose[3:5]))
        print(f"{-np.degrees(pose[5]):11.1f}  {' '.join(f'{v:8.4f}' for v in shown)}  {np.abs(misfit).max():9.1e}")
    out.mkdir(parents=True, exist_ok=True)
    columns: dict[str, Any] = {quantity(name).column: result.poses[:, k] for k, name in enumerate(POSE_NAMES)}
    for k, name in enumerate(WRENCH_NAMES):
        unit = quantity(name).kind.plain_unit
        columns |= {f"{name}_given_{unit}": given[:, k], f"{name}_contact_{unit}": result.wrenches[:, k]}
    columns |= {"outcome": [outcome.value for outcome in result.outcome], "verdict": verdict.words}
    write_columns(out / "static_equilibrium.csv", columns, digits=9)
    draw(out / "static_equilibrium.png", result)
    print(f"results in {out}")
    raise SystemExit(verdict.exit_code)


def draw(path: Path, result: EquilibriumResult) -> None:
    """Poses over flexion."""
    page = new_page(12.0, 3.5)
    flexion = -np.degrees(result.poses[:, 5])
    axes = page.subplots(1, 3)
    for axis, names, unit in zip(axes, (("tx", "tz"), ("ty",), ("rx", "ry")), ("mm", "mm", "°"), strict=True):
        for name in names:
            values = result.poses[:, POSE_NAMES.index(name)]
            axis.plot(flexion, np.degrees(values) if unit == "°" else values, "o-", label=name)
        axis.set_ylabel(f"[{unit}]")
        axis.legend()
    frame(axes, "flexion [°]")
    save_page(page, path)


if __name__ == "__main__":
    run_program(main)
