"""Activations of hidden neurons: each is one record, which every evaluation of a network reads.

    algebraic:  σ(z) = z/√(1 + z²)        tanh:  σ(z) = tanh z

A new one is a function, a few statements of C and an entry in ``ACTIVATIONS``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Activation:
    """A smooth, odd or not, strictly increasing σ.

    derivatives(xp, z, order): (σ, σ')[: order + 1] elementwise, with xp the module (numpy, torch or casadi) that z
    belongs to; all three give the same formulas. slope_from_value(xp, a): σ' where σ = a, so that training keeps
    no z. c: statements of C that set value, slope and curvature from z; c_type: of all four, ``double``, or, faster,
    ``Vector``, a register of neurons: for statements of arithmetic and of the helpers of ``core.h`` for it.
    """

    derivatives: Callable[[Any, Any, int], tuple[Any, ...]]
    slope_from_value: Callable[[Any, Any], Any]
    c: str
    c_type: str = "double"


def _algebraic(xp: Any, z: Any, order: int) -> tuple[Any, ...]:
    r = 1.0 / xp.sqrt(1.0 + z * z)
    return (z * r, r * r * r) if order else (z * r,)


def _tanh(xp: Any, z: Any, order: int) -> tuple[Any, ...]:
    a = xp.tanh(z)
    return (a, 1.0 - a * a) if order else (a,)


def _algebraic_slope(xp: Any, a: Any) -> Any:
    slope = 1.0 - a * a
    return slope * xp.sqrt(slope)


ACTIVATIONS: dict[str, Activation] = {
    "algebraic": Activation(
        _algebraic,
        _algebraic_slope,
        """\
const Vector r = reciprocal_root(1.0 + z * z), r2 = r * r;
value = z * r;
slope = r2 * r;
curvature = -3.0 * value * (r2 * r2);""",
        c_type="Vector",
    ),
    "tanh": Activation(
        _tanh,
        lambda _, a: 1.0 - a * a,
        """\
value = hyperbolic_tangent(z);
slope = 1.0 - value * value;
curvature = -2.0 * value * slope;""",
        c_type="Vector",
    ),
}


def activation_of(name: str) -> Activation:
    """The record of an activation; raises ValueError for an unknown name."""
    if name not in ACTIVATIONS:
        raise ValueError(f"unknown activation {name!r}, expected one of {', '.join(ACTIVATIONS)}")
    return ACTIVATIONS[name]
