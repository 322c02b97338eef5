"""Contact models that samples come from: one to settle poses on, one to evaluate samples on."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from casadi_contact import __version__
from casadi_contact.contact.approach import touching_start
from casadi_contact.contact.choice import foundation
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.samples.samples import Samples
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.scene import Scene

# Makes the model that poses are settled on and the one that samples are evaluated on, in each worker process.
ModelPair = Callable[[Scene, SamplingSettings], tuple[ContactModel, ContactModel]]


def elastic_foundations(scene: Scene, settings: SamplingSettings) -> tuple[ContactModel, ContactModel]:
    """Elastic foundations on the settings' settle grid and teacher grid."""
    return ElasticFoundation(scene, settings.settle_grid), ElasticFoundation(scene, settings.teacher_grid)


def foundations(scene: Scene, settings: SamplingSettings) -> tuple[ContactModel, ContactModel]:
    """The scene's `cc.foundation`, both to settle on and to evaluate samples on."""
    model = foundation(scene)
    return model, model


def finite_elements(scene: Scene, settings: SamplingSettings) -> tuple[ContactModel, ContactModel]:
    """Springs that carry as much as `cc.FiniteElements` where the patches have just touched, to settle on, and the
    latter to evaluate samples on: these need loads about those of the plan, and springs take a thousandth of the time.
    """
    from casadi_contact.contact.finite_elements.model import FiniteElements  # needs the extra `fem`

    model, springs = FiniteElements(scene), ElasticFoundation(scene, settings.settle_grid)
    pose, direction, share = touching_start(model), scene.normal_loads[0].direction, 0.5
    if direction is not None:
        pose[:3] += 0.02 * scene.material.thickness * direction
        share = float(np.linalg.norm(model.wrenches(pose)[:, :3]) / np.linalg.norm(springs.wrenches(pose)[:, :3]))
    softer = scene.with_overrides(youngs_modulus=share * scene.material.youngs_modulus)
    return ElasticFoundation(softer, settings.settle_grid), model


MODELS: dict[str, ModelPair] = {
    "elements": elastic_foundations,
    "foundation": foundations,
    "finite-elements": finite_elements,
}


def _given(model: ContactModel, scene: Scene, settings: SamplingSettings) -> tuple[ContactModel, ContactModel]:
    """A user's own model, to settle on and to evaluate samples on."""
    return model, model


def model_pair(model: str | ContactModel) -> ModelPair:
    """The model pair of a name in `MODELS`, or of a user's own model; raises ValueError for another name."""
    if not isinstance(model, str):
        return partial(_given, model)
    if model not in MODELS:
        raise ValueError(f"model is {model!r}, expected one of {', '.join(MODELS)}")
    return MODELS[model]


def model_name(models: ModelPair) -> str:
    """The name in `MODELS`, or the full name of a user's class or function."""
    named: Any = type(models.args[0]) if isinstance(models, partial) else models
    own = f"{named.__module__}.{named.__qualname__}"
    return next((name for name, pair in MODELS.items() if pair is models), own)


def models_identity(models: ModelPair) -> dict[str, str]:
    """What the samples' file says of their models: name and version of this package."""
    return {"models": model_name(models), "package": __version__}


def model_name_of(samples: Samples) -> str | None:
    """The name in `MODELS` of what samples were drawn from; None for a user's own model, and for a table."""
    name = samples.provenance.get("models")
    return name if name in MODELS else None


def teacher_of(samples: Samples) -> ContactModel | None:
    """The contact model that samples were evaluated on; None for a user's own, and for samples from a table."""
    name = model_name_of(samples)
    return None if name is None else MODELS[name](samples.scene, settings_of(samples))[1]


def settings_of(samples: Samples) -> SamplingSettings:
    """The settings that samples were drawn with; raises KeyError for samples that were not drawn."""
    return SamplingSettings(**samples.provenance["settings"])
