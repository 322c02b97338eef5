"""A verdict on every frame of a solution: solved and verified, solved but the contact model differs, or not solved."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.symbolic import HasConfidence, SymbolicContact
from casadi_contact.core.conventions import Array, as_poses, load_unit
from casadi_contact.core.quantities import format_above_limit, three_digits
from casadi_contact.optimisation.verification.unmodelled_load import unmodelled_fraction
from casadi_contact.optimisation.verification.verify import as_mask, loads_on, off_finer
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.tolerance import Tolerance

UNCOUNTED = 0.05  # of a frame's load, that lies where the contact model counts none: with more it is not verified
VERIFIED, DIFFERS, UNSOLVED, UNCHECKED = "solved and verified", "solved, differs", "not solved", "solved, not checked"
ON_MODEL, LEAPS, NOT_ASKED = "solved on the contact model", "solved, its pose leaps", "no load"


class _Doubt(NamedTuple):
    """A reason why solved frames are not verified: which (n,) are for it, the reason in words, what a summary says of
    those frames after their number, and what a frame's own verdict is."""

    rows: np.ndarray
    reason: str
    of_rows: Callable[[np.ndarray], str]
    of_frame: Callable[[int], str]


@dataclass(frozen=True)
class Verdict:
    """What the contact model says of a solution on a surrogate; its text is the first line of a summary.

    solved (n,): as the solver says; errors (n, L): surrogate minus model [N, N·mm] of load_names, infinite where the
    model gave no number, NaN where there was no model to ask; allowed (L,): the largest error of a verified frame;
    model: its name, or why there is none; on_model (n,): frames that were solved on that model itself, which have no
    error; expected (n, L): what a surrogate itself says of its errors (`Surrogate.expected_error`) where there was no
    model to ask, None where it says nothing; uncounted (n,): share of the load that lies where no model of the scene
    counts any (`unmodelled_fraction`); off_finer (n, L): what the model differs by from a finer one (`off_finer`), both
    None where nothing tells, as of a model other than the scene's elements; leaps (n,): frames whose pose lies apart
    from a neighbour's, None where nobody looked; without_load (n,): frames that bear none, which any pose out of
    contact carries: they count for nothing.
    """

    load_names: tuple[str, ...]
    solved: np.ndarray
    errors: Array
    allowed: Array
    model: str
    on_model: np.ndarray
    expected: Array | None = None
    uncounted: Array | None = None
    off_finer: Array | None = None
    leaps: np.ndarray | None = None
    without_load: np.ndarray | None = None

    @property
    def checked(self) -> bool:
        """True where there was a contact model to ask."""
        return not np.isnan(self.errors).all()

    @property
    def has_load(self) -> np.ndarray:
        """True (n,) for frames that bear a load, and so have a pose to find."""
        return np.ones_like(self.solved) if self.without_load is None else ~self.without_load

    @property
    def verified(self) -> np.ndarray:
        """True (n,) for frames that are solved, and on the contact model as well, which counts all of their load and is
        fine enough there, in a pose that does not leap."""
        if not self.checked:
            return np.zeros_like(self.solved)
        return self.solved & self.has_load & ~np.any([doubt.rows for doubt in self._doubts()], axis=0)

    @property
    def differs(self) -> np.ndarray:
        """True (n,) for frames that are solved, but of which the contact model, where it is fine enough, says
        otherwise."""
        return (
            self.solved & self.has_load & ~self._agrees & ~self._coarse if self.checked else np.zeros_like(self.solved)
        )

    @property
    def doubt(self) -> str:
        """Why the first kind of solved frames that are not verified is not; "" where all are."""
        return next((doubt.reason for doubt in self._doubts() if doubt.rows.any()), "")

    @property
    def words(self) -> list[str]:
        """The verdict of each frame (n,), with the load that differs most against what is allowed."""
        doubts = list(self._doubts())
        return [self._of_frame(k, doubts) for k in range(len(self.solved))]

    @property
    def exit_code(self) -> int:
        """0: every frame verified, or solved with no model to ask; 2: some not solved; 3: solved, not all verified."""
        if not self.solved[self.has_load].all():
            return 2
        return 0 if not self.checked or self.verified[self.has_load].all() else 3

    def __str__(self) -> str:
        count, solved = int(self.has_load.sum()), int((self.solved & self.has_load).sum())
        idle = len(self.solved) - count
        others = f", {idle} bear no load" if idle else ""
        if not self.checked:
            return f"{solved} of {count} solved{others}, not checked: {self.model}{self._own_words}"
        verified = int(self.verified.sum())
        alone = int((self.verified & self.on_model).sum())
        own = f", {alone} of them on it alone" if alone else ""
        parts = [f"{verified} of {count} solved and verified on {self.model}{own}{others}"]
        parts += [f"{doubt.rows.sum()} {doubt.of_rows(doubt.rows)}" for doubt in self._doubts() if doubt.rows.any()]
        if count > solved:
            parts.append(f"{count - solved} not solved")
        return "; ".join(parts)

    @property
    def _agrees(self) -> np.ndarray:
        return np.asarray((np.abs(self.errors) <= self.allowed).all(axis=1))

    @property
    def _coarse(self) -> np.ndarray:
        if self.off_finer is None:
            return np.zeros_like(self.solved)
        return np.asarray(~(np.abs(self.off_finer) <= self.allowed).all(axis=1))

    def _doubts(self) -> Iterator[_Doubt]:
        """In the order in which they are told; a frame has one at most."""
        left = self.solved & self.has_load
        for doubt in self._reasons():
            yield doubt._replace(rows=left & doubt.rows)
            left &= ~doubt.rows

    def _reasons(self) -> Iterator[_Doubt]:
        """Those that can be told, each on its own."""
        errors, finer, uncounted = self.errors, self.off_finer, self.uncounted
        if finer is not None:
            yield _Doubt(
                self._coarse,
                "the contact model is too coarse there",
                lambda rows: (
                    f"solved, but where elements half as wide differ, at most by {self._largest(finer, rows)}: "
                    "finer grids.teacher in the scene tell whether they hold"
                ),
                lambda frame: f"solved, elements half as wide differ by {self._largest(finer, frame)}",
            )
        if self.checked:
            yield _Doubt(
                ~self._agrees,
                "the contact model differs",
                lambda rows: f"solved but differ, at most by {self._largest(errors, rows)}",
                lambda frame: f"{DIFFERS} by {self._largest(errors, frame)}",
            )
        if uncounted is not None:
            yield _Doubt(
                uncounted > UNCOUNTED,
                "not all of their load is counted",
                lambda rows: f"solved, but up to {uncounted[rows].max():.0%} of their load lies where none is counted",
                lambda frame: f"solved, {uncounted[frame]:.0%} of the load not counted",
            )
        if self.leaps is not None:
            yield _Doubt(
                self.leaps,
                "their pose leaps",
                lambda rows: "solved, but their pose leaps from one to the next",
                lambda frame: LEAPS,
            )

    @property
    def _own_words(self) -> str:
        """The largest of a surrogate's own expected errors in solved frames, against what is allowed."""
        told = self.solved & self.has_load
        if self.expected is None or not told.any():
            return ""
        largest = self.expected[told].max(axis=0)
        load = int((largest / self.allowed).argmax())
        name = self.load_names[load]
        off, unit = format_above_limit(largest[load], self.allowed[load]), load_unit(name)
        return f"; the surrogate itself expects errors up to {off} {unit} ({name}, {self.allowed[load]:g} allowed)"

    def _largest(self, errors: Array, rows: np.ndarray | int) -> str:
        """Of errors (n, L) in rows, or in one: the one that is largest against what is allowed."""
        found = np.abs(np.atleast_2d(errors[rows]))
        of_allowed = np.nan_to_num(found / self.allowed, nan=np.inf)
        row, load = np.unravel_index(int(of_allowed.argmax()), found.shape)
        name = self.load_names[load]
        return f"{three_digits(found[row, load])} {load_unit(name)} ({name})"

    def _of_frame(self, frame: int, doubts: Sequence[_Doubt]) -> str:
        if not self.has_load[frame]:
            return NOT_ASKED
        if not self.solved[frame]:
            return UNSOLVED
        if not self.checked:
            return UNCHECKED
        words = [doubt.of_frame(frame) for doubt in doubts if doubt.rows[frame]]
        return words[0] if words else (ON_MODEL if self.on_model[frame] else VERIFIED)


def reference_model(scene: Scene) -> ContactModel | str:
    """The contact model that a scene's surrogates stand for, on its finest grid, or why there is none at hand."""
    if scene.layer is None:
        return f"the scene {scene.name} has no contact model at hand (ask yours in Python: cc.verify)"
    try:
        return ElasticFoundation(scene, scene.grids.get("teacher"))
    except (ValueError, OSError, ImportError) as error:
        return f"the scene {scene.name} has no contact model at hand ({error})"


def check_solution(
    tried: SymbolicContact,
    poses: ArrayLike,
    solved: ArrayLike,
    model: ContactModel | str,
    loads: Sequence[str] | None = None,
    on_model: ArrayLike = False,
) -> Verdict:
    """Evaluate a solution, poses (n, 6) and which of them are solved, (n,) or one word for all, on a contact model.

    model: `reference_model` of the scene as a rule; where it is a reason in words, frames are not checked.
    tried: the surrogate or foundation that the problem was solved on.
    loads: those of it that the problem uses, all if left out. on_model (n,): frames that were solved on the
    model itself, for want of a pose that the surrogate has learned. Raises ValueError where solved or on_model is of
    another number of poses.
    """
    poses, names = as_poses(poses), tried.check_loads(loads)
    ended, alone = (as_mask(key, value, len(poses)) for key, value in (("solved", solved), ("on_model", on_model)))
    tolerance = Tolerance.of(tried.scene, names)
    allowed = tolerance.single * tolerance.allowed  # of a single frame
    expected = uncounted = finer = None
    if isinstance(model, str):
        errors, name = np.full((len(poses), len(names)), np.nan), model
        if isinstance(tried, HasConfidence) and tried.confidence is not None:
            expected = tried.expected_error(poses)[:, [tried.load_names.index(load) for load in names]]
    else:
        errors = tried(poses, names) - loads_on(model, poses, names)
        errors[np.isnan(errors)] = np.inf
        errors[alone], name = 0.0, type(model).__name__
        if isinstance(model, ElasticFoundation):
            name, uncounted = model.label, unmodelled_fraction(model, poses)
            off = off_finer(model, poses[ended], names, allowed)
            if off is not None:
                finer = np.zeros((len(poses), len(names)))
                finer[ended] = off
    return Verdict(names, ended, errors, allowed, name, alone, expected, uncounted, finer)
