"""How long a fixed time step may be before integration of a loaded joint goes unstable, against its contact stiffness.

A joint at rest under constant loads is moved a little off its equilibrium and integrated with a fixed step h. The
step is stable if after `STEPS_TAKEN` steps the pose is no further off than `GROWTH` times its start. For eigenvalues
λ of the linearised motion, explicit schemes must keep every h·λ inside a bounded region (2/|λ| for Euler and 2.79/|λ|
for Runge-Kutta on the real axis), and the stiffest λ grows with the root of the contact stiffness over the moving
mass; implicit schemes have no such bound, only Newton's method can fail them.

Run ``python -m problems.studies.stable_step --help``.
"""

from __future__ import annotations

from typing import Annotated, Any

import casadi as ca
import numpy as np
import typer
from rich.table import Table

from casadi_contact.core.conventions import Array
from casadi_contact.core.terminal import PlainConsole, numbers
from casadi_contact.optimisation.starts import KNEE_STEPS
from casadi_contact.surrogate.load import load_surrogate
from problems import knee_simulator
from problems.common.command import new_app, run_command
from problems.knee_simulator import KneeSimulator, constant, start_state

SCHEMES = ("explicit_euler", "rk4", "implicit_euler", "implicit_midpoint")
STEPS_TAKEN = 1000
GROWTH = 3.0
LONGEST_STEP_S = 0.1  # of a cycle of 1 s; no more is asked of any scheme
_SHORTEST_STEP_S = 1e-9
_LOST = 1e4  # times the start: it does not come back
_OFF = 0.1 * KNEE_STEPS[:5]  # [mm, rad]
_BISECTIONS = 12


def step_function(simulator: KneeSimulator, scheme: str) -> ca.Function:
    """(state (10), step [s]) -> next state, under the loads at the start; raises ValueError for an unknown scheme."""
    if scheme not in SCHEMES:
        raise ValueError(f"scheme is {scheme!r}, expected one of {', '.join(SCHEMES)}")
    x, h = ca.MX.sym("x", 10), ca.MX.sym("h")

    def rate(state: ca.MX) -> ca.MX:
        return simulator.rate(state, 0.0)

    if scheme == "explicit_euler":
        return ca.Function(scheme, [x, h], [x + h * rate(x)])
    if scheme == "rk4":
        k1 = rate(x)
        k2 = rate(x + 0.5 * h * k1)
        k3 = rate(x + 0.5 * h * k2)
        k4 = rate(x + h * k3)
        return ca.Function(scheme, [x, h], [x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)])
    after = ca.MX.sym("after", 10)
    at = after if scheme == "implicit_euler" else 0.5 * (x + after)
    residual = ca.Function("residual", [after, x, h], [after - x - h * rate(at)])
    newton = ca.rootfinder("step", "newton", residual, {"abstol": 1e-10, "max_iter": 30, "error_on_fail": False})
    return ca.Function(scheme, [x, h], [newton(x, x, h)])


def is_stable(step: ca.Function, rest: Array, step_s: float, steps: int = STEPS_TAKEN) -> bool:
    """Whether a joint a little off its rest state (10,) stays near it over a number of steps."""
    state = rest + np.concatenate([_OFF, np.zeros(5)])
    last = 0.0
    for taken in range(1, steps + 1):
        state = np.asarray(step(state, step_s)).ravel()
        away = np.abs(state[:5] - rest[:5]) / _OFF
        if not np.isfinite(state).all() or away.max() > _LOST:  # before numbers overflow
            return False
        if taken > steps - max(steps // 10, 1):
            last = max(last, float(away.max()))
    return last <= GROWTH


def largest_stable_step(simulator: KneeSimulator, scheme: str, rest: Array, steps: int = STEPS_TAKEN) -> float:
    """Largest stable step [s] of a fixed-step scheme about the state rest (10,); `LONGEST_STEP_S` where that is stable,
    0 where none above 1 ns is. Found by halving from `LONGEST_STEP_S`, then bisection in the logarithm."""
    step = step_function(simulator, scheme)
    high = LONGEST_STEP_S
    if is_stable(step, rest, high, steps):
        return high
    low = 0.5 * high
    while not is_stable(step, rest, low, steps):
        high, low = low, 0.5 * low
        if low < _SHORTEST_STEP_S:
            return 0.0
    for _ in range(_BISECTIONS):
        middle = float(np.sqrt(low * high))
        if is_stable(step, rest, middle, steps):
            low = middle
        else:
            high = middle
    return low


def contact_stiffness(simulator: KneeSimulator, rest: Array) -> float:
    """dFy/dty [N/mm] of the contact force on the fixed body at a state (10,): above zero where it presses."""
    pose = ca.MX.sym("pose", 6)
    slope = ca.Function("slope", [pose], [ca.jacobian(simulator.contact(pose), pose)])
    return float(slope(simulator.pose(rest[:5], 0.0))[1, 1])


def fastest_rate(simulator: KneeSimulator, rest: Array) -> float:
    """Largest |λ| [1/s] of the linearised motion about a state (10,)."""
    x, t = ca.MX.sym("x", 10), ca.MX.sym("t")
    jacobian = ca.Function("jacobian", [x, t], [ca.jacobian(simulator.rate(x, t), x)])
    return float(np.abs(np.linalg.eigvals(np.asarray(jacobian(rest, 0.0)))).max())


app = new_app()


@app.command()
def run(
    surrogate: Annotated[str, typer.Option(help="a ready surrogate or the path of a .h5 file")] = "knee",
    axial: Annotated[str, typer.Option(help="axial forces [N], separated by commas")] = "50,200,800,2000",
    flexion_deg: Annotated[float, typer.Option(help="flexion held [degrees]")] = 20.0,
) -> None:
    """Table of the largest stable step of every scheme against axial force, and with it contact stiffness."""
    forces = numbers(axial, "axial")
    model = load_surrogate(surrogate)
    table = Table(title="Largest stable fixed step [ms]")
    for column in (
        "axial [N]",
        "stiffness [N/mm]",
        "fastest rate [1/s]",
        *(scheme.replace("_", " ") for scheme in SCHEMES),
    ):
        table.add_column(column, justify="right")
    for force in forces:
        simulator = knee_simulator.build(model, constant(flexion_deg, force))
        rest = start_state(simulator)
        cells: list[Any] = [f"{force:g}", f"{contact_stiffness(simulator, rest):.0f}"]
        cells.append(f"{fastest_rate(simulator, rest):.0f}")
        for scheme in SCHEMES:
            step = largest_stable_step(simulator, scheme, rest)
            cells.append(f"{'≥ ' if step == LONGEST_STEP_S else ''}{1e3 * step:.3g}")
        table.add_row(*cells)
    PlainConsole().print(table)


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, "studies.stable_step")


if __name__ == "__main__":
    main()
