"""A surrogate no larger than a tolerance needs: rounds of more samples and larger networks until it is met.

What the tolerance bounds: the root mean square error of every load, over the held-back samples of every domain by
itself (D1 is the motion, D3 the whole box around it), on validation rows and on test rows. The first round that is
within it is the last: the result depends on the scene and the tolerance, not on the clock.
"""

import logging
import shutil
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

from casadi_contact.core.conventions import Update
from casadi_contact.core.files.reading import sha256_of
from casadi_contact.core.files.writing import replacing
from casadi_contact.core.quantities import FORCE, TORQUE, of_kind
from casadi_contact.core.workers import worker_pool
from casadi_contact.samples.models import teacher_of
from casadi_contact.samples.samples import TEST, VALIDATION, LoadModel, Samples, domain_errors, partial_folder
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.tolerance import Tolerance
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.calibration import calibrate
from casadi_contact.surrogate.info import Fitness
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from casadi_contact.workflow.fitting import Fitting, fit_surrogate
from casadi_contact.workflow.presets import TO_TOLERANCE, Preset
from casadi_contact.workflow.project import Project, exclusive, trained_surrogates
from casadi_contact.workflow.stages import build_command, sample

_log = logging.getLogger(__name__)


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


def misses(model: LoadModel, samples: Samples) -> str:
    """The domains and loads whose RMS error on held-back rows exceeds the scene's tolerance, in words; empty: none."""
    for role in (VALIDATION, TEST):
        found = domain_errors(model, samples, role)
        errors = {domain: {load: error["rms"] for load, error in loads.items()} for domain, loads in found.items()}
        judged = Fitness(errors, samples.scene.tolerances)
        if judged.fit != list(errors):
            return str(judged)
    return ""


def _refuse_others(project: Project) -> None:
    """ValueError for samples or surrogates in the folder that do not come from its rounds."""
    trained_surrogates(project)
    if project.samples_path.is_file():
        project.samples()
        rounds = project.folder.glob(f"within-*/samples-*/{project.samples_path.name}")
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
    rounds: Sequence[Preset] = TO_TOLERANCE,
) -> Surrogate:
    """Sample and train in rounds until the tolerances of the project's scene are met (see above), going on where an
    earlier run stopped; samples and surrogate of the last round go into the project's folder. Raises ValueError where
    that misses them all the same, and for a folder whose samples or surrogates no such build of this scene made."""
    _refuse_others(project)
    structure, missed = PatchSurrogate.structure, ""
    tolerances = (f"{tolerance:.15g}" for tolerance in project.scene.tolerances.values())
    folder = project.folder / "-".join(["within", *tolerances])
    for number, preset in enumerate(rounds, start=1):
        told = update and (lambda what, *rest, n=number: update(f"{what}, round {n}", *rest))
        this = replace(project, folder=folder / f"samples-{preset.sampling_scale:g}", own=preset)
        this.folder.mkdir(parents=True, exist_ok=True)
        samples, _ = sample(this, cycle_files, told, executor, model)
        with worker_pool(executor) as workers:
            command = build_command(project, samples, [*map(str, cycle_files)], *_options(project.scene))
            efforts, checkpoints = preset.efforts[structure], folder / f"training-{number}"
            fitting = Fitting(structure, efforts, checkpoints, command, f"round {number}")
            surrogate = fit_surrogate(this, samples, fitting, update, workers)
        missed = misses(surrogate, samples)
        if not missed:
            break
        _log.warning("round %d: %s", number, missed)
    for path in (this.samples_path, this.motion_path):
        with replacing(project.folder / path.name) as beside:
            shutil.copyfile(path, beside)
    with worker_pool(executor) as workers:
        calibrated = calibrate(surrogate, samples, teacher_of(samples), update, executor=workers)
    calibrated.save(project.surrogate_path(structure))
    if missed:
        said = f"after {number} rounds, {len(samples)} samples, the tolerance is missed: {missed}"
        raise ValueError(f"{said}; loosen it, or ask for fewer loads or a smaller range")
    return calibrated
