"""Measured fronts that come with the library: the shipped surrogates of a scene and what needs no training.

``python -m casadi_contact.workflow.benchmark.shipped knee`` measures the one of the knee anew; a maintainer
puts the file into ``casadi_contact/workflow/benchmark/ready``.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.quantities import three_digits
from casadi_contact.core.terminal import new_app, run_app
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.scene import Scene
from casadi_contact.workflow.benchmark.candidates import surrogate_candidates, untrained_candidates
from casadi_contact.workflow.benchmark.evaluate import unseen_walking
from casadi_contact.workflow.benchmark.front_file import Front, read_front, write_front
from casadi_contact.workflow.benchmark.measure import measure
from casadi_contact.workflow.benchmark.timing import Candidate
from casadi_contact.workflow.project import built_in_motion, shipped_surrogates

_FOLDER = Path(__file__).parent / "ready"


def shipped_front(scene: Scene) -> tuple[Path, Front] | None:
    """The file of the front shipped for this very scene, and the front; None if there is none."""
    path = _FOLDER / f"{Path(scene.name).name}.csv"
    if not path.is_file():
        return None
    front = read_front(path)
    return (path, front) if front.header["scene_digest"] == scene.digest else None


def measured_front(scene: Scene) -> Front:
    """Measure elastic foundations and the scene's shipped surrogates, as kernels and graphs, on unseen walking.

    Raises ValueError for a scene without geometry.
    """
    motion = built_in_motion(scene)
    model = ElasticFoundation(scene, scene.grids["settle"])
    return measure(_candidates(scene), scene, unseen_walking(model, motion))


def _candidates(scene: Scene) -> Iterator[Candidate]:
    yield from untrained_candidates(scene)
    for name, surrogate in shipped_surrogates(scene).items():
        yield from surrogate_candidates(name, surrogate, graph=True)


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
    run_app(app, "shipped", sys.argv[1:], "python -m casadi_contact.workflow.benchmark.shipped")
