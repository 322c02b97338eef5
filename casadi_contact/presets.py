"""Presets: how much to sample and how long to train, from a quick look to the paper's own effort."""

from __future__ import annotations

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
class Preset:
    """sampling_scale: samples as a share of the paper's 122,400; efforts: by structure, then by the start of a
    network's name, the longest fitting start winning ("" fits all)."""

    sampling_scale: float
    efforts: dict[str, dict[str, Effort]] = field(default_factory=dict)

    def effort(self, structure: str, network: str) -> Effort:
        """The effort for one network of a structure."""
        fitting = [start for start in self.efforts[structure] if network.startswith(start)]
        return self.efforts[structure][max(fitting, key=len)]


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
    ),
}
