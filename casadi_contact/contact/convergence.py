"""How fine a contact model a scene needs: the cheapest whose errors, against a converged one, meet its tolerances."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.core.conventions import Array
from casadi_contact.core.quantities import format_above_limit, quantity
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.tolerance import Tolerance

Model = TypeVar("Model", bound=CompiledFoundation)


def forces_tried(scene: Scene, largest: float = 2.5) -> tuple[float, float]:
    """Least and largest force [N] on a patch that a choice is made for; the largest is in reference loads."""
    return scene.boundary_load, largest * scene.reference_load


@dataclass(frozen=True)
class Errors:
    """Of a model in n poses: absolute errors of the scene's named loads (n, L) [N, N·mm], force on the pressed patch
    (n,) [N], and whether the rim cuts contact, or a sharp edge of the moving mesh bears (n,).

    Poses at the rim count only where most of them are there: a narrow joint bears on its rim.
    """

    scene: Scene
    loads: Array
    forces_n: Array
    at_rim: np.ndarray
    mostly: float = 0.5  # share of the poses at the rim from which these count

    @property
    def of_allowed(self) -> Array:
        """Errors (n, L) as shares of what a single pose may be wrong by."""
        share = np.maximum(self.forces_n / self.scene.reference_load, 1.0)
        return Tolerance.of(self.scene).single_ratios(self.loads / share[:, None])

    @property
    def ratio(self) -> float:
        """As `Tolerance.ratio`, but a single error may grow in proportion to the force above the reference load."""
        return float(self._of_loads.max())

    @property
    def ratio_at_rim(self) -> float:
        """The largest ratio of a load's RMS to its tolerance over the poses at the rim, where others are judged."""
        return float(self._rms(~self._judged).max()) if (~self._judged).any() else 0.0

    @property
    def worst(self) -> str:
        """The load that misses its tolerance by most, in words."""
        load = int(self._of_loads.argmax())
        name, tolerance = self.scene.load_names[load], self.scene.tolerances_of()[load]
        times = format_above_limit(self._of_loads[load], 1.0)
        return f"{times} times what {name} may be off by (tolerance {tolerance:g} {quantity(name).unit})"

    def record(self, **details: Any) -> dict[str, Any]:
        """What is said of the model, and its errors, in plain values; which share exceeds it at the rim."""
        loads, names = self.loads[self._judged], self.scene.load_names
        values = {"rms": np.sqrt(np.mean(loads**2, axis=0)), "largest": loads.max(axis=0)}
        by_name = {key: dict(zip(names, sizes.tolist(), strict=True)) for key, sizes in values.items()}
        exceed = (self.of_allowed[~self._judged] > 1.0).any(axis=1)
        at_rim = {"exceeding_at_rim": float(exceed.mean())} if len(exceed) else {}
        return {**details, "poses": len(self.loads), "forces_n": list(forces_tried(self.scene)), **by_name, **at_rim}

    def _rms(self, rows: np.ndarray) -> Array:
        """Of every load (L,), in its tolerance."""
        return Tolerance.of(self.scene).rms_ratios(np.sqrt(np.mean(self.loads[rows] ** 2, axis=0)))

    @property
    def _of_loads(self) -> Array:
        """The largest ratio of an error of each load (L,), RMS or single, to what is allowed."""
        return np.maximum(self._rms(self._judged), self.of_allowed[self._judged].max(axis=0))

    @property
    def _judged(self) -> np.ndarray:
        return ~self.at_rim | (np.mean(self.at_rim) > self.mostly)


def cheapest(scene: Scene, candidates: Iterable[Model], errors_of: Callable[[Model], Array], **details: Any) -> Model:
    """The first candidate whose errors (poses, loads) are small enough (`Errors.ratio`, whatever the force), its
    record telling so, with details besides; raises ValueError where no candidate is good enough."""
    for model in candidates:
        values = np.abs(errors_of(model))
        errors = Errors(scene, values, np.zeros(len(values)), np.zeros(len(values), dtype=bool))
        if errors.ratio <= 1.0:
            model.record = errors.record(**details)
            return model
    raise not_good_enough(model, errors)


class NotGoodEnoughError(ValueError):
    """No foundation of a scene meets its tolerances."""


def not_good_enough(model: CompiledFoundation | str, errors: Errors) -> NotGoodEnoughError:
    """The finest of a scene's models is not good enough."""
    return NotGoodEnoughError(f"scene {errors.scene.name}: {model} is off by {errors.worst}: {remedy(errors.scene)}")


def remedy(scene: Scene) -> str:
    """What to do where no model is good enough: a damaged mesh, or a sharp moving rim, makes every model wrong."""
    look = "look first whether the meshes are damaged or sharp-edged where they touch (casadi-contact show), then "
    return f"{look if scene.shape == 'mesh' else ''}relax the scene's tolerances, or take cc.ElasticFoundation"
