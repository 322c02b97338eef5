"""What a surrogate's graph consists of: named outputs with derivatives up to the order asked for."""

from __future__ import annotations

from dataclasses import dataclass, field

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
