"""A surrogate's kernel: loads, root loads of its patches, validity and expected error (``confidence.h``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES
from casadi_contact.networks.kernel.networks import filled_up
from casadi_contact.networks.kernel.source import Kernel, c_text, roots_source, table
from casadi_contact.surrogate.confidence import SURE, Confidence

# Of most structures: the root loads of the kernel.
OWN_ROOTS = """\
INLINE void confidence_roots(const double *pose, const double *parts, double *roots) {
  (void)pose;
  patch_roots(first_part, parts, roots, 0);
}
"""
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
class SurrogateKernel:
    """kernel: of the loads and of root_count root loads, those of each patch from first_roots on (none of either where
    networks are missing); confidence: None for a surrogate that was not calibrated, whose loads are calibrated_loads;
    confidence_roots: C function that gives the root loads of the patches from the pose and the kernel's root loads.
    """

    kernel: Kernel
    loads: Sequence[str]
    calibrated_loads: Sequence[str]
    first_roots: Sequence[int]
    root_count: int
    confidence: Confidence | None
    confidence_roots: str

    def source(self) -> str:
        """C99 up to guarded_value and its like; patch_roots where there are roots; confidence_at where it was
        calibrated."""
        parts = [self.kernel.source(loads=len(self.loads), roots=self.root_count)]
        if self.root_count:
            parts.append(f"#define PATCHES {len(self.first_roots)}")
            parts.append(roots_source(self.first_roots, self.root_count))
        if self.confidence is not None:
            parts.append(self._confidence_source(self.confidence))
        return "\n".join(parts)

    def _confidence_source(self, confidence: Confidence) -> str:
        """C function confidence_at(pose, parts, errors) -> validity. Raises ValueError for arrays of other shapes than
        the patches and loads have."""
        known = self.calibrated_loads
        confidence.check_shapes(len(self.first_roots), len(known))
        counts = {
            "CENTRES": len(confidence.centres),
            "CONFIDENCE_COLUMNS": len(confidence.columns),
            "CALIBRATED": len(known),
        }
        numbers = {
            "BANDWIDTH": confidence.bandwidth,
            "SHARPNESS": confidence.sharpness,
            "EDGE": confidence.edge,
            "SURE": SURE,
        }
        tables = {
            "whitening": confidence.whitening,
            "centres": filled_up(confidence.centres.T),
            "confidence_columns": confidence.columns.astype(int),
            "calibrated_load": np.array([known.index(load) if load in known else -1 for load in self.loads]),
            "growth": confidence.growth,
        }
        return "\n".join(
            [
                *(f"#define {name} {value}" for name, value in counts.items()),
                *(f"#define {name} ({float(value)!r})" for name, value in numbers.items()),
                *(table(name, np.asarray(values)) for name, values in tables.items()),
                self.confidence_roots,
                c_text("confidence.h", __package__),
            ]
        )

    def outside(self, pose_range: Mapping[str, Sequence[float]]) -> tuple[str, str]:
        """C function outside(pose, parts), 1 for a pose that was not learned; and in words when it is 0.

        By validity; without, by the sampled range of each pose parameter; without that, never.
        """
        bounds = np.array([pose_range.get(name, (-np.inf, np.inf)) for name in POSE_NAMES], dtype=float)
        if self.confidence is not None:
            meaning, condition = "validity of at least 1/2", "!(confidence_at(pose, parts, 0) >= 0.5)"
        elif np.isfinite(bounds).all():
            meaning, condition = "each pose parameter within its sampled range", "beyond(pose)"
        else:
            meaning, condition = "unknown: this surrogate was never calibrated", "0"
        ranges = (
            f"{table('low', bounds[:, 0])}\n{table('high', bounds[:, 1])}\n{_BEYOND}" if "beyond" in condition else ""
        )
        return ranges + _OUTSIDE.format(condition=condition), meaning
