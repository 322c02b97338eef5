"""What a fit may use and how it grows."""

from __future__ import annotations

import math
from dataclasses import dataclass

from casadi_contact.core.conventions import whole_number
from casadi_contact.networks.activations import activation_of
from casadi_contact.networks.training.weights import check_sizes


@dataclass(frozen=True)
class TrainingSettings:
    """Settings of one network's fit.

    sizes: hidden layers to grow through, smallest first; a single entry trains that size without growth. On roots of
    contact loads three layers reach a given error sooner than two of as many weights.
    max_gflop: budget, shared by all sizes and restarts, in 10⁹ floating-point operations of matrix products. They are
    counted, not timed, so that a busy or slow machine stops at the same iteration with the same weights. A core of
    2023 does 5 to 35 Gflop a second, small networks being slowest. max_iterations: another end; with it growth goes
    by iterations instead.
    max_validation_rises: criterion 3 of [EF15 §2.6]. restarts: how often a stalled fit begins again from another seed.
    stall_window, stall_improvement: stalled if the error falls by less than this share over so many iterations.
    growth_share: share of the budget that a size gets, and growth_iterations the iterations, before its trend decides.
    share_for_another: a larger or restarted network needs work of its own; with a smaller share of the budget left the
    present one goes on.
    chunk_rows: rows worked on at once (cache). checkpoint_every_s: a killed fit loses at most so much. threads: BLAS
    threads; 1 keeps weights reproducible.
    """

    sizes: tuple[tuple[int, ...], ...] = ((8,), (12, 12), (16, 16, 16), (20, 20, 20), (24, 24, 24))
    activation: str = "algebraic"
    max_gflop: float = 5000.0
    max_iterations: int | None = None
    max_validation_rises: int = 50
    seed: int = 0
    restarts: int = 2
    stall_window: int = 60
    stall_improvement: float = 2e-3
    growth_share: float = 0.05
    growth_iterations: int = 20
    share_for_another: float = 0.2
    chunk_rows: int = 2000
    checkpoint_every_s: float = 5.0
    threads: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "sizes", check_sizes(self.sizes))
        activation_of(self.activation)
        if not self.max_gflop > 0.0:
            raise ValueError(f"max_gflop is {self.max_gflop!r}, expected 10⁹ operations, above 0")
        if self.max_iterations is None and math.isinf(self.max_gflop):
            raise ValueError("max_gflop is infinite and max_iterations None, expected an end to the fit")
        for name, least in (
            ("max_iterations", 1), ("max_validation_rises", 1), ("seed", 0), ("restarts", 0), ("stall_window", 1),
            ("growth_iterations", 1), ("chunk_rows", 1), ("threads", 1),
        ):  # fmt: skip
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, whole_number(name, value, least))
        for name in ("stall_improvement", "growth_share", "share_for_another"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ValueError(f"{name} is {getattr(self, name)!r}, expected a share from 0 to below 1")
        if not self.checkpoint_every_s >= 0.0:
            raise ValueError(f"checkpoint_every_s is {self.checkpoint_every_s!r}, expected seconds of 0 or more")
