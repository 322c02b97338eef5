"""How many samples a slow contact model needs: networks, polynomials, a Gaussian process, and on the foundation.

Samples are those of finite elements (``casadi-contact build knee_fem --model finite-elements``), of which N are drawn.
The error is the largest RMS of a load over the D3 samples held back, as a share of that load's largest in D3.

    on the foundation               `cc.OnFoundation`
    network alone                   patch surrogate, 6-6 or 10-10, 6 Gflop a network
    polynomial, Gaussian process    of the loads as functions of the pose
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import casadi_contact as cc
from casadi_contact.core.conventions import Array
from casadi_contact.core.terminal import run_program
from casadi_contact.networks.training.fit import fit_all
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.pictures.page import new_page, save_page
from casadi_contact.samples.samples import DOMAINS, TEST, TRAIN, VALIDATION, Samples, mirrored, read_samples
from casadi_contact.scenes.columns import write_columns
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from problems.studies.peers import LOADS, Peer, fitted, tasks
from problems.studies.regressors import METHODS

Model = Callable[[Array], Array]


def some(samples: Samples, count: int, seed: int = 0) -> Samples:
    """A random choice of the samples that are not held back, in which a tenth is for validation."""
    pool = np.flatnonzero(samples.role != TEST)
    chosen = samples.rows(np.random.default_rng(seed).choice(pool, min(count, len(pool)), replace=False))
    return replace(chosen, role=np.where(np.arange(len(chosen)) % 10 == 0, VALIDATION, TRAIN).astype(np.uint8))


def networks(samples: Samples, gflop: float = 6.0) -> PatchSurrogate:
    """The patch structure with networks of two layers, smaller ones for few samples; a knee's in the mirror as well."""
    used = samples.join_samples(mirrored(samples)) if samples.scene.symmetric else samples
    regressions, width = PatchSurrogate.regressions(used), 6 if len(samples) < 300 else 10
    settings = {each.name: TrainingSettings(((width, width),), max_gflop=gflop, restarts=0) for each in regressions}
    fits = fit_all(regressions, settings)
    return PatchSurrogate(samples.scene, {name: fit.network for name, fit in fits.items()})


def candidates(samples: Samples) -> Iterator[tuple[str, Model]]:
    """Models by name, each learned from these samples as it is asked for."""
    yield "on the foundation", cc.OnFoundation.fit(samples)
    yield "network alone", networks(samples)
    regressions = tasks(samples, samples.scene.load_names)[LOADS]
    for family in ("polynomial", "Gaussian process"):
        for settings, method in METHODS[family].items():
            try:
                fits = fitted(method, regressions, near=False)
            except ValueError:  # more terms than samples
                continue
            name = family if family == "Gaussian process" else f"{family} {settings}"
            yield name, Peer(samples.scene, samples.scene.load_names, fits)


def main(
    samples: Path = Path("results/knee_fem-quick/samples.h5"),
    counts: str = "30,100,300,1000,3000",
    out: Path = Path("results/few_samples"),
) -> None:
    """Print and draw the error of each method against the number of samples."""
    whole = read_samples(samples)
    names, unseen = whole.scene.load_names, whole.select("D3", TEST)
    if not len(unseen):
        raise ValueError(f"{samples} holds back no samples of D3, expected some of domain {DOMAINS[2]}")
    loads, largest = unseen.loads(names), np.abs(whole.select("D3").loads(names)).max(axis=0)
    rows: list[tuple[str, int, float]] = []
    for count in map(int, counts.split(",")):
        for name, model in candidates(some(whole, count)):
            error = 100.0 * float((np.sqrt(np.mean((model(unseen.poses) - loads) ** 2, axis=0)) / largest).max())
            print(f"{count:6d} samples, {name}: {error:.2f} %", flush=True)
            rows.append((name, count, error))
    out.mkdir(parents=True, exist_ok=True)
    columns = dict(zip(("method", "samples", "error_percent"), map(list, zip(*rows, strict=True)), strict=True))
    write_columns(out / "few_samples.csv", columns)
    page = new_page(7.0, 4.5)
    axes = page.subplots()
    for name in dict.fromkeys(name for name, _, _ in rows):
        points = [(count, error) for method, count, error in rows if method == name]
        axes.loglog(*zip(*points, strict=True), "o-", label=name)
    axes.set(xlabel="samples of finite elements", ylabel="largest RMS error of a load in D3 [% of its largest]")
    axes.legend(fontsize=7)
    save_page(page, out / "few_samples.png")


if __name__ == "__main__":
    run_program(main)
