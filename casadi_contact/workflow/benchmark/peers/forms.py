"""One set of networks, many forms: the paper's two stages [EF15 Eqs. 1-7] as CasADi and PyTorch users would write them.

All forms give the same loads, so only their times differ: this library's own function, plain MX, SX and generated C of
CasADi, PyTorch (float64, networks of a stage stacked, values and derivatives traced), and PyTorch through l4casadi
(float32). torch is imported in the functions that need it only.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from shutil import which
from subprocess import CalledProcessError, run
from typing import Any
from uuid import uuid4

import casadi as ca
import numpy as np

from casadi_contact.core.compiler import machine_flags
from casadi_contact.core.conventions import Array, as_poses
from casadi_contact.networks.activations import activation_of
from casadi_contact.networks.network import Network
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.two_stage.surrogate import TwoStageSurrogate
from casadi_contact.workflow.benchmark.timing import Candidate, Stopwatch, time_batch, time_calls, time_single_calls

FAMILY = "two-stage form"
FLAGS = ("-O3", "-fno-math-errno", "-fno-trapping-math")
COMPILATION_CPU_S = 600


@dataclass(frozen=True)
class Form:
    """pose -> loads (L); pose -> Jacobian (L x 6); pose, λ (L) -> Hessian (6 x 6) of λᵀ·loads, None where there is
    none."""

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
        return replace(cls.of_expression(pose, function(pose)), loads=function)


class CasadiModel:
    """Named loads of a function pose (6) -> loads (L)."""

    def __init__(self, function: ca.Function, load_names: Sequence[str]) -> None:
        self.load_names, self._function = tuple(load_names), function

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L)."""
        poses = as_poses(poses)
        return np.asarray(self._function.map(len(poses))(poses.T)).T


def plain_form(surrogate: Surrogate, names: Sequence[str], symbols: Any) -> Form:
    """[EF15 Eqs. 1-7] written down once in ca.MX or ca.SX, every derivative left to CasADi."""

    def value(network: Network, x: Any) -> Any:
        a, sigma = (x - ca.DM(network.input_shift)) / ca.DM(network.input_scale), activation_of(network.activation)
        for weight, bias in zip(network.weights[:-1], network.biases[:-1], strict=True):
            (a,) = sigma.derivatives(ca, ca.mtimes(ca.DM(weight), a) + ca.DM(bias), 0)
        return network.output_scale * (ca.mtimes(ca.DM(network.weights[-1]), a) + ca.DM(network.biases[-1]))

    pose, sensitive = symbols.sym("pose", 6), surrogate.scene.sensitive_loads
    first = [name for name in surrogate.needed_networks(names) if name in sensitive]
    forces = {name: ca.fmin(value(surrogate.networks[name], pose), 0) for name in first}
    u = ca.vertcat(pose, *forces.values())
    loads = [forces[name] if name in forces else value(surrogate.networks[name], u) for name in names]
    return Form.of_expression(pose, ca.vertcat(*loads))


def compiled_form(form: Form) -> Form:
    """The form as C from CasADi's generator, compiled with FLAGS for this processor, and loaded back.

    Raises FileNotFoundError without a compiler, RuntimeError where it fails or needs more than `COMPILATION_CPU_S`.
    """
    compiler = which("gcc") or which("cc")
    if compiler is None:
        raise FileNotFoundError("no C compiler (gcc or cc) found: install one to time generated code")
    limited = ("sh", "-c", f'ulimit -t {COMPILATION_CPU_S} && exec "$@"', "sh")
    command = [*limited, compiler, *FLAGS, *machine_flags(), "-fPIC", "-shared", "-o", "form.so", "form.c", "-lm"]
    functions = [function for function in (form.loads, form.jacobian, form.hessian) if function is not None]
    with tempfile.TemporaryDirectory() as folder:
        generator = ca.CodeGenerator("form.c")
        for function in functions:
            generator.add(function)
        generator.generate(f"{folder}/")
        try:
            run(command, cwd=folder, capture_output=True, text=True, check=True)
        except CalledProcessError as error:
            raise RuntimeError(f"the generated C does not compile: {error.stderr.strip().splitlines()[-1]}") from None
        library = str(Path(folder) / "form.so")
        loads, jacobian, *hessian = (ca.external(function.name(), library) for function in functions)
        return Form(loads, jacobian, hessian[0] if hessian else None)


@contextmanager
def _inference() -> Iterator[None]:
    """torch's inference mode on one thread."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.inference_mode():
            yield
    finally:
        torch.set_num_threads(threads)


def _stage(networks: dict[str, Network], dtype: Any) -> Callable[[Any], dict[str, Any]]:
    """x (k, m) -> {name: (m,)}: networks of equal shape stacked, so that each layer is one batched product."""
    import torch

    shapes: dict[Any, dict[str, Network]] = {}
    for name, network in networks.items():
        shapes.setdefault((network.hidden, network.activation), {})[name] = network

    def stacked(members: list[Network]) -> Callable[[Any], Any]:
        sigma, scaled = (
            activation_of(members[0].activation).derivatives,
            [n.weights[0] / n.input_scale for n in members],
        )
        layers = [(scaled, [n.biases[0] - w @ n.input_shift for n, w in zip(members, scaled, strict=True)])]
        for k in range(1, len(members[0].weights)):
            gains = [n.output_scale if k == len(n.weights) - 1 else 1.0 for n in members]
            scales = list(zip(gains, members, strict=True))
            layers.append(([g * n.weights[k] for g, n in scales], [g * n.biases[k] for g, n in scales]))
        (first, bias), *rest = [
            (torch.tensor(np.stack(w), dtype=dtype), torch.tensor(np.stack(b)[:, :, None], dtype=dtype))
            for w, b in layers
        ]
        first, bias = first.flatten(0, 1), bias.reshape(-1, 1)

        def evaluate(x: Any) -> Any:
            z = torch.addmm(bias, first, x).reshape(len(members), -1, x.shape[1])
            for weight, further in rest:
                z = torch.baddbmm(further, weight, sigma(torch, z, 0)[0])
            return z[:, 0]

        return evaluate

    stacks = [(list(group), stacked(list(group.values()))) for group in shapes.values()]
    return lambda x: {name: row for names, stack in stacks for name, row in zip(names, stack(x), strict=True)}


def torch_loads(surrogate: Surrogate, names: Sequence[str], dtype: Any) -> Callable[[Any], Any]:
    """[EF15 Eqs. 1-7] in torch: poses (6, m) -> loads (L, m)."""
    import torch

    needed = {name: surrogate.networks[name] for name in surrogate.needed_networks(names)}
    sensitive = surrogate.scene.sensitive_loads
    first = _stage({name: network for name, network in needed.items() if name in sensitive}, dtype)
    second = _stage({name: network for name, network in needed.items() if name not in sensitive}, dtype)

    def loads(poses: Any) -> Any:
        forces = {name: torch.clamp(force, max=0.0) for name, force in first(poses).items()}
        rest = second(torch.vstack([poses, *forces.values()]))
        return torch.stack([{**forces, **rest}[name] for name in names])

    return loads


class TorchForm:
    """The two stages in float64 on one thread: values in batch, values and derivatives of single poses."""

    def __init__(self, surrogate: Surrogate, names: Sequence[str]) -> None:
        try:
            import torch
            from torch.fx.experimental.proxy_tensor import make_fx
        except ImportError:
            raise ImportError("the PyTorch form needs torch: pip install casadi_contact[train]") from None
        self.load_names, self._batch = tuple(names), torch_loads(surrogate, names, torch.float64)
        self._pose = np.zeros(6)
        pose, multipliers = torch.from_numpy(self._pose).reshape(6, 1), torch.ones(len(names), dtype=torch.float64)

        def traced(function: Callable[..., Any], *inputs: Any) -> Callable[[Array], Array]:
            with warnings.catch_warnings():
                # torch.compile, which replaces tracing, needs a C++ compiler and minutes for each graph.
                warnings.simplefilter("ignore", DeprecationWarning)
                graph = torch.jit.trace(make_fx(function)(*inputs), inputs, check_trace=False)

            def call(at: Array) -> Array:
                self._pose[:] = at
                return np.asarray(graph(*inputs).numpy())

            return call

        def one(x: Any) -> Any:
            return self._batch(x)[:, 0]

        def weighted(x: Any, w: Any) -> Any:
            return torch.dot(w, one(x))

        self.one = traced(one, pose)
        self.jacobian_one = traced(torch.func.jacrev(one), pose)
        self.hessian_one = traced(torch.func.jacfwd(torch.func.jacrev(weighted)), pose, multipliers)

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L)."""
        import torch

        with _inference():
            return np.asarray(self._batch(torch.from_numpy(as_poses(poses)).T).numpy().T)


def l4casadi_form(surrogate: Surrogate, names: Sequence[str]) -> Form:
    """The torch form as a CasADi function through l4casadi, in float32, without a Hessian where l4casadi gives none."""
    import l4casadi
    import torch

    with tempfile.TemporaryDirectory(prefix="l4casadi") as folder:
        model = l4casadi.L4CasADi(
            torch_loads(surrogate, names, torch.float32), name=f"l4casadi_{uuid4().hex}", build_dir=folder
        )
        pose = ca.MX.sym("pose", 6, 1)
        form = Form.of_function(ca.Function("loads", [pose], [model(pose)]))
        # Its library reads the traced graphs at the first calls; after these the folder is not needed any more.
        form.loads(ca.DM.zeros(6)), form.jacobian(ca.DM.zeros(6))
        try:
            assert form.hessian is not None
            form.hessian(ca.DM.zeros(6), ca.DM.ones(len(names)))
        except RuntimeError:  # l4casadi 2.0 under CasADi 3.8: a block of the second derivatives is missing
            return replace(form, hessian=None)
    return form


def two_stage_forms(surrogate: Surrogate | None, names: Sequence[str]) -> Iterator[Candidate]:
    """Each form as a candidate; one that cannot be built says why.

    Raises ValueError without a two-stage surrogate, or for loads that it lacks.
    """
    if not isinstance(surrogate, TwoStageSurrogate):
        got = "none" if surrogate is None else f"a {surrogate.structure} surrogate"
        raise ValueError(f"the forms of the two-stage networks need a two_stage surrogate, got {got}")
    names = surrogate.check_loads(names)
    builders: dict[str, tuple[Callable[[], Form | TorchForm], str]] = {
        "own function": (lambda: Form.of_function(surrogate.function(names)), "MX with both derivatives written out"),
        "CasADi MX": (lambda: plain_form(surrogate, names, ca.MX), "plain graph, derivatives by CasADi"),
        "CasADi SX": (lambda: plain_form(surrogate, names, ca.SX), "expanded to scalars"),
        "CasADi C": (
            lambda: compiled_form(plain_form(surrogate, names, ca.MX)),
            f"generated from the plain MX graph, gcc {' '.join((*FLAGS, *machine_flags()))}",
        ),
        "l4casadi": (lambda: l4casadi_form(surrogate, names), "float32"),
        "PyTorch": (lambda: TorchForm(surrogate, names), "float64, networks of a stage stacked, traced"),
    }
    for what, (build, remark) in builders.items():
        name = f"two-stage, {what}"
        try:
            form = build()
        except Exception as error:  # compilers, l4casadi, torch and CasADi fail in ways of their own
            text = " ".join(str(error).split()) or type(error).__name__
            yield Candidate(name, FAMILY, None, failure=text)
            continue
        yield replace(
            _candidate(name, form, names),
            samples=sum(surrogate.record.get("samples", {}).values()),
            training_seconds=float(sum(surrogate.record.get("seconds", {}).values())),
            parameters=sum(network.parameter_count for network in surrogate.networks.values()),
            remark=remark,
        )


def _candidate(name: str, form: Form | TorchForm, names: Sequence[str]) -> Candidate:
    if isinstance(form, TorchForm):

        def in_inference(call: Callable[[Array], Array]) -> Stopwatch:
            def measure(poses: Array) -> float:
                with _inference():
                    return time_calls(call, poses)

            return measure

        one, by_pose, second = (in_inference(call) for call in (form.one, form.jacobian_one, form.hessian_one))
        return Candidate(name, FAMILY, form, one, by_pose, second, partial(time_batch, form))
    weights, model, hessian = np.ones(len(names)), CasadiModel(form.loads, names), form.hessian
    return Candidate(
        name,
        FAMILY,
        model,
        time_value=partial(time_single_calls, form.loads),
        time_jacobian=partial(time_single_calls, form.jacobian),
        time_hessian=None if hessian is None else (lambda poses: time_single_calls(hessian, poses, weights)),
        time_batch=partial(time_batch, model),
    )
