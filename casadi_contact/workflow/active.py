"""Active samples: poses on which a surrogate is worst, learned as well.

The points of a plan lie evenly, and so thinly in the corners of six dimensions that a surrogate with an RMS error of a
newton is off by a hundred in some. A round (`presets.ActiveRound`) draws the plan once more with another seed, several
times as many samples, and adds those on which the surrogate is worst to the ones it learns. They are training rows:
validation and test rows stay an even draw of the plan, so that what they say of the surrogate stays true.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from casadi_contact.core.conventions import Progress
from casadi_contact.samples.draw import draw_samples
from casadi_contact.samples.errors import LoadModel
from casadi_contact.samples.models import ModelPair, models_of, settings_of
from casadi_contact.samples.samples import TRAIN, Samples
from casadi_contact.workflow.project import Project, read_motion


def models_to_ask(project: Project, samples: Samples) -> ModelPair:
    """What makes the contact models of the samples, to draw more; ValueError where the library's did not make them."""
    models = models_of(samples)
    if models is None:
        raise ValueError(
            f"preset {project.preset_name} draws more samples in its active rounds, which it can of the elastic "
            "foundation alone: choose another preset for a model or a table of your own"
        )
    return models


def candidates(
    project: Project,
    samples: Samples,
    number: int,
    times: float,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> Samples:
    """The plan of the project's samples `times` as large, its seed greater by the round's number; kept in the project's
    folder, and drawn on where an earlier run stopped. Raises ValueError as `models_to_ask`."""
    models = models_to_ask(project, samples)
    settings = settings_of(samples)
    settings = replace(settings, scale=times * settings.scale, seed=settings.seed + number)
    path = project.folder / f"candidates-{number}.h5"
    motion = read_motion(project)[0]
    return draw_samples(
        project.scene, motion, path, settings=settings, executor=executor, models=models, progress=progress
    )


def worst_samples(model: LoadModel, samples: Samples, share: float) -> Samples:
    """The share of samples on which a model is worst, and all on which nothing touches, as training rows.

    The error of a sample is max over loads |model - sample|/tolerance, the scene's tolerances. Lifted bodies all belong
    to them because a load error of zero does not tell how near a false contact is. Raises ValueError for a share
    outside 0 to 1.
    """
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"share is {share!r}, expected 0 to 1")
    tolerances = samples.scene.tolerances_of(model.load_names)
    errors = np.max(np.abs(model(samples.poses) - samples.loads(model.load_names)) / tolerances, axis=1)
    chosen = (samples.wrenches == 0.0).all(axis=(1, 2))
    chosen[np.argsort(-errors, kind="stable")[: round(share * len(samples))]] = True
    worst = samples.rows(chosen)
    return replace(worst, role=np.full(len(worst), TRAIN, dtype=np.uint8))
