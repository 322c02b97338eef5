"""C functions of a two_stage surrogate (the formulas of `structures.two_stage.graph`; the code is ``two_stage.h``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from casadi_contact.networks.kernel.networks import Bundle
from casadi_contact.networks.kernel.source import Kernel, c_text, table
from casadi_contact.networks.network import Network
from casadi_contact.surrogate.patch.networks import PatchNetworks


def two_stage_kernel(
    first: Mapping[str, Network],
    second: Mapping[str, Network],
    load_names: Sequence[str],
    reference_load: float,
    smoothing_load: float,
) -> Kernel:
    """Kernel of loads, and of the root load of every first-stage force.

    first and second hold the networks of the two stages by load, first in the order of the second stage's inputs.
    """
    learned = [name for name in load_names if name not in first]
    inputs = 6 + len(first)

    def places(name: str, entries: Sequence[int]) -> str:
        return f"static const int {name}[] = {{{', '.join(map(str, [*entries, -1]))}}};"

    definitions = [
        f"#define FORCES {len(first)}",
        f"#define INPUTS {inputs}",
        f"#define OUTPUTS {len(learned)}",
        f"#define REFERENCE_LOAD {float(reference_load)!r}",
        f"#define ROUNDING {(smoothing_load / reference_load) ** 2!r}",
        "/* Which load each force and each output of the second stage is; -1 for none. */",
        places("LOAD_OF_FORCE", [load_names.index(name) if name in load_names else -1 for name in first]),
        places("LOAD_OF_OUTPUT", [load_names.index(name) for name in learned]),
    ]
    bundles = [Bundle("first", 6, first), Bundle("second", inputs, {name: second[name] for name in learned})]
    return Kernel(bundles, "\n".join([*definitions, "", c_text("two_stage.h", __package__)]))


def confirming_inputs(parts: Sequence[PatchNetworks], first_parts: Sequence[int]) -> tuple[list[Bundle], str]:
    """Networks and C function trust_inputs: the parts' root loads, which must confirm what the first stage claims."""
    bundles = [Bundle(f"confirming_{k}", 6, {f"root {part.name}": part.root}) for k, part in enumerate(parts)]
    anchors = table("confirming_anchor", np.array([part.anchor_mm for part in parts]))
    first = table("first_confirming", np.array([*first_parts, len(parts)]))
    roots = "\n".join(
        f"  local = local_of(pose, &frame, confirming_anchor[{k}][0], confirming_anchor[{k}][1], "
        f"confirming_anchor[{k}][2], 0);\n  confirming_{k}_value(local.x, s + {k});"
        for k in range(len(parts))
    )
    return (
        bundles,
        f"""\
{c_text("pose.h")}
{anchors}
{first}
INLINE void trust_inputs(const double *pose, const double *parts, double *roots, double *claims) {{
  const Frame frame = frame_of(pose);
  double s[{len(parts)}], raw[FORCES];
  Local local;
{roots}
  patch_roots(first_confirming, s, roots, 0);
  first_value(pose, raw);
  for (int p = 0; p < FORCES; p++) claims[p] = -raw[p];
  (void)parts;
}}
""",
    )
