"""Measure a scene's shipped surrogates and what needs no training: ``python -m casadi_contact.benchmark.shipped``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.benchmark.front_file import write_front
from casadi_contact.benchmark.shipped import measured_front
from casadi_contact.files import writable_folder
from casadi_contact.quantities import three_digits
from casadi_contact.scenes import load_scene
from casadi_contact.terminal import new_app, run_app

app = new_app(add_completion=False)


@app.command()
def run(
    scene: Annotated[str, typer.Argument(help="a ready scene or the path of a .toml")],
    out: Annotated[Path | None, typer.Option(help="file to write; results/SCENE-front.csv if left out")] = None,
) -> None:
    """Measure time and error of elastic foundations, and of the scene's shipped surrogates, on unseen walking."""
    loaded = load_scene(scene)
    path = Path("results") / f"{loaded.name}-front.csv" if out is None else out
    writable_folder(path.parent)  # before minutes of measuring
    front = measured_front(loaded)
    write_front(path, front)
    for model in front.models:
        time = "not timed" if model.value is None else f"{model.value.median_us:.3g} µs"
        print(
            f"{model.name}: {time}, RMS {three_digits(model.force_rms_n)} N, {three_digits(model.torque_rms_nmm)} N·mm"
        )
    print(f"written {path}")


if __name__ == "__main__":
    run_app(app, "shipped", sys.argv[1:], "python -m casadi_contact.benchmark.shipped")
