"""The two contact models that samples come from, as worker processes make and ask them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache

import numba

from casadi_contact.contact.model import ContactModel
from casadi_contact.samples.chunk import WrenchModel
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.scene import Scene

# Makes the model that poses are settled on and the one that samples are evaluated on, in each worker process.
ModelPair = Callable[[Scene, SamplingSettings], tuple[ContactModel, WrenchModel]]


@dataclass(frozen=True)
class WorkerModels:
    """What a worker needs to make its models, in hashable form."""

    scene_toml: str
    settings_json: str
    models: ModelPair

    @classmethod
    def of(cls, scene: Scene, settings: SamplingSettings, models: ModelPair) -> WorkerModels:
        """Of a scene and the settings of its samples."""
        return cls(scene.to_toml(), json.dumps(settings.to_table(), sort_keys=True), models)

    def settings(self) -> SamplingSettings:
        """Those of the samples."""
        return SamplingSettings.from_table(json.loads(self.settings_json))

    def pair(self) -> tuple[ContactModel, WrenchModel]:
        """The models, made once in each process."""
        return _made(self)


@lru_cache(maxsize=2)
def _made(models: WorkerModels) -> tuple[ContactModel, WrenchModel]:
    return models.models(Scene.from_toml(models.scene_toml), models.settings())


@contextmanager
def one_thread() -> Iterator[None]:
    """One numba thread in the block: the executor already uses all cores."""
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(threads)
