"""The formulas of `two_stage` and `patch` in PyTorch, and as CasADi functions that call it back.

Constants are made once; derivatives are those of ``torch.func``. torch is imported where it is used.
"""

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.symbolic import _Called
from casadi_contact.networks.activations import activation_of
from casadi_contact.networks.network import Network
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate


def torch_formula(surrogate: Surrogate, loads: Sequence[str]) -> Callable[[Any], Any]:
    """pose (6) -> loads and roots (L + P) in PyTorch: the formulas of `two_stage` and of `patch`."""
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
    """pose -> loads, roots by PyTorch, called back: values and both derivatives."""
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
