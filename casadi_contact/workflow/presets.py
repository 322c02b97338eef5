"""Presets: how much to sample and how long to train, from a quick look to what is shipped; and the paper's own way."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Any


@dataclass(frozen=True)
class Effort:
    """Training of one kind of network: sizes to grow through, budget, activation, samples used at most, and the wanted
    error as a share of the scene's tolerance (below 1, all the budget is used to get better than needed).

    gflop: 10⁹ floating-point operations, counted as `training.TrainingSettings` says; 0, in a round that goes on from
    other networks: weights are kept, made wider. Work and not time, so that the same samples give the same surrogate on
    a busy machine. Measured on one core with AVX-512, the other one busy: 13 Gflop a second for networks of 14-14, 22
    for 20-20-20, 35 for 4×30. cpu_s: a clock in place of it."""

    sizes: tuple[tuple[int, ...], ...]
    gflop: float
    activation: str = "algebraic"
    max_rows: int | None = None
    tolerance_share: float = 1.0
    cpu_s: float = inf


@dataclass(frozen=True)
class ActiveRound:
    """Training goes on with the worst_share of samples on which the surrogate of before is worst, of so many times the
    preset's (see `stages`); efforts: of this round. Sizes are those of before or wider: weights are kept."""

    times: float
    worst_share: float
    efforts: dict[str, dict[str, Effort]] = field(default_factory=dict)


@dataclass(frozen=True)
class Preset:
    """sampling_scale: samples as a share of the paper's 122,400; efforts: by structure, then by the start of a
    network's name (see `effort_for`); active: rounds that follow; charted: what the speed-accuracy chart trains beside
    these, by structure one effort for each size, whose budget goes to each network, or the share of it that the
    structure says (`Surrogate.budget_shares`); domain_weights: what residuals in a domain ("D1") are multiplied by in
    training, 1 where it is not named; sampling: other fields of `SamplingSettings` than the scene's."""

    sampling_scale: float
    efforts: dict[str, dict[str, Effort]] = field(default_factory=dict)
    active: tuple[ActiveRound, ...] = ()
    charted: dict[str, tuple[Effort, ...]] = field(default_factory=dict)
    domain_weights: dict[str, float] = field(default_factory=dict)
    sampling: dict[str, Any] = field(default_factory=dict)


def effort_for(efforts: Mapping[str, Effort], network: str) -> Effort:
    """The effort for one network: of the starts that fit its name the longest wins ("" fits all)."""
    fitting = [start for start in efforts if network.startswith(start)]
    return efforts[max(fitting, key=len)]


def _ladder(activation: str, *rungs: tuple[int, float, int | None]) -> tuple[Effort, ...]:
    """Efforts for sizes n-n from (n, Gflop, samples used at most); small networks learn no more from more rows."""
    return tuple(Effort(((size, size),), gflop, activation, rows, 0.2) for size, gflop, rows in rungs)


def _patch(
    root: tuple[int, float], ratios: tuple[int, float], max_rows: int | None = None, share: float = 0.2
) -> dict[str, Effort]:
    """Root networks of three layers and ratio networks of two, each of (neurons a layer, Gflop)."""
    layers = {"root": ((root[0],) * 3, root[1]), "ratios": ((ratios[0],) * 2, ratios[1])}
    return {
        name: Effort((sizes,), gflop, max_rows=max_rows, tolerance_share=share)
        for name, (sizes, gflop) in layers.items()
    }


def _as_in_the_paper(gflop: float, cpu_s: float = inf, first: tuple[tuple[int, ...], ...] = ()) -> dict[str, Effort]:
    """The paper's network of 4×30 neurons on 80,000 rows, grown to [EF15 §3.5], and the networks of root loads that
    confirm its contact; first: sizes to grow through before 4×15."""
    sizes = (*first, (15,) * 4, (22,) * 4, (30,) * 4)
    return {
        "": Effort(sizes, gflop, "tanh", max_rows=80_000, tolerance_share=0.1, cpu_s=cpu_s),
        "root": Effort(((16, 16, 16),), 1_000.0, max_rows=80_000, tolerance_share=0.2),
    }


def _reach_round(root: tuple[int, float], ratios: tuple[int, float]) -> ActiveRound:
    """The worst tenth of six times the samples, learned by wider networks."""
    return ActiveRound(times=6.0, worst_share=0.1, efforts={"patch": _patch(root, ratios)})


PRESETS: dict[str, Preset] = {
    "quick": Preset(
        sampling_scale=0.14,
        efforts={
            "patch": {"root": Effort(((8, 8), (16, 16, 16)), 1_000.0), "ratios": Effort(((8, 8), (14, 14)), 150.0)}
        },
        charted={
            "patch": _ladder(
                "algebraic",
                *((6, 6.0, 5_000), (8, 15.0, 5_000), (12, 55.0, None)),
                *((16, 100.0, None), (24, 220.0, None), (32, 380.0, None), (48, 800.0, None)),
            ),
            "two_stage": _ladder("tanh", (8, 6.0, 5_000), (16, 18.0, 5_000)),
        },
    ),
    "standard": Preset(
        sampling_scale=0.4,
        efforts={"patch": _patch((20, 9_000.0), (14, 700.0)), "two_stage": _as_in_the_paper(2_000.0)},
        charted={
            "patch": _ladder(
                "algebraic",
                *((6, 45.0, 10_000), (8, 95.0, 15_000), (12, 400.0, None)),
                *((16, 700.0, None), (24, 1_500.0, None), (32, 3_200.0, None), (48, 13_000.0, None)),
            ),
            "two_stage": _ladder("tanh", (8, 28.0, 12_000), (16, 115.0, 12_000), (24, 310.0, 12_000)),
        },
    ),
    "mesh": Preset(  # for surfaces of meshes, on which loads bend more sharply
        sampling_scale=0.4,
        efforts={"patch": _patch((32, 9_000.0), (24, 2_500.0))},
        domain_weights={"D1": 6.0, "D3": 2.0, "D4": 1.5},  # poses like those of the motion are to be the most accurate
    ),
    "reach": Preset(  # for scenes whose plan is a joint's whole reach: larger networks than around a motion
        sampling_scale=0.4,
        efforts={"patch": _patch((24, 20_000.0), (20, 6_000.0))},
        active=(
            *(_reach_round((32, gflop), (28, gflop)) for gflop in (3_000.0, 6_000.0, 8_000.0, 10_000.0)),
            *(_reach_round((40, of), (32, by)) for of, by in ((3e4, 12_000.0), (4e4, 15_000.0), (5e4, 20_000.0))),
        ),
    ),
    "full": Preset(
        sampling_scale=1.0,
        efforts={"patch": _patch((24, 24e3), (20, 6e3), 60_000, share=0.1), "two_stage": _as_in_the_paper(15e3)},
    ),
    "paper": Preset(  # [EF15 §2.6, §3.3, §3.5]: its grids, growth from one layer, six hours for each network
        sampling_scale=1.0,
        sampling={"settle_grid": (40, 30), "teacher_grid": (80, 40), "d3_minimum_widths": {"tz": 0.0, "ry": 0.0}},
        efforts={"two_stage": _as_in_the_paper(inf, 6.0 * 3600.0, ((15,), (15, 15), (15, 15, 15)))},
    ),
}


def _to_tolerance(scale: float, share: float, root: tuple[int, float], ratios: int) -> Preset:
    """A round: networks of root loads of (neurons a layer, Gflop), ratios for a fifth of the work. Fits end closer to
    the samples than the tolerance asks, since errors of a joint's sides may add up, and closer in later rounds."""
    return Preset(scale, {"patch": _patch(root, (ratios, 0.2 * root[1]), share=share)})


TO_TOLERANCE = (
    _to_tolerance(0.1, 0.8, (12, 50.0), 10),
    _to_tolerance(0.4, 0.6, (16, 300.0), 12),
    _to_tolerance(0.4, 0.6, (24, 1_800.0), 18),
    _to_tolerance(1.0, 0.4, (32, 9_000.0), 24),
    _to_tolerance(1.0, 0.3, (40, 40_000.0), 32),
)
"""Rounds of a build to a tolerance (see `tolerance`): the knee meets 2 N and 50 N·mm in the third."""
