"""What a surrogate is fit for, by its errors on held-back samples and the rule of `verify`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from casadi_contact.core.quantities import format_above_limit, of_kind, quantity, two_digits
from casadi_contact.surrogate.base import Surrogate

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


def fitness(surrogate: Surrogate) -> Fitness:
    """Judge a surrogate by the errors that its file records (`SurrogateInfo.test_errors`)."""
    errors = {
        domain: {load: row["rms"] for load, row in loads.items() if load in surrogate.load_names}
        for domain, loads in surrogate.info().test_errors.items()
    }
    return Fitness(
        errors,
        {load: surrogate.scene.tolerances[load] for load in surrogate.load_names},
        surrogate.record.get("dropped", {}),
        surrogate.record.get("test_samples", {}),
    )
