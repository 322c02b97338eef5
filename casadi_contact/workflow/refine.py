"""Refinement: new samples around the frames that fail verification, warm training, the problem solved again."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array
from casadi_contact.networks.training.fit import Fit, fit
from casadi_contact.networks.training.settings import TrainingSettings
from casadi_contact.optimisation.verification import Verification, verify
from casadi_contact.samples.chunk import Chunk, draw_chunk
from casadi_contact.samples.draw import joined_chunks
from casadi_contact.samples.samples import TEST, TRAIN, VALIDATION, Samples, domain_errors, samples_record
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.calibration import calibrate
from casadi_contact.workflow.fitting import fits_record, summed_work

# A round draws poses so many scales of the range around a failing frame, and normal loads between shares of the
# frame's own; of them a share is lifted off (as in D5).
_SPREAD, _LOAD_SHARES, _LIFTED = 0.3, (0.2, 1.3), 0.1
# Samples of before that are trained on again for each new one, and at least, so that they are not forgotten.
_KNOWN_PER_NEW, _LEAST_KNOWN = 3, 12_000
_TOLERANCE_SHARE = 0.2  # at which a fit ends: better than needed, because a few rows must be good among many

Solve = Callable[[Surrogate], tuple[Array, np.ndarray]]
"""A problem: surrogate -> poses (n, 6) of its solution, and which frames (n,) it solved."""


@dataclass(frozen=True)
class Refinement:
    """The refined surrogate, all samples, a verification before the first and after each round, and the number of
    samples that each added; ``print`` it."""

    surrogate: Surrogate
    samples: Samples
    verifications: list[Verification]
    added: list[int]

    @property
    def passed(self) -> bool:
        """True if the last verification passed."""
        return self.verifications[-1].passed

    def __str__(self) -> str:
        lines = [
            f"round {k}: {added} samples, {int(before.failing.sum())} failing frames before it"
            for k, (added, before) in enumerate(zip(self.added, self.verifications, strict=False), start=1)
        ]
        return "\n".join([*lines, str(self.verifications[-1])])


def refine(
    surrogate: Surrogate,
    samples: Samples,
    solve: Solve,
    model: ContactModel,
    *,
    rounds: int = 3,
    gflop: float = 600.0,
    per_frame: int = 20,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Refinement:
    """Solve, verify, and as long as that fails: sample around the failing frames, train on, calibrate, solve again.

    solve: surrogate -> poses (n, 6) of the solution and which frames (n,) are solved; frames that ``pose_range`` of the
    record leaves unsolved fail, and it grows with the samples around them. samples: what the surrogate was trained on.
    model: verifies, settles and labels the new samples (`per_frame` static analyses around each failing frame). gflop:
    of each network in each round, see `TrainingSettings`. progress(text) is told each step.

    Raises ValueError like `verify` and `calibrate`, for another answer of solve, and where no sample could be drawn."""
    if rounds < 0 or per_frame < 1:
        raise ValueError(f"rounds is {rounds} and per_frame {per_frame}, expected at least 0 and 1")
    tell = progress or (lambda text: None)
    result = Refinement(surrogate, samples, [_verified(surrogate, solve, model)], [])
    while not result.passed and len(result.added) < rounds:
        number = len(result.added) + 1
        tell(f"{result.verifications[-1]}")
        rng = np.random.default_rng([seed, number])
        new = _drawn_around(result.surrogate, result.verifications[-1], model, per_frame, rng)
        tell(f"round {number}: {len(new)} new samples")
        better = _trained_on(result.surrogate, result.samples, new, model, gflop, rng)
        checks = [*result.verifications, _verified(better, solve, model)]
        result = Refinement(better, result.samples.join_samples(new), checks, [*result.added, len(new)])
    return result


def _verified(surrogate: Surrogate, solve: Solve, model: ContactModel) -> Verification:
    solution = solve(surrogate)
    if not isinstance(solution, tuple) or len(solution) != 2:
        raise ValueError(f"solve returned a {type(solution).__name__}, expected poses (n, 6) and which (n,) are solved")
    poses, solved = solution
    return verify(surrogate, poses, model, solved)


def _drawn_around(
    surrogate: Surrogate, check: Verification, model: ContactModel, per_frame: int, rng: np.random.Generator
) -> Samples:
    """Samples around failing frames, pressed on the model by shares of the normal loads that the surrogate gives there,
    some of them lifted off: as D1 and D5 lie around a motion, and counted as these."""
    scene, scales = surrogate.scene, surrogate.require_confidence().scales
    sampling, columns = SamplingSettings.from_scene(scene), list(scene.pose_space.free)
    starts = check.poses[np.repeat(np.flatnonzero(check.failing), per_frame)]
    count, roots = len(starts), surrogate.root_loads(starts)[0]
    starts[:, columns] += _SPREAD * scales[columns] * rng.uniform(-1.0, 1.0, (count, len(columns)))
    starts = scene.pose_space.project(starts)
    normal = scene.reference_load * np.maximum(roots, 0.0) ** 2 * rng.uniform(*_LOAD_SHARES, roots.shape)
    role = rng.choice([TRAIN, VALIDATION, TEST], count, p=[0.8, 0.1, 0.1]).astype(np.uint8)
    lifted = rng.random(count) < _LIFTED
    normal = np.where(lifted[:, None], scene.boundary_load, np.maximum(normal, scene.boundary_load))
    parts = []
    for domain, rows in ((1, ~lifted), (5, lifted)):
        wanted = dict(zip(scene.patch_names, normal[rows].T, strict=True))
        chunk = Chunk(domain, -1, (), starts[rows], wanted, role[rows])
        parts.append(draw_chunk(model, model, chunk, sampling))
    if not any(len(part.poses) for part in parts):
        reasons = sorted({reason for part in parts for reason in part.dropped})
        raise ValueError(f"no sample could be drawn around the failing frames: {'; '.join(reasons)}")
    return joined_chunks(scene, parts)


def _trained_on(
    surrogate: Surrogate, known: Samples, new: Samples, model: ContactModel, gflop: float, rng: np.random.Generator
) -> Surrogate:
    """The surrogate's networks trained on from where they are, on the new samples and some of the known ones, and
    calibrated on all, and on the model around them."""
    count = max(_KNOWN_PER_NEW * len(new), _LEAST_KNOWN)
    some = known.rows(np.sort(rng.permutation(len(known))[:count])).join_samples(new)
    networks, fits = dict(surrogate.networks), dict[str, Fit]()
    for regression in surrogate.regressions(some):
        start = networks[regression.name]
        effort = TrainingSettings(sizes=(start.hidden,), activation=start.activation, max_gflop=gflop, restarts=0)
        closer = replace(regression, tolerance=_TOLERANCE_SHARE * regression.tolerance)
        fits[regression.name] = fit(closer, effort, start=start)
        networks[regression.name] = fits[regression.name].network
    everything, kind, before = known.join_samples(new), type(surrogate), surrogate.record
    of_fits = fits_record(fits)
    record = {**before, **samples_record(everything), **of_fits, **summed_work(before, of_fits)}
    record["refined"] = int(before.get("refined", 0)) + 1
    if not before.get("refined"):
        record["command"] = f"cc.refine in Python, of what this makes: {before.get('command', 'not known')}"
    record["test_errors"] = domain_errors(kind(surrogate.scene, networks, record), everything)
    return calibrate(kind(surrogate.scene, networks, record), everything, model)
