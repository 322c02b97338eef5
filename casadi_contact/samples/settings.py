"""Settings of a sampling plan; the defaults are the paper's [EF15 §3.3, Table 1]."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from casadi_contact.core.conventions import POSE_NAMES
from casadi_contact.samples.sample_point import SamplePoint
from casadi_contact.samples.samples import DOMAINS
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.checks import grid_size

MOST_SAMPLES = 10_000_000  # of a domain: hundreds of times the paper's
PAPER_COUNTS = {"D1": 24000, "D2": 24000, "D3": 24000, "D4": 30000, "D5": 300, "D6": 20000, "D7": 100}
ALONE_COUNTS = {"D5": 6000, "D7": 3000}
"""Of joints of which no patch is lifted off alone, without D4 and D6: all that tells what is out of contact."""


@dataclass(frozen=True)
class SamplingSettings:
    """How many samples, from which boxes, on which grids.

    counts: samples per domain at scale 1; d1_fraction and d1_offset (times the mean width, for narrow frames)
    expand the envelopes to D1, likewise D2; d3_fraction expands the extremes; d3_minimum_widths: width that D3 has at
    least in an input [mm, rad or N] (empty in the paper; an input that hardly varies in the reference motion would
    leave other motions and an optimiser's steps outside all domains); fixed_offsets: an input's offset in
    D1 and in D2 [mm, rad or N], whatever its curves (the paper gives no number for ry, known from a single curve: these
    are 1.1 and 3.4 degrees; other inputs with one curve: see `envelopes`); settle_tolerance_n: largest force error of a
    static analysis; most_dropped: share of a domain's plan that may become no samples; inputs: sample-point inputs, the
    scene's if empty; reach: ranges (low, high) of all inputs [mm, rad, N], the plan `reach` instead of the paper's: see
    `domains`.
    """

    counts: Mapping[str, int] = field(default_factory=lambda: dict(PAPER_COUNTS))
    scale: float = 1.0
    seed: int = 2015
    frames: int = 101
    d1_fraction: float = 0.2
    d1_offset: float = 0.5
    d2_fraction: float = 1.0
    d2_offset: float = 2.0
    d3_fraction: float = 0.25
    fixed_offsets: Mapping[str, tuple[float, float]] = field(default_factory=lambda: {"ry": (0.02, 0.06)})
    d3_minimum_widths: Mapping[str, float] = field(default_factory=dict)
    liftoff_mm: float = 2.0
    liftoff_steps: int = 3
    test_fraction: float = 0.1
    validation_fraction: float = 0.1
    settle_grid: tuple[int, int] = (40, 30)
    teacher_grid: tuple[int, int] = (80, 40)
    settle_tolerance_n: float = 1e-3
    chunk_size: int = 500
    most_dropped: float = 0.3
    inputs: tuple[str, ...] = ()
    reach: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.counts, Mapping) or set(self.counts) - set(DOMAINS):
            raise _bad("counts", self.counts, f"samples for some of {', '.join(DOMAINS)}")
        for domain, count in self.counts.items():
            _whole(f"counts.{domain}", count, least=0, most=MOST_SAMPLES)
        object.__setattr__(self, "counts", {d: self.counts.get(d, 0) for d in DOMAINS})
        if not isinstance(self.fixed_offsets, Mapping):
            raise _bad("fixed_offsets", self.fixed_offsets, "pairs (D1, D2) of offsets by input")
        offsets: dict[str, tuple[float, float]] = {}
        for name, pair in self.fixed_offsets.items():
            key = f"fixed_offsets.{name}"
            numbers = [_number(key, value) for value in pair] if isinstance(pair, list | tuple) else []
            if len(numbers) != 2 or not 0.0 < numbers[0] <= numbers[1]:
                raise _bad(key, pair, "two offsets, D1's and D2's, with 0 < D1 <= D2")
            offsets[name] = (numbers[0], numbers[1])
        object.__setattr__(self, "fixed_offsets", offsets)
        if not isinstance(self.d3_minimum_widths, Mapping):
            raise _bad("d3_minimum_widths", self.d3_minimum_widths, "widths by input")
        widths = {name: _number(f"d3_minimum_widths.{name}", w) for name, w in self.d3_minimum_widths.items()}
        object.__setattr__(self, "d3_minimum_widths", widths)
        for name in ("scale", "liftoff_mm", "settle_tolerance_n"):
            _number(name, getattr(self, name), positive=True)
        for name in ("d1_fraction", "d1_offset", "d2_fraction", "d2_offset", "d3_fraction"):
            _number(name, getattr(self, name))
        if not 0.0 <= _number("most_dropped", self.most_dropped) <= 1.0:
            raise _bad("most_dropped", self.most_dropped, "a share from 0 to 1")
        for name in ("test_fraction", "validation_fraction"):
            if not 0.0 <= _number(name, getattr(self, name)) <= 0.5:
                raise _bad(name, getattr(self, name), "a number from 0 to 0.5")
        limits = {"seed": (0, 2**63 - 1), "frames": (2, 10_000), "liftoff_steps": (1, 1000), "chunk_size": (1, 100_000)}
        for name, (least, most) in limits.items():
            _whole(name, getattr(self, name), least=least, most=most)
        if self.scale * max(self.counts.values()) > MOST_SAMPLES:
            raise _bad("scale", self.scale, f"at most {MOST_SAMPLES} samples in a domain")
        for name in ("settle_grid", "teacher_grid"):
            grid = getattr(self, name)
            object.__setattr__(self, name, grid_size(f"sampling.{name}", grid))
        if isinstance(self.inputs, str) or not all(isinstance(name, str) for name in self.inputs):
            raise _bad("inputs", self.inputs, "a list of pose parameters and loads")
        object.__setattr__(self, "inputs", tuple(self.inputs))
        if self.inputs:
            SamplePoint.of_inputs(self.inputs)
        if not isinstance(self.reach, Mapping):
            raise _bad("reach", self.reach, "pairs (low, high) by input")
        object.__setattr__(self, "reach", {name: _range(f"reach.{name}", pair) for name, pair in self.reach.items()})

    @classmethod
    def from_scene(cls, scene: Scene, **overrides: Any) -> SamplingSettings:
        """The paper's settings, with more of D5 and D7 where no patch is lifted off alone (`ALONE_COUNTS`), the scene's
        grids, the scene's ``[sampling]`` table, then keyword overrides.

        A ``counts``, ``fixed_offsets`` or ``d3_minimum_widths`` table replaces single entries. Raises ValueError naming
        an unknown key or a bad value.
        """
        grids = {"settle_grid": "settle", "teacher_grid": "teacher"}
        values: dict[str, Any] = {key: scene.grids[grid] for key, grid in grids.items() if grid in scene.grids}
        base = cls(counts={**PAPER_COUNTS, **(ALONE_COUNTS if len(scene.pressed) == 1 else {})})
        values["counts"] = base.counts
        known = [f.name for f in fields(cls)]
        for origin, table in (("sampling.", scene.sampling), ("", overrides)):
            for key, value in table.items():
                if key not in known:
                    raise ValueError(f"unknown sampling setting {origin}{key}, expected one of {', '.join(known)}")
                if key in ("counts", "fixed_offsets", "d3_minimum_widths") and isinstance(value, Mapping):
                    value = {**values.get(key, getattr(base, key)), **value}
                values[key] = value
        return cls(**values)

    def sample_point(self, scene: Scene) -> SamplePoint:
        """The sample-point definition: these settings' inputs, or the scene's [EF15 §3.2]."""
        point = SamplePoint.of_inputs(self.inputs, scene.pose_space) if self.inputs else SamplePoint.of_scene(scene)
        for setting in ("fixed_offsets", "d3_minimum_widths"):
            for name in getattr(self, setting):
                if name not in (*POSE_NAMES, *point.inputs):
                    raise _bad(setting, name, f"inputs among {', '.join(point.inputs)}")
        if self.reach and set(self.reach) != set(point.inputs):
            raise _bad("reach", list(self.reach), f"a range of each input: {', '.join(point.inputs)}")
        return point

    def to_table(self) -> dict[str, Any]:
        """Plain numbers, lists and tables, as JSON keeps them; without `most_dropped`, which changes no sample, and
        without an empty reach, which files of before do not know."""
        table = json.loads(json.dumps(asdict(self)))
        del table["most_dropped"]
        return {key: value for key, value in table.items() if key != "reach" or value}

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> SamplingSettings:
        """The settings that `to_table` wrote."""
        return cls(**table)


def _bad(name: str, got: object, expected: str) -> ValueError:
    return ValueError(f"sampling setting {name} = {got!r}, expected {expected}")


def _whole(name: str, value: object, *, least: int, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise _bad(name, value, f"a whole number from {least} to {most}")
    return value


def _range(name: str, pair: object) -> tuple[float, float]:
    numbers = [v for v in pair if isinstance(v, int | float)] if isinstance(pair, list | tuple) else []
    if len(numbers) != 2 or not all(map(math.isfinite, numbers)) or not numbers[0] < numbers[1]:
        raise _bad(name, pair, "two numbers, low < high")
    return float(numbers[0]), float(numbers[1])


def _number(name: str, value: object, *, positive: bool = False) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < 0:
        raise _bad(name, value, "a number >= 0")
    if positive and value == 0:
        raise _bad(name, value, "a number > 0")
    return float(value)
