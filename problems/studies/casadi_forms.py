"""What a CasADi user would write instead: the same networks in CasADi's own forms, called alone and inside IPOPT.

Forms: MX and SX graphs of the formula, C that CasADi generates from the MX graph (same compiler, same flags), PyTorch
called back with its own derivatives. l4casadi has no Hessian of the Lagrangian, which IPOPT asks for.
Run ``python -m problems.studies.casadi_forms``.
"""

import json
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.symbolic import CallbackContact, SymbolicContact, _Called
from casadi_contact.core.compiler import shared_library
from casadi_contact.core.conventions import Array
from casadi_contact.core.files.writing import writable_folder, write_text
from casadi_contact.core.machine import machine_record
from casadi_contact.core.terminal import run_program
from casadi_contact.core.workers import one_thread
from casadi_contact.networks.activations import activation_of
from casadi_contact.networks.functions import hessian_function
from casadi_contact.networks.network import Network
from casadi_contact.optimisation.ipopt import IpoptOutcome, least_squares_options
from casadi_contact.optimisation.pose_estimation import PoseEstimation
from casadi_contact.scenes.walking import reference_cycle
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from casadi_contact.workflow.benchmark.candidates import compare, time_single_calls
from casadi_contact.workflow.project import Project, available_poses

OWN = "own kernel"


def graph(surrogate: Surrogate, name: str, loads: Sequence[str], *, scalars: bool = False) -> ca.Function:
    """pose -> loads, roots as MX, or (scalars) as SX: the formula alone, which CasADi differentiates."""
    pose = ca.MX.sym("pose", 6)
    roots, values = surrogate._expressions(pose, loads)
    function = ca.Function(name, [pose], [values, roots])
    return function.expand() if scalars else function


def torch_formula(surrogate: Surrogate, loads: Sequence[str]) -> Callable[[Any], Any]:
    """pose (6) -> loads and roots (L + P) in PyTorch, constants made once: the formulas of `two_stage` and `patch`."""
    import torch

    def constant(value: Any) -> Any:
        return torch.tensor(np.array(value), dtype=torch.float64)

    def network(net: Network) -> Callable[[Any], Any]:
        shift, size, scale = constant(net.input_shift), constant(net.input_scale), constant(net.output_scale)
        layers = [(constant(weight), constant(bias)) for weight, bias in zip(net.weights, net.biases, strict=True)]
        activate = activation_of(net.activation).derivatives

        def value(x: Any) -> Any:
            a = (x - shift) / size
            for weight, bias in layers[:-1]:
                (a,) = activate(torch, weight @ a + bias, 0)
            return scale * (layers[-1][0] @ a + layers[-1][1])

        return value

    def turned(anchor: Any, angles: Any) -> Any:
        """Rx(rx)·Ry(ry)·Rz(rz)·a of an anchor a (3)."""
        v = list(anchor)
        for axis in (2, 1, 0):
            c, s, i, j = torch.cos(angles[axis]), torch.sin(angles[axis]), (axis + 1) % 3, (axis + 2) % 3
            v[i], v[j] = c * v[i] - s * v[j], s * v[i] + c * v[j]
        return torch.stack(v)

    scene = surrogate.scene
    if isinstance(surrogate, PatchSurrogate):
        picks = zip(surrogate.patches, scene.selection(loads).transpose(1, 0, 2), strict=True)
        parts = [
            [network(patch.root), network(patch.ratios)]
            + [constant(each) for each in (patch.anchor_mm, pick[:, patch.columns], pick @ patch.own)]
            for patch, pick in picks
        ]

        def patch(pose: Any) -> Any:
            roots, found = [], []
            for root, ratios, anchor, columns, own in parts:
                x = torch.cat([pose[:3] + turned(anchor, pose[3:]), pose[3:]])
                roots.append(root(x))
                found.append(scene.reference_load * torch.relu(roots[-1]) ** 2 * (columns @ ratios(x) + own))
            return torch.cat([sum(found), *roots])

        return patch
    first = {name: network(surrogate.networks[name]) for name in scene.sensitive_loads}
    second = {name: network(surrogate.networks[name]) for name in loads if name not in first}
    rounding = surrogate._rounding  # type: ignore[attr-defined]

    def two_stage(pose: Any) -> Any:
        raw = {name: value(pose) for name, value in first.items()}
        forces = {name: -torch.relu(-value) for name, value in raw.items()}
        u = torch.cat([pose, *forces.values()])
        values = [forces[name] if name in forces else second[name](u) for name in loads]
        shares = [-value / scene.reference_load for value in raw.values()]
        return torch.cat([*values, *(n / (n * n + rounding) ** 0.25 for n in shares)])

    return two_stage


def pytorch(surrogate: Surrogate, name: str, loads: Sequence[str]) -> ca.Function:
    """pose -> loads, roots by PyTorch, called back: values and both derivatives, those of ``torch.func``."""
    import torch

    value = torch_formula(surrogate, loads)
    jacobian, rows = torch.func.jacrev(value), len(loads) + len(surrogate.patch_names)
    orders = [value, jacobian, torch.func.jacrev(jacobian)]
    # Inputs are the pose and, of a Jacobian, the outputs that it is of, which it does not need.
    shapes = [ca.Sparsity.dense(6, 1), ca.Sparsity(rows, 1), ca.Sparsity(rows, 6)]

    def called(name: str, order: int) -> ca.Function:
        inputs = {f"i{k}": shape for k, shape in enumerate(shapes[: order + 1])}
        outputs = {"o0": ca.Sparsity.dense(rows * 6 ** max(0, order - 1), 6 if order else 1)}
        if order == 2:
            outputs["o1"] = ca.Sparsity(6 * rows, rows)  # by those outputs

        def evaluate(arg: Sequence[Any]) -> list[Any]:
            found = orders[order](torch.from_numpy(np.array(arg[0]).ravel())).numpy()
            return [found] if order < 2 else [found.transpose(1, 0, 2).reshape(-1, 6), ca.DM(6 * rows, rows)]

        return _Called(name, inputs, outputs, evaluate, None if order == 2 else lambda name, _: called(name, order + 1))

    pose = ca.MX.sym("pose", 6)
    both = called(f"{name}_torch", 0)(pose)
    return ca.Function(name, [pose], [both[: len(loads)], both[len(loads) :]])


FORMS: dict[str, Callable[..., ca.Function]] = {
    "CasADi C": graph,
    "CasADi MX": graph,
    "CasADi SX": partial(graph, scalars=True),
    "PyTorch callback": pytorch,
}


class Written(CallbackContact):
    """A surrogate whose CasADi functions are of another form, for every problem that takes a contact model."""

    def __init__(self, surrogate: Surrogate, form: str) -> None:
        super().__init__(surrogate)
        self.record, self._form = surrogate.record, FORMS[form]

    def _function(
        self, name: str, loads: Sequence[str], outputs: Sequence[str], compiled: bool, batch: int | None
    ) -> ca.Function:
        function = self._form(self.model, f"{name}_written", loads)
        if outputs == ("loads",):
            pose = ca.MX.sym("pose", 6)
            return ca.Function(name, [pose], [function(pose)[0]])
        return function if batch is None else function.map(batch)


def generated_library(functions: Sequence[ca.Function]) -> str:
    """The C that CasADi generates, compiled as our own kernels are."""
    code = ca.CodeGenerator("generated")
    for function in functions:
        code.add(function)
    return str(shared_library(code.dump()))


def stopwatches(model: SymbolicContact, poses: Array, *, generated: bool) -> dict[str, Callable[[], float]]:
    """Seconds of a call with one pose: loads, Jacobian, Hessian of the Lagrangian; generated: as CasADi's C."""
    function = model.function()
    functions = [function, function.jacobian(), hessian_function(function)]
    if generated:
        library = generated_library(functions)
        functions = [ca.external(each.name(), library) for each in functions]
    others: tuple[list[Array], ...] = ([], [], [np.ones(len(model.load_names))])
    watches = [partial(time_single_calls, f, poses, *more) for f, more in zip(functions, others, strict=True)]
    return dict(zip(("value", "Jacobian", "Hessian"), watches, strict=True))


def solution(problem: PoseEstimation, start: Array, *, generated: bool) -> dict[str, Any]:
    """IPOPT from start poses (n, 6): seconds of its second run; generated: the whole problem as CasADi's C."""
    options = least_squares_options(max_iterations=60)
    solver = ca.nlpsol("pose_estimation", "ipopt", problem.nlp, options)
    if generated:
        library = generated_library([solver.oracle(), *map(solver.get_function, solver.get_function())])
        solver = ca.nlpsol("pose_estimation", "ipopt", library, options)
    contact, x0 = problem.contact, problem.contact.variables(start)
    for _ in range(2):
        began = time.perf_counter()
        answer = solver(x0=x0, lbx=contact.lower, ubx=contact.upper)
        seconds = time.perf_counter() - began
    ipopt = IpoptOutcome.of(solver)
    result = problem.evaluate(contact.poses_with(start, np.asarray(answer["x"])), ipopt)
    found = {"frames": problem.frames, "solved": int(result.solved.sum()), "iterations": ipopt.iterations}
    return {**found, "status": ipopt.status, "seconds": seconds}


def measured(
    surrogate: Surrogate, poses: Array, frames: int = 101, few: int = 11, forms: Sequence[str] = tuple(FORMS)
) -> dict[str, dict[str, Any]]:
    """By form: µs of calls, and IPOPT's pose estimation of the built-in cycle in so many frames, few by Python."""
    found: dict[str, dict[str, Any]] = {}
    watches: dict[tuple[str, str], Callable[[], float]] = {}
    for form in (OWN, *forms):
        model, generated = surrogate if form == OWN else Written(surrogate, form), form == "CasADi C"
        try:
            times = stopwatches(model, poses, generated=generated)
        except (ImportError, RuntimeError) as error:
            found[form] = {"missing": " ".join(str(error).split())[-100:]}
            continue
        watches |= {(form, what): watch for what, watch in times.items()}
        cycle = reference_cycle(frames=few if form.startswith("PyTorch") else frames)
        own = PoseEstimation.of_cycle(surrogate, cycle)
        start = own.settle_start(own.contact.start_poses())
        found[form] = solution(PoseEstimation.of_cycle(model, cycle), start, generated=generated)
    for (form, what), timing in compare(watches, repeats=7).items():
        found[form][f"{what}_us"] = timing.low_us
    return found


def main(out: Path = Path("docs/results/data/casadi_forms.json")) -> None:
    """Measure the forms of `knee` and `knee_two_stage`."""
    writable_folder(out.parent)
    poses = available_poses(Project.open("knee", "quick"))[:20]
    with one_thread():
        surrogates = {name: measured(load_surrogate(name), poses) for name in ("knee", "knee_two_stage")}
    content = {"format": "casadi_contact casadi forms", "format_version": 1, "machine": machine_record()}
    write_text(out, json.dumps({**content, "surrogates": surrogates}, indent=1))
    print(f"written {out}")


if __name__ == "__main__":
    run_program(main)
