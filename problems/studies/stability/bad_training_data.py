"""Row 8: training on data that break naive Levenberg-Marquardt. A fit must end with a finite network, a stated reason
and an error that tells, or refuse the data in one line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from casadi_contact.core.quantities import two_digits
from casadi_contact.networks.network import Regression
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from casadi_contact.surrogate.two_stage.surrogate import TwoStageSurrogate
from problems.studies.stability.methods import EF_ANALYTIC, METHODS, PATCH, SURROGATES, TWO_STAGE, Bench
from problems.studies.stability.table import Line
from problems.studies.stability.walking_samples import walking_samples

STRUCTURES = {PATCH: PatchSurrogate, TWO_STAGE: TwoStageSurrogate}
OUTLIER_SHARE, OUTLIER_SIZE = 0.01, 5.0  # in deviations of the targets
QUANTITY = "error on clean rows / reported, over the clean fit's; stop"


def repeated(regression: Regression) -> Regression:
    """A tenth of the rows twenty times over."""
    rows = np.arange(len(regression.targets))
    return regression.of_rows(np.concatenate([rows, np.repeat(rows[::10], 19)]))


def rank_deficient(regression: Regression) -> Regression:
    """A constant input and one that is there twice."""
    extra = np.column_stack([np.full(len(regression.targets), 3.0), regression.inputs[:, 0]])
    return replace(regression, inputs=np.column_stack([regression.inputs, extra]))


def few_rows(regression: Regression) -> Regression:
    """Fewer rows than weights."""
    return regression.of_rows(np.arange(100))


def constant_output(regression: Regression) -> Regression:
    """The same target everywhere."""
    return replace(regression, targets=np.full_like(regression.targets, regression.targets[0]))


def outliers(regression: Regression) -> Regression:
    """One training target in a hundred off by five deviations."""
    rng = np.random.default_rng(4)
    hit = (rng.random(len(regression.targets)) < OUTLIER_SHARE) & ~regression.validation
    off = OUTLIER_SIZE * regression.targets.std() * rng.choice([-1.0, 1.0], len(hit))
    return replace(regression, targets=regression.targets + np.where(hit, off, 0.0))


def not_a_number(regression: Regression) -> Regression:
    """One target is NaN."""
    targets = regression.targets.copy()
    targets[7] = np.nan
    return replace(regression, targets=targets)


CASES: dict[str, Callable[[Regression], Regression]] = {
    "repeated samples": repeated,
    "rank-deficient JᵀJ (constant and doubled inputs)": rank_deficient,
    "rank-deficient JᵀJ (100 rows)": few_rows,
    "constant output": constant_output,
    "1 % outliers": outliers,
    "a NaN": not_a_number,
}


def outcome(regression: Regression, clean: Regression, settings: TrainingSettings) -> tuple[float, float, str]:
    """RMS weighted error on the clean rows, the larger RMS of training and validation rows that the fit itself
    reports, and why it stopped; a refusal is NaN and the message."""
    try:
        result = fit(regression, settings)
    except ValueError as error:
        return np.nan, np.nan, f"refused: {error}"
    inputs = clean.inputs if clean.inputs.shape[1] == regression.inputs.shape[1] else regression.inputs
    weighted = clean.weights * (result.network.value(inputs) - clean.targets)
    return float(np.sqrt(np.mean(weighted**2))), max(result.rms, result.validation_rms), result.stop_reason


def measure(bench: Bench, count: int = 1500, iterations: int = 150) -> tuple[list[Line], None]:
    """Lines of row 8, for the first network of both structures."""
    samples = walking_samples(bench.models[EF_ANALYTIC], bench.poses, count, seed=5)
    settings = TrainingSettings(sizes=((12, 12),), max_iterations=iterations, restarts=0)
    untrained = {m: "is not trained" for m in METHODS if m not in SURROGATES}
    cells: dict[str, dict[str, float | str]] = {case: {} for case in ("clean", *CASES)}
    for method, structure in STRUCTURES.items():
        clean = structure.regressions(samples)[0]
        usual, said, stop = outcome(clean, clean, settings)
        cells["clean"][method] = f"{two_digits(usual)} N / {two_digits(said)} N; {stop}"
        for case, spoil in CASES.items():
            truth = constant_output(clean) if case == "constant output" else clean
            error, said, stop = outcome(spoil(clean), truth, settings)
            known = f"{two_digits(error / usual)} / {two_digits(said / usual)}; " if np.isfinite(error) else ""
            cells[case][method] = known + stop
    quantities = {"clean": "error on clean rows / reported; stop"}
    return [Line(8, case, quantities.get(case, QUANTITY), row, untrained) for case, row in cells.items()], None
