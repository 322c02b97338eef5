"""The surrogates once more, written in torch from the formulas of README and Eqs. (1)-(7), for autograd."""

from __future__ import annotations

import numpy as np
import torch

from casadi_contact.core.conventions import WRENCH_NAMES, load_selection
from casadi_contact.networks.network import Network
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.patch.networks import ratio_outputs

torch.set_default_dtype(torch.float64)


def _tensor(array) -> torch.Tensor:
    return torch.tensor(np.asarray(array, dtype=float))


def _network(network: Network, x: torch.Tensor, output: int = 0) -> torch.Tensor:
    a = (x - _tensor(network.input_shift)) / _tensor(network.input_scale)
    for weight, bias in zip(network.weights[:-1], network.biases[:-1], strict=True):
        z = a @ _tensor(weight).T + _tensor(bias)
        a = {"tanh": torch.tanh, "algebraic": lambda z: z / torch.sqrt(1 + z**2)}[network.activation](z)
    scale = np.ravel(network.output_scale)[output]
    return scale * (a @ _tensor(network.weights[-1])[output] + network.biases[-1][output])


def _rotation(q: torch.Tensor) -> torch.Tensor:
    (sx, sy, sz), (cx, cy, cz) = torch.sin(q).T, torch.cos(q).T
    zero, one = torch.zeros(len(q)), torch.ones(len(q))
    rx = torch.stack([one, zero, zero, zero, cx, -sx, zero, sx, cx]).T.reshape(-1, 3, 3)
    ry = torch.stack([cy, zero, sy, zero, one, zero, -sy, zero, cy]).T.reshape(-1, 3, 3)
    rz = torch.stack([cz, -sz, zero, sz, cz, zero, zero, zero, one]).T.reshape(-1, 3, 3)
    return rx @ ry @ rz


def _patch(surrogate: Surrogate, poses: torch.Tensor, loads: bool) -> torch.Tensor:
    scene, wrenches, roots = surrogate.scene, [], [[] for _ in surrogate.patch_names]
    for part in scene.parts:
        patch, anchor, pressed = part.name, part.anchor_mm, scene.tables["loads"]["sensitive"][part.patch]
        sensitive = pressed.lstrip("+-").partition("_")[0]  # "F", a magnitude, is no component
        local = torch.cat([poses[:, :3] + _rotation(poses[:, 3:]) @ _tensor(anchor), poses[:, 3:]], dim=1)
        root = surrogate.networks[f"root_{patch}"]
        s = _network(root, local)
        roots[part.patch].append(s)
        normal = scene.reference_load * torch.clamp(s, min=0.0) ** 2
        for component in WRENCH_NAMES:
            if component == sensitive:
                wrenches.append(normal if pressed.startswith("+") else -normal)
            else:
                wrenches.append(normal * _ratio(surrogate, patch, component, local))
    of_patches = load_selection(surrogate.load_names, scene.patch_names)
    selection = of_patches[:, [part.patch for part in scene.parts]].reshape(len(surrogate.load_names), -1)
    if loads:
        return torch.stack(wrenches, dim=1) @ _tensor(selection).T
    return torch.stack([torch.stack([_together(s) for s in torch.stack(of_patch, dim=1)]) for of_patch in roots], dim=1)


def _ratio(surrogate: Surrogate, patch: str, component: str, local: torch.Tensor) -> torch.Tensor:
    outputs = ratio_outputs(surrogate.scene).get(f"ratios_{patch}", ())
    if component in outputs:
        return _network(surrogate.networks[f"ratios_{patch}"], local, outputs.index(component))
    return torch.zeros(len(local))  # no load needs it


def _together(s: torch.Tensor) -> torch.Tensor:
    """Root load of a patch from those of its parts."""
    if len(s) == 1:
        return s[0]
    pressed = s[s > 0.0]
    return torch.linalg.norm(pressed) if len(pressed) else -1.0 / torch.sqrt((s**-2.0).sum())


def _two_stage(surrogate: Surrogate, poses: torch.Tensor, loads: bool) -> torch.Tensor:
    scene = surrogate.scene
    raw = [_network(surrogate.networks[name], poses) for name in scene.sensitive_loads]
    if not loads:
        n = -torch.stack(raw, dim=1) / scene.reference_load
        return n / (n**2 + (0.01 * scene.boundary_load / scene.reference_load) ** 2) ** 0.25
    clamped = {name: torch.clamp(f, max=0.0) for name, f in zip(scene.sensitive_loads, raw, strict=True)}
    u = torch.cat([poses, torch.stack(list(clamped.values()), dim=1)], dim=1)
    return torch.stack(
        [clamped[name] if name in clamped else _network(surrogate.networks[name], u) for name in scene.load_names],
        dim=1,
    )


def _slopes(rows: torch.Tensor, poses: torch.Tensor, *, differentiable: bool = False) -> torch.Tensor:
    """Derivatives (n, k, 6) of rows (n, k), each of which depends on its own pose alone: so all poses go at once."""
    of_row = (torch.autograd.grad(row.sum(), poses, retain_graph=True, create_graph=differentiable) for row in rows.T)
    return torch.stack([slope for (slope,) in of_row], dim=1)


def oracles(surrogate: Surrogate, poses: np.ndarray, weights: np.ndarray, *, loads: bool = True) -> list[np.ndarray]:
    """Of loads or root loads: values (n, m), Jacobians (n, m, 6), Hessians (n, 1, 6, 6) of their weighted sums."""
    rule = {"patch": _patch, "two_stage": _two_stage}[surrogate.structure]
    x = _tensor(poses).requires_grad_()
    values = rule(surrogate, x, loads)
    sums = (_tensor(weights) * values).sum(dim=1, keepdim=True)
    (gradients,) = _slopes(sums, x, differentiable=True).unbind(dim=1)
    found = values, _slopes(values, x), _slopes(gradients, x)[:, None]
    return [numbers.detach().numpy() for numbers in found]
