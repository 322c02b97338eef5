"""The contact that a problem runs on: a surrogate, or the foundation of a scene, with nothing trained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated

import typer

import casadi_contact as cc
from casadi_contact.contact.convergence import NotGoodEnoughError
from casadi_contact.contact.elements.foundation import ElasticFoundation, grid_text
from casadi_contact.contact.symbolic import SymbolicContact, symbolic
from casadi_contact.core.compiler import warn_once
from casadi_contact.optimisation.joint_mechanics import whole_wrench
from casadi_contact.optimisation.verification.verdict import own_model
from casadi_contact.samples.reference import found_sensitive_pose
from casadi_contact.scenes.scene import Scene
from casadi_contact.workflow.project import reference_motion_cycles

SurrogateOption = Annotated[
    str | None, typer.Option("--surrogate", help="a ready surrogate or the path of a .h5 file; knee if left out")
]
SceneOption = Annotated[
    str | None, typer.Option("--scene", help="no surrogate but the foundation of this ready scene or scene .toml")
]


@dataclass(frozen=True)
class ContactSource:
    """Where a contact model comes from, by name or path: small enough to be sent to a worker, which loads it once."""

    surrogate: str | None = None
    scene: str | None = None

    def __post_init__(self) -> None:
        if (self.surrogate is None) == (self.scene is None):
            given = "neither --surrogate nor --scene" if self.scene is None else "both --surrogate and --scene"
            raise ValueError(f"got {given}, expected one of them")

    @classmethod
    def of(cls, surrogate: str | None, scene: str | None) -> ContactSource:
        """As a command line says; the ready surrogate `knee` where it says nothing."""
        return cls("knee" if surrogate is None and scene is None else surrogate, scene)

    @property
    def kind(self) -> str:
        """What pictures and tables call it."""
        return "surrogate" if self.scene is None else "foundation"

    def load_scene(self) -> Scene:
        """The scene alone, which takes no kernels; raises ValueError for an unknown name."""
        return cc.load_scene(self.scene) if self.scene is not None else _load(self).scene

    def load(self) -> SymbolicContact:
        """The contact model; raises ValueError for an unknown name and for a scene that no foundation fits."""
        return _load(self)

    def load_whole(self) -> SymbolicContact:
        """The same with the whole wrench among its loads, as equations of motion need it; a surrogate gives no more
        than it has learned."""
        model = _load(self)
        whole = whole_wrench(model.scene)
        return model if self.scene is None or whole is model.scene else _untrained(whole)


def warm_model(surrogate: str, model: SymbolicContact) -> SymbolicContact:
    """The surrogate on whose solution a problem on model begins; raises ValueError for one of other patches."""
    warm = ContactSource(surrogate=surrogate).load()
    if set(warm.scene.patch_names) != set(model.scene.patch_names):
        raise ValueError(
            f"--warm {surrogate} is of scene {warm.scene.name} with patches {', '.join(warm.scene.patch_names)}, "
            f"expected a surrogate with {', '.join(model.scene.patch_names)}, as scene {model.scene.name} has"
        )
    return warm


@cache
def _load(source: ContactSource) -> SymbolicContact:
    if source.scene is None:
        return cc.load_surrogate(str(source.surrogate))
    model = _untrained(cc.load_scene(source.scene))
    if model.scene.sensitive_pose:
        return model
    found = found_sensitive_pose(model, reference_motion_cycles(model.scene, ()))
    return _untrained(model.scene.with_sensitive_pose(found))


def models_on_grids(scene: Scene) -> dict[str, ElasticFoundation]:
    """The scene's contact model on its fine and its teacher grid, by these names; none where there is no contact model
    at hand (`own_model`): a report then leaves out what it tells."""
    teacher = own_model(scene)
    if not isinstance(teacher, ElasticFoundation):
        return {}
    return {"fine": ElasticFoundation(scene, scene.grids["fine"]), "teacher": teacher}


def grids_in_words(models: Mapping[str, ElasticFoundation]) -> dict[str, str]:
    """Elements along and across of `models_on_grids`, by name: 160×80."""
    return {name: grid_text(model.grid) for name, model in models.items()}


def _untrained(scene: Scene) -> SymbolicContact:
    """The foundation of a scene; where none is good enough, and the user is told so, its fine grid of elements."""
    try:
        return cc.foundation(scene)
    except NotGoodEnoughError as error:
        elements = ElasticFoundation(scene, scene.grids["fine"])
        warn_once(f"{error}; solved here on {elements}, slower and with differenced second derivatives")
        return symbolic(elements)
