"""Our Levenberg-Marquardt beside what one would take instead: the same network, rows, start, loss and CPU seconds.

Run ``python -m problems.studies.optimisers results/knee-quick/samples.h5`` after ``casadi-contact sample knee``. The
network gives the root load of the first side in contact, the loss is the mean of its squared errors [N²]. SciPy and
PyTorch get exact derivatives by PyTorch, in double precision.
"""

import json
import time
from contextlib import suppress
from dataclasses import replace
from math import cos, inf, pi
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.optimize import least_squares

from casadi_contact.core.conventions import Array
from casadi_contact.core.files.writing import writable_folder, write_text
from casadi_contact.core.machine import machine_record
from casadi_contact.core.terminal import run_program
from casadi_contact.core.workers import one_thread
from casadi_contact.networks.activations import activation_of
from casadi_contact.networks.network import Network, Regression, size_text
from casadi_contact.networks.training.fit import fit
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.networks.training.weights import flatten, initial_network, layer_shapes, split, unflatten
from casadi_contact.samples.samples import either_side, read_samples
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate


class Loss:
    """Mean squared error of training rows as PyTorch's function of the weights, and the best weights so far."""

    def __init__(self, rows: Regression, start: Network, seconds: float) -> None:
        scaled = (rows.inputs - start.input_shift) / start.input_scale
        self.rows = [torch.tensor(column) for column in (scaled, rows.targets, rows.weights)]
        self.shapes, self.scale = layer_shapes(scaled.shape[1], start.hidden), float(start.output_scale)
        self.sigma, self.best, self.least = activation_of(start.activation).derivatives, flatten(start), inf
        began = time.process_time()
        self.share_of_time = lambda: (time.process_time() - began) / seconds

    def output(self, weights: Any, inputs: Any) -> Any:
        """The network's output (n,) for scaled inputs (n, k)."""
        *hidden, last = split(weights, self.shapes)
        for layer in hidden:
            inputs = self.sigma(torch, inputs @ layer[:, :-1].T + layer[:, -1], 0)[0]
        return self.scale * (inputs @ last[0, :-1] + last[0, -1])

    def errors(self, weights: Any, chosen: Any = None) -> Any:
        """Errors (n,) [N] of chosen rows, or of all, which the best weights go by; StopIteration after the time."""
        inputs, target, weight = self.rows if chosen is None else [column[chosen] for column in self.rows]
        errors = weight * (self.output(weights, inputs) - target)
        if self.share_of_time() > 1.0:
            raise StopIteration
        if chosen is None and (mean := float((errors.detach() ** 2).mean())) < self.least:
            self.best, self.least = weights.detach().numpy().copy(), mean
        return errors


def scipy_least_squares(loss: Loss) -> None:
    """SciPy's default, a trust region, with the dense Jacobian of all rows."""

    def jacobian(weights: Array) -> Array:
        slopes = torch.func.vmap(torch.func.grad(loss.output), (None, 0))(torch.tensor(weights), loss.rows[0])
        return np.asarray(loss.rows[2][:, None] * slopes)

    least_squares(lambda w: loss.errors(torch.tensor(w)).numpy(), loss.best, jacobian, xtol=None, ftol=None)


def lbfgs(loss: Loss) -> None:
    """PyTorch's L-BFGS on all rows with its strong Wolfe search, begun anew from the best where it ends."""
    while True:
        weights = torch.tensor(loss.best, requires_grad=True)
        optimiser = torch.optim.LBFGS([weights], max_iter=1000, history_size=50, line_search_fn="strong_wolfe")

        def closure(weights: Any = weights, optimiser: Any = optimiser) -> Any:
            optimiser.zero_grad()
            (value := (loss.errors(weights) ** 2).mean()).backward()
            return value

        optimiser.step(closure)


def adam(loss: Loss, rows: int = 256, rate: float = 5e-3) -> None:
    """PyTorch's Adam on random rows, its rate a falling cosine of the time; all rows judge it after every epoch."""
    weights = torch.tensor(loss.best, requires_grad=True)
    optimiser = torch.optim.Adam([weights])
    while True:
        for chosen in torch.randperm(len(loss.rows[0])).split(rows):
            optimiser.param_groups[0]["lr"] = rate * 0.5 * (1.0 + cos(pi * min(loss.share_of_time(), 1.0)))
            optimiser.zero_grad()
            (loss.errors(weights, chosen) ** 2).mean().backward()
            optimiser.step()
        loss.errors(weights)


def main(samples: Path, seconds: float = 50.0, width: int = 16, out: Path = Path("results/optimisers.json")) -> None:
    """Fit 3 layers by every method for so many CPU seconds; write RMS errors [N] on rows for training and held back."""
    writable_folder(out.parent)
    regression = PatchSurrogate.regressions(either_side(read_samples(samples)))[0]
    regression = replace(regression.of_rows(regression.targets > 0.0), tolerance=0.0)
    rows, held_back = (regression.of_rows(chosen) for chosen in (~regression.validation, regression.validation))
    start = initial_network(rows.inputs, rows.targets, (width,) * 3, "algebraic", 0)
    clock = TrainingSettings((start.hidden,), max_gflop=inf, max_cpu_s=seconds, restarts=0)
    with one_thread():
        networks = {"Levenberg-Marquardt": fit(rows, clock, start=start).network}
        for name, method in (("SciPy least_squares", scipy_least_squares), ("PyTorch L-BFGS", lbfgs), ("Adam", adam)):
            loss = Loss(rows, start, seconds)
            with suppress(StopIteration):
                method(loss)
            networks[name] = unflatten(loss.best, start)
    errors = {name: [float(np.sqrt(r.squares(n).mean())) for r in (rows, held_back)] for name, n in networks.items()}
    said = {"rows": len(rows.targets), "network": size_text(start.hidden), "cpu_s": seconds, "rms_n": errors}
    write_text(out, json.dumps({**said, "machine": machine_record()}, indent=1))
    print(*(f"{name}: {train:.3g} N, held back {held:.3g} N" for name, (train, held) in errors.items()), sep="\n")


if __name__ == "__main__":
    run_program(main)
