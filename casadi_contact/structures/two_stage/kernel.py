"""C functions of a two_stage surrogate (the formulas of `structures.two_stage.graph`; the code is ``two_stage.h``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from casadi_contact.network import Network
from casadi_contact.transcription.kernel.networks import Bundle
from casadi_contact.transcription.kernel.source import Kernel, c_text


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

    def table(name: str, entries: Sequence[int]) -> str:
        return f"static const int {name}[] = {{{', '.join(map(str, [*entries, -1]))}}};"

    definitions = [
        f"#define FORCES {len(first)}",
        f"#define INPUTS {inputs}",
        f"#define OUTPUTS {len(learned)}",
        f"#define REFERENCE_LOAD {float(reference_load)!r}",
        f"#define ROUNDING {(smoothing_load / reference_load) ** 2!r}",
        "/* Which load each force and each output of the second stage is; -1 for none. */",
        table("LOAD_OF_FORCE", [load_names.index(name) if name in load_names else -1 for name in first]),
        table("LOAD_OF_OUTPUT", [load_names.index(name) for name in learned]),
    ]
    bundles = [Bundle("first", 6, first), Bundle("second", inputs, {name: second[name] for name in learned})]
    return Kernel(bundles, "\n".join([*definitions, "", c_text("two_stage.h", __package__)]))
