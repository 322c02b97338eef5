"""A verdict on every frame of a solution: solved and verified, solved but the contact model differs, or not solved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact import ContactModel, ElasticFoundation, SymbolicContact
from casadi_contact.conventions import Array, as_poses, load_unit
from casadi_contact.quantities import beside, three_digits
from casadi_contact.scenes import Scene
from casadi_contact.structures import Surrogate
from casadi_contact.verification.uncertain_load import uncounted_share
from casadi_contact.verification.verify import loads_on, true_of_each

UNCOUNTED = 0.05  # of a frame's load, that lies where the contact model counts none: with more it is not verified
ALLOWED = 3.0  # times the scene's tolerances, which are root mean squares: how far off a single frame may be
VERIFIED, DIFFERS, UNSOLVED, UNCHECKED = "solved and verified", "solved, differs", "not solved", "solved, not checked"
ON_MODEL, LEAPS = "solved on the contact model", "solved, its pose leaps"


@dataclass(frozen=True)
class Verdict:
    """What the contact model says of a solution on a surrogate; its text is the first line of a summary.

    solved (n,): as the solver says; errors (n, L): surrogate minus model [N, N·mm] of load_names, infinite where the
    model gave no number, NaN where there was no model to ask; allowed (L,): the largest error of a verified frame;
    model: its name, or why there is none; on_model (n,): frames that were solved on that model itself, which have no
    error; expected (n, L): what a surrogate itself says of its errors (`Surrogate.expected_error`) where there was no
    model to ask, None where it says nothing; uncounted (n,): share of the load that lies where no model of the scene
    counts any (`uncounted_share`), None where the model is not the scene's elements; leaps (n,): frames whose pose lies
    apart from a neighbour's, None where nobody looked.
    """

    load_names: tuple[str, ...]
    solved: np.ndarray
    errors: Array
    allowed: Array
    model: str
    on_model: np.ndarray
    expected: Array | None = None
    uncounted: Array | None = None
    leaps: np.ndarray | None = None

    @property
    def checked(self) -> bool:
        """True where there was a contact model to ask."""
        return not np.isnan(self.errors).all()

    @property
    def verified(self) -> np.ndarray:
        """True (n,) for frames that are solved, and on the contact model as well, which counts all of their load, in a
        pose that does not leap."""
        return self.solved & self._agrees & ~self._incomplete & ~self._leaps

    @property
    def differs(self) -> np.ndarray:
        """True (n,) for frames that are solved, but of which the contact model says otherwise."""
        return self.solved & ~self._agrees if self.checked else np.zeros_like(self.solved)

    @property
    def doubt(self) -> str:
        """Why the first kind of solved frames that are not verified is not; "" where all are."""
        if self.differs.any():
            return "the contact model differs"
        if (self.solved & self._incomplete).any():
            return "not all of their load is counted"
        return "their pose leaps" if (self.solved & self._leaps).any() else ""

    @property
    def words(self) -> list[str]:
        """The verdict of each frame (n,), with the load that differs most against what is allowed."""
        return [self._of_frame(k) for k in range(len(self.solved))]

    @property
    def exit_code(self) -> int:
        """0: every frame verified, or solved with no model to ask; 2: some not solved; 3: solved, not all verified."""
        if not self.solved.all():
            return 2
        return 0 if not self.checked or self.verified.all() else 3

    def __str__(self) -> str:
        count, solved = len(self.solved), int(self.solved.sum())
        if not self.checked:
            return f"{solved} of {count} solved, not checked: {self.model}{self._own_words}"
        verified = int(self.verified.sum())
        alone = int((self.verified & self.on_model).sum())
        own = f", {alone} of them on it alone" if alone else ""
        parts = [f"{verified} of {count} solved and verified on {self.model}{own}"]
        if self.differs.any():
            worst = int(np.where(self.solved, self._excess, -1.0).argmax())
            parts.append(f"{int(self.differs.sum())} solved but differ, at most by {self._largest(worst)}")
        if (lost := self.solved & self._agrees & self._incomplete).any():
            most = f"{self._uncounted[lost].max():.0%}"
            parts.append(f"{int(lost.sum())} solved, but up to {most} of their load lies where none is counted")
        if (apart := self.solved & self._agrees & ~self._incomplete & self._leaps).any():
            parts.append(f"{int(apart.sum())} solved, but their pose leaps from one to the next")
        if count > solved:
            parts.append(f"{count - solved} not solved")
        return "; ".join(parts)

    @property
    def _agrees(self) -> np.ndarray:
        return np.asarray((np.abs(self.errors) <= self.allowed).all(axis=1))

    @property
    def _uncounted(self) -> Array:
        return np.zeros(len(self.solved)) if self.uncounted is None else self.uncounted

    @property
    def _incomplete(self) -> np.ndarray:
        return np.asarray(self._uncounted > UNCOUNTED)

    @property
    def _leaps(self) -> np.ndarray:
        return np.zeros(len(self.solved), dtype=bool) if self.leaps is None else self.leaps

    @property
    def _own_words(self) -> str:
        """The largest of a surrogate's own expected errors in solved frames, against what is allowed."""
        if self.expected is None or not self.solved.any():
            return ""
        largest = self.expected[self.solved].max(axis=0)
        load = int((largest / self.allowed).argmax())
        name = self.load_names[load]
        off, unit = beside(largest[load], self.allowed[load]), load_unit(name)
        return f"; the surrogate itself expects errors up to {off} {unit} ({name}, {self.allowed[load]:g} allowed)"

    @property
    def _excess(self) -> Array:
        """Largest error of each frame (n,) over what is allowed."""
        return np.asarray(np.nan_to_num(np.abs(self.errors) / self.allowed, nan=np.inf).max(axis=1))

    def _largest(self, frame: int) -> str:
        load = int((np.abs(self.errors[frame]) / self.allowed).argmax())
        name = self.load_names[load]
        return f"{three_digits(abs(self.errors[frame, load]))} {load_unit(name)} ({name})"

    def _of_frame(self, frame: int) -> str:
        if not self.solved[frame]:
            return UNSOLVED
        if not self.checked:
            return UNCHECKED
        if self._agrees[frame] and self._incomplete[frame]:
            return f"solved, {self._uncounted[frame]:.0%} of the load not counted"
        if self._agrees[frame] and self._leaps[frame]:
            return LEAPS
        if self.on_model[frame]:
            return ON_MODEL
        return VERIFIED if self.verified[frame] else f"{DIFFERS} by {self._largest(frame)}"


def own_model(scene: Scene) -> ContactModel | str:
    """The contact model that a scene's surrogates stand for, on its finest grid, or why there is none at hand."""
    if scene.layer is None:
        return f"the scene {scene.name} has no contact model at hand (ask yours in Python: cc.verify)"
    try:
        return ElasticFoundation(scene, scene.grids.get("teacher"))
    except (ValueError, OSError, ImportError) as error:
        return f"the scene {scene.name} has no contact model at hand ({error})"


def judge(
    tried: SymbolicContact,
    poses: ArrayLike,
    solved: ArrayLike,
    model: ContactModel | str,
    loads: Sequence[str] | None = None,
    on_model: ArrayLike = False,
) -> Verdict:
    """Evaluate a solution, poses (n, 6) and which of them are solved, (n,) or one word for all, on a contact model.

    model: `own_model` of the scene as a rule; where it is a reason in words, frames are not checked.
    tried: the surrogate or foundation that the problem was solved on.
    loads: those of it that the problem uses, all if left out. on_model (n,): frames that were solved on the
    model itself, for want of a pose that the surrogate has learned. Raises ValueError where solved or on_model is of
    another number of poses.
    """
    poses, names = as_poses(poses), tried.check_loads(loads)
    ended, alone = (true_of_each(key, value, len(poses)) for key, value in (("solved", solved), ("on_model", on_model)))
    expected = uncounted = None
    if isinstance(model, str):
        errors, name = np.full((len(poses), len(names)), np.nan), model
        if isinstance(tried, Surrogate) and tried.trust is not None:
            expected = tried.expected_error(poses)[:, [tried.load_names.index(load) for load in names]]
    else:
        errors = tried(poses, names) - loads_on(model, poses, names)
        errors[np.isnan(errors)] = np.inf
        errors[alone], name = 0.0, type(model).__name__
        if isinstance(model, ElasticFoundation):
            name, uncounted = model.label, uncounted_share(model, poses)
    allowed = ALLOWED * tried.scene.tolerances_of(names)
    return Verdict(names, ended, errors, allowed, name, alone, expected, uncounted)
