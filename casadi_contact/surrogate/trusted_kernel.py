"""A surrogate's kernel with all that it knows: loads, root loads of its patches, validity and expected error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES
from casadi_contact.networks.kernel.source import Kernel, roots_source, table
from casadi_contact.surrogate.trust import Trust
from casadi_contact.surrogate.trust_source import trust_source

_BEYOND = """\
INLINE int beyond(const double *pose) {
  for (int j = 0; j < 6; j++) {
    if (pose[j] < low[j] || pose[j] > high[j]) return 1;
  }
  return 0;
}
"""
_OUTSIDE = """\
INLINE int outside(const double *pose, const double *parts) {{
  (void)pose, (void)parts;
  return {condition};
}}
"""


@dataclass(frozen=True)
class TrustedKernel:
    """kernel: of the loads and of root_count root loads, those of each patch from first_roots on (none of either where
    networks are missing); trust, with trust_inputs in C: None for a surrogate that was not calibrated, whose loads are
    calibrated_loads.
    """

    kernel: Kernel
    loads: Sequence[str]
    calibrated_loads: Sequence[str]
    first_roots: Sequence[int]
    root_count: int
    trust: Trust | None
    trust_inputs: str

    def source(self) -> str:
        """C99 up to guarded_value and its like; patch_roots where there are roots; trust_at where there is trust."""
        parts = [self.kernel.source(loads=len(self.loads), roots=self.root_count)]
        if self.root_count:
            parts.append(f"#define PATCHES {len(self.first_roots)}")
            parts.append(roots_source(self.first_roots, self.root_count))
        if self.trust is not None:
            parts.append(
                trust_source(self.trust, self.trust_inputs, len(self.first_roots), self.calibrated_loads, self.loads)
            )
        return "\n".join(parts)

    def outside(self, pose_range: Mapping[str, Sequence[float]]) -> tuple[str, str]:
        """C function outside(pose, parts), 1 for a pose that was not learned; and in words when it is 0.

        By validity; without, by the sampled range of each pose parameter; without that, never.
        """
        bounds = np.array([pose_range.get(name, (-np.inf, np.inf)) for name in POSE_NAMES], dtype=float)
        if self.trust is not None:
            said, condition = "validity of at least 1/2", "!(trust_at(pose, parts, 0) >= 0.5)"
        elif np.isfinite(bounds).all():
            said, condition = "each pose parameter within its sampled range", "beyond(pose)"
        else:
            said, condition = "unknown: this surrogate was never calibrated", "0"
        ranges = (
            f"{table('low', bounds[:, 0])}\n{table('high', bounds[:, 1])}\n{_BEYOND}" if "beyond" in condition else ""
        )
        return ranges + _OUTSIDE.format(condition=condition), said
