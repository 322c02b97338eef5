"""A surrogate's validity and expected error as C (``trust.h``)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.networks.kernel.networks import filled_up
from casadi_contact.networks.kernel.source import c_text, table
from casadi_contact.scenes.pose_space import OFF_SPACE
from casadi_contact.surrogate.cubic_logistic import cubic_terms
from casadi_contact.surrogate.distrust import STEEPNESS
from casadi_contact.surrogate.error_classifier import LAYERS
from casadi_contact.surrogate.error_classifier import STEEPNESS as CLASSIFIER_STEEPNESS
from casadi_contact.surrogate.trust import Trust

# Root loads come from those of the kernel, and nothing else claims contact.
OWN_ROOTS = """\
INLINE void trust_inputs(const double *pose, const double *parts, double *roots, double *claims) {
  (void)pose, (void)claims;
  patch_roots(first_part, parts, roots, 0);
}
"""


def trust_source(trust: Trust, inputs: str, patches: int, load_names: Sequence[str], loads: Sequence[str]) -> str:
    """C function trust_at(pose, parts, errors) -> validity, for a kernel of `loads`.

    inputs: defines trust_inputs(pose, parts, roots, claims), that is the root loads [-] and claimed normal loads [N]
    of the patches from the pose and the kernel's root loads. load_names: those of the trust; a load without has NaN.
    Raises ValueError for numbers of other shapes than so many patches and loads have: C would read beyond them.
    """
    _check_shapes(trust, patches, len(load_names))
    known = [load_names.index(load) if load in load_names else None for load in loads]
    return "\n".join(
        [
            *(f"#define {name} ({value!r})" for name, value in _counts(trust).items()),
            *(f"#define {name} ({float(value)!r})" for name, value in _numbers(trust).items()),
            *(table(name, np.asarray(values)) for name, values in _tables(trust, known).items()),
            inputs,
            c_text("trust.h", __package__),
        ]
    )


def _counts(trust: Trust) -> dict[str, int]:
    """Sizes of arrays, 0 where a part is missing."""
    box, border, states, classifier = trust.box, trust.border, trust.states, trust.classifier
    return {
        "CENTRES": len(trust.centres),
        "DENSE": len(trust.dense_centres),
        "BOX": 0 if box is None else len(box.columns),
        "BOUND": 0 if trust.off_space is None else len(trust.off_space.columns),
        "BORDER": 0 if border is None else len(border.scale),
        "CLASSIFIER": 0 if classifier is None else len(classifier.shift),
        "CONFIRMATION": int(trust.confirmation is not None),
        "STATES": 0 if states is None else len(states.centres),
        "STATE_SIZE": 0 if states is None else states.centres.shape[1],
    }


def _numbers(trust: Trust) -> dict[str, float]:
    """Constants of the formulas."""
    numbers = {
        "BANDWIDTH": trust.bandwidth,
        "SHARPNESS": trust.sharpness,
        "EDGE": trust.edge,
        "DENSE_BANDWIDTH": trust.dense_bandwidth,
        "DENSE_START": trust.dense_start,
        "BOUNDARY_ROOT": trust.boundary_root,
        "LIGHT_SQUARE": trust.light_square,
        "OFF_SPACE": OFF_SPACE,
        "STEEPNESS": STEEPNESS,
        "GROWTH_START": trust.growth_start or 0.0,
    }
    if trust.states is not None:
        numbers["STATES_BANDWIDTH"] = trust.states.bandwidth
    if trust.classifier is not None:
        numbers |= {"CLASSIFIER_STEEPNESS": CLASSIFIER_STEEPNESS, "CLASSIFIER_HALF": trust.classifier.half}
    return numbers


def _tables(trust: Trust, known: Sequence[int | None]) -> dict[str, np.ndarray]:
    """Arrays; those of loads have the rows that are known, NaN for the others (None)."""

    def picked(rows: Array) -> Array:
        return np.stack([np.broadcast_to(np.nan, rows.shape[1:]) if k is None else rows[k] for k in known])

    tables: dict[str, np.ndarray] = {
        "trust_scales": trust.scales,
        "centres": _by_coordinate(trust.centres),
        "dense_centres": _by_coordinate(trust.dense_centres),
        "trust_levels": filled_up(picked(trust.levels.T)),
        "trust_shares": picked(trust.all_shares),
        "growth_loads": picked(trust.growth_loads),
        **{name: getattr(trust, name) for name in ("root_low", "root_high", "margin_low", "margin_high")},
    }
    parts = {"box": trust.box, "bound": trust.off_space, "border": trust.border, "confirmation": trust.confirmation}
    for name, part in parts.items():
        if part is not None:
            kinds = {"columns": int}
            tables |= {f"{name}_{key}": np.asarray(value, kinds.get(key, float)) for key, value in vars(part).items()}
    if (states := trust.states) is not None:
        tables |= {
            "states_columns": np.asarray(states.columns, int),
            "states_scale": states.scale,
            "states_root_scale": states.root_scale,
            "states_centres": _by_coordinate(states.centres),
        }
    if trust.classifier is not None:
        tables["classifier_columns"] = np.asarray(trust.classifier.columns, int)
    return tables


def _check_shapes(trust: Trust, patches: int, loads: int) -> None:
    centres, box = len(trust.centres), 0 if trust.box is None else np.size(trust.box.columns)
    border = 0 if trust.border is None else np.size(trust.border.columns)
    states = 0 if trust.states is None else np.size(trust.states.columns)
    levels = centres if trust.states is None else len(trust.states.centres)
    answering = 0 if trust.classifier is None else np.size(trust.classifier.shift)
    hidden = [] if trust.classifier is None else [f"biases_{layer}" for layer in range(LAYERS)]
    layers = [np.size(getattr(trust.classifier, name)) for name in hidden]
    widths = [answering, *layers][: len(layers)]
    terms = 0 if trust.border is None else cubic_terms(np.zeros((1, border + patches))).shape[1]
    expected: dict[str, tuple[int, ...]] = {
        "scales": (6,),
        "centres": (centres, 6),
        "dense_centres": (len(trust.dense_centres), 6),
        "levels": (levels, loads),
        "shares": (loads, 3 + patches),
        "usual_loads": (loads,),
        **dict.fromkeys(("growth", "light_shares"), (loads,)),
        **dict.fromkeys(("root_low", "root_high", "margin_low", "margin_high"), (patches,)),
        **dict.fromkeys(("box/columns", "box/low", "box/high", "box/margin"), (box,)),
        **{"border/columns": (border,), "border/coefficients": (terms,)},
        **dict.fromkeys(("border/centre", "border/scale"), (border + patches,)),
        **dict.fromkeys(("states/columns", "states/scale"), (states,)),
        **{"states/root_scale": (patches,), "states/centres": (levels, states + patches)},
        "classifier/columns": (answering - patches,),
        **dict.fromkeys(("classifier/shift", "classifier/scale"), (answering,)),
        **{f"classifier/biases_{layer}": (count,) for layer, count in enumerate(layers)},
        **{f"classifier/weights_{k}": pair for k, pair in enumerate(zip(layers, widths, strict=True))},
        **dict.fromkeys(("confirmation/tolerance", "confirmation/root", "confirmation/width"), (patches,)),
    }
    for name, numbers in trust.numbers().items():
        if np.shape(numbers) != expected.get(name, ()):
            raise ValueError(
                f"trust: {name} has shape {np.shape(numbers)}, expected {expected.get(name, ())} for {patches} patches "
                f"and {loads} loads: build or calibrate the surrogate again"
            )


def _by_coordinate(centres: Array) -> Array:
    return filled_up(np.asarray(centres).T)
