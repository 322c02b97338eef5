"""The paper's two stages [EF15 Eqs. 1-7] as CasADi users would write them: plain MX, SX, and generated C."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.core.compiler import machine_flags
from casadi_contact.core.conventions import Array, as_poses
from casadi_contact.networks.activations import activation_of
from casadi_contact.networks.network import Network
from casadi_contact.surrogate.base import Surrogate

FLAGS = ("-O3", "-fno-math-errno", "-fno-trapping-math")
COMPILATION_CPU_S = 600


@dataclass(frozen=True)
class Form:
    """pose -> loads (L); pose -> Jacobian (L x 6); pose, multipliers (L) -> Hessian (6 x 6) of multipliers·loads.

    hessian is None where a form has none.
    """

    loads: ca.Function
    jacobian: ca.Function
    hessian: ca.Function | None

    @classmethod
    def of_expression(cls, pose: Any, loads: Any) -> Form:
        """Derivatives by CasADi's own differentiation of an MX or SX expression."""
        multipliers = type(pose).sym("multipliers", loads.numel())
        return cls(
            ca.Function("loads", [pose], [loads]),
            ca.Function("loads_jacobian", [pose], [ca.jacobian(loads, pose)]),
            ca.Function("loads_hessian", [pose, multipliers], [ca.hessian(ca.dot(multipliers, loads), pose)[0]]),
        )

    @classmethod
    def of_function(cls, function: ca.Function) -> Form:
        """The form of a function that may carry derivatives of its own."""
        pose = ca.MX.sym("pose", 6)
        form = cls.of_expression(pose, function(pose))
        return cls(function, form.jacobian, form.hessian)


class CasadiModel:
    """Named loads of a function pose (6) -> loads (L), with one buffered call for all poses."""

    def __init__(self, function: ca.Function, load_names: Sequence[str]) -> None:
        self.load_names = tuple(load_names)
        self._function = function
        self._mapped: dict[int, ca.Function] = {}

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L)."""
        poses = as_poses(poses)
        if len(poses) not in self._mapped:
            self._mapped = {len(poses): self._function.map(len(poses))}
        loads = np.zeros((len(poses), len(self.load_names)))
        buffer, call = self._mapped[len(poses)].buffer()
        buffer.set_arg(0, memoryview(poses.reshape(-1)))  # type: ignore[call-arg, arg-type]
        buffer.set_res(0, memoryview(loads.reshape(-1)))  # type: ignore[call-arg, arg-type]
        call()
        return loads


def _network(network: Network, x: Any) -> Any:
    a = (x - ca.DM(network.input_shift)) / ca.DM(network.input_scale)
    for weight, bias in zip(network.weights[:-1], network.biases[:-1], strict=True):
        (a,) = activation_of(network.activation).derivatives(ca, ca.mtimes(ca.DM(weight), a) + ca.DM(bias), 0)
    return network.output_scale * (ca.mtimes(ca.DM(network.weights[-1]), a) + ca.DM(network.biases[-1]))


def plain_form(surrogate: Surrogate, names: Sequence[str], symbols: Any) -> Form:
    """[EF15 Eqs. 1-7] written down once in ca.MX or ca.SX, every derivative left to CasADi."""
    pose, sensitive = symbols.sym("pose", 6), surrogate.scene.sensitive_loads
    first = [name for name in surrogate.needed_networks(names) if name in sensitive]
    forces = {name: ca.fmin(_network(surrogate.networks[name], pose), 0) for name in first}
    u = ca.vertcat(pose, *forces.values())
    loads = [forces[name] if name in forces else _network(surrogate.networks[name], u) for name in names]
    return Form.of_expression(pose, ca.vertcat(*loads))


def compiler() -> str:
    """Path of a C compiler; raises FileNotFoundError where there is none."""
    found = shutil.which("gcc") or shutil.which("cc")
    if found is None:
        raise FileNotFoundError("no C compiler (gcc or cc) found: install one to time generated code")
    return found


def compiled_form(form: Form) -> Form:
    """The form as C from CasADi's generator, compiled with FLAGS for this processor, and loaded back.

    Raises FileNotFoundError without a compiler, RuntimeError where it fails or needs more than `COMPILATION_CPU_S`.
    """
    limited = ("sh", "-c", f'ulimit -t {COMPILATION_CPU_S} && exec "$@"', "sh")
    command = [*limited, compiler(), *FLAGS, *machine_flags(), "-fPIC", "-shared", "-o", "form.so", "form.c", "-lm"]
    functions = [function for function in (form.loads, form.jacobian, form.hessian) if function is not None]
    with tempfile.TemporaryDirectory() as folder:
        generator = ca.CodeGenerator("form.c")
        for function in functions:
            generator.add(function)
        generator.generate(f"{folder}/")
        try:
            subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
        except subprocess.CalledProcessError as error:
            raise RuntimeError(f"the generated C does not compile: {error.stderr.strip().splitlines()[-1]}") from None
        library = str(Path(folder) / "form.so")
        loads, jacobian, *hessian = (ca.external(function.name(), library) for function in functions)
        return Form(loads, jacobian, hessian[0] if hessian else None)
