"""The seven domains as plans of sample-point inputs [EF15 §3.3, Table 1], deterministic for a seed.

Around the reference motion lie envelopes [EF15 §2.2]: bounds of each input at each time frame, expanded by multiples of
their width. An input with the same curve in all cycles has no width (a single cycle: no input has). Its assumed width
is a tenth of the curve's range over the frames, at least 1 mm, 0.04 rad (2.3°) or 5 % of the largest load of its kind.

    D1, D2  per time frame: the 2^k vertices of the expanded envelope's box, filled up with Hammersley points
    D3      one big box: Hammersley points
    D4      one patch at the contact boundary, later lifted off in steps: Hammersley points
    D5      all patches at the contact boundary, later lifted off: Hammersley points
    D6, D7  one patch, all patches at the contact boundary: Hammersley points

No input pulls: normal loads end at the contact boundary. With one patch, one patch out of contact is all patches out
of contact: D4 and D6 are then left out (`left_out`).

The plan `reach` (``[sampling.reach]``) follows no motion: the box of D3 to D7 has the given ranges, wide enough for
every pose whose contact lies on the fixed surface (others are dropped where it runs off), and normal loads are drawn
evenly in their roots √N, for light and heavy contact alike. D5 lifts each patch by its own gap. D1, D2 are left out.

Along a motion whose poses are known (inputs are whole poses), D3 to D7 fill the boxes of D2 in place of one
big box, with normal loads of the whole motion, evenly in their roots.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import Array
from casadi_contact.core.quantities import ANGLE, LENGTH, quantity
from casadi_contact.samples.samples import DOMAINS, TEST, TRAIN, VALIDATION
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.normal_load import NormalLoad

_FILLING, _VERTICES, _ROLES = 0, 1, 2  # streams of random numbers within one domain
_ROUNDING = 1e-9  # a frame of exactly mean width is not narrow
_SAME = 1e-3  # of the assumed width: smaller differences come from the tolerance of settling
_SHARE_OF_RANGE, _SHARE_OF_LOAD = 0.1, 0.05
_LEAST_WIDTH = {LENGTH: 1.0, ANGLE: 0.04}  # mm, rad


@dataclass(frozen=True)
class Envelopes:
    """lower, upper (frames, inputs): one box of inputs per time frame. A single box is an envelope of one frame."""

    names: tuple[str, ...]
    lower: Array
    upper: Array

    @classmethod
    def over(cls, names: Sequence[str], curves: ArrayLike) -> Envelopes:
        """Bounds over the cycles of curves (cycles, frames, inputs)."""
        array = np.asarray(curves, dtype=float)
        return cls(tuple(names), array.min(axis=0), array.max(axis=0))

    @property
    def widths(self) -> Array:
        """upper - lower (frames, inputs)."""
        return self.upper - self.lower

    @property
    def assumed_widths(self) -> dict[str, float]:
        """Assumed widths of inputs with the same curve in all cycles, see above; 0 where all loads are zero."""
        ranges, kinds = self.upper.max(axis=0) - self.lower.min(axis=0), [quantity(name).kind for name in self.names]
        largest = np.maximum(np.abs(self.lower), np.abs(self.upper)).max(axis=0)
        found = {}
        for column, (name, kind) in enumerate(zip(self.names, kinds, strict=True)):
            of_kind = max(float(largest[k]) for k, other in enumerate(kinds) if other == kind)
            assumed = max(_SHARE_OF_RANGE * float(ranges[column]), _LEAST_WIDTH.get(kind, _SHARE_OF_LOAD * of_kind))
            if self.widths[:, column].max() <= _SAME * assumed:
                found[name] = assumed
        return found

    def expand(self, fraction: float, offset_factor: float, fixed_offsets: Mapping[str, float]) -> Envelopes:
        """Every frame's box, expanded on both sides (D1: fraction 0.2, offset factor 0.5; D2: 1 and 2; [EF15 §3.3]).

        By fraction·width; where the frame is narrower than the mean width over the frames, by
        offset_factor·mean width (or the assumed one); for an input with a fixed offset, by that offset in every frame.
        """
        mean = self.widths.mean(axis=0)
        for name, width in self.assumed_widths.items():
            mean[self.names.index(name)] = width
        offsets = np.where(self.widths < mean * (1.0 - _ROUNDING), offset_factor * mean, fraction * self.widths)
        for column, name in enumerate(self.names):
            if name in fixed_offsets:
                offsets[:, column] = fixed_offsets[name]
        return Envelopes(self.names, self.lower - offsets, self.upper + offsets)

    def extremes(self, fraction: float, offset_factor: float, fixed_offsets: Mapping[str, float]) -> Envelopes:
        """One box: the extremes over all frames, expanded by fraction·range on both sides (D3, [EF15 §3.3]).

        An input with the same curve in all cycles may have next to no range: it is expanded by offset_factor·assumed
        width at least, as D2 is; by its fixed offset, if it has one and never changes.
        """
        lower, upper = self.lower.min(axis=0), self.upper.max(axis=0)
        offsets = fraction * (upper - lower)
        for name, width in self.assumed_widths.items():
            column = self.names.index(name)
            if name not in fixed_offsets:
                offsets[column] = max(offsets[column], offset_factor * width)
            elif upper[column] - lower[column] <= _SAME * width:
                offsets[column] = fixed_offsets[name]
        return Envelopes(self.names, (lower - offsets)[None], (upper + offsets)[None])

    def at_least(self, widths: Mapping[str, float]) -> Envelopes:
        """The same boxes, with the inputs named in widths [mm, rad or N] widened about their middle where narrower."""
        least = np.array([widths.get(name, 0.0) for name in self.names])
        grow = 0.5 * np.maximum(least - self.widths, 0.0)
        return Envelopes(self.names, self.lower - grow, self.upper + grow)

    def without_pull(self, normals: Sequence[NormalLoad], boundary_load: float) -> Envelopes:
        """The same boxes without pulling surfaces: bounds of normal loads end at the boundary load [N] [EF15 §2.2].

        The forces of a normal load without direction stay as they are: a contact can carry each.
        """
        lower, upper = self.lower.copy(), self.upper.copy()
        for normal in normals:
            if normal.component is None or normal.loads[0] not in self.names:
                continue
            column, least = self.names.index(normal.loads[0]), normal.sign * boundary_load
            bound = np.maximum if normal.sign > 0.0 else np.minimum
            lower[:, column], upper[:, column] = bound(lower[:, column], least), bound(upper[:, column], least)
        return Envelopes(self.names, lower, upper)


@dataclass(frozen=True)
class Block:
    """Inputs (n, inputs) of one domain; role (n,).

    lifted: number of the patch at the contact boundary in D4 and D6, -1 elsewhere; each row of D4 and D5 becomes
    `liftoff_steps` samples, which share its role.
    """

    domain: int
    lifted: int
    inputs: Array
    role: np.ndarray


def plan_domains(
    envelopes: Envelopes,
    normals: Sequence[NormalLoad],
    boundary_load: float,
    settings: SamplingSettings,
    along_poses: bool = False,
) -> list[Block]:
    """The inputs of all domains, in domain order.

    normals: the normal load of each patch, in patch order; boundary_load: its size [N] at the contact boundary;
    along_poses: poses are known along the motion.
    """
    fixed = {d: {name: pair[d] for name, pair in settings.fixed_offsets.items()} for d in (0, 1)}
    if settings.reach:
        box = Envelopes(envelopes.names, *(np.array([[settings.reach[n][k] for n in envelopes.names]]) for k in (0, 1)))
    else:
        box = envelopes.extremes(settings.d3_fraction, settings.d2_offset, fixed[1])
        box = box.at_least(settings.d3_minimum_widths)
    if along_poses:
        tube = envelopes.expand(settings.d2_fraction, settings.d2_offset, fixed[1])
        loads = np.isin(envelopes.names, [normal.loads[0] for normal in normals])
        box = Envelopes(box.names, np.where(loads, box.lower, tube.lower), np.where(loads, box.upper, tube.upper))
    box = box.without_pull(normals, boundary_load)
    missing = [name for normal in normals for name in normal.loads if name not in envelopes.names]
    skipped = left_out(normals, settings)
    blocks = []
    for domain, name in enumerate(DOMAINS, start=1):
        count = _scale(name, settings)
        if not count or name in skipped:
            continue
        if domain >= 4 and missing:
            raise ValueError(f"{name} needs {', '.join(missing)} as an input, expected it there or counts.{name} = 0")
        if domain in (1, 2):
            rules = (settings.d1_fraction, settings.d1_offset), (settings.d2_fraction, settings.d2_offset)
            boxes = envelopes.expand(*rules[domain - 1], fixed[domain - 1]).without_pull(normals, boundary_load)
            parts = [(-1, _fill(boxes, [], count, None) if along_poses else _cluster(boxes, domain, count, settings))]
        elif domain == 3:
            parts = [(-1, _fill(box, [], count, None))]
        else:
            groups = [(p, [normal]) for p, normal in enumerate(normals)] if domain in (4, 6) else [(-1, [*normals])]
            parts = []
            for (lifted, held), n in zip(groups, _shares(count, len(groups)), strict=True):
                shift = _rng(settings, domain, _FILLING, max(lifted, 0)).random(len(envelopes.names))
                parts.append((lifted, _at_boundary(box, held, int(n), shift, boundary_load)))
        if settings.reach or (along_poses and domain >= 3):
            parts = [(lifted, _rooted(inputs, box, normals)) for lifted, inputs in parts]
        roles = roles_of(sum(len(inputs) for _, inputs in parts), domain, settings)
        for lifted, inputs in parts:
            blocks.append(Block(domain, lifted, inputs, roles[: len(inputs)]))
            roles = roles[len(inputs) :]
    return blocks


def hammersley(count: int, dimensions: int, shift: Array | None = None) -> Array:
    """Hammersley points (count, dimensions) in [0, 1)^d: x_i = (i/n, φ_2(i), φ_3(i), φ_5(i), ...) [EF15 §2.2].

    φ_b is the radical inverse in base b (SciPy's unscrambled Halton sequence). A shift u (dimensions,) moves every
    point to (x_i + u) mod 1, the Cranley-Patterson rotation: another set of points, as evenly spread.
    """
    from scipy.stats import qmc  # takes a second to import

    points = np.empty((count, dimensions))
    points[:, 0] = np.arange(count) / max(count, 1)
    if dimensions > 1:
        points[:, 1:] = qmc.Halton(dimensions - 1, scramble=False).random(count)
    return points if shift is None else (points + shift) % 1.0


def left_out(normals: Sequence[NormalLoad], settings: SamplingSettings) -> dict[str, str]:
    """Domains that make no sense for these patches or this plan though they are wanted, with the reason."""
    reasons = dict.fromkeys(("D1", "D2"), "the plan reach follows no motion") if settings.reach else {}
    if len(normals) == 1:
        alone = "one patch out of contact is all patches out of contact (D5, D7)"
        reasons |= dict.fromkeys(("D4", "D6"), alone)
    return {domain: reason for domain, reason in reasons.items() if settings.counts[domain]}


def _rng(settings: SamplingSettings, *stream: int) -> np.random.Generator:
    return np.random.default_rng([settings.seed, *stream])


def _scale(name: str, settings: SamplingSettings) -> int:
    """Rows of a domain's plan: its count times the scale, over liftoff_steps in D4 and D5, whose rows give as many.

    A small scale leaves at least 10 rows (or all), so that every domain can still be tested.
    """
    per_row = settings.liftoff_steps if name in ("D4", "D5") else 1
    rows = settings.counts[name] / per_row
    return max(round(rows * settings.scale), min(10, round(rows)), int(rows > 0))


def _shares(total: int, parts: int) -> np.ndarray:
    """total spread over parts as evenly as whole numbers allow."""
    return np.diff(np.arange(parts + 1) * total // parts)


def _cluster(boxes: Envelopes, domain: int, count: int, settings: SamplingSettings) -> Array:
    """D1, D2: the vertices of each frame's box and a filling, each frame with another Cranley-Patterson shift.

    At scale 1 each frame has all its vertices. A smaller plan keeps the proportion of vertices to filling, with
    vertices chosen by the seed, a larger one has more filling; filling is never less than half.
    """
    frames, k = boxes.lower.shape
    share = min(0.5, frames * 2**k / settings.counts[DOMAINS[domain - 1]])
    vertex_count = min(frames * 2**k, round(share * count))
    of_vertices = _shares(vertex_count, frames)
    of_filling = _shares(count - vertex_count, frames)
    rows = []
    for f in range(frames):
        corners = np.where(np.arange(2**k)[:, None] >> np.arange(k) & 1, boxes.upper[f], boxes.lower[f])
        chosen = _rng(settings, domain, _VERTICES, f).permutation(len(corners))[: of_vertices[f]]
        rows.append(corners[np.sort(chosen)])
        shift = np.asarray(_rng(settings, domain, _FILLING, f).random(k))
        frame = Envelopes(boxes.names, boxes.lower[f : f + 1], boxes.upper[f : f + 1])
        rows.append(_fill(frame, [], int(of_filling[f]), shift))
    return np.concatenate(rows)


def _fill(box: Envelopes, held: Sequence[str], count: int, shift: Array | None) -> Array:
    """Hammersley points in a box's inputs, of several boxes in one each; those held stay at their upper bound."""
    moving = [column for column, name in enumerate(box.names) if name not in held]
    points = hammersley(count, len(moving), None if shift is None else shift[moving])
    of = np.random.default_rng(0).permutation(count) % len(box.lower)
    lower, inputs = box.lower[of], box.upper[of]
    inputs[:, moving] = lower[:, moving] + points * (inputs - lower)[:, moving]
    return inputs


def _rooted(inputs: Array, box: Envelopes, normals: Sequence[NormalLoad]) -> Array:
    """Inputs whose directed normal loads are spread evenly in √N over their range instead of in N."""
    spread = inputs.copy()
    for normal in normals:
        if normal.component is not None and normal.loads[0] in box.names:
            column, sign = box.names.index(normal.loads[0]), normal.sign
            ends = np.sort(sign * np.array([box.lower[0, column], box.upper[0, column]]))
            spread[:, column] = sign * np.interp(sign * inputs[:, column], ends, np.sqrt(ends)) ** 2
    return spread


def _at_boundary(box: Envelopes, held: Sequence[NormalLoad], count: int, shift: Array, boundary_load: float) -> Array:
    """Hammersley points in a box's inputs, with the held normal loads at the contact boundary.

    A normal load without direction keeps the direction of its forces.
    """
    inputs = _fill(box, [n.loads[0] for n in held if n.component is not None], count, shift)
    for normal in held:
        columns = [box.names.index(name) for name in normal.loads]
        inputs[:, columns] = normal.with_size(inputs[:, columns], boundary_load)
    return inputs


def roles_of(count: int, domain: int, settings: SamplingSettings) -> np.ndarray:
    """Test rows held back from the whole domain, validation rows from what is left [EF15 §3.3, §2.6].

    Any domain of at least three rows has one of each, so that no row of an error table stays empty.
    """
    least = int(count >= 3)
    test = max(least if settings.test_fraction else 0, round(settings.test_fraction * count))
    validation = max(least if settings.validation_fraction else 0, round(settings.validation_fraction * (count - test)))
    order = _rng(settings, domain, _ROLES).permutation(count)
    role = np.full(count, TRAIN, dtype=np.uint8)
    role[order[:test]] = TEST
    role[order[test : test + validation]] = VALIDATION
    return role
