"""What a surrogate is fit for, by its errors on held-back samples and the rule of `verify`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from casadi_contact.quantities import beside, of_kind, quantity
from casadi_contact.structures import Surrogate


@dataclass(frozen=True)
class Fitness:
    """RMS errors by domain and load [N, N·mm], and the scene's tolerances by load; its text is the verdict."""

    errors: Mapping[str, Mapping[str, float]]
    tolerances: Mapping[str, float]

    def failing(self, domain: str) -> list[str]:
        """Loads whose RMS error in a domain is above the tolerance: `verify` would not pass its samples."""
        return [load for load, rms in self.errors[domain].items() if rms > self.tolerances[load]]

    @property
    def fit(self) -> list[str]:
        """Domains in which every load is within its tolerance."""
        return [domain for domain in self.errors if not self.failing(domain)]

    def __str__(self) -> str:
        if not self.errors:
            return "not judged: the file records no errors on held-back samples"
        unfit = [domain for domain in self.errors if domain not in self.fit]
        reasons = "; ".join(f"{domain}: {self._reason(domain)}" for domain in unfit)
        if not self.fit:
            return f"not fit for use: {reasons}"
        text = f"fit for use within {self._within()} (RMS of held-back samples) in {', '.join(self.fit)}"
        return f"{text}; not in {reasons}" if unfit else text

    def _within(self) -> str:
        """The largest RMS error of each kind of load in the fit domains: 0.94 N and 27 N·mm."""
        kinds = dict.fromkeys(quantity(load).kind for load in self.tolerances)
        parts = []
        for kind in kinds:
            loads = of_kind(list(self.tolerances), kind)
            worst = max(self.errors[domain].get(load, 0.0) for domain in self.fit for load in loads)
            parts.append(f"{worst:.2g} {kind.unit}")
        return " and ".join(parts)

    def _reason(self, domain: str) -> str:
        """The load that is most above its tolerance."""
        rms = self.errors[domain]
        load = max(self.failing(domain), key=lambda name: rms[name] / self.tolerances[name])
        off, tolerance = beside(rms[load], self.tolerances[load]), self.tolerances[load]
        return f"{load} is off by {off} {quantity(load).unit}, tolerance {tolerance:g}"


def fitness(surrogate: Surrogate) -> Fitness:
    """Judge a surrogate by the errors that its file records (`SurrogateInfo.test_errors`)."""
    recorded = surrogate.info().test_errors
    errors = {domain: {load: row["rms"] for load, row in loads.items()} for domain, loads in recorded.items()}
    return Fitness(errors, {load: surrogate.scene.tolerances[load] for load in surrogate.load_names})
