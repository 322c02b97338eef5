"""Write the pages of results from result files: ``python -m problems.studies.pages``.

The folder of result files holds, as far as measured: speed_accuracy.csv (the front that comes with the library, by
``python -m casadi_contact.workflow.benchmark.shipped knee``), sizes.csv and chart-SCENE.csv (``casadi-contact chart``),
solve_time.csv, muscle_settings.json, seeds.json and two_stage_work.csv (``python -m problems.studies.solve_time``,
``.muscle_settings``, ``.seeds`` and ``.two_stage_work``), evaluation.json (``evaluate``), kernel_speed.json
(``speed``), pose_estimation/*.json and muscle_contact/*.json (summaries of the problems), and stability.json or
stability-SCENE.json (``python -m problems.studies.stability``). A page is written for each that is there.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.core.files.writing import replacing, writable_folder
from casadi_contact.pictures.page import save_page
from casadi_contact.workflow.benchmark.front_file import read_front
from problems.common.command import new_app, run_command
from problems.studies import solve_time
from problems.studies.pages.headline import headline, write_headline
from problems.studies.pages.problems import muscle_contact_page, pose_estimation_page, stability_page
from problems.studies.pages.surrogates import (
    domains_page,
    draw_speed_accuracy,
    kernel_speed_page,
    seeds_page,
    solve_time_page,
    speed_accuracy_page,
)

CHARTS = "chart-*.csv"
FRONTS = {
    "speed_accuracy": ("speed-accuracy", "Speed and accuracy"),
    "sizes": ("sizes", "Sizes, samples and training"),
    "two_stage_work": ("two-stage-work", "The paper's method by work of training"),
}
app = new_app()


def pages(data: Path) -> dict[str, str]:
    """Text of every page by file name, of the result files that are in the folder."""
    found: dict[str, str] = {}
    for path, (name, title) in _fronts(data).items():
        found[f"{name}.md"] = speed_accuracy_page(path, title)
    if (path := data / "solve_time.csv").is_file():
        found["solve-time.md"] = solve_time_page(path)
    if (path := data / "evaluation.json").is_file():
        found["domains.md"] = domains_page(path)
    if (path := data / "kernel_speed.json").is_file():
        found["kernel-speed.md"] = kernel_speed_page(path)
    if (path := data / "seeds.json").is_file():
        found["seeds.md"] = seeds_page(path)
    if summaries := sorted((data / "pose_estimation").glob("*.json")):
        found["pose-estimation.md"] = pose_estimation_page(summaries)
    if summaries := sorted((data / "muscle_contact").glob("*.json")):
        settings = data / "muscle_settings.json"
        found["muscle-contact.md"] = muscle_contact_page(summaries, settings if settings.is_file() else None)
    for path in sorted(data.glob("stability*.json")):
        found[f"{path.stem}.md"] = stability_page(path)
    return found


def _fronts(data: Path) -> dict[Path, tuple[str, str]]:
    """Measured fronts of the folder, with the name of their page and its title."""
    named = {path: page for name, page in FRONTS.items() if (path := data / f"{name}.csv").is_file()}
    charts = sorted(data.glob(CHARTS))
    return named | {path: (path.stem, f"Speed and accuracy: {path.stem.partition('-')[2]}") for path in charts}


@app.command()
def run(
    data: Annotated[Path, typer.Argument(help="folder of result files")] = Path("docs/results/data"),
    out: Annotated[Path, typer.Option(help="folder of the pages")] = Path("docs/results"),
    readme: Annotated[Path | None, typer.Option(help="put the headline numbers into this README too")] = None,
) -> None:
    """Write the pages of results; no number of theirs is typed by hand."""
    writable_folder(out)
    found = pages(data)
    if not found:
        raise ValueError(f"no result file in {data}, expected speed_accuracy.csv, evaluation.json or others")
    for name, text in found.items():
        with replacing(out / name) as beside:
            beside.write_text(text, "utf-8")
        print(f"written {out / name}")
    for path in _fronts(data):
        draw_speed_accuracy(path, out)
    if (data / "solve_time.csv").is_file():
        save_page(solve_time.draw(read_front(data / "solve_time.csv")), out / f"{solve_time.NAME}.png")
    if readme is not None:
        write_headline(readme, headline(data))
        print(f"numbers in {readme}")


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, "studies.pages")


if __name__ == "__main__":
    main()
