"""Measure what is shipped for a scene: time and error of its surrogates and elastic foundations, on unseen walking.

A maintainer puts the file into ``casadi_contact/workflow/benchmark/ready``.
"""

from pathlib import Path

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.terminal import run_program
from casadi_contact.scenes.loading import load_scene
from casadi_contact.workflow.benchmark.candidates import surrogate_candidates, untrained_candidates
from casadi_contact.workflow.benchmark.front_file import write_front
from casadi_contact.workflow.benchmark.measure import measure, unseen_walking
from casadi_contact.workflow.project import built_in_motion, shipped_surrogates


def main(scene: str = "knee", out: Path | None = None) -> None:
    """Measure a ready scene, or a .toml; written to out, or to results/SCENE-front.csv."""
    loaded = load_scene(scene)
    path = Path("results") / f"{loaded.name}-front.csv" if out is None else out
    writable_folder(path.parent)  # before minutes of measuring
    walking = unseen_walking(ElasticFoundation(loaded, loaded.grids["settle"]), built_in_motion(loaded))
    candidates = list(untrained_candidates(loaded))
    for name, surrogate in shipped_surrogates(loaded).items():
        candidates += surrogate_candidates(name, surrogate, graph=True)
    write_front(path, measure(candidates, loaded, walking, print))
    print(f"written {path}")


if __name__ == "__main__":
    run_program(main)
