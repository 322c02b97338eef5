"""A surrogate's kernel with all that it knows: loads, root loads of its patches, validity and expected error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from casadi_contact.structures.trust import Trust
from casadi_contact.structures.trust_source import roots_source, trust_source
from casadi_contact.transcription.kernel.source import Kernel


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
            parts.append(roots_source(self.first_roots, self.root_count))
        if self.trust is not None:
            parts.append(trust_source(self.trust, self.trust_inputs, self.calibrated_loads, self.loads))
        return "\n".join(parts)
