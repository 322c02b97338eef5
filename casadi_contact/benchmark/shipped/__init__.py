"""Measured fronts that come with the library: the shipped surrogates of a scene and what needs no training.

``python -m casadi_contact.benchmark.shipped knee`` measures the one of the knee anew; a maintainer puts the file into
``casadi_contact/benchmark/ready``.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from casadi_contact.benchmark.candidate import Candidate
from casadi_contact.benchmark.candidates import surrogate_candidates, untrained_candidates
from casadi_contact.benchmark.front_file import Front, read_front
from casadi_contact.benchmark.measure import measure
from casadi_contact.benchmark.walking import unseen_walking
from casadi_contact.contact import ElasticFoundation
from casadi_contact.project import built_in_motion, shipped_surrogates
from casadi_contact.scenes import Scene

_FOLDER = Path(__file__).parents[1] / "ready"


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
