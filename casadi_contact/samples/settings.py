"""What a sample is drawn from: its inputs, and the settings of a sampling plan [EF15 §2.1, §3.2, §3.3, Table 1]."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from casadi_contact.core.conventions import POSE_NAMES, WRENCH_NAMES
from casadi_contact.samples.samples import DOMAINS
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.checks import fail, grid_size

MOST_SAMPLES = 10_000_000  # of a domain: hundreds of times the paper's
PAPER_COUNTS = {"D1": 24000, "D2": 24000, "D3": 24000, "D4": 30000, "D5": 300, "D6": 20000, "D7": 100}
ALONE_COUNTS = {"D5": 6000, "D7": 3000}
"""Of joints with one patch, which have no D4 and D6: only D5 and D7 show what is out of contact."""

AROUND_POSES = {name: (0.5, 2.0) if name[0] == "t" else (0.02, 0.08) for name in POSE_NAMES}
"""Offsets [mm, rad] in D1 and D2 from poses that are known."""

# Least and greatest of each number among the settings.
_RANGES: dict[str, tuple[float, float]] = {
    **{"seed": (0, 2**63 - 1), "frames": (2, 10_000), "liftoff_steps": (1, 1000), "chunk_size": (1, 100_000)},
    **{"scale": (1e-6, MOST_SAMPLES), "liftoff_mm": (1e-3, 1e3), "settle_tolerance_n": (1e-9, 1e6)},
    **dict.fromkeys(("d1_fraction", "d1_offset", "d2_fraction", "d2_offset", "d3_fraction"), (0.0, 1e3)),
    **{"most_dropped": (0.0, 1.0), "most_edge_share": (0.0, 1.0)},
    **{"test_fraction": (0.0, 0.5), "validation_fraction": (0.0, 0.5)},
}


@dataclass(frozen=True)
class SamplePoint:
    """Inputs (pose parameters and loads, any mix) and the free pose parameters that a static analysis finds for them.

    Every movable pose parameter is an input or free, and there is one load for each free parameter: the knee's is
    {tx, Fy_med, tz, Fy_lat, ry, rz} -> (ty, rx). Where none is free, inputs are whole poses and each patch's normal
    load, which the pose takes by its least move (`chunk.pressed`).
    """

    inputs: tuple[str, ...]
    movable: tuple[str, ...] = POSE_NAMES

    def __post_init__(self) -> None:
        if len(set(self.inputs)) != len(self.inputs) or not set(self.pose_inputs) <= set(self.movable):
            raise ValueError(f"inputs are {', '.join(self.inputs)}, expected each once, and poses that can move")
        loads, free = self.load_inputs, self.free
        for name in loads:
            if name.partition("_")[0] not in (*WRENCH_NAMES, "F"):
                raise ValueError(f"sample point input {name!r} is neither a pose parameter nor a load")
        if len(loads) != len(free) and free:
            raise ValueError(f"got {len(loads)} loads for {len(free)} free pose parameters, expected as many")

    @property
    def free(self) -> tuple[str, ...]:
        """Movable pose parameters that are no inputs."""
        return tuple(name for name in self.movable if name not in self.inputs)

    @property
    def pose_inputs(self) -> tuple[str, ...]:
        """Inputs that are pose parameters, in input order."""
        return tuple(name for name in self.inputs if name in POSE_NAMES)

    @property
    def load_inputs(self) -> tuple[str, ...]:
        """Inputs that are loads, in input order."""
        return tuple(name for name in self.inputs if name not in POSE_NAMES)

    @classmethod
    def of_scene(cls, scene: Scene) -> SamplePoint:
        """[EF15 §3.2]: the pose parameters, each sensitive one replaced by a load of
        `Scene.controllable_normal_loads`."""
        if not scene.sensitive_pose:
            raise ValueError(f"{scene.name} has no sensitive_pose: use cc.sensitive_directions or sampling.inputs")
        loads = [name for normal in scene.controllable_normal_loads for name in normal.loads]
        if len(scene.sensitive_pose) != len(loads):
            got = f"{len(scene.sensitive_pose)} sensitive pose parameters for {len(loads)} sensitive loads"
            raise ValueError(f"scene {scene.name} has {got}, expected as many; give sampling.inputs")
        swap = dict(zip(scene.sensitive_pose, loads, strict=True))
        movable = scene.pose_space.free_names
        return cls(tuple(swap.get(name, name) for name in movable), movable)


@dataclass(frozen=True)
class SamplingSettings:
    """How many samples, from which boxes, on which grids; the defaults are the paper's [EF15 §3.3, Table 1].

    counts: samples per domain at scale 1; d1_fraction and d1_offset (times the mean width, for narrow frames) expand
    the envelopes to D1, likewise D2; d3_fraction expands the extremes; d3_minimum_widths: least width of D3 in an
    input [mm, rad or N]; fixed_offsets: an input's offset in D1 and in D2 [mm, rad or N], whatever its curves (ry is
    known from a single curve: 1.1° and 3.4°); settle_tolerance_n: largest force error of a static analysis;
    most_edge_share: of a patch's load, at the edges of the elements; poses with more of it become no samples;
    most_dropped: share of a domain's plan that may become no samples; inputs: sample-point inputs, the scene's if
    empty; reach: ranges (low, high) of all inputs [mm, rad, N] of the plan `reach` (see `domains`).
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
    most_edge_share: float = 0.02
    chunk_size: int = 500
    most_dropped: float = 0.3
    inputs: tuple[str, ...] = ()
    reach: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("counts", "fixed_offsets", "d3_minimum_widths", "reach"):
            if not isinstance(getattr(self, name), Mapping):
                raise fail(f"sampling.{name}", getattr(self, name), "a table")
        if set(self.counts) - set(DOMAINS):
            raise fail("sampling.counts", self.counts, f"samples for some of {', '.join(DOMAINS)}")
        for domain, count in self.counts.items():
            _number(f"counts.{domain}", count, 0, MOST_SAMPLES, whole=True)
        for name, (least, most) in _RANGES.items():
            _number(name, getattr(self, name), least, most, whole=isinstance(getattr(type(self), name), int))
        if self.scale * max(self.counts.values(), default=0) > MOST_SAMPLES:
            raise fail("sampling.scale", self.scale, f"at most {MOST_SAMPLES} samples in a domain")
        if isinstance(self.inputs, str) or not all(isinstance(name, str) for name in self.inputs):
            raise fail("sampling.inputs", self.inputs, "a list of pose parameters and loads")
        pairs = {
            key: {name: _pair(f"{key}.{name}", pair, least) for name, pair in getattr(self, key).items()}
            for key, least in (("fixed_offsets", 0.0), ("reach", -1e15))
        }
        widths = {name: _number(f"d3_minimum_widths.{name}", width) for name, width in self.d3_minimum_widths.items()}
        grids = {name: grid_size(f"sampling.{name}", getattr(self, name)) for name in ("settle_grid", "teacher_grid")}
        counts, inputs = {domain: self.counts.get(domain, 0) for domain in DOMAINS}, tuple(self.inputs)
        plain: dict[str, Any] = {"counts": counts, "inputs": inputs, "d3_minimum_widths": widths, **pairs, **grids}
        for name, value in plain.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_scene(cls, scene: Scene, **overrides: Any) -> SamplingSettings:
        """The paper's settings (`ALONE_COUNTS` with one patch), the scene's grids and ``[sampling]``, overrides.

        A ``counts``, ``fixed_offsets`` or ``d3_minimum_widths`` table replaces single entries. ValueError names a key.
        """
        grids = {"settle_grid": "settle", "teacher_grid": "teacher"}
        values: dict[str, Any] = {key: scene.grids[grid] for key, grid in grids.items() if grid in scene.grids}
        base = cls(counts={**PAPER_COUNTS, **(ALONE_COUNTS if len(scene.controllable_normal_loads) == 1 else {})})
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
        point = SamplePoint(self.inputs, scene.pose_space.free_names) if self.inputs else SamplePoint.of_scene(scene)
        for setting in ("fixed_offsets", "d3_minimum_widths"):
            for name in getattr(self, setting):
                if name not in (*POSE_NAMES, *point.inputs):
                    raise fail(f"sampling.{setting}", name, f"inputs among {', '.join(point.inputs)}")
        if self.reach and set(self.reach) != set(point.inputs):
            raise fail("sampling.reach", list(self.reach), f"a range of each input: {', '.join(point.inputs)}")
        return point

    def to_table(self) -> dict[str, Any]:
        """Plain numbers, lists and tables for JSON, without `most_dropped`, which changes no sample."""
        table: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        del table["most_dropped"]
        return table


def _number(name: str, value: object, least: float = 0.0, most: float = 1e15, *, whole: bool = False) -> float:
    kinds = int if whole else int | float
    if isinstance(value, bool) or not isinstance(value, kinds) or not least <= value <= most:
        raise fail(f"sampling.{name}", value, f"a {'whole ' if whole else ''}number from {least:g} to {most:g}")
    return float(value)


def _pair(name: str, pair: object, least: float) -> tuple[float, float]:
    numbers = [_number(name, number, least) for number in pair] if isinstance(pair, list | tuple) else []
    if len(numbers) != 2 or numbers[1] < numbers[0]:
        raise fail(f"sampling.{name}", pair, "two numbers, the smaller one first")
    return numbers[0], numbers[1]
