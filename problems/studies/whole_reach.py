"""How a surrogate does over the whole reach of its joint, on samples that it has never seen, domain by domain.

The samples are drawn with another seed, by a scene that is `like` its own:

    casadi-contact sample reach_anew.toml --preset reach --model foundation --out anew
    python -m problems.studies.whole_reach knee_reach anew/samples.h5

Errors are against the loads in the samples; coverage is the share of loads whose error lies below the expected one.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

import casadi_contact as cc
from casadi_contact.benchmark.timing import compare, one_thread, time_single_calls
from casadi_contact.conventions import load_unit
from casadi_contact.dataset import DOMAINS, Samples, read_samples
from casadi_contact.dataset.errors import load_errors
from casadi_contact.files import writable_folder
from casadi_contact.structures import Surrogate
from problems.common.command import RESULTS, new_app, run_command
from problems.common.records import write_summary
from problems.studies.stability.out_of_range import VALID

NAME = "whole_reach"
_TIMED = 300
app = new_app()


def reach_record(surrogate: Surrogate, samples: Samples) -> dict[str, Any]:
    """Errors by domain over the valid poses, by load: rms and max [N, N·mm], and coverage; poses and the valid share.

    "all" stands for all domains. Raises ValueError for loads that the samples do not tell.
    """
    names = surrogate.load_names
    reference = samples.loads(names)
    found, expected = surrogate(samples.poses), surrogate.expected_error(samples.poses)
    valid = surrogate.validity(samples.poses) > VALID
    record: dict[str, Any] = {}
    for domain, rows in _rows_by_domain(samples).items():
        kept = rows & valid
        record[domain] = {"poses": int(rows.sum()), "valid": float(kept.sum() / rows.sum())}
        if kept.any():
            errors = load_errors(names, found[kept], reference[kept])
            covered = np.mean(np.abs(found - reference)[kept] <= expected[kept], axis=0)
            record[domain]["loads"] = {
                name: {"rms": errors[name]["rms"], "max": errors[name]["max"], "coverage": float(share)}
                for name, share in zip(names, covered, strict=True)
            }
    return record


def _rows_by_domain(samples: Samples) -> dict[str, np.ndarray]:
    """True (n,) for the samples of every domain that has some, and of all."""
    rows = {name: samples.domain == k + 1 for k, name in enumerate(DOMAINS)}
    return {name: of for name, of in rows.items() if of.any()} | {"all": np.ones(len(samples.domain), dtype=bool)}


@app.command()
def run(
    surrogate: Annotated[str, typer.Argument(help="a ready surrogate or the path of a .h5 file")],
    samples: Annotated[Path, typer.Argument(help="samples file (.h5) drawn with another seed")],
    out: Annotated[Path, typer.Option(help="folder for whole_reach.json")] = RESULTS / NAME,
) -> None:
    """Say how far off a surrogate is on samples that it has never seen, and how fast it is beside the foundation."""
    writable_folder(out)
    model, drawn = cc.load_surrogate(surrogate), read_samples(samples)
    record = reach_record(model, drawn)
    rows = np.linspace(0, len(drawn.poses) - 1, _TIMED).astype(int)
    models = {"surrogate": model, "foundation": cc.foundation(model.scene)}
    with one_thread():
        timings = compare(
            {
                name: partial(time_single_calls, each.function(compiled=True), drawn.poses[rows])
                for name, each in models.items()
            }
        )
    microseconds = {name: timing.median_us for name, timing in timings.items()}
    write_summary(out / f"{NAME}.json", {"domains": record, "microseconds": microseconds})
    Console().print(_table(record))
    typer.echo(", ".join(f"{name} {us:.2f} µs" for name, us in microseconds.items()) + " a pose (single calls, median)")


def _table(record: dict[str, Any]) -> Table:
    loads = record["all"].get("loads", {})
    table = Table("domain", "poses", "valid", *(f"{name} [{load_unit(name)}]" for name in loads))
    for domain, of in record.items():
        cells = [f"{x['rms']:.3g} / {x['max']:.3g} / {x['coverage']:.1%}" for x in of.get("loads", {}).values()]
        table.add_row(domain, str(of["poses"]), f"{of['valid']:.1%}", *cells)
    table.caption = "RMS / largest error / coverage of the expected error, over valid poses"
    return table


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, f"studies.{NAME}")


if __name__ == "__main__":
    main()
