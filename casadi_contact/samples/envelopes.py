"""Reference envelopes: bounds of each input at each time frame, and their expansions [EF15 §2.2, §3.3].

Expansions are multiples of the envelope's width. An input with the same curve in all cycles has no width (a single
cycle: no input has). Its assumed width is a tenth of the curve's range over the frames, at least 1 mm, 0.04 rad (2.3°)
or 5 % of the largest load of its kind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import Array
from casadi_contact.core.quantities import ANGLE, LENGTH, quantity
from casadi_contact.scenes.normal_load import NormalLoad

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
        """Bounds over the cycles of curves (cycles, frames, inputs); raises ValueError for another shape or NaN."""
        array = np.asarray(curves, dtype=float)
        if array.ndim != 3 or array.shape[2] != len(names) or 0 in array.shape:
            raise ValueError(f"curves has shape {array.shape}, expected (cycles, frames, {len(names)})")
        if not np.isfinite(array).all():
            raise ValueError("curves holds NaN or infinity, expected finite numbers")
        return cls(tuple(names), array.min(axis=0), array.max(axis=0))

    @property
    def widths(self) -> Array:
        """upper - lower (frames, inputs)."""
        return self.upper - self.lower

    @property
    def assumed_widths(self) -> dict[str, float]:
        """Assumed widths [mm, rad, N or N·mm] of inputs with the same curve in all cycles, see above; 0 where
        all loads of the kind are zero."""
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
        lower, upper = self.lower.copy(), self.upper.copy()
        for column, name in enumerate(self.names):
            grow = np.maximum(widths.get(name, 0.0) - self.widths[:, column], 0.0)
            lower[:, column] -= 0.5 * grow
            upper[:, column] += 0.5 * grow
        return Envelopes(self.names, lower, upper)

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
