"""Contact loads as a PyTorch operation with first and second derivatives (pip install casadi_contact[torch])."""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from casadi_contact.core.conventions import Array
from casadi_contact.export import check_gives, check_last_axis


def contact_loads(model: Any) -> Callable[[torch.Tensor], torch.Tensor]:
    """Function poses (..., 6) [mm, rad] -> loads (..., L) [N, N·mm] of tensors, twice differentiable, on the CPU in
    double precision. ValueError for other poses, those that are not finite, and a model without Jacobian, or without
    Hessian at a second derivative; RuntimeError for a third."""
    check_gives(model, "__call__", "jacobian")

    def loads(poses: torch.Tensor) -> torch.Tensor:
        if not isinstance(poses, torch.Tensor):
            raise ValueError(f"poses is a {type(poses).__name__}, expected a tensor: torch.tensor(poses).double()")
        check_last_axis(poses.shape)
        if poses.dtype != torch.float64 or poses.device.type != "cpu":
            raise ValueError(f"poses is {poses.dtype} on {poses.device}, expected float64 on cpu: poses.double().cpu()")
        flat: torch.Tensor = _Loads.apply(poses.reshape(-1, 6), model)
        return flat.reshape(*poses.shape[:-1], flat.shape[-1])

    return loads


class _Loads(torch.autograd.Function):
    """F(x)"""

    @staticmethod
    def forward(ctx: Any, poses: torch.Tensor, model: Any) -> torch.Tensor:
        ctx.model = model
        ctx.save_for_backward(poses)
        return torch.from_numpy(model(_array(poses)))

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor, None]:
        (poses,) = ctx.saved_tensors
        return _Adjoint.apply(poses, gradients[0], ctx.model), None


class _Adjoint(torch.autograd.Function):
    """Jᵀ(x)·w"""

    @staticmethod
    def forward(ctx: Any, poses: torch.Tensor, weights: torch.Tensor, model: Any) -> torch.Tensor:
        ctx.model = model
        ctx.save_for_backward(poses, weights)
        slopes = model.jacobian(_array(poses))[1]
        return torch.from_numpy(np.einsum("nl,nlj->nj", _array(weights), slopes))

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, None]:
        return *_Second.apply(*ctx.saved_tensors, gradients[0], ctx.model), None


class _Second(torch.autograd.Function):
    """Σ w·∇²F(x)·v and J(x)·v; torch's own ``once_differentiable`` would give zero for what it cannot differentiate."""

    @staticmethod
    def forward(
        ctx: Any, poses: torch.Tensor, weights: torch.Tensor, seeds: torch.Tensor, model: Any
    ) -> tuple[torch.Tensor, torch.Tensor]:
        check_gives(model, "hessian")
        x, w, v = map(_array, (poses, weights, seeds))
        by_pose = np.einsum("nij,nj->ni", model.hessian(x, w), v)
        return torch.from_numpy(by_pose), torch.from_numpy(np.einsum("nlj,nj->nl", model.jacobian(x)[1], v))

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> Any:
        raise RuntimeError("contact loads have no third derivatives, expected one or two differentiations")


def _array(tensor: torch.Tensor) -> Array:
    return np.ascontiguousarray(tensor.detach().numpy())
