"""Re-evaluation of a solved problem's poses on the contact model that the surrogate stands for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.symbolic import HasConfidence, SymbolicContact
from casadi_contact.core.conventions import Array, as_poses
from casadi_contact.core.quantities import format_above_limit, quantity
from casadi_contact.scenes.shapes.checks import MOST_ELEMENTS
from casadi_contact.scenes.tolerance import Tolerance


@dataclass(frozen=True)
class Verification:
    """Surrogate against contact model at the poses (n, 6) of a solution; ``print`` it.

    solved (n,): False for frames that the problem's solver gave up; errors (n, L): surrogate minus model [N, N·mm] of
    load_names; tolerance: the scene's; validity (n,) and expected (n, L): what the surrogate itself says there.
    """

    load_names: tuple[str, ...]
    poses: Array
    solved: np.ndarray
    errors: Array
    tolerance: Tolerance
    validity: Array
    expected: Array

    @property
    def unanswered(self) -> np.ndarray:
        """True (n,) for frames at which the model gave no finite loads."""
        return np.asarray(~np.isfinite(self.errors).all(axis=1))

    @property
    def rms(self) -> Array:
        """Root mean square difference of each load (L,) over the frames that the model answered; NaN if it did none."""
        return np.asarray(np.sqrt(np.mean(self._answered**2, axis=0)))

    @property
    def worst(self) -> Array:
        """Largest difference of each load (L,) over these frames."""
        return np.asarray(np.abs(self._answered).max(axis=0))

    @property
    def _answered(self) -> Array:
        known = self.errors[~self.unanswered]
        return known if len(known) else np.full((1, len(self.load_names)), np.nan)

    @property
    def outside(self) -> np.ndarray:
        """True (n,) for frames outside the learned region, validity below 1/2."""
        return self.validity < 0.5

    @property
    def failing(self) -> np.ndarray:
        """True (n,) for frames unsolved, outside the learned region or with a single error that is too large; where an
        RMS is too large, frames with errors above it too."""
        tolerance = self.tolerance
        if not (tolerance.rms_ratios(self.rms) <= 1.0).all():
            tolerance = tolerance.times(1.0 / tolerance.single)
        return ~self.solved | self.outside | ~tolerance.met_by_each(self.errors)

    @property
    def passed(self) -> bool:
        """The errors meet the tolerance, every frame is solved, in the learned region and answered by the model."""
        return not self.failing.any() and self.tolerance.met(self.errors)

    def __str__(self) -> str:
        lines = [
            f"{len(self.poses)} frames, surrogate - model:",
            f"  {'load':<8}{'RMS':>10}{'worst':>10}{'tolerance':>11}",
        ]
        for name, rms, worst, tolerance in zip(
            self.load_names, self.rms, self.worst, self.tolerance.allowed, strict=True
        ):
            verdict = "" if rms <= tolerance else "  too large"
            numbers = f"{format_above_limit(rms, tolerance):>10}{worst:>10.3g}{tolerance:>11g}"
            lines.append(f"  {name:<8}{numbers} {quantity(name).unit}{verdict}")
        lines.append(f"  {_listed(self.outside)} outside the learned region")
        if self.unanswered.any():
            lines.append(f"  {_listed(self.unanswered)} at which the model gives no finite loads")
        if not self.solved.all():
            lines.append(f"  {_listed(~self.solved)} not solved")
        lines.append("  passed" if self.passed else "  not passed")
        return "\n".join(lines)


def _listed(rows: np.ndarray) -> str:
    """Number of frames and, of the first of them, which."""
    frames = np.flatnonzero(rows)
    which = f" ({', '.join(map(str, frames[:10]))}{', ...' if len(frames) > 10 else ''})" if len(frames) else ""
    return f"{len(frames)} of {len(rows)} frames{which}"


def verify(
    surrogate: SymbolicContact, poses: ArrayLike, model: ContactModel, solved: np.ndarray | None = None
) -> Verification:
    """Compare surrogate and contact model at the poses (n, 6) of a solution, against the scene's tolerances.

    surrogate: or a foundation, which is valid everywhere and expects no error. model: what decides; its own error
    should be well below the tolerances (the scene's teacher grid, for an elastic foundation). solved (n,): False for
    frames that the problem's solver gave up, which then do not pass.

    Raises ValueError for bad or no poses, for a model without the surrogate's loads, and for a surrogate that was not
    calibrated.
    """
    poses = as_poses(poses)
    if not len(poses):
        raise ValueError("no poses to verify, expected (n, 6) with n >= 1")
    ended = as_mask("solved", True if solved is None else solved, len(poses))
    validity, expected = np.ones(len(poses)), np.zeros((len(poses), len(surrogate.load_names)))
    if isinstance(surrogate, HasConfidence):
        validity, expected = surrogate.validity(poses), surrogate.expected_error(poses)
    return Verification(
        surrogate.load_names,
        poses,
        ended,
        surrogate(poses) - loads_on(model, poses, surrogate.load_names),
        Tolerance.of(surrogate.scene, surrogate.load_names),
        validity,
        expected,
    )


def as_mask(key: str, value: ArrayLike, count: int) -> np.ndarray:
    """Truth of each pose (n,), given for each or for all; ValueError for another shape, and for other than True, False,
    1 and 0."""
    given = np.asarray(value)
    if given.dtype.kind not in "biuf" or not np.isin(given, (0, 1)).all():
        raise ValueError(f"{key} holds {given.ravel()[0] if given.size else given.dtype}, expected True or False")
    truth = given.astype(bool)
    if truth.shape not in ((), (count,)):
        raise ValueError(f"{key} has shape {truth.shape}, expected one for each of {count} poses, or one for all")
    return np.broadcast_to(truth, count)


def loads_on(model: ContactModel, poses: Array, names: Sequence[str]) -> Array:
    """Named loads (n, L) of a contact model at poses (n, 6); ValueError naming those that it lacks."""
    missing = [name for name in names if name not in model.load_names]
    if missing:
        raise ValueError(f"the model lacks the loads {', '.join(missing)}, expected all that the surrogate gives")
    return np.asarray(model(poses)[:, [model.load_names.index(name) for name in names]])


_UNSURE = 0.5  # of what is allowed: elements twice as wide that differ by less let the model pass


def off_finer(model: ElasticFoundation, poses: Array, names: Sequence[str], allowed: Array) -> Array | None:
    """What the elements are off by in poses (n, 6): their named loads (n, L) minus those of elements half as wide; None
    where these are a mesh's own triangles, and so the same for every grid.

    Elements twice as wide are asked first, which takes a quarter of the model's time. Poses in which these differ by no
    more than half of `allowed` (L,) are left at zero. That is a sieve and no proof, since errors need not fall with the
    width: of 544 poses of the knee in which 40×20 elements are off by more than allowed, a sieve twice as wide let two
    pass. Where half the width would be too many elements, the wider ones stand in for the finer.
    """
    if model.scene.geometry.get("elements") == "triangles":
        return None
    nx, nz = model.grid
    loads = loads_on(model, poses, names)
    wider = ElasticFoundation(model.scene, ((nx + 1) // 2, (nz + 1) // 2))
    off = loads - loads_on(wider, poses, names)
    unsure = (np.abs(off) > _UNSURE * allowed).any(axis=1)
    if unsure.any() and 4 * nx * nz <= MOST_ELEMENTS:
        finer = ElasticFoundation(model.scene, (2 * nx, 2 * nz))
        off[unsure] = loads[unsure] - loads_on(finer, poses[unsure], names)
    off[~unsure] = 0.0
    return off
