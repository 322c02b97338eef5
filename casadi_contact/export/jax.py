"""Contact loads as a JAX function with first and second derivatives (pip install casadi_contact[jax])."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.export import check_gives, check_last_axis


def contact_loads(model: Any) -> Callable[[jax.Array], jax.Array]:
    """Function poses (..., 6) [mm, rad] -> loads (..., L) [N, N·mm], for jit, vmap, grad, jacfwd, jacrev and hessian.

    Compiled programs call the model back on the CPU. ValueError for poses in single precision and a model without
    Jacobian, or without Hessian at a second derivative. A pose that is not finite has loads and derivatives NaN."""
    check_gives(model, "__call__", "jacobian")
    count = len(model.load_names)

    def called_back(evaluate: Callable[[Array], Array], *shape: int) -> Callable[[jax.Array], jax.Array]:
        """A JAX function poses (..., 6) -> (..., *shape) that calls evaluate with poses (n, 6)."""

        def of_any(poses: Any) -> Array:
            array = np.asarray(poses, dtype=np.float64)
            rows = array.reshape(-1, 6)
            finite = np.isfinite(rows).all(axis=1)
            result = np.full((len(rows), *shape), np.nan)
            result[finite] = evaluate(rows[finite])
            return result.reshape(*array.shape[:-1], *shape)

        def function(poses: jax.Array) -> jax.Array:
            result = jax.ShapeDtypeStruct((*poses.shape[:-1], *shape), jnp.float64)
            return jax.pure_callback(of_any, result, poses, vmap_method="broadcast_all")

        return function

    values = jax.custom_jvp(called_back(model, count))
    jacobians = jax.custom_jvp(called_back(lambda poses: model.jacobian(poses)[1], count, 6))

    def of_each_load(poses: Array) -> Array:
        """Second derivatives (n, L, 6, 6) of each load."""
        return np.stack([model.hessian(poses, np.tile(row, (len(poses), 1))) for row in np.eye(count)], axis=1)

    hessians = called_back(of_each_load, count, 6, 6)

    @values.defjvp
    def _(primals: Any, tangents: Any) -> Any:
        (poses,), (moved,) = primals, tangents
        return values(poses), jnp.einsum("...lj,...j->...l", jacobians(poses), moved)

    @jacobians.defjvp
    def _(primals: Any, tangents: Any) -> Any:
        check_gives(model, "hessian")
        (poses,), (moved,) = primals, tangents
        return jacobians(poses), jnp.einsum("...ljk,...k->...lj", hessians(poses), moved)

    def loads(poses: jax.Array) -> jax.Array:
        poses = jnp.asarray(poses)
        check_last_axis(poses.shape)
        if poses.dtype != jnp.float64:
            raise ValueError(f'poses is {poses.dtype}, expected float64: jax.config.update("jax_enable_x64", True)')
        return values(poses)

    return loads
