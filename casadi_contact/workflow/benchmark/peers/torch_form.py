"""The paper's two stages in PyTorch, as a user who cares for time would write them, alone and through l4casadi.

Networks of equal shape are stacked, so that a stage is one batched product per layer; values and derivatives are
traced once into a graph, so that no Python runs between the products. torch is imported in the functions that
need it only.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any
from uuid import uuid4

import numpy as np

from casadi_contact.core.conventions import Array, as_poses
from casadi_contact.networks.activations import activation_of
from casadi_contact.networks.network import Network
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.workflow.benchmark.peers.casadi_forms import Form

Rows = Callable[[Any], dict[str, Any]]


def _torch() -> Any:
    try:
        import torch
    except ImportError:
        raise ImportError("the PyTorch form needs torch: pip install casadi_contact[torch]") from None
    return torch


@contextmanager
def _one_thread() -> Iterator[None]:
    torch = _torch()
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _stacked(networks: dict[str, Network], dtype: Any) -> Rows:
    """x (k, m) -> {name: (m,)} for networks of equal shape and activation."""
    torch = _torch()
    members = list(networks.values())
    count, layers = len(members), len(members[0].weights)
    sigma = activation_of(members[0].activation).derivatives

    def tensor(arrays: list[Array]) -> Any:
        return torch.tensor(np.stack(arrays), dtype=dtype)

    scaled = [n.weights[0] / n.input_scale for n in members]
    weights = [tensor(scaled).flatten(0, 1)]
    biases = [tensor([n.biases[0] - w @ n.input_shift for n, w in zip(members, scaled, strict=True)]).reshape(-1, 1)]
    for layer in range(1, layers):
        gain = [n.output_scale if layer == layers - 1 else 1.0 for n in members]
        weights.append(tensor([g * n.weights[layer] for g, n in zip(gain, members, strict=True)]))
        biases.append(tensor([g * n.biases[layer][:, None] for g, n in zip(gain, members, strict=True)]))

    def evaluate(x: Any) -> dict[str, Any]:
        z = torch.addmm(biases[0], weights[0], x).reshape(count, -1, x.shape[1])
        for weight, bias in zip(weights[1:], biases[1:], strict=True):
            z = torch.baddbmm(bias, weight, sigma(torch, z, 0)[0])
        return {name: z[row, 0] for row, name in enumerate(networks)}

    return evaluate


def _stage(networks: dict[str, Network], dtype: Any) -> Rows:
    """x (k, m) -> {name: (m,)}, one stack for each shape among the networks."""
    shapes: dict[Any, dict[str, Network]] = {}
    for name, network in networks.items():
        shapes.setdefault((network.hidden, network.activation), {})[name] = network
    stacks = [_stacked(group, dtype) for group in shapes.values()]
    return lambda x: {name: row for stack in stacks for name, row in stack(x).items()}


def torch_loads(surrogate: Surrogate, names: Sequence[str], dtype: Any) -> Callable[[Any], Any]:
    """[EF15 Eqs. 1-7] in torch: poses (6, m) -> loads (L, m)."""
    torch = _torch()
    sensitive = surrogate.scene.sensitive_loads
    needed = surrogate.needed_networks(names)
    first = _stage({name: surrogate.networks[name] for name in needed if name in sensitive}, dtype)
    others = {name: surrogate.networks[name] for name in needed if name not in sensitive}
    second = _stage(others, dtype)

    def loads(poses: Any) -> Any:
        forces = {name: torch.clamp(force, max=0.0) for name, force in first(poses).items()}
        rest = second(torch.vstack([poses, *forces.values()])) if others else {}
        return torch.stack([{**forces, **rest}[name] for name in names])

    return loads


class TorchForm:
    """The two stages in float64 on one thread: values in batch, and values and derivatives of single poses."""

    def __init__(self, surrogate: Surrogate, names: Sequence[str]) -> None:
        torch = _torch()
        from torch.fx.experimental.proxy_tensor import make_fx

        self.load_names = tuple(names)
        loads = torch_loads(surrogate, names, torch.float64)
        self._pose = np.zeros(6)
        self._multipliers = np.ones(len(self.load_names))
        pose, multipliers = torch.from_numpy(self._pose).reshape(6, 1), torch.from_numpy(self._multipliers)

        def one(x: Any) -> Any:
            return loads(x)[:, 0]

        def weighted(x: Any, w: Any) -> Any:
            return torch.dot(w, one(x))

        def traced(function: Callable[..., Any], *inputs: Any) -> Any:
            with warnings.catch_warnings():
                # torch.compile, which replaces tracing, needs a C++ compiler and up to minutes for each graph.
                warnings.simplefilter("ignore", DeprecationWarning)
                return torch.jit.trace(make_fx(function)(*inputs), inputs, check_trace=False)

        with _one_thread():
            self._batch, self._inputs = loads, (pose, multipliers)
            self._value = traced(one, pose)
            self._jacobian = traced(torch.func.jacrev(one), pose)
            self._hessian = traced(torch.func.jacfwd(torch.func.jacrev(weighted)), pose, multipliers)

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L)."""
        torch = _torch()
        with _one_thread(), torch.inference_mode():
            loads: Array = self._batch(torch.from_numpy(as_poses(poses)).T).numpy().T
        return loads

    def one(self, pose: Array) -> Array:
        """Loads (L) of one pose; on one thread and without gradients only inside `inference`."""
        self._pose[:] = pose
        loads: Array = self._value(self._inputs[0]).numpy()
        return loads

    def jacobian_one(self, pose: Array) -> Array:
        """d loads / d pose (L, 6) of one pose."""
        self._pose[:] = pose
        jacobian: Array = self._jacobian(self._inputs[0]).numpy()
        return jacobian.reshape(-1, 6)

    def hessian_one(self, pose: Array) -> Array:
        """Second derivatives (6, 6) of the sum of the loads at one pose."""
        self._pose[:] = pose
        hessian: Array = self._hessian(*self._inputs).numpy()
        return hessian.reshape(6, 6)

    @contextmanager
    def inference(self) -> Iterator[None]:
        """torch's inference mode on one thread, as single calls are timed."""
        with _one_thread(), _torch().inference_mode():
            yield


def l4casadi_form(surrogate: Surrogate, names: Sequence[str]) -> Form:
    """The torch form as a CasADi function through l4casadi, which computes in float32.

    Its Hessian is None where l4casadi does not provide what CasADi asks for. Raises ImportError where l4casadi or
    torch is missing.
    """
    torch = _torch()
    try:
        import l4casadi
    except ImportError:
        raise ImportError(
            "l4casadi is not installed (pip install --no-build-isolation l4casadi, after torch and its build tools, "
            "says its README); its naive form is the plain MX graph, timed above"
        ) from None
    import casadi as ca

    with tempfile.TemporaryDirectory(prefix="l4casadi") as folder:
        model = l4casadi.L4CasADi(
            torch_loads(surrogate, names, torch.float32), name=f"l4casadi_{uuid4().hex}", build_dir=folder
        )
        pose = ca.MX.sym("pose", 6, 1)
        form = Form.of_function(ca.Function("loads", [pose], [model(pose)]))
        # Its library reads the traced graphs at the first calls; after these the folder is not needed any more.
        zeros = ca.DM.zeros(6)
        form.loads(zeros), form.jacobian(zeros)
        try:
            assert form.hessian is not None
            form.hessian(zeros, ca.DM.ones(len(names)))
        except RuntimeError:  # seen with l4casadi 2.0 under CasADi 3.8: a block of the second derivatives is missing
            form = replace(form, hessian=None)
    return form
