"""How a surrogate does over the whole reach of its joint, on samples that it has never seen, domain by domain.

The samples are drawn with another seed, by a scene that is `like` its own:

    casadi-contact sample reach_anew.toml --preset reach --model foundation --out anew
    python -m problems.studies.whole_reach knee_reach anew/samples.h5

with reach_anew.toml, for some 99,000 samples,

    format = 1
    name = "reach_anew"
    like = "knee_reach"
    [sampling]
    seed = 7
    counts = { D3 = 360000, D4 = 216000, D5 = 10800, D6 = 108000, D7 = 3600 }

Errors are against the loads in the samples; coverage is the share of loads whose error lies below the expected one.
The last two rows have loads of the scene's foundation: poses drawn evenly over the sampled range, half of them pressed
by what the surrogate says, where contact shows that is claimed and is not; and poses to which the surrogate leads
(`sampling.led_to`), over a rim as well. Astray are valid poses with an error beyond ten times the scene's tolerance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

import casadi_contact as cc
from casadi_contact.core.conventions import load_unit
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.terminal import PlainConsole
from casadi_contact.samples.chunk import WrenchModel
from casadi_contact.samples.errors import load_errors
from casadi_contact.samples.led_to import samples_led_to
from casadi_contact.samples.perturbed import uniform_samples
from casadi_contact.samples.samples import DOMAINS, TRAIN, Samples, read_samples
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.coverage import trust_coverage
from casadi_contact.surrogate.wrong_poses import WRONG
from casadi_contact.workflow.benchmark.timing import compare, one_thread, time_single_calls
from problems.common.command import RESULTS, new_app, run_command
from problems.common.records import write_summary
from problems.studies.stability.out_of_range import VALID

NAME = "whole_reach"
ALL, EVENLY, LED = "all", "evenly", "led to"
_OTHERS, _OTHER_SEED = 20_000, 29  # poses, and a seed that calibration does not use
_TIMED = 300
app = new_app()


def reach_record(surrogate: Surrogate, samples: Samples) -> dict[str, Any]:
    """By domain, and over all: poses and the valid share, and over the valid poses by load rms and max [N, N·mm] of the
    errors, and coverage, over the poses that carry the load (None where none does, and over all; see `trust_coverage`).
    wrong: how many of the valid poses have an error beyond `WRONG` times the scene's tolerance of the load.

    Raises ValueError for loads that the samples do not tell.
    """
    valid = samples.rows(surrogate.validity(samples.poses) > VALID)
    coverage = trust_coverage(surrogate, valid)
    limits = WRONG * surrogate.scene.tolerances_of(surrogate.load_names)
    record: dict[str, Any] = {}
    for domain in (*DOMAINS, ALL):
        drawn, kept = (part.select(None if domain == ALL else domain) for part in (samples, valid))
        if len(drawn):
            record[domain] = {"poses": len(drawn), "valid": len(kept) / len(drawn)}
        if len(kept):
            loads, wanted = surrogate(kept.poses), kept.loads(surrogate.load_names)
            errors = load_errors(surrogate.load_names, loads, wanted)
            record[domain]["wrong"] = int((np.abs(loads - wanted) > limits).any(axis=1).sum())
            record[domain]["loads"] = {
                name: {"rms": of["rms"], "max": of["max"], "coverage": coverage.get(domain, {}).get(name)}
                for name, of in errors.items()
            }
    return record


def _others(surrogate: Surrogate, samples: Samples, foundation: WrenchModel) -> dict[str, Samples]:
    """Poses over the range of all samples, and those to which the surrogate leads, with the foundation's loads."""
    known, seed = replace(samples, role=np.full(len(samples), TRAIN, dtype=np.uint8)), _OTHER_SEED
    even = uniform_samples(known, foundation, surrogate.validity, surrogate.trust_roots, count=_OTHERS, seed=seed)
    return {EVENLY: even, LED: samples_led_to(surrogate, known, foundation, count=_OTHERS, seed=seed)}


@app.command()
def run(
    surrogate: Annotated[str, typer.Argument(help="a ready surrogate or the path of a .h5 file")],
    samples: Annotated[Path, typer.Argument(help="samples file (.h5) drawn with another seed")],
    out: Annotated[Path, typer.Option(help="folder for whole_reach.json")] = RESULTS / NAME,
) -> None:
    """Say how far off a surrogate is on samples that it has never seen, and how fast it is beside the foundation."""
    writable_folder(out)
    model, drawn = cc.load_surrogate(surrogate), read_samples(samples)
    foundation = cc.foundation(model.scene)
    others = {name: reach_record(model, part)[ALL] for name, part in _others(model, drawn, foundation).items()}
    record = {**reach_record(model, drawn), **others}
    rows = np.linspace(0, len(drawn.poses) - 1, _TIMED).astype(int)
    models = {"surrogate": model, "foundation": foundation}
    with one_thread():
        timings = compare(
            {
                name: partial(time_single_calls, each.function(compiled=True), drawn.poses[rows])
                for name, each in models.items()
            }
        )
    microseconds = {name: timing.median_us for name, timing in timings.items()}
    write_summary(out / f"{NAME}.json", {"domains": record, "microseconds": microseconds})
    console = PlainConsole()
    console.print(_table(record, model.load_names))
    times = ", ".join(f"{name} {us:.2f} µs" for name, us in microseconds.items())
    console.print(f"{times} a pose (single calls, median)", f"results in {out}", sep="\n", highlight=False)


def _table(record: dict[str, Any], names: Sequence[str]) -> Table:
    table = Table("domain", "poses", "valid", "wrong", *(f"{name} [{load_unit(name)}]" for name in names))
    for domain, of in record.items():
        found = of.get("loads", {}).values()
        shares = ["-" if x["coverage"] is None else f"{x['coverage']:.1%}" for x in found]
        cells = [f"{x['rms']:.3g} / {x['max']:.3g} / {share}" for x, share in zip(found, shares, strict=True)]
        table.add_row(domain, str(of["poses"]), f"{of['valid']:.1%}", str(of.get("wrong", "-")), *cells)
    table.caption = "RMS / largest error / coverage of the expected error, over valid poses"
    return table


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, f"studies.{NAME}")


if __name__ == "__main__":
    main()
