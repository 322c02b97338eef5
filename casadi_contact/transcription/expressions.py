"""What a surrogate's graph consists of: named outputs with derivatives up to the order asked for."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import casadi as ca


@dataclass(frozen=True)
class Output:
    """value (m), jacobian (m x 6), second (m x 36: row k holds the stacked columns of d² value_k / dpose²).

    Derivatives above the order asked for are empty.
    """

    value: ca.MX
    jacobian: ca.MX = field(default_factory=ca.MX)
    second: ca.MX = field(default_factory=ca.MX)


@dataclass(frozen=True)
class Expressions:
    """Signed root load of every patch and the named loads."""

    roots: Output
    loads: Output


def nan_marker(poses: ca.MX) -> ca.MX:
    """0 for every finite pose (a column of 6 x n), NaN for any other; shape (1 x n), derivatives zero."""
    # |sin| <= 1, and the sine of infinity is NaN. CasADi would simplify 0·pose to 0.
    return ca.floor(0.5 + 0.01 * ca.sum1(ca.sin(poses)))


def nan_if_not_finite(pose: ca.MX, expressions: Expressions) -> Expressions:
    """The expressions, NaN in every entry and order where a pose holds NaN or infinity; other values stay as they are.

    ca.fmax, ca.fmin and comparisons drop NaN, so that it would reach some of the outputs only.
    """
    marker = nan_marker(pose)

    def marked(output: Output) -> Output:
        parts = (getattr(output, part.name) for part in fields(output))
        return Output(*(part if part.is_empty() else part + marker for part in parts))

    return Expressions(marked(expressions.roots), marked(expressions.loads))
