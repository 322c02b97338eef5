"""A surrogate no larger than a tolerance needs: samples, networks and work grow until it is met in every domain.

Round k draws twice the samples of the round before and lets each network grow with three times the work to a closer
fit. The first round whose validation rows have errors within four fifths of the tolerance, load by load and domain by
domain, is the last: the result depends on the scene and the tolerance, not on the clock. In the last round allowed,
errors within the tolerance itself are enough. Networks grow from small ones, so that none is much larger than needed.
"""

from __future__ import annotations

import logging
import shutil
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

from casadi_contact.core.conventions import Update
from casadi_contact.core.files.reading import sha256_of
from casadi_contact.core.files.writing import replacing
from casadi_contact.core.quantities import FORCE, TORQUE, of_kind, three_digits
from casadi_contact.core.workers import worker_pool
from casadi_contact.samples.models import teacher_of
from casadi_contact.samples.samples import TEST, VALIDATION, LoadModel, Samples, domain_errors, partial_folder
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.tolerance import Tolerance
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.calibration import calibrate
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from casadi_contact.workflow.fitting import Fitting, fit_surrogate
from casadi_contact.workflow.presets import Effort, Preset
from casadi_contact.workflow.project import Project, exclusive, trained_surrogates
from casadi_contact.workflow.samples import sample
from casadi_contact.workflow.train import build_command

_log = logging.getLogger(__name__)

_FIT_SHARE, _CLOSER = 0.6, 0.7  # of the tolerance at which a fit ends, since domains differ; times 0.7 in each round
_MET = 0.8  # of it that validation rows must meet: the few hundred rows of a domain give its error no closer


@dataclass(frozen=True)
class ToleranceSettings:
    """How samples and networks grow.

    rounds: at most. first_scale, first_gflop: samples (as a share of the paper's) and budget of a root network in the
    first round. sizes: hidden layers to grow through.
    """

    rounds: int = 6
    first_scale: float = 0.1
    first_gflop: float = 60.0
    sizes: tuple[tuple[int, ...], ...] = (
        *((8,), (8, 8), (12, 12), (16, 16)),
        *((16, 16, 16), (20, 20, 20), (24, 24, 24), (28, 28, 28)),
    )

    def efforts(self, round_number: int) -> dict[str, Effort]:
        """The effort of root networks and of all others, in this round (from 1)."""
        gflop = self.first_gflop * 3.0 ** (round_number - 1)
        share = _FIT_SHARE * _CLOSER ** (round_number - 1)
        of_ratios = PatchSurrogate.budget_shares["ratios"] * gflop
        return {
            "": Effort(self.sizes, of_ratios, tolerance_share=share),
            "root": Effort(self.sizes, gflop, tolerance_share=share),
        }


def scene_to_tolerance(scene: Scene, force_n: float | None, torque_nmm: float | None) -> Scene:
    """The scene with one tolerance for all forces [N] and one for all torques [N·mm]; its own where None."""
    Tolerance.of_kinds(force_n, torque_nmm)
    wanted: dict[str, float] = {}
    for kind, value in ((FORCE, force_n), (TORQUE, torque_nmm)):
        if value is None:
            continue
        names = of_kind(scene.load_names, kind)
        if not names:
            raise ValueError(f"got a {kind.name} tolerance, but scene {scene.name} has no such load: leave it out")
        wanted |= dict.fromkeys(names, value)
    return scene.with_tolerances(**wanted)


def _options(scene: Scene) -> list[str]:
    """What asks for the scene's tolerances on the command line: of each kind of load whose tolerances are all one."""
    options = []
    for kind, option in ((FORCE, "--force-tol"), (TORQUE, "--torque-tol")):
        values = {scene.tolerances[name] for name in of_kind(scene.load_names, kind)}
        options += [option, f"{values.pop():.15g}"] if len(values) == 1 else []
    return options


def misses(model: LoadModel, samples: Samples, share: float, role: int = VALIDATION) -> list[str]:
    """Loads whose RMS error on validation rows (or those of another role) of a domain exceeds this share of the scene's
    tolerance, in words, the worst first."""
    found = {}
    for domain, errors in domain_errors(model, samples, role).items():
        tolerance = Tolerance.of(samples.scene, tuple(errors)).times(share)
        ratios = tolerance.rms_ratios([error["rms"] for error in errors.values()])
        for (load, error), ratio, allowed in zip(errors.items(), ratios, tolerance.allowed, strict=True):
            if ratio > 1.0:
                found[f"{load} {three_digits(error['rms'])} of {allowed:g} in {domain}"] = ratio
    return sorted(found, key=lambda text: -found[text])


def _refuse_others(project: Project) -> None:
    """ValueError for samples or surrogates in the folder that do not come from its rounds."""
    trained_surrogates(project)
    if project.samples_path.is_file():
        project.samples()
        rounds = project.folder.glob(f"within-*/round-*/{project.samples_path.name}")
        others = sha256_of(project.samples_path) not in map(sha256_of, rounds)
    else:
        others = project.has_results or partial_folder(project.samples_path).is_dir()
    if others:
        raise ValueError(f"{project.folder} holds samples or surrogates of another build: choose another --out")


@exclusive
def train_to_tolerance(
    project: Project,
    cycle_files: Sequence[Path] = (),
    update: Update | None = None,
    executor: Executor | None = None,
    model: str = "elements",
    settings: ToleranceSettings | None = None,
) -> Surrogate:
    """Sample and train in rounds until the tolerances of the project's scene are met on validation and test rows;
    samples and surrogate of the last round go into the project's folder.

    Goes on where an earlier run stopped. Raises ValueError, naming the largest misses, where the last round does not
    meet them; its samples and surrogate are kept all the same. A ValueError also refuses a folder with samples or
    surrogates that no such build of this scene made: they would be replaced.
    """
    chosen = settings or ToleranceSettings()
    structure = PatchSurrogate.structure
    _refuse_others(project)
    tolerances = (f"{tolerance:.15g}" for tolerance in project.scene.tolerances.values())
    rounds_folder = project.folder / "-".join(["within", *tolerances])
    for number in range(1, chosen.rounds + 1):
        efforts = chosen.efforts(number)
        preset = Preset(chosen.first_scale * 2 ** (number - 1), {structure: efforts})
        this = replace(project, folder=rounds_folder / f"round-{number}", own=preset)
        this.folder.mkdir(parents=True, exist_ok=True)
        samples, _ = sample(this, cycle_files, _in_round(update, number), executor, model)
        with worker_pool(executor) as workers:
            cycles = [str(path) for path in cycle_files]
            command = build_command(project, samples, cycles, *_options(project.scene))
            fitting = Fitting(structure, efforts, this.folder / "training", command, f"round {number}")
            surrogate = fit_surrogate(this, samples, fitting, update, workers)
            share = _MET if number < chosen.rounds else 1.0
            missed = misses(surrogate, samples, share) or misses(surrogate, samples, 1.0, TEST)
            if not missed:
                break
        _log.warning("round %d misses %s", number, "; ".join(missed[:3]))
    for name in (this.samples_path.name, this.motion_path.name):
        with replacing(project.folder / name) as beside:
            shutil.copyfile(this.folder / name, beside)
    teacher = teacher_of(samples)
    calibrated = calibrate(surrogate, samples, teacher, update)
    calibrated.save(project.surrogate_path(structure))
    if missed:
        raise ValueError(
            f"after {number} rounds, {len(samples)} samples, the tolerance is missed: {'; '.join(missed[:3])}; "
            "loosen it, or ask for fewer loads or a smaller range"
        )
    return calibrated


def _in_round(update: Update | None, number: int) -> Update | None:
    return None if update is None else lambda what, *rest: update(f"{what}, round {number}", *rest)
