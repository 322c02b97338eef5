"""What a surrogate says about itself, and what it is fit for, by errors on held-back samples and `verify`'s rule.

The record is plain JSON in the surrogate's file. These keys are printed as tables, all others as they are:

    samples          {"D1": 21600, ...}                             samples trained on, per domain
    drawn_from       "finite-elements"                              the contact model of the samples (`samples.models`)
    dropped          {"D2": 0.4, ...}                               share of a domain's plan that became no samples
    pose_range       {"tx": [-6.8, 11.0], ...}                      sampled range of the poses [mm, rad]
    load_range       {"Fy_med": [-1900.0, 0.0], ...}                and of the loads [N, N·mm]
    valid_share      0.98                                           share of held-back samples with validity above 0.9
    training_errors  {"root_med": 0.6, ...}                         RMS of each network's fit [N or N·mm]
    test_errors      {"D1": {"Fy_med": {"rms": 0.5, "max": 3.0}}}   held-back samples, per domain and load [N, N·mm]
    test_samples     {"D1": 900, ...}                               how many those held-back samples are
    coverage         {"D1": {"valid": 1.0, "Fy_med": 0.95}}         held-back samples, and other poses: share with
                                                                    validity above 0.9, and of errors below the
                                                                    expected error (see `calibration`)
    model_errors     {"Fy": 0.9, ...}                               RMS of the contact model's own loads, which no error
                                                                    above includes; model_errors_against: "EF 320×320"
    stop_reasons     {"root_med": "stalled", ...}                   why each fit ended (see `training.settings`)
    gflop, seconds   {"root_med": 1000.0, ...}                      its work [10⁹ operations] and its CPU time [s]
    active           [33000, 34000]                                 samples that each active round added (see `active`)
    convergence      {"root_med": {"gflop": [...], "rms": [...]}}   how its fit fell with the work done; drawn by report
    command, versions, seed, ...                                    how it was made
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from casadi_contact.core.quantities import ANGLE, format_above_limit, of_kind, quantity, three_digits, two_digits
from casadi_contact.networks.network import Network, size_text
from casadi_contact.scenes.scene import Scene

_TABLES = (
    "samples", "dropped", "pose_range", "load_range", "valid_share", "training_errors", "test_errors", "test_samples",
    "coverage", "model_errors", "model_errors_against", "convergence",
)  # fmt: skip
_COVERAGE_ROWS = {  # see `calibration.coverage_by_group`
    "around": "poses of validity above 0.5, perturbed from the samples",
    "range": "poses of validity above 0.5, drawn evenly over the sampled ranges",
    "settled": "poses of validity above 0.5 at which the static solver ends on the surrogate, at a rim too",
    "dropped": "poses of validity above 0.5 that a plan asked for and that became no samples",
    "cycles": "poses of validity above 0.5 of cycles that were never drawn around, found on the surrogate",
}


@dataclass(frozen=True)
class SurrogateInfo:
    """Structure, scene, networks, samples and errors of a surrogate; ``print`` it."""

    structure: str
    scene: Scene
    loads: tuple[str, ...]
    networks: Mapping[str, Network]
    record: Mapping[str, Any]

    @property
    def fitness(self) -> Fitness:
        """The verdict by the errors that the file records."""
        errors = {
            domain: {load: row["rms"] for load, row in loads.items() if load in self.loads}
            for domain, loads in self.test_errors.items()
        }
        tolerances = {load: self.scene.tolerances[load] for load in self.loads}
        return Fitness(errors, tolerances, self.record.get("dropped", {}), self.record.get("test_samples", {}))

    @property
    def samples(self) -> Mapping[str, int]:
        """Samples trained on, per domain."""
        return self.record.get("samples", {})

    @property
    def reach(self) -> list[tuple[str, float, float, str]]:
        """Sampled range of each pose parameter and load: name, low, high, unit (mm, °, N, N·mm)."""
        rows = []
        for name, (low, high) in (self.record.get("pose_range", {}) | self.record.get("load_range", {})).items():
            angle = quantity(name).kind == ANGLE
            low, high = (math.degrees(low), math.degrees(high)) if angle else (low, high)
            rows.append((name, low, high, "°" if angle else quantity(name).unit))
        return rows

    @property
    def test_errors(self) -> Mapping[str, Mapping[str, Mapping[str, float]]]:
        """Per domain and load: ``rms`` and ``max`` on held-back samples, N or N·mm."""
        return self.record.get("test_errors", {})

    @property
    def coverage(self) -> Mapping[str, Mapping[str, float]]:
        """Per domain: share of held-back samples inside the learned region ("valid") and, per load, of errors below
        the expected error; empty for a surrogate that was not calibrated."""
        return self.record.get("coverage", {})

    def __str__(self) -> str:
        parameters = sum(network.parameter_count for network in self.networks.values())
        lines = [
            f"{self.structure} surrogate of scene {self.scene.name} ({self.scene.digest[:12]})",
            f"loads: {', '.join(quantity(load).label for load in self.loads)}",
            f"networks: {len(self.networks)}, {parameters} parameters",
        ]
        for name, network in self.networks.items():
            error = self.record.get("training_errors", {}).get(name)
            fit = "" if error is None else f"  fit {three_digits(error)}"
            lines.append(f"  {name:<16} {size_text(network.hidden):<12} {network.activation}{fit}")
        if self.samples:
            counts = ", ".join(f"{domain} {count}" for domain, count in self.samples.items())
            lines.append(f"trained on {sum(self.samples.values())} samples: {counts}")
        else:
            lines.append("trained on: not recorded")
        if lost := [
            f"{domain} {100.0 * share:.1f} %" for domain, share in self.record.get("dropped", {}).items() if share
        ]:
            lines.append(f"dropped, of the plan: {', '.join(lost)}")
        lines += filter(None, [budget_line(self.record)])
        lines += [*self._reach_lines(), *self._test_lines(), *self._coverage_lines()]
        lines += filter(None, [model_line(self.record)])
        lines += [f"{key}: {value}" for key, value in self.record.items() if key not in _TABLES]
        return "\n".join(lines)

    def _reach_lines(self) -> list[str]:
        if not self.reach:
            return ["reach: not recorded"]
        lines = [f"  {name:<7}{low:10.4g} to {high:.4g} {unit}" for name, low, high, unit in self.reach]
        share = self.record.get("valid_share")
        said = "" if share is None else f", {100.0 * share:.1f} % of its held-back poses called valid (above 0.9)"
        return [f"reach (sampled){said}:", *lines]

    def _test_lines(self) -> list[str]:
        if not self.test_errors:
            return ["test errors: not recorded"]

        def cell(errors: Mapping[str, float] | None) -> str:
            return "-" if errors is None else f"{three_digits(errors['rms'])} / {three_digits(errors['max'])}"

        loads = list(next(iter(self.test_errors.values())))
        rows = {domain: [cell(row.get(load)) for load in loads] for domain, row in self.test_errors.items()}
        rows["allowed"] = [f"{self.scene.tolerances[load]:g}" for load in loads]
        return ["test errors, RMS / max, and the RMS that was allowed:", *_table(loads, rows, 20)]

    def _coverage_lines(self) -> list[str]:
        if not self.coverage:
            return ["validity and expected error: not calibrated"]
        columns = ("valid", *self.loads)
        rows = {
            domain: [f"{100.0 * shares[c]:.0f}" if c in shares else "-" for c in columns]
            for domain, shares in self.coverage.items()
        }
        said = "held-back samples with validity above 0.9, errors below the expected error [%]:"
        others = (f"  {name}: {which}" for name, which in _COVERAGE_ROWS.items() if name in self.coverage)
        return [said, *_table(columns, rows, 8), *others]


def _table(columns: Sequence[str], rows: Mapping[str, Sequence[str]], least: int) -> list[str]:
    """A line for each row, columns of at least so many letters."""
    widths = [max(least, len(column) + 2) for column in columns]
    return [
        f"  {name:<7}" + "".join(f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True))
        for name, cells in {"domain": columns, **rows}.items()
    ]


def model_line(record: Mapping[str, Any]) -> str:
    """How far the contact model that samples were drawn with is itself off; empty where nobody measured it."""
    errors = record.get("model_errors", {})
    if not errors:
        return ""
    said = ", ".join(f"{load} {three_digits(error)}" for load, error in errors.items())
    finer = record.get("model_errors_against", "a finer one")
    return f"these errors are against the contact model, which is itself off by (RMS against {finer}): {said}"


def budget_line(record: Mapping[str, Any]) -> str:
    """Which fits ended because their budget was used up and not because they were done; empty if none did."""
    from casadi_contact.networks.training.settings import LIMITS

    reasons = record.get("stop_reasons", {})
    ended = [name for name, reason in reasons.items() if reason in LIMITS]
    if not ended:
        return ""
    return f"budget used up in {len(ended)} of {len(reasons)} fits, more may fit better: {', '.join(ended)}"


_MOST_DROPPED = 0.3  # share of a domain's plan, as in `SamplingSettings`
_FEW = 50  # samples: the RMS error of 30 was 51 N·mm where that of 4,000 was 88


@dataclass(frozen=True)
class Fitness:
    """RMS errors by domain and load [N, N·mm], the scene's tolerances by load, the share of each domain's plan that was
    dropped, and how many samples were held back of each; its text is the verdict, which names shares that a build
    refuses unless the scene allows them, and fit domains of which few samples tell the error."""

    errors: Mapping[str, Mapping[str, float]]
    tolerances: Mapping[str, float]
    dropped: Mapping[str, float] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)

    def failing(self, domain: str) -> list[str]:
        """Loads whose RMS error in a domain is above the tolerance: `verify` would not pass its samples."""
        return [load for load, rms in self.errors[domain].items() if not rms <= self.tolerances[load]]

    @property
    def fit(self) -> list[str]:
        """Domains in which every load is within its tolerance."""
        return [domain for domain in self.errors if not self.failing(domain)]

    @property
    def usable(self) -> bool:
        """Whether all domains are fit, or one besides D5, where nothing touches."""
        return bool(self.errors) and (self.fit == list(self.errors) or bool(set(self.fit) - {"D5"}))

    def __str__(self) -> str:
        if not self.errors:
            return "not judged: the file records no errors on held-back samples"
        unfit = [domain for domain in self.errors if domain not in self.fit]
        reasons = "; ".join(f"{domain}: {self._reason(domain)}" for domain in unfit)
        if not self.usable:
            return f"not fit for use: {reasons}"
        text = f"fit for use within {self._within()} (RMS of held-back samples) in {', '.join(self.fit)}"
        text += f"; not in {reasons}" if unfit else ""
        lost = [
            f"{domain} {100.0 * share:.0f} %"
            for domain, share in self.dropped.items()
            if share > _MOST_DROPPED and domain not in unfit
        ]
        text += f"; dropped and not judged: of {', of '.join(lost)}" if lost else ""
        few = [f"{self.counts[domain]} of {domain}" for domain in self.fit if self.counts.get(domain, _FEW) < _FEW]
        return f"{text}; judged by few samples: {', '.join(few)}" if few else text

    def _within(self) -> str:
        """The largest RMS error of each kind of load in the fit domains: 0.94 N and 27 N·mm."""
        kinds = dict.fromkeys(quantity(load).kind for load in self.tolerances)
        parts = []
        for kind in kinds:
            loads = of_kind(list(self.tolerances), kind)
            worst = max(self.errors[domain].get(load, 0.0) for domain in self.fit for load in loads)
            parts.append(f"{two_digits(worst)} {kind.unit}")
        return " and ".join(parts)

    def _reason(self, domain: str) -> str:
        """The load that is most above its tolerance."""
        rms = self.errors[domain]
        load = max(self.failing(domain), key=lambda name: rms[name] / self.tolerances[name])
        off, tolerance = format_above_limit(rms[load], self.tolerances[load]), self.tolerances[load]
        return f"{load} is off by {off} {quantity(load).unit}, tolerance {tolerance:g}"
