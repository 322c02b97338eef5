"""How far the errors of one size of networks scatter with the random weights that training begins from.

Sizes, samples and budgets are those of the preset's chart, whose own points have the seed 0; others are trained into
the same folder:

    casadi-contact sample knee --preset quick
    python -m problems.studies.seeds knee --preset quick

Errors are on the samples that no network has seen, over all forces and over all torques of a domain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from casadi_contact.core.terminal import PlainConsole, progress_bars
from casadi_contact.samples.errors import domain_errors, rms_by_kind
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.workflow.benchmark.front_file import SIZE
from casadi_contact.workflow.benchmark.sizes import Sized, chart_surrogates, train_sizes
from casadi_contact.workflow.project import Project
from problems.common.command import new_app, run_command
from problems.common.records import write_summary

NAME = "seeds"
KINDS = {"force": "N", "torque": "N·mm"}
app = new_app()


def seeded_sizes(project: Project, seeds: int, widest: int) -> list[Sized]:
    """The sizes of the preset's chart up to so many neurons a layer, each with seeds 0 to seeds - 1."""
    sizes = [sized for sized in chart_surrogates(project.preset.chart, project.scene) if sized.sweep == SIZE]
    small = [sized for sized in sizes if max(sized.effort.sizes[-1]) <= widest]
    if not small:
        raise ValueError(f"preset {project.preset_name} has no size of up to {widest} neurons a layer in its chart")
    return [replace(sized, seed=seed) for sized in small for seed in range(seeds)]


def spread_of(errors: Sequence[Mapping[str, Mapping[str, float]]]) -> dict[str, dict[str, list[float]]]:
    """By domain and kind, those of `KINDS` that the scene's loads are of: the errors of all seeds, in their order."""
    kinds = {domain: tuple(of_kinds) for domain, of_kinds in errors[0].items()}
    return {domain: {kind: [of[domain][kind] for of in errors] for kind in kinds[domain]} for domain in kinds}


@app.command()
def run(
    scene: Annotated[str, typer.Argument(help="a ready scene, or the path of a .toml")],
    preset: Annotated[str, typer.Option(help="whose chart's sizes, samples and budgets")] = "quick",
    seeds: Annotated[int, typer.Option(min=2, help="how many random starts of each size")] = 5,
    widest: Annotated[int, typer.Option(min=1, help="sizes of up to so many neurons a layer")] = 24,
    out: Annotated[Path | None, typer.Option(help="project folder; results/SCENE-PRESET if left out")] = None,
) -> None:
    """Train the sizes of a chart from several random starts, and say how far their errors scatter."""
    project = Project.open(scene, preset, out)
    samples, wanted = project.samples(), seeded_sizes(project, seeds, widest)
    console = PlainConsole()
    with progress_bars(console) as update:
        paths = train_sizes(project, wanted, update)
    record: dict[str, Any] = {}
    for first in range(0, len(wanted), seeds):
        models = [load_surrogate(path) for path in paths[first : first + seeds]]
        errors = [{d: rms_by_kind(of) for d, of in domain_errors(model, samples).items()} for model in models]
        record[wanted[first].name] = spread_of(errors)
    write_summary(project.folder / f"{NAME}.json", {"scene": project.scene.name, "seeds": seeds, "sizes": record})
    console.print(_table(record))
    typer.echo(f"results in {project.folder / f'{NAME}.json'}")


def _table(record: Mapping[str, Mapping[str, Mapping[str, Sequence[float]]]]) -> Table:
    table = Table("networks", "domain", *(f"{kind} [{unit}]" for kind, unit in KINDS.items()))
    for name, domains in record.items():
        for domain, of in domains.items():
            cells = (
                f"{np.median(of[kind]):.3g} ({min(of[kind]):.3g} to {max(of[kind]):.3g})" if kind in of else ""
                for kind in KINDS
            )
            table.add_row(name, domain, *cells)
    table.caption = "RMS on unseen samples: median of the seeds (lowest to highest)"
    return table


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, f"studies.{NAME}")


if __name__ == "__main__":
    main()
