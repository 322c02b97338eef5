"""Verification: every frame of a solution evaluated again on the contact model that its surrogate was trained on."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import Array, as_poses
from casadi_contact.core.quantities import FORCE, format_above_limit, of_kind, quantity, three_digits
from casadi_contact.optimisation.reference import (
    loads_on,
    off_finer,
    reference_model,
    share_at_edges,
    unmodelled_fraction,
)
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.tolerance import Tolerance

UNCOUNTED = 0.05  # of a frame's load, where the model counts none or at edges: with more it is not verified
OUTSIDE = "outside the learned region"


@dataclass(frozen=True)
class Verification:
    """Comparison of a surrogate with a contact model at poses (n, 6) that solve a problem; ``print`` it.

    solved (n,): frames that the solver solved. errors (n, L): surrogate minus model [N, N·mm] of load_names, infinite
    where the model gave no number, NaN where there is no model. tolerance: the scene's. model: its name, or why there
    is none. outside (n,): frames outside the learned region. uncounted, at_edge (n,): shares of the load where the
    scene has no elements, and at edges of the elements. allowed (n, L): largest errors of a verified frame.
    off_finer (n, L): discretisation error of the model (`off_finer`). without_load (n,): frames without load, which are
    not compared. leaps (n,): frames whose pose leaps (`beside_leaps`)."""

    load_names: tuple[str, ...]
    poses: Array
    solved: np.ndarray
    errors: Array
    tolerance: Tolerance
    model: str
    outside: np.ndarray
    uncounted: Array
    at_edge: Array
    allowed: Array
    off_finer: Array
    without_load: np.ndarray
    leaps: np.ndarray

    @property
    def checked(self) -> bool:
        """True where there was a contact model to compare with."""
        return not np.isnan(self.errors).all()

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
        known = self.errors[np.isfinite(self.errors).all(axis=1)]
        return known if len(known) else np.full((1, len(self.load_names)), np.nan)

    @property
    def verified(self) -> np.ndarray:
        """True (n,) for frames that are solved, and on the contact model as well, which counts all of their load and is
        fine enough there, in a pose that does not leap."""
        if not self.checked:
            return np.zeros_like(self.solved)
        verified = self.solved & ~self.without_load
        for rows, *_ in self._doubts():
            verified &= ~rows
        return verified

    @property
    def failing(self) -> np.ndarray:
        """True (n,) for frames unsolved, outside the learned region or with a single error that is too large; where an
        RMS is too large, frames with errors above it too."""
        single = self.tolerance.single if (self.tolerance.rms_ratios(self.rms) <= 1.0).all() else 1.0
        return ~self.solved | self.outside | ~(np.abs(self.errors) <= single * self.tolerance.allowed).all(axis=1)

    @property
    def passed(self) -> bool:
        """The errors meet the tolerance, every frame is solved, in the learned region and answered by the model."""
        return not self.failing.any() and self.tolerance.met(self.errors)

    @property
    def words(self) -> list[str]:
        """The result of each frame (n,), with the load that differs most in proportion to what is allowed."""
        best = "solved and verified" if self.checked else "solved, not checked"
        words = np.select([self.without_load, ~self.solved], ["no load", "not solved"], best).tolist()
        for rows, said, sizes, _ in self._doubts():
            for frame in np.flatnonzero(rows).tolist():
                words[frame] = f"solved, {said} {self._largest(sizes, rows=[frame])}".rstrip()
        beyond = self.solved & self.outside & ~self.without_load
        return [f"{word}, {OUTSIDE}" if out else str(word) for word, out in zip(words, beyond, strict=True)]

    @property
    def exit_code(self) -> int:
        """0: every frame verified, or solved with no model to compare; 3: some unsolved; 4: some not verified."""
        if not (self.solved | self.without_load).all():
            return 3
        return 0 if not self.checked or (self.verified | self.without_load).all() else 4

    @property
    def line(self) -> str:
        """All frames in one line, with the numbers of those outside the learned region."""
        loaded = ~self.without_load
        count, solved, idle = (int(rows.sum()) for rows in (loaded, self.solved & loaded, self.without_load))
        others = f", {idle} bear no load" if idle else ""
        if not self.checked:
            return f"{solved} of {count} solved{others}, not checked: {self.model}"
        parts = [f"{int(self.verified.sum())} of {count} solved and verified on {self.model}{others}"]
        if count > solved:
            parts.append(f"{count - solved} not solved ({_numbers(~self.solved & loaded)})")
        for rows, said, sizes, cure in self._doubts():
            most = f" {self._largest(sizes, rows)} at most" if sizes is not None else ""
            parts.append(f"{rows.sum()} solved, {said}{most}{cure}")
        if (outside := self.outside & loaded).any():
            parts.append(f"{outside.sum()} ({_numbers(outside)}) {OUTSIDE}")
        return "; ".join(parts)

    def __str__(self) -> str:
        if not self.checked:
            return self.line
        lines = [self.line, f"  {'load':<8}{'RMS':>10}{'worst':>10}{'tolerance':>11}"]
        rows = zip(self.load_names, self.rms, self.worst, self.tolerance.allowed, strict=True)
        for name, rms, worst, allowed in rows:
            said = quantity(name).unit + ("" if rms <= allowed else "  too large")
            lines.append(f"  {name:<8}{format_above_limit(rms, allowed):>10}{worst:>10.3g}{allowed:>11g} {said}")
        return "\n".join([*lines, "  passed" if self.passed else "  not passed"])

    def _doubts(self) -> Iterator[tuple[np.ndarray, str, Array | None, str]]:
        """Why solved frames are not verified: rows (n,), words, sizes (n,) or (n, L) to name after them, and a cure. A
        frame has the first of its doubts alone."""
        if not self.checked:
            return
        wider = "; wider bounds in geometry.patches or a larger mesh tell what lies beyond"
        finer = "; finer grids.teacher (of a mesh also geometry.spacing) in the scene tell whether they hold"
        reasons: tuple[tuple[np.ndarray, str, Array | None, str], ...] = (
            (self.at_edge > UNCOUNTED, "load at an edge of the elements:", self.at_edge, wider),
            (~self._within(self.off_finer), "elements half as wide differ by", self.off_finer, finer),
            (~self._within(self.errors), "differs by", self.errors, ""),
            (self.uncounted > UNCOUNTED, "load not counted:", self.uncounted, ""),
            (self.leaps, "its pose leaps", None, ""),
        )
        left = self.solved & ~self.without_load
        for rows, *said in reasons:
            if (left & rows).any():
                yield left & rows, *said
            left &= ~rows

    def _within(self, errors: Array) -> np.ndarray:
        """True (n,) for frames whose errors (n, L) are all allowed; False for such that are no numbers."""
        return np.asarray((np.abs(errors) <= self.allowed).all(axis=1))

    def _largest(self, sizes: Array | None, rows: np.ndarray | list[int]) -> str:
        """The largest share (n,) in rows, or the error (n, L) that is largest against what is allowed."""
        if sizes is None:
            return ""
        if sizes.ndim == 1:
            return f"{sizes[rows].max():.0%}"
        found = np.abs(sizes[rows])
        row, load = np.unravel_index(int(np.nan_to_num(found / self.allowed[rows], nan=np.inf).argmax()), found.shape)
        name = self.load_names[load]
        return f"{three_digits(found[row, load])} {quantity(name).unit} ({name})"


def _numbers(rows: np.ndarray) -> str:
    """The first ten of the frames that are meant (n,)."""
    frames = np.flatnonzero(rows).tolist()
    return ", ".join(map(str, frames[:10])) + (", ..." if len(frames) > 10 else "")


def allowed_errors(scene: Scene, names: Sequence[str], forces: Array, share: float = 0.01) -> Array:
    """Largest errors (n, L) of named loads in verified frames with forces (n, F) [N]: a force may be off by 1 % of the
    frame's (√ΣF²) and 0.5 % of the scene's reference load (5 N of 1,000 N), but not by more than a single one may
    (`Tolerance`); a torque by as much of its own."""
    single = Tolerance.of(scene, names).allowed * Tolerance.single
    of_force = Tolerance.single * min(scene.tolerances_of(of_kind(scene.load_names, FORCE)))
    load_n = np.linalg.norm(forces, axis=1) + 0.5 * scene.reference_load
    return np.minimum(share * load_n / of_force, 1.0)[:, None] * single


def verify(
    surrogate: SymbolicContact,
    poses: ArrayLike,
    model: ContactModel | str | None = None,
    solved: ArrayLike = True,
    loads: Sequence[str] | None = None,
    *,
    without_load: ArrayLike = False,
    leaps: ArrayLike = False,
) -> Verification:
    """Compare a surrogate, or a foundation, with a contact model at poses (n, 6) of a solution on it.

    model: the `reference_model` if left out; any other should err well below the scene's tolerances. Text in its place
    says why there is none: frames are then not compared. solved (n,): frames that the solver solved. loads: those that
    the problem uses, all if left out. without_load, leaps: as in `Verification`. Raises ValueError for no poses,
    unknown loads, and masks of another shape.
    """
    poses, names = as_poses(poses), surrogate.check_loads(loads)
    if not len(poses):
        raise ValueError("no poses to verify, expected (n, 6) with n >= 1")
    if model is None:
        model = reference_model(surrogate)
    given = {"solved": solved, "without_load": without_load, "leaps": leaps}
    rows = {key: _truths(key, value, len(poses)) for key, value in given.items()}
    scene, shape = surrogate.scene, (len(poses), len(names))
    forces = of_kind(surrogate.load_names, FORCE)
    allowed = allowed_errors(scene, names, surrogate(poses, forces))
    outside = np.zeros(len(poses), dtype=bool)
    if hasattr(surrogate, "validity"):  # of other models no region is known
        outside |= surrogate.validity(poses) < 0.5 if getattr(surrogate, "confidence", None) is not None else True
    uncounted, at_edge, finer = np.zeros(len(poses)), np.zeros(len(poses)), np.zeros(shape)
    if isinstance(model, str):
        errors, said = np.full(shape, np.nan), model
    else:
        errors = surrogate(poses, names) - loads_on(model, poses, names)
        errors[~np.isfinite(errors)] = np.inf
        said = getattr(model, "label", type(model).__name__)
        if isinstance(model, ElasticFoundation):
            uncounted, at_edge = unmodelled_fraction(model, poses), share_at_edges(model, poses)
            ended = rows["solved"]
            finer[ended] = off_finer(model, poses[ended], names, allowed[ended])
    found = {"errors": errors, "outside": outside, "uncounted": uncounted, "at_edge": at_edge, "off_finer": finer}
    return Verification(
        names, poses, **found, **rows, allowed=allowed, tolerance=Tolerance.of(scene, names), model=said
    )


def beside_leaps(poses: Array, solved: ArrayLike = True) -> np.ndarray:
    """True (n, 6) where a pose parameter of poses (n, 6) leaps between neighbouring solved (n,) frames, as it may where
    several poses carry the same loads. A leap is a step of more than 2 mm or 3 degrees that is also more than 4 times
    the usual one: the median of the two steps before and the two behind it, or, if less, the sum of the step and its
    neighbour (which is small where the pose leaps and comes back), but not below the median of all steps."""
    moves = np.diff(poses, axis=0)
    steps = np.abs(moves)
    padded, count = np.pad(steps, ((2, 2), (0, 0)), constant_values=np.nan), len(steps)
    others = np.stack([padded[at : at + count] for at in (0, 1, 3, 4)])
    alone = np.isnan(others).all(axis=0)  # two frames: no step is usual
    usual = np.nanmedian(np.where(alone, np.inf, others), axis=0)
    least = np.array([2.0] * 3 + [np.radians(3.0)] * 3)
    left = np.abs(moves[1:] + moves[:-1])  # of one step and the next
    back = np.full_like(steps, np.inf)
    back[:-1] = left
    back[1:] = np.minimum(back[1:], left)
    back = np.maximum(back, np.median(steps, axis=0)) if count else back
    found = np.zeros(poses.shape, dtype=bool)
    known = np.broadcast_to(solved, len(poses))[:, None]
    found[1:] = (steps > least) & (steps > 4.0 * np.minimum(usual, back)) & known[1:] & known[:-1]
    found[:-1] |= found[1:]
    return found


def _truths(key: str, value: ArrayLike, count: int) -> np.ndarray:
    """True or False (n,) for each pose, given for each or for all."""
    given = np.asarray(value)
    if given.dtype.kind not in "biuf" or not np.isin(given, (0, 1)).all():
        raise ValueError(f"{key} holds {given.ravel()[:1]}, expected True or False")
    if given.shape not in ((), (count,)):
        raise ValueError(f"{key} has shape {given.shape}, expected one for each of {count} poses, or one for all")
    return np.broadcast_to(given.astype(bool), count)
