"""Presets: how much to sample and how long to train, from a quick look to the paper's own effort."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Effort:
    """Training of one kind of network: sizes to grow through, seconds allotted, activation, samples used at most, and
    the wanted error as a share of the scene's tolerance (below 1, all the time is used to get better than needed)."""

    sizes: tuple[tuple[int, ...], ...]
    seconds: float
    activation: str = "algebraic"
    max_rows: int | None = None
    tolerance_share: float = 1.0


@dataclass(frozen=True)
class ChartEffort:
    """What the speed-accuracy chart trains beside the preset's own surrogates.

    sizes: by structure, one effort for each size; its seconds go to each network, or the share of them that the
    structure says (`Surrogate.seconds_shares`). swept: structure and size (one of `sizes`) that is trained again with
    fewer samples (sample_counts) and with other seconds (training_seconds). peer_seconds: allotted to each peer.
    """

    sizes: dict[str, tuple[Effort, ...]] = field(default_factory=dict)
    swept: tuple[str, tuple[int, ...]] = ("patch", (12, 12))
    sample_counts: tuple[int, ...] = ()
    training_seconds: tuple[float, ...] = ()
    peer_seconds: float = 20.0


@dataclass(frozen=True)
class Preset:
    """sampling_scale: samples as a share of the paper's 122,400; efforts: by structure, then by the start of a
    network's name (see `effort_for`); chart: what the speed-accuracy chart trains."""

    sampling_scale: float
    efforts: dict[str, dict[str, Effort]] = field(default_factory=dict)
    chart: ChartEffort = field(default_factory=ChartEffort)


def effort_for(efforts: Mapping[str, Effort], network: str) -> Effort:
    """The effort for one network: of the starts that fit its name the longest wins ("" fits all)."""
    fitting = [start for start in efforts if network.startswith(start)]
    return efforts[max(fitting, key=len)]


def _ladder(activation: str, *rungs: tuple[int, float, int | None]) -> tuple[Effort, ...]:
    """Efforts for sizes n-n from (n, seconds, samples used at most); small networks learn no more from more rows."""
    return tuple(
        Effort(((width, width),), seconds, activation, max_rows=rows, tolerance_share=0.2)
        for width, seconds, rows in rungs
    )


_PAPER_NETWORK = ((30, 30, 30, 30),)

PRESETS: dict[str, Preset] = {
    "quick": Preset(
        sampling_scale=0.14,
        efforts={
            "patch": {
                "root": Effort(((8, 8), (16, 16, 16)), 90.0),
                "ratio": Effort(((6, 6), (10, 10)), 12.0),
            }
        },
        chart=ChartEffort(
            sizes={
                "patch": _ladder(
                    "algebraic",
                    *((6, 2.0, 5_000), (8, 3.0, 5_000), (12, 6.0, None)),
                    *((16, 8.0, None), (24, 12.0, None), (32, 18.0, None), (48, 30.0, None)),
                ),
                "two_stage": _ladder("tanh", (8, 2.0, 5_000), (16, 4.0, 5_000)),
            },
            sample_counts=(300, 1_000, 3_000),
            training_seconds=(1.0, 3.0, 15.0),
        ),
    ),
    "standard": Preset(
        sampling_scale=0.4,
        efforts={
            "patch": {
                "root": Effort(((20, 20, 20),), 1100.0, tolerance_share=0.2),
                "ratio": Effort(((14, 14),), 100.0, tolerance_share=0.2),
            },
            "two_stage": {"": Effort(_PAPER_NETWORK, 120.0, "tanh", max_rows=12_000)},
        },
        chart=ChartEffort(
            sizes={
                "patch": _ladder(
                    "algebraic",
                    *((6, 15.0, 10_000), (8, 20.0, 15_000), (12, 45.0, None)),
                    *((16, 55.0, None), (24, 90.0, None), (32, 150.0, None), (48, 480.0, None)),
                ),
                "two_stage": _ladder("tanh", (8, 10.0, 12_000), (16, 25.0, 12_000), (24, 50.0, 12_000)),
            },
            sample_counts=(300, 1_000, 3_000, 10_000),
            training_seconds=(2.0, 5.0, 15.0, 120.0),
            peer_seconds=600.0,
        ),
    ),
    "paper": Preset(
        sampling_scale=1.0,
        efforts={
            "patch": {
                "root": Effort(
                    ((16, 16, 16), (20, 20, 20), (24, 24, 24), (28, 28, 28)), 3 * 3600.0, tolerance_share=0.1
                ),
                "ratio": Effort(((10, 10), (14, 14), (20, 20)), 3600.0, tolerance_share=0.1),
            },
            "two_stage": {"": Effort(_PAPER_NETWORK, 6 * 3600.0, "tanh", max_rows=80_000)},
        },
        chart=ChartEffort(
            sizes={
                "patch": _ladder(
                    "algebraic",
                    *((6, 60.0, 20_000), (8, 120.0, 30_000), (12, 600.0, None)),
                    *((16, 900.0, None), (24, 1800.0, None), (32, 3600.0, None), (48, 2 * 3600.0, None)),
                ),
                "two_stage": _ladder("tanh", (8, 120.0, 80_000), (16, 600.0, 80_000), (24, 1800.0, 80_000)),
            },
            sample_counts=(300, 1_000, 3_000, 10_000, 30_000),
            training_seconds=(5.0, 20.0, 80.0, 300.0, 1200.0),
            peer_seconds=1200.0,
        ),
    ),
}
