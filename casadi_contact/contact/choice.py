"""Choices of contact models kept on disc, so that a scene's convergence test runs once.

A file holds the record of a choice as JSON. Its name is the SHA-256 of the scene's content, its tolerances and the
library's code: a scene or a library that differs finds none. What cannot be read, or could be another user's, is as
good as absent, and where the folder cannot be written nothing is kept.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import ArrayLike

from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.choice import CellChoice, cell_foundation
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.contact.cells.patches import CELL_SHAPES
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.cup import CUP_SHAPE, CupFoundation, cup_foundation
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.foundation_source import C_LAWS
from casadi_contact.contact.polar.foundation import PolarFoundation, polar_foundation
from casadi_contact.contact.polar.lines import Rays
from casadi_contact.contact.polar.surfaces import POLAR_SHAPES
from casadi_contact.core.compiler import cache_folder, check_private, is_private
from casadi_contact.core.conventions import as_poses
from casadi_contact.core.files.writing import write_bytes
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.tolerance import Tolerance

_PACKAGE = Path(__file__).parents[1]


def kept_record(scene: Scene, most_bytes: int = 100_000) -> dict[str, Any] | None:
    """The record of the choice made for a scene; None where there is none."""
    path = _path(scene)
    with suppress(OSError, ValueError, TypeError, RecursionError):
        check_private(path.parent)
        if path.stat().st_size <= most_bytes and is_private(path):
            return dict(json.loads(path.read_bytes()))
    return None


def keep_record(scene: Scene, record: Mapping[str, Any]) -> None:
    """Keep the record of a choice: plain values."""
    path = _path(scene)
    with suppress(OSError):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        check_private(path.parent)
        write_bytes(path, json.dumps(record).encode())


def _path(scene: Scene) -> Path:
    tolerances = json.dumps(dict(scene.tolerances), sort_keys=True)
    key = hashlib.sha256(f"{scene.digest} {tolerances} {_code_digest()}".encode()).hexdigest()[:32]
    return cache_folder() / f"choice-{key}.json"


@cache
def _code_digest() -> str:
    paths = sorted(path for ending in ("py", "h") for path in _PACKAGE.rglob(f"*.{ending}"))
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in paths)).hexdigest()


class _Kind(NamedTuple):
    """A kind of foundation: how it is chosen, its class, its size from a choice's record, sizes from coarse to fine."""

    chosen: Callable[..., CompiledFoundation]
    made: Callable[..., CompiledFoundation]
    recorded: Callable[[Mapping[str, Any]], Any]
    ladder: Callable[[Scene], Iterable[Any]]


POLAR_LADDER = (Rays(8, 2), Rays(8, 3), Rays(16, 4))
_CELLS = _Kind(cell_foundation, CellFoundation, lambda r: Cells(*r["cells_mm"], *r["sub_points"]), CellChoice().ladder)
_POLAR = _Kind(polar_foundation, PolarFoundation, lambda r: Rays(r["rays"], r["points"]), lambda _: POLAR_LADDER)
_CUP = _Kind(cup_foundation, CupFoundation, lambda r: r["points"], lambda _: (12, 24, 48))
# Later entries are cheaper where a shape has several.
_KINDS = {**dict.fromkeys(CELL_SHAPES, _CELLS), **dict.fromkeys(POLAR_SHAPES, _POLAR), CUP_SHAPE: _CUP}
FOUNDATION_SHAPES = tuple(_KINDS)


def foundation(
    scene: Scene | str | Path, *, compiled: bool = True, poses: ArrayLike | None = None
) -> CompiledFoundation:
    """The cheapest elastic foundation of a scene (or its name, or file) that meets the scene's tolerances.

    Smooth shapes with one contact area a patch take polar quadrature, a ball in a cup its closed form, meshes and the
    rest cubic cells. Errors are taken against a much finer model of the same kind (cells: an element grid), over poses
    that press each patch within its rim from the scene's boundary load to 2.5 reference loads. Their RMS is within the
    tolerance of every load, and none is more than three times it. (Cells: 0.3 of both where that can be had; a single
    error may grow in proportion to the force above the reference load.) Cells are also tested at given poses (n, 6),
    such as a measured cycle's on elements; where the tolerance is not met there, they are chosen anew with these.

    ``record`` of the model holds the choice and its errors, of polar quadrature also how often elements contradict it.
    It is kept in the cache folder, for pressure laws of the library. The kernel is compiled here, once for a machine.
    Raises ValueError for a shape that has no such model (`FOUNDATION_SHAPES`), or where none is good enough.
    """
    model = _chosen(scene if isinstance(scene, Scene) else load_scene(scene), compiled)
    model.compile()
    if isinstance(model, CellFoundation) and poses is not None:
        given = as_poses(poses)
        if not Tolerance.of(model.scene).met(model(given) - ElasticFoundation(model.scene, CellChoice.elements)(given)):
            model = cell_foundation(model.scene, compiled=compiled, poses=given)
            model.compile()
    return model


def _chosen(scene: Scene, compiled: bool) -> CompiledFoundation:
    """The foundation that a kept record names, else that which meets the tolerances."""
    if scene.shape not in _KINDS:
        known = f"expected one of {', '.join(FOUNDATION_SHAPES)}; others take cc.ElasticFoundation"
        raise ValueError(f"scene {scene.name} has the shape {scene.shape}, which has no foundation of its own: {known}")
    kind, kept = _KINDS[scene.shape], scene.material.law in C_LAWS  # of any other law the scene holds but a name
    if kept and (record := kept_record(scene)) is not None:
        with suppress(KeyError, TypeError, ValueError):  # not as such a record is written: as good as absent
            model = kind.made(scene, kind.recorded(record), compiled=compiled)
            model.record = record
            return model
    model = kind.chosen(scene, compiled=compiled)
    if kept:
        keep_record(scene, model.record)
    return model


def foundation_ladder(scene: Scene) -> Iterator[CompiledFoundation]:
    """Foundations of a scene from coarse to fine, last what `foundation` takes (or raises) if it is none of them."""
    shown = set()
    if kind := _KINDS.get(scene.shape):
        for size in kind.ladder(scene):
            model = kind.made(scene, size)
            shown.add(model.resolution)
            yield model
    chosen = foundation(scene)
    if chosen.resolution not in shown:
        yield chosen
